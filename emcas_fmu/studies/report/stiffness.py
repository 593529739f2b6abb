"""Dynamic stiffness: hinge moment over fin angle, powered and unpowered, and the breakaway moment."""

from __future__ import annotations

from math import degrees, isnan, nan, radians

import numpy as np

from ...bench.excitation import LOAD, Excitation, load_ramp, times
from ...bench.frequency_response import Sines, held
from ...bench.measure import Test, obstacle
from ...bench.metrics import CREPT, breakaway
from ...motions import STEP
from ...parameters import Scalar
from ...simulation import Array
from .accuracy import smallest
from .outcome import FigureGroup, Outcome, Quantity, Rig

FREQUENCIES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0)  # Hz
CYCLES = 6.0  # fitted cycles of a sine
SETTLE = (4.0, 0.5)  # before the fitted cycles: cycles, and at least this time [s]
RAMP = 5.0  # s, in which the breakaway ramp reaches the rated load
HELD, WITHIN = 2.0, 1.02  # s, duration of a trial moment; ratio of two trial moments at which bisection ends
LEFT, MOVING = 1.0, 1e-5  # deg and rad: a fin that moves more, in all or in the last quarter of a trial, broke away
BELOW, ABOVE = 0.8, 2.0  # unpowered load amplitudes, relative to the smaller and to the larger breakaway moment
_UNPOWERED = {"enable": False}

_SIZE = "magnitude of the ratio of the fundamentals of hinge moment and fin angle"
_MARKS = {frequency: Quantity(f"stiffness_{frequency:g}hz_n_m_per_rad", _SIZE, f"|T/θ| at {frequency:g} Hz")
          for frequency in (1.0, 10.0, 20.0)}
_LEAST = Quantity("least_stiffness_n_m_per_rad", f"lowest {_SIZE}", "lowest |T/θ|")
_SIDES = tuple(
    Quantity(f"{side}_n_m", f"smallest hinge moment in the {side} direction under which the fin moves on"
             + "; its magnitude" * (side == "negative"), side)
    for side in ("positive", "negative"))
QUANTITIES = (
    Quantity("load_amplitude_n_m", "amplitude of the sinusoidal hinge moment", "load amplitude"),
    Quantity("friction_locked", "whether the fin moved by at most 1e-8 rad, peak to peak, at every frequency",
             "friction-locked"),
    _LEAST, Quantity("least_stiffness_at_hz", "frequency of the lowest |T/θ|", "lowest |T/θ| at"), *_MARKS.values(),
    *_SIDES)


def sweep(rig: Rig, amplitude: float, powered: bool) -> tuple[Array, bool, list[float]]:
    """Return the complex stiffness T/θ [N.m/rad] at FREQUENCIES, whether the fin is locked, and where it met stops.

    The hinge moment is a sine of `amplitude` [N.m], with a run for each frequency. The stiffness is nan where the fin
    did not move or met a stop. The fin is locked if it moved at no frequency. Stops are frequencies [Hz].
    """
    stiffness, locked, stops = [], True, []
    for frequency in FREQUENCIES:
        sines = Sines(np.array([frequency]), SETTLE, (CYCLES, 0.0), drift=True)
        wave = sines.excitation(amplitude, LOAD).of(0)
        run = rig.run(wave if powered else wave.holding(_UNPOWERED)).columns
        angle = run["fin_angle"][np.newaxis]
        (fundamental,) = sines.fit(angle)
        moved, stopped = bool(np.ptp(sines.rows(angle)) > CREPT), bool(np.any(run["at_stop"] > 0.5))
        locked &= not moved
        stops += [frequency] * stopped
        stiffness.append(held(amplitude, frequency, STEP) / fundamental
                         if moved and not stopped else complex(nan, nan))
    return np.array(stiffness), locked, stops


