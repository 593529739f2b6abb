"""The tests of requirements, and the figures measured in them.

A motion or a load is tested in both directions, and the worse figure counts. All studies use these tests: a figure has
the same value wherever it is shown, except that experiments of campaigns integrate the power more finely.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import degrees, isnan, nan
from typing import Any, NamedTuple

import numpy as np

from ..actuators import capabilities
from ..errors import EmcasError
from ..motions import MOTIONS, SETTLE, STEP
from ..parameters import ParameterSet
from ..simulation import Array
from ..support import extras
from .excitation import COMMAND, LOAD, Excitation, motion, times
from .frequency_response import PURE, FrequencyResponse, Sines, swept
from .metrics import FIGURES, figures_of, motion_figures, rest_figures, usage_figures
from .runs import Run, Runs
from .subject import Subject


class TestKind(NamedTuple):
    """A kind of test: the fields that it has in files, its figures, and a format of its description."""

    fields: tuple[str, ...]
    figures: tuple[str, ...]
    words: str


_RESTS = ("rest", "usage")  # kinds of run in `figures_of`
_WORDS = {"step": "step of {size}, both ways, held for {duration:g} s{load}",
          "slew": "slew from one side to the other, {size}, both ways, over {duration:g} s{load}"}
TESTS: Mapping[str, TestKind] = {name: TestKind(fields, tuple(figures_of(name, *runs)), words)
                                 for name, (fields, runs, words) in {
    # The torque of a step is constant from the start; that of a slew rises after the command.
    **{name: (("amplitude", "duration", *each.options, "supply"), ("jump", "usage"),
              _WORDS.get(name, f"{name} of {{size}}, both ways, over {{duration:g}} s{{load}}"))
       for name, each in MOTIONS.items() if each.jumps},
    "load": (("torque", "duration", "supply"), _RESTS,
             "{torque:g} N.m at once on a fin held at 0, both ways, for {duration:g} s"),
    "release": (("torque", "duration", "supply", "settle"), _RESTS,
                "{torque:g} N.m let go after {settle:g} s, both ways, over {duration:g} s"),
    # Bisection finds the frequency.
    "sine": (("amplitude",), (), "fundamental under sines of {size}"),
    # The loop is broken at the drive's reference.
    "linear": ((), (), "linear loop"),
    # The slews follow a history of use, with this torque, and a rest; a fresh actuator's slews are the reference.
    "repeat": (("amplitude", "duration", "torque"), (),
               "slew of ±{size} after one-sided cycles, stall, saturation, disabling and brown-out")}.items()}
"""The kinds of tests of requirements."""
BANDWIDTHS = 2.0, 60.0  # Hz, range of the search for a bandwidth
GRID = tuple(np.geomspace(*BANDWIDTHS, 12).tolist())  # Hz; the interval that contains a bandwidth is bisected
BISECTIONS = 6  # they locate a bandwidth within 3 parts in 1000
LOOP_LOWEST, LOOP_POINTS = 0.05, 200  # lowest frequency [Hz] and number of frequencies, for margins within 2e-6
CYCLES, FITTED = 4.0, 0.15  # smallest number of fitted cycles of a sine, and their shortest duration [s]
TRANSIENT = (2.0, 0.1)  # smallest number of cycles before the fit, and their shortest duration [s]
REST = 4.0  # s, duration of the rest after the history of use


def bound(bandwidth: float) -> str:
    """Return the sign ``< `` or ``> `` of a bandwidth [Hz] at an end of the search, which is only a bound; or ""."""
    return "< " if bandwidth <= BANDWIDTHS[0] else "> " if bandwidth >= BANDWIDTHS[1] else ""


@dataclass(frozen=True)
class Test:
    """A test of a requirement, of one of the TESTS.

    `amplitude` is in rad. `duration` [s] is that of the judged part, in a repeat that of each slew; `settle` [s] is the
    time before it in a slew or release. In a motion a `torque` [N.m] above 0 acts along the motion. `supply` is a share
    of the supply's start value.
    """

    __test__ = False  # not one of pytest's

    kind: str
    amplitude: float = 0.0
    duration: float = 0.6
    torque: float = 0.0
    settle: float = SETTLE
    supply: float = 1.0

    @property
    def simulated(self) -> float:
        """The approximate simulated time in total [s]."""
        each = {"linear": 0.0, "sine": 20.0, "repeat": len(_use("")) + REST + 3.0 * self.duration}
        return 2.0 * each.get(self.kind, self.settle + self.duration)

    def __str__(self) -> str:
        """The test in words."""
        load = f", {'with' if self.torque > 0.0 else 'against'} {abs(self.torque):g} N.m" if self.torque else ""
        supply = "" if self.supply == 1.0 else f", at {100.0 * self.supply:g} % of the supply"
        size = f"{degrees(self.amplitude):.4g} deg"
        return TESTS[self.kind].words.format(size=size, load=load, **asdict(self)) + supply


def obstacle(test: Test, figure: str, subject: Subject) -> str:
    """Return the reason why a figure of a test cannot be measured for a subject; empty if it can."""
    if test.kind == "linear":
        lacks = capabilities.POSITION_LOOP not in subject.actuator.provides
        if lacks:
            return f"margins need {capabilities.POSITION_LOOP}, which this actuator does not have"
        return extras.absent("analysis", "margins need", "control", "casadi") or _linear_obstacle(subject.parameters)
    if test.supply != 1.0 and subject.supply is None:
        return "this actuator has no supply"
    for name, needed in ((LOAD, test.torque and test.kind != "repeat"), (subject.supply, test.supply != 1.0)):
        if needed and name in subject.actuator.without_effect:
            return f"{name} has no effect on this actuator's motion"
    return subject.lacking(FIGURES[figure].needs)


def measure(test: Test, subject: Subject, changes: Sequence[Mapping[str, Any]], figures: Sequence[str],
            senses: Sequence[str]) -> Array:
    """Return the figures of a test [changes, figures], in the units of FIGURES; the worse direction counts.

    Each item of `changes` has the parameters of a variant that differ from the subject's; a variant's figures do not
    depend on other variants. `senses` are the senses of the figures' limits, `maximum` or `minimum`. A figure without
    a value is nan (a settling time or margin: inf); all of a variant are nan if its response cannot be computed.
    """
    if test.kind == "linear":
        margins = [_margins(subject.parameters, each) for each in changes]
        table: Array = np.array([[each[name] for name in figures] for each in margins])
        return table
    if test.kind == "sine":
        return _bandwidths(test, subject, changes, figures)
    if test.kind == "repeat":
        return np.tile(_repeated(test, subject, changes)[:, np.newaxis], len(figures))
    sides = [_moved(_run(test, sign, subject, changes, recorded(figures))) for sign in (1.0, -1.0)]
    if "rate_asymmetry" in figures:
        rates = [side["sustained_rate"] for side in sides]
        sides[0]["rate_asymmetry"] = sides[1]["rate_asymmetry"] = 1.0 - np.minimum(*rates) / np.maximum(*rates)
    worse = {"maximum": np.maximum, "minimum": np.minimum}
    measured: Array = np.column_stack([worse[sense](*(side[name] for side in sides))
                                       for name, sense in zip(figures, senses, strict=True)])
    return measured


def recorded(figures: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the outputs that the figures of a motion or a load need."""
    return tuple(dict.fromkeys(name for figure in ("sustained_rate", "peak_rate", *figures)
                               for name in FIGURES[figure].needs))


