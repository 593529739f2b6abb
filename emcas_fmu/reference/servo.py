"""Integration of the servo from event to event: motor and fin under friction, with play between them.

The equations of docs/model/servo.md are written again here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from .actuator import ReferenceActuator, Sample
from .events import Accuracy, Body, Event, Scalar, StateVector, band
from .vehicle import Surroundings, clip, hinge_friction, hinge_moment, masses_of, sign, surroundings

FIN, RATE, MOTOR, SPEED = range(4)


class Mode(NamedTuple):
    """Directions of motor and fin, 0 at rest; side on which the gear is in contact, 0 within its play."""

    motor: int = 0
    fin: int = 0
    contact: int = 0


class Servo(ReferenceActuator):
    """Firmware, motor, gear and fin."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1.0, 100.0), 1e-3)
    names = ("fin_angle", "fin_rate", "motor_angle", "motor_speed", "duty")

    def __init__(self, parameters: Mapping[str, Scalar]):
        self.p = p = parameters
        self.ratio, self.masses = p["gear.ratio"], masses_of(p)
        self.inertia = sum(p[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
        self.rotor = p["inertia.motor"] * self.ratio**2
        self.half_play = p["gear.backlash"] / 2.0
        self.hinge_dry, self.hinge_viscous = hinge_friction(p)
        self.bodies = (Body("motor", lambda y: y[SPEED], self.excess_of_motor, {SPEED: 0.0}),
                       Body("fin", lambda y: y[RATE], self.excess_of_fin, {RATE: 0.0}, FIN, p["fin.stop_angle"]))

    def start(self) -> tuple[StateVector, Mode]:
        angle = self.p["fin.start_angle"]
        return [angle, 0.0, self.ratio * angle, 0.0], Mode()

    def controller(self, nominal: Servo) -> Sample:
        """Return the firmware: PID on counts with a dead band, and a limited duty cycle [1]."""
        p = nominal.p
        period, per_rad, limit = p["controller.sample_time"], p["encoder.counts"] / (2.0 * math.pi), p["pwm.limit"]

        def counted(angle: float) -> float:
            return math.floor(angle * per_rad + 0.5) if p["encoder.enabled"] else angle * per_rad

        last, integral = counted(p["fin.start_angle"]), 0.0

        def sample(y: StateVector, command: float, enable: bool) -> float:
            nonlocal last, integral
            now = counted(y[FIN])
            error = counted(clip(command, p["command.limit"])) - now
            if abs(error) < p["controller.dead_band"]:
                error = 0.0
            demand = p["controller.kp"] * error + integral - p["controller.kd"] * (now - last) / period
            if abs(demand) <= limit or demand * error <= 0.0:
                integral += period * p["controller.ki"] * error
            last, integral = now, integral * enable
            return enable * clip(demand, limit) / p["pwm.full"]

        return sample

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return loads and supply from a row of inputs, with a delayed duty cycle [1] as reference."""
        return surroundings(self.p, row, reference, self.supply[0])

    def outputs(self, y: StateVector, _around: Surroundings) -> StateVector:
        return y

    def windup(self, y: StateVector) -> float:
        """Return the motor's angle over the gear ratio minus the fin's [rad]."""
        return y[MOTOR] / self.ratio - y[FIN]

    def driven(self, y: StateVector, around: Surroundings) -> float:
        """Return the motor's torque, referred to the output [N.m]."""
        if not around.enable:
            return 0.0
        p, duty = self.p, around.reference
        lost = p["motor.asymmetry"]
        share = 1.0 - abs(lost) if sign(lost) * sign(duty) < 0 else 1.0
        return share * p["motor.stall_torque"] * (duty * around.supply / p["motor.nominal_voltage"]
                                                  - y[SPEED] / self.ratio / p["motor.no_load_speed"])

    def transmitted(self, y: StateVector, contact: int) -> float:
        """Return the torque from the gear to the fin [N.m]."""
        if not contact and self.half_play:
            return 0.0
        p = self.p
        return (p["gear.stiffness"] * (self.windup(y) - contact * self.half_play)
                + p["gear.damping"] * (y[SPEED] / self.ratio - y[RATE]))

    def rubbing(self, y: StateVector, contact: int, around: Surroundings) -> float:
        """Return the dry friction of the gear, referred to the output [N.m]."""
        p = self.p
        mean = (abs(self.driven(y, around)) + abs(self.transmitted(y, contact))) / 2.0
        share = p["friction.gear_load"] + p["friction.gear_load_rise"] * min(mean / p["motor.stall_torque"], 1.0)
        slow: float = math.exp(-abs(y[SPEED]) / self.ratio / p["friction.stribeck_speed"])
        return (p["friction.gear"] + share * mean) * (1.0 + p["friction.stribeck_share"] * slow)

    def on_motor(self, y: StateVector, contact: int, around: Surroundings) -> float:
        """Return the torque on the motor without dry friction, referred to the output [N.m]."""
        return (self.driven(y, around) - self.transmitted(y, contact)
                - self.p["friction.gear_viscous"] * y[SPEED] / self.ratio - self.rotor * around.faster[1] / self.ratio)

    def on_fin(self, y: StateVector, contact: int, around: Surroundings) -> float:
        """Return the torque on the fin without dry friction [N.m]."""
        return (self.transmitted(y, contact) + hinge_moment(self.masses, self.inertia, y[FIN], around)
                - self.hinge_viscous * y[RATE])

    def excess_of_motor(self, y: StateVector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the torque [N.m] on the resting motor towards `side` beyond stiction, referred to the output."""
        return side * self.on_motor(y, mode.contact, around) - self.rubbing(y, mode.contact, around)

    def excess_of_fin(self, y: StateVector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the torque [N.m] on the resting fin towards `side` beyond stiction."""
        return side * self.on_fin(y, mode.contact, around) - self.hinge_dry

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        motor = (self.on_motor(y, mode.contact, around) - mode.motor * self.rubbing(y, mode.contact, around)
                 ) / self.rotor * self.ratio
        fin = (self.on_fin(y, mode.contact, around) - mode.fin * self.hinge_dry) / self.inertia
        return y[RATE], fin * bool(mode.fin), y[SPEED], motor * bool(mode.motor)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        half, events = self.half_play, super().events(mode, around)
        return [*events, *band(mode, "contact", self.windup, -half, half)] if half else events


simulate = Servo.simulate
