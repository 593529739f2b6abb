"""The unknowns of a calibration: free parameters with bounds and priors, from texts such as ``NAME=0.1..0.4 Ohm``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt

from ...errors import EmcasError, hint
from ...parameters import ParameterSet
from ...units import UnitError, quantity

SPREAD = 5.0
"""Ratio of the default upper bound to a parameter's value, and of the value to the default lower bound."""
# Beginnings of the names of parameters that determine the times of samples and ticks.
_SCHEDULE = ("solver.", "controller.sample_time", "command.update_time")
_BOUNDS = re.compile(r"(\S+?)\.\.(\S+)\s*(.*)")
_PRIOR = re.compile(r"(\S+?)\+-(\S+)\s*(.*)")


@dataclass(frozen=True)
class Unknown:
    """A number to fit between two bounds, with its typical `size` and its prior, all in `unit`.

    The prior is a normal distribution with `mean` and 1 `sigma`. The mean of a parameter's default prior is the base
    set's value, its sigma that of a uniform distribution between the bounds: a parameter that the records do not
    determine stays near the base set. The parameter `follower` gets the same value. `has_prior` says that the caller
    has passed a prior.
    """

    name: str
    unit: str
    lower: float
    upper: float
    mean: float
    sigma: float
    size: float
    follower: str = ""
    has_prior: bool = False

    @property
    def start(self) -> float:
        """The initial value: the mean of the prior, limited by the bounds."""
        return min(max(self.mean, self.lower), self.upper)

    def between(self, share: float) -> float:
        """Return the value at a `share` [1] of the interval between the bounds, logarithmic if they are above 0."""
        if self.lower > 0.0 and self.unit != "degC":  # ratios of degC have no meaning
            return float(self.lower * (self.upper / self.lower) ** share)
        return self.lower + (self.upper - self.lower) * share


def nuisance(name: str, unit: str, start: float, size: float, largest: float) -> Unknown:
    """Return an unknown within +-`largest` that is not a parameter; the prior has the sigma `largest`."""
    return Unknown(name, unit, -largest, largest, start, largest, size)


def free_parameters(base: ParameterSet, free: Iterable[str], priors: Iterable[str] = ()) -> list[Unknown]:
    """Return the parameters to fit from ``NAME`` or ``NAME=LOWER..UPPER UNIT``, and priors ``NAME=VALUE+-SIGMA UNIT``.

    Default bounds are a fifth of the value and five times the value, within the limits of the parameter. The name of an
    array frees each of its elements; their default bounds are +- five times the largest magnitude. A parameter that is
    physically equal to a free one, as the back-EMF constant to the torque constant, follows it if their values in the
    base set are equal. Raises EmcasError for other texts and for parameters that cannot be free.
    """
    unknowns = {each.name: each for text in free for each in _free(base, text)}
    if not unknowns:
        raise EmcasError("no parameter is free; name at least one, as in --free motor.resistance")
    for text in priors:
        names, values = _parsed(base, text, _PRIOR, "VALUE+-SIGMA UNIT, as in motor.resistance=0.25+-0.02 Ohm")
        for name in names:
            if name not in unknowns:
                raise EmcasError(f"prior {text}: {name} is not free; free it, or leave the prior out")
            if values is None or not values[1] > 0.0:
                raise EmcasError(f"prior {text}: expected NAME=VALUE+-SIGMA UNIT with a sigma above 0")
            u = unknowns[name]
            if not u.lower <= values[0] <= u.upper:
                raise EmcasError(f"prior {text}: its value is beyond the bounds of {name}, {u.lower:.6g} to "
                                 f"{u.upper:.6g} {u.unit}; correct the value, or widen the bounds")
            unknowns[name] = replace(u, mean=values[0], sigma=values[1], has_prior=True)
    for name, other in (pair for names in base.actuator.equal_parameters for pair in (names, names[::-1])):
        if name in unknowns and other not in unknowns and base.values[other] == base.values[name]:
            unknowns[name] = replace(unknowns[name], follower=other)
    return list(unknowns.values())


def _free(base: ParameterSet, text: str) -> Iterator[Unknown]:
    names, bounds = _parsed(base, text, _BOUNDS, "LOWER..UPPER UNIT, as in motor.resistance=0.1..0.4 Ohm")
    entries = {e.variable.name: e for e in base.entries}
    for name in names:
        v, value = entries[name].variable, float(entries[name].value)
        if v.kind != "Real":
            raise EmcasError(f"{name} is of kind {v.kind}; only real numbers can be free")
        if name.startswith(_SCHEDULE):
            raise EmcasError(f"{name} determines the times at which the model is computed, and simulations depend on "
                             "it abruptly; set it in a parameter file, and free others")
        if v.unit == "degC" and not bounds:
            raise EmcasError(f"{name} is in degC: its value gives no default bounds; give bounds, as in "
                             f"{name}=-40..70 degC")
        lower, upper = bounds or sorted((value / SPREAD, value * SPREAD))
        if len(names) > 1 and not bounds:  # a coefficient may be 0 or change its sign
            upper = SPREAD * max(abs(float(entries[each].value)) for each in names)
            lower = -upper
        if lower == upper:
            raise EmcasError(f"{name} is 0 in the base set, which gives no default bounds; give bounds, as in "
                             f"{name}=0..1{'' if v.unit == '1' else f' {v.unit}'}")
        lower, upper = max(lower, v.minimum), min(upper, v.maximum)
        if not (lower < upper and lower <= value <= upper):
            raise EmcasError(f"{text}: the bounds of {name} must rise and enclose its value in the base set, "
                             f"{value:.6g} {v.unit}")
        yield Unknown(name, v.unit, lower, upper, value, (upper - lower) / sqrt(12.0),
                      max(abs(value), 0.1 * (upper - lower)))


def _parsed(base: ParameterSet, text: str, form: re.Pattern[str],
            expected: str) -> tuple[Sequence[str], tuple[float, float] | None]:
    """Return the name of the parameter, or of each element of an array, and the two numbers in its unit, if any."""
    name, equals, rest = (part.strip() for part in text.partition("="))
    variables = {e.variable.name: e.variable for e in base.entries}
    names = [name] if name in variables else [each for each in variables if each.startswith(f"{name}[")]
    if not names:
        raise EmcasError(f"{base.actuator.name} has no parameter {name}{hint(name, variables)}")
    if not equals:
        return names, None
    match = form.fullmatch(rest)
    if not match:
        raise EmcasError(f"{text}: expected {name}={expected}")
    one, other, written = match.groups()
    unit = variables[names[0]].unit
    try:
        first, second = (quantity(number, written, unit) for number in (one, other))
        if form is _PRIOR:  # sigma is a difference: subtract the offset of a unit such as degC
            second -= quantity("0", written, unit)
    except UnitError as error:
        raise EmcasError(f"{text}: {rest} {error}") from error
    return names, (first, second)
