"""The figures of responses, each defined once: pure functions of uniformly sampled columns, SI throughout.

A column is an array [rows], or of many runs [runs, rows]; a figure then is a number, or an array [runs]. What it is of
one run does not depend on the others: rows are contiguous, and reduced one by one.
Angles in rad, rates in rad/s, times in s, frequencies in Hz, shares as numbers; `shown` gives what people read.
FIGURES names them all, with their units and the standard or book a definition follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, inf, isfinite, nan, pi, radians
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..variables import Variable
    from .runs import Run

Array = NDArray[np.floating[Any]]

ACCURACY = radians(0.2)  # Yerlikaya (2016), Table 2
SWEPT = (0.5, 24.0)  # Hz; above, a sweep to 30 Hz ends within half a segment of the estimate
HELD = 1.0 / 3.0  # share of a hold, its end, over which every figure of what is held is taken
PURE = 0.9  # least share of a sine's response that its fundamental has: a triangle has 0.986, a square 0.81
CREPT = 1e-8  # rad that count as motion

# Hann segments of the frequency response. A second is thirty times the actuator's memory, so that cutting a
# response off at a segment's end matters little, and short enough that a sweep's harmonics, which come at
# other times than the same frequency in the command, fall into other segments.
SEGMENT = 1.0  # s
OVERLAP = 15.0 / 16.0
# Share of the strongest input power below which a frequency counts as not excited.
EXCITED = 1e-2


@dataclass(frozen=True)
class Figure:
    """A figure's unit (SI, dB, or none of a plain number), what it is and the outputs it `needs`.

    `bad` is the side on which it is bad: 1 above, -1 below.
    """

    unit: str
    title: str
    needs: tuple[str, ...] = ("fin_angle",)
    bad: float = 1.0


FIGURES: Mapping[str, Figure] = {
    "rise_time": Figure("s", "first time from 10 to 90 % of the commanded change"),
    "settling_time": Figure("s", "until within 2 % of the change around the command for good"),
    "time_to_accuracy": Figure("s", f"until within {degrees(ACCURACY):g} deg of the command for good"),
    "time_to_90_percent": Figure("s", "until 90 % of the commanded change is covered"),
    "overshoot": Figure("1", "beyond the command, share of the change"),
    "steady_error": Figure("rad", "mean distance from the command over the last third of the hold"),
    "held_error": Figure("rad", "largest distance from the command over the last third of the hold"),
    "held_angle": Figure("rad", "smallest magnitude of the angle over the last third of the hold", bad=-1.0),
    "ripple": Figure("rad", "peak to peak of the angle over the last third of the hold"),
    "rebound": Figure("rad", "largest angle beyond the command against a load that went"),
    "current_ripple": Figure("A", "motor current about its mean, root mean square over the last third of the hold",
                             ("motor_current",)),
    "repeat_error": Figure("rad", "largest difference of the response after a history of use from a fresh unit's"),
    "sustained_rate": Figure("rad/s", "mean over the middle 60 % of the travel", bad=-1.0),
    "rate_asymmetry": Figure("1", "difference of the sustained rates of both directions, share of the larger"),
    "peak_rate": Figure("rad/s", "largest magnitude of the fin rate", ("fin_rate",), -1.0),
    "peak_angle": Figure("rad", "largest magnitude of the fin angle"),
    "bandwidth_3db": Figure("Hz", "lowest frequency where the fundamental is 3 dB down", bad=-1.0),
    "bandwidth_90deg": Figure("Hz", "lowest frequency where the fundamental lags 90 deg", bad=-1.0),
    "gain_margin": Figure("dB", "of the loop broken at the drive's reference", (), -1.0),
    "phase_margin": Figure("rad", "of the loop broken at the drive's reference", (), -1.0),
    "delay_margin": Figure("s", "further delay of the loop broken at the drive's reference", (), -1.0),
    "peak_gain": Figure("dB", "largest gain of the fundamental within the frequencies looked at"),
    "lowest_coherence": Figure("", "least ordinary coherence up to the -3 dB frequency", bad=-1.0),
    "peak_tracking_error": Figure("rad", "largest distance from the clipped command", ("tracking_error",)),
    "rms_tracking_error": Figure("rad", "distance from the clipped command, root mean square", ("tracking_error",)),
    "peak_current": Figure("A", "largest magnitude of the motor current", ("motor_current",)),
    "rms_current": Figure("A", "motor current, root mean square", ("motor_current",)),
    "peak_power": Figure("W", "largest power drawn", ("supply_power",)),
    "peak_returned_power": Figure("W", "largest power fed back", ("supply_power",)),
    "rms_power": Figure("W", "power, root mean square", ("supply_power",)),
    "net_energy": Figure("J", "energy drawn less regenerated", ("supply_power",)),
    "energy_drawn": Figure("J", "integral of the power drawn", ("supply_power",)),
    "energy_returned": Figure("J", "integral of the power fed back", ("supply_power",)),
    "saturated_share": Figure("1", "share of the time a limit is active", ("saturated",)),
    "at_stop_share": Figure("1", "share of the time against a mechanical stop", ("at_stop",)),
}
_SHOWN = {"rad": ("deg", degrees(1.0)), "rad/s": ("deg/s", degrees(1.0)), "s": ("ms", 1e3), "1": ("%", 100.0),
          "Pa": ("MPa", 1e-6), "m3/s": ("l/min", 6e4)}


def shown(unit: str) -> tuple[str, float]:
    """Return the unit people read a figure in, and the factor to it."""
    return _SHOWN.get(unit, (unit, 1.0))


def shown_output(v: Variable) -> tuple[str, float]:
    """Return the unit people read an output in, and the factor to it."""
    return ("rpm", 30.0 / pi) if v.display == "rpm" else shown(v.unit)


# Ending of the name of a figure in a result, and the unit it is in; the longer endings first.
_ENDINGS = {"_n_m_per_rad": "N.m/rad", "_deg_per_s": "deg/s", "_l_per_min": "l/min", "_percent": "%",
            "_n_m": "N.m", "_deg": "deg", "_mpa": "MPa", "_hz": "Hz", "_db": "dB", "_s": "s", "_v": "V", "_a": "A",
            "_w": "W", "_j": "J"}


def unit_of(key: str) -> str:
    """Return the unit that the name of a figure in a result ends in; 1 for a pure number."""
    return next((unit for ending, unit in _ENDINGS.items() if key.endswith(ending)), "1")


def in_words(key: str) -> str:
    """Return the name of a figure in a result for people, without its unit."""
    return key.removesuffix(next((ending for ending in _ENDINGS if key.endswith(ending)), "")).replace("_", " ")


def result_name(name: str) -> tuple[str, float]:
    """Return the name of a figure in a result, which ends in its unit, and the factor to that; a time is in s."""
    return named(name, FIGURES[name].unit)


def named(name: str, of_unit: str) -> tuple[str, float]:
    """Return the same for a figure that is in a unit."""
    unit, factor = ("s", 1.0) if of_unit == "s" else shown(of_unit)
    return name + next((ending for ending, of in _ENDINGS.items() if of == unit), ""), factor


def displayed(figures: Mapping[str, float]) -> dict[str, float]:
    """Return figures of one run as plain numbers by their names in a result, in the units of these."""
    return {key: float(value) * factor for name, value in figures.items() for key, factor in [result_name(name)]}


@dataclass(frozen=True)
class Errors:
    """Largest magnitude and root mean square of response - reference, in the variable's `unit`."""

    maximum: float
    rms: float
    unit: str


