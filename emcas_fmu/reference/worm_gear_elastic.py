"""Integration of the worm gear with an elastic mesh: worm and fin are two bodies, coupled by the flank force.

The state is that of :mod:`.plant` for the worm (angle and speed divided by the ratio), then angle [rad] and rate
[rad/s] of the fin. `Mode.flank` is the side on which the flanks press, 0 in the gap; a mesh without a gap changes sides
at once. Events change the side of contact, and stop and start the bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

from .drive import Driven
from .events import Body, Event, Scalar, StateVector
from .plant import Mode
from .vehicle import Surroundings
from .worm_gear import WormPlant

_LEFT = 1e-9  # N.m; a smaller moment between flanks that separate is a rounding error
_REFUSED = ("motor.pole_pairs", "encoder.on_fin")  # parameters that must be 0


class MeshPlant(WormPlant):
    """Motor, drive and fin of the thesis's actuator, with an elastic worm gear between them."""

    accuracy = WormPlant.accuracy._replace(scales=(1e-2, 1.0, 1.0, 1.0, 1e-2, 1.0))

    def __init__(self, parameters: Mapping[str, Scalar]):
        if refused := [name for name in _REFUSED if parameters[name]]:
            raise ValueError(f"{refused[0]} must be 0: this reference does not model it")
        super().__init__(parameters)
        p, square = self.p, self.wheel_radius**2
        about_hinge = sum(1.0 / k for part in ("fork", "shaft", "structure")
                          if (k := p[f"drive_line.{part}_stiffness"]))
        gap = p["drive_line.backlash"]
        # Compliance [rad/(N.m)] and damping [N.m.s/rad] about the hinge of the elements in series.
        parts = [(p["drive_line.axial_compliance"] / square, p["drive_line.axial_damping"] * square),
                 (1.0 / (p["drive_line.contact_stiffness"] * square) if gap else 0.0,
                  p["drive_line.contact_damping"] * square),
                 (about_hinge, p["drive_line.hinge_damping"])]
        whole = sum(compliance for compliance, _ in parts)
        self.stiffness = 1.0 / whole
        self.damping = sum(damping * (compliance / whole)**2 for compliance, damping in parts)
        self.half_gap = 0.5 * gap / self.wheel_radius  # rad, of the fin
        self.bodies = (Body("motion", itemgetter(1), self._worm_excess, {1: 0.0}),
                       Body("fin", itemgetter(5), self._fin_excess, {5: 0.0}, 4, self.stop))

    def start(self) -> tuple[StateVector, Mode]:
        """Return the state at rest at the start angle, with the tooth in the middle of its gap, and its mode."""
        state, mode = super().start()
        return [*state, state[0], 0.0], mode

    def outputs(self, y: StateVector, around: Surroundings) -> tuple[float, ...]:
        return *y[4:], *super().outputs(y, around)[2:]

    def _penetration(self, y: StateVector, side: int) -> float:
        """Return the penetration [rad] of the flanks on a side."""
        return side * (y[0] - y[4]) - self.half_gap

    def _pressure(self, y: StateVector, side: int) -> float:
        """Return the moment [N.m] that presses the flanks on a side together; below 0 they would pull."""
        return self.stiffness * self._penetration(y, side) + self.damping * side * (y[1] - y[5])

    def _moment(self, y: StateVector, mode: Mode) -> float:
        """Return the moment [N.m] of the flanks on the wheel."""
        return mode.flank * self._pressure(y, mode.flank) if mode.flank else 0.0

    def _worm_torque(self, y: StateVector, mode: Mode, around: Surroundings, way: int) -> float:
        """Return the torque [N.m] on a worm that turns in the direction `way`."""
        moment = self._moment(y, mode)
        on_wheel, on_worm = self._levers(y[1], 1 if moment * way > 0.0 else -1)
        return self._torques([y[4], *y[1:3]], way, around)[0] - moment / on_wheel * on_worm

    def _fin_moment(self, y: StateVector, mode: Mode, around: Surroundings, way: int) -> float:
        """Return the moment [N.m] on a fin that turns in the direction `way`."""
        return self._moment(y, mode) + self._torques([y[4], y[5], 0.0], way, around)[1]

    def turning(self, y: StateVector, mode: Mode, around: Surroundings) -> float:
        """Return the acceleration of the worm divided by the ratio [rad/s2]."""
        way = mode.motion
        return self._worm_torque(y, mode, around, way) / (self.motor_inertia * self.turns) if way else 0.0

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        fin = self._fin_moment(y, mode, around, mode.fin) / self.fin_inertia if mode.fin else 0.0
        return *super().slope(y, mode, around), y[5], fin

    def _worm_excess(self, y: StateVector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the torque [N.m] on a resting worm towards `side` beyond stiction."""
        return side * self._worm_torque(y, mode, around, side)

    def _fin_excess(self, y: StateVector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond stiction."""
        return side * self._fin_moment(y, mode, around, side)

    def _met(self, y: StateVector, side: int) -> float:
        """Return a margin [N.m] that is above 0 where the flanks on a side overlap and press on each other.

        It is below 0 when they have just separated, so that contact within the first step is detected.
        """
        return min(self.stiffness * self._penetration(y, side), self._pressure(y, side)) - _LEFT

    def settled(self, y: StateVector, mode: Mode, around: Surroundings) -> Any:
        if not self.half_gap and not mode.flank:
            mode = mode._replace(flank=1 if self._pressure(y, 1) >= 0.0 else -1)
        return Driven.settled(self, y, mode, around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        events = Driven.events(self, mode, around)
        if mode.flank:
            left = 0 if self.half_gap else -mode.flank
            return [*events, Event(lambda y: self._pressure(y, mode.flank), {"flank": left})]

        def meeting(side: int) -> Event:
            return Event(lambda y: -self._met(y, side), {"flank": side})

        return [*events, meeting(1), meeting(-1)]


simulate = MeshPlant.simulate
