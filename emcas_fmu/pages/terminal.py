"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from rich.box import HEAVY_HEAD, SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from .numbers import number


def table(columns: Iterable[str], rows: Iterable[Iterable[Any] | None], title: str = "", whole: Collection[int] = (),
          plain: bool = False) -> Table:
    """Return a table of texts and of numbers, which have four digits; None is a dash, a row that is None a line.

    Columns whose name begins with ">" are aligned to the right. Cells of the columns with indices in `whole` have one
    line; texts in other columns are not cut short, so that they can be searched for. A `plain` table has no frame.
    """
    made = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD if plain else HEAVY_HEAD,
                 padding=(0, 1, 0, 0) if plain else (0, 1), pad_edge=not plain)
    for k, name in enumerate(columns):
        right = name.startswith(">")
        made.add_column(escape(name.removeprefix(">")), justify="right" if right else "left", no_wrap=k in whole,
                        overflow="ellipsis" if right or k in whole else "fold")
    for row in rows:
        if row is None:
            made.add_section()
        else:
            made.add_row(*(cell if isinstance(cell, Text) else escape(cell) if isinstance(cell, str) else number(cell)
                           for cell in row))
    return made
