"""Tables of the thesis that list parts of the actuator, with the numbers of the parameter set and their sources."""

from __future__ import annotations

from .entry import Show, Shown, Table
from .rigs import rig_entries
from .runs import Runs

COLUMNS = ("", "value", "source", "note")
LOST = "the thesis's numbers, except those with the source thesis."


def parameters(*prefixes: str, unknown: str = LOST) -> Show:
    """Return a function that shows the entries of the parameter set whose names begin with one of the prefixes."""
    def show(runs: Runs) -> Shown:
        return Shown("the parameter set", table=Table(COLUMNS, rows_of(runs, *prefixes)), unknown=unknown)

    return show


def rows_of(runs: Runs, *prefixes: str) -> list[tuple[str, ...]]:
    """Return a row of COLUMNS for each entry of the parameter set whose name begins with one of the prefixes."""
    return [(e.variable.name, e.text, e.source, e.note) for e in runs.parameters.entries
            if e.variable.name.startswith(prefixes)]


def rig(name: str) -> Show:
    """Return a function that shows the numbers of a rig."""
    def show(_: Runs) -> Shown:
        rows = tuple((key, f"{entry.value:g} {entry.unit}".removesuffix(" 1"), entry.source, entry.note)
                     for key, entry in rig_entries(name).items())
        return Shown("docs/thesis/rigs.toml", table=Table(COLUMNS, rows),
                     unknown="the thesis's numbers; these are estimates.")

    return show
