"""Code blocks of the documents that are said to be tested: those after a line `<!-- run: name -->`."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_BLOCK = re.compile(r"<!-- run: (\w+) -->\n```(\w+)\n(.*?)```", re.DOTALL)


def recipes(document: str) -> dict[str, tuple[str, str]]:
    """Language and text of each marked block of a document in docs/, by name."""
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return {name: (language, block) for name, language, block in _BLOCK.findall(text)}
