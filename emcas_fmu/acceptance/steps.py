"""Step responses, both signs, several sizes."""

from __future__ import annotations

import numpy as np

from ..validation import metrics
from .bench import HOLD, STEP_AT, Bench, step_inputs
from .outcome import Outcome, Quantity

SIZES = (1.0, 5.0, 10.0)  # deg, and the end of the range
NAME = "step_response"

QUANTITIES = (
    Quantity("rise_time_s", "rise time", "first time from 10 to 90 % of the commanded change"),
    Quantity("settling_time_s", "settling time", "from the command until the angle stays within ±2 % of the change "
             "around the command"),
    Quantity("overshoot_percent", "overshoot", "largest angle beyond the command, in % of the change"),
    Quantity("steady_error_deg", "steady error", f"mean of angle - command over the last tenth of the {HOLD:g} s "
             "the command is held"),
)


def group_of(size: float) -> str:
    """The name of the step of `size` [deg]."""
    return f"{'plus' if size > 0.0 else 'minus'}_{abs(size):g}deg".replace(".", "p")


def measure(bench: Bench) -> Outcome:
    """Step from rest at zero to each size, no load."""
    figures, series, labels = {}, {}, {}
    for size in (sign * size for size in bench.sizes(SIZES) for sign in (1.0, -1.0)):
        run = bench.run(step_inputs(size))
        time, angle = run["time"], np.degrees(run["fin_angle"])
        found = metrics.step_metrics(time, angle, STEP_AT, size)
        group = group_of(size)
        labels[group] = f"{size:+g} deg"
        figures[group] = {"rise_time_s": found.rise_time, "settling_time_s": found.settling_time,
                          "overshoot_percent": found.overshoot, "steady_error_deg": found.steady_error}
        series[group] = {"time_s": time - STEP_AT, "angle_deg": angle, "command_deg": np.array([size])}
    largest = group_of(bench.sizes(SIZES)[-1])
    return Outcome(
        NAME, "Step response",
        f"From rest at 0 deg the command jumps to each size and stays there for {HOLD:g} s; no load. Outputs are "
        "read every 1 ms.", QUANTITIES, figures,
        (f"{group_of(1.0)}.rise_time_s", f"{group_of(1.0)}.settling_time_s", f"{largest}.rise_time_s",
         f"{largest}.settling_time_s", f"{largest}.overshoot_percent"),
        labels, series=series)
