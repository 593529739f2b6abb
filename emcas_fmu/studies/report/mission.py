"""Currents, power and energy over a mission profile, the user's or a synthetic one."""

from __future__ import annotations

import numpy as np

from ...bench.excitation import COMMAND, LOAD, Excitation, times
from ...bench.metrics import displayed, usage_figures
from ...motions import STEP
from ...simulation import Array
from .outcome import FigureGroup, Outcome, Quantity, Rig, quantities, quantity

LAG = 0.02  # s, lag of the hinge moment behind the command in the synthetic profile
RATE = 150.0  # deg/s, largest rate of the command in the synthetic profile
# Phase, its end [s], and the hinge moment at the end of the range as a share of the rated load.
FLIGHT_PHASES = (("launch", 2.0, 0.1), ("pitch-over", 5.0, 0.5), ("midcourse", 10.0, 0.6), ("terminal", 15.0, 1.0))

QUANTITIES = (*quantities("usage"), Quantity("duration_s", "duration of the profile", "duration"))
_HEADLINE = tuple(map(quantity, ("rms_current", "peak_power", "energy_drawn", "energy_returned")))


def synthetic(limit: float, load: float) -> tuple[Array, Array]:
    """Return command [deg] and hinge moment [N.m] of a made-up mission of 15 s, every 1 ms; it is not a flight record.

    `limit` is the largest command [deg], `load` the rated hinge moment [N.m]. docs/tools/acceptance_report.md has a
    table of the phases.
    """
    time = times(FLIGHT_PHASES[-1][1])
    wave = 2.0 * np.pi * time
    doublet = np.where(np.floor((time - 2.0) / 0.5) % 2 < 0.5, 0.5, -0.5)
    busy = 0.1 + 0.04 * (np.sin(0.7 * wave) + np.sin(1.9 * wave) + np.sin(4.3 * wave))
    levels = np.array([0.75, -0.6, 0.9, -0.75, 0.0, 0.0])
    terminal = levels[np.clip((time - 10.0).astype(int), 0, 5)] + 0.05 * np.sin(3.0 * wave)
    phase = np.searchsorted([end for _, end, _ in FLIGHT_PHASES], time, side="right").clip(max=3)
    guidance = limit * np.choose(phase, [0.05 + 0.1 * np.sin(wave), doublet, busy, terminal])
    limited, most = [0.0], RATE * STEP
    for wanted in guidance[1:].tolist():
        limited.append(limited[-1] + min(max(wanted - limited[-1], -most), most))
    command = np.array(limited)
    rows = round(LAG / STEP)
    lagging = np.concatenate([np.zeros(rows), command[:-rows]])
    share = np.array([share for _, _, share in FLIGHT_PHASES])[phase]
    return command, -load * share * lagging / limit


def measure(rig: Rig) -> Outcome:
    """Run the profile, and measure currents, power, energy and tracking error."""
    if rig.mission is None:
        command, torque = synthetic(rig.limit, rig.load)
        profile = Excitation("synthetic profile", {COMMAND: np.radians(command), LOAD: torque})
        name, estimate = "synthetic", (
            "The mission profile is made up, a plausible sequence of phases; currents, power and energy are estimates "
            "of the order of magnitude. Pass the real profile with --mission.")
        method = (
            "Synthetic mission profile: launch (2 s, trim and roll correction), pitch-over (3 s of doublets to half "
            "the range), midcourse (5 s, three sines about a trim), terminal (5 s, steps to 90 % of the range with a "
            "weave at 3 Hz). Commands change by at most 150 deg/s. The hinge moment restores in proportion to the "
            "command 20 ms earlier; in the four phases it is 10, 50, 60 and 100 % of the rated load at the end of the "
            "range.")
    else:
        profile, name, estimate = rig.mission, "file", ""
        method = f"Profile of {profile.title}, {profile.stop:g} s, inputs constant over 1 ms."
    run = rig.run(profile)
    figures = {**displayed(usage_figures(run)), "duration_s": float(run.columns["time"][-1])}
    return Outcome(
        f"{method} Outputs are read every 1 ms: transients of the current loop are shorter, and their power can be "
        "higher." + ("" if "link_voltage" in rig.subject.outputs else
                     " Whether the supply can absorb the returned power is not modelled."),
        {name: FigureGroup(profile.title, figures, _HEADLINE, data=run)}, estimate=estimate)