def errors(response: Array, reference: Array, unit: str = "1") -> Errors:
    """Return the errors of a response to a reference at the same times; nan where either is, or there is none."""
    difference = np.asarray(response, dtype=float) - reference
    largest, mean = (float(np.max(np.abs(difference))), rms(difference)) if len(difference) else (nan, nan)
    return Errors(largest, mean, unit)


def rms(values: Array) -> Any:
    """Return the root mean square."""
    return np.sqrt(np.mean(np.square(values), axis=-1))


def _at(values: NDArray[Any], row: Any) -> Any:
    """Return the values at a row, of many runs each at its own."""
    return np.take_along_axis(values, row[..., np.newaxis], -1)[..., 0]


def crossing(time: Array, values: Array, level: float) -> Any:
    """Return the first time [s] `values` reach `level` from below, by linear interpolation; nan if never."""
    above = values >= level
    k = np.argmax(above, axis=-1)
    before = np.maximum(k - 1, 0)
    low, high = _at(values, before), _at(values, k)
    with np.errstate(divide="ignore", invalid="ignore"):  # at the first row there is none before
        between = time[before] + (level - low) / (high - low) * (time[k] - time[before])
    return np.where(_at(above, k), np.where(k == 0, time[0], between), nan)[()]


def settling(time: Array, distance: Array, band: float) -> Any:
    """Return the time [s] from the first row on after which `distance` stays within `band` for good.

    By linear interpolation; 0 where it is never outside, inf where it is not within it at the end.
    """
    outside = ~(distance <= band)
    last = len(time) - 1
    k = last - np.argmax(outside[..., ::-1], axis=-1)
    after = np.minimum(k + 1, last)
    here = _at(distance, k)
    with np.errstate(divide="ignore", invalid="ignore"):  # at the last row there is none after
        inside = (here - band) / (here - _at(distance, after))
        within = time[k] - time[0] + inside * (time[after] - time[k])
    return np.where(_at(outside, k), np.where(k == last, inf, within), 0.0)[()]


