"""The electrohydraulic actuator integrated by SciPy from event to event, for `emcas validate`.

Written from the equations of docs/model/electrohydraulic.md; it takes parameters by name from the rest and no equation.
Between two instants (a sample, the arrival of a command in the valve, an input row) DOP853 integrates what holds in a
mode: the fin slides or rests, the spool is free, as fast as it can be or at the end of its stroke, a chamber has oil or
a void. Each is ended by an event. The check valves of the chambers bend a slope only, which needs none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .piston import PistonLoop
from .plant import STANDARD_GRAVITY, Value, clip, cross
from .simulate import Array, Bus, columns_of, schedule

MOTION = tuple(f"{kind}.{axis}" for kind in ("acceleration", "angular_rate", "angular_acceleration") for axis in "xyz")
OUTPUTS = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "valve_position")
RTOL = 1e-10
# Absolute tolerance = rtol * scale: of rad, rad/s, Pa twice, the stroke, and its rate in 1/s.
SCALES = np.array([1e-2, 1.0, 1e6, 1e6, 1e-2, 10.0])
MAX_STEP = 1e-4  # s, so that no two events of a kind hide in a step
_CLOSE = 1.0 - 1e-12  # of a limit

State = list[float]
FREE = 0  # the spool; +-1 at its largest speed, +-2 at the end of its stroke


class Mode(NamedTuple):
    """Direction of sliding, or 0 at rest; the spool's; whether each chamber has a void."""

    motion: int
    spool: int
    void_1: bool
    void_2: bool


class Around(NamedTuple):
    """What is constant between two instants: valve command [1], line [Pa], moments [N.m] and force [N] from outside."""

    command: float
    supply: float
    moment: Callable[[float], float]


