"""Runs with faults, for their tests."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sin
from typing import Any

from emcas_fmu.actuators import get
from emcas_fmu.extensions.fault_list import FAULTS, bits
from emcas_fmu.extensions.monitors import MONITORS
from emcas_fmu.parameters import load_parameters

from .runs import values_of

MODEL = "nonlinear+faults"
BASE = load_parameters(model=MODEL)
PLAIN = load_parameters()
BIT = {fault.name: 2.0**i for i, fault in enumerate(FAULTS)}
TRIPPED = {monitor.name: 2**i for i, monitor in enumerate(MONITORS)}


def bits_of(model: str) -> Mapping[str, float]:
    """Return the bits of a model's faults: the general ones, then those that it declares."""
    return {name: 2.0**i for i, name in enumerate(bits(get(model)))}


def wave(t: float) -> float:
    return 0.15 * sin(2.0 * pi * 3.0 * t)


def gust(t: float) -> float:
    return 40.0 * sin(2.0 * pi * 1.7 * t)


def scheduled(model: str, *faults: str, begin: float = 0.0, end: float = 1e9, **more: Any) -> Mapping[str, Any]:
    """Return a model's values with faults from `begin` to `end` [s]; more values by name, ``__`` for the dot."""
    windows = {f"fault.{name}.{edge}": time for name in faults for edge, time in (("begin", begin), ("end", end))}
    return values_of(windows, model=model, **more)
