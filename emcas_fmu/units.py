"""Units of measurement, and their conversion to the units of variables.

Angle is a dimension here. In the SI radians are pure numbers, and a speed in revolutions per minute would be accepted
where 1/s is expected. Arithmetic is decimal: 3.7 ms is exactly 0.0037 s.
"""

from __future__ import annotations

import re
from decimal import Context, Decimal, localcontext
from functools import cache, lru_cache
from math import isfinite, pi

from pint import Unit, UnitRegistry

from .errors import hint

RPM = 30.0 / pi
"""Speed [rpm] of 1 rad/s: pages and terminals show speeds of motors and screws in rpm."""

# In pint's notation: "name = definition = symbol = alias = ...".
_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
ampere = [current] = A = amp
kelvin = [temperature]; offset: 0 = K
radian = [angle] = rad
turn = 6.283185307179586476925286766559005768 * radian = _ = revolution = rev
degree = turn / 360 = deg
arcminute = degree / 60 = arcmin
arcsecond = arcminute / 60 = arcsec
minute = 60 * second = min
hour = 60 * minute = h
hertz = 1 / second = Hz
rpm = turn / minute
inch = 0.0254 * meter = in
foot = 12 * inch = ft = feet
pound = 0.45359237 * kilogram = lb
ounce = pound / 16 = oz
slug = pound_force * second ** 2 / foot
standard_gravity = 9.80665 * meter / second ** 2
newton = kilogram * meter / second ** 2 = N
kilogram_force = kilogram * standard_gravity = kgf
pound_force = pound * standard_gravity = lbf
ounce_force = ounce * standard_gravity = ozf
newton_meter = newton * meter = Nm
joule = newton * meter = J
pascal = newton / meter ** 2 = Pa
bar = 1e5 * pascal
psi = pound_force / inch ** 2
liter = 1e-3 * meter ** 3 = l = L = litre
watt = joule / second = W
volt = watt / ampere = V
ohm = volt / ampere = Ω = Ohm
henry = ohm * second = H
farad = ampere * second / volt = F
weber = volt * second = Wb
percent = 0.01 = _
decibel = [level] = dB
degree_Celsius = kelvin; offset: 273.15 = degC = celsius
degree_Fahrenheit = 5 / 9 * kelvin; offset: 255.372222222222222222222222222222 = degF = fahrenheit
"""
_WORD = re.compile("[A-Za-z_µμΩ]+")
_CHARACTERS = re.compile(r"[A-Za-z_µμΩ0-9 °·⋅.*/^()²³⁻¹%-]*")
_QUANTITY = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)\b)"
                       r"\s*(.*?)\s*", re.DOTALL)
_REWRITES = (
    (re.compile("°([CF])"), r"deg\1"),
    (re.compile("°"), "deg"),
    (re.compile("%"), "percent"),
    (re.compile("⁻¹"), "^-1"),
    (re.compile("⁻²"), "^-2"),
    (re.compile(r"[·⋅]|\.(?=[A-Za-z(°])"), "*"),  # N.m
    (re.compile(r"(?<=[A-Za-z])(-?\d)(?![A-Za-z])"), r"^\1"),  # kg.m2, s-1
    (re.compile("^ */"), "1/"),  # /s
)


class UnitError(ValueError):
    """The text is not a number with a known unit, or the unit does not measure the expected quantity."""


def quantity(written: str, written_unit: str, unit: str) -> float:
    """Return the value in `unit` of text such as ``50 mm``, or of ``50`` with a separate `written_unit`.

    Raises UnitError; its message continues a sentence that begins with the name of the value.
    """
    match = _QUANTITY.fullmatch(written)
    if not match:
        raise UnitError(f"is not a number; expected {describe(unit)}")
    number, unit_in_text = match.groups()
    if unit_in_text and written_unit:
        raise UnitError(f"has two units, {unit_in_text} and {written_unit}; leave one out")
    if not isfinite(float(number)):
        raise UnitError(f"is not a finite number; expected {describe(unit)}")
    if not (unit_in_text or written_unit) and unit != "1":
        raise UnitError(f"has no unit; expected {describe(unit)}")
    # A number that is zero as a float may have an exponent that Decimal refuses.
    return convert(Decimal(number if float(number) else 0), unit_in_text or written_unit, unit)


def convert(amount: Decimal, written: str, unit: str) -> float:
    """Convert `amount` from the unit `written` to `unit`; degC and degF are absolute temperatures.

    Raises UnitError if `written` is unknown or cannot be converted.
    """
    with localcontext(Context(prec=34)):
        source, target = _parse(written), _parse(unit)
        if source.dimensionality != target.dimensionality:
            raise UnitError(f"{f'the unit {written}' if written else 'a pure number'} does not measure this "
                            f"quantity; expected {describe(unit)}")
        try:
            if source != target:
                amount = _registry().Quantity(amount, source).to(target).magnitude
            return float(amount)
        except Exception as error:  # pint and decimal: offset units in a product, overflow
            raise UnitError(f"the unit {written} cannot be converted to {unit}: {error}") from error


@cache
def to_base(unit: str) -> tuple[dict[str, int], float, float]:
    """Return the exponents of a unit by dimension, such as ``[mass]``, and its factor and offset to SI base units.

    Raises UnitError for an unknown unit.
    """
    with localcontext(Context(prec=34)):
        parsed = _parse(unit)
        zero, one = (_registry().Quantity(Decimal(amount), parsed).to_base_units() for amount in (0, 1))
        # The registry's base unit of mass is the gram.
        exponents = {dimension: round(float(str(power))) for dimension, power in parsed.dimensionality.items()}
        mass = Decimal(1000) ** exponents.get("[mass]", 0)
        return exponents, float((one.magnitude - zero.magnitude) / mass), float(zero.magnitude)


def factor(unit: str, other: str) -> float:
    """Return the value of 1 `unit` in the `other` unit, of the same quantity. Raises UnitError for an unknown unit."""
    with localcontext(Context(prec=34)):
        return float(_registry().Quantity(Decimal(1), _parse(unit)).to(_parse(other)).magnitude)


def describe(unit: str) -> str:
    """Return the expected text of a quantity in `unit`, for messages."""
    return "a pure number" if unit == "1" else f"a number with a unit such as {unit}"


@lru_cache(maxsize=1)
def _registry() -> UnitRegistry[Decimal]:
    registry: UnitRegistry[Decimal] = UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@lru_cache(maxsize=256)
def _parse(written: str) -> Unit:
    text = written
    for pattern, replacement in _REWRITES:
        text = pattern.sub(replacement, text)
    try:
        if not _CHARACTERS.fullmatch(written):
            raise UnitError("it contains a character that no unit has")
        return _registry().parse_units(text)
    except Exception as error:  # pint's parser fails in many ways, assertions among them
        unknown = [word for word in _WORD.findall(text) if not _registry().parse_unit_name(word)]
        names = [name for name in _registry() if not name.startswith("delta_")]
        nearest = next(filter(None, (hint(word, names) for word in unknown)), "")
        raise UnitError(f"unknown unit {written!r}{nearest}") from error
