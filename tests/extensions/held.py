"""A motor blocked by friction under a known current, for which heat and I2t have closed forms."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from emcas_fmu.simulation import simulate

from . import runs
from .runs import BLOCKED

MODEL = "nonlinear+heat"
# At 1000 V on 1 uH the current is there within 1e-7 s, less than its reference by R/(R + kp), 0.025 % at this gain.
BLOCKED_FAST = {**BLOCKED, "drive.kp": 1e3, "drive.supply_voltage": 1000.0, "motor.inductance": 1e-6}
NO_COEFFICIENTS = {"heat.resistance_coefficient": 0.0, "heat.torque_coefficient": 0.0}
values_of = partial(runs.values_of, model=MODEL)


def blocked_run(current: float, stop: float, step: float, overrides: Mapping[str, Any]
                ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return values and outputs of a blocked motor with a current reference [A]."""
    values = values_of(BLOCKED_FAST, {"drive.current_offset": current}, overrides)
    return values, simulate(values, stop, step, model=MODEL)
