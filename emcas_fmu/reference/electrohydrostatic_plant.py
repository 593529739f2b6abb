"""The plant of the electrohydrostatic reference: seven first-order equations, one set for each mode.

The equations are those of docs/model/electrohydrostatic.md, written again. The state is fin angle [rad], fin rate
[rad/s], both pressures [Pa], motor speed [rad/s], motor current [A], integral of the drive [V]. A `Mode` says which
piece of them holds; its guards are the zeros that end it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .plant import clip

Vector = Sequence[float]
FIN, RATE, ONE, TWO, SPEED, CURRENT, INTEGRAL = range(7)
FREE, ON_LIMIT, OPEN = 0, 2, 9  # of the drive, beside 1 and -1: clipped on that side
EDGE = 1e-9  # V


class Mode(NamedTuple):
    """Directions of fin and shaft (0: at rest), drive (+-2: gliding along its limit), relief valve's direction, and
    what is open: check valves, voids."""

    fin: int
    shaft: int
    drive: int
    relief: int
    check_1: bool
    check_2: bool
    void_1: bool
    void_2: bool


class Guard:
    """A SciPy event: a zero crossed upwards ends the mode; `then` makes the next one, and may change the state."""

    terminal, direction = True, 1.0

    def __init__(self, value: Callable[[Vector], float], then: Callable[[list[float], Mode], Mode]):
        self.value, self.then = value, then

    def __call__(self, _time: float, y: Vector) -> float:
        # SciPy takes a value that stays at zero for one that crosses.
        return self.value(y) or -1e-300


class Plant:
    """The equations between two instants, under an input `row` and a drive reference [V] that has arrived."""

    def __init__(self, p: Mapping[str, float], row: Mapping[str, float], reference: float):
        self.p, self.enable, self.supply = p, bool(row["enable"]), row["supply_voltage"]
        asked = p["drive.current_gain"] * reference + p["drive.current_offset"]
        self.i_ref = clip(asked, p["drive.current_limit"])
        self.vehicle, self.axial = moment_of_vehicle(p, row)
        self.torque = row["aero_torque"]
        self.refill = p["reservoir.pressure"] - p["check_valve.cracking_pressure"]
        self.inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        open_ = 1.0 if p["bypass_valve.opens_disabled"] and not self.enable else p["bypass_valve.opening"]
        self.leakage = (p["pump.leakage"] + p["cylinder.internal_leakage"]
                        + open_ * p["bypass_valve.conductance"])

    # Mechanics ----------------------------------------------------------------------------------------------

    def lever(self, angle: float) -> tuple[float, float, float]:
        """Return x [m], dx/d(angle) [m] and its derivative [m]."""
        arm, start = self.p["kinematics.moment_arm"], self.p["kinematics.initial_angle"]
        tangent = math.tan(angle + start)
        ratio = arm / math.cos(angle + start) ** 2
        return arm * (tangent - math.tan(start)), ratio, 2.0 * ratio * tangent

    def fin_moment(self, y: Vector) -> float:
        """Return the moment [N.m] of pressures and loads."""
        ratio = self.lever(y[FIN])[1]
        force = self.p["cylinder.area"] * (y[ONE] - y[TWO]) + self.p["cylinder.moving_mass"] * self.axial
        return ratio * force + self.torque + self.vehicle(y[FIN])

    def fin_dry(self, y: Vector) -> float:
        """Return the dry friction [N.m] at the fin."""
        return self.p["friction.fin_coulomb"] + self.lever(y[FIN])[1] * self.p["cylinder.coulomb_friction"]

    def shaft_torque(self, y: Vector) -> float:
        """Return the torque [N.m] of current and pressures on the shaft."""
        return self.p["motor.torque_constant"] * y[CURRENT] - self.p["pump.displacement"] * (y[ONE] - y[TWO])

    def shaft_dry(self, y: Vector) -> float:
        """Return the dry friction [N.m] of the shaft."""
        return self.p["pump.coulomb_friction"] + self.p["pump.pressure_friction"] * abs(y[ONE] - y[TWO])

    # Drive --------------------------------------------------------------------------------------------------

    def demand(self, y: Vector) -> float:
        """Return the voltage [V] asked for."""
        return self.p["drive.kp"] * (self.i_ref - y[CURRENT]) + y[INTEGRAL]

    def limit(self, y: Vector) -> float:
        """Return the largest voltage [V]."""
        across = self.p["motor.pole_pairs"] * self.p["motor.inductance"] * y[SPEED] * y[CURRENT]
        return math.sqrt(max(self.supply**2 - across**2, 0.0))

    def voltage(self, y: Vector) -> float:
        """Return the voltage [V] on the motor."""
        return (clip(self.demand(y), self.limit(y)) if self.enable
                else self.p["motor.back_emf_constant"] * y[SPEED])

    def outward(self, y: Vector, mode: Mode, side: int, moving: bool) -> float:
        """Return how fast [V/s] the demand leaves a limit it stands at, the voltage clipped, the integral `moving`."""
        slopes = self.slope(y, mode._replace(drive=side))
        limit, product = self.limit(y), (self.p["motor.pole_pairs"] * self.p["motor.inductance"])**2
        speed, current = y[SPEED], y[CURRENT]
        falls = product * speed * current * (slopes[SPEED] * current + speed * slopes[CURRENT])
        limit_slope = -falls / limit if limit else 0.0
        integral = self.p["drive.ki"] * (self.i_ref - y[CURRENT]) if moving else 0.0
        return side * (integral - self.p["drive.kp"] * slopes[CURRENT]) - limit_slope

    def at_limit(self, y: Vector, mode: Mode, side: int) -> int:
        """Return the drive's mode where the demand stands at the limit."""
        if self.outward(y, mode, side, False) >= 0.0:
            return side
        return FREE if self.outward(y, mode, side, True) <= 0.0 else side * ON_LIMIT

    # Equations ----------------------------------------------------------------------------------------------

    def slope(self, y: Vector, mode: Mode) -> list[float]:
        """Return d/dt of the state."""
        p, (angle, rate, one, two, speed, current, _) = self.p, y
        position, ratio, bend = self.lever(angle)
        area, mass = p["cylinder.area"], p["cylinder.moving_mass"]
        turning = 0.0
        if mode.fin:
            viscous = p["cylinder.viscous_friction"] * ratio**2 + p["friction.fin_viscous"]
            net = (self.fin_moment(y) - mode.fin * self.fin_dry(y) - viscous * rate - mass * ratio * bend * rate**2)
            turning = net / (self.inertia + mass * ratio**2)
        spinning = 0.0
        if mode.shaft:
            net = self.shaft_torque(y) - mode.shaft * self.shaft_dry(y) - p["pump.viscous_friction"] * speed
            spinning = net / p["inertia.motor"]
        over = (one - two) - mode.relief * p["relief_valve.pressure"] if mode.relief else 0.0
        across = (p["pump.displacement"] * speed - self.leakage * (one - two)
                  - p["relief_valve.conductance"] * over - area * ratio * rate)
        rises = []
        for pressure, flow, check, void, volume in (
                (one, across, mode.check_1, mode.void_1, p["cylinder.dead_volume"] + area * position),
                (two, -across, mode.check_2, mode.void_2, p["cylinder.dead_volume"] - area * position)):
            flow += p["pump.case_leakage"] * (p["reservoir.pressure"] - pressure)
            flow += p["check_valve.conductance"] * (self.refill - pressure) if check else 0.0
            rises.append(p["oil.cavitated_modulus" if void else "oil.bulk_modulus"] / volume * flow)
        electrical = [0.0, 0.0]
        if mode.drive != OPEN:
            voltage = self.demand(y) if mode.drive == FREE else math.copysign(self.limit(y), mode.drive)
            emf = p["motor.back_emf_constant"] * speed
            electrical[0] = (voltage - p["motor.resistance"] * current - emf) / p["motor.inductance"]
            if mode.drive == FREE:
                electrical[1] = p["drive.ki"] * (self.i_ref - current)
        slopes = [rate, turning, *rises, spinning, *electrical]
        if abs(mode.drive) == ON_LIMIT:  # the integral keeps the demand where it is
            side = int(math.copysign(1, mode.drive))
            slopes[INTEGRAL] = -side * self.outward(y, mode, side, False)
        return slopes

    # Modes --------------------------------------------------------------------------------------------------

    def breaks(self, y: Vector) -> tuple[int, int]:
        """Return the directions in which fin and shaft at rest begin to move, 0 where they are held."""
        moment, dry, stop = self.fin_moment(y), self.fin_dry(y), self.p["fin.stop_angle"]
        fin = int(moment > dry and y[FIN] < stop) - int(-moment > dry and y[FIN] > -stop)
        torque, rub = self.shaft_torque(y), self.shaft_dry(y)
        return fin, int(torque > rub) - int(-torque > rub)

    def admit(self, y: list[float], mode: Mode | None) -> Mode:
        """Return the mode after what acts has jumped; an opened bridge loses its current."""
        if not self.enable:
            y[CURRENT] = y[INTEGRAL] = 0.0
        fin, shaft = self.breaks(y)
        low, drop = self.p["oil.cavitation_pressure"], y[ONE] - y[TWO]
        if mode is None:
            over = self.p["relief_valve.pressure"]
            mode = Mode(0, 0, 0, int(drop > over) - int(drop < -over), y[ONE] < self.refill, y[TWO] < self.refill,
                        y[ONE] <= low, y[TWO] <= low)
        mode = mode._replace(fin=mode.fin or fin, shaft=mode.shaft or shaft)
        if not self.enable:
            return mode._replace(drive=OPEN)
        demand, limit = self.demand(y), self.limit(y)
        side = 1 if demand >= 0.0 else -1
        if abs(abs(demand) - limit) <= EDGE:
            return mode._replace(drive=self.at_limit(y, mode, side))
        return mode._replace(drive=side if abs(demand) > limit else FREE)

    def guards(self, mode: Mode) -> list[Guard]:
        """Return what ends a mode."""
        return [*self._of_fin(mode), *self._of_shaft(mode), *self._of_valves(mode), *self._of_drive(mode)]

    def _of_fin(self, mode: Mode) -> list[Guard]:
        way, stop = mode.fin, self.p["fin.stop_angle"]

        def halted(y: list[float], now: Mode) -> Mode:
            y[RATE] = 0.0
            return now._replace(fin=self.breaks(y)[0])

        def struck(y: list[float], now: Mode) -> Mode:
            y[FIN] = way * stop
            return halted(y, now)

        if way:
            return [Guard(lambda y: -way * y[RATE], halted), Guard(lambda y: way * y[FIN] - stop, struck)]
        return [Guard(lambda y, s=s: -1.0 if s * y[FIN] >= stop else s * self.fin_moment(y) - self.fin_dry(y),  # type: ignore[misc]
                      lambda _, now, s=s: now._replace(fin=s)) for s in (1, -1)]  # type: ignore[misc]

    def _of_shaft(self, mode: Mode) -> list[Guard]:
        way = mode.shaft

        def halted(y: list[float], now: Mode) -> Mode:
            y[SPEED] = 0.0
            return now._replace(shaft=self.breaks(y)[1])

        if way:
            return [Guard(lambda y: -way * y[SPEED], halted)]
        return [Guard(lambda y, s=s: s * self.shaft_torque(y) - self.shaft_dry(y),  # type: ignore[misc]
                      lambda _, now, s=s: now._replace(shaft=s)) for s in (1, -1)]  # type: ignore[misc]

    def _of_valves(self, mode: Mode) -> list[Guard]:
        over = self.p["relief_valve.pressure"]
        guards = []
        if mode.relief:
            guards.append(Guard(lambda y: over - mode.relief * (y[ONE] - y[TWO]),
                                lambda _, now: now._replace(relief=0)))
        else:
            guards += [Guard(lambda y, s=s: s * (y[ONE] - y[TWO]) - over,  # type: ignore[misc]
                             lambda _, now, s=s: now._replace(relief=s)) for s in (1, -1)]  # type: ignore[misc]
        for name, place, level in (("check_1", ONE, self.refill), ("check_2", TWO, self.refill),
                                   ("void_1", ONE, self.p["oil.cavitation_pressure"]),
                                   ("void_2", TWO, self.p["oil.cavitation_pressure"])):
            is_ = getattr(mode, name)
            guards.append(Guard(
                lambda y, place=place, level=level, is_=is_: (y[place] - level) * (1.0 if is_ else -1.0),  # type: ignore[misc]
                lambda _, now, name=name, is_=is_: now._replace(**{name: not is_})))  # type: ignore[misc]
        return guards

    def _of_drive(self, mode: Mode) -> list[Guard]:
        drive = mode.drive
        if drive == OPEN:
            return []

        def reached(side: int) -> Callable[[list[float], Mode], Mode]:
            return lambda y, now: now._replace(drive=self.at_limit(y, now, side))

        if drive == FREE:
            return [Guard(lambda y, s=s: s * self.demand(y) - self.limit(y), reached(s))  # type: ignore[misc]
                    for s in (1, -1)]
        side = 1 if drive > 0 else -1
        if abs(drive) != ON_LIMIT:
            return [Guard(lambda y: self.limit(y) - side * self.demand(y), reached(side))]
        return [Guard(lambda y: self.outward(y, mode, side, False), lambda _, now: now._replace(drive=side)),
                Guard(lambda y: -self.outward(y, mode, side, True), lambda _, now: now._replace(drive=FREE))]


