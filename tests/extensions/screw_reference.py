"""An independent integration of an actuator with screw losses and Stribeck friction, by SciPy.

DOP853 at 1e-10 integrates the fin angle between events, which are rest and breakaway of motor and fin. In the elastic
line only the screw stretches, and there is no gap.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, exp, radians, tan
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.default_actuator import THESIS_LOOPS

IDEAL = {**THESIS_LOOPS, "encoder.enabled": False, "compensation.gain": 0.0, "drive.transport_delay": 3e-3}
_ROUNDING = 1e-9  # N.m, by which a torque at an event may be less than breakaway


class Screw:
    """State: fin angle and rate, current [A], drive integral [V]; elastic also: motor angle and speed. In rad, s."""

    def __init__(self, v: Mapping[str, Any], torque: float, line: bool) -> None:
        self.v, self.torque, self.line = v, torque, line
        self.arm, self.lead, self.start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
        self.rotor, self.nut = v["inertia.motor"] + v["inertia.screw"], v["mass.nut"]
        self.fin = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
        table = {name: [v[f"friction.table.{name}[{i}]"] for i in range(5)]
                 for name in ("temperature", "coulomb", "viscous")}
        self.cold = {name: float(np.interp(v["friction.temperature"], table["temperature"], table[name]))
                     for name in ("coulomb", "viscous")}
        self.y = np.zeros(6 if line else 4)
        self.i_ref = 0.0
        self.way = self.fin_way = 0.0  # sign of motion, 0 at rest; a rigid line has only `way`

    def lever(self, fin: float) -> float:
        """Return the fork's lever [m], nut speed over fin rate."""
        return float(self.arm / cos(fin + self.start)**2)

    def motor_angle(self, fin: float) -> float:
        """Return the motor angle [rad] of a rigid line at a fin angle."""
        return float(self.arm / self.lead * (tan(fin + self.start) - tan(self.start)))

    def motor(self, y: Any) -> tuple[float, float]:
        """Return motor angle and speed."""
        return (y[4], y[5]) if self.line else (self.motor_angle(y[0]), self.lever(y[0]) / self.lead * y[1])

    def net(self, y: Any, way: float) -> float:
        """Return the torque [N.m] on the rotor without the screw's, for motion in direction `way`."""
        v, side, w = self.v, "positive" if way > 0.0 else "negative", self.motor(y)[1]
        level = sum(v[f"friction.coulomb.{side}[{n}]"] * (y[0] / radians(20.0))**n for n in range(7))
        excess = (v.get("stribeck.static_ratio", 1.0) - 1.0) * exp(-(w / v.get("stribeck.speed", 1.0))**2)
        dry = level * self.cold["coulomb"] * (1.0 + excess)
        return float(v["motor.torque_constant"] * y[2] - way * dry
                     - v[f"friction.viscous.{side}"] * self.cold["viscous"] * w)

    def at_motor(self, force: float, way: float) -> float:
        """Return the torque [N.m] of an axial force [N] on the rotor, against positive motion."""
        share = 1.0 / self.v["efficiency.forward"] if force * way > 0.0 else self.v["efficiency.backward"]
        return float(share * force * self.lead)

    def screw_force(self, y: Any) -> float:
        """Return the force [N] of the screw on the fork."""
        stretch = self.lead * (y[4] - self.motor_angle(y[0]))
        rate = self.lead * y[5] - self.lever(y[0]) * y[1]
        return float(stretch / self.v["drive_line.axial_compliance"] + self.v["drive_line.axial_damping"] * rate)

    def hinge_resistance(self, y: Any, way: float) -> float:
        """Return the moment [N.m] about the hinge against positive motion, without inertia and screw."""
        return float(self.v["friction.fin_viscous"] * y[1] + way * self.v["friction.fin_coulomb"] - self.torque)

    def nut_acceleration(self, at_rest: float, mass: float, bend: float, net: float) -> float:
        """Return the nut acceleration less `bend` [m/s2].

        It is x in (rotor/lead) (x + bend) = net - at_motor(at_rest + mass x).
        """
        forward, backward = ((net - self.rotor * bend / self.lead - share * self.lead * at_rest)
                             / (self.rotor / self.lead + share * self.lead * mass)
                             for share in (1.0 / self.v["efficiency.forward"], self.v["efficiency.backward"]))
        return float(forward if (at_rest + mass * forward) * self.way > 0.0 else backward)

    def slope(self, y: Any) -> list[float]:
        """Return the state's rate of change in the present directions of motion."""
        v, way, (fin, rate, i, xi) = self.v, self.way, y[:4]
        lever, w = self.lever(fin), self.motor(y)[1]
        demand = v["drive.kp"] * (self.i_ref - i) + xi
        limit = v["drive.supply_voltage"]
        winding = [(min(max(demand, -limit), limit) - v["motor.resistance"] * i - v["motor.back_emf_constant"] * w)
                   / v["motor.inductance"], v["drive.ki"] * (self.i_ref - i) if abs(demand) < limit else 0.0]
        if not self.line:
            # x is the nut's acceleration without its part at a constant fin rate.
            bend = 2.0 * lever * tan(fin + self.start) * rate**2
            force = self.hinge_resistance(y, way) / lever + self.nut * bend
            x = self.nut_acceleration(force, self.fin / lever**2 + self.nut, bend, self.net(y, way)) if way else 0.0
            return [rate if way else 0.0, x / lever, *winding]
        force = self.screw_force(y)
        x = self.nut_acceleration(force, self.nut, 0.0, self.net(y, way)) if way else 0.0
        turning = (lever * force - self.hinge_resistance(y, self.fin_way)) / self.fin if self.fin_way else 0.0
        return [rate if self.fin_way else 0.0, turning, *winding, w, x / self.lead]

    def margin(self, y: Any, way: float) -> float:
        """Return the torque [N.m] beyond breakaway of a motor at rest, in direction `way`."""
        force = self.screw_force(y) if self.line else self.hinge_resistance(y, way) / self.lever(y[0])
        return way * (self.net(y, way) - self.at_motor(force, way))

    def fin_margin(self, y: Any, way: float) -> float:
        """Return the moment [N.m] beyond breakaway of an elastic line's fin at rest, in direction `way`."""
        return way * (self.lever(y[0]) * self.screw_force(y) - self.hinge_resistance(y, way))

    def move(self, interval: float) -> None:
        """Integrate over an interval [s]."""
        left = interval
        while left > 1e-14:
            for way in (1.0, -1.0):
                if not self.way and self.margin(self.y, way) >= -_ROUNDING:
                    self.way = way
                if self.line and not self.fin_way and self.fin_margin(self.y, way) >= -1e3 * _ROUNDING:
                    self.fin_way = way
            events: list[Any] = []
            if self.way:
                events.append(lambda _, y: -self.way * self.motor(y)[1])
            else:
                events += [lambda _, y, way=way: self.margin(y, way) for way in (1.0, -1.0)]
            dry = self.line and self.v["friction.fin_coulomb"] > 0.0
            if dry and self.fin_way:
                events.append(lambda _, y: -self.fin_way * y[1])
            elif dry:
                events += [lambda _, y, way=way: self.fin_margin(y, way) for way in (1.0, -1.0)]
            for event in events:
                event.terminal, event.direction = True, 1.0
            done = solve_ivp(lambda _, y: self.slope(y), (0.0, left), self.y, "DOP853", events=events, rtol=1e-10,
                             atol=1e-12, max_step=left / 3.0)
            self.y, left = done.y[:, -1].copy(), left - done.t[-1]
            ended = [bool(len(times)) for times in done.t_events]
            speed_index = 5 if self.line else 1
            # A body that starts and turns back at once is at rest, too.
            if self.way and (ended[0] or self.way * self.y[speed_index] < 0.0):
                self.way, self.y[speed_index] = 0.0, 0.0
            if dry and self.fin_way and (ended[-1] or self.fin_way * self.y[1] < 0.0):
                self.fin_way, self.y[1] = 0.0, 0.0


