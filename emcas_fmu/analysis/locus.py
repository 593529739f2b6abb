"""Root locus against any parameter: exact poles of the sampled loop, mapped to s = ln(z)/T."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from ..actuators import get
from ..errors import EmcasError
from ..parameters import ParameterSet
from .linear import Array, LinearActuator

_POINTS = 81
_DECADES = 1.0


@dataclass(frozen=True)
class Locus:
    """Poles [rad/s] at ``values`` of a parameter (in its unit), one array each; ``nominal`` is the set's value.

    ``stable_range`` are the values, within those tried, between which the loop is stable around the nominal
    one; ``rational`` the poles of the continuous approximation with a Padé delay at the nominal value.
    """

    name: str
    unit: str
    nominal: float
    values: Array
    poles: list[Array]
    stable_range: tuple[float, float]
    rational: Array


def continuous_poles(linear: LinearActuator) -> Array:
    """Closed-loop poles [rad/s] of the sampled system as those of s; those at z = 0 have no image and are left out."""
    z = linear.closed.poles().astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 1e-9]) / linear.period)


def default(model: str) -> str:
    """Return the name of an actuator's first gain. Raises EmcasError where it has none."""
    for v in get(model).parameters:
        if v.kind == "Real" and v.variability == "tunable" and v.name.startswith("controller."):
            return v.name
    raise EmcasError(f"--model {model}: has no controller.* that is tunable; name a parameter with --locus")


def locus(parameters: ParameterSet, name: str | None = None, fin_angle: float = 0.0, aero_torque: float = 0.0) -> Locus:
    """Poles while a parameter, the first gain unless named, goes from a tenth to ten times its value, as far as it may.

    Raises EmcasError for a name that is no number of the set, is zero, or moves no pole.
    """
    model = parameters.model
    gain = default(model)
    name = name or gain
    known = {v.name: v for v in get(model).file_entries if v.kind == "Real"}
    if name not in known:
        close = get_close_matches(name, known, 1)
        raise EmcasError(f"--locus {name}: there is no such parameter; "
                         + (f"did you mean {close[0]}?" if close else "see emcas parameters"))
    nominal = float(parameters.values[name])
    if nominal == 0.0:
        raise EmcasError(f"--locus {name}: is 0 and a locus scales it; give it a value in a parameter file")

    def at(value: float) -> LinearActuator | None:
        try:
            return LinearActuator(parameters.replace({name: value}).values, fin_angle, aero_torque, model)
        except EmcasError:  # beyond what the parameter, or the operating point, allows
            return None

    tried = [(value, at(value)) for value in nominal * np.geomspace(10.0**-_DECADES, 10.0**_DECADES, _POINTS)]
    made = [(float(value), linear) for value, linear in tried if linear is not None]
    poles = [continuous_poles(linear) for _, linear in made]
    if not _moved(poles):
        raise EmcasError(f"--locus {name}: moves no pole of the linearised loop; choose a gain such as {gain}")
    here = LinearActuator(parameters.values, fin_angle, aero_torque, model)

    def stable(value: float) -> bool:
        linear = at(value)
        return linear is not None and linear.stable

    ends = []
    for side in (-1.0, 1.0):
        beyond = sorted(((v, one.stable) for v, one in made if side * v > side * nominal), key=lambda x: side * x[0])
        inside = nominal
        for value, holds in beyond:
            if not holds:
                inside = _edge(stable, inside, value)
                break
            inside = value
        ends.append(inside)
    return Locus(name, known[name].unit, nominal, np.array([value for value, _ in made]), poles, (ends[0], ends[1]),
                 here.rational().poles())


def _edge(stable: Callable[[float], bool], inside: float, outside: float) -> float:
    """The last stable value between a stable and an unstable one, to a thousandth of their distance."""
    for _ in range(10):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if stable(middle) else (inside, middle)
    return inside


def _moved(poles: list[Array]) -> bool:
    if len(poles) < 2 or len(poles[0]) != len(poles[-1]):
        return len(poles) > 1
    ends: list[Any] = [np.sort_complex(np.exp(each * 1e-3)) for each in (poles[0], poles[-1])]
    return bool(np.max(np.abs(ends[0] - ends[1])) > 1e-9)
