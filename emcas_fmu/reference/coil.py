"""Coil, flux, torque and heat of an electromagnetic clutch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .events import Event, StateVector, band

EDGE = 1e-9  # V, by which a demand may exceed a limit while the amplifier is free


class Coil:
    """One clutch and its coil: `gain` and `share` are the names of the parameters K_p [V/A] and the torque's scatter.

    `field` is the mode's field for the voltage: at the supply (1), at the suppressor (-1) or free (0). `current`,
    `flux` and `temperature` are the indices of coil current [A], flux [A] and clutch temperature [degC] in the state.
    """

    def __init__(self, p: Mapping[str, float], gain: str, share: str, field: str, current: int, flux: int,
                 temperature: int):
        self.p, self.gain, self.share, self.field = p, p[gain], p[share], field
        self.current, self.flux, self.temperature = current, flux, temperature
        self.resistance, self.clamp = p["coil.resistance"], p["coil.suppression_voltage"]

    def limit(self, y: StateVector) -> float:
        """Return the torque [N.m] at which the clutch slips."""
        p, rated = self.p, self.p["clutch.rated_torque"]
        warmer = y[self.temperature] - p["clutch.reference_temperature"]
        magnetic = rated * (1.0 - p["clutch.residual"]) * y[self.flux] / p["clutch.rated_current"]
        warm = max(1.0 + p["clutch.temperature_coefficient"] * warmer, 0.1)
        return warm * self.share * (rated * p["clutch.residual"] + magnetic)

    def demand(self, y: StateVector, reference: float) -> float:
        """Return the amplifier's voltage [V] before its limits, at a current reference [A]."""
        return self.resistance * reference + self.gain * (reference - y[self.current])

    def admit(self, y: StateVector, mode: Any, reference: float, supply: float) -> Any:
        """Return the mode after a jump of the reference [A] or the supply [V]."""
        demand = self.demand(y, reference)
        return mode._replace(**{self.field: (demand > supply + EDGE) - (demand < -self.clamp - EDGE)})

    def slopes(self, y: StateVector, mode: Any, reference: float, supply: float) -> tuple[float, float]:
        """Return d/dt of current and flux [A/s]."""
        side = getattr(mode, self.field)
        voltage = supply if side > 0 else -self.clamp if side < 0 else self.demand(y, reference)
        return ((voltage - self.resistance * y[self.current]) / self.p["coil.inductance"],
                (y[self.current] - y[self.flux]) / self.p["clutch.eddy_time"])

    def events(self, mode: Any, reference: float, supply: float) -> list[Event]:
        """Return the events that end a mode of the amplifier."""
        return band(mode, self.field, lambda y: self.demand(y, reference), -self.clamp, supply)

    def warming(self, y: StateVector, heat: float) -> float:
        """Return the rise [K/s] of the clutch's temperature at a slip power `heat` [W]."""
        lost = (y[self.temperature] - self.p["friction.temperature"]) / self.p["clutch.thermal_resistance"]
        return (heat - lost) / self.p["clutch.heat_capacity"]
