"""The example of a user's own actuator, and changed copies of it."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "own_actuator"
FILE = FOLDER / "direct_drive.py"
MODEL = str(FILE)


def changed(folder: Path, *changes: tuple[str, str], name: str = "mine.py") -> Path:
    """Write a copy of the example with replaced texts, and return its path."""
    text = FILE.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name
