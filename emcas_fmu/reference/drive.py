"""Motor winding and current-mode drive (2.46, 2.47), with the modes of its voltage limit.

    L di/dt = v - R i - K_e w        v = clip(K_p (i_ref - i) + xi, +-limit)
    dxi/dt = K_i (i_ref - i) while v is not clipped, else 0

The mode of a drive is FREE, 1 or -1 (clipped at the limit of this sign), +-ON_LIMIT (sliding along it), OPEN (bridge
disabled, no current) or +-DIODES (the diodes of a disabled bridge conduct a current of this sign). An inverter's dead
time reduces v along i.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

from .actuator import ReferenceActuator
from .events import Changes, Event, Margin, StateVector
from .vehicle import Surroundings, clip

FREE, ON_LIMIT, DIODES, OPEN = 0, 2, 8, 9
# V; a demand within this distance of the voltage limit is on it. This is far above the rounding of a 39 V signal
# (1e-14), and such an error for a millisecond changes the current by less than 2e-9 A. It is also the current [A] below
# 0 at which conduction of a diode ends.
EDGE = 1e-9


class Motor(NamedTuple):
    """Motor speed [rad/s], motor current [A], drive integral xi [V] and motor acceleration [rad/s2]; the acceleration
    is used with pole pairs only."""

    speed: float
    current: float
    integral: float
    acceleration: float = 0.0


class Driven(ReferenceActuator):
    """An actuator whose motor has a drive: its mode has a field `drive`; its state has current [A] and integral [V]."""

    current: int
    """Index of the motor's current in the state; the drive's integral follows it."""

    @abstractmethod
    def speed(self, y: StateVector) -> float:
        """Return the speed of the motor [rad/s]."""

    @abstractmethod
    def acceleration(self, y: StateVector, mode: Any, around: Surroundings) -> float:
        """Return the acceleration of the motor [rad/s2]."""

    def motor(self, y: StateVector, mode: Any, around: Surroundings) -> Motor:
        """Return speed, current, drive integral and acceleration of the motor."""
        faster = self.acceleration(y, mode, around) if self.p["motor.pole_pairs"] else 0.0
        return Motor(self.speed(y), y[self.current], y[self.current + 1], faster)

    def flux(self, current: float) -> float:
        """Return the ratio of the flux at a current [A] to that at 0 A: saturation lowers it, at most to 2/3."""
        lost = self.p.get("saturation.share", 0.0)
        return max(1.0 - lost * (current / self.p["saturation.current"]) ** 2, 2.0 / 3.0) if lost else 1.0

    def motor_torque(self, current: float) -> float:
        """Return the torque of the motor [N.m] at a current [A]."""
        return self.p["motor.torque_constant"] * self.flux(current) * current

    def demand(self, m: Motor, around: Surroundings) -> float:
        """Return the output of the current controller [V] before the limit."""
        return self.p["drive.kp"] * (around.reference - m.current) + m.integral

    def _across(self) -> float:
        """Return n L [V.s/(rad.A)]: the inductive voltage n w L i over speed and current."""
        return self.p["motor.pole_pairs"] * self.p["motor.inductance"]

    def limit(self, m: Motor, around: Surroundings) -> float:
        """Return the largest voltage [V] in phase with the back-EMF: sqrt(max(supply^2 - (n w L i)^2, 0))."""
        across = self._across() * m.speed * m.current
        return math.sqrt(max(around.supply**2 - across**2, 0.0))

    def voltage(self, y: StateVector, around: Surroundings) -> float:
        """Return the motor terminal voltage [V]; the back-EMF while the bridge is open and no current flows."""
        m = Motor(self.speed(y), y[self.current], y[self.current + 1])
        mode = self.drive_mode(m, around)
        if mode == OPEN:
            return self.p["motor.back_emf_constant"] * m.speed
        if abs(mode) == DIODES:
            return self._rectified(m, mode, around)[0]
        return clip(self.demand(m, around), self.limit(m, around)) - self._dead(m, around)

    def _dead(self, m: Motor, around: Surroundings) -> float:
        """Return the voltage [V] lost along the current by dead time: the fundamental of +-V t_d f in each phase."""
        dead_time = self.p.get("inverter.dead_time", 0.0)
        if not dead_time:
            return 0.0
        frequency = self.p["inverter.switching_frequency"]
        ripple = around.supply / (16.0 * self.p["motor.inductance"] * frequency)
        return math.sqrt(3.0) * 4.0 / math.pi * around.supply * dead_time * frequency * clip(m.current / ripple, 1.0)

    def _conduction(self, around: Surroundings) -> float:
        """Return the back-EMF [V] above which diodes of an open bridge conduct: its rectified mean is the supply."""
        return around.supply * math.pi / 3.0 if self.p.get("inverter.pole_pairs") else math.inf

    def _begin(self, around: Surroundings) -> list[Event]:
        """Return the events at which the diodes of an open bridge begin to conduct."""
        onset = self._conduction(around)

        def below(way: int) -> Margin:
            return lambda y: onset - way * self.p["motor.back_emf_constant"] * self.speed(y)

        return [] if math.isinf(onset) else [Event(below(way), {"drive": -way * DIODES}) for way in (1, -1)]

    def _rectified(self, m: Motor, mode: int, around: Surroundings) -> tuple[float, float]:
        """Return two voltages [V] of conducting diodes: v in the motor's power v i, and v in L di/dt.

        Up to a back-EMF of 1.4 times the supply they follow a fit to three phases, from twice the supply on phasors,
        and in between a linear mixture of both.
        """
        p, resistance = self.p, self.p["motor.resistance"]
        emf = abs(p["motor.back_emf_constant"] * self.flux(m.current) * m.speed)
        reactance = p["inverter.pole_pairs"] * m.speed * p["motor.inductance"]
        line = 2.0 * math.sqrt(3.0) / math.pi * around.supply
        # (line + R I)^2 + (reactance I)^2 = emf^2
        square, half, rest = resistance**2 + reactance**2, resistance * line, line**2 - emf**2
        amplitude = max((math.sqrt(max(half**2 - square * rest, 0.0)) - half) / square, 0.0)
        over = emf / (line + resistance * amplitude) if emf > line else 1.0
        part = clip((emf / around.supply - 1.7) / 0.6, 0.5) + 0.5 if around.supply > 0.0 else float(emf > 0.0)
        opposed = (1.0 - part) * self._conduction(around) + part * over * line
        fitted = (1.0 - part) * (math.hypot(resistance, 0.8 * reactance) - resistance)
        terminal = -math.copysign(opposed, mode) - fitted * m.current
        return terminal, terminal - part * (over**2 - 1.0) * resistance * m.current

    def electrical(self, m: Motor, mode: int, around: Surroundings) -> tuple[float, float]:
        """Return di/dt [A/s] and dxi/dt [V/s] in a mode of the drive."""
        if mode == OPEN:
            return 0.0, 0.0
        if abs(mode) == DIODES:
            return self._rise(m, self._rectified(m, mode, around)[1]), 0.0
        dead = self._dead(m, around)
        if mode == FREE:
            return self._rise(m, self.demand(m, around) - dead), self.p["drive.ki"] * (around.reference - m.current)
        rise = self._rise(m, math.copysign(self.limit(m, around), mode) - dead)
        if abs(mode) != ON_LIMIT:
            return rise, 0.0
        side = 1 if mode > 0 else -1  # xi keeps the demand on the limit
        return rise, self.p["drive.kp"] * rise + side * self._limit_slope(m, rise, around)

    def _rise(self, m: Motor, voltage: float) -> float:
        """Return di/dt [A/s] at a motor voltage [V]."""
        p = self.p
        induced = p["motor.back_emf_constant"] * self.flux(m.current) * m.speed
        return (voltage - p["motor.resistance"] * m.current - induced) / p["motor.inductance"]

    def _limit_slope(self, m: Motor, rise: float, around: Surroundings) -> float:
        """Return the limit's time derivative [V/s] at a current that rises by `rise` [A/s]."""
        limit, across = self.limit(m, around), self._across()
        if limit == 0.0 or across == 0.0:
            return 0.0
        return -across**2 * m.speed * m.current * (m.acceleration * m.current + m.speed * rise) / limit

    def _held_slope(self, m: Motor, around: Surroundings, side: int) -> float:
        """Return the rate [V/s] at which the demand on `side` rises above the limit, clipped and at constant xi."""
        rise, _ = self.electrical(m, side, around)
        return -side * self.p["drive.kp"] * rise - self._limit_slope(m, rise, around)

    def _free_slope(self, m: Motor, around: Surroundings, side: int) -> float:
        """Return the rate of `_held_slope` [V/s] with a changing xi."""
        return self._held_slope(m, around, side) + side * self.p["drive.ki"] * (around.reference - m.current)

    def _mode_on_limit(self, m: Motor, around: Surroundings, side: int) -> int:
        """Return the next mode of a drive whose demand has reached the limit on `side`.

        In a clipped drive xi is constant and only the current moves the demand; in a free one xi moves it, too. If the
        demand would return inside when clipped but leave when free, the drive slides along the limit. Where the
        inductive voltage needs the whole supply, both limits are 0: the demand goes from one to the other.
        """
        if self._held_slope(m, around, side) >= 0.0:
            return side
        if self.limit(m, around) == 0.0:
            return -side
        return FREE if self._free_slope(m, around, side) <= 0.0 else side * ON_LIMIT

    def drive_mode(self, m: Motor, around: Surroundings) -> int:
        """Return the mode of the drive after a jump of motor or surroundings."""
        if not around.enable:
            if math.isinf(self._conduction(around)):
                return OPEN
            if m.current:
                return DIODES if m.current > 0.0 else -DIODES
            emf = self.p["motor.back_emf_constant"] * m.speed
            if abs(emf) <= self._conduction(around):
                return OPEN
            return -DIODES if emf > 0.0 else DIODES
        demand, limit = self.demand(m, around), self.limit(m, around)
        side = 1 if demand >= 0.0 else -1
        if abs(abs(demand) - limit) <= EDGE:
            return self._mode_on_limit(m, around, side)
        return side if abs(demand) > limit else FREE

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return :meth:`.Actuator.surroundings`. Raises ValueError unless the supply voltage is above 0."""
        if row["supply_voltage"] <= 0.0:
            raise ValueError(f"supply_voltage is {row['supply_voltage']:g} V; this reference needs a value above 0")
        return super().surroundings(row, reference)

    def admit(self, y: StateVector, mode: Any, around: Surroundings) -> Any:
        """Return the mode after a jump of the surroundings; sets a disabled bridge's integral to 0 in place, and its
        current if there are no diodes."""
        if not around.enable:
            y[self.current + 1] = 0.0
            if math.isinf(self._conduction(around)):
                y[self.current] = 0.0
        mode = self.settled(y, mode, around)
        return mode._replace(drive=self.drive_mode(self.motor(y, mode, around), around))

    def events(self, mode: Any, around: Surroundings) -> list[Event]:
        def motor(y: StateVector) -> Motor:
            return self.motor(y, mode, around)

        def beyond(y: StateVector, side: int) -> float:
            m = motor(y)
            return side * self.demand(m, around) - self.limit(m, around)

        def at_limit(side: int) -> Changes:
            return {"drive": lambda y, _: self._mode_on_limit(motor(y), around, side)}

        events, side = super().events(mode, around), 1 if mode.drive > 0 else -1
        if abs(mode.drive) == DIODES:
            return [*events, Event(lambda y: side * y[self.current] + EDGE, {
                self.current: 0.0, "drive": lambda y, _: self.drive_mode(motor(y), around)})]
        if mode.drive == OPEN:
            return [*events, *self._begin(around)]
        if mode.drive == FREE:
            return [*events, Event(lambda y: -beyond(y, 1), at_limit(1)), Event(lambda y: -beyond(y, -1), at_limit(-1))]
        if abs(mode.drive) == ON_LIMIT:
            return [*events, Event(lambda y: -self._held_slope(motor(y), around, side), {"drive": side}),
                    Event(lambda y: self._free_slope(motor(y), around, side), {"drive": FREE})]
        return [*events, Event(lambda y: beyond(y, side), at_limit(side))]
