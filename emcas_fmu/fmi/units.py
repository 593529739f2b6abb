"""Units in FMI: exponents of the base units, quantities, and display units."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from .. import units
from ..variables import Variable

_BASE = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K", "[angle]": "rad"}
_QUANTITIES = {
    "1": "Ratio", "1/K": "TemperatureCoefficient", "1/s": "InverseTime", "1/s2": "InverseTimeSquared",
    "A": "ElectricCurrent", "A.s": "ElectricCharge", "A/V": "CurrentPerVoltage",
    "F": "Capacitance", "H": "Inductance", "Hz": "Frequency", "J/K": "HeatCapacity",
    "K": "TemperatureDifference", "K/W": "ThermalResistance", "N": "Force", "N.m": "Torque",
    "N.m.s/rad": "RotationalDamping", "N.m/A": "TorqueConstant", "N.m/Pa": "TorquePerPressure",
    "N.m/rad": "RotationalStiffness", "N.s/m": "TranslationalDamping", "N/m": "TranslationalStiffness",
    "Ohm": "Resistance", "Pa": "Pressure", "V": "Voltage", "V.s/rad": "VoltagePerAngularVelocity",
    "V/(A.s)": "VoltagePerCharge", "V/A": "VoltagePerCurrent", "V/rad": "VoltagePerAngle", "W": "Power",
    "degC": "Temperature", "kg": "Mass", "kg.m2": "MomentOfInertia", "m": "Length", "m/N": "TranslationalCompliance",
    "m/rad": "LengthPerAngle", "m/s": "Velocity", "m/s2": "Acceleration", "m2": "Area", "m3": "Volume",
    "m3/(s.Pa)": "HydraulicConductance", "m3/rad": "VolumePerAngle", "m3/s": "VolumeFlowRate", "rad": "Angle",
    "rad/(N.m)": "RotationalCompliance", "rad/s": "AngularVelocity", "rad/s2": "AngularAcceleration",
    "rad/s3": "AngularJerk", "s": "Time"}
# Display units by quantity, for variables without a display unit.
_DISPLAYS = {"Angle": "deg", "AngularVelocity": "deg/s", "BulkModulus": "MPa", "Length": "mm",
             "LengthPerAngle": "mm/rev", "Pressure": "MPa", "Volume": "l", "VolumeFlowRate": "l/min"}
DIFFERENCES = ("TemperatureDifference",)
"""Quantities to which the offset of a unit does not apply."""


@dataclass(frozen=True)
class Unit:
    """A unit of FMI: exponents of the base units; a value in base units is `factor` times the value plus `offset`."""

    exponents: dict[str, int]
    factor: float
    offset: float


@cache
def fmi_unit(name: str) -> Unit:
    """Return a unit by its name. Raises UnitError if the name is unknown."""
    base, factor, offset = units.to_base(name)
    exponents = {symbol: base[dimension] for dimension, symbol in _BASE.items() if dimension in base}
    return Unit(exponents, factor, offset)


def quantity(v: Variable) -> str:
    """Return the quantity of a variable, as one word; empty if neither the variable nor its unit defines one."""
    return v.quantity or _QUANTITIES.get(v.unit, "")


def default_display(quantity: str) -> str:
    """Return the display unit of a quantity; empty if it has none."""
    return _DISPLAYS.get(quantity, "")


def display(v: Variable) -> str:
    """Return the display unit of a variable; empty if it has none."""
    return v.display or default_display(quantity(v))
