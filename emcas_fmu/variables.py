"""Scalars of an interface: what a variable is, and short ways to declare one.

Every actuator declares its own (:mod:`emcas_fmu.actuators`); model description, parameter files, kernels and
documentation are generated from that. Values of parameters live in parameter files, each with its source.
Names are a contract: one that has shipped is never renamed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal

Kind = Literal["Real", "Integer", "Boolean", "Enumeration"]
Causality = Literal["input", "output", "parameter", "independent"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]


@dataclass(frozen=True)
class Variable:
    """One scalar of the interface, in the unit named (see :mod:`emcas_fmu.units`).

    ``minimum``/``maximum`` are inclusive; infinite where physics knows no limit.
    ``start`` is an input's; a parameter's value comes from its file, of one that may be missing there it is this.
    ``key`` names the parameter-file entry a start value is taken from, where the
    variable itself is no parameter. ``items`` are an enumeration's from 1 on, each with what it means;
    ``bits`` name those of an Integer that is a word of flags, the least first. ``sheet`` says where a user reads the
    value, and what it is called there, as in "motor: rotor inertia"; empty where no sheet or drawing has it.
    ``display`` is the unit people read it in, ``quantity`` what it measures, where these are not what goes with its
    unit (:mod:`emcas_fmu.fmi.units`). An output's magnitude is at most the sum of the parameters ``limited_by``, of an
    actuator that has them.
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
        """Return the start value of an input of an actuator whose parameters are `values`, by name."""
        return values[self.key] if self.key else self.start or 0.0

    def in_words(self, value: float) -> str:
        """Return a value as people read it: an enumeration's item, the flags that are set, or the number."""
        if self.items:
            return self.items[int(value) - 1][0]
        if self.bits:
            return " ".join(self.flags(value)) or "none"
        return f"{value:.5g}"

    def flags(self, value: float) -> tuple[str, ...]:
        """Return the names of the bits of a word that are set."""
        return tuple(name for i, name in enumerate(self.bits) if int(value) >> i & 1)


@dataclass(frozen=True)
class Terminal:
    """Inputs and outputs that belong to one connector."""

    name: str
    description: str
    members: tuple[str, ...]


def real_input(name: str, unit: str, description: str, *, minimum: float = -inf, maximum: float = inf,
               nominal: float | None = None, start: float | None = 0.0, key: str | None = None,
               sheet: str = "") -> Variable:
    """Declare a continuous input; its start value is `start`, or the parameter-file entry `key`."""
    return Variable(name, "Real", "input", "continuous", unit, description, minimum, maximum, nominal, start, key,
                    sheet=sheet)


def boolean_input(name: str, description: str, start: bool) -> Variable:
    """Declare a Boolean input."""
    return Variable(name, "Boolean", "input", "discrete", "", description, start=start)


def real_output(name: str, unit: str, description: str, nominal: float, *, minimum: float = -inf,
                maximum: float = inf, display: str = "", limited_by: tuple[str, ...] = ()) -> Variable:
    """Declare a continuous output; limits are those it keeps within whatever parameters and inputs there may be."""
    return Variable(name, "Real", "output", "continuous", unit, description, minimum, maximum, nominal,
                    display=display, limited_by=limited_by)


def boolean_output(name: str, description: str) -> Variable:
    """Declare a Boolean output."""
    return Variable(name, "Boolean", "output", "discrete", "", description)


def integer_output(name: str, description: str, bits: tuple[str, ...] = ()) -> Variable:
    """Declare an Integer output; of a word of flags with their names."""
    return Variable(name, "Integer", "output", "discrete", "", description, minimum=0 if bits else -inf,
                    maximum=2 ** len(bits) - 1 if bits else inf, bits=bits)


def parameter(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
              display: str = "", quantity: str = "") -> Variable:
    """Declare a parameter that is fixed after initialization."""
    return Variable(name, "Real", "parameter", "fixed", unit, description, minimum, maximum, sheet=sheet,
                    display=display, quantity=quantity)


def tunable(name: str, unit: str, minimum: float, maximum: float, description: str, sheet: str = "", *,
            display: str = "") -> Variable:
    """Declare a parameter that may change while running."""
    return Variable(name, "Real", "parameter", "tunable", unit, description, minimum, maximum, sheet=sheet,
                    display=display)


def integer_parameter(name: str, minimum: int, maximum: int, description: str, sheet: str = "") -> Variable:
    """Declare an Integer parameter that is fixed after initialization."""
    return Variable(name, "Integer", "parameter", "fixed", "1", description, minimum, maximum, sheet=sheet)


def switch(name: str, description: str, sheet: str = "") -> Variable:
    """Declare a Boolean parameter that is fixed after initialization."""
    return Variable(name, "Boolean", "parameter", "fixed", "", description, sheet=sheet)


def in_group(group: str, *variables: Variable) -> tuple[Variable, ...]:
    """Return variables named as members of a group: ``peak_time`` of ``heat`` becomes ``heat.peak_time``."""
    return tuple(replace(v, name=f"{group}.{v.name}") for v in variables)


def only(variables: Iterable[Variable], *prefixes: str) -> tuple[Variable, ...]:
    """Return variables by name, or by what a group of names begins with, in their order.

    Raises ValueError for a prefix that is no variable's.
    """
    listed = tuple(variables)
    for prefix in prefixes:
        if not any(v.name.startswith(prefix) for v in listed):
            raise ValueError(f"there is no variable {prefix}")
    return tuple(v for v in listed if v.name.startswith(prefixes))
