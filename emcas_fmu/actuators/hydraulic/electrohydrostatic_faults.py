"""Faults of the electrohydrostatic actuator: leakage, a lost reservoir, air, valves that stay open, a seized pump."""

from __future__ import annotations

from ...variables import tunable
from ..plant_fault import PlantFault

_SEIZED = 1e6  # N.m, of dry friction: a pump that nothing turns

FAULTS = (
    PlantFault("leakage", "seals of pump and piston are worn", lambda ops, p, amounts: {
        "pump.leakage": amounts.factor * p.pump.leakage,
        "pump.case_leakage": amounts.factor * p.pump.case_leakage,
        "cylinder.internal_leakage": amounts.factor * p.cylinder.internal_leakage,
    }, (tunable("factor", "1", 1.0, 1e4, "by which leakage rises"),)),
    PlantFault("reservoir_loss", "the reservoir has lost its pressure, for good", lambda ops, p, amounts: {
        "reservoir.pressure": amounts.share * p.reservoir.pressure,
    }, (tunable("share", "1", 0.0, 1.0, "of its pressure that is left"),), lasting=True),
    PlantFault("air", "there is air in the oil", lambda ops, p, amounts: {
        "oil.bulk_modulus": amounts.share * p.oil.bulk_modulus,
    }, (tunable("share", "1", 1e-3, 1.0, "of the bulk modulus that is left"),)),
    PlantFault("relief_open", "the relief valves open too early", lambda ops, p, amounts: {
        "relief_valve.pressure": amounts.share * p.relief_valve.pressure,
    }, (tunable("share", "1", 0.0, 1.0, "of their setting that is left"),)),
    PlantFault("bypass_open", "the bypass valve is open", lambda ops, p, amounts: {
        "bypass_valve.opening": amounts.share,
    }, (tunable("share", "1", 0.0, 1.0, "by which it is open"),)),
    PlantFault("pump_seized", "rotor and pump are seized", lambda ops, p, amounts: {
        "pump.coulomb_friction": _SEIZED,
    }),
)
