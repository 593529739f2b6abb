"""Numbers and units as text on pages and terminals."""

from __future__ import annotations

import re
from math import isfinite


def rounded(value: float, form: str) -> str:
    """Return a number as text in a format such as ``+.3f``. Zeros have no sign; inf and nan are a dash."""
    if not isfinite(value):
        return "–"
    text = format(value, form)
    return text if any(digit in text for digit in "123456789") else text.lstrip("+-")


def number(value: float | bool | None) -> str:
    """Return a figure as text: with four significant digits, from 1e4 as a whole number.

    None and nan are a dash, inf is ``not reached``, -inf ``-∞``, a bool ``yes`` or ``no``.
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value != value:
        return "–"
    if not isfinite(value):
        return "not reached" if value > 0.0 else "-∞"
    return rounded(value, ".0f" if abs(value) >= 9999.5 else ".4g")


def beside(value: float | bool | None, limit: float) -> str:
    """Return a figure as `number` does, with more digits if four do not distinguish it from its `limit`."""
    text = number(value)
    if value is None or not isfinite(value) or value == limit:
        return text
    longer = (rounded(value, f".{digits}g") for digits in range(5, 18))
    return text if text != number(limit) else next((each for each in longer if each != number(limit)), text)


def percent(share: float) -> str:
    """Return a share [1] as text in whole percent; a share that would round to 0 has one significant digit."""
    value = 100.0 * share
    text = rounded(value, ".0f")
    return f"{text if text != '0' or not value else rounded(value, '.1g')} %".replace("-", "−")


def with_unit(value: float | bool | None, unit: str, limit: float | None = None) -> str:
    """Return a figure with its unit, typeset; times below 1 s are in ms.

    With a `limit` [`unit`], the figure has enough digits to differ from the limit. An angle below 1e-9 deg is shown as
    0: doubles near 20 deg are 4e-15 deg apart, and the rounding of some thousands of steps adds up.
    """
    if unit == "deg" and value and abs(value) < 1e-9:
        value = 0.0
    if unit == "s" and value and abs(value) < 1.0:
        value, unit, limit = value * 1e3, "ms", None if limit is None else limit * 1e3
    text, symbol = (number(value) if limit is None else beside(value, limit)).replace("-", "−"), typeset(unit)
    if not symbol or not text[-1].isdigit():
        return text
    return f"{text}{symbol}" if symbol[0] == "°" and symbol != "°C" else f"{text} {symbol}"


def typeset(unit: str) -> str:
    """Return a unit as pages show it: ``°`` for deg, ``·`` for the dot, ``²`` and ``³`` for powers; empty for 1."""
    raised = re.sub(r"(?<=[A-Za-z)])[23]", lambda digit: "²³"[int(digit[0]) - 2], unit).replace(".", "·")
    return {"1": "", "deg": "°", "deg/s": "°/s", "degC": "°C"}.get(unit, raised)