def settled(time: Array, distance: Array, band: float) -> Any:
    """Return `settling`, inf where it is later than where the last third begins: too little is left to call it so."""
    after = settling(time, distance, band)
    return np.where(after > (1.0 - HELD) * (time[-1] - time[0]), inf, after)[()]


def since(start: float, time: Array, *columns: Array) -> tuple[Array, ...]:
    """Return time and columns from `start` [s] on."""
    # Communication times carry rounding: a nanosecond early is on time.
    begin = int(np.searchsorted(time, start - 1e-9))
    return (time[begin:], *(column[..., begin:] for column in columns))


RESTING = ("rebound", "time_to_accuracy", "steady_error", "held_error", "held_angle", "ripple", "current_ripple")
"""The figures of `rest`."""
MOTION = ("rise_time", "settling_time", "time_to_accuracy", "time_to_90_percent", "overshoot", "steady_error",
          "held_error", "held_angle", "ripple", "current_ripple", "peak_rate", "sustained_rate")
"""The figures of `motion`."""


def step_metrics(time: Array, response: Array, start: float, command: Any) -> dict[str, Any]:
    """Return the figures of the response [rad] to a command that jumps to a level at `start` [s] and stays there.

    `steady_error` is signed; nan where a level is never reached, inf for a time that does not end within the record.

    All levels refer to the commanded change, from the response at `start`, and not to the value the
    response ends at: a servo is judged by where it is commanded to go. Otherwise as in Ogata,
    "Modern Control Engineering", 5th ed., section 5-3. `time_to_accuracy` is settling within ACCURACY.
    """
    time, response = since(start, time, response)
    level = np.asarray(command)[..., np.newaxis]
    share = (response - response[..., :1]) / (level - response[..., :1])
    tenth, most = (crossing(time, share, reached) for reached in (0.1, 0.9))
    return {"rise_time": most - tenth, "settling_time": settled(time, np.abs(share - 1.0), 0.02),
            "time_to_90_percent": most - start, "overshoot": np.maximum(np.max(share, axis=-1) - 1.0, 0.0),
            **hold_figures(time, response, command)}


def hold_figures(time: Array, response: Array, command: Any) -> dict[str, Any]:
    """Return the figures of a response [rad] to a command [rad] that is constant over these times [s]."""
    error = response - np.asarray(command)[..., np.newaxis]
    last = _last(time)
    return {"time_to_accuracy": settled(time, np.abs(error), ACCURACY),
            "steady_error": np.mean(error[..., last], axis=-1), "held_error": np.max(np.abs(error[..., last]), axis=-1),
            "held_angle": np.min(np.abs(response[..., last]), axis=-1), "ripple": np.ptp(response[..., last], axis=-1)}


def _last(time: Array) -> slice:
    """Return the rows of the last third of a hold."""
    return slice(int(np.searchsorted(time, time[-1] - HELD * (time[-1] - time[0]) - 1e-9)), None)


