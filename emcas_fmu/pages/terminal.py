"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from rich.box import HEAVY_HEAD, SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from .numbers import number

_SHORT = 10  # characters: longer words are broken before shorter ones; numbers are never broken


class _Fitting(Table):
    """A table that narrows its widest columns to fit the terminal, the columns `whole` last."""

    whole: Collection[int] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        texts = [[Text.from_markup(each).plain if isinstance(each, str) else str(each)
                  for each in (column.header, *column.cells)] for column in self.columns]
        widths = [max(map(len, column)) for column in texts]
        least = [max((min(len(word), len(word) if column.justify == "right" and n else _SHORT)
                      for n, text in enumerate(each) for word in text.split()), default=0)
                 for each, column in zip(texts, self.columns, strict=True)]
        room = options.max_width - (3 * len(widths) + 1 if self.pad_edge else 2 * len(widths))  # lines and spaces
        every = range(len(widths))
        texts_only = [k for k in every if self.columns[k].justify == "left"]
        others = [k for k in every if k not in self.whole]
        for able, floor in ((others, least), (every, least), (texts_only, [1] * len(least))):
            while sum(widths) > room and (wide := [k for k in able if widths[k] > floor[k]]):
                widths[max(wide, key=widths.__getitem__)] -= 1
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)


def table(columns: Iterable[str], rows: Iterable[Iterable[Any] | None], title: str = "", whole: Collection[int] = (),
          plain: bool = False) -> Table:
    """Return a table; numbers have four digits, a cell None is a dash, a row None a line between sections.

    Columns whose name begins with ">" are aligned to the right. Texts that are too wide for the terminal are folded,
    between words or within long names, and last in the columns `whole` (indices). A `plain` table has no frame.
    """
    made = _Fitting(title=title or None, title_justify="left", box=SIMPLE_HEAD if plain else HEAVY_HEAD,
                    padding=(0, 1, 0, 0) if plain else (0, 1), pad_edge=not plain)
    made.whole = whole
    for name in columns:
        made.add_column(escape(name.removeprefix(">")), justify="right" if name.startswith(">") else "left",
                        overflow="fold")
    for row in rows:
        if row is None:
            made.add_section()
        else:
            made.add_row(*(cell if isinstance(cell, Text) else escape(cell) if isinstance(cell, str) else number(cell)
                           for cell in row))
    return made
