"""Targets of relative links and paths in documents exist, also headings; the index lists every page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .recipes import ROOT

DOCS = ROOT / "docs"
DOCUMENTS = sorted((*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "examples").rglob("*.md"),
                    *(ROOT / "models").rglob("*.md")))
_CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_PATH = re.compile(r"`([\w./]+(?:\.(?:py|h|c|toml|svg|md)|/))`")
_HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)


def links(text: str) -> list[str]:
    """Return the relative targets of links and pictures outside code."""
    return [target for target in _LINK.findall(_CODE.sub("`code`", text)) if "://" not in target]


def anchors(text: str) -> set[str]:
    """Return the anchors of a document's headings, as GitHub makes them."""
    headings = _HEADING.findall(re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def dead(document: Path, text: str) -> list[str]:
    """Return the links of a document whose target does not exist."""
    def exists(target: str) -> bool:
        path, _, heading = target.partition("#")
        file = (document.parent / path).resolve() if path else document
        return file.exists() and (not heading or heading in anchors(text if file == document
                                                                    else file.read_text(encoding="utf-8")))

    return [target for target in links(text) if not exists(target)]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_link_is_dead(document: Path) -> None:
    assert dead(document, document.read_text(encoding="utf-8")) == []


def test_dead_link_is_detected() -> None:
    text = "# One\n[a](none.md) [b](use/hosts.md#none) [c](use/hosts.md#fmpy) [d](#one) [e](#two) `[f](none.md)`"
    assert dead(DOCS / "README.md", text) == ["none.md", "use/hosts.md#none", "#two"]


def test_index_lists_every_page() -> None:
    index = DOCS / "README.md"
    named = {(DOCS / target.partition("#")[0]).resolve() for target in links(index.read_text(encoding="utf-8"))}
    assert {path for path in DOCS.rglob("*.md") if path != index} <= named
    assert set((ROOT / "examples").rglob("README.md")) <= named


def missing(text: str) -> list[str]:
    """Return the paths in code that exist neither in the repository nor in the package."""
    package = ROOT / "emcas_fmu"
    return [path for path in _PATH.findall(text) if "NAME" not in path
            and not any((folder / path).exists() for folder in (ROOT, package)) and not any(package.rglob(path))]


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", DOCS / "develop" / "architecture.md"],
                         ids=lambda path: path.name)
def test_paths_of_the_package_exist(page: Path) -> None:
    assert missing(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_paths_from_the_root_exist(document: Path) -> None:
    # Other paths are a user's, or in an FMU.
    paths = missing(document.read_text(encoding="utf-8"))
    assert [path for path in paths if path.startswith(("emcas_fmu/", "tests/", "docs/", "examples/"))] == []


def test_missing_path_is_detected() -> None:
    assert missing("`runtime/core.py` `core.h` `bench/` `bench/none.py` `none.h` `nowhere/`") == [
        "bench/none.py", "none.h", "nowhere/"]