def sustained_rate(time: Array, angle: Array, start: float, command: Any) -> Any:
    """Return the mean rate [rad/s] over the middle 60 % of a motion commanded at `start` [s]; nan if it falls short.

    The middle of the travel leaves out the run-up and the braking, and a mean does not reward a
    spike: this, and not the largest rate, is what a guidance loop can count on.
    """
    time, angle = since(start, time, angle)
    first = angle[..., :1]
    travel = command - angle[..., 0]
    share = (angle - first) / travel[..., np.newaxis]
    return np.abs(travel) * 0.6 / (crossing(time, share, 0.8) - crossing(time, share, 0.2))


def motion(run: Run, number: int = 0) -> dict[str, Any]:
    """Return the figures of the nth jump of the command of a finished run, judged until the next."""
    move, columns = run.excitation.moves[number], run.columns
    upto = int(np.searchsorted(columns["time"], move.end + 1e-9, side="right"))
    of_move = {name: column[..., :upto] for name, column in columns.items()}
    time, angle = of_move["time"], of_move["fin_angle"]
    return {**step_metrics(time, angle, move.start, move.level), **_current_ripple(of_move, move.start),
            "peak_rate": np.max(np.abs(since(move.start, time, of_move["fin_rate"])[1]), axis=-1),
            "sustained_rate": sustained_rate(time, angle, move.start, move.level)}


def rest(run: Run) -> dict[str, Any]:
    """Return the figures RESTING of a finished run whose command is 0 and that is moved by a hinge moment."""
    load = run.excitation.columns["aero_torque"]
    time, angle = since(run.excitation.begin, run.columns["time"], run.columns["fin_angle"])
    against = -np.sign(np.sum(load, axis=-1, keepdims=True)) * angle
    return {**hold_figures(time, angle, 0.0), **_current_ripple(run.columns, run.excitation.begin),
            "rebound": np.max(against, axis=-1, initial=0.0)}


def _current_ripple(columns: Mapping[str, Array], start: float) -> dict[str, Any]:
    if "motor_current" not in columns:
        return {}
    time, current = since(start, columns["time"], columns["motor_current"])
    return {"current_ripple": np.std(current[..., _last(time)], axis=-1)}


def usage(run: Run) -> dict[str, Any]:
    """Return what any run has, from the excitation's beginning on, as far as the outputs it needs were recorded."""
    at = dict(zip(run.columns, since(run.excitation.begin, *run.columns.values()), strict=True))
    reductions: Mapping[str, Callable[[Array], Any]] = {
        "peak": lambda column: np.max(np.abs(column), axis=-1), "rms": rms,
        "share": lambda column: np.mean(column > 0.5, axis=-1)}
    figures = {name: reductions[reduction](at[output]) for name, (reduction, output) in REDUCED.items() if output in at}
    if "supply_power" in at:
        power = at["supply_power"]
        drawn, returned = energies(at["time"], power)
        figures |= {"peak_power": np.max(power, axis=-1, initial=0.0), "energy_drawn": drawn,
                    "energy_returned": returned, "peak_returned_power": np.max(0.0 - power, axis=-1, initial=0.0)}
    return figures


REDUCED: Mapping[str, tuple[str, str]] = {
    "peak_angle": ("peak", "fin_angle"), "peak_rate": ("peak", "fin_rate"), "peak_current": ("peak", "motor_current"),
    "peak_tracking_error": ("peak", "tracking_error"), "rms_current": ("rms", "motor_current"),
    "rms_tracking_error": ("rms", "tracking_error"), "saturated_share": ("share", "saturated"),
    "at_stop_share": ("share", "at_stop")}
USAGE = (*REDUCED, "peak_power", "energy_drawn", "energy_returned", "peak_returned_power")
"""The figures of `usage`."""


def energies(time: Array, power: Array) -> tuple[Any, Any]:
    """Return the energy [J] drawn and, as a magnitude, fed back, by the trapezoidal rule."""
    return np.trapezoid(np.maximum(power, 0.0), time), np.trapezoid(np.maximum(-power, 0.0), time)


