"""Independent integrations of the actuator with Stribeck or LuGre friction in closed loop, by SciPy.

The equations are written in the fin angle. Encoder and compensation are off, the delay is a whole number of samples,
and the voltage stays within its limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, exp, radians, tan
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.default_actuator import THESIS_LOOPS

IDEAL = {**THESIS_LOOPS, "encoder.enabled": False, "compensation.gain": 0.0, "drive.transport_delay": 3e-3,
         "drive.supply_voltage": 900.0}


class Plant:
    """State: fin angle [rad], fin rate [rad/s], current [A], drive integral [V], bristle deflection [rad]."""

    def __init__(self, v: Mapping[str, Any], torque: float = 0.0, powered: bool = True) -> None:
        self.v, self.torque, self.powered = v, torque, powered
        self.arm, self.lead, self.start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
        self.motor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * self.lead**2
        self.fin = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
        self.y = np.zeros(5)
        self.i_ref = 0.0

    def ratio(self, angle: float) -> float:
        return float(self.arm / self.lead / cos(angle + self.start)**2)

    def coulomb(self, angle: float, way: float) -> float:
        name = "positive" if way > 0.0 else "negative"
        return float(sum(self.v[f"friction.coulomb.{name}[{n}]"] * (angle / radians(20.0))**n for n in range(7)))

    def applied(self, y: Any) -> float:
        """Return the torque [N.m] at the motor without friction and inertia."""
        return float(self.v["motor.torque_constant"] * y[2] + self.torque / self.ratio(y[0]))

    def slope(self, y: Any, dry: float, bristle: float = 0.0, stuck: bool = False) -> list[float]:
        """Return the state's rate of change under dry friction `dry` [N.m] against positive motion."""
        v, (angle, rate, current, integral) = self.v, y[:4]
        ratio, tangent = self.ratio(angle), tan(angle + self.start)
        viscous = v["friction.viscous.positive" if rate > 0.0 else "friction.viscous.negative"] * ratio * rate
        inertia = self.fin + self.motor * ratio**2
        swing = self.motor * ratio * 2.0 * ratio * tangent * rate**2
        turning = (ratio * (v["motor.torque_constant"] * current - viscous - dry) + self.torque - swing) / inertia
        motion = [0.0, 0.0] if stuck else [rate, turning]
        if not self.powered:
            return [*motion, 0.0, 0.0, bristle]
        demand = v["drive.kp"] * (self.i_ref - current) + integral
        assert abs(demand) < v["drive.supply_voltage"]
        back = v["motor.back_emf_constant"] * ratio * rate
        return [*motion, (demand - v["motor.resistance"] * current - back) / v["motor.inductance"],
                v["drive.ki"] * (self.i_ref - current), bristle]

    def closed_loop(self, stop: float, command: Callable[[float], float]) -> Any:
        """Return fin angle [rad] and motor speed [rad/s] at the samples."""
        v, integral, period = self.v, 0.0, self.v["controller.sample_time"]
        delayed = [0.0] * round(v["drive.transport_delay"] / period)
        rows = [(self.y[0], 0.0)]
        for k in range(round(stop / period)):
            motor_angle = self.arm / self.lead * (tan(self.y[0] + self.start) - tan(self.start))
            error = self.arm / self.lead * (tan(command(k * period) + self.start) - tan(self.start)) - motor_angle
            speed = v["controller.position.kp"] * error + integral
            integral += period * v["controller.position.ki"] * error
            measured = self.ratio(self.y[0]) * self.y[1]
            delayed.append(v["controller.velocity.kp"] * (speed - measured))
            self.i_ref = v["drive.current_gain"] * delayed.pop(0) + v["drive.current_offset"]
            self.move(period)
            rows.append((self.y[0], self.ratio(self.y[0]) * self.y[1]))
        return np.array(rows).T

    def move(self, interval: float) -> None:
        """Integrate over an interval [s]."""
        raise NotImplementedError


def stribeck(ratio: float, width: float, speed: float) -> float:
    """Return dry friction at a motor speed over that of fast sliding."""
    return 1.0 + (ratio - 1.0) * exp(-(speed / width)**2)


class Dry(Plant):
    """Dry friction that falls with speed; rest and breakaway are events."""

    way = 0.0

    def level(self, angle: float, way: float, speed: float) -> float:
        return self.coulomb(angle, way) * stribeck(self.v["stribeck.static_ratio"], self.v["stribeck.speed"], speed)

    def move(self, interval: float) -> None:
        left = interval
        while left > 1e-15:
            if self.way == 0.0:
                applied = self.applied(self.y)
                for way in (1.0, -1.0):
                    if applied * way >= self.level(self.y[0], way, 0.0) * (1.0 - 1e-10):
                        self.way = way
            left -= self._slide(left) if self.way else self._stick(left)

    def _run(self, interval: float, slope: Any, events: Any) -> float:
        for event in events:
            event.terminal = True
        done = solve_ivp(slope, (0.0, interval), self.y, "DOP853", events=events, rtol=1e-11, atol=1e-13,
                         max_step=interval / 2)
        self.y = done.y[:, -1]
        return float(done.t[-1])

    def _stick(self, interval: float) -> float:
        self.y[1] = 0.0

        def margin(way: float) -> Any:
            return lambda _, y: way * self.applied(y) - self.level(y[0], way, 0.0)

        events = [margin(1.0), margin(-1.0)]
        return self._run(interval, lambda _, y: self.slope(y.tolist(), 0.0, stuck=True), events)

    def _slide(self, interval: float) -> float:
        way = self.way

        def slope(_: float, state: Any) -> list[float]:
            y = state.tolist()  # floats take half the time of NumPy's numbers
            return self.slope(y, way * self.level(y[0], way, self.ratio(y[0]) * y[1]))

        def rest(_: float, y: Any) -> float:
            return float(way * y[1])

        rest.direction = -1.0  # type: ignore[attr-defined]
        duration = self._run(interval, slope, [rest])
        if duration < interval * (1.0 - 1e-12) or way * self.y[1] <= 0.0:
            self.y[1], self.way = 0.0, 0.0
        return duration


class Bristle(Plant):
    """LuGre friction."""

    def __init__(self, v: Mapping[str, Any], torque: float = 0.0, powered: bool = True) -> None:
        super().__init__(v, torque, powered)
        self.lugre = {name.partition(".")[2]: value for name, value in v.items() if name.startswith("lugre.")}

    def rate(self, y: Any) -> tuple[float, float]:
        """Return dz/dt [rad/s] and the bristles' torque [N.m]."""
        lugre, ratio = self.lugre, self.ratio(y[0])
        speed, z = ratio * y[1], y[4]
        level = (self.coulomb(y[0], speed) * stribeck(lugre["static_ratio"], lugre["stribeck_speed"], speed)
                 + self.v["friction.fin_coulomb"] / ratio)
        rate = speed - lugre["stiffness"] * abs(speed) / level * z
        damping = lugre["damping"] / (1.0 + lugre["damping"] * abs(speed) / level)
        return rate, lugre["stiffness"] * z + damping * rate

    def move(self, interval: float) -> None:
        def slope(_: float, state: Any) -> list[float]:
            y = state.tolist()
            rate, torque = self.rate(y)
            return self.slope(y, torque, rate)

        self.y = solve_ivp(slope, (0.0, interval), self.y, "Radau", rtol=1e-9, atol=1e-12).y[:, -1]
