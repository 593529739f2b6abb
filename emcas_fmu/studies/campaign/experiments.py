"""The experiments of a campaign: a motion of the command and profiles of other inputs, as excitations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import degrees, pi
from typing import Any

import numpy as np

from ...actuators import get
from ...bench.excitation import COMMAND, Excitation, motion
from ...motions import KINDS, STEP
from ...simulation import Array

REQUIREMENT = "requirement"  # reserved: the columns of requirements begin with it
SAME = ""  # the unit of the input itself
PROFILES: Mapping[str, Mapping[str, str]] = {
    "constant": {"value": SAME},
    "step": {"before": SAME, "after": SAME, "at": "s"},
    "window": {"value": SAME, "begin": "s", "end": "s", "outside": SAME},
    "sine": {"amplitude": SAME, "frequency": "Hz", "offset": SAME},
    "spring": {"stiffness": "N.m/rad", "offset": SAME},
}
"""Kinds of input profiles: their fields with units."""
# Fields that may be left out: the input's start value is the default.
OPTIONAL = ("before", "outside", "offset")


@dataclass(frozen=True)
class Profile:
    """One input over time; the numbers of its fields are named `prefix`, a dot and the field."""

    variable: str
    kind: str
    prefix: str


@dataclass(frozen=True)
class Experiment:
    """One run of each sample: a kind of motion, its `duration` [s] after the command, profiles of other inputs."""

    name: str
    kind: str
    duration: float
    profiles: tuple[Profile, ...] = ()

    @property
    def prefix(self) -> str:
        """What the names of the motion's numbers begin with."""
        return f"experiments.{self.name}"


def excitation(experiment: Experiment, values: Mapping[str, Any], numbers: Mapping[str, Any],
               model: str) -> Excitation:
    """Return the excitation of an experiment; the times of profiles count from the command.

    `values` are the parameters of the `model` (flat, SI), `numbers` those of motions and profiles by name. Those that
    differ between samples are arrays [samples]. Raises ValueError for numbers that contradict each other.
    """
    number = _finder(numbers, experiment.prefix, 0.0)
    amplitude, *shape = (number(field) for field in ("amplitude", *KINDS[experiment.kind].shape))
    each = zip(*(np.ravel(x).tolist() for x in np.broadcast_arrays(*shape)), strict=True) if shape else [()]
    motions = [_of_unit_amplitude(experiment.kind, experiment.duration, *fields) for fields in each]
    one, time = motions[0], motions[0].time - motions[0].begin
    command = one.command if len(motions) == 1 else np.stack([each.command for each in motions])
    columns: dict[str, Any] = {COMMAND: amplitude * command + 0.0}  # no -0.0 for a negative amplitude
    inputs = {v.name: v for v in get(model).inputs}
    spring: Any = 0.0
    for profile in experiment.profiles:
        v = inputs[profile.variable]
        number = _finder(numbers, profile.prefix, v.initial(values))
        if profile.kind == "spring":
            columns[v.name], spring = number("offset"), number("stiffness")
        else:
            columns[v.name] = _SHAPES[profile.kind](time, number)
    size = "" if np.ndim(amplitude) else f" of {degrees(amplitude):.6g} deg"
    return replace(one.holding(columns), title=experiment.kind + size,
                   spring=np.ravel(spring) if np.ndim(spring) else spring)


Number = Callable[[str], Any]


def _finder(numbers: Mapping[str, Any], prefix: str, start: Any) -> Number:
    """Return a function that returns the number of a field, [samples, 1] where samples differ; `start` is the default.
    """
    def number(field: str) -> Any:
        value = numbers.get(f"{prefix}.{field}", start)
        return np.asarray(value, dtype=float)[:, np.newaxis] if np.ndim(value) else float(value)
    return number


@lru_cache(maxsize=64)
def _of_unit_amplitude(kind: str, duration: float, *shape: float) -> Excitation:
    return motion(kind, 1.0, duration, **dict(zip(KINDS[kind].shape, shape, strict=True)))


def _from(time: Array, instant: Any) -> Any:
    """Return whether rows are at an instant or later; a row that is early by a rounding error counts as on it."""
    return time > instant - STEP / 2


def _window(time: Array, number: Number) -> Any:
    begin, end = number("begin"), number("end")
    for first, last in np.broadcast(begin, end):
        if last < first:
            raise ValueError(f"a window's end = {last:g} s is before its begin = {first:g} s")
    return np.where(_from(time, begin) & ~_from(time, end), number("value"), number("outside"))


_SHAPES: Mapping[str, Callable[[Array, Number], Any]] = {
    "constant": lambda time, number: number("value"),
    "step": lambda time, number: np.where(_from(time, number("at")), number("after"), number("before")),
    "window": _window,
    # Row by row: with vectors, numpy's sine of a sample could depend on the samples beside it.
    "sine": lambda time, number: number("offset") + number("amplitude") * np.apply_along_axis(
        np.sin, -1, 2.0 * pi * number("frequency") * np.maximum(time, 0.0)),
}
