"""Responses to the command: steps of several sizes, sweeps at two amplitudes, slews over the full travel."""

from __future__ import annotations

from math import isfinite, isnan, radians

import numpy as np

from ...bench.excitation import HOLD, SETTLE, step_to, sweep
from ...bench.frequency_response import SWEPT, sweep_response
from ...bench.measure import BANDWIDTHS, Test, excitation, sweep_figures
from ...bench.metrics import motion, since
from ...reference.cases import LOAD_RISE, SWEEP
from .outcome import Outcome, displayed, quantity
from .rig import Rig

SIZES = (1.0, 5.0, 10.0)  # deg of a step, and the end of the range
DURATION = 1.0  # s from the command to the other end

STEP = (
    quantity("rise_time", "rise time"), quantity("settling_time", "settling time"),
    quantity("overshoot", "overshoot"), quantity("steady_error", "steady error"),
)
_BANDWIDTHS = ("bandwidth_3db", "bandwidth_90deg")
FREQUENCY = (
    quantity("bandwidth_3db", "-3 dB"), quantity("bandwidth_90deg", "-90 deg"),
    quantity("peak_gain", "largest gain"), quantity("lowest_coherence", "least coherence"),
)
SLEW = (
    quantity("sustained_rate", "sustained rate"), quantity("peak_rate", "peak rate"),
    quantity("time_to_90_percent", "time to 90 %"),
)


def steps(rig: Rig) -> Outcome:
    """Measure steps from rest at zero to each size, both signs, no load."""
    figures, series, labels = {}, {}, {}
    sizes = rig.sizes(SIZES)
    for size in (sign * size for size in sizes for sign in (1.0, -1.0)):
        run, group = rig.run(step_to(radians(size), HOLD)), _step_group(size)
        labels[group] = f"{size:+g} deg"
        figures[group] = displayed(motion(run), STEP)
        series[group] = {"time_s": run.columns["time"] - run.excitation.begin,
                         "angle_deg": np.degrees(run.columns["fin_angle"]), "command_deg": np.array([size])}
    first, largest = _step_group(1.0), _step_group(sizes[-1])
    return Outcome(
        f"From rest at 0 deg the command jumps to each size and stays there for {HOLD:g} s; no load. Outputs are "
        "read every 1 ms.", STEP, figures,
        (f"{first}.rise_time_s", f"{first}.settling_time_s", f"{largest}.rise_time_s", f"{largest}.settling_time_s",
         f"{largest}.overshoot_percent"), labels, series=series)


def _step_group(size: float) -> str:
    return f"{'plus' if size > 0.0 else 'minus'}_{abs(size):g}deg".replace(".", "p")


def frequency(rig: Rig) -> Outcome:
    """Measure bandwidths under sines, and the response to logarithmic sweeps, H1 estimate by Welch's method."""
    figures, curves, notes, labels = {}, {}, [], {"1deg": "1 deg", "3p5deg": "3.5 deg"}
    beyond: dict[str, float] = {}
    lowest, highest = BANDWIDTHS
    for (group, label), amplitude in zip(labels.items(), (1.0, 3.5), strict=True):
        run = rig.run(sweep(radians(amplitude), 12.0))
        response = sweep_response(run)
        found = sweep_figures(response, rig.subject, radians(amplitude), {})
        at, lag = (found[name] for name in _BANDWIDTHS)
        if at <= lowest:
            notes.append(f"At {label} the gain is below -3 dB from {lowest:g} Hz on.")
        elif isnan(at):
            notes.append(f"At {label} there is no bandwidth: what comes out is no sine of the command's frequency.")
        figures[group] = displayed(found, FREQUENCY)
        beyond |= {f"{group}.{name}_hz": highest for name, each in zip(_BANDWIDTHS, (at, lag), strict=True)
                   if isfinite(each) and each >= highest}
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
        labels, curves, notes=tuple(notes), beyond=beyond)


def slews(rig: Rig) -> Outcome:
    """Measure slews from one end of the range to the other: unloaded, against and with the rated load."""
    figures, series, labels = {}, {}, {}
    for load, factor, label in (("unloaded", 0.0, "unloaded"), ("opposing", -1.0, f"against {rig.load:g} N.m"),
                                ("aiding", 1.0, f"with {rig.load:g} N.m")):
        for direction, sign in (("positive", 1.0), ("negative", -1.0)):
            slew = excitation(Test("slew", radians(rig.limit), DURATION, factor * rig.load), sign, rig.subject)
            run, group = rig.run(slew), f"{load}_{direction}"
            labels[group] = f"{label}, {direction}"
            figures[group] = displayed(motion(run, -1), SLEW)
            names = [name for name in ("fin_angle", "fin_rate", "motor_current") if name in run.columns]
            time, *columns = since(slew.begin, run.columns["time"], *(run.columns[name] for name in names))
            series[group] = {"time_s": time - slew.begin, **{
                name: column if name == "motor_current" else np.degrees(column)
                for name, column in zip(names, columns, strict=True)}}
    return Outcome(
        f"From -{rig.limit:g} to +{rig.limit:g} deg and back the other way, after {SETTLE:g} s at the starting end "
        f"without load. The load comes on within {LOAD_RISE * 1e3:g} ms of the command and stays: against the motion "
        "(opposing) or with it (aiding).", SLEW, figures,
        tuple(f"{group}.sustained_rate_deg_per_s" for group in figures if not group.startswith("aiding")), labels,
        series=series)
