"""Unknowns of a calibration: free parameters with bounds and priors, read from texts such as ``NAME=0.1..0.4 Ohm``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt

from ...errors import EmcasError, hint
from ...parameters import ParameterSet
from ...units import UnitError, quantity

SPREAD = 5.0
"""Ratio of the default bounds of a parameter to its value."""
# Beginnings of the names of parameters that set at which times samples and ticks are.
_SCHEDULE = ("solver.", "controller.sample_time", "command.update_time")
_BOUNDS = re.compile(r"(\S+?)\.\.(\S+)\s*(.*)")
_PRIOR = re.compile(r"(\S+?)\+-(\S+)\s*(.*)")


@dataclass(frozen=True)
class Unknown:
    """A number to find between two bounds, with its typical `size`, and what is known of it before, in `unit`.

    This is a normal distribution of 1 `sigma` about `mean`. Unless a prior says more, that of a parameter is as wide as
    the interval between its bounds: what the records leave open stays near the base set. `follower` is a parameter that
    is equal to it, `known` says whether a prior is given.
    """

    name: str
    unit: str
    lower: float
    upper: float
    mean: float
    sigma: float
    size: float
    follower: str = ""
    known: bool = False

    @property
    def start(self) -> float:
        """The mean, within the bounds."""
        return min(max(self.mean, self.lower), self.upper)

    def between(self, share: float) -> float:
        """Return the value at a share of the interval between the bounds; by ratios if they are above 0."""
        if self.lower > 0.0 and self.unit != "degC":  # whose zero is none
            return float(self.lower * (self.upper / self.lower) ** share)
        return self.lower + (self.upper - self.lower) * share


def nuisance(name: str, unit: str, start: float, size: float, largest: float) -> Unknown:
    """Return an unknown that is not a parameter, within +-`largest`, of which little is known before."""
    return Unknown(name, unit, -largest, largest, start, largest, size)


def free_parameters(base: ParameterSet, free: Iterable[str], priors: Iterable[str] = ()) -> list[Unknown]:
    """Return the parameters to find, from ``NAME`` or ``NAME=LOWER..UPPER UNIT``, and ``NAME=VALUE+-SIGMA UNIT``.

    Default bounds are a fifth of the value and five times the value, within the limits of the parameter. The name of an
    array frees each of its elements, by default up to five times the largest magnitude of them, with either sign. A
    parameter that is equal to a free one by physics, as the back-EMF constant to the torque constant, follows it, as
    where a parameter file sets only one of them. Raises EmcasError.
    """
    found = {each.name: each for text in free for each in _free(base, text)}
    if not found:
        raise EmcasError("no parameter is free; name at least one, as in --free motor.resistance")
    for text in priors:
        names, values = _parsed(base, text, _PRIOR, "VALUE+-SIGMA UNIT, as in motor.resistance=0.25+-0.02 Ohm")
        for name in names:
            if name not in found:
                raise EmcasError(f"prior {text}: {name} is not free; free it, or leave its prior out")
            if values is None or not values[1] > 0.0:
                raise EmcasError(f"prior {text}: expected NAME=VALUE+-SIGMA UNIT with a sigma above 0")
            if not found[name].lower <= values[0] <= found[name].upper:
                raise EmcasError(f"prior {text}: its value is beyond the bounds of {name}, {found[name].lower:.6g} to "
                                 f"{found[name].upper:.6g} {found[name].unit}; correct it, or widen the bounds")
            found[name] = replace(found[name], mean=values[0], sigma=values[1], known=True)
    for name, other in (pair for names in base.actuator.equal_parameters for pair in (names, names[::-1])):
        if name in found and other not in found and base.values[other] == base.values[name]:
            found[name] = replace(found[name], follower=other)
    return list(found.values())


def _free(base: ParameterSet, text: str) -> Iterator[Unknown]:
    names, bounds = _parsed(base, text, _BOUNDS, "LOWER..UPPER UNIT, as in motor.resistance=0.1..0.4 Ohm")
    entries = {e.variable.name: e for e in base.entries}
    for name in names:
        v, value = entries[name].variable, float(entries[name].value)
        if v.kind != "Real":
            raise EmcasError(f"{name} is of kind {v.kind}; only real numbers can be free")
        if name.startswith(_SCHEDULE):
            raise EmcasError(f"{name} sets when the model is computed, and simulations jump with it; set it in a "
                             "parameter file, and free others")
        if v.unit == "degC" and not bounds:
            raise EmcasError(f"{name} is in degC, whose zero says nothing of its size; give bounds, as in "
                             f"{name}=-40..70 degC")
        lower, upper = bounds or sorted((value / SPREAD, value * SPREAD))
        if len(names) > 1 and not bounds:  # a coefficient may be 0, and change its sign
            upper = SPREAD * max(abs(float(entries[each].value)) for each in names)
            lower = -upper
        if lower == upper:
            raise EmcasError(f"{name} is 0 in the base set, which says nothing of its size; give bounds, as in "
                             f"{name}=0..1{'' if v.unit == '1' else f' {v.unit}'}")
        lower, upper = max(lower, v.minimum), min(upper, v.maximum)
        if not (lower < upper and lower <= value <= upper):
            raise EmcasError(f"{text}: the bounds of {name} must rise and enclose its value in the base set, "
                             f"{value:.6g} {v.unit}")
        yield Unknown(name, v.unit, lower, upper, value, (upper - lower) / sqrt(12.0),
                      max(abs(value), 0.1 * (upper - lower)))


def _parsed(base: ParameterSet, text: str, form: re.Pattern[str],
            expected: str) -> tuple[Sequence[str], tuple[float, float] | None]:
    """Return the names of the parameter, or of the elements of an array, and two numbers in its unit if there are."""
    name, equals, rest = (part.strip() for part in text.partition("="))
    known = {e.variable.name: e.variable for e in base.entries}
    names = [name] if name in known else [each for each in known if each.startswith(f"{name}[")]
    if not names:
        raise EmcasError(f"{base.actuator.name} has no parameter {name}{hint(name, known)}")
    if not equals:
        return names, None
    match = form.fullmatch(rest)
    if not match:
        raise EmcasError(f"{text}: expected {name}={expected}")
    one, other, written = match.groups()
    unit = known[names[0]].unit
    try:
        first, second = (quantity(number, written, unit) for number in (one, other))
        if form is _PRIOR:  # a difference: degC have a zero of their own
            second -= quantity("0", written, unit)
    except UnitError as error:
        raise EmcasError(f"{text}: {rest} {error}") from error
    return names, (first, second)
