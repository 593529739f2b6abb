"""Responses to the command: steps of several sizes, sines and sweeps of two amplitudes, slews over the full travel."""

from __future__ import annotations

from math import isnan, radians

import numpy as np

from ...bench.excitation import HOLD, Excitation, step_to, sweep
from ...bench.frequency_response import SWEPT, sweep_response
from ...bench.measure import BANDWIDTHS, TESTS, Test, bound, excitation, sweep_figures
from ...bench.metrics import displayed, motion_figures
from ...motions import LOAD_RISE, SETTLE, SWEEP
from .outcome import FigureGroup, Outcome, Quantity, Rig, quantities, quantity

SIZES = (1.0, 5.0, 10.0)  # deg, of the steps; a step to the end of the range is added
DURATION = 1.0  # s, of a slew after the command
_TINY = 1e-9  # deg; a size this close to the limit is the limit

MOTION, FREQUENCY = quantities("jump"), quantities("sweep")
_STEP = tuple(map(quantity, ("rise_time", "settling_time", "overshoot")))
_SLEW = (quantity("sustained_rate"),)


def steps(rig: Rig) -> Outcome:
    """Measure steps without load, from rest at 0 deg to each size with both signs."""
    limit = round(rig.limit, 9)
    sizes = [*(size for size in SIZES if size < limit - _TINY), limit]
    headlines = {1.0: _STEP[:2], sizes[-1]: _STEP}
    return Outcome(
        f"From rest at 0 deg the command steps to each size and is constant for {HOLD:g} s; no load. Outputs are "
        "read every 1 ms.",
        {f"{sign}_{size:g}deg".replace(".", "p"):
         _group(rig, f"{side * size:+g} deg", step_to(radians(side * size), HOLD), headlines.get(side * size, ()))
         for size in sizes for sign, side in (("plus", 1.0), ("minus", -1.0))})


def _group(rig: Rig, label: str, excited_by: Excitation, headline: tuple[Quantity, ...]) -> FigureGroup:
    """Return the group with the figures of the last step of the command."""
    run = rig.run(excited_by)
    return FigureGroup(label, displayed(motion_figures(run, -1)), headline, data=run)


def frequency(rig: Rig) -> Outcome:
    """Measure bandwidths with sines, and the response to logarithmic sweeps by the H1 estimate of Welch's method."""
    groups, notes = {}, []
    lowest, highest = BANDWIDTHS
    low, high = SWEPT
    for name, amplitude in (("1deg", 1.0), ("3p5deg", 3.5)):
        response = sweep_response(rig.run(sweep(radians(amplitude), 12.0)))
        measured = sweep_figures(response, rig.subject, radians(amplitude), {})
        if measured["bandwidth_3db"] <= lowest:
            notes.append(f"At {amplitude:g} deg the gain is below -3 dB already at {lowest:g} Hz.")
        elif isnan(measured["bandwidth_3db"]):
            notes.append(f"At {amplitude:g} deg there is no bandwidth: the fin angle is not a sine of the command's "
                         "frequency.")
        groups[name] = FigureGroup(
            f"{amplitude:g} deg", displayed(measured), FREQUENCY[:2],
            {"frequency_hz": response.frequency, "gain_db": response.gain_db, "phase_deg": np.degrees(response.phase),
             "coherence": response.coherence}, response,
            {f"{name}_hz": bound(measured[name]) for name in TESTS["sine"].figures})
    return Outcome(
        "The describing function: the fundamental of the fin angle over that of the command, by amplitude. Bandwidths "
        "are measured with sines about 0 deg without load, by bisection of the frequency between "
        f"{lowest:g} and {highest:g} Hz. Curves, largest gain and coherence are from a logarithmic sine sweep of "
        f"{SWEEP[0]:g} to {SWEEP[1]:g} Hz in 12 s: H1 estimate by Welch's method, Hann segments of 1 s, evaluated from "
        f"{low:g} to {high:g} Hz. Coherence is below 1 where the response is not linear, or changes within a segment.",
        groups, tuple(notes))


def slews(rig: Rig) -> Outcome:
    """Measure slews from one end of the range to the other: unloaded, against the rated load and with it."""
    loads = (("unloaded", "unloaded", 0.0, _SLEW), ("opposing", f"against {rig.load:g} N.m", -rig.load, _SLEW),
             ("aiding", f"with {rig.load:g} N.m", rig.load, ()))
    return Outcome(
        f"Slews from -{rig.limit:g} to +{rig.limit:g} deg, and in other runs back, after {SETTLE:g} s at the starting "
        f"end without load. The load rises within {LOAD_RISE * 1e3:g} ms after the command and is then constant: "
        "against the motion (opposing) or with it (aiding).",
        {f"{load}_{direction}": _group(rig, f"{label}, {direction}", excitation(
            Test("slew", radians(rig.limit), DURATION, torque), sign, rig.subject), headline)
         for load, label, torque, headline in loads for direction, sign in (("positive", 1.0), ("negative", -1.0))})
