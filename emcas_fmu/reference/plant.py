"""The thesis's actuator between two discrete instants: equations of motion, smooth in each mode.

The state is (fin angle [rad], fin rate [rad/s], motor current [A], drive integral xi [V]). Dry friction, the voltage
limit and the mechanical stops make the right-hand side discontinuous; a `Mode` names the smooth equations in force.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .drive import FREE, Drive, Motor
from .events import Accuracy, Event, State, Value, Vector, friction_events
from .vehicle import Surroundings, as_built, clip, hinge_moment, masses_of, surroundings

POLYNOMIAL_ANGLE = math.radians(20.0)  # rad, the angle that scales the Coulomb polynomials
_SIGNS = {1: "positive", -1: "negative"}


class Mode(NamedTuple):
    """`motion` is the direction of sliding, or 0 while friction or a stop holds the fin; `drive` is the drive's mode.

    Where the fin turns by itself, `fin` is its direction, and `flank` the side on which the transmission presses on it.
    """

    motion: int
    drive: int
    fin: int = 0
    flank: int = 0


def over_temperature(p: Mapping[str, Value], kind: str) -> float:
    """Return friction of a kind, viscous or coulomb, at friction.temperature over that at 24 degC.

    Linear between the points of the table, constant beyond them.
    """
    at, ratio = ([p[f"friction.table.{column}[{i}]"] for i in range(5)] for column in ("temperature", kind))
    return float(np.interp(p["friction.temperature"], at, ratio))


class FinPlant:
    """Lever, screw and fin: kinematics, friction and loads, positive along +delta."""

    def __init__(self, parameters: Mapping[str, Value]):
        p = self.parameters = {name: float(value) for name, value in parameters.items()}
        self.arm, self.lead = p["kinematics.moment_arm"], p["screw.lead"]  # m; m/rad
        self.assembly = p["kinematics.initial_angle"]
        self.stop = p["fin.stop_angle"]
        # J_t = J_mt + m_n l^2 and J_ft: what turns with the motor and what turns with the fin (2.8), (2.13).
        self.motor_inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * self.lead**2
        self.fin_inertia = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
        self.masses = masses_of(p)
        self.fin_viscous, self.fin_coulomb = p["friction.fin_viscous"], p["friction.fin_coulomb"]
        warm_to_now = over_temperature(p, "viscous")
        self.coulomb_factor = over_temperature(p, "coulomb")
        self.viscous = {s: p[f"friction.viscous.{n}"] * warm_to_now for s, n in _SIGNS.items()}
        self.polynomial = {s: [p[f"friction.coulomb.{n}[{order}]"] for order in range(7)] for s, n in _SIGNS.items()}

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
        """Return external moment T_f + l R P_n at the fin [N.m] (2.27 - 2.45)."""
        moment = hinge_moment(self.masses, self.fin_inertia, delta, around)
        # The rotor's share of turning with the vehicle, about its own axis, by the ratio at the hinge.
        rotor = self.parameters["inertia.motor"] + self.parameters["inertia.screw"]
        moment -= self.ratio(delta) * rotor * around.faster[0]
        # l R = d / cos^2 phi is the lever of the screw; P_n = m_n f_x (2.10 - 2.12).
        return moment + self.lead * self.ratio(delta) * self.parameters["mass.nut"] * around.force[0]

    def surroundings(self, row: Mapping[str, float], drive_input: float) -> Surroundings:
        """Return what acts under an input row (names of the interface) and a delayed DAC value [V]."""
        p = self.parameters
        reference = p["drive.current_gain"] * drive_input + p["drive.current_offset"]
        return surroundings(p, row, clip(reference, p["drive.current_limit"]), "supply_voltage")


class Plant(FinPlant):
    """Mechanics, motor and current-mode drive of one actuator."""

    # The step stays below the time constant of the current loop, L/(R + Kp) = 0.11 ms, the shortest there is.
    accuracy = Accuracy(1e-11, (1e-2, 1.0, 1.0, 1.0), 1e-4)

    def __init__(self, parameters: Mapping[str, Value]):
        super().__init__(parameters)
        self.drive = Drive(self.parameters)

    def as_built(self) -> Plant:
        """Return the plant that deviates from this nominal one."""
        return type(self)(as_built(self.parameters))

    def start(self) -> tuple[State, Mode]:
        """Return the state at rest at the start angle, and its mode."""
        return [self.parameters["fin.start_angle"], 0.0, 0.0, 0.0], Mode(0, FREE)

    def fin(self, state: Vector) -> tuple[float, float]:
        """Return angle [rad] and rate [rad/s] of the fin."""
        return state[0], state[1]

    def outputs(self, state: Vector, _mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return fin angle [rad], fin rate [rad/s], motor current [A] and motor voltage [V]."""
        return *self.fin(state), state[2], self.drive.voltage(self.motor(state), around)

    def motor(self, state: Vector) -> Motor:
        """Return speed [rad/s], current [A] and drive integral [V] of the motor."""
        return Motor(self.ratio(state[0]) * state[1], state[2], state[3])

    def excess(self, state: Vector, around: Surroundings, side: int) -> float:
        """Return the moment [N.m] on a resting fin towards `side` beyond what friction, or a stop, holds."""
        if side * state[0] >= self.stop:  # the stop holds against any moment towards it
            return -1.0
        return self._beyond_friction(state, around, side)

    def _beyond_friction(self, state: Vector, around: Surroundings, side: int) -> float:
        moment = self.ratio(state[0]) * self.drive.torque_constant * state[2] + self.loads(state[0], around)
        return side * moment - self.coulomb(state[0], side)

    # Equations --------------------------------------------------------------------------------------------

    def slope(self, state: Vector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        """Return the time derivative of the state: rad/s, rad/s2, A/s, V/s."""
        omega_slope = self._omega_slope(state, mode.motion, around) if mode.motion else 0.0
        electrical = self.drive.slopes(self.motor(state), mode.drive, around,
                                       lambda: self._motor_acceleration(state, omega_slope))
        return state[1] if mode.motion else 0.0, omega_slope, *electrical

    def _omega_slope(self, state: Vector, motion: int, around: Surroundings) -> float:
        """Return the acceleration [rad/s2] of a fin that slides in the direction `motion`."""
        delta, omega, current, _ = state
        tangent = math.tan(delta + self.assembly)
        ratio = self.arm / self.lead * (1.0 + tangent * tangent)
        ratio_slope = 2.0 * ratio * tangent  # R' (2.7)
        moment = (  # (2.15 - 2.17)
            ratio * self.drive.torque_constant * current
            - (ratio * ratio * self.viscous[motion] + self.fin_viscous) * omega
            - self.motor_inertia * ratio * ratio_slope * omega * omega
            + self.loads(delta, around)
            - motion * self.coulomb(delta, motion)
        )
        inertia = self.fin_inertia + self.motor_inertia * ratio * ratio  # M = J_ft + J_t R^2
        return moment / inertia

    def _motor_acceleration(self, state: Vector, omega_slope: float) -> float:
        """Return the acceleration of the motor [rad/s2] at one of the fin [rad/s2]."""
        return self.ratio(state[0]) * (omega_slope + self.bend(state[0]) * state[1] ** 2)

    # Modes ------------------------------------------------------------------------------------------------

    def motion_at_rest(self, state: Vector, around: Surroundings) -> int:
        """Return the direction in which a resting fin breaks away, or 0: friction or a stop holds it."""
        return next((side for side in (1, -1) if self.excess(state, around, side) > 0.0), 0)

    def admit(self, state: State, mode: Mode, around: Surroundings) -> Mode:
        """Return the mode after the surroundings have jumped; clears the current of an opened bridge in place."""
        drive_state = self.motor(state)
        if not around.enable:
            state[2] = state[3] = 0.0
        motion = mode.motion or self.motion_at_rest(state, around)
        return Mode(motion, self.drive.admit(drive_state, around, lambda: self._acceleration(state, motion, around)))

    def _acceleration(self, state: Vector, motion: int, around: Surroundings) -> float:
        """Return the acceleration of the motor [rad/s2] in a direction of motion."""
        return self._motor_acceleration(state, self._omega_slope(state, motion, around) if motion else 0.0)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        """Return the events that end `mode`."""
        return self._motion_events(mode, around) + self.drive.events(
            mode.drive, around, self.motor, lambda y: self._acceleration(y, mode.motion, around),
            lambda _, drive: mode._replace(drive=drive))

    def _motion_events(self, mode: Mode, around: Surroundings) -> list[Event]:
        motion = mode.motion

        def halt(state: State) -> Mode:
            state[1] = 0.0
            return mode._replace(motion=self.motion_at_rest(state, around))

        def strike(state: State) -> Mode:
            state[0] = motion * self.stop
            # The inductive voltage goes with the speed, all at once.
            return self.admit(state, halt(state), around)

        events = friction_events(motion, lambda y: y[1], lambda y, side: self.excess(y, around, side), halt,
                                 lambda side: lambda _: mode._replace(motion=side))
        return [*events, Event(lambda y: self.stop - motion * y[0], strike)] if motion else events
