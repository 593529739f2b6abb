"""Trajectory generator and feed-forward in front of the thesis's loops.

The generator's states are angle r, rate and acceleration; its parameters are the natural frequency W and the damping z.
With a small remaining angle e to the command its target rate is that of a linear system, e W/(2 z), otherwise that of
braking with 0.8 a_max. Its rate approaches the target with the time constant 1/(2 z W), within the limits of rate,
acceleration and jerk. The loops' command is r delayed by the drive's delay, the lag of its current and the delay of the
notch, read from a history of r.
"""

from __future__ import annotations

import math

from .controllers import Controllers
from .screw import Screw
from .vehicle import clip

# Parameter values that the loops use when a generator precedes them.
_FOLLOWING = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 1.0,
              "command.update_time": 0.0}

_INTEGRALS = ("controller.position.ki", "controller.velocity.ki")


class Following(Controllers):
    """The loops of the thesis's actuator behind a trajectory generator, whose motion is fed forward."""

    def __init__(self, plant: Screw, nominal: Screw):
        self.integral_gains = [float(nominal.p[name]) for name in _INTEGRALS]
        nominal.p = self.loop_parameters = {**nominal.p, **_FOLLOWING}
        super().__init__(plant, nominal)
        p = self.p
        lag = p["motor.inductance"] / (p["motor.resistance"] + p["drive.kp"])  # s, lag of the current
        frequency = p.get("filters.notch_frequency", 0.0)
        if frequency:
            lag += 2.0 * (p["filters.notch_pole_damping"] - p["filters.notch_zero_damping"]) / frequency
        self.delay = (p["drive.transport_delay"] + lag) / self.period  # samples
        self._rest(self.nominal.fin_angle(self._measure(p["fin.start_angle"], 0.0)[1]))

    def _rest(self, fin: float) -> None:
        self.history = [fin] * (math.ceil(self.delay) + 2)  # rad, the newest first
        self.rate = self.acceleration = self.integral_of_drive = 0.0
        # True from when a limit of speed or reference is reached with the fin beyond the tracking limit until the fin
        # is within it again.
        self.overload = False
        self.lost = 0.0  # share of the last sample's motion that a lagging fin has removed
        self.forward: tuple[float, float] = 0.0, 0.0  # rad/s and V, speed and reference that are fed forward
        self.last_mean = 0.0  # rad/s, motor speed that the followed angle had in the last sample

    def sample(self, delta: float, omega: float, command: float, enable: bool, current: float = 0.0) -> float:
        """Return the DAC value [V] of a sample; see :meth:`Controllers.sample`."""
        now, rate = self.history[0], self.rate
        self._accelerate(clip(command, self.p["command.limit"]) - now)
        after = rate + self.period * self.acceleration
        following = now + self.period * (rate + after) / 2.0
        self._feed_forward(now, rate, following, after)
        whole, share = math.floor(self.delay), self.delay % 1.0
        followed = clip((1.0 - share) * self.history[whole] + share * self.history[whole + 1], self.p["command.limit"])
        gains = (0.0, 0.0) if 0.0 < self.lost < 1.0 else self.integral_gains
        self.loop_parameters.update(zip(_INTEGRALS, gains, strict=True))
        # An observed speed is half a sample newer than the mean rate that is fed forward.
        mean = (self._target(followed) - self.target) / self.period
        if self.observer:
            speed, reference = self.forward
            self.forward = speed, reference + self.p["controller.velocity.kp"] * (mean - self.last_mean) / 2.0
        integral = self.integral
        reference = super().sample(delta, omega, followed, enable, current)
        fin = self.measured
        if not enable:
            self._rest(fin)
            return reference
        self.last_mean = mean
        # A fin that lags too far slows the generator, at most to a standstill.
        behind, limit, way = followed - fin, self.p["trajectory.tracking_limit"], following - now
        lost = math.copysign(min(max(abs(behind) - limit, 0.0), abs(way)), way) if behind * way > 0.0 else 0.0
        # In an overload with a load observer the integral is 0 at a limit, and otherwise grows as for an error equal to
        # the tracking limit.
        self.overload = abs(behind) > limit and (self.limited or self.overload)
        if self.overload and self.p["controller.load_observer"]:
            growth = (self.integral - integral) * limit / abs(behind)
            self.integral = 0.0 if self.limited else integral + growth
        # Without integral action and load observer any load keeps the fin behind.
        lost *= max(self.integral_gains[0], self.p["controller.load_observer"]) > 0.0
        self.lost = lost / way if way else 0.0  # extensions/trajectory.py treats shares up to 1e-12 as none
        self.rate = after * (1.0 - 0.3 * self.lost)
        self.history = [angle - lost for angle in (following, *self.history[:-1])]
        return reference

    def _accelerate(self, way: float) -> None:
        """Set the acceleration [rad/s2] until the next sample, for a remaining angle `way` [rad]."""
        p = self.p
        damping, frequency = p["trajectory.damping"], p["trajectory.natural_frequency"]
        largest, constant = p["trajectory.acceleration_limit"], 2.0 * damping / frequency
        braking = 0.8 * largest
        linear = braking * constant**2
        speed = (abs(way) / constant if abs(way) <= linear
                 else math.sqrt(2.0 * braking * (abs(way) - linear / 2.0)))
        target = math.copysign(min(speed, p["trajectory.rate_limit"]), way)
        acceleration = clip(2.0 * damping * frequency * (target - self.rate), largest)
        self.acceleration += clip(acceleration - self.acceleration, p["trajectory.jerk_limit"] * self.period)

    def _feed_forward(self, now: float, rate: float, following: float, after: float) -> None:
        """Set the motor speed [rad/s] and the reference [V] that are fed forward."""
        p, ratios = self.p, (self.nominal.ratio(now), self.nominal.ratio(following))
        first, last = ratios[0] * rate, ratios[1] * after
        speed, inertia = (first + last) / 2.0, (self._inertia(now) + self._inertia(following)) / 2.0
        way = 1 if speed > 0.0 else -1
        viscous = self.nominal.viscous[way] + self.nominal.fin_viscous / ratios[0] ** 2
        # The fin's inertia, referred to the motor, changes with the ratio R; `bend` is R'/R.
        swing = self.nominal.fin_inertia / ratios[0] ** 3 * self.nominal.bend(now)
        torque = inertia * (last - first) / self.period + viscous * speed - swing * speed**2
        motor = torque / p["motor.torque_constant"]
        voltage = p["motor.resistance"] * motor + p["motor.back_emf_constant"] * speed
        error = (voltage - self.integral_of_drive) / p["drive.kp"]
        self.integral_of_drive += self.period * p["drive.ki"] * error
        self.forward = speed, (motor + error) / p["drive.current_gain"]

    def fed_forward(self, feedback: float, reference: float) -> tuple[float, float]:
        """Return the speed [rad/s] for the friction compensation, and the reference [V] of the motion."""
        speed, ahead = self.forward
        return feedback + (1.0 - self.lost) * speed, (1.0 - self.lost) * ahead
