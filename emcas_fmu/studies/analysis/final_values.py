"""Steady errors by the final-value theorem, with P and with PI position control of loops in cascade.

In a stable closed loop, a command step of size a causes the steady error lim e(k) = lim_{z->1} (z - 1) E(z) =
a (1 - G(1)), with G from command to angle. A load step of size a causes -a G(1), with G from load to angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, inf, log, nan
from typing import Any

from ...actuators import NONLINEAR, capabilities, get
from ...bench.linear.actuator import LinearActuator
from ...bench.linear.systems import cleared, largest_pole
from ...motions import RATED

COMMAND = 1.0  # deg, size of the command step; the load step is RATED


def final_values(values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR) -> dict[str, dict[str, Any]]:
    """Return the final values at `fin_angle` [rad] under `aero_torque` [N.m], with the keys of the JSON file.

    Loops in cascade have the results ``p`` and, if the integral gain ``ki`` [1/s2] is not zero, ``pi``; others have
    ``as_set``. Errors are command minus fin angle several of the slowest time constants after steps of COMMAND and
    RATED, nan if the loop is unstable.
    """
    gains: dict[str, float | None] = {"as_set": None}
    if capabilities.CASCADE in get(model).provides:
        gain = float(values["controller.position.ki"])
        gains = {"p": 0.0, "pi": gain} if gain else {"p": 0.0}
    table = {}
    for name, ki in gains.items():
        changed = dict(values) if ki is None else {**values, "controller.position.ki": ki}
        if ki == 0.0:  # without an integral, a setpoint weight other than 1 causes a steady error
            changed["controller.position.setpoint_weight"] = 1.0
        linear = LinearActuator(changed, fin_angle, aero_torque, model)
        command, load = linear.closed.dcgain()[0] if linear.stable else (nan, nan)
        largest = largest_pole(linear.closed)
        slowest = (-linear.period / log(largest) if largest else 0.0) if linear.stable else inf
        table[name] = {"ki": ki, "stable": linear.stable,
                       "command_error_deg": cleared(COMMAND * (1.0 - command), 1e-9),
                       "load_error_deg": cleared(degrees(-RATED * load), 1e-9), "slowest_time_constant_s": slowest}
    return table
