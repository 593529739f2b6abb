"""Filters of the sampled part: an observer of the motor's speed, and a notch, from their poles and zeros.

The observer is a Luenberger observer of speed w and load T_d, whose gain follows from Ackermann's formula; it compares
the mean of two speeds with the encoder's difference. The notch is a ratio of polynomials in z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from .vehicle import clip


class SpeedObserver:
    """Speed and load of a motor from the encoder's difference and the torque of the current."""

    def __init__(self, bandwidth: float, period: float):
        self.pole, self.period = math.exp(-bandwidth * period), period
        self.state = np.zeros(2)  # rad/s, N.m

    def speed(self, difference: float, torque: float, inertia: float) -> float:
        """Return the speed [rad/s] for a `difference` of counts [rad/s], torque [N.m] and inertia [kg.m2]."""
        gain = self.period / inertia
        a, output = np.array([[1.0, gain], [0.0, 1.0]]), np.array([1.0, 0.5 * gain])
        shifted = a - self.pole * np.eye(2)
        innovation = shifted @ shifted @ np.linalg.solve(np.vstack([output, output @ a]), [0.0, 1.0])
        error = difference - output @ self.state - 0.5 * gain * torque
        self.state = a @ self.state + np.array([gain * torque, 0.0]) + innovation * error
        return float(self.state[0])


class Notch:
    """A notch of frequency [rad/s] and dampings of zeros and poles, exact at that frequency."""

    def __init__(self, frequency: float, dampings: tuple[float, float], period: float):
        scale = frequency / math.tan(frequency * period / 2.0)
        back, forth = np.array([1.0, -1.0]), np.array([1.0, 1.0])
        self.zeros, self.poles = (
            np.polyadd(scale**2 * np.polymul(back, back), np.polyadd(
                2.0 * damping * frequency * scale * np.polymul(back, forth), frequency**2 * np.polymul(forth, forth)))
            for damping in dampings)
        self.reset()

    def reset(self) -> None:
        """Put the notch at rest at 0."""
        self.before, self.after = np.zeros(2), np.zeros(2)  # of the last two samples, the newest first

    def filtered(self, value: float, limit: float) -> float:
        """Return a reference [V] behind the notch, at most `limit` [V]."""
        out = (self.zeros @ [value, *self.before] - self.poles[1:] @ self.after) / self.poles[0]
        self.before, self.after = np.array([value, self.before[0]]), np.array([out, self.after[0]])
        return clip(float(out), limit)


def of(p: Mapping[str, float]) -> tuple[SpeedObserver | None, Notch | None]:
    """Return the filters of an actuator with parameters by name, None for those that it does not have."""
    period, bandwidth = p["controller.sample_time"], p.get("filters.speed_bandwidth", 0.0)
    frequency = p.get("filters.notch_frequency", 0.0)
    return (SpeedObserver(bandwidth, period) if bandwidth and p["encoder.enabled"] else None,
            Notch(frequency, (p["filters.notch_zero_damping"], p["filters.notch_pole_damping"]), period)
            if frequency else None)
