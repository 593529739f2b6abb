"""Faults of the electrohydrostatic actuator: leakage, a lost reservoir, air, valves that stay open, a seized pump."""

from __future__ import annotations

from ...variables import tunable
from ..plant_fault import PlantFault
from .interface import AIR

_SEIZED = 1e6  # N.m, of dry friction: nothing turns the pump

FAULTS = (
    PlantFault.scaling("leakage", "seals of pump and piston are worn",
                       tunable("factor", "1", 1.0, 1e4, "by which leakage rises"),
                       "pump.leakage", "pump.case_leakage", "cylinder.internal_leakage"),
    PlantFault.scaling("reservoir_loss", "the reservoir has permanently lost its pressure",
                       tunable("share", "1", 0.0, 1.0, "of its pressure that is left"), "reservoir.pressure",
                       lasting=True),
    PlantFault.scaling("air", "there is air in the oil", AIR, "oil.bulk_modulus"),
    PlantFault.scaling("relief_open", "the relief valves open too early",
                       tunable("share", "1", 0.0, 1.0, "of their setting that is left"), "relief_valve.pressure"),
    PlantFault("bypass_open", "the bypass valve is open", lambda ops, p, amounts: {
        "bypass_valve.opening": amounts.share,
    }, (tunable("share", "1", 0.0, 1.0, "by which it is open"),)),
    PlantFault("pump_seized", "rotor and pump are seized", lambda ops, p, amounts: {
        "pump.coulomb_friction": _SEIZED,
    }),
)
