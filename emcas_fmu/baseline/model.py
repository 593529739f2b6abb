"""What a baseline is: limits, cases with their approved figures and trajectories, and what they were recorded of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuators import NONLINEAR, get
from .excite import Case

SCHEMA = "emcas-baseline/1"
"""Name and version of the files' layout; the number changes when an entry changes its meaning or goes."""
FILE = "baseline.toml"
DIGITS = 6  # significant, of what is written: a ten-thousandth of the tightest relative limit shipped
NEVER = "never"
"""Written for a figure whose level is not reached."""

Array = NDArray[np.floating[Any]]
_RECORDED = ("fin_angle", "fin_rate", "motor_current", "motor_voltage", "supply_power")
# Outputs a trajectory may have: their display unit, and the factor to it from the variable table's.
TRACES: Mapping[str, tuple[str, float]] = {
    v.name: {"rad": ("deg", float(np.degrees(1.0))), "rad/s": ("deg/s", float(np.degrees(1.0)))}.get(v.unit,
                                                                                              (v.unit, 1.0))
    for v in get(NONLINEAR).outputs if v.kind == "Real" and v.name in _RECORDED}


@dataclass(frozen=True)
class Limit:
    """Largest change of a figure: `absolute` in its unit or `relative` as a share, whichever is larger."""

    absolute: float
    relative: float = 0.0

    def of(self, approved: float) -> float:
        """Largest change from the approved value, in its unit."""
        return max(self.absolute, self.relative * abs(approved)) if isfinite(approved) else 0.0


@dataclass(frozen=True)
class Limits:
    """`figures` by name; `traces` are the largest changes of outputs in display units, every `sample_time` [s]."""

    figures: Mapping[str, Limit]
    traces: Mapping[str, float]
    sample_time: float


@dataclass(frozen=True)
class Approved:
    """A case with the figures (units of FIGURES) and trajectories (display units, from 0 on) approved for it.

    `limits` go before those of the whole baseline.
    """

    case: Case
    figures: Mapping[str, float] = field(default_factory=dict)
    traces: Mapping[str, Array] = field(default_factory=dict)
    limits: Mapping[str, Limit] = field(default_factory=dict)


@dataclass(frozen=True)
class Baseline:
    """`recorded` tells what of; `parameters` are its values in the variable table's units. Both empty in a template."""

    limits: Limits
    cases: tuple[Approved, ...]
    recorded: Mapping[str, str]
    parameters: Mapping[str, Any]


def rounded(value: float) -> float:
    """A value as a file holds it; nan for one that is never reached."""
    return float(f"{value + 0.0:.{DIGITS}g}") if isfinite(value) else nan