def _breakaway(rig: Rig, sign: float) -> float:
    """Return the smallest hinge moment [N.m] under which the unpowered fin moves on, in a direction (1, -1).

    It is the moment at which the fin first moves in a ramp, or a larger one, found by bisection, if the fin only yields
    there: by twist, in a gap, or on the bristles of a friction model. It is nan if the rated load does not suffice.
    """
    ramp, left = load_ramp(sign * rig.load, RAMP), radians(min(LEFT, 0.5 * rig.limit))
    first = breakaway(ramp.columns[LOAD], rig.run(ramp.holding(_UNPOWERED)).columns["fin_angle"])

    def moves_on(moment: float) -> bool:
        rising = np.minimum(2.0 * times(HELD) / HELD, 1.0)
        angle = rig.run(Excitation("hold", {LOAD: sign * moment * rising}).holding(_UNPOWERED)).columns["fin_angle"]
        return bool(abs(angle[-1] - angle[0]) > left or np.ptp(angle[-len(angle) // 4:]) > MOVING)

    return first if isnan(first) or moves_on(min(WITHIN * first, rig.load)) else smallest(
        moves_on, first, rig.load, WITHIN)


def measure(rig: Rig) -> Outcome:
    """Measure the breakaway moment, then the stiffness: powered, and unpowered below and above breakaway."""
    groups, notes = dict[str, FigureGroup](), list[str]()
    if why := obstacle(Test("load", torque=rig.load), "peak_angle", rig.subject):
        return Outcome("Not measured.", not_applicable={q.key: why for q in QUANTITIES})
    loads: dict[str, tuple[str, float, tuple[Quantity, ...]]] = {
        "powered": ("Powered", 0.5 * rig.load, (_LEAST, _MARKS[10.0]))}
    if "enable" in rig.subject.inputs:
        broke = [_breakaway(rig, sign) for sign in (1.0, -1.0)]
        groups["breakaway"] = FigureGroup("Breakaway moment, unpowered",
                                          {q.key: moment for q, moment in zip(_SIDES, broke, strict=True)}, _SIDES)
        if stays := bool(np.isnan(broke).any()):
            notes.append(f"Unpowered, the fin does not move on under the rated load of {rig.load:g} N.m in at least "
                         "one direction: there is no unpowered stiffness above breakaway.")
        # A breakaway moment below a thousandth of the rated load is too small for a test below it.
        if stays or min(broke) > 1e-3 * rig.load:
            loads["unpowered_below_breakaway"] = (
                "Unpowered, below breakaway", rig.load if stays else BELOW * min(broke), ())
        if not stays:
            loads["unpowered_above_breakaway"] = (
                "Unpowered, above breakaway", max(ABOVE * max(broke), 0.01 * rig.load), (_MARKS[10.0],))
    else:
        notes.append("Unpowered: not applicable, this actuator has no input enable.")
    at = np.array(FREQUENCIES)
    for name, (label, amplitude, headline) in loads.items():
        stiffness, locked, stops = sweep(rig, amplitude, name == "powered")
        size = np.abs(stiffness)
        moved, curve = ~np.isnan(size), dict[str, Array]()
        figures: dict[str, Scalar] = {"load_amplitude_n_m": amplitude, "friction_locked": locked}
        if moved.any():
            least = int(np.nanargmin(size))
            figures |= {_LEAST.key: float(size[least]), "least_stiffness_at_hz": float(at[least])}
            figures |= {q.key: float(size[at == frequency][0]) for frequency, q in _MARKS.items()}
            curve = {"frequency_hz": at[moved], "stiffness_n_m_per_rad": size[moved],
                     "phase_deg": np.degrees(np.angle(stiffness[moved]))}
        groups[name] = FigureGroup(label, figures, headline, curve)
        if locked:
            notes.append(f"{label}, {amplitude:.3g} N.m: friction-locked. The fin does not move at any frequency.")
        if stops:
            notes.append(f"{label}, {amplitude:.3g} N.m: the fin meets a mechanical stop at "
                         f"{', '.join(f'{f:g}' for f in stops)} Hz.")
    angle = rig.subject.values.get("fin.stop_angle")
    stop = "" if angle is None else f" at ±{degrees(angle):g} deg"
    return Outcome(
        f"Sinusoidal hinge moment T at {len(FREQUENCIES)} frequencies from {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} "
        "Hz (stepped-sine sweep), command 0 deg. T/θ is the ratio of the fundamentals of moment and fin angle over "
        f"{CYCLES:g} cycles, by least squares after at least {SETTLE[0]:g} cycles. Powered: the loops hold 0 deg "
        "against half the rated load. Unpowered: enable is false. Breakaway: unpowered, the moment rises from zero to "
        f"the rated load in {RAMP:g} s; the moment of the first motion is high by less than 0.1 % of that load. If the "
        f"fin then comes to rest under a constant moment, larger ones are tried, within {100.0 * (WITHIN - 1.0):.0f} "
        f"%. Frequencies at which the fin meets its stops{stop} are left out.", groups, tuple(notes))
