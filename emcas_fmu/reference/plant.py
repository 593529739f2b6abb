"""The actuator between two discrete instants: smooth equations of motion, one set for each mode.

The state is (fin angle [rad], fin rate [rad/s], motor current [A], drive integral xi [V]).  Dry friction, the
voltage limit and the mechanical stops make the right-hand side discontinuous; a `Mode` names the smooth piece
in force, and its guards are the functions whose zeros end it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

Value = float | int | bool
Vector = Sequence[float]
Triple = tuple[float, float, float]

STANDARD_GRAVITY = 9.80665  # m/s2
POLYNOMIAL_ANGLE = math.radians(20.0)  # rad, the angle that scales the Coulomb polynomials
# V. Closeness at which the drive is taken to sit on its voltage limit: far above rounding of a 39 V signal
# (1e-14), and a voltage wrong by this much for a millisecond moves the current by less than 2e-9 A.
EDGE = 1e-9

FREE, ON_LIMIT, OPEN = 0, 2, 9  # drive modes beside +1 and -1, which mean clipped at +V_dc and -V_dc


class Mode(NamedTuple):
    """One smooth piece: `motion` is the direction of sliding, or 0 while friction or a stop holds the fin.

    `drive` is FREE, +1/-1 (voltage clipped), +2/-2 (gliding along the limit) or OPEN (bridge disabled). Where the fin
    turns by itself, `fin` is its direction, and `flank` the side on which what moves it presses.
    """

    motion: int
    drive: int
    fin: int = 0
    flank: int = 0


class Surroundings(NamedTuple):
    """What stays constant between two discrete instants."""

    current_reference: float  # A, after gain, offset and limit
    supply: float  # V, above 0
    aero_torque: float  # N.m, positive along +delta
    force: Triple  # m/s2, specific force g_b - a_b at the hinge in the fin's own axes
    turning: Triple  # rad/s, the vehicle's rate in the fin's own axes
    faster: Triple  # rad/s2, its angular acceleration there
    enable: bool


class Guard:
    """A function of the state whose zero, crossed in `direction`, ends the mode (a SciPy event)."""

    terminal = True

    def __init__(self, value: Callable[[Vector], float], direction: int, successor: Callable[[list[float]], Any]):
        self.value, self.direction, self.successor = value, float(direction), successor

    def __call__(self, _time: float, state: Vector) -> float:
        # SciPy counts a value that stays exactly zero as crossing; here a zero is not yet crossed, so that a
        # frictionless fin can rest without load.
        return self.value(state) or -self.direction * sys.float_info.min


def clip(value: float, limit: float) -> float:
    """Return `value` limited to the range -limit to limit, in any unit."""
    return max(-limit, min(limit, value))


def whole_samples(p: Mapping[str, Value], name: str) -> int:
    """Return a time of the bus in whole sample times, half of one upwards."""
    return math.floor(p[name] / p["controller.sample_time"] + 0.5)


def cross(a: Triple, b: Triple) -> Triple:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def over_temperature(p: Mapping[str, Value], kind: str) -> float:
    """Return friction of a kind, viscous or coulomb, at friction.temperature over that at 24 degC.

    Linear between the points of the table, held outside.
    """
    at, ratio = ([p[f"friction.table.{column}[{i}]"] for i in range(5)] for column in ("temperature", kind))
    return float(np.interp(p["friction.temperature"], at, ratio))


class Plant:
    """Mechanics, motor and current-mode drive of one actuator."""

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.parameters = {name: float(value) for name, value in parameters.items()}
        self.arm, self.lead = p["kinematics.moment_arm"], p["screw.lead"]  # m; m/rad
        self.assembly = p["kinematics.initial_angle"]
        self.stop = p["fin.stop_angle"]
        # J_t = J_mt + m_n l^2 and J_ft: what turns with the motor and what turns with the fin (2.8), (2.13).
        self.motor_inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * self.lead**2
        self.fin_inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        self.masses = [(p[f"mass.{part}"], p[f"center_of_mass.{part}.x"], p[f"center_of_mass.{part}.z"])
                       for part in ("fin", "shaft", "fork")]
        self.fin_viscous, self.fin_coulomb = p["friction.fin_viscous"], p["friction.fin_coulomb"]
        warm_to_now = over_temperature(p, "viscous")
        self.coulomb_factor = over_temperature(p, "coulomb")
        self.viscous = {s: p[f"friction.viscous.{n}"] * warm_to_now for s, n in _SIGNS.items()}
        self.polynomial = {s: [p[f"friction.coulomb.{n}[{order}]"] for order in range(7)] for s, n in _SIGNS.items()}
        self.torque_constant, self.emf_constant = p["motor.torque_constant"], p["motor.back_emf_constant"]
        self.resistance, self.inductance = p["motor.resistance"], p["motor.inductance"]
        self.kp, self.ki = p["drive.kp"], p["drive.ki"]
        self.electrical_inductance = p["motor.pole_pairs"] * self.inductance  # V.s/(rad.A), over speed and current

    def as_built(self) -> Plant:
        """Return the plant that deviates from this nominal one."""
        def off(name: str) -> float:
            return 1.0 + self.parameters[f"deviation.{name}"]

        changes = {"kinematics.initial_angle": self.assembly + self.parameters["deviation.kinematics.initial_angle"]}
        for name in ("kinematics.moment_arm", "screw.lead", "motor.torque_constant"):
            changes[name] = self.parameters[name] * off(name)
        for name in ("mass.fin", "inertia.fin"):
            changes[name] = self.parameters[name] * off("mass.fin")
        # One flux makes both constants.
        changes["motor.back_emf_constant"] = self.emf_constant * off("motor.torque_constant")
        for kind in ("coulomb", "viscous"):
            for name, value in self.parameters.items():
                if name.startswith((f"friction.{kind}.", f"friction.fin_{kind}")):
                    changes[name] = value * off(f"friction.{kind}")
        return type(self)({**self.parameters, **changes})

    def start(self, delta: float) -> list[float]:
        """Return the state at rest at a fin angle [rad]."""
        return [delta, 0.0, 0.0, 0.0]

    def fin(self, state: Vector) -> tuple[float, float]:
        """Return angle [rad] and rate [rad/s] of the fin."""
        return state[0], state[1]

    # Kinematics -------------------------------------------------------------------------------------------

    def motor_angle(self, delta: float) -> float:
        """Return motor angle [rad] at fin angle `delta` [rad] (2.1 - 2.5)."""
        return self.arm * (math.tan(delta + self.assembly) - math.tan(self.assembly)) / self.lead

    def fin_angle(self, theta: float) -> float:
        """Return fin angle [rad] at motor angle `theta` [rad], the inverse of (2.5)."""
        return math.atan(self.lead * theta / self.arm + math.tan(self.assembly)) - self.assembly

    def ratio(self, delta: float) -> float:
        """Return reduction ratio R = dtheta_m/ddelta [-] (2.6)."""
        return self.arm / self.lead * (1.0 + math.tan(delta + self.assembly) ** 2)

    def bend(self, delta: float) -> float:
        """Return R'/R [-] at fin angle `delta` [rad] (2.7)."""
        return 2.0 * math.tan(delta + self.assembly)

    # Forces -----------------------------------------------------------------------------------------------

    def motor_coulomb(self, delta: float, direction: int) -> float:
        """Return the Coulomb torque at the motor [N.m] at 24 degC, polynomial in delta / 20 deg, never negative."""
        x, total = delta / POLYNOMIAL_ANGLE, 0.0
        for coefficient in reversed(self.polynomial[direction]):
            total = total * x + coefficient
        return max(total, 0.0)

    def coulomb(self, delta: float, direction: int) -> float:
        """Return the Coulomb moment at the fin T_c = R C_m + C_f [N.m]."""
        return self.ratio(delta) * self.motor_coulomb(delta, direction) * self.coulomb_factor + self.fin_coulomb

    def loads(self, delta: float, around: Surroundings) -> float:
        """Return external moment T_f + l R P_n at the fin [N.m] (2.27 - 2.45), positive along +delta."""
        fx, _, fz = around.force
        c, s = math.cos(delta), math.sin(delta)
        moment = around.aero_torque
        for mass, x, z in self.masses:  # y . (r x m f), r turned right-handed about +y by delta
            moment += mass * ((-x * s + z * c) * fx - (x * c + z * s) * fz)
        # Euler's equation about the hinge for a plate of fin, shaft and fork with its masses along (c, 0, -s): what
        # it takes to turn it with the vehicle is missing from the moment.
        spin, angular = around.turning, self._angular_momentum(around.turning, c, s)
        moment -= self._angular_momentum(around.faster, c, s)[1] + cross(spin, angular)[1]
        # The rotor's share of turning with the vehicle, about its own axis, by the ratio at the hinge.
        rotor = self.parameters["inertia.motor"] + self.parameters["inertia.screw"]
        moment -= self.ratio(delta) * rotor * around.faster[0]
        # l R = d / cos^2 phi is the lever of the screw; P_n = m_n f_x (2.10 - 2.12).
        return moment + self.lead * self.ratio(delta) * self.parameters["mass.nut"] * fx

    def _angular_momentum(self, w: Triple, c: float, s: float) -> Triple:
        """Return I w [kg.m2/s] of the plate about the hinge; of I the products with y are left out."""
        x, z = s * s * w[0] + s * c * w[2], c * c * w[2] + s * c * w[0]
        return self.fin_inertia * x, self.fin_inertia * w[1], self.fin_inertia * z

    def excess(self, state: Vector, around: Surroundings, side: int) -> float:
        """Return moment [N.m] on a resting fin towards `side` beyond what friction holds."""
        moment = self.ratio(state[0]) * self.torque_constant * state[2] + self.loads(state[0], around)
        return side * moment - self.coulomb(state[0], side)

    def surroundings(self, row: Mapping[str, float], drive_input: float) -> Surroundings:
        """Return constants of a segment from an input row (names of the interface) and the delayed DAC value [V]."""
        p = self.parameters
        gravity = STANDARD_GRAVITY if p["loads.gravity"] else 0.0
        roll, pitch = row["attitude.roll"], row["attitude.pitch"]  # a yaw turns about g itself
        given, rate, faster = ((row[f"{kind}.x"], row[f"{kind}.y"], row[f"{kind}.z"])
                               for kind in ("acceleration", "angular_rate", "angular_acceleration"))
        place = (p["mounting.station"], 0.0, 0.0)
        swung = [sum(parts) for parts in zip(given, cross(faster, place), cross(rate, cross(rate, place)), strict=True)]
        x = -gravity * math.sin(pitch) - swung[0]
        y = gravity * math.sin(roll) * math.cos(pitch) - swung[1]
        z = gravity * math.cos(roll) * math.cos(pitch) - swung[2]
        c, s = math.cos(p["mounting.azimuth"]), math.sin(p["mounting.azimuth"])

        def turned(v: Triple) -> Triple:
            return v[0], c * v[1] + s * v[2], -s * v[1] + c * v[2]

        reference = p["drive.current_gain"] * drive_input + p["drive.current_offset"]
        return Surroundings(
            current_reference=clip(reference, p["drive.current_limit"]),
            supply=row["supply_voltage"],
            aero_torque=row["aero_torque"],
            force=turned((x, y, z)),
            turning=turned(rate),
            faster=turned(faster),
            enable=bool(row["enable"]),
        )

    # Drive (2.46, 2.47) -----------------------------------------------------------------------------------

    def demand(self, state: Vector, around: Surroundings) -> float:
        """Return voltage the current controller asks for, before the limit [V]."""
        return self.kp * (around.current_reference - state[2]) + state[3]

    def voltage(self, state: Vector, around: Surroundings) -> float:
        """Return motor terminal voltage [V]; the back-EMF when the bridge is open."""
        if not around.enable:
            return self.emf_constant * self.ratio(state[0]) * state[1]
        return clip(self.demand(state, around), self.limit(state, around))

    def limit(self, state: Vector, around: Surroundings) -> float:
        """Return the largest voltage along the back-EMF [V]: the supply's, less n w L i across it as phasors add."""
        across = self.electrical_inductance * self.ratio(state[0]) * state[1] * state[2]
        return math.sqrt(max(around.supply**2 - across**2, 0.0))

    def _limit_slope(self, state: Vector, slopes: Sequence[float], around: Surroundings) -> float:
        """Return the limit's time derivative [V/s] for those of the state."""
        delta, omega, current = state[:3]
        ratio, limit = self.ratio(delta), self.limit(state, around)
        if limit == 0.0 or self.electrical_inductance == 0.0:
            return 0.0
        speed = ratio * omega
        speed_slope = ratio * (slopes[1] + self.bend(delta) * omega**2)
        across_slope = speed_slope * current + speed * slopes[2]
        return -self.electrical_inductance**2 * speed * current * across_slope / limit

    def _current_slope(self, state: Vector, voltage: float) -> float:
        speed = self.ratio(state[0]) * state[1]
        return (voltage - self.resistance * state[2] - self.emf_constant * speed) / self.inductance

    # Smooth pieces ----------------------------------------------------------------------------------------

    def slope(self, state: Vector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return time derivative of the state in `mode`: rad/s, rad/s2, A/s, V/s."""
        _, omega, current, _ = state
        motion, drive, *_ = mode
        current_slope = integral_slope = 0.0
        if drive == FREE:
            current_slope = self._current_slope(state, self.demand(state, around))
            integral_slope = self.ki * (around.current_reference - current)
        elif drive != OPEN:
            current_slope = self._current_slope(state, math.copysign(self.limit(state, around), drive))
        omega_slope = self._omega_slope(state, motion, around) if motion else 0.0
        if abs(drive) == ON_LIMIT:  # xi keeps the demand exactly on the limit
            moved = self._limit_slope(state, (omega, omega_slope, current_slope), around)
            integral_slope = self.kp * current_slope + math.copysign(moved, drive)
        if motion == 0:
            return 0.0, 0.0, current_slope, integral_slope
        return omega, omega_slope, current_slope, integral_slope

    def _omega_slope(self, state: Vector, motion: int, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of a fin that slides in the direction `motion`."""
        delta, omega, current, _ = state
        tangent = math.tan(delta + self.assembly)
        ratio = self.arm / self.lead * (1.0 + tangent * tangent)
        ratio_slope = 2.0 * ratio * tangent  # R' (2.7)
        moment = (  # (2.15 - 2.17)
            ratio * self.torque_constant * current
            - (ratio * ratio * self.viscous[motion] + self.fin_viscous) * omega
            - self.motor_inertia * ratio * ratio_slope * omega * omega
            + self.loads(delta, around)
            - motion * self.coulomb(delta, motion)
        )
        inertia = self.fin_inertia + self.motor_inertia * ratio * ratio  # M = J_ft + J_t R^2
        return moment / inertia

    # Modes ------------------------------------------------------------------------------------------------

    def motion_at_rest(self, state: Vector, around: Surroundings) -> int:
        """Return direction in which a resting fin breaks away, or 0: friction or a stop holds it."""
        if state[0] < self.stop and self.excess(state, around, 1) > 0.0:
            return 1
        if state[0] > -self.stop and self.excess(state, around, -1) > 0.0:
            return -1
        return 0

    def drive_on_limit(self, state: Vector, motion: int, around: Surroundings, side: int) -> int:
        """Return drive mode that leaves the voltage limit of sign `side`, reached by the demand, consistently.

        Clipped, xi is held and the demand moves with the current alone; free, xi moves too.  When the one
        takes the demand back inside and the other outside, neither can last: the drive glides on the limit.
        """
        if self._held_slope(state, motion, around, side) >= 0.0:
            return side
        return FREE if self._free_slope(state, motion, around, side) <= 0.0 else side * ON_LIMIT

    def _held_slope(self, state: Vector, motion: int, around: Surroundings, side: int) -> float:
        """Return slope [V/s] of the demand out of the limit on `side` while the voltage is clipped and xi is held."""
        slopes = self.slope(state, Mode(motion, side), around)
        return -side * self.kp * slopes[2] - self._limit_slope(state, slopes, around)

    def _free_slope(self, state: Vector, motion: int, around: Surroundings, side: int) -> float:
        """Return the same while xi moves."""
        return self._held_slope(state, motion, around, side) + side * self.ki * (around.current_reference - state[2])

    def admit(self, state: list[float], mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; clears the current of an opened bridge in place."""
        demand, limit = self.demand(state, around), self.limit(state, around)
        side = 1 if demand >= 0.0 else -1
        if not around.enable:
            state[2] = state[3] = 0.0
        motion = mode.motion or self.motion_at_rest(state, around)
        if not around.enable:
            drive = OPEN
        elif abs(abs(demand) - limit) <= EDGE:
            drive = self.drive_on_limit(state, motion, around, side)
        else:
            drive = side if abs(demand) > limit else FREE
        return Mode(motion, drive)

    def guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        """Return events that end `mode`; each successor turns the state at the event into the next mode."""
        return self._motion_guards(mode, around) + self._drive_guards(mode, around)

    def _motion_guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        s, drive, *_ = mode
        if s:

            def halt(state: list[float]) -> Mode:
                state[1] = 0.0
                return Mode(self.motion_at_rest(state, around), drive)

            def strike(state: list[float]) -> Mode:
                state[0] = s * self.stop
                # The inductive voltage goes with the speed, all at once.
                return self.admit(state, halt(state), around)

            return [Guard(lambda y: s * y[1], -1, halt), Guard(lambda y: s * y[0] - self.stop, 1, strike)]

        def breakaway(side: int) -> Guard:
            def excess(state: Vector) -> float:
                if side * state[0] >= self.stop:  # the stop holds against any moment towards it
                    return -1.0
                return self.excess(state, around, side)

            return Guard(excess, 1, lambda state: Mode(side, drive))

        return [breakaway(1), breakaway(-1)]

    def _drive_guards(self, mode: Mode, around: Surroundings) -> list[Guard]:
        motion, drive, *_ = mode
        if drive == OPEN:
            return []

        def reached(side: int) -> Callable[[list[float]], Mode]:
            return lambda state: Mode(motion, self.drive_on_limit(state, motion, around, side))

        def excess(side: int) -> Callable[[Vector], float]:
            return lambda state: side * self.demand(state, around) - self.limit(state, around)

        if drive == FREE:
            return [Guard(excess(side), 1, reached(side)) for side in (1, -1)]
        side = 1 if drive > 0 else -1
        if abs(drive) != ON_LIMIT:
            return [Guard(excess(side), -1, reached(side))]
        return [Guard(lambda y: self._held_slope(y, motion, around, side), 1, lambda _: Mode(motion, side)),
                Guard(lambda y: self._free_slope(y, motion, around, side), -1, lambda _: Mode(motion, FREE))]


_SIGNS = {1: "positive", -1: "negative"}
