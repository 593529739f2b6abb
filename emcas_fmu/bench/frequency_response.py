"""Frequency responses from runs: sine sweeps by Welch's method, steady sines by least squares (`Sines`).

Frequencies are in Hz, phases in rad, gains are ratios; columns are sampled uniformly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf, isnan, nan, pi
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..motions import STEP
from ..pages.numbers import number
from .excitation import COMMAND, Excitation, sine, times
from .metrics import Array, crossing
from .runs import Run

SWEPT = (0.5, 24.0)  # Hz, range of the estimate: a sweep of 12 s to 30 Hz passes 24 Hz 0.65 s before it ends
# A response counts as a sine if its fundamental has at least this share of its power. A triangle wave has 0.986, a
# square wave 0.81.
PURE = 0.9

# Length and overlap of the Hann segments. A second is long compared with the actuator's impulse response: truncating a
# response at a segment's end matters little. It is short compared with the sweep: a harmonic of the response and the
# command have the same frequency in different segments.
SEGMENT = 1.0  # s
OVERLAP = 15.0 / 16.0  # share of a segment
# Share of the largest input power below which a frequency counts as not excited.
EXCITED = 1e-2


@dataclass(frozen=True)
class FrequencyResponse:
    """Response over command: ``frequency`` [Hz], ``gain`` [1], ``phase`` [rad, unwrapped], ``coherence`` [1]."""

    frequency: Array
    gain: Array
    phase: Array
    coherence: Array

    @property
    def gain_db(self) -> Array:
        """Gain [dB]; -inf for a response of zero, such as that to a sine within the backlash."""
        with np.errstate(divide="ignore"):
            return 20.0 * np.log10(self.gain)

    @property
    def crossings(self) -> tuple[float, float]:
        """Lowest frequencies [Hz] with a gain of -3 dB or less and with a lag of 90 deg or more; nan if there is none.
        """
        return (float(crossing(self.frequency, -self.gain_db, 3.0)),
                float(crossing(self.frequency, -np.degrees(self.phase), 90.0)))

    @property
    def bandwidths(self) -> tuple[float, float]:
        """`crossings`, but nan where the limit is already reached at the lowest frequency."""
        gain, phase = self.crossings
        return (nan if self.gain_db[0] <= -3.0 else gain, nan if np.degrees(self.phase[0]) <= -90.0 else phase)

    @property
    def bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the gain falls to -3 dB; nan if it does not within `frequency`."""
        return self.bandwidths[0]

    @property
    def phase_bandwidth(self) -> float:
        """Lowest frequency [Hz] at which the lag rises to 90 deg; nan if it does not within `frequency`."""
        return self.bandwidths[1]

    @property
    def stated(self) -> tuple[str, str]:
        """Both bandwidths [Hz] as text: ``< `` or ``> `` and an end of `frequency` if beyond it; a dash behind gaps."""
        complete = np.all(np.isfinite(self.gain)) and np.all(np.isfinite(self.phase))
        gain, phase = (f"< {number(at)}" if not isnan(at) and isnan(within) else
                       f"> {number(self.frequency[-1])}" if isnan(at) and complete else number(at)
                       for at, within in zip(self.crossings, self.bandwidths, strict=True))
        return gain, phase


def of_ratio(frequency: Array, ratio: NDArray[Any]) -> FrequencyResponse:
    """Return the frequency response with a complex `ratio` at each `frequency` [Hz]; the phase of 0 is nan."""
    phase = np.full(len(ratio), nan)
    passed = ratio != 0.0
    phase[passed] = np.unwrap(np.angle(ratio[passed]))
    return FrequencyResponse(frequency, np.abs(ratio), phase, np.ones(len(ratio)))


