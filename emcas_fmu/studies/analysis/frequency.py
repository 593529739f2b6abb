"""Frequency responses, poles and stability margins of linear systems, on exact responses."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, pi
from typing import Any

import control as ct
import numpy as np

from ...bench.metrics import FrequencyResponse
from .linear import Array, System

LOWEST = 1e-3  # Hz
_PER_DECADE = 500


def frequencies(highest: float, lowest: float = LOWEST) -> Array:
    """Return frequencies [Hz], logarithmic, fine enough that a margin read between them is good to 1e-5."""
    return np.geomspace(lowest, highest, round(np.log10(highest / lowest) * _PER_DECADE))


def highest(system: System) -> float:
    """Return a grid's upper end [Hz]: just below half the sample rate, or far above a continuous system's poles."""
    if system.dt:
        return 0.499 / float(system.dt)
    return 100.0 * float(np.max(np.abs(system.poles()))) / (2.0 * pi)


def evaluate(system: System, frequency: Array) -> Array:
    """Return the complex response of a system with one input and output at frequencies [Hz]; shape of `frequency`."""
    omega = 2j * pi * np.asarray(frequency)
    response: Array = system(np.exp(omega * system.dt) if system.dt else omega)
    return response


def response(system: System) -> FrequencyResponse:
    """Return gain and phase of a closed loop up to half the sample rate."""
    grid = frequencies(highest(system))
    return of_ratio(grid, evaluate(system, grid))


def of_ratio(frequency: Array, ratio: Array) -> FrequencyResponse:
    """Return gain and unwrapped phase of a complex ratio at frequencies [Hz]; where it is 0 there is no phase, nan."""
    phase = np.full(len(ratio), nan)
    passed = ratio != 0.0
    phase[passed] = np.unwrap(np.angle(ratio[passed]))
    return FrequencyResponse(frequency, np.abs(ratio), phase, np.ones(len(ratio)))


def continuous_poles(system: System) -> Array:
    """Return the poles of a sampled system as s = ln(z)/T [rad/s]; those at z = 0 have no image and are left out."""
    z = system.poles().astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 1e-9]) / system.dt)


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop that is stable when closed.

    ``gain`` [1] by which the loop's gain may grow, ``reduction`` [1] to which it may fall
    (0: by any amount), at ``phase_crossover`` [Hz]; ``phase`` [rad] at ``gain_crossover``
    [Hz]; ``delay`` [s] that may be added, which may be limited at another crossover than the phase; ``modulus``
    [1], the smallest distance of the loop to -1. inf where nothing limits, nan for its frequency.
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
    """Return the margins of a loop transfer function L, by its exact frequency response and python-control.

    `grid` are frequencies [Hz] to look between, fine ones unless given.
    """
    grid = frequencies(highest(loop)) if grid is None else grid
    values = evaluate(loop, grid)
    data: Any = ct.frd(values, 2.0 * pi * grid, smooth=True)
    gains, phases, _, at_180, at_one, _ = ct.stability_margins(data, returnall=True)
    phases, hertz = np.radians(phases), 1.0 / (2.0 * pi)
    # The first crossing met as the gain grows, and as the phase lags or leads, of those there are.
    gain, at_gain = min(((g, at) for g, at in zip(gains, at_180, strict=True) if g > 1.0), default=(inf, nan))
    phase, at_phase = min(zip(phases, at_one, strict=True), key=lambda pair: abs(pair[0]), default=(inf, nan))
    return Margins(
        gain=float(gain), phase_crossover=float(at_gain) * hertz,
        reduction=float(np.max(gains[gains < 1.0], initial=0.0)),
        phase=float(phase), gain_crossover=float(at_phase) * hertz,
        delay=float(np.min(np.remainder(phases, 2.0 * pi) / at_one, initial=inf)),
        modulus=float(np.min(np.abs(1.0 + values))))
