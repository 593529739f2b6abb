"""Responses to the command: steps of several sizes, sweeps at two amplitudes, slews over the full travel."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, radians
from typing import Any

import numpy as np

from ...bench.excitation import HOLD, Excitation, step_to, sweep
from ...bench.frequency_response import SWEPT, sweep_response
from ...bench.measure import BANDWIDTHS, Test, excitation, sweep_figures
from ...bench.metrics import motion
from ...motions import LOAD_RISE, SETTLE, SWEEP
from .outcome import Outcome, Quantity, Rig, displayed, quantity

SIZES = (1.0, 5.0, 10.0)  # deg of a step; the end of the range is added
DURATION = 1.0  # s from the command to the other end
_TINY = 1e-9  # deg; a size this close to the limit is the limit

STEP = (
    quantity("rise_time", "rise time"), quantity("settling_time", "settling time"),
    quantity("overshoot", "overshoot"), quantity("steady_error", "steady error"),
)
FREQUENCY = (
    quantity("bandwidth_3db", "-3 dB"), quantity("bandwidth_90deg", "-90 deg"),
    quantity("peak_gain", "largest gain"), quantity("lowest_coherence", "least coherence"),
)
SLEW = (
    quantity("sustained_rate", "sustained rate"), quantity("peak_rate", "peak rate"),
    quantity("time_to_90_percent", "time to 90 %"),
)


def step_sizes(limit: float) -> list[float]:
    """Return the SIZES [deg] within the `limit` of the command [deg], and the limit."""
    limit = round(limit, 9)
    return [size for size in SIZES if size < limit - _TINY] + [limit]


def steps(rig: Rig) -> Outcome:
    """Measure steps from rest at zero to each size, both signs, no load."""
    sizes = step_sizes(rig.limit)
    signed = [sign * size for size in sizes for sign in (1.0, -1.0)]
    first, largest = _step_group(1.0), _step_group(sizes[-1])
    return Outcome(
        f"From rest at 0 deg the command jumps to each size and stays there for {HOLD:g} s; no load. Outputs are "
        "read every 1 ms.", STEP,
        headline=(f"{first}.rise_time_s", f"{first}.settling_time_s", f"{largest}.rise_time_s",
                  f"{largest}.settling_time_s", f"{largest}.overshoot_percent"),
        labels={_step_group(size): f"{size:+g} deg" for size in signed},
        **_motions(rig, {_step_group(size): step_to(radians(size), HOLD) for size in signed}, STEP))


def _step_group(size: float) -> str:
    return f"{'plus' if size > 0.0 else 'minus'}_{abs(size):g}deg".replace(".", "p")


def _motions(rig: Rig, excitations: Mapping[str, Excitation], quantities: tuple[Quantity, ...]) -> dict[str, Any]:
    """Return the runs of motions by group, and the figures of the last step of each command."""
    runs = {group: rig.run(each) for group, each in excitations.items()}
    return {"data": runs, "figures": {group: displayed(motion(run, -1), quantities) for group, run in runs.items()}}


def frequency(rig: Rig) -> Outcome:
    """Measure bandwidths under sines, and the response to logarithmic sweeps, H1 estimate by Welch's method."""
    figures, curves, notes, labels = {}, {}, [], {"1deg": "1 deg", "3p5deg": "3.5 deg"}
    lowest, highest = BANDWIDTHS
    for (group, label), amplitude in zip(labels.items(), (1.0, 3.5), strict=True):
        response = sweep_response(rig.run(sweep(radians(amplitude), 12.0)))
        measured = sweep_figures(response, rig.subject, radians(amplitude), {})
        bandwidth = measured["bandwidth_3db"]
        if bandwidth <= lowest:
            notes.append(f"At {label} the gain is below -3 dB from {lowest:g} Hz on.")
        elif isnan(bandwidth):
            notes.append(f"At {label} there is no bandwidth: what comes out is no sine of the command's frequency.")
        figures[group] = displayed(measured, FREQUENCY)
        curves[group] = {"frequency_hz": response.frequency, "gain_db": response.gain_db,
                         "phase_deg": np.degrees(response.phase), "coherence": response.coherence}
    low, high = SWEPT
    return Outcome(
        "Fin angle over command, the fundamental: the describing function of the amplitude. Bandwidths by sines of the "
        f"command about 0 deg, no load, the frequency bisected between {lowest:g} and {highest:g} Hz. Curves, largest "
        f"gain and coherence by a logarithmic sine sweep from {SWEEP[0]:g} to {SWEEP[1]:g} Hz in 12 s; H1 estimate by "
        f"Welch's method, Hann segments of 1 s, evaluated from {low:g} to {high:g} Hz. Coherence is below 1 where the "
        "response is not linear, or changes within a segment.", FREQUENCY, figures,
        tuple(f"{group}.{key}" for group in labels for key in ("bandwidth_3db_hz", "bandwidth_90deg_hz")),
        labels, curves, notes=tuple(notes))


def slews(rig: Rig) -> Outcome:
    """Measure slews from one end of the range to the other: unloaded, against and with the rated load."""
    loads = {"unloaded": (0.0, "unloaded"), "opposing": (-1.0, f"against {rig.load:g} N.m"),
             "aiding": (1.0, f"with {rig.load:g} N.m")}
    moves, labels = {}, {}
    for load, (factor, label) in loads.items():
        test = Test("slew", radians(rig.limit), DURATION, factor * rig.load)
        for direction, sign in (("positive", 1.0), ("negative", -1.0)):
            moves[f"{load}_{direction}"] = excitation(test, sign, rig.subject)
            labels[f"{load}_{direction}"] = f"{label}, {direction}"
    return Outcome(
        f"From -{rig.limit:g} to +{rig.limit:g} deg and back the other way, after {SETTLE:g} s at the starting end "
        f"without load. The load comes on within {LOAD_RISE * 1e3:g} ms of the command and stays: against the motion "
        "(opposing) or with it (aiding).", SLEW, labels=labels,
        headline=tuple(f"{group}.sustained_rate_deg_per_s" for group in moves if not group.startswith("aiding")),
        **_motions(rig, moves, SLEW))
