"""Two traces of a user's functions are compared: their equations may depend on nothing that changes between calls."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..errors import EmcasError, called_from
from .tracer import Expr, If, Tracer


class LocatedTracer(Tracer):
    """A tracer that remembers from where in a Python file each value was computed, "" if from elsewhere."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.places: list[str] = []

    def _new(self, fixed: bool) -> Expr:
        self.places.append(called_from(self._path))
        return super()._new(fixed)


def same(tracer: Tracer, again: Tracer) -> bool:
    """Return whether two traces of the same functions are the same program."""
    one, other = (repr((each.prologue, [(f.block, f.results) for f in each.functions])) for each in (tracer, again))
    return one == other


def changed(tracer: Tracer, located: LocatedTracer, of_function: Callable[[str], str]) -> EmcasError:
    """Return the error, with file, line and function, for two traces of the same functions that are not the same.

    `of_function` returns the location of a function of the program, for values that are not computed in the file.
    """
    before, after = _operations(tracer), _operations(located)
    index = min((i for i in {*before, *after} if before.get(i) != after.get(i)), default=None)
    place = located.places[index] if index in after else ""
    function = next((one.name for one, other in zip(tracer.functions, located.functions, strict=True)
                     if repr((one.block, one.results)) != repr((other.block, other.results))), "")
    return EmcasError(f"{place or of_function(function)} is not the same when it is called again: random numbers, "
                      "clocks and variables that change would be constants of the FMU; use states, parameters and "
                      "inputs")


def _operations(tracer: Tracer) -> dict[int, str]:
    """Return the operations of a program as texts, by the index of the value that they compute."""
    texts: dict[int, str] = {}
    blocks = [tracer.prologue, *(f.block for f in tracer.functions)]
    while blocks:
        for statement in blocks.pop().statements:
            if isinstance(statement, If):
                blocks += [statement.yes, statement.no]
                texts |= {int(result[1:]) - 1: repr((statement.condition, *values)) for result, *values in zip(
                    statement.names, statement.yes_values, statement.no_values, strict=True)}
            else:
                texts[int(statement.name[1:]) - 1] = repr(statement)
    return texts
