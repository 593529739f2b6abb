"""Frequency responses, poles and stability margins of linear systems."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log10, nan, pi

import control as ct
import numpy as np

from ..frequency_response import FrequencyResponse, of_ratio
from .systems import Array, System

LOWEST = 1e-3  # Hz, lower end of a grid
_PER_DECADE = 500  # frequencies
_NARROW = 0.1  # damping ratio below which a resonance or notch needs additional frequencies
# Distances of these frequencies from the resonance or notch, in half widths.
_NEAR = np.concatenate([-np.geomspace(20.0, 0.05, 24), [0.0], np.geomspace(0.05, 20.0, 24)])
_LOCAL = 20  # points on each side of a crossing; a change of a point beyond changes the spline by 0.27^20 = 4e-12 of it
_AT_A_POLE = 1e-6  # a pole nearer (z, or s [rad/s]) to an end of the frequencies is at it; rounding moves poles by 1e-8


def frequencies(highest: float, lowest: float = LOWEST) -> Array:
    """Return frequencies [Hz] at equal ratios, dense enough for margins to 1e-9 by splines, and for |1 + L| to 1e-4."""
    return np.geomspace(lowest, highest, round(np.log10(highest / lowest) * _PER_DECADE))


def highest(system: System) -> float:
    """Return the upper end of a grid [Hz]: below half the sample rate, or far above a continuous system's poles."""
    if system.dt:
        return 0.499 / float(system.dt)
    return 100.0 * float(np.max(np.abs(system.poles()))) / (2.0 * pi)


def evaluate(system: System, frequency: Array) -> Array:
    """Return the complex response of a system with one input and output, in the shape of `frequency` [Hz]."""
    at = 2j * pi * np.asarray(frequency)
    at = np.exp(at * system.dt) if system.dt else at
    states = np.linalg.solve(at[..., None, None] * np.eye(system.nstates) - system.A, system.B)
    response: Array = (system.C @ states + system.D)[..., 0, 0]
    return response


def response(system: System) -> FrequencyResponse:
    """Return the frequency response of a system with one input and output, from LOWEST to :func:`highest`."""
    grid = frequencies(highest(system))
    return of_ratio(grid, evaluate(system, grid))


def continuous_poles(system: System) -> Array:
    """Return the poles of a sampled system as s = ln(z)/T [rad/s], without poles at z = 0, which have no image."""
    return _continuous(system.poles(), system.dt)


def _continuous(z: Array, period: float) -> Array:
    z = z.astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 1e-9]) / period)


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop that is stable when closed.

    ``gain`` [1] is the factor by which the loop's gain may grow, at ``phase_crossover`` [Hz]; ``reduction`` [1] is the
    factor to which it may fall (0: any), at ``reduction_crossover`` [Hz]. ``phase`` [rad] is the phase margin, at
    ``gain_crossover`` [Hz]. ``delay`` [s] is the largest additional delay, which another gain crossover may limit.
    ``modulus`` [1] is the smallest distance of the loop to -1. A margin without a limit is inf, its frequency nan.
    """

    gain: float
    phase_crossover: float
    reduction: float
    reduction_crossover: float
    phase: float
    gain_crossover: float
    delay: float
    modulus: float

    @property
    def up_db(self) -> float:
        """Gain margin upwards [dB]."""
        return 20.0 * log10(self.gain)

    @property
    def down_db(self) -> float:
        """Gain margin downwards [dB], above 0."""
        return -20.0 * log10(self.reduction) if self.reduction else inf

    @property
    def gain_db(self) -> float:
        """Gain margin [dB]: the smaller one of both directions."""
        return min(self.up_db, self.down_db)


def _refined(loop: System, grid: Array) -> Array:
    """Return a grid [Hz] with additional frequencies about lightly damped poles and zeros, within its ends.

    They reach twenty half widths from a pole or zero, where it changes the loop by only 5 %.
    """
    roots = np.concatenate([loop.poles(), loop.zeros()])
    if loop.dt:
        roots = _continuous(roots, loop.dt)
    narrow = roots[(roots.imag > 0.0) & (np.abs(roots.real) < _NARROW * np.abs(roots))]
    width = np.maximum(np.abs(narrow.real), 1e-6 * narrow.imag)
    near = (narrow.imag + np.multiply.outer(_NEAR, width)) / (2.0 * pi)
    whole = np.union1d(grid, near[(near > grid[0]) & (near < grid[-1])])
    return whole[np.diff(whole, prepend=0.0) > 1e-9 * whole]


def margins(loop: System, grid: Array | None = None) -> Margins:
    """Return the margins of a loop transfer function L, by its exact frequency response.

    python-control locates the crossovers between the frequencies [Hz] of `grid`, by default a fine grid, with splines.
    Frequencies are added about narrow resonances and notches. Gain margins are also computed where the loop is negative
    at the ends of the frequencies: at 0 Hz, and for a sampled loop at half the sample rate.
    """
    grid = _refined(loop, frequencies(highest(loop)) if grid is None else grid)
    response = evaluate(loop, grid)
    near = _near_crossings(response)
    gains, lags, _, at_180, at_one, _ = ct.stability_margins(
        (np.abs(response[near]), np.degrees(np.angle(response[near])), 2.0 * pi * grid[near]),
        returnall=True) if near.any() else np.empty((6, 0))
    phases = np.radians(lags)
    crossings = [*zip(gains, at_180 / (2.0 * pi), strict=True), *_ends(loop)]
    # The first crossing as the gain grows or falls, and as the phase lags or leads.
    gain, at_gain = min(((g, at) for g, at in crossings if g > 1.0), default=(inf, nan))
    reduction, at_reduction = max(((g, at) for g, at in crossings if g < 1.0), default=(0.0, nan))
    phase, at_phase = min(zip(phases, at_one, strict=True), key=lambda pair: abs(pair[0]), default=(inf, nan))
    return Margins(
        gain=float(gain), phase_crossover=float(at_gain),
        reduction=float(reduction), reduction_crossover=float(at_reduction),
        phase=float(phase), gain_crossover=float(at_phase) / (2.0 * pi),
        delay=float(np.min(np.remainder(phases, 2.0 * pi) / at_one, initial=inf)),
        modulus=float(np.min(np.abs(1.0 + response))))


def _near_crossings(response: Array) -> Array:
    """Return a mask of the values within `_LOCAL` points of a crossing of the real axis or the unit circle.

    No crossover is elsewhere. The mask saves time: python-control evaluates its splines point by point.
    """
    crossed = np.diff(np.sign(response.imag)).astype(bool) | np.diff(np.sign(np.abs(response) - 1.0)).astype(bool)
    return np.convolve(crossed, np.ones(2 * _LOCAL, int))[_LOCAL - 1:_LOCAL - 1 + len(response)] > 0


def _ends(loop: System) -> list[tuple[float, float]]:
    """Return gain margins [1] and frequencies [Hz] at the ends of the frequencies at which the loop is negative."""
    ends = [(1.0 if loop.dt else 0.0, 0.0), *([(-1.0, 0.5 / float(loop.dt))] if loop.dt else [])]
    poles = loop.poles()
    values = [(complex(loop(at)).real, hertz) for at, hertz in ends if np.all(np.abs(poles - at) > _AT_A_POLE)]
    return [(-1.0 / value, hertz) for value, hertz in values if value < 0.0]
