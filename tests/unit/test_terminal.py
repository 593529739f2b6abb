"""Tables on the terminal are complete at any width."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console
from rich.text import Text

from emcas_fmu.pages.terminal import table

FIGURES = ("0.0004996", "-0.0004996", "248.7")
NAME = "time_to_accuracy_20deg_as_built"


def printed(columns: list[str], rows: list[list[object]], width: int, whole: tuple[int, ...] = ()) -> str:
    """Return a table as printed; `whole` columns are folded only if nothing else is left to fold."""
    console = Console(width=width, file=StringIO())
    console.print(table(columns, rows, whole=whole, plain=True))
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("whole", [(), (0,), (0, 1)])
def test_table_of_five_actuators_is_complete_at_80_columns(whole: tuple[int, ...]) -> None:
    """Figures, limits and verdicts are not folded, and names only into lines."""
    names = [">nonlinear", ">worm-gear", ">electrohydraulic", ">elastic", ">servo"]
    cells = [Text(f"{figure} FAIL") for figure in (*FIGURES, *FIGURES[:2])]
    text = printed(["requirement", ">required", *names], [[NAME, "<= 0.25 deg/s", *cells]], 80, whole)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert "\N{HORIZONTAL ELLIPSIS}" not in text
    words = text.split()
    assert {*FIGURES, "0.25", "deg/s"} <= set(words)
    assert words.count("FAIL") == 5
    body = lines[next(n for n, line in enumerate(lines) if "\N{BOX DRAWINGS LIGHT HORIZONTAL}" in line) + 1:]
    assert "".join(line[1:12].strip() for line in body) == NAME


def test_whole_columns_are_folded_last() -> None:
    rows: list[list[object]] = [[NAME, "a reason of so many words that it takes more than one line", 1.0]]
    assert NAME in printed(["name", "reason", ">value"], rows, 60, (0,))
    assert NAME not in printed(["name", "reason", ">value"], rows, 40, (0,))


def test_wide_terminal_folds_nothing() -> None:
    assert len(printed(["name", ">value"], [[NAME, FIGURES[0]]], 200).split("\n")) == 6
