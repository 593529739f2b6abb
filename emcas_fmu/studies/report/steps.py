"""Step responses, both signs, several sizes."""

from __future__ import annotations

from math import radians

import numpy as np

from ...bench.excitation import step_to
from ...bench.metrics import motion
from ...bench.verdict import HOLD
from .outcome import Outcome, displayed, quantity
from .rig import Rig

SIZES = (1.0, 5.0, 10.0)  # deg, and the end of the range
NAME = "step_response"

QUANTITIES = (
    quantity("rise_time", "rise time"), quantity("settling_time", "settling time"),
    quantity("overshoot", "overshoot"), quantity("steady_error", "steady error"),
)


def group_of(size: float) -> str:
    """Return the name of the step of `size` [deg]."""
    return f"{'plus' if size > 0.0 else 'minus'}_{abs(size):g}deg".replace(".", "p")


def measure(rig: Rig) -> Outcome:
    """Measure steps from rest at zero to each size, no load."""
    figures, series, labels = {}, {}, {}
    for size in (sign * size for size in rig.sizes(SIZES) for sign in (1.0, -1.0)):
        run = rig.run(step_to(radians(size), HOLD))
        group = group_of(size)
        labels[group] = f"{size:+g} deg"
        figures[group] = displayed(motion(run), QUANTITIES)
        series[group] = {"time_s": run.columns["time"] - run.excitation.begin,
                         "angle_deg": np.degrees(run.columns["fin_angle"]), "command_deg": np.array([size])}
    largest = group_of(rig.sizes(SIZES)[-1])
    return Outcome(
        f"From rest at 0 deg the command jumps to each size and stays there for {HOLD:g} s; no load. Outputs are "
        "read every 1 ms.", QUANTITIES, figures,
        (f"{group_of(1.0)}.rise_time_s", f"{group_of(1.0)}.settling_time_s", f"{largest}.rise_time_s",
         f"{largest}.settling_time_s", f"{largest}.overshoot_percent"),
        labels, series=series)
