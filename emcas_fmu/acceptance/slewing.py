"""Slew rate over the full travel: unloaded, against and with the rated load, in both directions."""

from __future__ import annotations

import numpy as np

from ..reference.cases import LOAD_RISE
from ..validation import metrics
from .bench import STEP, Bench
from .outcome import Outcome, Quantity

NAME = "slew_rate"
SETTLE = 1.0  # s at the starting end, unloaded
SLEW = 1.0  # s from the command to the other end

QUANTITIES = (
    Quantity("sustained_rate_deg_per_s", "sustained rate", "mean over the middle 60 % of the travel"),
    Quantity("peak_rate_deg_per_s", "peak rate", "largest rate at any instant"),
    Quantity("time_to_90_percent_s", "time to 90 %", "from the command until 90 % of the travel is covered"),
)


def measure(bench: Bench) -> Outcome:
    """From one end of the range to the other."""
    figures, series = {}, {}
    for load, factor in (("unloaded", 0.0), ("opposing", -1.0), ("aiding", 1.0)):
        for direction, sign in (("positive", 1.0), ("negative", -1.0)):
            target = sign * bench.limit
            time = np.arange(round((SETTLE + SLEW) / STEP) + 1) * STEP
            moment = factor * sign * bench.load * np.clip((time - SETTLE) / LOAD_RISE, 0.0, 1.0)
            command = np.where(time > SETTLE - STEP / 2, target, -target)
            command[time < STEP / 2] = 0.0
            run = bench.run({"fin_command": np.radians(command), "aero_torque": moment})
            angle, rate = np.degrees(run["fin_angle"]), np.degrees(run["fin_rate"])
            found = metrics.slew(run["time"], angle, rate, SETTLE, target)
            begin = round(SETTLE / STEP)
            share = (angle[begin:] - angle[begin]) / (target - angle[begin])
            group = f"{load}_{direction}"
            figures[group] = {
                "sustained_rate_deg_per_s": float(found.sustained), "peak_rate_deg_per_s": found.peak,
                "time_to_90_percent_s": metrics.crossing(run["time"][begin:], share, 0.9) - SETTLE}
            series[group] = {"time_s": run["time"][begin:] - SETTLE, "angle_deg": angle[begin:],
                             "rate_deg_per_s": rate[begin:], "current_a": run["motor_current"][begin:]}
    rated = f"{bench.load:g} N.m"
    labels = {f"{load}_{d}": f"{text}, {d}" for load, text in (
        ("unloaded", "unloaded"), ("opposing", f"against {rated}"), ("aiding", f"with {rated}")) for d in (
        "positive", "negative")}
    return Outcome(
        NAME, "Slew rate",
        f"From -{bench.limit:g} to +{bench.limit:g} deg and back the other way, after {SETTLE:g} s at the starting end "
        f"without load. The load comes on within {LOAD_RISE * 1e3:g} ms of the command and stays: against the motion "
        "(opposing) or with it (aiding).", QUANTITIES, figures,
        ("unloaded_positive.sustained_rate_deg_per_s", "unloaded_negative.sustained_rate_deg_per_s",
         "opposing_positive.sustained_rate_deg_per_s", "opposing_negative.sustained_rate_deg_per_s"), labels,
        series=series)


