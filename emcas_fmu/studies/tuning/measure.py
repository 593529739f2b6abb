"""The tests of a tuning study and the figures read off them: steps and slews, sines, the linear loop.

Steps and slews are made both ways; a figure is the worse of the two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, nan
from typing import Any

import numpy as np

from ...actuators import capabilities, require
from ...bench.excitation import COMMAND, LOAD, SETTLE, Excitation, sine, slew_to, step_to
from ...bench.metrics import FIGURES, MOTION, USAGE, fundamental, motion, usage
from ...bench.subject import ParameterSubject, Run
from ...parameters import ParameterSet

_MARGINS = ("gain_margin", "phase_margin", "delay_margin")
_BANDWIDTHS = ("bandwidth_3db", "bandwidth_90deg")
_MOVES = tuple(dict.fromkeys((*MOTION, *USAGE)))
KINDS: Mapping[str, tuple[str, ...]] = {
    "step": _MOVES, "slew": _MOVES, "load": USAGE, "sine": _BANDWIDTHS, "linear": _MARGINS}
"""The figures of each kind of test."""
_LOWEST, _HIGHEST = 2.0, 60.0  # Hz, where a bandwidth is looked for
_LOOP_LOWEST, _LOOP_POINTS = 0.5, 150  # Hz, and how many: enough for margins to 1e-6
_CYCLES, _FITTED = 4.0, 0.15  # of a sine that are fitted, and s that these last at least
_TRANSIENT = (2.0, 0.1)  # cycles, and at least s, before them


@dataclass(frozen=True)
class Test:
    """A test. ``amplitude`` [rad]; ``duration`` [s] after the step or slew; ``torque`` [N.m] along the motion
    (negative: against it), constant in a step, risen with the command in a slew from -amplitude to amplitude, which
    comes after ``settle`` [s]; of a load, which comes at once on a fin held at 0."""

    __test__ = False  # not one of pytest's

    kind: str
    amplitude: float = 0.0
    duration: float = 0.6
    torque: float = 0.0
    settle: float = SETTLE


def lacking(test: Test, figure: str, subject: ParameterSubject) -> str:
    """Return why a subject has not this figure of a test, in words; empty where it has it."""
    if test.kind == "linear":
        require(subject.model, "a test of kind linear", capabilities.POSITION_LOOP)
    return subject.lacking(FIGURES[figure].needs)


def measure(test: Test, subject: ParameterSubject, changes: Mapping[str, Any], figures: tuple[str, ...],
            senses: tuple[str, ...]) -> list[float]:
    """Return figures of a test, SI, the worse of both directions by the sense of their limits; nan where there is none.

    `changes` are parameters that differ from the subject's. Figures that only some limits need are only then computed.
    Raises StoppedError for a response that cannot be computed.
    """
    if test.kind == "linear":
        margins = _margins(subject.parameters, changes)
        return [margins[name] for name in figures]
    if test.kind == "sine":
        return _bandwidths(test, subject, changes, figures)
    sides = [_moved(response(test, subject, changes, sign), figures) for sign in (1.0, -1.0)]
    return [float((np.max if sense == "maximum" else np.min)([side[name] for side in sides]))
            for name, sense in zip(figures, senses, strict=True)]


def response(test: Test, subject: ParameterSubject, changes: Mapping[str, Any], sign: float = 1.0) -> Run:
    """Return the run of a step or slew."""
    return subject.run(_motion(test, sign), changes)


@lru_cache(maxsize=64)
def _motion(test: Test, sign: float) -> Excitation:
    level, torque = sign * test.amplitude, sign * test.torque
    if test.kind == "load":
        rest = step_to(0.0, test.duration)
        return rest.holding({LOAD: np.where(rest.judged(rest.time), torque, 0.0)})
    if test.kind == "slew":
        slew = slew_to(level, test.duration, torque, settle=test.settle)
        return slew.holding({COMMAND: np.where(slew.judged(slew.time), level, -level)})  # from the first row on
    return step_to(level, test.duration).holding({LOAD: torque})


def _moved(run: Run, figures: tuple[str, ...]) -> dict[str, float]:
    run.finished()
    if not run.excitation.moves:
        return usage(run)
    moved = motion(run, -1)
    if not set(figures) <= set(MOTION):
        moved = usage(run) | moved
    return moved | {"steady_error": abs(moved["steady_error"])}


def _bandwidths(test: Test, subject: ParameterSubject, changes: Mapping[str, Any],
                figures: tuple[str, ...]) -> list[float]:
    """Return the frequencies where gain and lag pass their levels, by bisection of the describing function."""
    @cache
    def at(frequency: float) -> complex:
        return describing_function(subject, changes, test.amplitude, frequency)

    levels: dict[str, Callable[[complex], float]] = {
        "bandwidth_3db": lambda h: abs(h) - 10.0 ** (-3.0 / 20.0),
        "bandwidth_90deg": lambda h: h.real,  # a servo's lag grows from none: it is 90 deg where this first vanishes
    }
    return [_crossing(levels[name], at) for name in figures]


def _crossing(level: Callable[[complex], float], response_at: Callable[[float], complex]) -> float:
    """Return where a level that is positive at low frequency first falls to zero; the highest looked at if nowhere."""
    def margin(frequency: float) -> float:
        return level(response_at(frequency))

    low = _LOWEST
    for high in np.geomspace(_LOWEST, _HIGHEST, 12).tolist():
        if margin(high) <= 0.0:
            break
        low = high
    else:
        return _HIGHEST
    if low == high:
        return _LOWEST
    for _ in range(6):  # to 2 parts in 1000
        middle = (low * high) ** 0.5
        low, high = (middle, high) if margin(middle) > 0.0 else (low, middle)
    return float((low * high) ** 0.5)


def describing_function(subject: ParameterSubject, changes: Mapping[str, Any], amplitude: float,
                        frequency: float) -> complex:
    """Return the fundamental of the fin angle over a sine command of `amplitude` [rad] at a `frequency` [Hz]."""
    cycles = ceil(max(_CYCLES / frequency, _FITTED) * frequency)
    columns = subject.run(sine(amplitude, frequency, cycles, _TRANSIENT), changes, ("fin_angle",)).finished()
    begin = max(_TRANSIENT[0] / frequency, _TRANSIENT[1])
    fitted = (columns["time"] >= begin) & (columns["time"] <= begin + cycles / frequency)
    angle = fundamental(columns["time"][fitted], columns["fin_angle"][fitted], frequency, drift=False)
    return 1j * angle / amplitude


def _margins(parameters: ParameterSet, changes: Mapping[str, Any]) -> dict[str, float]:
    """Return the margins of the loop broken at the drive's reference; none where the closed loop is unstable."""
    from ..analysis.frequency import highest, margins
    from ..analysis.linear import LinearActuator, sound

    plain = sound(parameters)
    linear = LinearActuator({**plain.values, **plain.having(changes)}, model=plain.model)
    if not linear.stable:
        return dict.fromkeys(_MARGINS, nan)
    loop = linear.loop("reference")
    broken = margins(loop, np.geomspace(_LOOP_LOWEST, highest(loop), _LOOP_POINTS))
    return dict(zip(_MARGINS, (broken.gain_db, broken.phase, broken.delay), strict=True))
