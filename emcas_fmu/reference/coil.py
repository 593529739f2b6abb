"""Coil, flux, torque and heat of an electromagnetic clutch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .events import Event, State, Vector

ON_SUPPLY, FREE, ON_SUPPRESSOR = 1, 0, -1  # modes of a coil's amplifier: which limit its voltage is on
EDGE = 1e-9  # V, within which of a limit the amplifier is free


class Coil:
    """One clutch and its coil: `gain` and `share` are its parameters of the amplifier and of the torque."""

    def __init__(self, p: Mapping[str, float], gain: str, share: str):
        self.p, self.gain, self.share = p, p[gain], p[share]
        self.resistance, self.clamp = p["coil.resistance"], p["coil.suppression_voltage"]

    def limit(self, flux: float, temperature: float) -> float:
        """Return the torque [N.m] at which the clutch slips."""
        p, rated = self.p, self.p["clutch.rated_torque"]
        warm = max(1.0 + p["clutch.temperature_coefficient"] * (temperature - p["clutch.reference_temperature"]), 0.1)
        magnetic = rated * (1.0 - p["clutch.residual"]) * flux / p["clutch.rated_current"]
        return warm * self.share * (rated * p["clutch.residual"] + magnetic)

    def demand(self, reference: float, current: float) -> float:
        """Return the amplifier's voltage [V] before its limits, at a current reference and a current [A]."""
        return self.resistance * reference + self.gain * (reference - current)

    def mode(self, reference: float, current: float, supply: float) -> int:
        """Return the mode of the amplifier."""
        demand = self.demand(reference, current)
        return ON_SUPPLY if demand > supply + EDGE else ON_SUPPRESSOR if demand < -self.clamp - EDGE else FREE

    def slopes(self, reference: float, mode: int, current: float, flux: float, supply: float) -> tuple[float, float]:
        """Return d/dt of current and flux [A/s]."""
        voltage = (self.demand(reference, current) if mode == FREE else supply if mode == ON_SUPPLY
                   else -self.clamp)
        return ((voltage - self.resistance * current) / self.p["coil.inductance"],
                (current - flux) / self.p["clutch.eddy_time"])

    def events(self, reference: float, mode: int, index: int, supply: float, changed: Callable[[int], Any]
               ) -> list[Event]:
        """Return the events that end a mode of the amplifier, with the coil's current at an `index` of the state.

        `changed` returns the plant's next mode from the amplifier's.
        """
        def demand(y: Vector) -> float:
            return self.demand(reference, y[index])

        def to(next_mode: int) -> Callable[[State], Any]:
            return lambda _: changed(next_mode)

        if mode == FREE:
            return [Event(lambda y: supply - demand(y), to(ON_SUPPLY)),
                    Event(lambda y: demand(y) + self.clamp, to(ON_SUPPRESSOR))]
        limit = supply if mode == ON_SUPPLY else self.clamp
        return [Event(lambda y: mode * demand(y) - limit, to(FREE))]


def warming(p: Mapping[str, float], heat: float, temperature: float) -> float:
    """Return the rise [K/s] of the clutch's temperature [degC] under a power of slip [W]."""
    lost = (temperature - p["friction.temperature"]) / p["clutch.thermal_resistance"]
    return (heat - lost) / p["clutch.heat_capacity"]
