"""Variables of an actuator's interface, and functions that declare them.

Model description, kernels and documentation are generated from these declarations. Parameter files contain the values
of parameters, each with its source. A released name is never changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal

VariableType = Literal["Real", "Integer", "Boolean", "Enumeration", "Clock"]
Causality = Literal["input", "output", "parameter", "independent"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]


@dataclass(frozen=True)
class Variable:
    """A scalar of the interface; its values and limits are in its ``unit`` (:mod:`emcas_fmu.units`).

    - ``minimum``, ``maximum``: limits, inclusive; infinite if there is no physical limit.
    - ``start``: start value of an input; default of a parameter that its file may leave out.
    - ``key``: name of the parameter-file entry that contains an input's start value.
    - ``items``: name and meaning of each value of an enumeration; the values count from 1.
    - ``bits``: names of the flags of an Integer that is a word of flags, the lowest bit first.
    - ``sheet``: document and name under which a user finds the value, as in "motor: rotor inertia"; empty if no data
      sheet or drawing has it.
    - ``display``, ``quantity``: unit in which pages and hosts show the value, and name of the measured quantity, such
      as "BulkModulus"; the defaults depend on the unit (:mod:`emcas_fmu.fmi.units`).
    - ``limited_by``: parameters whose sum limits the magnitude of an output; ignored unless the actuator has all of
      these parameters.
    """

    name: str
    kind: VariableType
    causality: Causality
    variability: Variability
    unit: str
    description: str
    minimum: float = -inf
    maximum: float = inf
    nominal: float | None = None
    start: float | bool | None = None
    key: str | None = None
    items: tuple[tuple[str, str], ...] = ()
    bits: tuple[str, ...] = ()
    sheet: str = ""
    display: str = ""
    quantity: str = ""
    limited_by: tuple[str, ...] = ()

    def initial(self, values: Mapping[str, Any]) -> Any:
        """Return the start value of an input: the entry `key` of `values`, or without a key `start` (None means 0.0).

        `values` are the actuator's parameters and start values by name. Raises KeyError if they lack the entry.
        """
        return values[self.key] if self.key else self.start or 0.0

    def in_words(self, value: float) -> str:
        """Return a value in words: an enumeration's item, the flags that are set, or the number with 5 digits."""
        if self.items:
            return self.items[int(value) - 1][0]
        if self.bits:
            return " ".join(self.flags(value)) or "none"
        return f"{value:.5g}"

    def flags(self, value: float) -> tuple[str, ...]:
        """Return the names of the flags that are set in `value`, a word of flags."""
        return tuple(name for i, name in enumerate(self.bits) if int(value) >> i & 1)


@dataclass(frozen=True)
class Terminal:
    """A connector of the interface; `members` are the names of its inputs and outputs."""

    name: str
    description: str
    members: tuple[str, ...]


def real_input(name: str, unit: str, description: str, *, minimum: float = -inf, maximum: float = inf,
               nominal: float | None = None, start: float | None = 0.0, key: str | None = None,
               sheet: str = "") -> Variable:
    """Declare a continuous input.

    Limits, nominal and start value are in `unit`. The start value is the parameter-file entry `key` or, without a key,
    `start`.
    """
    return Variable(name, "Real", "input", "continuous", unit, description, minimum, maximum, nominal, start, key,
                    sheet=sheet)


def boolean_input(name: str, description: str, start: bool) -> Variable:
    """Declare a Boolean input with its start value."""
    return Variable(name, "Boolean", "input", "discrete", "", description, start=start)


def real_output(name: str, unit: str, description: str, nominal: float, *, minimum: float = -inf,
                maximum: float = inf, display: str = "", limited_by: tuple[str, ...] = ()) -> Variable:
    """Declare a continuous output.

    Nominal value and limits are in `unit`; the limits must hold for all parameters and inputs.
    """
    return Variable(name, "Real", "output", "continuous", unit, description, minimum, maximum, nominal,
                    display=display, limited_by=limited_by)


def boolean_output(name: str, description: str) -> Variable:
    """Declare a Boolean output."""
    return Variable(name, "Boolean", "output", "discrete", "", description)


def integer_output(name: str, description: str, bits: tuple[str, ...] = ()) -> Variable:
    """Declare an Integer output; if it is a word of flags, `bits` are their names, the lowest bit first."""
    return Variable(name, "Integer", "output", "discrete", "", description, minimum=0 if bits else -inf,
                    maximum=2 ** len(bits) - 1 if bits else inf, bits=bits)


def parameter(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
              display: str = "", quantity: str = "") -> Variable:
    """Declare a Real parameter that is fixed after initialization; its limits are in `unit`."""
    return Variable(name, "Real", "parameter", "fixed", unit, description, minimum, maximum, sheet=sheet,
                    display=display, quantity=quantity)


def array(name: str, count: int, unit: str, minimum: float, maximum: float, description: str) -> tuple[Variable, ...]:
    """Declare an array of `count` Real parameters ``name[0]``, ``name[1]``, ..., such as the points of a table.

    The limits, in `unit`, apply to each. Equations read the array as a tuple.
    """
    return tuple(parameter(f"{name}[{i}]", unit, minimum, maximum, f"{description}, point {i + 1}")
                 for i in range(count))


def tunable(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
            display: str = "") -> Variable:
    """Declare a Real parameter that may be changed during a simulation; its limits are in `unit`."""
    return Variable(name, "Real", "parameter", "tunable", unit, description, minimum, maximum, sheet=sheet,
                    display=display)


def integer_parameter(name: str, minimum: int, maximum: int, description: str, sheet: str = "") -> Variable:
    """Declare an Integer parameter that is fixed after initialization."""
    return Variable(name, "Integer", "parameter", "fixed", "1", description, minimum, maximum, sheet=sheet)


def switch(name: str, description: str, sheet: str = "") -> Variable:
    """Declare a switch: a Boolean parameter that is fixed after initialization."""
    return Variable(name, "Boolean", "parameter", "fixed", "", description, sheet=sheet)


def in_group(group: str, *variables: Variable) -> tuple[Variable, ...]:
    """Return variables with `group` in front of their names: in "heat" ``peak_time`` becomes ``heat.peak_time``."""
    return tuple(replace(v, name=f"{group}.{v.name}") for v in variables)


def with_outputs(outputs: tuple[Variable, ...], added: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Return `outputs`, then those of `added` whose names are not among `outputs`."""
    names = {v.name for v in outputs}
    return (*outputs, *(v for v in added if v.name not in names))


def only(variables: Iterable[Variable], *prefixes: str) -> tuple[Variable, ...]:
    """Return the variables whose names begin with one of the prefixes, in the order of `variables`.

    Raises ValueError for a prefix with which no name begins.
    """
    listed = tuple(variables)
    for prefix in prefixes:
        if not any(v.name.startswith(prefix) for v in listed):
            raise ValueError(f"no variable's name begins with {prefix!r}; the names are "
                             f"{', '.join(v.name for v in listed)}")
    return tuple(v for v in listed if v.name.startswith(prefixes))