class Plant:
    """Valve, cylinder, lever and fin as built."""

    def __init__(self, p: Mapping[str, float]):
        def built(name: str, deviation: str) -> float:
            return p[name] * (1.0 + p[f"deviation.{deviation}"])

        self.p = p
        self.arm = built("kinematics.moment_arm", "kinematics.moment_arm")
        self.phase = p["kinematics.initial_angle"] + p["deviation.kinematics.initial_angle"]
        self.inertia = built("inertia.fin", "mass.fin") + p["inertia.shaft"] + p["inertia.fork"]
        self.masses = {"fin": built("mass.fin", "mass.fin"), "shaft": p["mass.shaft"], "fork": p["mass.fork"]}
        self.dry = built("friction.fin_coulomb", "friction.coulomb"), built("cylinder.coulomb_friction",
                                                                            "friction.coulomb")
        self.viscous = built("friction.fin_viscous", "friction.viscous"), built("cylinder.viscous_friction",
                                                                                "friction.viscous")
        self.area, self.mass = p["cylinder.area"], p["cylinder.moving_mass"]
        self.stop, self.tank = p["fin.stop_angle"], p["tank.pressure"]
        # Flow of one edge fully open is Q_r at half the rated drop.
        self.gain = built("valve.rated_flow", "valve.rated_flow") / math.sqrt(p["valve.rated_pressure"] / 2.0)
        self.fastest, self.frequency = 1.0 / p["valve.stroke_time"], p["valve.natural_frequency"]

    def lever(self, angle: float) -> tuple[float, float, float]:
        """Return the piston's way [m], its slope [m/rad] and that one's [m/rad2] at a fin angle [rad]."""
        tangent = math.tan(angle + self.phase)
        slope = self.arm / math.cos(angle + self.phase) ** 2
        return self.arm * (tangent - math.tan(self.phase)), slope, 2.0 * slope * tangent

    def around(self, row: Mapping[str, float], command: float) -> Around:
        """Return what holds under a row of inputs with the valve's command of samples [1]."""
        p = self.p
        given, rate, faster = ([row[name] for name in MOTION[k:k + 3]] for k in (0, 3, 6))
        at = (p["mounting.station"], 0.0, 0.0)
        swung = cross(tuple(faster), at), cross(tuple(rate), cross(tuple(rate), at))  # type: ignore[arg-type]
        weight = STANDARD_GRAVITY if p["loads.gravity"] else 0.0
        roll, pitch = row["attitude.roll"], row["attitude.pitch"]
        down = (-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch))
        c, s = math.cos(p["mounting.azimuth"]), math.sin(p["mounting.azimuth"])

        def turned(v: Any) -> tuple[float, float, float]:
            return v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]

        force = turned([weight * d - g - a - b for d, g, a, b in zip(down, given, *swung, strict=True)])
        w, up = turned(rate), turned(faster)

        def moment(angle: float) -> float:
            cosine, sine = math.cos(angle), math.sin(angle)
            total = row["aero_torque"] + self.lever(angle)[1] * self.mass * force[0]
            for part, mass in self.masses.items():
                x, z = p[f"center_of_mass.{part}.x"], p[f"center_of_mass.{part}.z"]
                total += mass * ((z * cosine - x * sine) * force[0] - (x * cosine + z * sine) * force[2])
            # A plate through the hinge, along (cos, 0, -sin), that the vehicle turns.
            plate = (w[0] * cosine - w[2] * sine) * (w[0] * sine + w[2] * cosine) - up[1]
            return total + self.inertia * plate

        return Around(clip(command + p["valve.null_shift"], 1.0), row["supply_pressure"], moment)

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
        return self.dry[0] + self.lever(angle)[1] * self.dry[1]

    def push(self, y: State, around: Around) -> float:
        """Return the moment [N.m] that friction has to hold at rest."""
        return self.area * self.lever(y[0])[1] * (y[2] - y[3]) + around.moment(y[0])

    def rises(self, y: State, around: Around) -> tuple[float, float]:
        """Return d/dt of both pressures [Pa/s], of chambers without a void."""
        way, slope, _ = self.lever(y[0])
        into_1, into_2 = self.flows(y[4], around.supply, y[2], y[3])
        lost = self.area * slope * y[1] + self.p["cylinder.internal_leakage"] * (y[2] - y[3])
        beta, dead = self.p["oil.bulk_modulus"], self.p["cylinder.dead_volume"]
        return beta * (into_1 - lost) / (dead + self.area * way), beta * (into_2 + lost) / (dead - self.area * way)

    def spool_force(self, y: State, around: Around) -> float:
        """Return the spool's acceleration [1/s2] where nothing limits it."""
        w, damping = self.frequency, self.p["valve.damping"]
        return w * w * (around.command - y[4]) - 2.0 * damping * w * y[5]

    def slope(self, y: State, mode: Mode, around: Around) -> tuple[float, ...]:
        """Return d/dt of the state in a mode."""
        turning = 0.0
        if mode.motion:
            _, slope, bend = self.lever(y[0])
            against = self.viscous[0] + slope * slope * self.viscous[1] + self.mass * slope * bend * y[1]
            turning = self.push(y, around) - mode.motion * self.friction(y[0]) - against * y[1]
            turning /= self.inertia + self.mass * slope * slope
        rise_1, rise_2 = self.rises(y, around)
        moving = mode.spool in (FREE, 1, -1)
        return (y[1] if mode.motion else 0.0, turning, 0.0 if mode.void_1 else rise_1, 0.0 if mode.void_2 else rise_2,
                y[5] if moving else 0.0, self.spool_force(y, around) if mode.spool == FREE else 0.0)

    # Modes ------------------------------------------------------------------------------------------------

    def motion_at_rest(self, y: State, around: Around) -> int:
        """Return the direction in which a resting fin breaks away, 0 where friction or a stop holds it."""
        push, held = self.push(y, around), self.friction(y[0]) * (1.0 - 1e-10)
        if push > held and y[0] < self.stop * _CLOSE:
            return 1
        return -1 if -push > held and y[0] > -self.stop * _CLOSE else 0

    def admit(self, y: State, around: Around) -> Mode:
        """Return the mode of a state; puts what is at a limit there."""
        motion = (1 if y[1] > 0.0 else -1) if y[1] else self.motion_at_rest(y, around)
        spool, force = FREE, self.spool_force(y, around)
        if abs(y[4]) >= _CLOSE and y[4] * y[5] >= 0.0 and y[4] * force >= 0.0:
            y[4], y[5], spool = math.copysign(1.0, y[4]), 0.0, 2 if y[4] > 0.0 else -2
        elif abs(y[5]) >= self.fastest * _CLOSE and y[5] * force >= 0.0:
            y[5] = math.copysign(self.fastest, y[5])
            spool = 1 if y[5] > 0.0 else -1
        rises = self.rises([*y[:2], max(y[2], 0.0), max(y[3], 0.0), *y[4:]], around)
        voids = []
        for i in (0, 1):
            y[2 + i] = max(y[2 + i], 0.0)
            voids.append(y[2 + i] == 0.0 and rises[i] <= 0.0)
        return Mode(motion, spool, *voids)

    def guards(self, mode: Mode, around: Around) -> list[tuple[Callable[[State], float], Callable[[State], None]]]:
        """Return what is above 0 while the mode holds, each with what to do with the state where it ends."""
        def nothing(_: State) -> None:
            pass

        def put(place: int, value: float) -> Callable[[State], None]:
            def act(y: State) -> None:
                y[place] = value
            return act

        def slower(side: int) -> Callable[[State], float]:
            return lambda y: self.fastest - side * y[5]

        def filled(i: int) -> Callable[[State], float]:
            return lambda y: y[2 + i]

        def void(i: int) -> Callable[[State], float]:
            return lambda y: -self.rises(y, around)[i]

        def strike(y: State) -> None:
            y[0], y[1] = mode.motion * self.stop, 0.0

        guards: list[tuple[Callable[[State], float], Callable[[State], None]]] = []
        if mode.motion:
            guards += [(lambda y: mode.motion * y[1], put(1, 0.0)),
                      (lambda y: self.stop - mode.motion * y[0], strike)]
        else:
            guards += [(lambda y: self.friction(y[0]) - self.push(y, around) if y[0] < self.stop * _CLOSE else 1.0,
                       nothing),
                      (lambda y: self.friction(y[0]) + self.push(y, around) if y[0] > -self.stop * _CLOSE else 1.0,
                       nothing)]
        if mode.spool == FREE:
            guards += [(slower(side), put(5, side * self.fastest)) for side in (1, -1)]
        elif mode.spool in (1, -1):
            # A hair slower than the fastest, so that it counts as free.
            guards.append((lambda y: mode.spool * self.spool_force(y, around),
                          put(5, mode.spool * self.fastest * (1.0 - 1e-11))))
        if mode.spool in (FREE, 1, -1):
            def end(y: State) -> None:
                y[4], y[5] = math.copysign(1.0, y[4]), 0.0
            guards.append((lambda y: 1.0 - abs(y[4]), end))
        for i, empty in enumerate((mode.void_1, mode.void_2)):
            # A hair above nothing, so that it counts as filled.
            guards.append((void(i), put(2 + i, 1e-3)) if empty else (filled(i), put(2 + i, 0.0)))
        return guards


