"""The equation of motion averaged over windows, for records of motor angle and current.

A smooth window phi (Hann, sum 1, zero with its slope at both ends) averages the current, the
central differences of the angle and its second differences alike. Summed by parts the latter are
the angle under phi' and phi'' (Shinbrot 1957, modulating functions): acceleration is had without
differentiating an encoder's steps, and what the equation of motion balances at each instant it
balances in the average.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import hann

from ...actuators.electromechanical import nonlinear
from ...ops.arrays import ARRAYS as ARRAYS
from ...physics import drive, kinematics, loads, mechanics
from .records import Array, Record, derivative, refuse_clipped, refuse_magnitude

# Windows that overlap by half share a sixth of their variance: of white noise too, 1 + 2/6 windows make one.
OVERLAP = 4.0 / 3.0
# Motor angle beyond the stops, in shares of the travel, at which the unit or the zero must be wrong.
_OVER_TRAVEL = 1.25
_OVER_CURRENT = 2.0


@dataclass(frozen=True)
class Averages:
    """Windowed means, each an array over windows: motor angle, speed, acceleration, current, time; SI."""

    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    current: Array
    slowest: Array  # least speed [rad/s] along the direction of motion inside a window

    def at(self, chosen: Any) -> Averages:
        """Some of the windows."""
        return Averages(*(column[chosen] for column in (self.time, self.angle, self.speed, self.acceleration,
                                                        self.current, self.slowest)))


def check(record: Record, values: Mapping[str, Any]) -> None:
    """Refuse current or angle that are clipped, of a wrong magnitude or at rest, and a speed that denies the angle."""
    p = nonlinear.ACTUATOR.namespace(values)
    travel = motor_travel(p)
    refuse_clipped(record, "motor_current")
    refuse_magnitude(record, "motor_current", _OVER_CURRENT * p.drive.current_limit,
                     f"{_OVER_CURRENT:g} times drive.current_limit")
    refuse_magnitude(record, "motor_angle", _OVER_TRAVEL * travel,
                     f"{_OVER_TRAVEL:g} times the travel to fin.stop_angle; or its zero is not at fin angle zero")
    moved = float(np.ptp(record["motor_angle"]))
    if moved < 0.02 * travel:
        raise record.fail(f"there is no motion to speak of: the motor turns by {moved:.3g} rad of the {2 * travel:.3g} "
                          "rad between the stops; check the unit of motor_angle, and that the drive was enabled")
    if "motor_speed" in record:
        derived = derivative(record, "motor_angle")
        smooth = max(len(record) // 50, 3)
        kernel = np.ones(smooth) / smooth
        ours, theirs = (np.convolve(x, kernel, "valid") for x in (derived, record["motor_speed"]))
        ratio = float(ours @ theirs) / float(ours @ ours)
        if not 0.9 < ratio < 1.1:
            raise record.fail(f"motor_speed is {ratio:.3g} times the rate of motor_angle: one of them has another unit "
                              f"than the header says (read as {record.written['motor_speed']} and "
                              f"{record.written['motor_angle']}; 1 rad/s is 9.55 rpm, 1 rad is 57.3 deg)")


def motor_travel(p: Any) -> float:
    """The larger motor angle [rad] of the two stops."""
    from ...steppers.rigid import stops

    low, high = stops(ARRAYS, p)
    return float(max(-low, high))


def fin_angle(p: Any, motor_angle: Array) -> Array:
    """Fin angle [rad] by the geometry of lever and screw."""
    found: Array = kinematics.fin_angle(ARRAYS, p, kinematics.lever_tangent(ARRAYS, p, motor_angle))
    return found


def averages(record: Record, width: int, hop: int) -> Averages:
    """Windows of `width` samples, one every `hop`."""
    window = hann(width + 2)[1:-1]
    window = window / window.sum()
    angle, step = record["motor_angle"], record.step
    speed = (angle[2:] - angle[:-2]) / (2.0 * step)
    second = (angle[2:] - 2.0 * angle[1:-1] + angle[:-2]) / step**2

    def mean(x: Array) -> Array:
        found: Array = np.convolve(x, window[::-1], "valid")[::hop]
        return found

    middle = mean(speed)
    # A quarter of the window: over fewer samples an encoder's steps are not yet averaged out.
    part = max(width // 4, 1)
    local = (angle[part:] - angle[:-part]) / (part * step)
    views = np.lib.stride_tricks.sliding_window_view(local, width - part + 1)[::hop][:len(middle)]
    slowest = np.where(middle > 0.0, views.min(axis=1), -views.max(axis=1))
    inner = slice(1, -1)
    return Averages(mean(record["time"][inner]), mean(angle[inner]), middle, mean(second),
                    mean(record["motor_current"][inner]), slowest)


def joined(parts: Sequence[Averages]) -> Averages:
    """Windows of several stretches, one after the other."""
    return Averages(*(np.concatenate(columns) for columns in zip(
        *((a.time, a.angle, a.speed, a.acceleration, a.current, a.slowest) for a in parts), strict=True)))


def balance(values: Mapping[str, Any], a: Averages, temperature: Array | float) -> tuple[mechanics.Mechanics, Array]:
    """The mechanics at the windows, and the torque [N.m] left for friction: what drives less what accelerates."""
    p = nonlinear.ACTUATOR.namespace({**values, "friction.temperature": temperature})
    f_x, f_z = loads.specific_force(ARRAYS, p, (0.0, 0.0, 0.0), 0.0, 0.0)
    m = mechanics.coefficients(ARRAYS, p, a.angle, 0.0, f_x, f_z)
    driving = drive.torque(p, a.current) + m.load + m.centrifugal * a.speed * a.speed
    return m, driving - m.inertia * a.acceleration


def resisting(values: Mapping[str, Any], a: Averages, m: mechanics.Mechanics, temperature: Array | float) -> Array:
    """Friction torque [N.m] of the model at sliding windows, along positive motor angle."""
    p = nonlinear.ACTUATOR.namespace({**values, "friction.temperature": temperature})
    direction = np.sign(a.speed)
    found: Array = (direction * mechanics.breakaway(ARRAYS, p, m, direction)
                    + mechanics.damping(ARRAYS, p, m, direction) * a.speed)
    return found


def stretches(chosen: NDArray[np.bool_], fewest: int) -> list[NDArray[np.int64]]:
    """Indices of each run of consecutive chosen windows that has at least `fewest`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], chosen.astype(int), [0]))))
    return [np.arange(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= fewest]
