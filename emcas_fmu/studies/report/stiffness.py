"""Dynamic stiffness: hinge moment over fin angle, powered and unpowered, and the breakaway moment."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, nan

import numpy as np

from ...bench.excitation import LOAD, Excitation, load_ramp, sine
from ...bench.frequency_response import fundamental, held
from ...bench.metrics import breakaway
from ...motions import STEP
from .outcome import Array, Outcome, Quantity, Rig, Value

FREQUENCIES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)  # Hz
CYCLES, SETTLE = 6.0, (4.0, 0.5)  # cycles fitted; cycles, and at least s, before them
RAMP = 5.0  # s in which the breakaway ramp reaches the rated load
BELOW, ABOVE = 0.8, 2.0  # unpowered load amplitudes, of the smaller and larger breakaway moment
LOCKED = 1e-8  # rad peak to peak, up to which the fin counts as friction-locked

_MARKS = {f"stiffness_{frequency:g}hz_n_m_per_rad": frequency for frequency in (1.0, 10.0, 20.0)}
QUANTITIES = (
    Quantity("load_amplitude_n_m", "load amplitude", "of the sinusoidal hinge moment"),
    Quantity("friction_locked", "friction-locked", "whether the fin stood still, to 1e-8 rad, at every frequency"),
    Quantity("least_stiffness_n_m_per_rad", "least |T/θ|", "least magnitude of load over angle of the fundamentals"),
    Quantity("least_stiffness_at_hz", "at", "frequency of the least |T/θ|"),
    *(Quantity(key, f"|T/θ| at {frequency:g} Hz", "magnitude of load over angle of the fundamentals")
      for key, frequency in _MARKS.items()),
    Quantity("positive_n_m", "positive", "hinge moment, ramped from zero in the positive direction, at which the fin "
             "first moves"),
    Quantity("negative_n_m", "negative", "hinge moment, ramped from zero in the negative direction, at which the fin "
             "first moves; its magnitude"),
)


@dataclass(frozen=True)
class Sweep:
    """Stiffness T/θ [N.m/rad], complex, at frequencies [Hz]; nan where the fin stood still or met a stop."""

    frequency: Array
    stiffness: Array
    locked: bool
    stopped_at: tuple[float, ...]


def sweep(rig: Rig, amplitude: float, enable: bool) -> Sweep:
    """Return the stiffness under sines of the hinge moment about 0 deg, each frequency in a run of its own."""
    stiffness, still, stops = [], [], []
    for frequency in FREQUENCIES:
        wave = sine(amplitude, frequency, CYCLES, SETTLE, LOAD)
        run = rig.run(wave if enable else _unpowered(wave)).columns
        time, angle = (run[name][wave.judged(run["time"])] for name in ("time", "fin_angle"))
        still.append(bool(np.ptp(angle) <= LOCKED))
        if stopped := bool(np.any(run["at_stop"] > 0.5)):
            stops.append(frequency)
        stiffness.append(complex(nan, nan) if still[-1] or stopped else
                         held(amplitude, frequency, STEP) / fundamental(time, angle, frequency))
    return Sweep(np.array(FREQUENCIES), np.array(stiffness), all(still), tuple(stops))


def measure(rig: Rig) -> Outcome:
    """Measure the breakaway moment; then the stiffness powered, and unpowered below and above breakaway."""
    figures: dict[str, dict[str, Value]] = {}
    loads, notes, curves = [("powered", 0.5 * rig.load, True)], [], {}
    if "enable" in rig.subject.inputs:
        lowest, highest = sorted(broke := [_breakaway(rig, sign) for sign in (1.0, -1.0)])
        figures["breakaway"] = dict(zip(("positive_n_m", "negative_n_m"), broke, strict=True))
        if np.isnan(broke).any():
            loads.append(("unpowered_below_breakaway", rig.load, False))
            notes.append(f"Unpowered, the rated load of {rig.load:g} N.m does not move the fin in both directions: "
                         "there is no unpowered stiffness above breakaway.")
        else:
            # Below a thousandth of the rated load, friction is too small for a load below breakaway to be informative.
            if lowest > 1e-3 * rig.load:
                loads.append(("unpowered_below_breakaway", BELOW * lowest, False))
            loads.append(("unpowered_above_breakaway", max(ABOVE * highest, 0.01 * rig.load), False))
    else:
        notes.append("Unpowered: not applicable, this actuator has no enable.")
    for group, amplitude, enable in loads:
        response, load = sweep(rig, amplitude, enable), f"{_LABELS[group]}, {amplitude:.3g} N.m"
        size = np.abs(response.stiffness)
        figures[group] = {"load_amplitude_n_m": amplitude, "friction_locked": response.locked}
        moved = ~np.isnan(size)
        if moved.any():
            least = int(np.nanargmin(size))
            figures[group] |= {"least_stiffness_n_m_per_rad": float(size[least]),
                               "least_stiffness_at_hz": float(response.frequency[least])}
            figures[group] |= {key: float(size[response.frequency == at][0]) for key, at in _MARKS.items()}
            curves[group] = {"frequency_hz": response.frequency[moved], "stiffness_n_m_per_rad": size[moved],
                             "phase_deg": np.degrees(np.angle(response.stiffness[moved]))}
        if response.locked:
            notes.append(f"{load}: friction-locked. The fin stands still at every frequency; where the drive line is "
                         "rigid, its stiffness is then infinite.")
        if response.stopped_at:
            notes.append(f"{load}: the fin meets a mechanical stop at "
                         f"{', '.join(f'{f:g}' for f in response.stopped_at)} Hz, which are left out.")
    angle = rig.subject.values.get("fin.stop_angle")
    stop = "" if angle is None else f" at ±{degrees(angle):g} deg"
    return Outcome(
        f"Sinusoidal hinge moment at {len(FREQUENCIES)} frequencies from {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} Hz "
        f"(stepped-sine sweep), command 0 deg; T/θ is the ratio of the fundamentals over {CYCLES:g} cycles, "
        f"by least squares after at least {SETTLE[0]:g} cycles. Powered: the loops hold 0 deg against half "
        "the rated load. Unpowered: enable is false. Breakaway: unpowered, the moment is ramped from zero to the "
        f"rated load in {RAMP:g} s, which reads it high by less than 0.1 % of that load. Where the fin meets its "
        f"stops{stop} the frequency is left out.",
        QUANTITIES, figures,
        ("powered.least_stiffness_n_m_per_rad", "powered.stiffness_10hz_n_m_per_rad", "breakaway.positive_n_m",
         "breakaway.negative_n_m", "unpowered_above_breakaway.stiffness_10hz_n_m_per_rad"),
        _LABELS, curves, notes=tuple(notes))


_LABELS = {"breakaway": "Breakaway moment, unpowered", "powered": "Powered",
           "unpowered_below_breakaway": "Unpowered, below breakaway",
           "unpowered_above_breakaway": "Unpowered, above breakaway"}


def _breakaway(rig: Rig, sign: float) -> float:
    ramp = load_ramp(sign * rig.load, RAMP)
    return breakaway(ramp.columns[LOAD], rig.run(_unpowered(ramp)).columns["fin_angle"])


def _unpowered(excitation: Excitation) -> Excitation:
    return excitation.holding({"enable": False})
