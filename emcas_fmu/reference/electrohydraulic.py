"""Integration of the electrohydraulic actuator from event to event: valve, cylinder and fin.

The equations of docs/model/electrohydraulic.md are written again here. In a mode the fin slides or rests; the spool is
free, at its largest speed or at the end of its stroke; each chamber is full of oil or has a void. The flows of check
valves are continuous and need no event.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from .actuator import Sample
from .events import Accuracy, Event, StateVector
from .piston import ONE, RATE, TWO, Cylinder, PistonLoop
from .vehicle import Surroundings, clip, sign, surroundings

SPOOL, SPOOL_RATE = 4, 5
_CLOSE = 1.0 - 1e-12  # share of a limit at which a value counts as at the limit
FREE = 0  # mode of the spool; +-1 is at its largest speed, +-2 at the end of its stroke


class Mode(NamedTuple):
    """Direction of the sliding fin, 0 at rest; mode of the spool; True for a chamber with a void."""

    fin: int = 0
    spool: int = FREE
    void_1: bool = False
    void_2: bool = False


class Electrohydraulic(Cylinder):
    """Valve, cylinder, lever and fin."""

    accuracy = Accuracy(1e-10, (1e-2, 1.0, 1e6, 1e6, 1e-2, 10.0), 1e-4)
    names = ("fin_angle", "fin_rate", "pressure_1", "pressure_2", "valve_position")
    supply = ("supply_pressure", "hydraulic_supply.pressure")

    def __init__(self, parameters: Mapping[str, float]):
        super().__init__(parameters)
        p = self.p
        # One fully open edge passes the rated flow at half the rated pressure drop.
        self.gain = p["valve.rated_flow"] / math.sqrt(p["valve.rated_pressure"] / 2.0)
        self.fastest, self.tank = 1.0 / p["valve.stroke_time"], p["tank.pressure"]

    def start(self) -> tuple[StateVector, Mode]:
        """Return the state at rest at the start angle, and a mode that `settled` completes."""
        filled = self.p["cylinder.start_pressure"]
        return [self.p["fin.start_angle"], 0.0, filled, filled, 0.0, 0.0], Mode()

    def controller(self, nominal: Electrohydraulic) -> Sample:
        """Return a PI controller of the piston position; the valve command is its speed over the largest."""
        full = nominal.p["valve.rated_flow"] / nominal.p["cylinder.area"]
        return PistonLoop(nominal.p, full, lambda speed, _piston, _y: (speed / full, 0.0)).sample

    def surroundings(self, row: Mapping[str, float], reference: float) -> Surroundings:
        """Return loads and valve command [1], limited and with the null shift, from inputs and the delayed command."""
        command = clip((reference if row["enable"] else 0.0) + self.p["valve.null_shift"], 1.0)
        return surroundings(self.p, row, command, self.supply[0])

    def outputs(self, y: StateVector, _around: Surroundings) -> StateVector:
        return y[:SPOOL_RATE]

    def flows(self, spool: float, supply: float, one: float, two: float) -> tuple[float, float]:
        """Return the flows [m3/s] through valve and check valves into both chambers."""
        lap, soft, k = self.p["valve.lap"], self.p["valve.laminar_pressure"], self.gain

        def through(drop: float) -> float:
            return math.copysign(abs(drop) / (drop * drop + soft * soft) ** 0.25, drop)

        radius = math.hypot(spool, lap)
        a, b = k * (radius + spool) / 2.0, k * (radius - spool) / 2.0
        check = self.p["check_valve.conductance"]
        into_1 = a * through(supply - one) - b * through(one - self.tank) + check * max(self.tank - one, 0.0)
        into_2 = b * through(supply - two) - a * through(two - self.tank) + check * max(self.tank - two, 0.0)
        return into_1, into_2

    def rises(self, y: StateVector, around: Surroundings) -> tuple[float, float]:
        """Return d/dt of both pressures [Pa/s] in chambers without a void."""
        displaced, volume_1, volume_2 = self.chambers(y)
        into_1, into_2 = self.flows(y[SPOOL], around.supply, y[ONE], y[TWO])
        lost = displaced + self.p["cylinder.internal_leakage"] * (y[ONE] - y[TWO])
        beta = self.p["oil.bulk_modulus"]
        return beta * (into_1 - lost) / volume_1, beta * (into_2 + lost) / volume_2

    def spool_acceleration(self, y: StateVector, around: Surroundings) -> float:
        """Return the spool's acceleration [1/s2] without its limits."""
        w, damping = self.p["valve.natural_frequency"], self.p["valve.damping"]
        return w * w * (around.reference - y[SPOOL]) - 2.0 * damping * w * y[SPOOL_RATE]

    def slope(self, y: StateVector, mode: Mode, around: Surroundings) -> tuple[float, ...]:
        rise_1, rise_2 = self.rises(y, around)
        return (y[RATE], self.turning(y, mode.fin, around), 0.0 if mode.void_1 else rise_1,
                0.0 if mode.void_2 else rise_2, y[SPOOL_RATE],
                0.0 if mode.spool else self.spool_acceleration(y, around))

    def settled(self, y: StateVector, mode: Mode, around: Surroundings) -> Any:
        """Return the mode of a state; set values near a limit to the limit in place."""
        spool, acceleration = FREE, self.spool_acceleration(y, around)
        if abs(y[SPOOL]) >= _CLOSE and y[SPOOL] * y[SPOOL_RATE] >= 0.0 and y[SPOOL] * acceleration >= 0.0:
            y[SPOOL], y[SPOOL_RATE], spool = float(sign(y[SPOOL])), 0.0, 2 * sign(y[SPOOL])
        elif abs(y[SPOOL_RATE]) >= self.fastest * _CLOSE and y[SPOOL_RATE] * acceleration >= 0.0:
            spool = sign(y[SPOOL_RATE])
            y[SPOOL_RATE] = spool * self.fastest
        for chamber in (ONE, TWO):
            y[chamber] = max(y[chamber], 0.0)
        void_1, void_2 = (y[chamber] == 0.0 and rise <= 0.0
                          for chamber, rise in zip((ONE, TWO), self.rises(y, around), strict=True))
        return super().settled(y, Mode(mode.fin, spool, void_1, void_2), around)

    def events(self, mode: Mode, around: Surroundings) -> list[Event]:
        def faster(side: int) -> Event:
            return Event(lambda y: self.fastest - side * y[SPOOL_RATE], {SPOOL_RATE: side * self.fastest})

        def chamber(index: int, empty: bool) -> Event:
            if empty:  # slightly above 0 Pa, so that the chamber counts as full
                return Event(lambda y: -self.rises(y, around)[index - ONE], {index: 1e-3})
            return Event(lambda y: y[index], {index: 0.0})

        events = [*super().events(mode, around), chamber(ONE, mode.void_1), chamber(TWO, mode.void_2)]
        if mode.spool == FREE:
            events += [faster(1), faster(-1)]
        elif abs(mode.spool) == 1:
            # Slightly below the largest speed, so that the spool counts as free.
            events.append(Event(lambda y: mode.spool * self.spool_acceleration(y, around),
                                {SPOOL_RATE: mode.spool * self.fastest * (1.0 - 1e-11)}))
        if abs(mode.spool) < 2:
            events.append(Event(lambda y: 1.0 - abs(y[SPOOL]),
                                {SPOOL: lambda y, _: math.copysign(1.0, y[SPOOL]), SPOOL_RATE: 0.0}))
        return events


simulate = Electrohydraulic.simulate
