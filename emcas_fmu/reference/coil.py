"""Coil, flux, torque and heat of an electromagnetic clutch, for the references of the actuators that have some."""

from __future__ import annotations

from collections.abc import Mapping

OF_SUPPLY, FREE, OF_SUPPRESSOR = 1, 0, -1  # where a coil's amplifier stands
EDGE = 1e-9  # V, within which of a limit it is free


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

    def demand(self, asked: float, current: float) -> float:
        """Return the voltage [V] that the amplifier would give."""
        return self.resistance * asked + self.gain * (asked - current)

    def side(self, asked: float, current: float, supply: float) -> int:
        """Return where the amplifier stands."""
        demand = self.demand(asked, current)
        return OF_SUPPLY if demand > supply + EDGE else OF_SUPPRESSOR if demand < -self.clamp - EDGE else FREE

    def slopes(self, asked: float, side: int, current: float, flux: float, supply: float) -> tuple[float, float]:
        """Return d/dt of current and flux [A/s]."""
        voltage = self.demand(asked, current) if side == FREE else supply if side == OF_SUPPLY else -self.clamp
        return ((voltage - self.resistance * current) / self.p["coil.inductance"],
                (current - flux) / self.p["clutch.eddy_time"])

    def left(self, asked: float, side: int, current: float, supply: float) -> dict[int, float]:
        """Return by the place where the amplifier stands next how far [V] it is to there."""
        demand = self.demand(asked, current)
        if side == FREE:
            return {OF_SUPPLY: supply - demand, OF_SUPPRESSOR: demand + self.clamp}
        return {FREE: side * demand - (supply if side == OF_SUPPLY else self.clamp)}


def warming(p: Mapping[str, float], heat: float, temperature: float) -> float:
    """Return the rise [K/s] of the clutch's temperature under a power of slip [W]."""
    lost = (temperature - p["friction.temperature"]) / p["clutch.thermal_resistance"]
    return (heat - lost) / p["clutch.heat_capacity"]
