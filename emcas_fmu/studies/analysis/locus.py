"""Root locus against a parameter: exact poles of the sampled loop, mapped to s = ln(z)/T."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import takewhile

import numpy as np
from scipy.optimize import brentq

from ...actuators import get
from ...bench.linear.actuator import LinearActuator
from ...bench.linear.frequency import continuous_poles
from ...bench.linear.systems import ROUNDING, Array, largest_pole
from ...errors import EmcasError, hint
from ...parameters import ParameterSet

_POINTS = 81  # number of values of the parameter
_DECADES = 1.0  # range of the values in decades, to each side of the nominal one


@dataclass(frozen=True)
class Locus:
    """Poles [rad/s], an array for each of the ``values`` of a parameter [unit]; ``nominal`` is the set's value.

    ``stable_range`` is the interval around the nominal value, within ``values``, in which the loop is stable.
    ``rational`` are the poles of the continuous approximation with a Padé delay at the nominal value.
    """

    name: str
    unit: str
    nominal: float
    values: Array
    poles: list[Array]
    stable_range: tuple[float, float]
    rational: Array


def locus(parameters: ParameterSet, name: str | None = None, fin_angle: float = 0.0, aero_torque: float = 0.0) -> Locus:
    """Return the poles at `fin_angle` [rad] under `aero_torque` [N.m] over the parameter `name`.

    By default it is the first gain other than 0. Its values are 0.1 to 10 times the nominal one, without those outside
    its limits or without an operating point. Raises EmcasError for a parameter that is not a number of the set, is 0 or
    moves no pole.
    """
    model = parameters.model
    numbers = {v.name: v for v in get(model).file_entries if v.kind == "Real"}
    gains = [v.name for v in numbers.values() if v.variability == "tunable" and v.name.startswith("controller.")]
    if name is None and not gains:
        raise EmcasError(f"model {model}: has no tunable parameter controller.*; choose another one as locus")
    name = next((each for each in gains if parameters.values[each]), gains[0]) if name is None else name
    if name not in numbers:
        raise EmcasError(f"locus {name!r}: there is no such parameter"
                         f"{hint(name, numbers) or '; see emcas parameters'}")
    nominal = float(parameters.values[name])
    if nominal == 0.0:
        raise EmcasError(f"locus {name}: is 0, and a locus scales its parameter; set another value in a parameter file")

    @cache
    def at(value: float) -> LinearActuator:
        return LinearActuator(parameters.with_values({name: value}).values, fin_angle, aero_torque, model)

    def growth(value: float) -> float:
        return largest_pole(at(value).closed) - (1.0 - ROUNDING)

    values, poles = [], []
    for value in np.sort(nominal * np.geomspace(10.0**-_DECADES, 10.0**_DECADES, _POINTS)).tolist():
        with suppress(EmcasError):  # outside the parameter's limits, or without an operating point
            poles.append(continuous_poles(at(value).closed))
            values.append(value)
    if not _moved(poles):
        raise EmcasError(f"locus {name}: moves no pole of the linearised loop; choose a gain"
                         + "".join(f" such as {gain}" for gain in gains[:1]))
    ends = []
    for outwards in ([v for v in reversed(values) if v < nominal], [v for v in values if v > nominal]):
        stable = [nominal, *takewhile(lambda value: growth(value) < 0.0, outwards)]
        unstable = outwards[len(stable) - 1:]
        ends.append(float(brentq(growth, stable[-1], unstable[0], rtol=1e-6)) if unstable else stable[-1])
    return Locus(name, numbers[name].unit, nominal, np.array(values), poles, (ends[0], ends[1]),
                 at(nominal).rational().poles())


def _moved(poles: list[Array]) -> bool:
    """Return whether the number of poles or, by more than rounding, a pole differs between first and last value."""
    if len(poles) < 2 or len(poles[0]) != len(poles[-1]):
        return len(poles) > 1
    first, last = (np.sort_complex(np.exp(1e-3 * ends)) for ends in (poles[0], poles[-1]))
    return bool(np.max(np.abs(first - last), initial=0.0) > 1e-9)
