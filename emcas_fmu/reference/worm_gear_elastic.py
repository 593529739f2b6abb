"""The worm gear with an elastic mesh in time: worm and fin turn by themselves, the flanks between them press or do not.

The state is that of :mod:`.plant` for the worm, its angle and speed over the ratio, then angle [rad] and rate [rad/s]
of the fin. `Mode.flank` is the side on which the flanks press, 0 in the gap between them; a mesh without a gap changes
sides at once. Which side rubs, who rests, and who is let go are decided at events.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .plant import Guard, Mode, Surroundings, Value, Vector
from .simulate import Array
from .simulate import simulate as in_time
from .worm_gear import WormPlant

_LEFT = 1e-9  # N.m; less is rounding where flanks are left
_REFUSED = ("motor.pole_pairs", "encoder.on_fin")


class MeshPlant(WormPlant):
    """Motor, drive and fin of the thesis's actuator, worm and wheel with flanks that yield between them."""

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

    def start(self, delta: float) -> list[float]:
        """Return the state at rest at a fin angle [rad], the tooth amid its gap."""
        return [*super().start(delta), delta, 0.0]

    def fin(self, state: Vector) -> tuple[float, float]:
        """Return angle [rad] and rate [rad/s] of the fin."""
        return state[4], state[5]

    # Forces -----------------------------------------------------------------------------------------------

    def _entered(self, state: Vector, side: int) -> float:
        """Return by how much [rad] the flanks on a side have entered each other."""
        return side * (state[0] - state[4]) - self.half_gap

    def _pressure(self, state: Vector, side: int) -> float:
        """Return the moment [N.m] that presses the flanks on a side together; below 0 they would pull."""
        return self.stiffness * self._entered(state, side) + self.damping * side * (state[1] - state[5])

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
        """Return time derivative of the state in `mode`."""
        electrical = super().slope(state[:4], Mode(0, mode.drive), around)[2:]
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
        return min(self.stiffness * self._entered(state, side), self._pressure(state, side)) - _LEFT

    def _settled(self, state: Vector, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode with whoever rests and is not held let go."""
        if not self.half_gap and not mode.flank:
            mode = mode._replace(flank=1 if self._pressure(state, 1) >= 0.0 else -1)
        for side in (1, -1):
            if not mode.motion and self._worm_excess(state, mode, around, side) > 0.0:
                mode = mode._replace(motion=side)
            if not mode.fin and self._fin_excess(state, mode, around, side) > 0.0:
                mode = mode._replace(fin=side)
        return mode

    def admit(self, state: list[float], mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; clears the current of an opened bridge in place."""
        drive = super().admit(state, Mode(1, mode.drive), around).drive
        return self._settled(state, mode._replace(drive=drive), around)

    def guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        """Return events that end `mode`."""
        def switched(guard: Guard) -> Callable[[list[float]], Mode]:
            return lambda state: mode._replace(drive=guard.successor(state).drive)

        def then(place: int | None = None, at: float = 0.0, **change: int) -> Callable[[list[float]], Mode]:
            """Change the mode, and put a state where it now is to the bit."""
            def successor(state: list[float]) -> Mode:
                if place is not None:
                    state[place] = at
                return self._settled(state, mode._replace(**change), around)
            return successor

        electrical = super()._drive_guards(Mode(mode.motion, mode.drive), around)
        guards = [Guard(each.value, int(each.direction), switched(each)) for each in electrical]
        if mode.motion:
            guards.append(Guard(lambda y: mode.motion * y[1], -1, then(1, motion=0)))
        if mode.fin:
            guards.append(Guard(lambda y: mode.fin * y[5], -1, then(5, fin=0)))

            def strike(state: list[float]) -> Mode:
                state[4] = mode.fin * self.stop
                return then(5, fin=0)(state)

            guards.append(Guard(lambda y: mode.fin * y[4] - self.stop, 1, strike))
        for side in (1, -1):
            if not mode.motion:
                guards.append(Guard(lambda y, side=side: self._worm_excess(y, mode, around, side), 1,  # type: ignore[misc]
                                    then(motion=side)))
            if not mode.fin:
                guards.append(Guard(lambda y, side=side: self._fin_excess(y, mode, around, side), 1,  # type: ignore[misc]
                                    then(fin=side)))
            if not mode.flank:
                guards.append(Guard(lambda y, side=side: self._met(y, side), 1, then(flank=side)))  # type: ignore[misc]
        if mode.flank:
            guards.append(Guard(lambda y: self._pressure(y, mode.flank), -1,
                                then(flank=0 if self.half_gap else -mode.flank)))
        return guards


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from rest, as :func:`emcas_fmu.reference.simulate.simulate` does."""
    return in_time(parameters, inputs, MeshPlant)
