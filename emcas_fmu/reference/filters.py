"""Filters of the controllers, computed from their poles and zeros: an observer of the motor's speed, and a notch.

The Luenberger observer estimates speed and load torque; its gain follows from Ackermann's formula. It compares the mean
of two successive speeds with the encoder's difference. The notch is a ratio of polynomials in z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from .vehicle import clip


class SpeedObserver:
    """Observer of a motor's speed and load torque, with a bandwidth [1/s] and a sampling period [s]."""

    def __init__(self, bandwidth: float, period: float):
        self.pole, self.period = math.exp(-bandwidth * period), period
        self.state = np.zeros(2)  # rad/s, N.m

    def speed(self, difference: float, torque: float, inertia: float) -> float:
        """Return the speed [rad/s] for an encoder `difference` [rad/s], torque [N.m] and inertia [kg.m2]."""
        gain = self.period / inertia
        a, output = np.array([[1.0, gain], [0.0, 1.0]]), np.array([1.0, 0.5 * gain])
        shifted = a - self.pole * np.eye(2)
        innovation = shifted @ shifted @ np.linalg.solve(np.vstack([output, output @ a]), [0.0, 1.0])
        error = difference - output @ self.state - 0.5 * gain * torque
        self.state = a @ self.state + np.array([gain * torque, 0.0]) + innovation * error
        return float(self.state[0])


class Notch:
    """A notch with a frequency [rad/s], where it is exact, the dampings of zeros and poles, and a period [s]."""

    def __init__(self, frequency: float, dampings: tuple[float, float], period: float):
        scale = frequency / math.tan(frequency * period / 2.0)
        back, forth = np.array([1.0, -1.0]), np.array([1.0, 1.0])
        self.zeros, self.poles = (
            np.polyadd(scale**2 * np.polymul(back, back), np.polyadd(
                2.0 * damping * frequency * scale * np.polymul(back, forth), frequency**2 * np.polymul(forth, forth)))
            for damping in dampings)
        self.reset()

    def reset(self) -> None:
        """Reset the notch to rest at 0 V."""
        self.inputs, self.outputs = np.zeros(2), np.zeros(2)  # V, the newest first

    def filtered(self, value: float, limit: float) -> float:
        """Return the reference [V] after the notch, within +-`limit` [V]."""
        out = (self.zeros @ [value, *self.inputs] - self.poles[1:] @ self.outputs) / self.poles[0]
        self.inputs, self.outputs = np.array([value, self.inputs[0]]), np.array([out, self.outputs[0]])
        return clip(float(out), limit)


def of(p: Mapping[str, float]) -> tuple[SpeedObserver | None, Notch | None]:
    """Return observer and notch for the parameters `p`, None for a filter that is absent."""
    period, bandwidth = p["controller.sample_time"], p.get("filters.speed_bandwidth", 0.0)
    frequency = p.get("filters.notch_frequency", 0.0)
    return (SpeedObserver(bandwidth, period) if bandwidth and p["encoder.enabled"] else None,
            Notch(frequency, (p["filters.notch_zero_damping"], p["filters.notch_pole_damping"]), period)
            if frequency else None)
