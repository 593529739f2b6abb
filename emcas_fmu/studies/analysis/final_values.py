"""Steady errors by the final-value theorem; for loops in cascade, with P and with PI position control.

With a stable closed loop G, the error after a command step of size a is lim e(k) = lim_{z->1} (z - 1) E(z) =
a (1 - G(1)), and after a load step of size a it is -a G(1).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, inf, log, nan
from typing import Any

from ...actuators import NONLINEAR, capabilities, get
from ...bench.linear.actuator import LinearActuator
from ...bench.linear.systems import cleared, largest_pole
from ...motions import RATED

COMMAND = 1.0  # deg, size of the command step; the load step is the load of the thesis's Table 2


def final_values(values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR) -> dict[str, dict[str, Any]]:
    """Return the final values at `fin_angle` [rad] under `aero_torque` [N.m], with the keys of the JSON file.

    Loops in cascade are computed with P control and, if the integral gain ``ki`` [1/s2] is not zero, PI control; others
    as set. Errors, command minus fin angle, are those after steps of COMMAND and RATED, nan if the loop is unstable.
    Final values are reached after several of the slowest time constants.
    """
    gains: dict[str, float | None] = {"as_set": None}
    if capabilities.CASCADE in get(model).provides:
        gain = float(values["controller.position.ki"])
        gains = {"p": 0.0, "pi": gain} if gain else {"p": 0.0}
    table = {}
    for name, ki in gains.items():
        changed = dict(values) if ki is None else {**values, "controller.position.ki": ki}
        if ki == 0.0:  # without an integral, a weighted command would leave an error
            changed["controller.position.setpoint_weight"] = 1.0
        linear = LinearActuator(changed, fin_angle, aero_torque, model)
        command, load = linear.closed.dcgain()[0] if linear.stable else (nan, nan)
        largest = largest_pole(linear.closed)
        slowest = (-linear.period / log(largest) if largest else 0.0) if linear.stable else inf
        table[name] = {"ki": ki, "stable": linear.stable,
                       "command_error_deg": cleared(COMMAND * (1.0 - command), 1e-9),
                       "load_error_deg": cleared(degrees(-RATED * load), 1e-9), "slowest_time_constant_s": slowest}
    return table
