"""Tested code blocks of documents, which follow a line `<!-- run: name -->`, and commands in documents."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from tests.hosts.host import missing

ROOT = Path(__file__).resolve().parents[2]
_BLOCK = re.compile(r"<!-- run: (\w+) -->\n```(\w+)\n(.*?)```", re.DOTALL)


def recipes(document: str) -> dict[str, tuple[str, str]]:
    """Return language and text of each marked block of a document in docs/, by name."""
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return {name: (language, block) for name, language, block in _BLOCK.findall(text)}


def run_block(document: str, name: str, folder: Path) -> None:
    """Run a shell block of a document in docs/ in a folder, with this environment's programs first."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    subprocess.run(["sh", "-euc", recipes(document)[name][1]], cwd=folder, check=True,
                   env={**os.environ, "PATH": path}, stdout=subprocess.DEVNULL, timeout=120)


def build_site(folder: Path) -> Path:
    """Build the site into a folder and return the folder; skip the test without MkDocs."""
    if importlib.util.find_spec("mkdocs") is None or importlib.util.find_spec("mkdocstrings") is None:
        missing("there is no mkdocs (pip install -e '.[docs]')")
    result = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
                            cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr  # dead link, missing heading, page not in the navigation
    return folder


def commands(document: str) -> list[list[str]]:
    """Return the `emcas` commands of a document, split like a shell; build_fmu.py becomes `emcas build`.

    Commands within a sentence are included if they have an option or a file.
    """
    text = (ROOT / document).read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ").replace("&&", "\n")
    inline = [line for line in re.findall(r"`(emcas [^`|]*)`", text) if re.search(r" -(?!-help)|\.\w", line)]
    words = [shlex.split(line, comments=True) for line in [*blocks.splitlines(), *inline]]
    found = []
    for line in filter(None, words):
        program, *rest = [Path(line[0]).name, *line[1:]]
        if program == "emcas":
            found.append([program, *rest])
        elif rest[:1] == ["build_fmu.py"]:
            found.append(["emcas", "build", *rest[1:]])
    return found
