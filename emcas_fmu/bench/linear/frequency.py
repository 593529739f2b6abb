"""Frequency responses, poles and stability margins of linear systems."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, pi

import control as ct
import numpy as np

from ..frequency_response import FrequencyResponse
from .systems import Array, System

LOWEST = 1e-3  # Hz
_PER_DECADE = 500


def frequencies(highest: float, lowest: float = LOWEST) -> Array:
    """Return logarithmic frequencies [Hz], dense enough for margins to 1e-5 by interpolation."""
    return np.geomspace(lowest, highest, round(np.log10(highest / lowest) * _PER_DECADE))


def highest(system: System) -> float:
    """Return the upper end of a grid [Hz]: just below half the sample rate, or far above continuous poles."""
    if system.dt:
        return 0.499 / float(system.dt)
    return 100.0 * float(np.max(np.abs(system.poles()))) / (2.0 * pi)


def evaluate(system: System, frequency: Array) -> Array:
    """Return the complex response of a system with one input and output at frequencies [Hz]; shape of `frequency`."""
    at = 2j * pi * np.asarray(frequency)
    at = np.exp(at * system.dt) if system.dt else at
    states = np.linalg.solve(at[..., None, None] * np.eye(system.nstates) - system.A, system.B)
    response: Array = (system.C @ states + system.D)[..., 0, 0]
    return response


def response(system: System) -> FrequencyResponse:
    """Return gain and phase of a closed loop up to half the sample rate."""
    grid = frequencies(highest(system))
    return of_ratio(grid, evaluate(system, grid))


def of_ratio(frequency: Array, ratio: Array) -> FrequencyResponse:
    """Return gain and unwrapped phase of a complex ratio at frequencies [Hz]; the phase of 0 is nan."""
    phase = np.full(len(ratio), nan)
    passed = ratio != 0.0
    phase[passed] = np.unwrap(np.angle(ratio[passed]))
    return FrequencyResponse(frequency, np.abs(ratio), phase, np.ones(len(ratio)))


def continuous_poles(system: System) -> Array:
    """Return the poles of a sampled system as s = ln(z)/T [rad/s], without those at z = 0, which have no image."""
    z = system.poles().astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 1e-9]) / system.dt)


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop that is stable when closed.

    ``gain`` [1] is the factor by which the loop's gain may grow, at ``phase_crossover`` [Hz]; ``reduction`` [1] is the
    factor to which it may fall (0: any). ``phase`` [rad] is the phase margin, at ``gain_crossover`` [Hz]. ``delay`` [s]
    is the largest additional delay; another crossover than that of the phase may limit it. ``modulus`` [1] is the
    smallest distance of the loop to -1. A margin without a limit is inf, its frequency nan.
    """

    gain: float
    phase_crossover: float
    reduction: float
    phase: float
    gain_crossover: float
    delay: float
    modulus: float

    @property
    def gain_db(self) -> float:
        """Gain margin [dB]."""
        return 20.0 * float(np.log10(self.gain))


def margins(loop: System, grid: Array | None = None) -> Margins:
    """Return the margins of a loop transfer function L, by its exact frequency response.

    python-control locates the crossovers between the frequencies [Hz] of `grid`, by default a fine one, with splines.
    """
    grid = frequencies(highest(loop)) if grid is None else grid
    response = evaluate(loop, grid)
    gains, lags, _, at_180, at_one, _ = ct.stability_margins(
        (np.abs(response), np.degrees(np.angle(response)), 2.0 * pi * grid), returnall=True)
    phases = np.radians(lags)
    # The first crossing as the gain grows, and as the phase lags or leads.
    gain, at_gain = min(((g, at) for g, at in zip(gains, at_180, strict=True) if g > 1.0), default=(inf, nan))
    phase, at_phase = min(zip(phases, at_one, strict=True), key=lambda pair: abs(pair[0]), default=(inf, nan))
    return Margins(
        gain=float(gain), phase_crossover=float(at_gain) / (2.0 * pi),
        reduction=float(np.max(gains[gains < 1.0], initial=0.0)),
        phase=float(phase), gain_crossover=float(at_phase) / (2.0 * pi),
        delay=float(np.min(np.remainder(phases, 2.0 * pi) / at_one, initial=inf)),
        modulus=float(np.min(np.abs(1.0 + response))))
