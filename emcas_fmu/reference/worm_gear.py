"""The worm-gear actuator in time: worm and wheel by the force between their flanks, under the same drive and loops.

A normal force F on the flank and friction mu |F| against its sliding are resolved at the pitch cylinder into the axial
force, which turns the wheel, and the tangential one, which brakes the worm. Both bodies then have the acceleration that
the number of teeth asks for. Where F changes sign the integration starts anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .events import Event, Value, Vector
from .plant import Mode, Plant
from .simulate import Array
from .simulate import simulate as in_time
from .vehicle import Surroundings

_NO_LEVER = ("kinematics.initial_angle", "mass.nut", "deviation.kinematics.moment_arm",
             "deviation.kinematics.initial_angle", "deviation.screw.lead")
# kg.m2 N.m: a load as small as that has changed its sign, 2e-9 N.m at the worm of a fin of 0.05 kg.m2.
_CROSSED = 1e-10


class Reversal(Event):
    """A change of the load's sign, which changes no mode: it must not fire again where it has just fired."""

    begun = False

    def __call__(self, time: float, state: Vector) -> float:
        """Return the event's margin; at the start one so small counts as crossed."""
        value = super().__call__(time, state)
        if not self.begun and abs(value) < _CROSSED:
            value = -_CROSSED
        self.begun = True
        return value


class WormPlant(Plant):
    """Motor, drive and fin of the thesis's actuator, a worm and its wheel between them."""

    def __init__(self, parameters: Mapping[str, Value]):
        p = parameters
        self.teeth = p["worm.teeth"] / p["worm.starts"]
        super().__init__({**p, **dict.fromkeys(_NO_LEVER, 0.0), "kinematics.moment_arm": self.teeth, "screw.lead": 1.0,
                          "inertia.screw": p["inertia.worm"]})
        self.worm_radius = 0.5 * p["worm.module"] * p["worm.diameter_quotient"]
        self.wheel_radius = 0.5 * p["worm.module"] * p["worm.teeth"]
        self.lead_angle = math.atan2(p["worm.starts"], p["worm.diameter_quotient"])
        self.normal = math.cos(p["worm.pressure_angle"])
        self.friction = float(p["worm.friction"])

    def motor_angle(self, delta: float) -> float:
        """Return motor angle [rad] at fin angle `delta` [rad]."""
        return self.teeth * delta

    def fin_angle(self, theta: float) -> float:
        """Return fin angle [rad] at motor angle `theta` [rad]."""
        return theta / self.teeth

    def ratio(self, delta: float) -> float:
        """Return turns of the motor in one of the fin [-]."""
        return self.teeth

    def bend(self, delta: float) -> float:
        """Return R'/R [-], of a constant ratio 0."""
        return 0.0

    def _levers(self, omega: float, along: int) -> tuple[float, float]:
        """Return moment on the wheel and against the worm [N.m] of 1 N between the flanks, at a fin rate [rad/s].

        `along` is 1 where the force is on the side to which the worm turns, else -1.
        """
        sine, cosine = math.sin(self.lead_angle), math.cos(self.lead_angle)
        sliding = abs(self.teeth * omega) * self.worm_radius / cosine
        ratio, fast = self.parameters["worm.static_ratio"], self.parameters["worm.stribeck_speed"]
        rub = along * self.friction * (1.0 + (ratio - 1.0) * math.exp(-(sliding / fast) ** 2))
        return (self.wheel_radius * (self.normal * cosine - rub * sine),
                self.worm_radius * (self.normal * sine + rub * cosine))

    def _torques(self, state: Vector, around: Surroundings, way: int) -> tuple[float, float]:
        """Return torque on the worm and moment on the wheel [N.m] without the flanks', of motion along `way`."""
        delta, omega, current, _ = state
        rotor = (self.parameters["inertia.motor"] + self.parameters["inertia.screw"]) * around.faster[0]
        worm = (self.drive.torque_constant * current - rotor - self.viscous[way] * self.teeth * omega
                - way * self.coulomb_factor * self.motor_coulomb(delta, way))
        wheel = self.loads(delta, around) + self.teeth * rotor - self.fin_viscous * omega - way * self.fin_coulomb
        return worm, wheel

    def _pressing(self, state: Vector, around: Surroundings, way: int) -> float:
        """Return a value of the sign of the force between the flanks [kg.m2 N.m]."""
        worm, wheel = self._torques(state, around, way)
        return worm * self.fin_inertia - self.motor_inertia * self.teeth * wheel

    def _omega_slope(self, state: Vector, motion: int, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of a fin that slides in the direction `motion`."""
        _, wheel = self._torques(state, around, motion)
        pressing = self._pressing(state, around, motion)
        on_wheel, on_worm = self._levers(state[1], 1 if pressing * motion > 0.0 else -1)
        force = pressing / (self.motor_inertia * self.teeth * on_wheel + self.fin_inertia * on_worm)
        return (wheel + force * on_wheel) / self.fin_inertia

    def _beyond_friction(self, state: Vector, around: Surroundings, side: int) -> float:
        """Return torque [N.m] on a resting worm towards `side` beyond what friction holds."""
        worm, wheel = self._torques((state[0], 0.0, state[2], state[3]), around, side)
        on_wheel, on_worm = self._levers(0.0, 1 if wheel * side < 0.0 else -1)
        return side * (worm + wheel / on_wheel * on_worm)

    def _motion_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        events = super()._motion_events(mode, around)
        if not mode.motion:
            return events

        def reversal(side: int) -> Event:
            return Reversal(lambda y: -side * self._pressing(y, around, mode.motion), lambda _: mode)

        return [*events, reversal(1), reversal(-1)]


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from rest, as :func:`emcas_fmu.reference.simulate.simulate` does."""
    return in_time(parameters, inputs, WormPlant)
