"""The tests of a tuning study and the figures read off them: steps and slews, sines, the linear loop.

Steps and slews are made both ways; a figure is the worse of the two.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isnan, nan
from typing import Any, TypeVar

import numpy as np

from ...actuators import capabilities, require
from ...bench.excitation import COMMAND, LOAD, SETTLE, Excitation, sine, slew_to, step_to, times
from ...bench.metrics import FIGURES, MOTION, USAGE, fundamental_weights, motion, usage
from ...bench.subject import ParameterSubject, Run, Runs
from ...parameters import ParameterError, ParameterSet
from ...simulation import Array

T = TypeVar("T")

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


def measure(test: Test, subject: ParameterSubject, changes: Sequence[Mapping[str, Any]], figures: Sequence[str],
            senses: Sequence[str]) -> Array:
    """Return figures of a test [changes, figures], SI, the worse of both directions by the sense of their limits.

    `changes` are parameters that differ from the subject's, for each unit that is tested; what is measured of one does
    not depend on the others. nan where there is none, and in every figure of a unit whose response cannot be computed.
    """
    if test.kind == "linear":
        margins = [_margins(subject.parameters, each) for each in changes]
        return np.array([[each[name] for name in figures] for each in margins])
    if test.kind == "sine":
        return _bandwidths(test, subject, changes, figures)
    outputs = tuple(dict.fromkeys(name for figure in (*MOTION, *figures) for name in FIGURES[figure].needs))
    sides = [_moved(subject.run_all(_motion(test, sign), columns(subject, changes), outputs)) for sign in (1.0, -1.0)]
    worse = {"maximum": np.maximum, "minimum": np.minimum}
    return np.column_stack([worse[sense](*(side[name] for side in sides))
                            for name, sense in zip(figures, senses, strict=True)])


def columns(subject: ParameterSubject, changes: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """Return parameters that differ from the subject's in some of the units, for each name the values in all."""
    names = dict.fromkeys(name for each in changes for name in each) or [next(iter(subject.values))]  # for their number
    return {name: np.array([each.get(name, subject.values[name]) for each in changes]) for name in names}


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


def _moved(runs: Runs) -> dict[str, Array]:
    """Return the figures of steps, slews or loads."""
    places, finished = runs.finished()
    figures = usage(finished)
    if finished.excitation.moves:
        figures |= motion(finished, -1)
        figures["steady_error"] = np.abs(figures["steady_error"])
    return {name: _among(runs, places, values) for name, values in figures.items()}


def _among(runs: Runs, places: Array, values: Any) -> Array:
    """Return values of the runs at these places among nan for the others."""
    every = np.full(len(runs), nan, dtype=np.result_type(values))
    every[places] = values
    return every


def _bandwidths(test: Test, subject: ParameterSubject, changes: Sequence[Mapping[str, Any]], figures: Sequence[str]
                ) -> Array:
    """Return the frequencies where gain and lag pass their levels, by bisection of the describing function.

    Every unit follows its own bisection; what they all ask for next is simulated together.
    """
    crossings, searches = np.full((len(changes), len(figures)), nan), [_search(figures) for _ in changes]
    asked = {unit: next(search) for unit, search in enumerate(searches)}
    while asked:
        responses = describing_function(subject, [changes[unit] for unit in asked], test.amplitude,
                                        list(asked.values()))
        for unit, response in zip(list(asked), responses.tolist(), strict=True):
            if isnan(abs(response)):
                del asked[unit]
                continue
            try:
                asked[unit] = searches[unit].send(response)
            except StopIteration as end:
                crossings[unit] = end.value
                del asked[unit]
    return crossings


_LEVELS: Mapping[str, Callable[[complex], float]] = {
    "bandwidth_3db": lambda h: abs(h) - 10.0 ** (-3.0 / 20.0),
    "bandwidth_90deg": lambda h: h.real,  # a servo's lag grows from none: it is 90 deg where this first vanishes
}
_Asking = Generator[float, complex, T]  # frequencies [Hz], for the responses there, before it returns a T


def _search(figures: Sequence[str]) -> _Asking[list[float]]:
    """Return where gain and lag pass their levels, asking once for each frequency."""
    known: dict[float, complex] = {}

    def at(frequency: float) -> _Asking[complex]:
        if frequency not in known:
            known[frequency] = yield frequency
        return known[frequency]

    crossings = []
    for name in figures:
        crossings.append((yield from _crossing(_LEVELS[name], at)))
    return crossings


def _crossing(level: Callable[[complex], float], at: Callable[[float], _Asking[complex]]) -> _Asking[float]:
    """Return where a level that is positive at low frequency first falls to zero; the highest looked at if nowhere."""
    low = _LOWEST
    for high in np.geomspace(_LOWEST, _HIGHEST, 12).tolist():
        if level((yield from at(high))) <= 0.0:
            break
        low = high
    else:
        return _HIGHEST
    if low == high:
        return _LOWEST
    for _ in range(6):  # to 2 parts in 1000
        middle = (low * high) ** 0.5
        low, high = (middle, high) if level((yield from at(middle))) > 0.0 else (low, middle)
    return float((low * high) ** 0.5)


def describing_function(subject: ParameterSubject, changes: Sequence[Mapping[str, Any]], amplitude: float,
                        frequency: Sequence[float]) -> Array:
    """Return the fundamental of the fin angle over a sine command of `amplitude` [rad], for each unit at its frequency
    [Hz]; nan where the response cannot be computed."""
    at = np.array(frequency)
    cycles = np.ceil(np.maximum(_CYCLES / at, _FITTED) * at)
    runs = subject.run_all(sine(amplitude, at, cycles, _TRANSIENT), columns(subject, changes), ("fin_angle",))
    places, finished = runs.finished()
    fundamentals = [_fundamental(*each) for each in zip(
        finished.columns["fin_angle"], at[places].tolist(), cycles[places].tolist(), strict=True)]
    return _among(runs, places, 1j * np.array(fundamentals, dtype=complex) / amplitude)


def _fundamental(angle: Array, frequency: float, cycles: float) -> complex:
    """Return the fundamental of the last cycles of a sine of fin angles at the rows."""
    first, weights = _weights(frequency, cycles)
    return complex(weights @ angle[first:first + len(weights)])


@lru_cache(maxsize=1024)  # all bisections are between the same frequencies
def _weights(frequency: float, cycles: float) -> tuple[int, Array]:
    """Return the first row that is fitted, and the weights of those that are."""
    begin = max(_TRANSIENT[0] / frequency, _TRANSIENT[1])
    time = times(begin + cycles / frequency)
    fitted = (time >= begin) & (time <= begin + cycles / frequency)
    return int(np.argmax(fitted)), fundamental_weights(time[fitted], frequency, drift=False)


def _margins(parameters: ParameterSet, changes: Mapping[str, Any]) -> dict[str, float]:
    """Return the margins of the loop broken at the drive's reference; none where the closed loop is unstable."""
    from ..analysis.frequency import highest, margins
    from ..analysis.linear import LinearActuator, sound

    plain = sound(parameters)
    try:
        linear = LinearActuator({**plain.values, **plain.having(changes)}, model=plain.model)
    except (ParameterError, ArithmeticError):
        return dict.fromkeys(_MARGINS, nan)
    if not linear.stable:
        return dict.fromkeys(_MARGINS, nan)
    loop = linear.loop("reference")
    broken = margins(loop, np.geomspace(_LOOP_LOWEST, highest(loop), _LOOP_POINTS))
    return dict(zip(_MARGINS, (broken.gain_db, broken.phase, broken.delay), strict=True))