def columns(subject: Subject, changes: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """Return the parameters that any variant changes, with an array of their values in all variants."""
    # Without changes any one parameter defines the number of variants.
    names = dict.fromkeys(name for each in changes for name in each) or [next(iter(subject.values))]
    others = {**subject.values, **subject.at_start}
    return {name: np.array([each.get(name, others[name]) for each in changes]) for name in names}


def response(test: Test, subject: Subject, changes: Mapping[str, Any], sign: float = 1.0) -> Run:
    """Return the run of a test with a motion or a load, in the direction `sign` (1 or -1)."""
    return _run(test, sign, subject, [changes], None)[0]


def excitation(test: Test, sign: float, subject: Subject, changes: Mapping[str, Any] | None = None) -> Excitation:
    """Return the excitation of a test with a motion or a load, in the direction `sign` (1 or -1).

    `changes` are changed parameters, arrays for many variants.
    """
    nominal = _motion(test, sign)
    if test.supply == 1.0 or subject.supply is None:
        return nominal
    return nominal.holding({subject.supply: test.supply * _start(subject, subject.supply, changes or {})})


def _start(subject: Subject, name: str, changes: Mapping[str, Any]) -> Array:
    """Return the start value of an input with changed parameters [1], or [variants, 1] where they change it."""
    return np.asarray(subject.inputs[name].initial({**subject.values, **changes}), dtype=float)[..., np.newaxis]


def _run(test: Test, sign: float, subject: Subject, changes: Sequence[Mapping[str, Any]],
         outputs: Sequence[str] | None) -> Runs:
    differing = columns(subject, changes)
    return subject.run_all(excitation(test, sign, subject, differing), differing, outputs)


@lru_cache(maxsize=64)
def _motion(test: Test, sign: float) -> Excitation:
    level, torque = sign * test.amplitude, sign * test.torque
    if test.kind == "load":
        return motion("load", 0.0, test.duration, torque)
    if test.kind == "release":
        applied = motion("load", 0.0, test.settle + test.duration, torque)
        released = replace(applied, begin=applied.begin + test.settle)
        return released.holding({LOAD: np.where(released.judged(released.time), 0.0, applied.columns[LOAD])})
    if test.kind == "slew":
        return motion("slew", level, test.duration, torque, test.settle, first=None)
    return motion(test.kind, level, test.duration).holding({LOAD: torque})


def _moved(runs: Runs) -> dict[str, Array]:
    """Return the figures of finished motions or loads, and nan for the other runs."""
    indices, finished = runs.finished()
    moved = motion_figures(finished, -1) if finished.excitation.moves else rest_figures(finished)
    figures = {**usage_figures(finished), **moved}
    figures["steady_error"] = np.abs(figures["steady_error"])
    measured = {name: np.full(len(runs), nan) for name in figures}
    for name, values in figures.items():
        measured[name][indices] = values
    return measured


def _use(supply: str) -> list[dict[str, Array]]:
    """Return the inputs in each second of a history of use, as shares of amplitude, torque and start values.

    It consists of one-sided cycles and a load near or beyond the stall torque, in each direction; disabling in motion;
    a breakdown of the input `supply`; and commands that exceed the range and the fin's rate.
    """
    phase = times(1.0)[:-1]
    one_sided = np.interp(phase % 0.5, [0.0, 0.15, 0.35, 0.5], [1.0, 1.0, 0.0, 0.0])
    square = np.sign(np.sin(6.0 * phase))
    return [
        {COMMAND: one_sided}, {LOAD: np.where(phase < 0.9, 1.0, 0.0)},
        {COMMAND: -one_sided}, {LOAD: np.where(phase < 0.9, -1.0, 0.0)},
        {COMMAND: np.where(phase < 0.5, 0.75, -0.5), "enable": phase % 0.37 < 0.25, LOAD: 0.15 * square},
        {COMMAND: square, supply: np.where(phase % 0.4 < 0.2, 1.0, 0.3)},
        {COMMAND: 3.0 * np.sin(8.0 * np.pi * phase), LOAD: -0.5 * square}]


def _repeated(test: Test, subject: Subject, changes: Sequence[Mapping[str, Any]]) -> Array:
    """Return the largest difference [rad] between slews after use and rest and slews of a fresh actuator [variants]."""
    differing, angles = columns(subject, changes), []
    for history in histories(test, subject, {name: _start(subject, name, differing) for name in subject.inputs}):
        angle = subject.run_all(history, differing, ("fin_angle",)).columns["fin_angle"]
        angles.append(angle[..., history.judged(history.time)])
    difference: Array = np.max(np.abs(angles[0] - angles[1]), axis=-1)
    return difference


def histories(test: Test, subject: Subject, starts: Mapping[str, Any]) -> tuple[Excitation, Excitation]:
    """Return the excitations of a used and of a fresh actuator; the slews at their ends are judged.

    `starts` are start values of inputs, arrays [variants, 1] if they differ between variants.
    """
    history = _use(subject.supply or "")
    used = len(history) * round(1.0 / STEP)
    rows = used + round((REST + 3.0 * test.duration) / STEP) + 1
    scale = {COMMAND: test.amplitude, LOAD: test.torque}
    fresh = {name: np.tile(np.atleast_1d(start), rows) for name, start in starts.items()
             if any(name in phase for phase in history)}
    probe = round(test.duration / STEP)
    fresh[COMMAND][-3 * probe - 1:] = test.amplitude * np.repeat([1.0, -1.0, 0.0], [probe, probe, probe + 1])
    worn = {name: column.copy() for name, column in fresh.items()}
    for k, phase in enumerate(history):
        for name, share in phase.items():
            if name in worn:
                at = slice(k * round(1.0 / STEP), (k + 1) * round(1.0 / STEP))
                worn[name][..., at] = share * scale.get(name, starts[name])
    begin = (rows - 3 * probe) * STEP
    return Excitation(str(test), worn, begin), Excitation(str(test), fresh, begin)


_LEVELS: Mapping[str, Callable[[complex], float]] = {
    "bandwidth_3db": lambda h: abs(h) - 10.0 ** (-3.0 / 20.0),
    "bandwidth_90deg": lambda h: h.real,  # a servo's lag grows from zero; at 90 deg the real part first becomes 0
}


def _bandwidths(test: Test, subject: Subject, changes: Sequence[Mapping[str, Any]], figures: Sequence[str]) -> Array:
    """Return the frequencies [Hz] at which gain and lag cross their levels, by bisection of the describing function.

    Each figure of a variant is bisected separately; the next sines of all are simulated together, each frequency once.
    If a level is not crossed, the result is the end of BANDWIDTHS beyond which the crossing is; it is nan if a response
    up to the crossing is not a sine, as in hunting.
    """
    searching = [(k, name) for k in range(len(changes)) for name in figures]
    crossings, between = dict.fromkeys(searching, BANDWIDTHS[1]), dict[tuple[int, str], tuple[float, float]]()
    known: dict[tuple[int, float], complex] = {}

    def levels(at: Mapping[tuple[int, str], float]) -> dict[tuple[int, str], float]:
        if new := [*dict.fromkeys((k, f) for (k, _), f in at.items() if (k, f) not in known)]:
            responses = describing_function(subject, [changes[k] for k, _ in new], test.amplitude, [f for _, f in new])
            known.update(zip(new, responses.tolist(), strict=True))
        return {(k, name): _LEVELS[name](known[k, f]) for (k, name), f in at.items()}

    for low, high in pairwise((GRID[0], *GRID)):
        at_high = levels(dict.fromkeys(searching, high))
        between |= {each: (low, high) for each, level in at_high.items() if level <= 0.0}
        crossings |= {each: nan for each, level in at_high.items() if isnan(level)}
        searching = [each for each, level in at_high.items() if level > 0.0]
    for _ in range(BISECTIONS):
        at_middle = levels(middle := {each: (low * high) ** 0.5 for each, (low, high) in between.items()})
        crossings |= {each: nan for each, level in at_middle.items() if isnan(level)}
        between = {each: (middle[each], between[each][1]) if level > 0.0 else (between[each][0], middle[each])
                   for each, level in at_middle.items() if not isnan(level)}
    crossings |= {each: (low * high) ** 0.5 for each, (low, high) in between.items()}
    return np.array([[crossings[k, name] for name in figures] for k in range(len(changes))])


def sweep_figures(response: FrequencyResponse, subject: Subject, amplitude: float,
                  changes: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures of a sweep of `amplitude` [rad]; the bandwidths are measured with steady sines."""
    names = TESTS["sine"].figures
    (bandwidths,) = measure(Test("sine", amplitude), subject, [changes], names, ("minimum",) * len(names))
    return {**swept(response), **dict(zip(names, bandwidths.tolist(), strict=True))}


def describing_function(subject: Subject, changes: Sequence[Mapping[str, Any]], amplitude: float,
                        frequency: Sequence[float]) -> Array:
    """Return the complex ratio of the fin angle's fundamental to a sine command of `amplitude` [rad].

    Each variant has its own `frequency` [Hz]. The ratio is nan if the response cannot be computed, or if it is not a
    sine: its fundamental has less than the share PURE of its power.
    """
    sines = Sines(np.array(frequency), TRANSIENT, (CYCLES, FITTED))
    runs = subject.run_all(sines.excitation(amplitude), columns(subject, changes), ("fin_angle",))
    angle = runs.columns["fin_angle"]
    fundamentals = sines.fit(angle)
    pure = 0.5 * np.abs(fundamentals) ** 2 >= PURE * np.array([np.var(rows) for rows in sines.rows(angle)])
    return np.where(pure, 1j * fundamentals / amplitude, complex(nan, nan))


@lru_cache(maxsize=16)
def _linear_obstacle(parameters: ParameterSet) -> str:
    from .linear.actuator import obstacle

    return obstacle(parameters)


def _margins(parameters: ParameterSet, changes: Mapping[str, Any]) -> dict[str, float]:
    """Return the margins [dB, rad, s] of the loop broken at the drive's reference.

    They are nan if the closed loop is unstable, or if the actuator cannot rest at 0, does not react there, or has no
    linear model.
    """
    from .linear.actuator import LinearActuator, sound
    from .linear.frequency import highest, margins

    plain, figures = sound(parameters), (nan, nan, nan)
    with suppress(EmcasError, ArithmeticError):
        linear = LinearActuator({**plain.values, **plain.having(changes)}, model=plain.model)
        if linear.stable and not linear.idle:
            loop = linear.loop("reference")
            result = margins(loop, np.geomspace(LOOP_LOWEST, highest(loop), LOOP_POINTS))
            figures = result.gain_db, result.phase, result.delay
    return dict(zip(TESTS["linear"].figures, figures, strict=True))
