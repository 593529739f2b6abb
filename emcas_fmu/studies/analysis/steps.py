"""Steps of the linear models and of the simulated actuator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, radians
from typing import Any

import control as ct
import numpy as np

from ...bench.linear.actuator import LinearActuator
from ...bench.linear.systems import Array
from ...bench.metrics import step_metrics
from ...simulation import simulate
from .thesis import linear_model

SIZES = (1.0, 3.0, 10.0, 20.0)  # deg, of the steps
STOP = 0.6  # s, simulated time after the step; the slowest step has then settled
_SETTLE = 2.0  # s, simulated time under load before the step


@dataclass(frozen=True)
class StepComparison:
    """Changes of the fin angle [deg] at ``time`` [s] after a step of ``size`` [deg, signed], by model.

    ``nonlinear`` is simulated, and ``active`` is true while a limit acts in this simulation. ``thesis`` is None if the
    thesis's model does not apply. The metrics are results of :func:`step_metrics`.
    """

    size: float
    time: Array
    linear: Array
    thesis: Array | None
    nonlinear: Array
    active: Array
    metrics_linear: Mapping[str, Any]
    metrics_nonlinear: Mapping[str, Any]

    @property
    def difference(self) -> float:
        """The largest difference between nonlinear and linear angle [% of the step]."""
        return 100.0 * float(np.max(np.abs(self.nonlinear - self.linear))) / abs(self.size)


def compare(values: Mapping[str, Any], linear: LinearActuator, size: float, thesis: bool = True) -> StepComparison:
    """Compare the models in a step of `size` [deg, signed] from the operating point; `thesis` includes the thesis's."""
    at, period = linear.point.fin_angle, linear.period
    time = np.arange(round(STOP / period) + 1) * period
    command = np.full(len(time), radians(size))
    angle = np.asarray(ct.forced_response(linear.command_to_angle, time, command).outputs)
    torque = linear.point.aero_torque
    lead = round(_SETTLE / period) if torque else 0
    held = np.full(lead + len(time), at)
    stepped = np.concatenate([held[:lead], at + command])
    # The fin may still creep under the load at the step: the response without a step is subtracted.
    run, still = (simulate({**values, "fin.start_angle": at}, (len(held) - 1) * period, period, model=linear.model,
                           fin_command=level, aero_torque=torque) for level in (stepped, held))
    nonlinear = np.degrees(run["fin_angle"] - still["fin_angle"])[lead:]
    metrics = [step_metrics(time, one, 0.0, radians(size)) for one in (angle, np.radians(nonlinear))]
    return StepComparison(size, time, np.degrees(angle),
                          np.degrees(linear_model(values).simulate(command)) if thesis else None,
                          nonlinear, run["saturated"][lead:] > 0.0, *metrics)


def comparisons(values: Mapping[str, Any], linear: LinearActuator, thesis: bool) -> list[StepComparison]:
    """Compare the models in steps of SIZES within the range of commands: positive if possible, otherwise negative."""
    at, limit = degrees(linear.point.fin_angle), degrees(values["command.limit"]) * (1.0 + 1e-9)
    signed = [size if at + size <= limit else -size for size in SIZES]
    return [compare(values, linear, size, thesis) for size in signed if abs(at + size) <= limit]
