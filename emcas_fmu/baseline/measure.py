"""The figures of a response, each with its unit and what it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, nan, radians
from typing import Any

import numpy as np

from ..bench import metrics
from ..bench.excitation import Excitation
from ..bench.metrics import SWEPT
from ..bench.subject import Columns
from .excite import Case, level

ACCURACY = round(float(np.degrees(metrics.ACCURACY)), 9)  # deg


@dataclass(frozen=True)
class Figure:
    """A figure's unit and what it is."""

    unit: str
    title: str


FIGURES: Mapping[str, Figure] = {
    "rise_time": Figure("ms", "10 to 90 % of the commanded change"),
    "settling_time": Figure("ms", "until within 2 % of the change around the command for good"),
    "time_to_accuracy": Figure("ms", f"until within {ACCURACY:g} deg of the command for good"),
    "overshoot": Figure("%", "beyond the command, of the change"),
    "steady_error": Figure("deg", "mean error over the last tenth"),
    "sustained_rate": Figure("deg/s", "mean over the middle 60 % of the travel"),
    "peak_rate": Figure("deg/s", "largest fin rate"),
    "bandwidth_3db": Figure("Hz", "the fundamental is 3 dB down"),
    "bandwidth_90deg": Figure("Hz", "the fundamental lags by 90 deg"),
    "peak_gain": Figure("dB", "largest gain of the fundamental"),
    "peak_angle": Figure("deg", "largest magnitude of the fin angle"),
    "peak_current": Figure("A", "largest magnitude of the motor current, read every 1 ms"),
    "rms_current": Figure("A", "motor current, root mean square"),
    "peak_power": Figure("W", "largest power drawn, read every 1 ms"),
    "energy_drawn": Figure("J", "integral of the power drawn"),
    "energy_returned": Figure("J", "integral of the power fed back"),
}
"""All figures there are, in the order they are told; which of them a case has depends on its kind."""


def figures(case: Case, excitation: Excitation, run: Columns) -> dict[str, float]:
    """Figures of a finished run, in the units of FIGURES; inf or nan where a level is never reached."""
    time, angle, rate = run["time"], np.degrees(run["fin_angle"]), np.degrees(run["fin_rate"])
    found: dict[str, float] = {}
    if case.kind in ("step", "slew"):
        found = _motion(run, case.begin, radians(level(excitation)))
    elif case.kind == "sweep":
        with np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain
            found = _sweep(time, excitation.columns["fin_command"], run["fin_angle"])
    else:
        found = {"peak_angle": float(np.max(np.abs(angle))), "peak_rate": float(np.max(np.abs(rate)))}
    found |= _electrical(time, run)
    return {name: float(found[name]) for name in FIGURES if name in found}


def _motion(run: Columns, begin: float, command: float) -> dict[str, float]:
    time, angle = run["time"], run["fin_angle"]
    step = metrics.step_metrics(time, angle, begin, command)
    slew = metrics.slew(time, angle, run["fin_rate"], begin, command)
    return {"rise_time": step.rise_time * 1e3, "settling_time": step.settling_time * 1e3,
            "time_to_accuracy": step.time_to_accuracy * 1e3, "overshoot": 100.0 * step.overshoot,
            "steady_error": degrees(step.steady_error), "sustained_rate": degrees(slew.sustained),
            "peak_rate": degrees(slew.peak)}


def _sweep(time: Any, command: Any, angle: Any) -> dict[str, float]:
    response = metrics.frequency_response(time, command, angle, *SWEPT)
    return {"bandwidth_3db": response.bandwidth, "bandwidth_90deg": response.phase_bandwidth,
            "peak_gain": float(np.max(response.gain_db)) if len(response.gain) else nan}


def _electrical(time: Any, run: Columns) -> dict[str, float]:
    current, power = run["motor_current"], run["supply_power"]
    return {"peak_current": float(np.max(np.abs(current))), "rms_current": float(np.sqrt(np.mean(current**2))),
            "peak_power": float(np.max(power, initial=0.0)),
            "energy_drawn": float(np.trapezoid(np.maximum(power, 0.0), time)),
            "energy_returned": float(np.trapezoid(np.maximum(-power, 0.0), time))}
