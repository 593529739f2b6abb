"""Tables of the thesis that list parts of the unit: their numbers in the parameter set, with where these are from."""

from __future__ import annotations

from collections.abc import Callable

from .entry import Shown, Table
from .rigs import rig_entries
from .runs import Runs

_COLUMNS = ("", "value", "source", "note")
_LOST = "The thesis's numbers are lost but for those marked seed."


def parameters(*prefixes: str, unknown: str = _LOST) -> Callable[[Runs], Shown]:
    """Return what shows the entries of the parameter set whose names begin so."""
    def show(runs: Runs) -> Shown:
        rows = tuple((e.variable.name, e.text, e.source, e.note) for e in runs.parameters.entries
                     if e.variable.name.startswith(prefixes))
        return Shown("the parameter set", table=Table(_COLUMNS, rows), unknown=unknown)

    return show


def rig(name: str) -> Callable[[Runs], Shown]:
    """Return what shows the numbers of a rig."""
    def show(_: Runs) -> Shown:
        rows = tuple((key, f"{entry.value:g} {entry.unit}".removesuffix(" 1"), entry.source, entry.note)
                     for key, entry in rig_entries(name).items())
        return Shown("models/rigs.toml", table=Table(_COLUMNS, rows),
                     unknown="The thesis's numbers are lost: these are estimates.")

    return show
