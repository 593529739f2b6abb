"""The worm gear with an elastic mesh in time: worm and fin turn by themselves, coupled by the force between the flanks.

The state is that of :mod:`.plant` for the worm, its angle and speed over the ratio, then angle [rad] and rate [rad/s]
of the fin. `Mode.flank` is the side on which the flanks press, 0 in the gap between them; a mesh without a gap changes
sides at once. Which side rubs, which body rests, and which one breaks away are decided at events.
"""

from __future__ import annotations

from collections.abc import Mapping

from .events import Event, State, Successor, Value, Vector, friction_events
from .plant import Mode
from .simulate import Array
from .simulate import simulate as in_time
from .vehicle import Surroundings
from .worm_gear import WormPlant

_LEFT = 1e-9  # N.m; less is rounding where flanks separate
_REFUSED = ("motor.pole_pairs", "encoder.on_fin")


class MeshPlant(WormPlant):
    """Motor, drive and fin of the thesis's actuator, with worm and wheel of elastic flanks between them."""

    accuracy = WormPlant.accuracy._replace(scales=(1e-2, 1.0, 1.0, 1.0, 1e-2, 1.0))

    def __init__(self, parameters: Mapping[str, Value]):
        if refused := [name for name in _REFUSED if parameters[name]]:
            raise ValueError(f"{refused[0]} must be 0: this reference does not follow it")
        super().__init__(parameters)
        p, square = self.parameters, self.wheel_radius**2
        about_hinge = sum(1.0 / k for part in ("fork", "shaft", "structure")
                          if (k := p[f"drive_line.{part}_stiffness"]))
        gap = p["drive_line.backlash"]
        # Compliance [rad/(N.m)] and damping [N.m.s/rad] about the hinge of what is in series.
        parts = [(p["drive_line.axial_compliance"] / square, p["drive_line.axial_damping"] * square),
                 (1.0 / (p["drive_line.contact_stiffness"] * square) if gap else 0.0,
                  p["drive_line.contact_damping"] * square),
                 (about_hinge, p["drive_line.hinge_damping"])]
        whole = sum(compliance for compliance, _ in parts)
        self.stiffness = 1.0 / whole
        self.damping = sum(damping * (compliance / whole)**2 for compliance, damping in parts)
        self.half_gap = 0.5 * gap / self.wheel_radius  # rad, of the fin

    def start(self) -> tuple[State, Mode]:
        """Return the state at rest at the start angle, the tooth amid its gap, and its mode."""
        state, mode = super().start()
        return [*state, state[0], 0.0], mode

    def fin(self, state: Vector) -> tuple[float, float]:
        """Return angle [rad] and rate [rad/s] of the fin."""
        return state[4], state[5]

    # Forces -----------------------------------------------------------------------------------------------

    def _penetration(self, state: Vector, side: int) -> float:
        """Return the penetration [rad] of the flanks on a side."""
        return side * (state[0] - state[4]) - self.half_gap

    def _pressure(self, state: Vector, side: int) -> float:
        """Return the moment [N.m] that presses the flanks on a side together; below 0 they would pull."""
        return self.stiffness * self._penetration(state, side) + self.damping * side * (state[1] - state[5])

    def _moment(self, state: Vector, mode: Mode) -> float:
        """Return moment [N.m] of the flanks on the wheel."""
        return mode.flank * self._pressure(state, mode.flank) if mode.flank else 0.0

    def _worm_torque(self, state: Vector, mode: Mode, around: Surroundings, way: int) -> float:
        """Return torque [N.m] on a worm that slides along `way`."""
        moment = self._moment(state, mode)
        on_wheel, on_worm = self._levers(state[1], 1 if moment * way > 0.0 else -1)
        return self._torques((state[4], *state[1:4]), around, way)[0] - moment / on_wheel * on_worm

    def _fin_moment(self, state: Vector, mode: Mode, around: Surroundings, way: int) -> float:
        """Return moment [N.m] on a fin that slides along `way`."""
        return self._moment(state, mode) + self._torques((state[4], state[5], 0.0, 0.0), around, way)[1]

    def slope(self, state: Vector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return the time derivative of the state in `mode`."""
        electrical = self.drive.slopes(self.motor(state), mode.drive, around, lambda: 0.0)
        worm = fin = (0.0, 0.0)
        if mode.motion:
            torque = self._worm_torque(state, mode, around, mode.motion)
            worm = state[1], torque / (self.motor_inertia * self.teeth)
        if mode.fin:
            fin = state[5], self._fin_moment(state, mode, around, mode.fin) / self.fin_inertia
        return *worm, *electrical, *fin

    # Modes ------------------------------------------------------------------------------------------------

    def _worm_excess(self, state: Vector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return torque [N.m] on a resting worm towards `side` beyond what friction holds."""
        return side * self._worm_torque((state[0], 0.0, *state[2:]), mode, around, side)

    def _fin_excess(self, state: Vector, mode: Mode, around: Surroundings, side: int) -> float:
        """Return moment [N.m] on a resting fin towards `side` beyond what friction, or a stop, holds."""
        if side * state[4] >= self.stop:
            return -1.0
        return side * self._fin_moment((*state[:5], 0.0), mode, around, side)

    def _met(self, state: Vector, side: int) -> float:
        """Return what is above 0 where flanks touch, or where a damped flank that has been left presses again.

        It begins below 0 where flanks are left, so that a return within the first step is seen.
        """
        return min(self.stiffness * self._penetration(state, side), self._pressure(state, side)) - _LEFT

    def _settled(self, state: Vector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode in which every body that rests and is not held starts."""
        if not self.half_gap and not mode.flank:
            mode = mode._replace(flank=1 if self._pressure(state, 1) >= 0.0 else -1)
        for side in (1, -1):
            if not mode.motion and self._worm_excess(state, mode, around, side) > 0.0:
                mode = mode._replace(motion=side)
            if not mode.fin and self._fin_excess(state, mode, around, side) > 0.0:
                mode = mode._replace(fin=side)
        return mode

    def admit(self, state: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; clears the current of an opened bridge in place."""
        drive = self.drive.admit(self.motor(state), around, lambda: 0.0)
        if not around.enable:
            state[2] = state[3] = 0.0
        return self._settled(state, mode._replace(drive=drive), around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end `mode`."""
        def then(index: int | None = None, value: float = 0.0, **change: int) -> Successor:
            """Change the mode, and set a state to the value that it has there to the bit."""
            def successor(state: State) -> Mode:
                if index is not None:
                    state[index] = value
                return self._settled(state, mode._replace(**change), around)
            return successor

        def strike(state: State) -> Mode:
            state[4] = mode.fin * self.stop
            state[5] = 0.0
            return self._settled(state, mode._replace(fin=0), around)

        def meeting(side: int) -> Event:
            return Event(lambda y: -self._met(y, side), then(flank=side))

        # The acceleration of the motor does not matter without pole pairs.
        events = self.drive.events(mode.drive, around, self.motor, lambda _: 0.0,
                                   lambda _, drive: mode._replace(drive=drive))
        events += friction_events(mode.motion, lambda y: y[1], lambda y, side: self._worm_excess(y, mode, around, side),
                                  then(1, motion=0), lambda side: then(motion=side))
        events += friction_events(mode.fin, lambda y: y[5], lambda y, side: self._fin_excess(y, mode, around, side),
                                  then(5, fin=0), lambda side: then(fin=side))
        if mode.fin:
            events.append(Event(lambda y: self.stop - mode.fin * y[4], strike))
        if mode.flank:
            events.append(Event(lambda y: self._pressure(y, mode.flank),
                                then(flank=0 if self.half_gap else -mode.flank)))
        else:
            events += [meeting(1), meeting(-1)]
        return events


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from rest, as :func:`emcas_fmu.reference.simulate.simulate` does."""
    return in_time(parameters, inputs, MeshPlant)
