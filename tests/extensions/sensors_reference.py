"""An independent integration of the extension `sensors`: the reference's plant and controllers with sensor errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from emcas_fmu.reference.controllers import Controllers
from emcas_fmu.reference.drive import FREE, ON_LIMIT, Motor
from emcas_fmu.reference.plant import Plant
from emcas_fmu.reference.screw import Screw
from emcas_fmu.reference.vehicle import Surroundings


class Noise:
    """L'Ecuyer's random generator in integers."""

    def __init__(self, seed: int):
        self.states = [seed, 1234567890]

    def uniform(self) -> float:
        """Return a number between 0 and 1, uniformly distributed."""
        self.states = [40014 * self.states[0] % 2147483563, 40692 * self.states[1] % 2147483399]
        return (self.states[0] / 2147483563 - self.states[1] / 2147483399) % 1.0

    def draw(self) -> float:
        """Return a number of mean 0 and variance 1."""
        first, second, third, fourth = (self.uniform() for _ in range(4))
        return math.sqrt(3.0) * (first + second - third - fourth)


def measured(p: Mapping[str, float], current: float) -> float:
    """Return the measured current [A] at a motor current [A]."""
    return (1.0 + p["sensor.current.gain_error"]) * current + p["sensor.current.offset"]


class Sensing(Controllers):
    """Controllers that read an encoder and a current with errors."""

    def __init__(self, plant: Screw, nominal: Screw):
        self.generator, self.noise = Noise(int(nominal.p["sensor.encoder.seed"])), 0.0
        super().__init__(plant, nominal)

    def read(self, x: float) -> float:
        """Return the encoder's angle [rad] at an angle [rad] of its shaft."""
        p, prefix = self.p, "sensor.encoder."
        return x + self.noise + sum(
            p[prefix + name] * (math.sin(n * x + p[f"{prefix}{name}_phase"]) - math.sin(p[f"{prefix}{name}_phase"]))
            for n, name in ((1, "once"), (2, "twice")))

    def _counts(self, delta: float) -> int:
        motor = self.plant.motor_angle(delta)
        return math.floor((motor if self.on_fin else self.read(motor)) / self.count_size)

    def _measure(self, delta: float, omega: float) -> tuple[float, float, float]:
        previous, self.counts = self.counts, self._counts(delta)
        motor = self.plant.motor_angle(delta)
        if not self.p["encoder.enabled"]:
            speed = self.plant.ratio(delta) * omega
            if self.on_fin:
                reading = self.read(delta)
                return reading, self.nominal.motor_angle(reading), speed
            slope = (self.read(motor + 1e-4) - self.read(motor - 1e-4)) / 2e-4  # the noise cancels
            return self.nominal.fin_angle(self.read(motor)), self.read(motor), slope * speed
        speed = (self.counts - previous) * self.count_size / self.period
        if self.on_fin:
            angle = math.floor(self.read(delta) / self.count_size) * self.count_size
            return angle, self.nominal.motor_angle(angle), speed
        angle = self.counts * self.count_size
        return self.nominal.fin_angle(angle), angle, speed

    def sample(self, delta: float, omega: float, command: float, enable: bool, current: float = 0.0) -> float:
        self.noise = self.p["sensor.encoder.noise"] * self.generator.draw()
        return super().sample(delta, omega, command, enable, measured(self.p, current))


class Sensed(Plant):
    """The plant whose drive controls the measured current."""

    def __init__(self, parameters: Mapping[str, Any]):
        super().__init__(parameters)
        self.scale = 1.0 + self.p["sensor.current.gain_error"]

    def controller(self, nominal: Screw) -> Any:
        loops = Sensing(self, nominal)
        return lambda y, command, enable: loops.sample(y[0], y[1], command, enable, y[2])

    def error(self, m: Motor, around: Surroundings) -> float:
        """Return current reference less measured current [A]."""
        return around.reference - measured(self.p, m.current)

    def demand(self, m: Motor, around: Surroundings) -> float:
        return self.p["drive.kp"] * self.error(m, around) + m.integral

    def electrical(self, m: Motor, mode: int, around: Surroundings) -> tuple[float, float]:
        rise, integral = super().electrical(m, mode, around)
        if mode == FREE:
            return rise, self.p["drive.ki"] * self.error(m, around)
        if abs(mode) == ON_LIMIT:
            return rise, integral + (self.scale - 1.0) * self.p["drive.kp"] * rise
        return rise, integral

    def _held_slope(self, m: Motor, around: Surroundings, side: int) -> float:
        rise, _ = self.electrical(m, side, around)
        return -side * self.p["drive.kp"] * self.scale * rise

    def _free_slope(self, m: Motor, around: Surroundings, side: int) -> float:
        return self._held_slope(m, around, side) + side * self.p["drive.ki"] * self.error(m, around)
