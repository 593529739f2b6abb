"""Natural frequencies of motor shaft and screw, (2.48)-(2.55) of the thesis, in hertz.

    A = pi d^2/4    J_p = pi d^4/32    k_x = E A/L    k_t = G J_p/L                (2.48)-(2.51)
    m_eq = J_eq/l^2    f_x = sqrt(k_x/m_eq)/(2 pi)    f_t = sqrt(k_t/J_eq)/(2 pi)    (2.52)-(2.55)

d and L are the rod's diameter and length, E and G its tensile and shear moduli, J_eq [kg.m2] is the inertia at the
motor, l [m/rad] the screw's lead. The thesis states that the frequencies are 42 and 139 times its bandwidth of 10 Hz,
but divides rad/s by Hz. The true factors, 6.7 and 22, still justify a rigid model.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from pathlib import Path
from typing import Any

from ...actuators import NONLINEAR, get
from ...errors import EmcasError
from ...ops.floats import FLOATS
from ...parameters.entries import Known, read_entries
from ...parameters.schema import document
from ...physics import kinematics, mechanics
from ...support.files import models_directory
from ...variables import Variable

_SMALLEST = 1e-15  # lower limit of each quantity in its unit, since all must be above 0
_KNOWN = Known([Variable(name, "Real", "parameter", "fixed", unit, "", _SMALLEST) for name, unit in {
    "rod.length": "m", "rod.diameter": "m", "rod.tensile_modulus": "N/m^2", "rod.shear_modulus": "N/m^2",
    "thesis.inertia": "kg*m^2", "thesis.mass": "kg", "thesis.bandwidth": "Hz"}.items()], "a rod has no such entry")


def load_rod(path: Path | None = None) -> Mapping[str, float]:
    """Return the values [SI] of the rod and of the thesis's Table 1 by dotted name.

    They are those of models/rod.toml; the file `path` overrides them. Raises EmcasError for an invalid file.
    """
    entries: dict[str, float] = {}
    for file in (models_directory() / "rod.toml", *([path] if path else [])):
        read, problems = read_entries(document(file, EmcasError, str)[1], str(file), file.name, "user", _KNOWN)
        if problems:
            raise EmcasError("\n".join(problems))
        entries |= {name: float(entry.value) for name, entry in read.items()}
    return entries


def modes(rod: Mapping[str, float], inertia: float, mass: float) -> dict[str, float]:
    """Return the natural frequencies [Hz] of a rod in tension and torsion, with the keys of the JSON file.

    The rod has an `inertia` [kg.m2] and a `mass` [kg] at its end. Ratios [1] are relative to `thesis.bandwidth`.
    """
    length, diameter = rod["rod.length"], rod["rod.diameter"]
    tension = rod["rod.tensile_modulus"] * pi * diameter**2 / 4.0 / length
    torsion = rod["rod.shear_modulus"] * pi * diameter**4 / 32.0 / length
    axial, torsional = sqrt(tension / mass) / (2.0 * pi), sqrt(torsion / inertia) / (2.0 * pi)
    return {"axial_hz": axial, "torsional_hz": torsional, "axial_over_bandwidth": axial / rod["thesis.bandwidth"],
            "torsional_over_bandwidth": torsional / rod["thesis.bandwidth"], "bandwidth_hz": rod["thesis.bandwidth"]}


def modes_at(rod: Mapping[str, float], values: Mapping[str, Any], fin_angle: float, model: str = NONLINEAR
             ) -> dict[str, float]:
    """Return :func:`modes` with the parameter set's inertia at the motor, at a fin angle [rad]."""
    p = get(model).plant(values)
    inertia = mechanics.coefficients(FLOATS, p, kinematics.motor_angle(FLOATS, p, fin_angle)).inertia
    mass = inertia / p.screw.lead**2
    return {**modes(rod, inertia, mass), "inertia_kgm2": inertia, "mass_kg": mass}


def thesis_modes() -> dict[str, float]:
    """Return :func:`modes` of the rod in Table 1 with its inertia and mass, and the thesis's ratios of rad/s to Hz."""
    rod = load_rod()
    table = modes(rod, rod["thesis.inertia"], rod["thesis.mass"])
    ratios = {f"{name}_rad_per_s_over_hz": 2.0 * pi * table[f"{name}_over_bandwidth"]
              for name in ("axial", "torsional")}
    return {**table, **ratios}
