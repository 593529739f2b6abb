"""Performance figures of responses: pure functions of uniformly sampled columns.

Angles come in and go out in one unit, whichever the caller uses; times in s, frequencies in Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.floating[Any]]

# Hann segments of the frequency response. A second is thirty times the actuator's memory, so that cutting a
# response off at a segment's end matters little, and short enough that a sweep's harmonics, which come at
# other times than the same frequency in the command, fall into other segments.
SEGMENT = 1.0  # s
OVERLAP = 15.0 / 16.0
# Share of the strongest input power below which a frequency counts as not excited.
EXCITED = 1e-2


@dataclass(frozen=True)
class Errors:
    """Largest magnitude and root mean square of response - reference, in the variable's unit."""

    maximum: float
    rms: float


def errors(response: Array, reference: Array) -> Errors:
    """Errors of a response to a reference at the same times; nan where either is."""
    difference = np.asarray(response, dtype=float) - reference
    return Errors(float(np.max(np.abs(difference))), float(np.sqrt(np.mean(difference**2))))


@dataclass(frozen=True)
class StepMetrics:
    """Figures of a step from its instant on; times in s, nan where the level is never reached.

    ``rise_time`` from 10 to 90 % of the commanded change; ``settling_time`` until the response
    stays within 2 % of it around the command (inf if it is outside at the end); ``overshoot``
    beyond the command in % of the change; ``steady_error`` mean of response - command over
    the last tenth of the record, in the response's unit.
    """

    rise_time: float
    settling_time: float
    overshoot: float
    steady_error: float


def step_metrics(time: Array, response: Array, start: float, command: float) -> StepMetrics:
    """Figures of the response to a command that jumps to a level at `start` [s] and stays there.

    All levels refer to the commanded change, from the response at `start`, and not to the value the
    response ends at: a servo is judged by where it was told to go. Otherwise as in Ogata,
    "Modern Control Engineering", 5th ed., section 5-3.
    """
    time, response = _since(time, response, start)
    initial = response[0]
    share = (response - initial) / (command - initial)
    rise = crossing(time, share, 0.9) - crossing(time, share, 0.1)
    tail = max(len(time) // 10, 1)
    return StepMetrics(
        rise_time=rise,
        settling_time=_settling(time - start, share, 0.02),
        overshoot=100.0 * max(float(np.max(share)) - 1.0, 0.0),
        steady_error=float(np.mean(response[-tail:]) - command),
    )


def crossing(time: Array, values: Array, level: float) -> float:
    """First time [s] at which `values` reach `level` from below, by linear interpolation; nan if never."""
    above = values >= level
    if not above.any():
        return nan
    k = int(np.argmax(above))
    if k == 0:
        return float(time[0])
    return float(time[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (time[k] - time[k - 1]))


def _settling(time: Array, share: Array, band: float) -> float:
    distance = np.abs(share - 1.0)
    outside = np.flatnonzero(~(distance <= band))
    if not len(outside):
        return 0.0
    k = int(outside[-1])
    if k == len(time) - 1:
        return inf
    return float(time[k] + (distance[k] - band) / (distance[k] - distance[k + 1]) * (time[k + 1] - time[k]))


def time_to_accuracy(time: Array, response: Array, start: float, command: float, accuracy: float) -> float:
    """Time [s] from a command at `start` [s] until the response stays within ±`accuracy` of it for good.

    It is that of the first row which all later ones are within, too: 0 where no row from `start` on is outside, inf
    where the last one is. A row that is not a number is outside.
    """
    time, response = _since(time, response, start)
    outside = np.flatnonzero(~(np.abs(response - command) <= accuracy))
    if not len(outside):
        return 0.0
    last = int(outside[-1])
    return inf if last == len(time) - 1 else float(time[last + 1] - start)


def _since(time: Array, values: Array, start: float) -> tuple[Array, Array]:
    # Communication times carry rounding: a nanosecond early is on time.
    begin = int(np.searchsorted(time, start - 1e-9))
    return time[begin:], values[begin:]


@dataclass(frozen=True)
class Slew:
    """Rates of a large motion: highest at any instant, and mean over the middle 60 % of the travel, unit/s."""

    peak: float
    sustained: float


def slew(time: Array, angle: Array, rate: Array, start: float, command: float) -> Slew:
    """Rates towards a command given at `start` [s]; the sustained one is nan if 80 % is never reached.

    The middle of the travel leaves out the run-up and the braking, and a mean does not reward a
    spike: of the two, the sustained rate is what a guidance loop can count on.
    """
    _, rate = _since(time, rate, start)
    time, angle = _since(time, angle, start)
    travel = command - angle[0]
    share = (angle - angle[0]) / travel
    return Slew(
        peak=float(np.max(rate * np.sign(travel))),
        sustained=abs(travel) * 0.6 / (crossing(time, share, 0.8) - crossing(time, share, 0.2)),
    )


@dataclass(frozen=True)
class FrequencyResponse:
    """Response over command: ``frequency`` [Hz], ``gain`` [1], ``phase`` [rad, unwrapped], ``coherence`` [1]."""

    frequency: Array
    gain: Array
    phase: Array
    coherence: Array

    @property
    def gain_db(self) -> Array:
        """Gain [dB]."""
        return 20.0 * np.log10(self.gain)

    @property
    def bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the gain falls 3 dB below unity; nan if it does not."""
        return crossing(self.frequency, -self.gain_db, 3.0)

    @property
    def phase_bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the response lags by 90 degrees; nan if it does not."""
        return crossing(self.frequency, -np.degrees(self.phase), 90.0)


def frequency_response(time: Array, command: Array, response: Array, low: float, high: float) -> FrequencyResponse:
    """H1 estimate, S_cr / S_cc by Welch's method, between two frequencies [Hz] the command sweeps through.

    H1 (Bendat & Piersol, "Random Data", 4th ed., section 6.2) weighs every segment by what the
    command does in it, so that the harmonics a nonlinear response has while the sweep is elsewhere
    drop out: what remains is the fundamental, the describing function of the amplitude swept with.
    The response is first moved back by its lag, which would bias the estimate (ibid., section 11.3).
    Frequencies the command does not excite are left out; at an end of a sweep the estimate is poor
    where it lasts less than half a segment. One sweep of 12 s from 0.5 to 30 Hz gives a second-order
    system with delay to 1.5 % from 0.5 to 22 Hz, and to 5 % at 24 Hz.
    """
    rate = (len(time) - 1) / (time[-1] - time[0])
    lag = max(int(np.argmax(signal.correlate(response, command))) - (len(command) - 1), 0)
    command, response = command[:len(command) - lag], response[lag:]
    length = min(round(SEGMENT * rate), len(command))
    options = {"fs": rate, "window": "hann", "nperseg": length, "noverlap": int(OVERLAP * length),
               "nfft": 8 * length, "detrend": False}
    frequency, s_cr = signal.csd(command, response, **options)
    _, s_cc = signal.welch(command, **options)
    _, s_rr = signal.welch(response, **options)
    inside = (frequency >= low) & (frequency <= high) & (s_cc > EXCITED * np.max(s_cc))
    frequency, s_cr, s_cc, s_rr = frequency[inside], s_cr[inside], s_cc[inside], s_rr[inside]
    ratio = s_cr / s_cc * np.exp(-2j * np.pi * frequency * lag / rate)
    # The first phase is near zero: a servo follows what is slow.
    return FrequencyResponse(frequency, np.abs(ratio), np.unwrap(np.angle(ratio)), np.abs(s_cr) ** 2 / (s_cc * s_rr))
