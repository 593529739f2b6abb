"""Natural frequencies of motor shaft and screw, (2.48)-(2.55), in hertz.

    A = pi d^2/4    J_p = pi d^4/32    k_x = E A/L    k_t = G J_p/L                (2.48)-(2.51)
    m_eq = J_eq/l^2    f_x = sqrt(k_x/m_eq)/(2 pi)    f_t = sqrt(k_t/J_eq)/(2 pi)    (2.52)-(2.55)

In the thesis they are 42 and 139 times the bandwidth of 10 Hz. That divides rad/s by Hz: the true factors are 6.7 and
22, still enough for a rigid model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan, pi, sqrt
from pathlib import Path
from typing import Annotated, Any

from ...actuators import NONLINEAR, get
from ...errors import EmcasError
from ...ops.floats import FLOATS
from ...parameters.schema import In, Table, load
from ...physics import kinematics, mechanics
from ...support.files import models_directory


@dataclass(frozen=True)
class _Entry(In):
    """A quantity above 0, alone or in a table with its unit, source and note."""

    def limited(self, written: Any) -> Any:
        """Return the value in the unit. Raises ValueError."""
        if isinstance(written, Mapping):
            if "value" not in written or not {"value", "unit", "source", "note"}.issuperset(written):
                raise ValueError("an entry has value, unit, source, note")
            written = f"{written['value']} {written.get('unit', '')}"
        value = self.number(written)
        if not value > 0.0:
            raise ValueError("must be above 0")
        return value


class _Rod(Table):
    length: Annotated[float, _Entry("m")] = nan
    diameter: Annotated[float, _Entry("m")] = nan
    tensile_modulus: Annotated[float, _Entry("N/m^2")] = nan
    shear_modulus: Annotated[float, _Entry("N/m^2")] = nan


class _Table1(Table):
    inertia: Annotated[float, _Entry("kg*m^2")] = nan
    mass: Annotated[float, _Entry("kg")] = nan
    bandwidth: Annotated[float, _Entry("Hz")] = nan


class _File(Table):
    rod: _Rod = _Rod()
    thesis: _Table1 = _Table1()


@dataclass(frozen=True)
class Modes:
    """Natural frequencies [Hz] of the rod in tension and torsion, with an inertia [kg.m2] and a mass [kg] at its end.

    `bandwidth` [Hz] is the required one.
    """

    inertia: float
    mass: float
    axial: float
    torsional: float
    bandwidth: float

    @property
    def ratios(self) -> tuple[float, float]:
        """Axial and torsional frequency over the bandwidth [1]."""
        return self.axial / self.bandwidth, self.torsional / self.bandwidth

    @property
    def slipped(self) -> tuple[float, float]:
        """The thesis's ratios: angular frequencies [rad/s] over the bandwidth [Hz]."""
        return 2.0 * pi * self.ratios[0], 2.0 * pi * self.ratios[1]


def load_rod(path: Path | None = None) -> Mapping[str, float]:
    """Return the rod and the thesis's Table 1, SI by dotted name, from models/rod.toml and entries of `path` over it.

    Raises EmcasError with file, entry and remedy.
    """
    entries: dict[str, float] = {}
    for file in (models_directory() / "rod.toml", *([path] if path else [])):
        tables = load(_File, file, EmcasError).model_dump(exclude_unset=True)
        entries |= {f"{table}.{key}": value for table, keys in tables.items() for key, value in keys.items()}
    return entries


def modes(rod: Mapping[str, float], inertia: float, mass: float) -> Modes:
    """Return the rod's natural frequencies with an inertia [kg.m2] and a mass [kg] at its end."""
    length, diameter = rod["rod.length"], rod["rod.diameter"]
    tension = rod["rod.tensile_modulus"] * pi * diameter**2 / 4.0 / length
    torsion = rod["rod.shear_modulus"] * pi * diameter**4 / 32.0 / length
    return Modes(inertia, mass, sqrt(tension / mass) / (2.0 * pi), sqrt(torsion / inertia) / (2.0 * pi),
                 rod["thesis.bandwidth"])


def modes_at(rod: Mapping[str, float], values: Mapping[str, Any], fin_angle: float, model: str = NONLINEAR) -> Modes:
    """Return the natural frequencies with the parameter set's inertia at the motor, at a fin angle [rad]."""
    p = get(model).plant(values)
    inertia = mechanics.coefficients(FLOATS, p, kinematics.motor_angle(FLOATS, p, fin_angle)).inertia
    return modes(rod, inertia, inertia / p.screw.lead**2)


def thesis_modes(rod: Mapping[str, float]) -> Modes:
    """Return the natural frequencies with the inertia and mass of Table 1."""
    return modes(rod, rod["thesis.inertia"], rod["thesis.mass"])
