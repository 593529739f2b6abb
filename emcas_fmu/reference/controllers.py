"""Sampled bus, encoder, position loop and velocity loop of the thesis's actuator (section 4.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from . import filters
from .events import Scalar
from .screw import Screw
from .vehicle import clip


def whole_samples(p: Mapping[str, Scalar], name: str) -> int:
    """Return the parameter `name`, a time [s], in whole sample times; a half is rounded up."""
    return math.floor(p[name] / p["controller.sample_time"] + 0.5)


class Bus:
    """Command bus from the host to the controllers, with update time, resolution and latency."""

    def __init__(self, p: Mapping[str, float]):
        self.latency, self.every = (whole_samples(p, f"command.{name}") for name in ("latency", "update_time"))
        self.resolution = p["command.resolution"]
        self.sent = [p["fin.start_angle"]] * self.latency  # rad, the newest last
        self.count = 0

    def arrived(self, command: float) -> float:
        """Return the command [rad] that the controllers read at this sample, while the host sends `command` [rad]."""
        if self.count % max(self.every, 1) == 0:
            if self.resolution:
                command = self.resolution * math.floor(command / self.resolution + 0.5)
            self.sent.append(command)
        else:
            self.sent.append(self.sent[-1])
        self.count += 1
        return self.sent[-1 - self.latency]


class Controllers:
    """Encoder, position PI and velocity PI with friction compensation (section 4.2), load observer and filters.

    The sensors measure `plant`, the actuator as built; the controllers compute with the `nominal` one.
    """

    def __init__(self, plant: Screw, nominal: Screw):
        self.plant, self.nominal, self.p = plant, nominal, nominal.p
        self.period = self.p["controller.sample_time"]
        self.count_size = 2.0 * math.pi / (self.p["encoder.pulses"] * self.p["encoder.multiplier"])
        self.on_fin = bool(self.p["encoder.on_fin"])
        delta = self.p["fin.start_angle"]
        self.counts = self._counts(delta)
        self.update_samples = max(1, whole_samples(self.p, "command.update_time"))
        self.observer, self.notch = filters.of(self.p)
        self._reset(*self._measure(delta, 0.0), delta)

    def _reset(self, fin: float, motor: float, speed: float, command: float) -> None:
        """Reset the loops to rest at measured angles [rad] of fin and motor.

        The load observer begins at a motor `speed` [rad/s] without load, the lagged target at the `command` [rad].
        """
        weight = self.p["controller.position.setpoint_weight"]
        self.integral = self.p["controller.position.kp"] * motor * (1.0 - weight)  # rad/s
        self.velocity_integral = 0.0  # V
        if self.notch:
            self.notch.reset()
        self.target = self._target(command)  # rad, of the motor, lagged
        self.momentum = self._inertia(fin) * speed  # N.m.s, of the load observer

    def _target(self, command: float) -> float:
        """Return the motor angle [rad] for a command [rad]."""
        return self.nominal.motor_angle(clip(command, self.p["command.limit"]))

    def _inertia(self, fin: float) -> float:
        """Return the nominal inertia at the motor [kg.m2]."""
        return self.nominal.motor_inertia + self.nominal.fin_inertia / self.nominal.ratio(fin) ** 2

    def _counts(self, delta: float) -> int:
        """Return the counts of the motor's encoder at fin angle `delta` [rad]."""
        return math.floor(self.plant.motor_angle(delta) / self.count_size)

    def _measure(self, delta: float, omega: float) -> tuple[float, float, float]:
        """Return measured fin angle [rad], motor angle [rad] and motor speed [rad/s]."""
        previous, self.counts = self.counts, self._counts(delta)
        if not self.p["encoder.enabled"]:
            motor = (self.nominal if self.on_fin else self.plant).motor_angle(delta)
            return self.nominal.fin_angle(motor), motor, self.plant.ratio(delta) * omega
        speed = (self.counts - previous) * self.count_size / self.period
        if self.on_fin:
            angle = math.floor(delta / self.count_size) * self.count_size
            return angle, self.nominal.motor_angle(angle), speed
        angle = self.counts * self.count_size
        return self.nominal.fin_angle(angle), angle, speed

    def fed_forward(self, feedback: float, reference: float) -> tuple[float, float]:
        """Return the speed [rad/s] for the friction compensation, and a reference [V] that is fed forward.

        `feedback` and `reference` [rad/s] are speed references; the latter includes the command's rate and is limited.
        """
        return reference, 0.0

    def sample(self, delta: float, omega: float, command: float, enable: bool, current: float = 0.0) -> float:
        """Return the DAC value u_k [V] of one sample.

        Fin angle `delta` [rad], fin rate `omega` [rad/s] and motor `current` [A] are true values; `command` [rad] is
        the one that arrived on the bus.
        """
        p = self.p
        fin, motor, speed = self._measure(delta, omega)
        self.measured = fin
        if self.observer:
            speed = self.observer.speed(speed, p["motor.torque_constant"] * current, self._inertia(fin))
        if not enable:
            self._reset(fin, motor, speed, command)
            return 0.0
        target = self._target(command)
        weighted = p["controller.position.setpoint_weight"] * target - motor
        feedback = p["controller.position.kp"] * weighted + self.integral
        # The command's rate, lagged by the time between its updates.
        ahead = target - self.target
        command_rate = p["controller.position.velocity_feedforward"] * ahead / (self.update_samples * self.period)
        self.target += ahead / self.update_samples
        reference = clip(feedback + command_rate, p["controller.speed_limit"])
        friction_speed, feedforward = self.fed_forward(feedback, reference)
        friction = self.nominal.motor_coulomb(fin, 1 if friction_speed > 0.0 else -1)
        compensation = p["compensation.gain"] * friction * clip(friction_speed / p["compensation.speed_band"], 1.0)
        compensation /= p["motor.torque_constant"] * p["drive.current_gain"]
        gain = p["controller.velocity.kp"]
        u = gain * (reference - speed) + self.velocity_integral + compensation + feedforward
        torque_constant, bandwidth = p["motor.torque_constant"], p["controller.load_observer"]
        if bandwidth:
            load = bandwidth * (self._inertia(fin) * speed - self.momentum)
            u -= load / (torque_constant * p["drive.current_gain"])
            compensation_torque = compensation * torque_constant * p["drive.current_gain"]
            self.momentum += self.period * (torque_constant * current + load - compensation_torque)
        self.limited = abs(feedback + command_rate) > p["controller.speed_limit"] or abs(u) > p["drive.reference_limit"]
        # The drive can follow `possible`, the reference within the limits of DAC and current.
        limited = clip(u, p["drive.reference_limit"])
        offset, slope = p["drive.current_offset"], p["drive.current_gain"]
        possible = (clip(slope * limited + offset, p["drive.current_limit"]) - offset) / slope
        excess = possible - u  # V
        tracking = p["controller.drive_antiwindup"]  # 1/s
        integral_gain, velocity_integral_gain = p["controller.position.ki"], p["controller.velocity.ki"]
        if integral_gain:  # without integral action the integral stays constant
            self.integral += self.period * (
                integral_gain * (target - motor)
                + p["controller.antiwindup"] * (clip(feedback, p["controller.speed_limit"]) - feedback)
                + tracking * (excess / gain if gain else excess))
        if velocity_integral_gain:
            # The tracking time is at least the integral time.
            integral_time = (gain or 1.0) / velocity_integral_gain  # s
            tracking = 1.0 / max(1.0 / tracking, integral_time) if tracking else 0.0
            self.velocity_integral += self.period * (velocity_integral_gain * (reference - speed) + tracking * excess)
        return self.notch.filtered(limited, p["drive.reference_limit"]) if self.notch else limited
