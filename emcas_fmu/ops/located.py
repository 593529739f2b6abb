"""Operations on floats by IEEE 754, as in compiled code; a number that is not finite stores its origin."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from math import copysign, inf, isfinite, nan
from pathlib import Path

from ..errors import called_from
from .base import Value
from .floats import FLOATS, FloatOps

_FUNCTIONS = ("sin", "cos", "tan", "atan", "exp", "log", "sqrt", "fabs", "floor", "power_of_two", "exponent",
              "pow")
_OPERATORS = {"add": "+", "sub": "-", "mul": "*", "truediv": "/"}


class LocatedFloat(float):
    """A number; `path` is the file in which its operations are located.

    If it is not finite, `origin` is the operation on finite numbers from which it results: file, line, function and
    numbers.
    """

    __slots__ = ("origin", "path")
    origin: str
    path: Path


def located(value: float, path: Path, origin: str = "") -> LocatedFloat:
    """Return a number whose operations are located in the file `path`; `origin` is that of :class:`LocatedFloat`."""
    number = LocatedFloat(value)
    number.path, number.origin = path, origin
    return number


class LocatedFloats(FloatOps):
    """The operations on numbers, located in a file; see :class:`LocatedFloat`."""

    def __init__(self, path: Path) -> None:
        for name in _FUNCTIONS:
            operands = "{:g}, {:g}" if name == "pow" else "{:g}"
            setattr(self, name, partial(_result, path, f"{name}({operands})", getattr(FLOATS, name)))


def _result(path: Path, template: str, function: Callable[..., float], *operands: Value) -> LocatedFloat:
    """Return the result of an operation; `template` formats the operation and its operands in a message."""
    numbers = [float(x) for x in operands]
    try:
        value = function(*numbers)
    except ZeroDivisionError:
        above, below = numbers
        value = nan if above == 0.0 or above != above else copysign(inf, above) * copysign(1.0, below)
    except (ValueError, OverflowError):  # a function outside its domain
        value = nan
    if isfinite(value):
        return located(value, path)
    before = next((x.origin for x in operands if isinstance(x, LocatedFloat) and x.origin), "")
    return located(value, path, before or f"{called_from(path)}: {template.format(*numbers)} = {value:g}")


def _operator(name: str, template: str, swapped: str = "") -> Callable[..., LocatedFloat]:
    """Return an operator of a number, which is the second operand if `swapped` is "r"."""
    own, function = getattr(float, f"__{swapped}{name}__"), getattr(operator, name)

    def method(self: LocatedFloat, *other: Value) -> LocatedFloat:
        try:
            if isfinite(value := own(self, *other)):  # almost always true; operators are twice as fast by this test
                return located(value, self.path)
        except (ZeroDivisionError, TypeError):  # TypeError: the operator of float does not accept the other
            pass
        return _result(self.path, template, function, *((*other, self) if swapped else (self, *other)))

    return method


for _name, _symbol in _OPERATORS.items():
    for _swapped in ("", "r"):
        setattr(LocatedFloat, f"__{_swapped}{_name}__", _operator(_name, f"{{:g}} {_symbol} {{:g}}", _swapped))
for _name in ("neg", "abs"):
    setattr(LocatedFloat, f"__{_name}__", _operator(_name, f"{_name}({{:g}})"))
