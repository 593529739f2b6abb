"""Natural frequencies of motor shaft and screw, (2.48)-(2.55), in hertz.

    A = pi d^2/4    J_p = pi d^4/32    k_x = E A/L    k_t = G J_p/L                (2.48)-(2.51)
    m_eq = J_eq/l^2    f_x = sqrt(k_x/m_eq)/(2 pi)    f_t = sqrt(k_t/J_eq)/(2 pi)    (2.52)-(2.55)

The thesis finds them 42 and 139 times its bandwidth of 10 Hz. That divides rad/s by Hz: the true factors are
6.7 and 22, still enough for a rigid model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import pi, sqrt
from pathlib import Path
from typing import Any

from ..actuators import NONLINEAR, get
from ..errors import EmcasError
from ..files import models_directory
from ..ops.floats import FLOATS
from ..physics import kinematics, mechanics
from ..toml import tomllib
from ..units import UnitError, quantity

_UNITS = {"rod.length": "m", "rod.diameter": "m", "rod.tensile_modulus": "N/m^2", "rod.shear_modulus": "N/m^2",
          "thesis.inertia": "kg*m^2", "thesis.mass": "kg", "thesis.bandwidth": "Hz"}
_FIELDS = ("value", "unit", "source", "note")


@dataclass(frozen=True)
class Modes:
    """Natural frequencies [Hz] of the rod in tension and in torsion, for an inertia [kg.m2] and mass [kg] on it.

    ``ratios`` are those frequencies over the required bandwidth [Hz] (axial, torsional), ``slipped`` the same
    with rad/s over Hz.
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
        """The same ratios with angular frequencies [rad/s] over the bandwidth [Hz], as the thesis has them."""
        return 2.0 * pi * self.ratios[0], 2.0 * pi * self.ratios[1]


def load_rod(path: Path | None = None) -> Mapping[str, float]:
    """Rod and the thesis's Table 1 from models/rod.toml, overridden by a file's entries; SI, by dotted name.

    Raises EmcasError naming file, entry and remedy.
    """
    default = models_directory() / "rod.toml"
    return {**_read(default), **(_read(path) if path else {})}


def _read(path: Path) -> dict[str, float]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"), parse_float=str)
    except OSError as error:
        raise EmcasError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # TOML, and text that is not UTF-8
        raise EmcasError(f"{path}: is not valid TOML: {error}") from error
    found = {}
    for group, entries in document.items():
        for key, written in (entries if isinstance(entries, dict) else {"": entries}).items():
            name = f"{group}.{key}" if key else group
            fields = written if isinstance(written, dict) else {"value": written}
            if name not in _UNITS:
                close = get_close_matches(name, _UNITS, 1)
                raise EmcasError(f"{path}: {name}: unknown entry; "
                                 + (f"did you mean {close[0]}?" if close else f"there is {', '.join(_UNITS)}"))
            if "value" not in fields or any(field not in _FIELDS for field in fields):
                raise EmcasError(f"{path}: {name}: an entry has {', '.join(_FIELDS)}")
            try:
                found[name] = quantity(str(fields["value"]), str(fields.get("unit", "")), _UNITS[name])
            except UnitError as error:
                raise EmcasError(f"{path}: {name} = {fields['value']}: {error}") from error
            if not found[name] > 0.0:
                raise EmcasError(f"{path}: {name} = {fields['value']}: must be above 0")
    return found


def modes(rod: Mapping[str, float], inertia: float, mass: float) -> Modes:
    """The rod's natural frequencies with an inertia [kg.m2] in torsion and a mass [kg] in tension at its end."""
    length, diameter = rod["rod.length"], rod["rod.diameter"]
    tension = rod["rod.tensile_modulus"] * pi * diameter**2 / 4.0 / length
    torsion = rod["rod.shear_modulus"] * pi * diameter**4 / 32.0 / length
    return Modes(inertia, mass, sqrt(tension / mass) / (2.0 * pi), sqrt(torsion / inertia) / (2.0 * pi),
                 rod["thesis.bandwidth"])


def modes_at(rod: Mapping[str, float], values: Mapping[str, Any], fin_angle: float, model: str = NONLINEAR) -> Modes:
    """With the parameter set's inertia at the motor, at a fin angle [rad]."""
    p = get(model).namespace(values)
    inertia = mechanics.coefficients(FLOATS, p, kinematics.motor_angle(FLOATS, p, fin_angle), 0.0, 0.0, 0.0).inertia
    return modes(rod, inertia, inertia / p.screw.lead**2)


def thesis_modes(rod: Mapping[str, float]) -> Modes:
    """With the inertia and mass of Table 1."""
    return modes(rod, rod["thesis.inertia"], rod["thesis.mass"])
