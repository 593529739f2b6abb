"""The excitations of the reference responses: steps, a square wave, sweeps, loads, cold and a voltage sag.

Every case starts with 50 ms at rest. Inputs are rows 1 ms apart, each held until the next. They are rounded to the
digits of a file, so that simulated and stored inputs are equal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..errors import EmcasError, hint
from ..motions import EXCITATIONS, LEAD_IN, RATED, STEP
from .events import Array, Scalar
from .vehicle import clip

SIGNIFICANT_DIGITS = 9  # of the numbers in a reference file
T = TypeVar("T")
EDGE_RATE = 400.0  # deg/s, slope of a square wave's edges: faster than the fin, and therefore saturates the drive
SUPPLY_START = 39.0  # V, start value of the default actuator's supply
TOLERANCE = math.radians(0.002)  # rad, largest error of a fin angle: 1/100 of the accuracy in the thesis's Table 2
_SAG = 28.0 / 39.0  # share of the supply in a sag, below the back-EMF of a fast slew, so that the motor regenerates
_SWEEP_TIME = 12.0  # s, duration of a sweep including the lead-in

# A quantised encoder with exact stiction amplifies any difference, even from rounding: integrations with ticks of 5 and
# 2 us differ by up to 0.0025 deg (docs/model/numerics.md). Trajectories are therefore compared with feedback of the
# true angle and speed.
EXACT: Mapping[str, Scalar] = {"encoder.enabled": False}

Columns = dict[str, Array]


def stored(values: Array) -> Array:
    """Return values rounded to the digits of a reference file."""
    return np.array([float(f"{value:.{SIGNIFICANT_DIGITS}g}") for value in values])


@dataclass(frozen=True)
class ReferenceCase:
    """One excitation; angles in rad, loads in N.m, voltages in V."""

    name: str
    title: str
    kind: str  # of excitation: one of motions.EXCITATIONS, square, or embedded
    stop_time: float  # s
    amplitude: float  # rad, largest magnitude of the command
    build: Callable[[Array], Columns]  # function of the row times [s] that returns the input columns
    overrides: Mapping[str, Scalar] = field(default_factory=lambda: EXACT)  # parameters that the case changes, SI
    step: float = STEP  # s, time between rows

    def inputs(self) -> Columns:
        """Return `time` [s] and the input columns of the case; the arrays are read-only."""
        return dict(self._inputs)

    @cached_property
    def _inputs(self) -> Columns:
        time = stored(np.arange(round(self.stop_time / self.step) + 1) * self.step)
        columns = {"time": time} | {name: stored(column) for name, column in self.build(time).items()}
        for column in columns.values():
            column.flags.writeable = False  # all callers share it
        return columns


def _levels(*points: tuple[float, float]) -> Callable[[Array], Columns]:
    """Return the builder of a command that jumps at each time [s] to a level [deg] and is 0 before the first."""
    return lambda time: {"fin_command": _staircase(time, 0.0, *((at, math.radians(deg)) for at, deg in points))}


def _staircase(time: Array, value: float, *points: tuple[float, float]) -> Array:
    """Return a column that is `value`, then from each point's time [s] on its level."""
    column = np.full_like(time, value)
    for at, level in points:
        column[time > at - STEP / 2] = level
    return column


def _square(time: Array) -> Columns:
    """Return a command of levels +A, 0, -A, 0 with growing A, 150 ms each, joined by ramps (section 5.4.1.2)."""
    levels = [sign * amplitude for amplitude in (5.0, 10.0, 15.0, 20.0) for sign in (1.0, 0.0, -1.0, 0.0)]
    target = _staircase(time, 0.0, *((LEAD_IN + 0.15 * k, level) for k, level in enumerate(levels)))
    command, change = np.zeros_like(time), EDGE_RATE * STEP
    for k in range(1, len(time)):
        command[k] = command[k - 1] + clip(target[k] - command[k - 1], change)
    return {"fin_command": np.radians(command)}


def _swept(amplitude: float) -> Callable[[Array], Columns]:
    """Return the builder of a sweep of `amplitude` [deg] over the time after the lead-in."""
    return lambda time: {"fin_command": EXCITATIONS["sweep"].command(
        time - LEAD_IN, math.radians(amplitude), duration=_SWEEP_TIME - LEAD_IN)}


