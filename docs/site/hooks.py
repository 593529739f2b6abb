"""Hooks of MkDocs: pages of the site from outside docs/ or made from the source, targets of links, navigation.

The navigation follows docs/README.md: a group for each heading `## Group: ...`, a page for each row of its table.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

import generated
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from emcas_fmu.actuators import NAMES

ROOT = Path(__file__).resolve().parents[2]
# Source files from which a page is made, with the page and the function that makes it; links to the file lead to it.
MADE = {
    "emcas_fmu/api.py": ("reference/python.md", generated.python),
    "emcas_fmu/actuators/declaration.py": ("reference/declaration.md", generated.declaration),
    "emcas_fmu/fmi/interface.py": ("reference/fmu.md", generated.fmu),
    "emcas_fmu/cli.py": ("reference/commands.md", generated.commands),
    "examples/notebook/first_steps.ipynb": ("examples/notebook/first_steps.md", generated.notebook),
}
THESIS = "thesis/thesis.html"  # not a Markdown page; links to docs/thesis/__main__.py lead to it
# Pages made from Markdown files outside docs/; the front page is docs/README.md.
OUTSIDE = {"overview.md": "README.md", "CONTRIBUTING.md": "CONTRIBUTING.md", "CHANGELOG.md": "CHANGELOG.md", **{
    name: name for name in (file.relative_to(ROOT).as_posix() for file in ROOT.glob("examples/*/README.md"))}}
PAGES = {file: page for page, file in OUTSIDE.items()} | {file: page for file, (page, _) in MADE.items()} | {
    "docs/thesis/__main__.py": THESIS}
FILES = {page: file for file, page in PAGES.items()}
_ROW = re.compile(r"^\| \[.*?\]\((.*?)\)", re.MULTILINE)
_CODE_OR_LINK = re.compile(r"```.*?```|(!?)\[((?:`[^`]*`|[^\]`])*)\]\(([^)\s]+)\)|`[^`\n]*`", re.DOTALL)
# Marks of docstrings that are not Markdown: roles, and literals within blocks of code.
_MARKS = re.compile(r":(?:class|data|func|meth|mod):(?:(<code>)[~.]*|`([^`]*)`)|``([^`<]*)``")


def path_in_site(path: str) -> str | None:
    """Return the path in the site of a file or folder of the repository; None if the site does not have it."""
    path = posixpath.normpath(path)
    inside = path.removeprefix("docs/") if path.startswith("docs/") else PAGES.get(f"{path}/README.md")
    return PAGES.get(path, inside)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Set the navigation from docs/README.md."""
    groups = re.split(r"^## (\w+)", (ROOT / "docs/README.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    config.nav = [{"Start": ["README.md", "overview.md"]}]
    for name, rows in zip(groups[::2], groups[1::2], strict=True):
        config.nav.append({name: [path_in_site(f"docs/{link}") for link in _ROW.findall(rows)]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside docs/ and those that are made from the source."""
    for page, file in OUTSIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / file)))
    for page, make in MADE.values():
        files.append(File.generated(config, page, content=make()))
    for name in NAMES:
        if (page := f"explore/{name}.html") not in files.src_uris:  # docs/ has the default actuator's
            files.append(File.generated(config, page, content=generated.explored(name)))
    files.append(File.generated(config, THESIS, content=generated.thesis()))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Change links to pages of the site, with titles instead of file names; links to other files become code."""
    here = page.file.src_uri
    folder = posixpath.dirname(FILES.get(here, f"docs/{here}"))

    def leading(match: re.Match[str]) -> str:
        picture, text, link = match.groups()
        path, mark, heading = (link or "").partition("#")
        if not path or ":" in path:
            return match[0]
        target = path_in_site(posixpath.join(folder, path))
        if target is None:
            return text if "`" in text else f"`{text}`"
        file = files.get_file_from_path(target)
        if file and text.endswith((".md", ".py", ".ipynb")) and not mark:
            text = re.findall(r"^# (.*)$", file.content_string, re.MULTILINE)[0]
        return f"{picture}[{text}]({posixpath.relpath(target, posixpath.dirname(here) or '.')}{mark}{heading})"

    return _CODE_OR_LINK.sub(leading, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Remove docstrings' marks that are not Markdown, and make empty cells of headings without words."""
    html = _MARKS.sub(lambda match: "".join(filter(None, match.groups())), html)
    return re.sub(r"<th([^>]*)></th>", r"<td\1></td>", html)
