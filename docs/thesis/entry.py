"""What an entry of the thesis's lists is here: what it shows and meets of the thesis, or why it shows nothing."""

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
"""Of a picture of things whose title does not tell which it is; the text that is kept has no pictures."""
SCREENSHOT = "screen of a program"
HARDWARE = "list of hardware"
TEST_DATA = "test data, not published"
REASONS = {DRAWING: "drawings", PHOTOGRAPH: "photographs", UNSEEN: "drawings or photographs",
           SCREENSHOT: "screens of a program", HARDWARE: "lists of hardware", TEST_DATA: "of test data, not published"}
"""Why an entry is not shown, with the words for several of its kind."""


@dataclass(frozen=True)
class Table:
    """Rows of cells (words, numbers, yes or no, nothing) under columns, which end in their unit in brackets."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[Any, ...]]

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the rows as dictionaries by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


@dataclass(frozen=True)
class Shown:
    """What an entry shows: a figure with its caption, a table, or both.

    `conditions` are temperature, command and load in a line; `unknown` is what the thesis's text does not say of its
    test, with what is assumed instead.
    """

    conditions: str
    figure: Figure | None = None
    caption: str = ""
    table: Table | None = None
    unknown: str = ""


Show = Callable[["Runs"], Shown]
"""What makes an entry of runs."""


@dataclass(frozen=True)
class Entry:
    """An entry: ``Figure`` or ``Table``, its number, a title in words of this package.

    `show` makes what it shows; of one that is not shown `reason` is one of REASONS, and `note` says where its content
    is to be found here, if anywhere. `met` are the numbers or the curve of the thesis that what is shown has to meet,
    and meets; an entry without shows the set's own values. `structure`: the thesis draws a block diagram or structure
    there, and what that does is shown instead.
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
        """The name as the id of a heading."""
        return self.name.lower().replace(" ", "-").replace(".", "-")

    @property
    def chapter(self) -> str:
        """The chapter of a figure; empty for a table, which is numbered through."""
        return self.number.partition(".")[0] if self.kind == "Figure" else ""
