"""FMI's view of a unit: exponents of the base units, and display units; all from the units of parameter files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from .. import units

# Units shown instead of a variable's, the first as its displayUnit.
_DISPLAYS = {"rad": ("deg",), "rad/s": ("deg/s", "rpm"), "m": ("mm",), "m/rad": ("mm/rev",), "s": ("ms",),
             "Pa": ("bar",), "m3": ("l",), "m3/s": ("l/min",)}
_BASE = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K", "[angle]": "rad"}


@dataclass(frozen=True)
class Unit:
    """Base-unit exponents, factor and offset to SI, display units with their factors."""

    exponents: dict[str, int]
    factor: float
    offset: float
    displays: tuple[tuple[str, float], ...]


@cache
def fmi_unit(name: str) -> Unit:
    """Return what FMI says of a unit. Raises UnitError for one that is not known."""
    base, factor, offset = units.to_base(name)
    exponents = {symbol: base[dimension] for dimension, symbol in _BASE.items() if dimension in base}
    displays = tuple((display, units.factor(name, display)) for display in _DISPLAYS.get(name, ()))
    return Unit(exponents, factor, offset, displays)