def leap_weights(count: int, step: float, leaps: Array) -> Array:
    """Return what each of `count` rows, `step` [s] apart, adds to an integral of power that leaps between them.

    `leaps` [s], two rows apart or more, are from the first row on. The cut with a leap is extended to it from either
    side, by the line through the two rows there: leaps in step with the rows would bias the trapezoidal rule.
    """
    weights = np.full(count, step)
    weights[[0, -1]] /= 2.0
    last = np.floor(leaps / step + 1e-6).astype(int)  # row before the leap
    inside = (last >= 1) & (last <= count - 3)
    before = last[inside]
    left = leaps[inside] - before * step
    for row, inner, length in ((before, -1, left), (before + 1, 1, step - left)):
        line = length**2 / (2.0 * step)
        weights[row] += length - step / 2.0 + line
        weights[row + inner] -= line
    return weights


def leaping_power(power: Array, weights: Array) -> dict[str, Any]:
    """Return peak, root mean square and net energy of power whose rows have these :func:`leap_weights`."""
    weighted = weights * power
    return {"peak_power": np.max(power, axis=-1), "net_energy": np.sum(weighted, axis=-1),
            "rms_power": np.sqrt(np.sum(weighted * power, axis=-1) / np.sum(weights, axis=-1))}


@dataclass(frozen=True)
class FrequencyResponse:
    """Response over command: ``frequency`` [Hz], ``gain`` [1], ``phase`` [rad, unwrapped], ``coherence`` [1]."""

    frequency: Array
    gain: Array
    phase: Array
    coherence: Array

    @property
    def gain_db(self) -> Array:
        """Gain [dB]; -inf where nothing comes through, as a sine that backlash swallows."""
        with np.errstate(divide="ignore"):
            return 20.0 * np.log10(self.gain)

    @property
    def bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the gain falls 3 dB below unity; nan if it does not."""
        return float(crossing(self.frequency, -self.gain_db, 3.0))

    @property
    def phase_bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the response lags by 90 degrees; nan if it does not."""
        return float(crossing(self.frequency, -np.degrees(self.phase), 90.0))

    @property
    def beyond(self) -> float:
        """Highest frequency [Hz], which a bandwidth that is nan lies beyond; nan where nothing is measured."""
        measured = len(self.gain) > 0 and bool(np.all(np.isfinite(self.gain)))
        return float(self.frequency[-1]) if measured else nan

    @property
    def bandwidths(self) -> str:
        """Both bandwidths in words."""
        return ", ".join(
            f"{level} at {at:.1f} Hz" if isfinite(at) else
            f"{level} above {self.beyond:.4g} Hz" if isfinite(self.beyond) else f"no {level}"
            for level, at in (("-3 dB", self.bandwidth), ("-90 deg", self.phase_bandwidth)))


