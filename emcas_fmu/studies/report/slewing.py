"""Slew rate over the full travel: unloaded, against and with the rated load, in both directions."""

from __future__ import annotations

from math import radians

import numpy as np

from ...bench.excitation import SETTLE, slew_to
from ...bench.metrics import motion, since
from ...reference.cases import LOAD_RISE
from .outcome import Outcome, displayed, quantity
from .rig import Rig

NAME = "slew_rate"
SLEW = 1.0  # s from the command to the other end

QUANTITIES = (
    quantity("sustained_rate", "sustained rate"), quantity("peak_rate", "peak rate"),
    quantity("time_to_90_percent", "time to 90 %"),
)


def measure(rig: Rig) -> Outcome:
    """Measure slews from one end of the range to the other."""
    figures, series, labels = {}, {}, {}
    for load, factor, label in (("unloaded", 0.0, "unloaded"), ("opposing", -1.0, f"against {rig.load:g} N.m"),
                                ("aiding", 1.0, f"with {rig.load:g} N.m")):
        for direction, sign in (("positive", 1.0), ("negative", -1.0)):
            slew = slew_to(radians(sign * rig.limit), SLEW, factor * sign * rig.load)
            run, group = rig.run(slew), f"{load}_{direction}"
            labels[group] = f"{label}, {direction}"
            figures[group] = displayed(motion(run, 1), QUANTITIES)
            names = [name for name in ("fin_angle", "fin_rate", "motor_current") if name in run.columns]
            time, *columns = since(slew.begin, run.columns["time"], *(run.columns[name] for name in names))
            series[group] = {"time_s": time - slew.begin, **{
                name: column if name == "motor_current" else np.degrees(column)
                for name, column in zip(names, columns, strict=True)}}
    return Outcome(
        f"From -{rig.limit:g} to +{rig.limit:g} deg and back the other way, after {SETTLE:g} s at the starting end "
        f"without load. The load comes on within {LOAD_RISE * 1e3:g} ms of the command and stays: against the motion "
        "(opposing) or with it (aiding).", QUANTITIES, figures,
        tuple(f"{group}.sustained_rate_deg_per_s" for group in figures if not group.startswith("aiding")), labels,
        series=series)