def frequency_response(time: Array, command: Array, response: Array, low: float, high: float) -> FrequencyResponse:
    """Return the H1 estimate S_cr / S_cc by Welch's method, from `low` to `high` [Hz], for a swept command.

    H1 (Bendat & Piersol, "Random Data", 4th ed., section 6.2) weights each segment by the command's power in it. The
    harmonics of a nonlinear response occur while the sweep is at other frequencies and have no weight: the result is
    the fundamental, the describing function at the sweep's amplitude. The response is first shifted back by its lag,
    since a lag biases the estimate (ibid., section 11.3). Frequencies that the command does not excite are left out.
    The estimate is poor at frequencies that the sweep reaches within half a segment of its end. One sweep of 12 s from
    0.5 to 30 Hz gives a second-order system with delay within 1.5 % from 0.5 to 22 Hz, and within 5 % at 24 Hz.
    """
    rate = (len(time) - 1) / (time[-1] - time[0])
    lag = max(int(np.argmax(scipy.signal.correlate(response, command))) - (len(command) - 1), 0)
    command, response = command[:len(command) - lag], response[lag:]
    length = min(round(SEGMENT * rate), len(command))
    kept = int(OVERLAP * length)
    segments = scipy.signal.ShortTimeFFT(scipy.signal.get_window("hann", length), length - kept, rate, mfft=8 * length)
    # Whole segments only; the first begins at the first sample.
    of_command, of_response = (segments.stft(column, p0=0, p1=(len(command) - kept) // (length - kept),
                                             k_offset=length // 2) for column in (command, response))
    frequency, s_cc = segments.f, np.mean(np.abs(of_command) ** 2, axis=-1)
    inside = (frequency >= low) & (frequency <= high) & (s_cc > EXCITED * np.max(s_cc))
    frequency, s_cc, of_response = frequency[inside], s_cc[inside], of_response[inside]
    s_cr = np.mean(np.conj(of_command[inside]) * of_response, axis=-1)
    s_rr = np.mean(np.abs(of_response) ** 2, axis=-1)
    ratio = s_cr / s_cc * np.exp(-2j * np.pi * frequency * lag / rate)
    # The first phase is near zero: at the lowest frequency a servo follows its command.
    return FrequencyResponse(frequency, np.abs(ratio), np.unwrap(np.angle(ratio)), np.abs(s_cr) ** 2 / (s_cc * s_rr))


def sweep_response(run: Run, low: float = SWEPT[0], high: float = SWEPT[1]) -> FrequencyResponse:
    """Return the frequency response of a finished run under a sweep, estimated from `low` to `high` [Hz].

    The coherence is nan if the fin does not move.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return frequency_response(run.columns["time"], run.excitation.command, run.columns["fin_angle"], low, high)


def swept(response: FrequencyResponse) -> dict[str, float]:
    """Return the figures of a frequency response: bandwidths [Hz], peak gain [dB], lowest coherence [-]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        gain, phase = response.crossings
        in_band = response.frequency <= (inf if isnan(gain) else gain)
        return {"bandwidth_3db": gain, "bandwidth_90deg": phase,
                "peak_gain": float(np.max(response.gain_db)) if len(response.gain) else nan,
                "lowest_coherence": float(np.min(response.coherence[in_band])) if in_band.any() else nan}


@dataclass(frozen=True)
class Sines:
    """Sines of an input, a run for each `frequency` [Hz], with rows every `step` [s].

    After a transient, a sine with an offset, with `drift` also with a linear term, is fitted by least squares to whole
    cycles. `transient` and `fitted` have the smallest number of cycles, and the shortest time [s], of each.
    """

    frequency: Array
    transient: tuple[float, float]
    fitted: tuple[float, float]
    step: float = STEP
    drift: bool = False

    @property
    def _cycles(self) -> Array:
        smallest, shortest = self.fitted
        cycles: Array = np.ceil(np.maximum(smallest / self.frequency, shortest) * self.frequency)
        return cycles

    def excitation(self, amplitude: float, variable: str = COMMAND) -> Excitation:
        """Return sines of the command [rad], or cosines of another input `variable`, with an amplitude in its unit."""
        return sine(amplitude, self.frequency, self._cycles, self.transient, variable, self.step)

    @property
    def _fits(self) -> list[tuple[slice, Array]]:
        return [_fit(*each, self.transient, self.step, self.drift)
                for each in zip(self.frequency.tolist(), self._cycles.tolist(), strict=True)]

    def rows(self, column: Array) -> list[Array]:
        """Return the fitted rows of each run of a column [runs, rows]."""
        return [run[chosen] for run, (chosen, _) in zip(column, self._fits, strict=True)]

    def fit(self, column: Array) -> Array:
        """Return the complex amplitude c of Re(c exp(2 pi i f t)) in each run of a column [runs, rows].

        The amplitude, in the column's unit, is nan if a fitted row is.
        """
        return np.array([weights @ rows for rows, (_, weights) in zip(self.rows(column), self._fits, strict=True)])


@lru_cache(maxsize=1024)  # bisections of all variants use the same frequencies, fewer than this
def _fit(frequency: float, cycles: float, transient: tuple[float, float], step: float, drift: bool
         ) -> tuple[slice, Array]:
    """Return the fitted rows, and the weights whose product with their values is the complex amplitude."""
    begin = max(transient[0] / frequency, transient[1])
    end = begin + cycles / frequency
    time = times(end, step)
    chosen = np.flatnonzero((time >= begin) & (time <= end))
    time = time[chosen]
    angle, slow = 2.0 * pi * frequency * time, (np.ones_like(time), time - time[0])[:1 + drift]
    cosine, quadrature, *_ = np.linalg.pinv(np.column_stack([np.cos(angle), np.sin(angle), *slow]))
    return slice(chosen[0], chosen[-1] + 1), cosine - 1j * quadrature


def held(amplitude: complex, frequency: float, step: float) -> complex:
    """Return the complex fundamental of a sine that is sampled and held every `step` [s]; `frequency` is in Hz."""
    return complex(amplitude * np.sinc(frequency * step) * np.exp(-1j * pi * frequency * step))