def frequency_response(time: Array, command: Array, response: Array, low: float, high: float) -> FrequencyResponse:
    """Return the H1 estimate, S_cr / S_cc by Welch's method, between two frequencies [Hz] the command sweeps through.

    H1 (Bendat & Piersol, "Random Data", 4th ed., section 6.2) weighs every segment by what the
    command does in it, so that the harmonics a nonlinear response has while the sweep is elsewhere
    drop out: what remains is the fundamental, the describing function of the amplitude swept with.
    The response is first moved back by its lag, which would bias the estimate (ibid., section 11.3).
    Frequencies the command does not excite are left out; at an end of a sweep the estimate is poor
    where it lasts less than half a segment. One sweep of 12 s from 0.5 to 30 Hz gives a second-order
    system with delay to 1.5 % from 0.5 to 22 Hz, and to 5 % at 24 Hz.
    """
    rate = (len(time) - 1) / (time[-1] - time[0])
    lag = max(int(np.argmax(scipy.signal.correlate(response, command))) - (len(command) - 1), 0)
    command, response = command[:len(command) - lag], response[lag:]
    length = min(round(SEGMENT * rate), len(command))
    kept = int(OVERLAP * length)
    segments = scipy.signal.ShortTimeFFT(scipy.signal.get_window("hann", length), length - kept, rate, mfft=8 * length)
    # Whole segments only, each from its first sample on.
    of_command, of_response = (segments.stft(column, p0=0, p1=(len(command) - kept) // (length - kept),
                                             k_offset=length // 2) for column in (command, response))
    frequency, s_cc = segments.f, np.mean(np.abs(of_command) ** 2, axis=-1)
    inside = (frequency >= low) & (frequency <= high) & (s_cc > EXCITED * np.max(s_cc))
    frequency, s_cc, of_response = frequency[inside], s_cc[inside], of_response[inside]
    s_cr = np.mean(np.conj(of_command[inside]) * of_response, axis=-1)
    s_rr = np.mean(np.abs(of_response) ** 2, axis=-1)
    ratio = s_cr / s_cc * np.exp(-2j * np.pi * frequency * lag / rate)
    # The first phase is near zero: a servo follows what is slow.
    return FrequencyResponse(frequency, np.abs(ratio), np.unwrap(np.angle(ratio)), np.abs(s_cr) ** 2 / (s_cc * s_rr))


def sweep_response(run: Run, low: float = SWEPT[0], high: float = SWEPT[1]) -> FrequencyResponse:
    """Return the frequency response of a finished run under a sweep; a fin that does not move has none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return frequency_response(run.columns["time"], run.excitation.command, run.columns["fin_angle"], low, high)


def swept(response: FrequencyResponse) -> dict[str, float]:
    """Return the figures of a frequency response."""
    with np.errstate(divide="ignore", invalid="ignore"):
        upto = response.frequency <= (inf if np.isnan(response.bandwidth) else response.bandwidth)
        return {"bandwidth_3db": response.bandwidth, "bandwidth_90deg": response.phase_bandwidth,
                "peak_gain": float(np.max(response.gain_db)) if len(response.gain) else nan,
                "lowest_coherence": float(np.min(response.coherence[upto])) if upto.any() else nan}


def fundamental(time: Array, values: Array, frequency: float, drift: bool = True) -> complex:
    """Return the complex amplitude c of Re(c exp(2 pi i f t)) in `values`, by least squares beside an offset.

    And beside a drift, unless it is known that there is none to speak of.
    """
    return complex(fundamental_weights(time, frequency, drift) @ values)


def fundamental_weights(time: Array, frequency: float, drift: bool = True) -> Array:
    """Return the complex numbers whose product with values at these times is their `fundamental`."""
    angle = 2.0 * pi * frequency * time
    span = float(time[-1] - time[0]) or 1.0
    slow = (np.ones_like(time), (time - time[0]) / span)[:1 + drift]
    cosine, sine, *_ = np.linalg.pinv(np.column_stack([np.cos(angle), np.sin(angle), *slow]))
    weights: Array = cosine - 1j * sine
    return weights


def held(amplitude: complex, frequency: float, step: float) -> complex:
    """Return the fundamental of a sinusoid of complex `amplitude` that is sampled and held every `step` [s]."""
    return complex(amplitude * np.sinc(frequency * step) * np.exp(-1j * pi * frequency * step))


def breakaway(moment: Array, angle: Array) -> float:
    """Return the magnitude of the moment at which the angle first leaves its start; nan if it does not."""
    moved = np.flatnonzero(np.abs(angle - angle[0]) > CREPT)
    return float(abs(moment[moved[0]])) if len(moved) else nan


def bidirectional(below: Array, above: Array) -> dict[str, Any]:
    """Return the figures of errors (target, cycle) of approaches from below and from above, in the unit of the errors.

    `means` (side, target), and the `reversal` of each target, nan where a target is not approached from a side.

    ISO 230-2 (2014), "Determination of accuracy and repeatability of positioning of numerically
    controlled axes". A target that has no approach from one side has nan there.
    """
    errors = np.stack([below, above])  # side, target, cycle
    approached = ~np.isnan(errors).all(axis=2)
    means, spreads = np.full(approached.shape, np.nan), np.full(approached.shape, np.nan)
    means[approached] = errors[approached].mean(axis=1)
    spreads[approached] = errors[approached].std(axis=1, ddof=1) if errors.shape[2] > 1 else 0.0
    reversal = means[0] - means[1]
    both = ~np.isnan(reversal)
    return {"largest_error": float(np.nanmax(np.abs(errors))),
            "hysteresis": float(np.max(np.abs(reversal[both]), initial=0.0)),
            "repeatability": float(4.0 * np.nanmax(spreads)),
            "bidirectional_accuracy": float(np.nanmax(means + 2.0 * spreads) - np.nanmin(means - 2.0 * spreads)),
            "mean_error": float(np.nanmean(errors)), "means": means, "reversal": reversal}
