"""FMI's view of the table's units: exponents of the base units, and display units."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi


@dataclass(frozen=True)
class Unit:
    """Base-unit exponents, factor and offset to SI, display units (name, factor, offset)."""

    exponents: dict[str, int]
    offset: float = 0.0
    displays: tuple[tuple[str, float, float], ...] = ()
    factor: float = field(default=1.0)


_DEGREE = ("deg", 180.0 / pi, 0.0)

UNITS: dict[str, Unit] = {
    "1": Unit({}),
    "rad": Unit({"rad": 1}, displays=(_DEGREE,)),
    "rad/s": Unit({"rad": 1, "s": -1}, displays=(("deg/s", 180.0 / pi, 0.0), ("rpm", 30.0 / pi, 0.0))),
    "m": Unit({"m": 1}, displays=(("mm", 1e3, 0.0),)),
    "m/rad": Unit({"m": 1, "rad": -1}, displays=(("mm/rev", 2e3 * pi, 0.0),)),
    "m/s2": Unit({"m": 1, "s": -2}),
    "kg": Unit({"kg": 1}),
    "kg.m2": Unit({"kg": 1, "m": 2}),
    "s": Unit({"s": 1}, displays=(("ms", 1e3, 0.0),)),
    "1/s": Unit({"s": -1}),
    "1/s2": Unit({"s": -2}),
    "N.m": Unit({"kg": 1, "m": 2, "s": -2}),
    "N.m/A": Unit({"kg": 1, "m": 2, "s": -2, "A": -1}),
    "N.m.s/rad": Unit({"kg": 1, "m": 2, "s": -1, "rad": -1}),
    "N.m/rad": Unit({"kg": 1, "m": 2, "s": -2, "rad": -1}),
    "rad/(N.m)": Unit({"kg": -1, "m": -2, "s": 2, "rad": 1}),
    "N/m": Unit({"kg": 1, "s": -2}),
    "m/N": Unit({"kg": -1, "s": 2}),
    "N.s/m": Unit({"kg": 1, "s": -1}),
    "V": Unit({"kg": 1, "m": 2, "s": -3, "A": -1}),
    "V/A": Unit({"kg": 1, "m": 2, "s": -3, "A": -2}),
    "V/(A.s)": Unit({"kg": 1, "m": 2, "s": -4, "A": -2}),
    "V.s/rad": Unit({"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
    "A": Unit({"A": 1}),
    "A/V": Unit({"kg": -1, "m": -2, "s": 3, "A": 2}),
    "Ohm": Unit({"kg": 1, "m": 2, "s": -3, "A": -2}),
    "H": Unit({"kg": 1, "m": 2, "s": -2, "A": -2}),
    "W": Unit({"kg": 1, "m": 2, "s": -3}),
    "degC": Unit({"K": 1}, offset=273.15),
    "K": Unit({"K": 1}),
    "1/K": Unit({"K": -1}),
    "J/K": Unit({"kg": 1, "m": 2, "s": -2, "K": -1}),
    "K/W": Unit({"kg": -1, "m": -2, "s": 3, "K": 1}),
}
