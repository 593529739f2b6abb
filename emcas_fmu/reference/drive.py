"""Motor winding and current-mode drive (2.46, 2.47), with the modes of its voltage limit.

    L di/dt = v - R i - K_e w        v = clip(K_p (i_ref - i) + xi, +-limit)        dxi/dt = K_i (i_ref - i), free only

A drive is FREE, clipped on a side (1 or -1), gliding along the limit on a side (2 or -2), or OPEN (bridge disabled).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from .events import Event, State, Vector
from .vehicle import Surroundings, clip

FREE, ON_LIMIT, OPEN = 0, 2, 9
# V. A demand this close to the voltage limit is on it: far above the rounding of a 39 V signal (1e-14), and a voltage
# wrong by this much for a millisecond moves the current by less than 2e-9 A.
EDGE = 1e-9


class Motor(NamedTuple):
    """Motor speed [rad/s], motor current [A], drive integral xi [V]."""

    speed: float
    current: float
    integral: float


class Drive:
    """Winding and drive of a motor whose speed is a function of some state."""

    def __init__(self, p: Mapping[str, float]):
        self.torque_constant, self.emf_constant = p["motor.torque_constant"], p["motor.back_emf_constant"]
        self.resistance, self.inductance = p["motor.resistance"], p["motor.inductance"]
        self.kp, self.ki = p["drive.kp"], p["drive.ki"]
        self.electrical_inductance = p["motor.pole_pairs"] * self.inductance  # V.s/(rad.A), over speed and current

    def demand(self, m: Motor, around: Surroundings) -> float:
        """Return the output of the current controller [V] before the limit."""
        return self.kp * (around.reference - m.current) + m.integral

    def limit(self, m: Motor, around: Surroundings) -> float:
        """Return the largest voltage along the back-EMF [V]: the supply's, less n w L i across it as phasors add."""
        across = self.electrical_inductance * m.speed * m.current
        return math.sqrt(max(around.supply**2 - across**2, 0.0))

    def voltage(self, m: Motor, around: Surroundings) -> float:
        """Return the motor terminal voltage [V]; the back-EMF while the bridge is open."""
        if not around.enable:
            return self.emf_constant * m.speed
        return clip(self.demand(m, around), self.limit(m, around))

    def slopes(self, m: Motor, mode: int, around: Surroundings, accelerate: Callable[[], float]
               ) -> tuple[float, float]:
        """Return di/dt [A/s] and dxi/dt [V/s] in a mode; `accelerate` gives the motor's acceleration [rad/s2]."""
        if mode == OPEN:
            return 0.0, 0.0
        if mode == FREE:
            return self._current_slope(m, self.demand(m, around)), self.ki * (around.reference - m.current)
        current_slope = self._current_slope(m, math.copysign(self.limit(m, around), mode))
        if abs(mode) != ON_LIMIT:
            return current_slope, 0.0
        side = 1 if mode > 0 else -1  # xi keeps the demand exactly on the limit
        return current_slope, self.kp * current_slope + side * self._limit_slope(m, current_slope, around, accelerate)

    def _current_slope(self, m: Motor, voltage: float) -> float:
        return (voltage - self.resistance * m.current - self.emf_constant * m.speed) / self.inductance

    def _limit_slope(self, m: Motor, current_slope: float, around: Surroundings, accelerate: Callable[[], float]
                     ) -> float:
        """Return the limit's time derivative [V/s]."""
        limit = self.limit(m, around)
        if limit == 0.0 or self.electrical_inductance == 0.0:
            return 0.0
        across_slope = accelerate() * m.current + m.speed * current_slope
        return -self.electrical_inductance**2 * m.speed * m.current * across_slope / limit

    # Modes ------------------------------------------------------------------------------------------------

    def _held_slope(self, m: Motor, around: Surroundings, side: int, accelerate: Callable[[], float]) -> float:
        """Return how fast [V/s] the demand leaves the limit on `side` while the voltage is clipped and xi is held."""
        current_slope, _ = self.slopes(m, side, around, accelerate)
        return -side * self.kp * current_slope - self._limit_slope(m, current_slope, around, accelerate)

    def _free_slope(self, m: Motor, around: Surroundings, side: int, accelerate: Callable[[], float]) -> float:
        """Return the same while xi moves."""
        return self._held_slope(m, around, side, accelerate) + side * self.ki * (around.reference - m.current)

    def mode_on_limit(self, m: Motor, around: Surroundings, side: int, accelerate: Callable[[], float]) -> int:
        """Return the mode that follows where the demand has reached the limit on `side`.

        Clipped, xi is held and the demand moves with the current alone; free, xi moves too. Where the first takes the
        demand back inside and the second takes it outside, neither can last: the drive glides on the limit.
        """
        if self._held_slope(m, around, side, accelerate) >= 0.0:
            return side
        return FREE if self._free_slope(m, around, side, accelerate) <= 0.0 else side * ON_LIMIT

    def admit(self, m: Motor, around: Surroundings, accelerate: Callable[[], float]) -> int:
        """Return the mode after the surroundings have jumped."""
        if not around.enable:
            return OPEN
        demand, limit = self.demand(m, around), self.limit(m, around)
        side = 1 if demand >= 0.0 else -1
        if abs(abs(demand) - limit) <= EDGE:
            return self.mode_on_limit(m, around, side, accelerate)
        return side if abs(demand) > limit else FREE

    def events(self, mode: int, around: Surroundings, motor: Callable[[Vector], Motor],
               acceleration: Callable[[Vector], float], changed: Callable[[State, int], Any]) -> list[Event]:
        """Return the events that end a mode, of a motor and an acceleration [rad/s2] that follow from the state.

        `changed` returns the plant's next mode at a state from the drive's.
        """
        def beyond(y: Vector, side: int) -> float:
            m = motor(y)
            return side * self.demand(m, around) - self.limit(m, around)

        def reached(side: int) -> Callable[[State], Any]:
            return lambda y: changed(y, self.mode_on_limit(motor(y), around, side, lambda: acceleration(y)))

        if mode == OPEN:
            return []
        if mode == FREE:
            return [Event(lambda y: -beyond(y, 1), reached(1)), Event(lambda y: -beyond(y, -1), reached(-1))]
        side = 1 if mode > 0 else -1
        if abs(mode) != ON_LIMIT:
            return [Event(lambda y: beyond(y, side), reached(side))]
        return [Event(lambda y: -self._held_slope(motor(y), around, side, lambda: acceleration(y)),
                      lambda y: changed(y, side)),
                Event(lambda y: self._free_slope(motor(y), around, side, lambda: acceleration(y)),
                      lambda y: changed(y, FREE))]
