"""The variables of FMI 3.0: a unit's scalars as arrays, of the points of a table and of the fins.

``friction.coulomb.positive[0]`` to ``[6]`` are one array ``friction.coulomb.positive`` of 7; the variables
``fin[1].fin_angle`` to ``fin[4].fin_angle`` are one, ``fins.fin_angle`` of 4. Tables of four fins have two dimensions.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from os.path import commonprefix

from ...errors import EmcasError
from ...variables import Variable
from ..interface import FmuInterface

TIME = Variable("time", "Real", "independent", "continuous", "s", "time, set by the steps")
CLOCK = "sample_clock"
_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
_KINDS = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}


@dataclass(frozen=True)
class Array:
    """A variable of one element or more; `variable` has its name and what all elements have in common.

    Among the unit's scalars the elements of a fin stand together from `first` on, those of the next fin `stride`
    further. `table` is the number of elements of a table's dimension, None of what is no table; `fins` likewise.
    """

    variable: Variable
    first: int
    table: int | None = None
    fins: int | None = None
    stride: int = 0

    @property
    def kind(self) -> str:
        """FMI 3.0's type; words of flags are unsigned."""
        return "UInt32" if self.variable.bits else _KINDS[self.variable.kind]

    @property
    def dimensions(self) -> tuple[int, ...]:
        """Lengths of the dimensions, the fins first; none of a scalar."""
        return tuple(n for n in (self.fins, self.table) if n is not None)

    @property
    def places(self) -> tuple[int, ...]:
        """Places of the elements among the unit's scalars, the last dimension counting fastest."""
        return tuple(self.first + fin * self.stride + k
                     for fin in range(self.fins or 1) for k in range(self.table or 1))


def _tables(variables: tuple[Variable, ...], first: int) -> Iterator[Array]:
    """Yield variables, whose scalars stand from `first` on, with the elements of a table as one."""
    def table(v: Variable) -> str:
        match = _ELEMENT.fullmatch(v.name)
        return match[1] if match else ""

    for name, group in groupby(variables, key=table):
        elements = tuple(group)
        if not name:
            yield from (Array(v, first + i) for i, v in enumerate(elements))
        else:
            yield Array(_common(name, elements), first, len(elements))
        first += len(elements)


def _common(name: str, elements: tuple[Variable, ...]) -> Variable:
    """Return the variable that stands for a table. Raises EmcasError where its elements are not alike."""
    same = {replace(v, name="", description="", sheet="") for v in elements}
    if len(same) != 1 or [v.name for v in elements] != [f"{name}[{k}]" for k in range(len(elements))]:
        raise EmcasError(f"{name}: elements of a table differ in more than their places, or stand apart")
    words = commonprefix([v.description for v in elements])  # noqa: RUF071  characters are meant
    first, last = (v.description[len(words):] for v in (elements[0], elements[-1]))
    return replace(elements[0], name=name, description=f"{words}{first} … {last}" if first else words)


@cache
def arrays(unit: FmuInterface) -> tuple[Array, ...]:
    """Return the variables of a unit; a value reference is a place among them, and time's and the clock's follow.

    Raises EmcasError where a name is one of these two.
    """
    made: list[Array] = []
    first = 0
    for shared, each in unit.groups:
        made += _tables(shared, first)
        first += len(shared)
        for v in _tables(each, first):
            made.append(v if unit.fins == 1 else replace(v, fins=unit.fins, stride=len(each), variable=replace(
                v.variable, name=unit.array_name(v.variable.name))))
        first += unit.fins * len(each)
    if taken := {TIME.name, CLOCK} & {v.variable.name for v in made}:
        raise EmcasError(f"{unit.actuator.name}: a variable is named {', '.join(taken)}; FMI 3.0 has a variable of "
                         "that name already: give yours another")
    return tuple(made)