def _loaded(torque: float) -> Callable[[Array], Columns]:
    """Return the builder of a slew from rest at -20 deg without load to +20 deg; a torque [N.m] rises at its start."""
    slew = 0.35
    return lambda time: {**_levels((LEAD_IN, -20.0), (slew, 20.0))(time),
                         "aero_torque": EXCITATIONS["slew"].torque(time - slew, torque)}


_LARGE = math.radians(20.0)


def sag(supply: float) -> ReferenceCase:
    """Return the case in which a supply that starts at `supply` [V] sags."""
    def build(time: Array) -> Columns:
        command = _levels((LEAD_IN, 20.0), (0.35, -20.0), (0.7, 0.0))(time)
        return command | {"supply_voltage": _staircase(time, supply, (0.4, _SAG * supply), (0.47, supply))}

    title = f"Supply sags from {supply:.3g} to {_SAG * supply:.3g} V during a 40 deg slew and recovers"
    return ReferenceCase("sag", title, "step", 1.0, _LARGE, build)


def with_supply(case: ReferenceCase, supply: float) -> ReferenceCase:
    """Return the case for an actuator whose supply starts at `supply` [V]; only a sag depends on it."""
    return sag(supply) if case.name == "sag" else case


def select(names: Collection[str] | None, known: Mapping[str, T], folder: Path | None = None) -> dict[str, T]:
    """Return the cases with these names, in the order of `known`; without names, all of them.

    Raises EmcasError for an unknown name; its message begins with the `folder`, if any.
    """
    for name in names or ():
        if name not in known:
            raise EmcasError(f"{f'{folder}: ' if folder else ''}there is no case {name}{hint(name, known)}; there is "
                             f"{', '.join(known)}")
    return {name: case for name, case in known.items() if not names or name in names}


CASES = [
    ReferenceCase("step", "Steps to +10, 0, -10 and 0 deg", "step", 1.0, math.radians(10.0),
                  _levels((LEAD_IN, 10.0), (0.3, 0.0), (0.55, -10.0), (0.8, 0.0))),
    *(ReferenceCase(f"step_{sign}{size}", f"Step to {side * size:+d} deg", "step", 0.5, math.radians(size),
                    _levels((LEAD_IN, side * size)))
      for size in (1, 5, 10, 20) for sign, side in (("plus", 1), ("minus", -1))),
    ReferenceCase("square", "Modified square wave, 5 to 20 deg, edges at 400 deg/s", "square", 2.5, _LARGE, _square),
    *(ReferenceCase(f"chirp_{label}deg", f"Logarithmic sine sweep 0.5 to 30 Hz, {degrees:g} deg", "sweep", _SWEEP_TIME,
                    math.radians(degrees), _swept(degrees))
      for label, degrees in (("1", 1.0), ("3p5", 3.5))),
    ReferenceCase("load_opposing", "Slew from -20 to +20 deg against 100 N.m", "slew", 0.85, _LARGE, _loaded(-RATED)),
    ReferenceCase("load_aiding", "Slew from -20 to +20 deg with 100 N.m", "slew", 0.85, _LARGE, _loaded(RATED)),
    ReferenceCase("cold", "Steps to +5, +20, +5 and 0 deg at -6 degC", "step", 1.0, _LARGE, _levels(
        (LEAD_IN, 5.0), (0.3, 20.0), (0.55, 5.0), (0.8, 0.0)), {**EXACT, "friction.temperature": -6.0}),
    sag(SUPPLY_START),
]

# The reference embedded in FMUs of actuators without stored responses. It is short, since it is integrated during the
# build. It shows the signs of command and hinge torque.
STEP_AND_LOAD = ReferenceCase("step_and_load", "Step to +10 deg, and 50 N.m against it from 0.2 s on", "embedded", 0.35,
                              math.radians(10.0),
                              lambda time: {**_levels((LEAD_IN, 10.0))(time),
                                            "aero_torque": EXCITATIONS["step"].torque(time - 0.2, -50.0)})
