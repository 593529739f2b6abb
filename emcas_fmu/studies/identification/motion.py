"""The equation of motion averaged over windows, for records of motor angle and current.

A smooth window phi (Hann, sum 1, value and slope zero at both ends) averages the current, and the first and second
central differences of the angle. By summation by parts, the averaged differences are the angle weighted by phi' and
phi'' (Shinbrot 1957, modulating functions): an encoder's steps are not differentiated. The equation of motion holds for
the averages as for every sample, if its coefficients hardly change within a window.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.signal.windows import hann

from ...actuators.electromechanical import nonlinear
from ...ops.arrays import ARRAYS
from ...physics import drive, kinematics, loads, mechanics
from ...steppers.rigid import stops
from .estimation import Fit, each, weighted_fit
from .records import Array, RecordFile, refuse_clipped, refuse_magnitude

# Correlation time [windows] of averages of white noise: 1 + 2/6, as windows that overlap by half correlate by 1/6.
_OVERLAP = 4.0 / 3.0
# Largest plausible ratios of motor angle to travel and of current to its limit; above, a unit or a zero is wrong.
_OVER_TRAVEL, _OVER_CURRENT = 1.25, 2.0
WARM = 24.0  # degC, temperature for which friction.viscous and friction.coulomb are valid


class Averages(NamedTuple):
    """Means over windows [windows], in SI: time, motor angle, motor speed, motor acceleration, motor current."""

    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    current: Array
    slowest: Array  # lowest speed in each window, positive along the direction of motion

    def at(self, windows: Any) -> Averages:
        """Return the averages of some `windows`: indices, a slice or a mask."""
        return Averages(*(column[windows] for column in self))


def check(record: RecordFile, values: Mapping[str, Any]) -> None:
    """Raise RecordError for a clipped current, implausible magnitudes, no motion or a speed unlike the angle's rate."""
    p = nonlinear.ACTUATOR.namespace(values)
    travel = motor_travel(p)
    refuse_clipped(record, "motor_current")
    refuse_magnitude(record, "motor_current", _OVER_CURRENT * p.drive.current_limit,
                     f"{_OVER_CURRENT:g} times drive.current_limit")
    refuse_magnitude(record, "motor_angle", _OVER_TRAVEL * travel,
                     f"{_OVER_TRAVEL:g} times the travel to fin.stop_angle; or its zero is not at fin angle zero")
    moved = float(np.ptp(record["motor_angle"]))
    record.require(moved >= 0.02 * travel, f"there is hardly any motion: the motor turns by {moved:.3g} rad, of "
                   f"{2 * travel:.3g} rad between the stops; check the unit of motor_angle, and that the drive was "
                   "enabled")
    if "motor_speed" in record.columns:
        width = max(len(record) // 50, 3)
        rate, speed = (np.convolve(x, np.ones(width) / width, "valid") for x in (
            np.gradient(record["motor_angle"], record.step), record["motor_speed"]))
        ratio = float(rate @ speed) / float(rate @ rate)
        record.require(0.9 < ratio < 1.1, f"motor_speed is {ratio:.3g} times the rate of motor_angle: one of them has "
                       f"another unit than the header says (read as {record.units['motor_speed']} and "
                       f"{record.units['motor_angle']}; 1 rad/s is 9.55 rpm, 1 rad is 57.3 deg)")


def motor_travel(p: Any) -> float:
    """Return the larger of the motor angles [rad] at the two stops."""
    low, high = stops(ARRAYS, p)
    return float(max(-low, high))


def fin_angle(p: Any, motor_angle: Array) -> Array:
    """Return the fin angle [rad] at a motor angle [rad], by the geometry of lever and screw."""
    angle: Array = kinematics.fin_at(ARRAYS, p, motor_angle)
    return angle


def averages(record: RecordFile, width: int, hop: int) -> Averages:
    """Return the means over windows of `width` samples, `hop` samples apart."""
    window = hann(width + 2)[1:-1]
    window = window / window.sum()
    angle, step = record["motor_angle"], record.step

    def mean(x: Array) -> Array:
        return np.convolve(x, window[::-1], "valid")[::hop]

    speed = mean((angle[2:] - angle[:-2]) / (2.0 * step))
    # Over shorter times than a quarter of the window, an encoder's steps do not average out.
    part = max(width // 4, 1)
    local = (angle[part:] - angle[:-part]) / (part * step)
    views = np.lib.stride_tricks.sliding_window_view(local, width - part + 1)[::hop][:len(speed)]
    slowest = np.where(speed > 0.0, views.min(axis=1), -views.max(axis=1))
    inner = slice(1, -1)
    return Averages(mean(record["time"][inner]), mean(angle[inner]), speed,
                    mean((angle[2:] - 2.0 * angle[1:-1] + angle[:-2]) / step**2),
                    mean(record["motor_current"][inner]), slowest)


def namespace(values: Mapping[str, Any], temperature: Array | float) -> Any:
    """Return the parameters as attributes, at a temperature [degC] or at temperatures [windows]."""
    return nonlinear.ACTUATOR.namespace({**values, "friction.temperature": temperature})


def balance(p: Any, a: Averages) -> tuple[mechanics.Mechanics, Array]:
    """Return mechanics and friction torque [N.m] in windows: all other torques minus inertia times acceleration."""
    m = mechanics.coefficients(ARRAYS, p, a.angle, loads.level(ARRAYS, p))
    driving = drive.torque(p, a.current) + m.load + m.centrifugal * a.speed * a.speed
    return m, driving - m.inertia * a.acceleration


def fit_motion(values: Mapping[str, Any], names: Sequence[str], parts: Sequence[Averages],
               temperatures: Sequence[float], start: Array, scale: Array, owners: Sequence[int]) -> Fit:
    """Fit the parameters `names` to the equation of motion in windows in which the motor slides.

    `parts` are stretches of windows, `temperatures` [degC] those of the stretches. `values` has the other parameters.
    Residuals are torques [N.m]; for `start`, `scale` and `owners` see :func:`.estimation.weighted_fit`.
    """
    windows = Averages(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    lengths = [len(a.time) for a in parts]
    temperature, ends = np.repeat(temperatures, lengths), np.cumsum(lengths)[:-1]
    direction = np.sign(windows.speed)

    def residuals(x: Array) -> list[Array]:
        p = namespace({**values, **dict(zip(names, x.tolist(), strict=True))}, temperature)
        m, torque = balance(p, windows)
        friction = (direction * mechanics.breakaway(ARRAYS, p, m, direction)
                    + mechanics.damping(ARRAYS, p, m, direction) * windows.speed)
        return np.split(torque - friction, ends)

    return weighted_fit(names, each(residuals), start, scale, owners, _OVERLAP)
