"""A motor held by friction under a known current, for which heat and I2t have closed forms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+heat"
# No controller: the current is drive.current_offset within the limit, less R/(R + kp) of it, 0.025 % at this gain. At
# 1000 V on 1 uH it is there within 1e-7 s.
HELD = {"friction.coulomb.positive[0]": 10.0, "friction.coulomb.negative[0]": 10.0, "controller.position.kp": 0.0,
        "controller.position.ki": 0.0, "controller.velocity.kp": 0.0, "compensation.gain": 0.0, "drive.ki": 0.0,
        "drive.kp": 1e3, "drive.supply_voltage": 1000.0, "motor.inductance": 1e-6}
NO_COEFFICIENTS = {"heat.resistance_coefficient": 0.0, "heat.torque_coefficient": 0.0}


def values_of(overrides: Mapping[str, Any] | None = None, model: str = MODEL) -> Mapping[str, Any]:
    """Values of a model with heat, some replaced."""
    return load_parameters(model=model).with_values(overrides or {}).values


def held(current: float, stop: float, step: float, overrides: Mapping[str, Any]) -> tuple[Mapping[str, Any], Any]:
    """Values and outputs of a held motor with a current reference [A]."""
    values = values_of({**HELD, "drive.current_offset": current, **overrides})
    return values, simulate(values, stop, step, model=MODEL)
