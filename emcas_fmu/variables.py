"""Variables of an interface, and short functions to declare them.

Every actuator declares its variables (:mod:`emcas_fmu.actuators`); model description, parameter files, kernels and
documentation are generated from them. Values of parameters are in parameter files, each with its source. A name that
has been released is never changed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal

Kind = Literal["Real", "Integer", "Boolean", "Enumeration", "Clock"]
Causality = Literal["input", "output", "parameter", "independent"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]


@dataclass(frozen=True)
class Variable:
    """One scalar of the interface, in its ``unit`` (:mod:`emcas_fmu.units`).

    - ``minimum``, ``maximum``: limits, inclusive; infinite if there is no physical limit.
    - ``start``: start value of an input; default of a parameter that its file may leave out.
    - ``key``: entry of the parameter file that contains an input's start value.
    - ``items``: values of an enumeration from 1 on, each with its meaning.
    - ``bits``: names of the flags of an Integer that is a word of flags, the lowest bit first.
    - ``sheet``: document and name under which a user finds the value, as in "motor: rotor inertia"; empty if no data
      sheet or drawing has it.
    - ``display``, ``quantity``: unit in which people read it, and what it measures, if these differ from the defaults
      for its unit (:mod:`emcas_fmu.fmi.units`).
    - ``limited_by``: parameters whose sum limits the magnitude of an output, for actuators that have them.
    """

    name: str
    kind: Kind
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
        """Return the start value of an input; `values` are the actuator's parameters by name."""
        return values[self.key] if self.key else self.start or 0.0

    def in_words(self, value: float) -> str:
        """Return a value in words: the item of an enumeration, the flags that are set, or the number."""
        if self.items:
            return self.items[int(value) - 1][0]
        if self.bits:
            return " ".join(self.flags(value)) or "none"
        return f"{value:.5g}"

    def flags(self, value: float) -> tuple[str, ...]:
        """Return the names of the flags that are set in a word."""
        return tuple(name for i, name in enumerate(self.bits) if int(value) >> i & 1)


@dataclass(frozen=True)
class Terminal:
    """Inputs and outputs of one connector."""

    name: str
    description: str
    members: tuple[str, ...]


def real_input(name: str, unit: str, description: str, *, minimum: float = -inf, maximum: float = inf,
               nominal: float | None = None, start: float | None = 0.0, key: str | None = None,
               sheet: str = "") -> Variable:
    """Declare a continuous input.

    `unit` is the unit of limits, nominal and start value. The start value is `start` or the parameter-file entry `key`.
    """
    return Variable(name, "Real", "input", "continuous", unit, description, minimum, maximum, nominal, start, key,
                    sheet=sheet)


def boolean_input(name: str, description: str, start: bool) -> Variable:
    """Declare a Boolean input."""
    return Variable(name, "Boolean", "input", "discrete", "", description, start=start)


def real_output(name: str, unit: str, description: str, nominal: float, *, minimum: float = -inf,
                maximum: float = inf, display: str = "", limited_by: tuple[str, ...] = ()) -> Variable:
    """Declare a continuous output.

    `unit` is the unit of nominal value and limits, which must hold for all parameters and inputs.
    """
    return Variable(name, "Real", "output", "continuous", unit, description, minimum, maximum, nominal,
                    display=display, limited_by=limited_by)


def boolean_output(name: str, description: str) -> Variable:
    """Declare a Boolean output."""
    return Variable(name, "Boolean", "output", "discrete", "", description)


def integer_output(name: str, description: str, bits: tuple[str, ...] = ()) -> Variable:
    """Declare an Integer output; `bits` are the names of the flags if it is a word of flags."""
    return Variable(name, "Integer", "output", "discrete", "", description, minimum=0 if bits else -inf,
                    maximum=2 ** len(bits) - 1 if bits else inf, bits=bits)


def parameter(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
              display: str = "", quantity: str = "") -> Variable:
    """Declare a parameter that is fixed after initialization; `unit` is also that of its limits."""
    return Variable(name, "Real", "parameter", "fixed", unit, description, minimum, maximum, sheet=sheet,
                    display=display, quantity=quantity)


def array(name: str, count: int, unit: str, minimum: float, maximum: float, description: str) -> tuple[Variable, ...]:
    """Declare an array of parameters, such as the points or the values of a table; equations read it as a tuple."""
    return tuple(parameter(f"{name}[{i}]", unit, minimum, maximum, f"{description}, point {i + 1}")
                 for i in range(count))


def tunable(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
            display: str = "") -> Variable:
    """Declare a parameter that may be changed during a simulation; `unit` is also that of its limits."""
    return Variable(name, "Real", "parameter", "tunable", unit, description, minimum, maximum, sheet=sheet,
                    display=display)


def integer_parameter(name: str, minimum: int, maximum: int, description: str, sheet: str = "") -> Variable:
    """Declare an Integer parameter that is fixed after initialization."""
    return Variable(name, "Integer", "parameter", "fixed", "1", description, minimum, maximum, sheet=sheet)


def switch(name: str, description: str, sheet: str = "") -> Variable:
    """Declare a Boolean parameter that is fixed after initialization."""
    return Variable(name, "Boolean", "parameter", "fixed", "", description, sheet=sheet)


def in_group(group: str, *variables: Variable) -> tuple[Variable, ...]:
    """Return variables with the group in front of their names: ``peak_time`` becomes ``heat.peak_time``."""
    return tuple(replace(v, name=f"{group}.{v.name}") for v in variables)


def with_outputs(outputs: tuple[Variable, ...], further: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Return outputs with further ones appended, each once."""
    names = {v.name for v in outputs}
    return (*outputs, *(v for v in further if v.name not in names))


def only(variables: Iterable[Variable], *prefixes: str) -> tuple[Variable, ...]:
    """Return the variables whose names begin with one of the prefixes, in their order.

    Raises ValueError for a prefix of no variable.
    """
    listed = tuple(variables)
    for prefix in prefixes:
        if not any(v.name.startswith(prefix) for v in listed):
            raise ValueError(f"there is no variable {prefix}")
    return tuple(v for v in listed if v.name.startswith(prefixes))
