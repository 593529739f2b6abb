"""The friction measurement test setup (section 3.3.1): a rig's motor turns the screw, the actuator's drive is off.

    (J_r + J) dw/dt = K_r i - C_r sgn w - b_r w - actuator's friction         i = clip(k_p e + k_i int e), e = n - w

The rig's motor is on the screw's axis, so its inertia J_r is added to the rotor's. At constant speed the actuator's
friction is the torque of the rig's motor, from the current, less the friction of this motor: the method of section 3.3.
A sweep goes from one end of the range to the other and back; acceleration, dwell and range are estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, nan, pi
from typing import Any

import numpy as np

from emcas_fmu.actuators.electromechanical import nonlinear
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import kinematics
from emcas_fmu.simulation import Array

from .rigs import rig_values
from .stepping import SteppedActuator

RPM = 2.0 * pi / 60.0
REACH = 0.95  # share of command.limit that a sweep covers in both directions
_DWELL = 0.1  # s at rest before, between and after
_ABOUT_ZERO = 0.2  # share of command.limit: largest fin angle in means, the same at every speed
_SETTLES = 0.05  # s, time after the ramp in which the speed loop settles


@dataclass(frozen=True)
class Sweep:
    """A sweep up and down: signals over time [s], SI.

    `speed` [rad/s] is the commanded speed, `temperature` is in degC. `steady` has masks of the rows at constant speed,
    by direction (1 and -1). Means are over fin angles within +-`about_zero` [rad].
    """

    speed: float
    temperature: float
    time: Array
    current: Array
    motor_speed: Array
    motor_angle: Array
    fin_angle: Array
    commanded: Array
    steady: Mapping[int, Any]
    about_zero: float

    def friction(self, direction: int) -> Array:
        """Return the actuator's friction torque [N.m] in the rows at constant speed, from the rig's current."""
        rig, rows = rig_values("friction_motor"), self.steady[direction]
        turning = np.abs(self.motor_speed[rows])
        torque: Array = direction * rig.torque_constant * self.current[rows] - rig.coulomb - rig.viscous * turning
        return torque

    def mean_friction(self, direction: int) -> float:
        """Return the mean friction [N.m] about fin angle 0; nan if the speed is not constant there."""
        return self._mean(self.friction(direction), direction)

    def mean_current(self, direction: int) -> float:
        """Return the rig's mean current [A] about fin angle 0; nan if the speed is not constant there."""
        return self._mean(self.current[self.steady[direction]], direction)

    def _mean(self, column: Array, direction: int) -> float:
        inside = np.abs(self.fin_angle[self.steady[direction]]) < self.about_zero
        return float(np.mean(column[inside])) if inside.any() else nan


def sweep(values: Mapping[str, Any], rpm: float, temperature: float) -> Sweep:
    """Return a sweep of the whole range up and down at a motor speed [rpm] and a temperature [degC]."""
    rig = rig_values("friction_motor")
    start = -REACH * values["command.limit"]
    values = {**values, "friction.temperature": temperature, "fin.start_angle": start,
              "inertia.motor": values["inertia.motor"] + rig.inertia}
    p = nonlinear.ACTUATOR.plant(values)
    low, high = (float(kinematics.motor_angle(FLOATS, p, angle)) for angle in (start, -start))
    commanded, constant = _profile(rpm * RPM, high - low, rig.acceleration, rig.sample_time)
    actuator = SteppedActuator(values, rig.sample_time)
    speed_index, angle_index = actuator.index("motor_speed"), actuator.index("motor_angle")
    currents, integral = [], 0.0
    for reference in commanded:
        speed, angle = actuator.now[speed_index], actuator.now[angle_index]
        error = reference - speed
        unlimited = rig.speed_kp * error + integral
        current = min(max(unlimited, -rig.current_limit), rig.current_limit)
        if current == unlimited:
            integral += rig.speed_ki * rig.sample_time * error
        currents.append(current)
        torque = _net(rig, rig.torque_constant * current, speed)
        ratio = kinematics.reduction_ratio(FLOATS, p, kinematics.lever_tangent(FLOATS, p, angle))
        actuator.run(aero_torque=float(torque * ratio), enable=False)
    columns = actuator.columns()
    return Sweep(rpm * RPM, temperature, columns["time"][:-1], np.array(currents), columns["motor_speed"][:-1],
                 columns["motor_angle"][:-1], columns["fin_angle"][:-1], commanded, constant,
                 _ABOUT_ZERO * float(values["command.limit"]))


def _net(rig: Any, torque: float, speed: float) -> float:
    """Return the torque [N.m] of the rig's motor on the screw: motor torque minus the motor's friction."""
    if speed == 0.0:
        return torque - copysign(min(abs(torque), rig.coulomb), torque)
    return float(torque - copysign(rig.coulomb, speed) - rig.viscous * speed)


def _profile(speed: float, travel: float, acceleration: float, step: float) -> tuple[Array, dict[int, Any]]:
    """Return the commanded speed [rad/s] for a travel [rad] up and down, and masks of constant speed by direction."""
    ramp = min(speed / acceleration, (travel / acceleration) ** 0.5)
    duration = travel / (acceleration * ramp) + ramp  # of a trapezium
    time = np.arange(round((3.0 * _DWELL + 2.0 * duration) / step)) * step
    commanded, constant = np.zeros(len(time)), dict[int, Any]()
    for direction, begin in ((1, _DWELL), (-1, 2.0 * _DWELL + duration)):
        since = time - begin
        commanded += direction * acceleration * np.clip(np.minimum(since, duration - since), 0.0, ramp)
        settled = min(_SETTLES, 0.25 * (duration - 2.0 * ramp))
        constant[direction] = (since > ramp + settled) & (since < duration - ramp - step)
    return commanded, constant