def moment_of_vehicle(p: Mapping[str, float], row: Mapping[str, float]) -> tuple[Callable[[float], float], float]:
    """Return the moment [N.m] about the hinge of gravity and the vehicle's motion, as a function of the fin angle
    [rad], and the specific force [m/s2] along the piston.

    The fin with its shaft and fork: point masses for the force, a plate along its chord for the rotation.
    """
    given, rate, faster = (np.array([row[f"{kind}.{axis}"] for axis in "xyz"])
                           for kind in ("acceleration", "angular_rate", "angular_acceleration"))
    roll, pitch = row["attitude.roll"], row["attitude.pitch"]
    down = np.array([-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch)])
    place = np.array([p["mounting.station"], 0.0, 0.0])
    hinge = given + np.cross(faster, place) + np.cross(rate, np.cross(rate, place))
    c, s = math.cos(p["mounting.azimuth"]), math.sin(p["mounting.azimuth"])
    turned = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    force = turned @ ((9.80665 * down if p["loads.gravity"] else 0.0 * down) - hinge)
    (x_rate, _, z_rate), about = turned @ rate, float((turned @ faster)[1])
    parts = ("fin", "shaft", "fork")
    x, z = (sum(p[f"mass.{part}"] * p[f"center_of_mass.{part}.{axis}"] for part in parts) for axis in "xz")
    inertia = sum(p[f"inertia.{part}"] for part in parts)
    along, across = float(force[0]), float(force[2])

    def moment(angle: float) -> float:
        cosine, sine = math.cos(angle), math.sin(angle)
        weight = (z * cosine - x * sine) * along - (x * cosine + z * sine) * across
        plate = (x_rate**2 - z_rate**2) * sine * cosine + x_rate * z_rate * (cosine**2 - sine**2)
        return float(weight + inertia * (plate - about))

    return moment, along
