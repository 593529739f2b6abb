"""The variables of FMI 3.0: arrays of the interface's scalars, over the points of a table and over the fins.

``friction.coulomb.positive[0]`` to ``[6]`` are the array ``friction.coulomb.positive`` of 7 elements, and
``fin[1].fin_angle`` to ``fin[4].fin_angle`` the array ``fins.fin_angle`` of 4. A table of four fins has two dimensions.
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
CLOCK = Variable("sample_clock", "Clock", "input", "discrete", "",
                 "ticks when the controllers sample (of fin 1, if sample times differ); they also sample without it")
_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
KINDS = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration", "Clock": "Clock"}
"""Types in FMI 3.0 by the variable's kind."""


@dataclass(frozen=True)
class Array:
    """A variable of one or more elements; `variable` has its name and the common attributes of its elements.

    `first` is the index of the first fin's first element among the scalars of the interface; the fin's other elements
    follow it. The elements of the next fin begin at `first` + `stride`. `table` and `fins` are the lengths of the
    dimensions, None for a dimension that the array does not have.
    """

    variable: Variable
    first: int
    table: int | None = None
    fins: int | None = None
    stride: int = 0

    @property
    def kind(self) -> str:
        """The type in FMI 3.0; an Integer whose bits are flags is unsigned."""
        return "UInt32" if self.variable.bits else KINDS[self.variable.kind]

    @property
    def dimensions(self) -> tuple[int, ...]:
        """Lengths of the dimensions, the fins first; empty for a scalar."""
        return tuple(n for n in (self.fins, self.table) if n is not None)

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the elements among the scalars of the interface, in row-major order."""
        return tuple(self.first + fin * self.stride + k
                     for fin in range(self.fins or 1) for k in range(self.table or 1))


def _tables(variables: tuple[Variable, ...], first: int) -> Iterator[Array]:
    """Yield variables as arrays, a table's elements as one array; `first` is the index of the first variable."""
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
    """Return the variable for a whole table. Raises EmcasError if the elements differ in more than the index."""
    same = {replace(v, name="", description="", sheet="") for v in elements}
    if len(same) != 1 or [v.name for v in elements] != [f"{name}[{k}]" for k in range(len(elements))]:
        raise EmcasError(f"{name}: elements of a table must be declared in order and differ only in their index")
    words = commonprefix([v.description for v in elements])  # noqa: RUF071  by characters
    first, last = (v.description[len(words):] for v in (elements[0], elements[-1]))
    return replace(elements[0], name=name, description=f"{words}{first} … {last}" if first else words)


@cache
def arrays(interface: FmuInterface) -> tuple[Array, ...]:
    """Return the variables of an interface in the order of value references, without time and clock.

    Raises EmcasError if a variable has the name of time or clock, or if the elements of a table differ.
    """
    result: list[Array] = []
    first = 0
    for shared, each in interface.groups:
        result += _tables(shared, first)
        first += len(shared)
        for v in _tables(each, first):
            result.append(v if interface.fins == 1 else replace(
                v, fins=interface.fins, stride=len(each),
                variable=replace(v.variable, name=interface.array_name(v.variable.name))))
        first += interface.fins * len(each)
    if reserved := {TIME.name, CLOCK.name} & {v.variable.name for v in result}:
        raise EmcasError(f"{interface.actuator.name}: a variable is named {', '.join(reserved)}; FMI 3.0 already "
                         "has a variable with that name: rename yours")
    return tuple(result)
