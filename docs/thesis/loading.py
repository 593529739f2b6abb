"""Section 5.4.2, loaded tests on the loading test setup (Figures 5.17 and 5.27 to 5.30)."""

from __future__ import annotations

from math import degrees
from typing import Any

import numpy as np

from emcas_fmu.bench.excitation import COMMAND, LOAD, Excitation, times
from emcas_fmu.bench.metrics import crossing, rms, settling, sustained_rate
from emcas_fmu.motions import LEAD_IN, LOAD_RISE, RATED, STEP
from emcas_fmu.plotting.plots import GRAY

from . import loading_rig
from .entry import Shown, Table
from .pictures import Line, Panel, angle, command, current, panels, rate
from .rigs import Columns
from .runs import SLEWS, Runs

_UNKNOWN = "command and load over time, and every number of the setup (Table 16); all are estimates."
_SPAN = 0.35  # s after the beginning of a slew: the enlarged part


def _conditions(runs: Runs) -> str:
    reach = degrees(runs.reach)
    return runs.conditions(f"0, {-reach:g}°, {reach:g}° at {SLEWS[0]:g} s, {-reach:g}° at {SLEWS[1]:g} s",
                           f"-{RATED:g} N.m from {SLEWS[0]:g} s on, by the loading test setup")


def torque_loop(runs: Runs) -> Shown:
    """Show how the setup's torque loop loads a fin that the actuator holds (Figure 5.17)."""
    time = times(0.6)
    requested = RATED * np.clip((time - LEAD_IN) / LOAD_RISE, 0.0, 1.0)
    values = {**runs.values, "fin.start_angle": 0.0}  # the fin is held from the start
    run = loading_rig.run(values, Excitation("load comes on", {COMMAND: 0.0 * time, LOAD: requested}, LEAD_IN))
    share = run.applied / RATED
    after, fin = time > LEAD_IN - STEP / 2, run.columns["fin_angle"]
    moved = fin[after] - fin[~after][-1]
    rows = (("rise 10-90 % [ms]", 1e3 * (crossing(time, share, 0.9) - crossing(time, share, 0.1))),
            ("overshoot [%]", 100.0 * max(float(np.max(share)) - 1.0, 0.0)),
            ("settling 2 % [ms]", 1e3 * settling(time[after], np.abs(share - 1.0)[after], 0.02)),
            ("largest deflection of the fin [deg]", degrees(float(np.max(np.abs(moved))))))
    load = f"{RATED:g} N.m requested from the loading test setup within {1e3 * LOAD_RISE:g} ms"
    return Shown(runs.conditions("0", load), panels([
        Panel("moment [N.m]", [Line(time, requested, "requested", {"color": GRAY}),
                               Line(time, run.applied, "applied")]),
        Panel("fin angle [deg]", [angle(run.columns)])], "time [s]", (0.0, 0.4)),
        "The torque loop feeds the requested moment forward, and corrects the moment by the sensor's reading.",
        Table(("", "value"), rows), _UNKNOWN)


def commanded(runs: Runs) -> Shown:
    """Show fin angle and command of the loaded test (Figure 5.27)."""
    run = runs.loaded
    return Shown(_conditions(runs), panels([Panel("fin angle [deg]", [
        command(run.excitation.time, run.excitation.command), angle(run.columns, "fin")])], "time [s]"),
        "From one end of the range to the other against the load, and back with it.", unknown=_UNKNOWN)


def applied(runs: Runs) -> Shown:
    """Show the moment that the setup applies (Figure 5.28)."""
    run = runs.loaded
    time, missed = run.columns["time"], run.applied - run.requested
    rows = []
    for label, begin in zip(("against the load", "with the load"), SLEWS, strict=True):
        during = missed[(time >= begin) & (time < begin + _SPAN)]
        rows.append((label, float(np.max(np.abs(during))), rms(during)))
    return Shown(_conditions(runs), panels([Panel("moment on the fin [N.m]", [
        Line(time, run.requested, "requested", {"color": GRAY}), Line(time, run.applied, "applied")])], "time [s]"),
        "The peaks come from the setup's inertia and friction, which the fin has to move until the torque loop has "
        "compensated them; they also occur before 1 s, without a requested moment.",
        Table(("slew", "largest difference [N.m]", "root mean square [N.m]"), rows), _UNKNOWN)


def _rates(runs: Runs, columns: Columns) -> list[float]:
    """Return the mean rates [deg/s] of both slews."""
    time = columns["time"]
    upto = time <= SLEWS[1]
    return [degrees(sustained_rate(time[upto], columns["fin_angle"][upto], SLEWS[0], runs.reach)),
            degrees(sustained_rate(time, columns["fin_angle"], SLEWS[1], -runs.reach))]


def results(runs: Runs) -> Shown:
    """Show angle, rate and current of the loaded test: with the setup, and with an exact moment (Figure 5.29)."""
    return _results(runs, (0.0, float(runs.loaded.columns["time"][-1])), "The whole test.")


def zoomed(runs: Runs) -> Shown:
    """Show the slew against the load, enlarged (Figure 5.30)."""
    return _results(runs, (SLEWS[0] - LEAD_IN, SLEWS[0] + _SPAN), "The slew against the load.")


def _results(runs: Runs, window: tuple[float, float], caption: str) -> Shown:
    run, both = runs.loaded, {"loading setup": runs.loaded.columns, "exact moment": runs.ideal.columns}
    looks: tuple[dict[str, Any], ...] = ({}, {"linestyle": (0, (4, 2)), "linewidth": 1.0})
    rows = [(name, *_rates(runs, columns), float(np.max(np.abs(columns["motor_current"]))))
                                    for name, columns in both.items()]
    return Shown(_conditions(runs), panels([
        Panel("fin angle [deg]", [command(run.excitation.time, run.excitation.command),
                                  *(angle(c, name, **look) for (name, c), look in zip(both.items(), looks))]),
        Panel("fin rate [deg/s]", [rate(c, **look) for c, look in zip(both.values(), looks)], (200.0,)),
        Panel("current [A]", [current(c, **look) for c, look in zip(both.values(), looks)])], "time [s]", window),
        f"{caption} Dashed: with exactly the requested moment. Dotted: 200 deg/s, the required rate against "
        f"{RATED:g} N.m (Table 2).",
        Table(("load from", "mean rate against the load [deg/s]", "mean rate with the load [deg/s]",
               "largest current [A]"), rows), _UNKNOWN)
