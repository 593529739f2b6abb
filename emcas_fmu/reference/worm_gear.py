"""Integration of the worm-gear actuator: worm and wheel, with the thesis's drive and loops.

A normal force F on the flank and friction mu |F| against its sliding are resolved at the pitch cylinder into the axial
force, which turns the wheel, and the tangential one, which brakes the worm. The ratio of the accelerations of both
bodies is that of teeth to starts. The integration restarts where F changes sign.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .events import Event, Scalar, StateVector
from .plant import Geared, Mode
from .vehicle import Surroundings

# kg.m2 N.m; below it the load keeps its sign from the last event. At the worm: 2e-9 N.m for a fin of 0.05 kg.m2.
_KEPT = 1e-10


class WormPlant(Geared):
    """A worm and its wheel between motor and fin."""

    def __init__(self, parameters: Mapping[str, Scalar]):
        p = parameters
        super().__init__(p, p["worm.teeth"] / p["worm.starts"], p["inertia.worm"])
        self.worm_radius = 0.5 * p["worm.module"] * p["worm.diameter_quotient"]
        self.wheel_radius = 0.5 * p["worm.module"] * p["worm.teeth"]
        self.lead_angle = math.atan2(p["worm.starts"], p["worm.diameter_quotient"])
        self.normal = math.cos(p["worm.pressure_angle"])
        self.friction = float(p["worm.friction"])

    def _levers(self, omega: float, along: int) -> tuple[float, float]:
        """Return the moment on the wheel and the torque against the worm [N.m] per 1 N of normal force.

        `omega` [rad/s] is the fin rate. `along` is 1 if the force is on the side to which the worm turns, otherwise -1.
        """
        sine, cosine = math.sin(self.lead_angle), math.cos(self.lead_angle)
        sliding = abs(self.turns * omega) * self.worm_radius / cosine
        ratio, fast = self.p["worm.static_ratio"], self.p["worm.stribeck_speed"]
        rub = along * self.friction * (1.0 + (ratio - 1.0) * math.exp(-(sliding / fast) ** 2))
        return (self.wheel_radius * (self.normal * cosine - rub * sine),
                self.worm_radius * (self.normal * sine + rub * cosine))

    def _torques(self, y: StateVector, way: int, around: Surroundings) -> tuple[float, float]:
        """Return torque on the worm and moment on the wheel [N.m] without flank forces, for motion along `way`."""
        delta, omega, current = y[:3]
        rotor = (self.p["inertia.motor"] + self.p["inertia.screw"]) * around.faster[0]
        worm = (self.motor_torque(current) - rotor - self.viscous[way] * self.turns * omega
                - way * self.coulomb_factor * self.motor_coulomb(delta, way))
        wheel = self.loads(delta, around) + self.turns * rotor - self.fin_viscous * omega - way * self.fin_coulomb
        return worm, wheel

    def _pressing(self, worm: float, wheel: float) -> float:
        """Return a value [kg.m2 N.m] with the sign of the flank force, from torques on worm and wheel without it."""
        return worm * self.fin_inertia - self.motor_inertia * self.turns * wheel

    def turning(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration of the fin [rad/s2]."""
        if not mode.motion:
            return 0.0
        worm, wheel = self._torques(y, mode.motion, around)
        on_wheel, on_worm = self._levers(y[1], mode.flank * mode.motion)
        inertia = self.motor_inertia * self.turns * on_wheel + self.fin_inertia * on_worm
        force = self._pressing(worm, wheel) / inertia
        return (wheel + force * on_wheel) / self.fin_inertia

    def excess(self, y: StateVector, _mode: Mode, around: Surroundings, side: int) -> float:
        """Return the torque [N.m] on a resting worm towards `side` beyond stiction."""
        worm, wheel = self._torques(y, side, around)
        on_wheel, on_worm = self._levers(0.0, 1 if wheel * side < 0.0 else -1)
        return side * (worm + wheel / on_wheel * on_worm)

    def settled(self, y: StateVector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode in which the fin starts if nothing holds it, with the flank that the load presses."""
        mode = super().settled(y, mode, around)
        pressing = self._pressing(*self._torques(y, mode.motion, around)) if mode.motion else 0.0
        if mode.flank and abs(pressing) <= _KEPT:
            return mode
        return mode._replace(flank=1 if pressing > 0.0 else -1)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end a mode, among them the reversal of the load."""
        reversal = Event(lambda y: mode.flank * self._pressing(*self._torques(y, mode.motion, around)),
                         {"flank": -mode.flank})
        return [*super().events(mode, around), *([reversal] if mode.motion else [])]


simulate = WormPlant.simulate
