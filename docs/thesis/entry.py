"""An entry of the thesis's lists: its content and what it reproduces, or the reason why it is not shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from .runs import Runs

DRAWING = "drawing"
PHOTOGRAPH = "photograph"
UNSEEN = "drawing or photograph"
"""Reason for a picture whose title does not show which of the two it is; the available text has no pictures."""
SCREENSHOT = "screen of a program"
HARDWARE = "list of hardware"
TEST_DATA = "test data, not published"
REASONS = {DRAWING: "drawings", PHOTOGRAPH: "photographs", UNSEEN: "drawings or photographs",
           SCREENSHOT: "screens of a program", HARDWARE: "lists of hardware", TEST_DATA: "of test data, not published"}
"""The reasons why an entry is not shown, with their plurals."""


@dataclass(frozen=True)
class Table:
    """Rows of cells (text, number, Boolean or None); names of columns end with the unit in brackets."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[Any, ...]]

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the rows as dictionaries by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


@dataclass(frozen=True)
class Shown:
    """The content of an entry: a figure with its caption, a table, or both.

    `conditions` are temperature, command and load in a line. `unknown` lists the data of the thesis's test that are not
    available, with the assumptions made instead.
    """

    conditions: str
    figure: Figure | None = None
    caption: str = ""
    table: Table | None = None
    unknown: str = ""


Show = Callable[["Runs"], Shown]
"""A function that returns the content of an entry from runs."""


@dataclass(frozen=True)
class Entry:
    """An entry: ``Figure`` or ``Table``, its number, and a title in words of this package.

    `show` returns the content. If an entry is not shown, `reason` is one of REASONS, and `note` names the file or entry
    that has the content, if any. `met` names the numbers or the curve of the thesis that the content reproduces; if it
    is empty, the values are those of the parameter set. `structure` is true if the thesis has only a block diagram or
    structure, whose behaviour the entry shows.
    """

    kind: str
    number: str
    title: str
    show: Show | None = None
    reason: str = ""
    note: str = ""
    structure: bool = False
    met: str = ""

    @property
    def name(self) -> str:
        """``Figure 5.18`` or ``Table 4``."""
        return f"{self.kind} {self.number}"

    @property
    def anchor(self) -> str:
        """The name as an id in HTML."""
        return self.name.lower().replace(" ", "-").replace(".", "-")

    @property
    def chapter(self) -> str:
        """The chapter of a figure; empty for a table, as tables are numbered without chapters."""
        return self.number.partition(".")[0] if self.kind == "Figure" else ""
