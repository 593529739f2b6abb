"""Comparison of two traces of a user's functions: a value that changes between calls must not be in an equation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..errors import EmcasError, called_from
from .tracer import Expr, If, Tracer


class LocatedTracer(Tracer):
    """A tracer that stores, for each value, the location in a Python file where it is computed; "" in other files."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.locations: list[str] = []

    def _new(self, fixed: bool) -> Expr:
        self.locations.append(called_from(self._path))
        return super()._new(fixed)


def same(tracer: Tracer, again: Tracer) -> bool:
    """Return whether two traces of the same functions are the same program."""
    one, other = (repr((each.prologue, [(f.block, f.results) for f in each.functions])) for each in (tracer, again))
    return one == other


def changed(tracer: Tracer, located: LocatedTracer, of_function: Callable[[str], str]) -> EmcasError:
    """Return the error for two different traces of the same functions, with file, line and function.

    `of_function(name)` returns the location of a function of the program, used for values from other files.
    """
    before, after = _operations(tracer), _operations(located)
    index = min((i for i in {*before, *after} if before.get(i) != after.get(i)), default=None)
    location = located.locations[index] if index in after else ""
    function = next((one.name for one, other in zip(tracer.functions, located.functions, strict=True)
                     if repr((one.block, one.results)) != repr((other.block, other.results))), "")
    return EmcasError(f"{location or of_function(function)} is not the same when it is called again: random numbers, "
                      "clocks and variables that change would be constants of the FMU; use states, parameters and "
                      "inputs")


def _operations(tracer: Tracer) -> dict[int, str]:
    """Return the operations of a program as texts, by the index of the computed value."""
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