def advance(plant: Plant, y: State, around: Around, begin: float, end: float) -> State:
    """Integrate from `begin` to `end` [s] through every event; return the state there."""
    from scipy.integrate import solve_ivp

    stalled = 0
    while begin < end:
        mode = plant.admit(y, around)
        guards = plant.guards(mode, around)
        events = []
        for value, _ in guards:
            # What is 0 where the mode begins, as the speed of a fin that starts, is not lost there.
            def event(t: float, s: Array, value: Any = value, begin: float = begin) -> float:
                margin = float(value(s.tolist() if isinstance(s, np.ndarray) else s))
                return max(margin, 1e-300) if t == begin else margin or 1e-300
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
            events.append(event)
        run = solve_ivp(lambda _t, s, mode=mode: plant.slope(s.tolist(), mode, around), (begin, end), np.array(y),
                        method="DOP853", rtol=RTOL, atol=RTOL * SCALES, max_step=MAX_STEP, events=events)
        if run.status < 0:
            raise ArithmeticError(f"integration failed after {begin} s in {mode}: {run.message}")
        y, reached = [float(x) for x in run.y[:, -1]], float(run.t[-1])
        if run.status == 1:
            next(act for (_, act), times in zip(guards, run.t_events, strict=True) if times.size)(y)
        stalled = 0 if reached > begin else stalled + 1
        if stalled > 10:
            raise ArithmeticError(f"modes chatter at {begin} s in {mode}")
        begin = reached
    return y


class Controller(PistonLoop):
    """PI on the piston that the fin's transducer stands for."""

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
        asked = p["controller.position.kp"] * weighted + self.integral
        if abs(asked) <= self.full or asked * (target - piston) <= 0.0:
            self.integral += p["controller.sample_time"] * p["controller.position.ki"] * (target - piston)
        else:
            self.hold(piston)
        self.before = piston
        return clip(asked, self.full) / self.full


def simulate(parameters: Mapping[str, Value], inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Return `time` and the `OUTPUTS` at the rows of `inputs`, each held until the next; SI.

    `inputs` has the row times ``time`` [s], from 0, and the columns that are used. Outputs are left limits.
    """
    p = {name: float(value) for name, value in parameters.items()}
    starts = {"fin_command": 0.0, "aero_torque": 0.0, "supply_pressure": p["hydraulic_supply.pressure"], "enable": 1.0,
              **dict.fromkeys((*MOTION, "attitude.roll", "attitude.pitch", "attitude.yaw"), 0.0)}
    columns = columns_of(inputs, starts)
    instants, row_at, sample_at, arrivals = schedule(inputs["time"], p)

    plant, y = Plant(p), [p["fin.start_angle"], 0.0, p["cylinder.start_pressure"], p["cylinder.start_pressure"], 0., 0.]
    controller, bus = Controller(p, y[0]), Bus(p)
    row, asked, active, records = {n: c[0] for n, c in columns.items()}, [], 0.0, []
    for t, following in zip(instants, [*instants[1:], None], strict=True):
        if t in row_at:
            records.append((t, *y[:5]))
            row = {name: column[row_at[t]] for name, column in columns.items()}
        if following is None:
            break
        if t in sample_at:
            asked.append(controller.sample(y[0], bus.arrived(row["fin_command"]), bool(row["enable"])))
        if t in arrivals:
            active = asked[arrivals[t]]
        y = advance(plant, y, plant.around(row, active if row["enable"] else 0.0), t, following)
    return dict(zip(("time", *OUTPUTS), np.array(records).T, strict=True))
