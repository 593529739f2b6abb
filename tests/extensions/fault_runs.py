"""Runs with faults, for their tests."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sin
from typing import Any

import numpy as np

from emcas_fmu.actuators import get
from emcas_fmu.extensions.fault_list import FAULTS, bits
from emcas_fmu.extensions.monitors import MONITORS
from emcas_fmu.parameters import load_parameters
from tests.default_actuator import OUTPUTS

MODEL = "nonlinear+faults"
BASE = load_parameters(model=MODEL)
PLAIN = load_parameters()
BIT = {fault.name: 2.0**i for i, fault in enumerate(FAULTS)}
TRIPPED = {monitor.name: 2**i for i, monitor in enumerate(MONITORS)}
SHARED = [v.name for v in OUTPUTS]


def bits_of(model: str) -> Mapping[str, float]:
    """The bits of a model's faults: the general ones, then those that it declares."""
    return {name: 2.0**i for i, name in enumerate(bits(get(model)))}


def wave(t: float) -> float:
    return 0.15 * sin(2.0 * pi * 3.0 * t)


def gust(t: float) -> float:
    return 40.0 * sin(2.0 * pi * 1.7 * t)


def scheduled(model: str, *faults: str, begin: float = 0.0, end: float = 1e9, **more: Any) -> Mapping[str, Any]:
    """A model's values with faults in a window; more values by name, ``__`` for the dot."""
    windows = {f"fault.{name}.{edge}": time for name in faults for edge, time in (("begin", begin), ("end", end))}
    return load_parameters(model=model).with_values(
        windows | {name.replace("__", "."): value for name, value in more.items()}).values


def equal(one: Mapping[str, Any], other: Mapping[str, Any], rows: slice = slice(None)) -> bool:
    """Whether all that the second run has is the same in both."""
    return all(np.array_equal(one[name][rows], column[rows]) for name, column in other.items())
