"""Steady errors by the final-value theorem; of loops in cascade with P and with PI position control.

After a step of size a of the command, lim e(k) = lim_{z->1} (z - 1) E(z) = a (1 - G(1)), and of the load -a G(1), with
the closed loop G, if it is stable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, inf, log, nan
from typing import Any

from ...actuators import NONLINEAR, capabilities, get
from ...bench.linear.actuator import LinearActuator
from ...bench.linear.systems import cleared, largest_pole
from ...motions import RATED

COMMAND = 1.0  # deg; the load is that of the thesis's Table 2


@dataclass(frozen=True)
class FinalValues:
    """Steady errors [deg], command less fin angle, after steps of COMMAND and RATED; nan if the loop is unstable.

    ``name`` is the position controller's, ``ki`` its integral gain [1/s2] (None for a loop not in cascade). ``slowest``
    [s] is the largest time constant of the closed loop: final values are reached after several of them.
    """

    name: str
    ki: float | None
    command_error: float
    load_error: float
    slowest: float
    stable: bool


def final_values(values: Mapping[str, Any], fin_angle: float = 0.0, aero_torque: float = 0.0,
                 model: str = NONLINEAR) -> list[FinalValues]:
    """Return the final values at `fin_angle` [rad] under `aero_torque` [N.m].

    Loops in cascade have P control and, if the integral gain is not zero, PI control; other loops are as set.
    """
    gains: dict[str, float | None] = {"as set": None}
    if capabilities.CASCADE in get(model).provides:
        gain = float(values["controller.position.ki"])
        gains = {"P": 0.0, "PI": gain} if gain else {"P": 0.0}
    table = []
    for name, ki in gains.items():
        changed = dict(values) if ki is None else {**values, "controller.position.ki": ki}
        if ki == 0.0:  # without an integral, a weighted command would leave an error
            changed["controller.position.setpoint_weight"] = 1.0
        linear = LinearActuator(changed, fin_angle, aero_torque, model)
        command, load = linear.closed.dcgain()[0] if linear.stable else (nan, nan)
        largest = largest_pole(linear.closed)
        slowest = (-linear.period / log(largest) if largest else 0.0) if linear.stable else inf
        table.append(FinalValues(name, ki, cleared(COMMAND * (1.0 - command), 1e-9),
                                 cleared(degrees(-RATED * load), 1e-9), slowest, linear.stable))
    return table
