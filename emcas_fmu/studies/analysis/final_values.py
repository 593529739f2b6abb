"""Steady errors by the final-value theorem, with P and with PI position control of loops in cascade.

In a stable closed loop, a command step of size a causes the steady error lim e(k) = lim_{z->1} (z - 1) E(z) =
a (1 - G(1)), with G from command to angle. A load step of size a causes -a G(1), with G from load to angle. The linear
model leaves out friction, which may hold the load; the error after the load step is therefore also simulated.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, inf, log, nan
from typing import Any

import numpy as np

from ...actuators import NONLINEAR, capabilities, get
from ...bench.linear.actuator import LinearActuator
from ...bench.linear.systems import cleared, largest_pole
from ...motions import RATED
from ...simulation import simulate

COMMAND = 1.0  # deg, size of the command step
_BEFORE, _AFTER = 1.0, 3.0  # s, simulated before and after the load step


def final_values(values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR, load: float = RATED) -> dict[str, dict[str, Any]]:
    """Return the final values at `fin_angle` [rad] under `aero_torque` [N.m], with the keys of the JSON file.

    Loops in cascade have the results ``p`` and, if the integral gain ``ki`` [1/s2] is not zero, ``pi``; others have
    ``as_set``. Errors are the final values of command minus fin angle after steps of COMMAND and of the `load` [N.m],
    nan if the loop is unstable; the error that the load adds is also simulated, for 3 s.
    """
    gains: dict[str, float | None] = {"as_set": None}
    if capabilities.CASCADE in get(model).provides:
        gain = float(values["controller.position.ki"])
        gains = {"p": 0.0, "pi": gain} if gain else {"p": 0.0}
    table = {}
    for name, ki in gains.items():
        changed = dict(values) if ki is None else {**values, "controller.position.ki": ki}
        if ki == 0.0 and "controller.position.setpoint_weight" in values:
            changed["controller.position.setpoint_weight"] = 1.0  # another weight causes an error without an integral
        linear = LinearActuator(changed, fin_angle, aero_torque, model)
        to_command, to_load = linear.closed.dcgain()[0] if linear.stable else (nan, nan)
        largest = largest_pole(linear.closed)
        slowest = (-linear.period / log(largest) if largest else 0.0) if linear.stable else inf
        table[name] = {"ki": ki, "stable": linear.stable,
                       "command_error_deg": cleared(COMMAND * (1.0 - to_command), 1e-9),
                       "load_error_deg": cleared(degrees(-load * to_load), 1e-9),
                       "simulated_load_error_deg": _simulated(changed, fin_angle, aero_torque, load, model),
                       "slowest_time_constant_s": slowest}
    return table


def _simulated(values: Mapping[str, Any], fin_angle: float, aero_torque: float, load: float, model: str) -> float:
    """Return the error [deg] that the load adds in the simulation: means over 0.3 s before it and at the end."""
    run = simulate({**values, "fin.start_angle": fin_angle}, _BEFORE + _AFTER, model=model, fin_command=fin_angle,
                   aero_torque=lambda time: aero_torque + load * (time >= _BEFORE))
    time, angle = run["time"], run["fin_angle"]
    before, after = (np.mean(angle[(time > end - 0.1 * _AFTER) & (time <= end)])
                     for end in (_BEFORE - 1e-9, _BEFORE + _AFTER))
    return degrees(before - after)