def motion(v: Mapping[str, Any], stop: float, command: Any, torque: float, line: bool = False) -> Any:
    """Return fin angle [rad] and motor speed [rad/s] at the samples under a command [rad] of time and a moment [N.m].

    Encoder and compensation are off; the delay is a whole number of samples.
    """
    plant, integral, period = Screw(v, torque, line), 0.0, v["controller.sample_time"]
    rows, delayed = [(0.0, 0.0)], [0.0] * round(v["drive.transport_delay"] / period)
    for k in range(round(stop / period)):
        theta, w = plant.motor(plant.y)
        raw = v["controller.position.kp"] * (plant.motor_angle(command(k * period)) - theta) + integral
        speed = float(np.clip(raw, -v["controller.speed_limit"], v["controller.speed_limit"]))
        integral += period * (v["controller.position.ki"] * (plant.motor_angle(command(k * period)) - theta)
                              + v["controller.antiwindup"] * (speed - raw))
        delayed.append(float(np.clip(v["controller.velocity.kp"] * (speed - w), -10.0, 10.0)))
        plant.i_ref = float(np.clip(v["drive.current_gain"] * delayed.pop(0) + v["drive.current_offset"], -60.0, 60.0))
        plant.move(period)
        rows.append((plant.y[0], plant.motor(plant.y)[1]))
    return np.array(rows).T
