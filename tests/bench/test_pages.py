"""Pages on a narrow screen and in print, as far as their templates tell."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import emcas_fmu

FOLDER = Path(emcas_fmu.__file__).parent
TEMPLATES = sorted([*FOLDER.rglob("studies/**/*.j2"), *FOLDER.rglob("bench/*.j2")])


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_table_scrolls_by_itself(template: Path) -> None:
    """Not the page with it. What is signed and what is said about the article have short cells that wrap."""
    for before, attributes in re.findall(r"(.*)<table([^>]*)>", template.read_text(encoding="utf-8")):
        if 'class="sign"' not in attributes and 'class="about"' not in attributes:
            assert before == '<div class="wide">'
