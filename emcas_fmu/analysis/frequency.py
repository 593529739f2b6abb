"""Frequency responses, bandwidths and stability margins of linear systems, on exact responses."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, pi
from typing import Any

import control as ct
import numpy as np

from ..bench.metrics import FrequencyResponse
from .linear import Array, System

LOWEST = 1e-3  # Hz
_PER_DECADE = 500


def frequencies(highest: float, lowest: float = LOWEST) -> Array:
    """Frequencies [Hz], logarithmic, fine enough that a margin read between them is good to 1e-5."""
    return np.geomspace(lowest, highest, round(np.log10(highest / lowest) * _PER_DECADE))


def highest(system: System) -> float:
    """Upper end [Hz] of a grid: just below half the sample rate, or far above a continuous system's poles."""
    if system.dt:
        return 0.499 / float(system.dt)
    return 100.0 * float(np.max(np.abs(system.poles()))) / (2.0 * pi)


def evaluate(system: System, frequency: Array) -> Array:
    """Complex response of a system with one input and output at frequencies [Hz]; shape of `frequency`."""
    omega = 2j * pi * np.asarray(frequency)
    response: Array = system(np.exp(omega * system.dt) if system.dt else omega)
    return response


def response(system: System, frequency: Array | None = None) -> FrequencyResponse:
    """Gain and unwrapped phase of a closed loop at frequencies [Hz]; up to half the sample rate unless given."""
    grid = frequencies(highest(system)) if frequency is None else frequency
    values = evaluate(system, grid)
    return FrequencyResponse(grid, np.abs(values), np.unwrap(np.angle(values)), np.ones(len(grid)))


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
    """Margins of a loop transfer function L, by its exact frequency response and python-control.

    `grid` are frequencies [Hz] to look between, fine ones unless given.
    """
    grid = frequencies(highest(loop)) if grid is None else grid
    values = evaluate(loop, grid)
    data: Any = ct.frd(values, 2.0 * pi * grid, smooth=True)
    gains, phases, _, at_180, at_one, _ = ct.stability_margins(data, returnall=True)
    up = gains > 1.0
    # The first crossing met as the gain grows or falls, of those there are.
    k = int(np.argmin(np.where(up, gains, inf))) if np.any(up) else -1
    down = gains[gains < 1.0]
    phases = np.radians(phases)
    j = int(np.argmin(np.abs(phases))) if len(phases) else -1
    delays = np.remainder(phases, 2.0 * pi) / at_one
    hertz = 1.0 / (2.0 * pi)
    return Margins(
        gain=float(gains[k]) if k >= 0 else inf, phase_crossover=float(at_180[k]) * hertz if k >= 0 else nan,
        reduction=float(np.max(down, initial=0.0)),
        phase=float(phases[j]) if j >= 0 else inf, gain_crossover=float(at_one[j]) * hertz if j >= 0 else nan,
        delay=float(np.min(delays, initial=inf)), modulus=float(np.min(np.abs(1.0 + values))))
