"""The electrohydraulic actuator in time: valve, cylinder and fin integrated from event to event.

The equations are those of docs/model/electrohydraulic.md, written again. In a mode the fin slides or rests; the spool
is free, at its largest speed or at the end of its stroke; each chamber has oil or a void. The check valves of the
chambers only bend a slope, which needs no event.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from .events import Accuracy, Event, State, Successor, Value, Vector, friction_events
from .piston import PistonLoop, lever
from .simulate import Array, run
from .vehicle import INPUTS_AT_REST, Surroundings, as_built, clip, hinge_moment, masses_of, surroundings

OUTPUTS = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "valve_position")
FIN, RATE, ONE, TWO, SPOOL, SPOOL_RATE = range(6)
_CLOSE = 1.0 - 1e-12  # of a limit
FREE = 0  # the spool; +-1 at its largest speed, +-2 at the end of its stroke


class Mode(NamedTuple):
    """Direction of sliding, or 0 at rest; the spool's mode; whether each chamber has a void."""

    motion: int
    spool: int
    void_1: bool
    void_2: bool


class Plant:
    """Valve, cylinder, lever and fin as built."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1e6, 1e6, 1e-2, 10.0), 1e-4)

    def __init__(self, nominal: Mapping[str, float]):
        p = self.p = as_built(nominal)
        self.inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        self.masses = masses_of(p)
        self.area, self.mass = p["cylinder.area"], p["cylinder.moving_mass"]
        self.stop, self.tank = p["fin.stop_angle"], p["tank.pressure"]
        # Flow of one edge fully open is Q_r at half the rated drop.
        self.gain = p["valve.rated_flow"] / math.sqrt(p["valve.rated_pressure"] / 2.0)
        self.fastest, self.frequency = 1.0 / p["valve.stroke_time"], p["valve.natural_frequency"]

    def start(self) -> tuple[State, Mode]:
        """Return the state at the start, and a mode that the first instant replaces."""
        filled = self.p["cylinder.start_pressure"]
        return [self.p["fin.start_angle"], 0.0, filled, filled, 0.0, 0.0], Mode(0, FREE, False, False)

    def surroundings(self, row: Mapping[str, float], command: float) -> Surroundings:
        """Return what acts under an input row and a delayed valve command [1]."""
        reference = clip((command if row["enable"] else 0.0) + self.p["valve.null_shift"], 1.0)
        return surroundings(self.p, row, reference, "supply_pressure")

    def outputs(self, y: Vector, _mode: Mode, _around: Surroundings) -> Vector:
        """Return the outputs."""
        return y[:SPOOL_RATE]

    # Equations --------------------------------------------------------------------------------------------

    def flows(self, spool: float, supply: float, one: float, two: float) -> tuple[float, float]:
        """Return the flows [m3/s] of the valve and its check valves into both chambers."""
        lap, soft, k = self.p["valve.lap"], self.p["valve.laminar_pressure"], self.gain

        def through(drop: float) -> float:
            return math.copysign(abs(drop) / (drop * drop + soft * soft) ** 0.25, drop)

        radius = math.hypot(spool, lap)
        a, b = k * (radius + spool) / 2.0, k * (radius - spool) / 2.0
        check = self.p["check_valve.conductance"]
        into_1 = a * through(supply - one) - b * through(one - self.tank) + check * max(self.tank - one, 0.0)
        into_2 = b * through(supply - two) - a * through(two - self.tank) + check * max(self.tank - two, 0.0)
        return into_1, into_2

    def friction(self, angle: float) -> float:
        """Return the dry friction about the hinge [N.m]."""
        return self.p["friction.fin_coulomb"] + lever(self.p, angle)[1] * self.p["cylinder.coulomb_friction"]

    def push(self, y: Vector, around: Surroundings) -> float:
        """Return the moment [N.m] that friction has to hold at rest."""
        force = self.area * (y[ONE] - y[TWO]) + self.mass * around.force[0]
        return lever(self.p, y[FIN])[1] * force + hinge_moment(self.masses, self.inertia, y[FIN], around)

    def rises(self, y: Vector, around: Surroundings) -> tuple[float, float]:
        """Return d/dt of both pressures [Pa/s] in chambers without a void."""
        position, ratio, _ = lever(self.p, y[FIN])
        into_1, into_2 = self.flows(y[SPOOL], around.supply, y[ONE], y[TWO])
        lost = self.area * ratio * y[RATE] + self.p["cylinder.internal_leakage"] * (y[ONE] - y[TWO])
        beta, dead, swept = self.p["oil.bulk_modulus"], self.p["cylinder.dead_volume"], self.area * position
        return beta * (into_1 - lost) / (dead + swept), beta * (into_2 + lost) / (dead - swept)

    def spool_force(self, y: Vector, around: Surroundings) -> float:
        """Return the spool's acceleration [1/s2] where nothing limits it."""
        w, damping = self.frequency, self.p["valve.damping"]
        return w * w * (around.reference - y[SPOOL]) - 2.0 * damping * w * y[SPOOL_RATE]

    def slope(self, y: Vector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return d/dt of the state in a mode."""
        turning = 0.0
        if mode.motion:
            _, ratio, bend = lever(self.p, y[FIN])
            against = (self.p["friction.fin_viscous"] + ratio * ratio * self.p["cylinder.viscous_friction"]
                       + self.mass * ratio * bend * y[RATE])
            turning = self.push(y, around) - mode.motion * self.friction(y[FIN]) - against * y[RATE]
            turning /= self.inertia + self.mass * ratio * ratio
        rise_1, rise_2 = self.rises(y, around)
        return (y[RATE] if mode.motion else 0.0, turning,
                0.0 if mode.void_1 else rise_1, 0.0 if mode.void_2 else rise_2,
                y[SPOOL_RATE] if abs(mode.spool) < 2 else 0.0,
                self.spool_force(y, around) if mode.spool == FREE else 0.0)

    # Modes ------------------------------------------------------------------------------------------------

    def _excess(self, y: Vector, around: Surroundings, side: int, held: float = 1.0) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond a share of friction, or a stop."""
        if side * y[FIN] >= self.stop * _CLOSE:
            return -1.0
        return side * self.push(y, around) - self.friction(y[FIN]) * held

    def admit(self, y: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode of a state; puts states that are at a limit exactly there."""
        motion = (y[RATE] > 0.0) - (y[RATE] < 0.0) or next(
            (side for side in (1, -1) if self._excess(y, around, side, 1.0 - 1e-10) > 0.0), 0)
        spool, force = FREE, self.spool_force(y, around)
        if abs(y[SPOOL]) >= _CLOSE and y[SPOOL] * y[SPOOL_RATE] >= 0.0 and y[SPOOL] * force >= 0.0:
            y[SPOOL], y[SPOOL_RATE], spool = math.copysign(1.0, y[SPOOL]), 0.0, 2 if y[SPOOL] > 0.0 else -2
        elif abs(y[SPOOL_RATE]) >= self.fastest * _CLOSE and y[SPOOL_RATE] * force >= 0.0:
            y[SPOOL_RATE] = math.copysign(self.fastest, y[SPOOL_RATE])
            spool = 1 if y[SPOOL_RATE] > 0.0 else -1
        for chamber in (ONE, TWO):
            y[chamber] = max(y[chamber], 0.0)
        void_1, void_2 = (y[chamber] == 0.0 and rise <= 0.0
                          for chamber, rise in zip((ONE, TWO), self.rises(y, around), strict=True))
        return Mode(motion, spool, void_1, void_2)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end a mode. The next mode follows from the state after each."""
        def put(index: int, value: float) -> Successor:
            def successor(y: State) -> Mode:
                y[index] = value
                return self.admit(y, mode, around)
            return successor

        def strike(y: State) -> Mode:
            y[FIN], y[RATE] = mode.motion * self.stop, 0.0
            return self.admit(y, mode, around)

        def end(y: State) -> Mode:
            y[SPOOL], y[SPOOL_RATE] = math.copysign(1.0, y[SPOOL]), 0.0
            return self.admit(y, mode, around)

        def faster(side: int) -> Event:
            return Event(lambda y: self.fastest - side * y[SPOOL_RATE], put(SPOOL_RATE, side * self.fastest))

        def chamber(index: int, empty: bool) -> Event:
            if empty:  # a hair above nothing, so that it counts as filled
                return Event(lambda y: -self.rises(y, around)[index - ONE], put(index, 1e-3))
            return Event(lambda y: y[index], put(index, 0.0))

        events = friction_events(mode.motion, lambda y: y[RATE], lambda y, side: self._excess(y, around, side),
                                 put(RATE, 0.0), lambda _: lambda y: self.admit(y, mode, around))
        if mode.motion:
            events.append(Event(lambda y: self.stop - mode.motion * y[FIN], strike))
        if mode.spool == FREE:
            events += [faster(1), faster(-1)]
        elif abs(mode.spool) == 1:
            # A hair slower than the fastest, so that it counts as free.
            events.append(Event(lambda y: mode.spool * self.spool_force(y, around),
                                put(SPOOL_RATE, mode.spool * self.fastest * (1.0 - 1e-11))))
        if abs(mode.spool) < 2:
            events.append(Event(lambda y: 1.0 - abs(y[SPOOL]), end))
        return [*events, chamber(ONE, mode.void_1), chamber(TWO, mode.void_2)]


class Controller(PistonLoop):
    """PI on the piston position from the fin's transducer."""

    def __init__(self, p: Mapping[str, float], angle: float):
        super().__init__(p, angle)
        self.full = p["valve.rated_flow"] / p["cylinder.area"]

    def sample(self, angle: float, command: float, enable: bool) -> float:
        """Return the valve's command [1] at a fin angle [rad] under a command [rad]."""
        p, piston = self.p, self.read(angle)
        if not enable:
            self.reset(piston)
            return 0.0
        target = self.piston(clip(command, p["command.limit"]))
        weighted = p["controller.position.setpoint_weight"] * target - piston
        speed = p["controller.position.kp"] * weighted + self.integral
        if abs(speed) <= self.full or speed * (target - piston) <= 0.0:
            self.integral += p["controller.sample_time"] * p["controller.position.ki"] * (target - piston)
        else:
            self.hold(piston)
        self.before = piston
        return clip(speed, self.full) / self.full


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate one actuator from its start and return `time` and the `OUTPUTS` at the rows, SI units.

    `inputs` are as :func:`emcas_fmu.reference.simulate.simulate` takes them; a row holds until the next.
    """
    p = {name: float(value) for name, value in parameters.items()}
    starts = {**INPUTS_AT_REST, "supply_pressure": p["hydraulic_supply.pressure"], "enable": 1.0}
    controller = Controller(p, p["fin.start_angle"])
    result = run(Plant(p), lambda y, command, enable: controller.sample(y[FIN], command, enable), p, inputs, starts,
                 (*OUTPUTS, "valve_command"))
    del result["valve_command"]
    return result
