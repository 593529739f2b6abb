"""The judging engine: figures against closed forms, and verdicts that a wrong unit cannot get."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import atan, cos, degrees, exp, inf, log, nan, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from emcas_fmu.bench import metrics, writers
from emcas_fmu.bench.excitation import Excitation, step_to
from emcas_fmu.bench.measure import BANDWIDTHS, KINDS, Test, describing_function, measure
from emcas_fmu.bench.metrics import FIGURES, Array, hold_figures
from emcas_fmu.bench.requirements import Requirement, Specification, load_requirements
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject, Subject
from emcas_fmu.bench.verdict import Judged, all_passed, in_words, judge, judged, summary_table
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters

from .subjects import FIN_PORT, Broken, Known, Play

TIME = np.arange(3001) * 1e-3  # a hold of 3 s: its last third are the rows from 2 s on
LEVEL = radians(5.0)


def specified(folder: Path, *tables: str, start: str = "") -> Path:
    """Write a file of requirements."""
    path = folder / "mine.toml"
    path.write_text(start + "".join(f"[[requirements]]\n{table}\n" for table in tables), encoding="utf-8")
    return path


def by_name(subject: Subject, specification: Specification, *names: str) -> dict[str, Judged]:
    """Judge by some requirements of a specification, all unless named."""
    chosen = tuple(r for r in specification.requirements if not names or r.name in names)
    return {j.name: j for j in judge(subject, replace(specification, requirements=chosen))}


def shipped(changes: Mapping[str, float], *names: str) -> dict[str, Judged]:
    """Judge the default unit with parameters that differ by some of the shipped requirements."""
    parameters = load_parameters().with_values(dict(changes))
    return by_name(ParameterSubject(parameters), load_requirements(None, parameters), *names)


# -- figures against closed forms ------------------------------------------------


@pytest.mark.parametrize(("offset", "size"), [(0.0, 0.02), (0.03, 0.02), (-0.04, 0.01), (0.0, 0.0)])
def test_held_is_an_oscillation_about_an_offset(offset: float, size: float) -> None:
    """5 Hz has its crests on rows, whole cycles in the last third, and a last row at its middle."""
    found = hold_figures(TIME, LEVEL + offset + size * np.sin(2 * pi * 5.0 * TIME), LEVEL)
    exact = {"held_error": abs(offset) + size, "ripple": 2.0 * size, "steady_error": offset,
             "held_angle": LEVEL + offset - size}
    assert {name: found[name] for name in exact} == pytest.approx(exact, abs=1e-12)  # rounding of 1e3 rows
    assert found["time_to_accuracy"] >= (2.9 if offset or size else 0.0)  # each is beyond 0.2 deg in the last cycle


def test_the_window_is_the_last_third_and_no_more() -> None:
    """A burst before it is not seen, the same in its first row is."""
    for first, seen in ((1999, 0.0), (2000, 0.1), (3000, 0.1)):
        angle = np.where(np.arange(3001) == first, 0.1, 0.0)
        found = hold_figures(TIME, angle, 0.0)
        assert (found["held_error"], found["ripple"]) == (seen, seen)


def _moved(angle: Array, **others: Array) -> Run:
    """Return a run to LEVEL whose columns begin where the command comes."""
    excitation = step_to(LEVEL, 3.0)
    before = len(excitation.time) - len(TIME)
    columns = {name: np.append(np.zeros(before), column) for name, column in {"fin_angle": angle, **others}.items()}
    return Run(excitation, {"time": excitation.time, **columns}, None, (), 0.0)


def test_a_motion_that_decays_to_the_command() -> None:
    lag = 0.4
    left = np.exp(-TIME / lag)
    found = metrics.motion(_moved(LEVEL * (1.0 - left), fin_rate=LEVEL / lag * left,
                                  motor_current=3.0 + np.sin(2 * pi * 10.0 * TIME)), -1)
    begin, end = exp(-2.0 / lag), exp(-3.0 / lag)
    exact = {"rise_time": lag * log(9.0), "time_to_90_percent": lag * log(10.0), "settling_time": lag * log(50.0),
             "time_to_accuracy": lag * log(LEVEL / metrics.ACCURACY), "overshoot": 0.0, "peak_rate": LEVEL / lag,
             "held_error": LEVEL * begin, "held_angle": LEVEL * (1.0 - begin), "ripple": LEVEL * (begin - end),
             "sustained_rate": 0.6 * LEVEL / (lag * log(4.0)), "current_ripple": (0.5 * 1000 / 1001) ** 0.5}
    # Between rows the curve is a chord: (h/lag)^2/8 of what is left, 1e-6 of it.
    assert {name: found[name] for name in exact} == pytest.approx(exact, rel=1e-5)
    # The mean of rows counts both ends whole: a row in 2000 more than the integral's mean.
    assert found["steady_error"] == pytest.approx(-LEVEL * lag * (begin - end), rel=1e-3)
    assert set(found) == set(metrics.MOTION)


def test_a_motion_that_overshoots() -> None:
    """exp(-s t) cos(w t) beside the command: its first crest is where tan(w t) = -s/w, half a turn on."""
    decay, turn = 8.0, 2 * pi * 5.0
    found = metrics.motion(_moved(LEVEL * (1.0 - np.exp(-decay * TIME) * np.cos(turn * TIME)), fin_rate=TIME), -1)
    crest = (pi - atan(decay / turn)) / turn
    # A row beside the crest loses (w h)^2/8 of it.
    assert found["overshoot"] == pytest.approx(-exp(-decay * crest) * cos(turn * crest), rel=2e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rest_that_a_load_disturbs_and_leaves(sign: float) -> None:
    decay, turn, size = 5.0, 2 * pi * 4.0, radians(3.0)
    excitation = replace(step_to(0.0, 3.0), begin=0.5)
    time = excitation.time
    load = sign * np.where(time < 0.5, 100.0, 0.0)
    after = np.maximum(time - 0.5, 0.0)
    angle = sign * size * np.exp(-decay * after) * np.cos(turn * after)
    columns = {"time": time, "fin_angle": angle, "motor_current": np.sin(2 * pi * 10.0 * time)}
    found = metrics.rest(Run(excitation.holding({"aero_torque": load}), columns, None, (), 0.0))
    crest = (pi - atan(decay / turn)) / turn
    assert found["rebound"] == pytest.approx(-size * exp(-decay * crest) * cos(turn * crest), rel=2e-4)
    held = after[time >= time[-1] - (time[-1] - 0.5) / 3.0 - 1e-9][0]
    assert found["held_error"] <= size * exp(-decay * held)
    assert found["current_ripple"] == pytest.approx(0.5**0.5, rel=1e-2)  # of whole cycles but for a part of one
    assert set(found) == set(metrics.RESTING)


class Answer(Known):
    """Answers with the command, offset and a sine of `size` [rad] about it, to one side another share of it."""

    def __init__(self, size: float = 0.0, frequency: float = 5.0, one_sided: float = 0.0) -> None:
        super().__init__(there=FIN_PORT)
        self.size, self.frequency, self.one_sided = size, frequency, one_sided

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """What a row commands acts after that row's output is read."""
        time = step * np.arange(len(command))
        command = np.append(command[0] if command[0] < 0.0 else 0.0, command[:-1])
        return (command * (1.0 - self.one_sided * (command < 0.0))
                + self.size * np.sin(2 * pi * self.frequency * time))


def test_an_oscillation_whose_mean_is_zero_is_no_rest() -> None:
    """What a mean over the hold would not see."""
    subject, size = Answer(radians(0.6)), radians(0.6)
    specification = load_requirements(None, subject.parameters)
    found = by_name(subject, specification, "rest", "accuracy_20deg", "rest_loaded", "torque_reserve")
    assert not any(j.passed for j in found.values())
    assert found["rest"].measured == pytest.approx(2.0 * degrees(size), rel=1e-9)
    assert found["accuracy_20deg"].measured == pytest.approx(degrees(size), rel=1e-9)
    ((steady, ripple),) = measure(Test("step", LEVEL, 3.0), subject, [{}], ("steady_error", "ripple"),
                                  ("maximum", "maximum"))
    assert steady < 1e-3 * size < ripple
    still = by_name(Answer(), specification, *found)
    assert all(j.passed for j in still.values())


# -- verdicts of units -----------------------------------------------------------


def test_a_unit_that_hunts_fails_by_what_says_so() -> None:
    names = "rest", "rest_current", "gain_margin", "phase_margin", "bandwidth_1deg", "lag", "settling"
    hunting = shipped({"controller.position.kp": 190.0}, *names)
    assert [name for name in names if hunting[name].passed] == []
    assert hunting["rest"].measured is not None
    assert hunting["rest"].measured > 1.0  # deg peak to peak
    for name in ("bandwidth_1deg", "lag", "gain_margin", "phase_margin", "settling"):
        assert hunting[name].measured is None
        assert "no value" in str(hunting[name])
    assert "unstable" in hunting["gain_margin"].note
    assert "not a sine" in hunting["lag"].note
    assert "not met by the end" in hunting["settling"].note
    sound = shipped({}, *names)
    assert [name for name in names if not sound[name].passed] == []


def test_a_clipped_command_misses_the_range_and_says_so() -> None:
    found = shipped({"command.limit": radians(15.0)}, "range", "accuracy_20deg", "rest")
    assert (found["range"].passed, found["accuracy_20deg"].passed, found["rest"].passed) == (False, False, True)
    assert found["range"].measured == pytest.approx(15.0, abs=0.01)
    assert "commands are clipped to 15 deg" in str(found["range"])
    assert "clipped" not in found["rest"].note  # 100 % is of its own range
    assert "clipped" not in shipped({}, "range")["range"].note


class OneSided(Answer):
    """Falls short to one side alone."""

    def __init__(self, side: float) -> None:
        super().__init__()
        self.side = side

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """A tenth less."""
        found = super().angle(command, moment, step)
        return np.where(self.side * found > 0.0, 0.9 * found, found)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_both_directions_count_and_the_worse_is_shown(side: float) -> None:
    subject = OneSided(side)
    found = by_name(subject, load_requirements(None, subject.parameters), "range", "accuracy_20deg")
    assert found["range"].measured == pytest.approx(18.0)
    assert found["accuracy_20deg"].measured == pytest.approx(2.0)
    assert not any(j.passed for j in found.values())


CASES = """
[cases.nominal]
[cases.slow]
"controller.position.kp" = "50 %"
[cases.narrow]
"command.limit" = "4 deg"
"""
RISE = """name = "rise"
test = { kind = "step", amplitude = "4 deg", duration = "1 s" }
figure = "rise_time"
maximum = "30 ms"
"""


def test_all_cases_count_and_the_worst_is_shown_by_name(tmp_path: Path) -> None:
    parameters = load_parameters()
    subject = ParameterSubject(parameters)
    tables = RISE, RISE.replace('"rise"', '"sound"') + "cases = ['nominal', 'narrow']\n"
    found = by_name(subject, load_requirements(specified(tmp_path, *tables, start=CASES), parameters))
    assert (found["rise"].passed, found["rise"].case) == (False, "slow")
    assert "worst in the case slow" in found["rise"].how
    assert found["sound"].passed
    # One case after the other gives the same.
    slow = by_name(ParameterSubject(parameters.with_values(
        {"controller.position.kp": 0.5 * float(parameters.values["controller.position.kp"])})),
        load_requirements(specified(tmp_path, RISE), parameters))["rise"]
    assert slow.measured == found["rise"].measured


@pytest.mark.parametrize("value", [nan, inf, -inf, None])
@pytest.mark.parametrize("sense", ["<=", ">="])
def test_no_value_never_passes(value: float | None, sense: str) -> None:
    row = Judged("", "x", "X", value, sense, 1.0, "deg")
    assert (row.passed, row.margin, row.margin_percent) == (False, None, None)
    assert not all_passed([row])
    assert not all_passed([replace(row, measured=1.0), row])


def test_a_figure_without_value_is_worse_than_any_and_says_why() -> None:
    parameters = load_parameters()
    subject = ParameterSubject(parameters)
    (wanted,) = (r for r in load_requirements(None, parameters).requirements if r.name == "settling")
    from emcas_fmu.bench.requirements import NOMINAL, Case
    from emcas_fmu.bench.verdict import Measured
    for bad, said in ((nan, "never reaches"), (inf, "not met by the end")):
        figures = [Measured(wanted, case, value) for case, value in (
            (NOMINAL, 1e9), (Case("odd", {}), bad), (NOMINAL, 0.01))]
        row = judged(wanted, figures, subject)
        assert (row.measured, row.passed, row.skipped) == (None, False, False)
        assert said in str(row)
        assert writers.plain(row.as_dict())["measured"] is None


def test_a_unit_that_stops_has_no_figures_and_passes_nothing() -> None:
    subject = Broken()
    found = by_name(subject, load_requirements(None, subject.parameters))
    of_runs = [j for j in found.values() if not j.figure.endswith("_margin")]
    assert len(of_runs) > 20
    assert all(j.measured is None and not j.passed and not j.skipped for j in of_runs)
    assert all("no value" in str(j) and "the run ended early" in j.note for j in of_runs)


def test_what_is_skipped_counts_neither_way() -> None:
    subject = Play(half=1e-6, there=FIN_PORT)
    found = by_name(subject, load_requirements(None, subject.parameters), "rest", "rest_current", "rated_current")
    assert [j.skipped for j in found.values()] == [False, True, True]
    assert [j.passed for j in found.values()] == [True, False, False]
    assert found["rest_current"].note == "this actuator has no motor_current"
    assert in_words(list(found.values())) == "the one requirement is met; 2 more were not judged"
    assert all_passed(list(found.values()))
    assert not all_passed([j for j in found.values() if j.skipped])


@pytest.mark.parametrize("pattern", [p for n in range(4) for p in product(["ok", "fail", "skip"], repeat=n)],
                         ids=lambda pattern: "-".join(pattern) or "none")
def test_what_passes_as_a_whole(pattern: Sequence[str]) -> None:
    rows = [Judged("", "x", "X", {"ok": 0.5, "fail": 2.0, "skip": None}[each], "<=", 1.0, "deg", skipped=each == "skip")
            for each in pattern]
    assert all_passed(rows) is ("ok" in pattern and "fail" not in pattern)
    said = in_words(rows)
    assert said.partition(": ")[2] == ", ".join(["x"] * pattern.count("fail"))
    assert said.startswith(("all ", "the one ")) is all_passed(rows)
    assert ("not judged" in said) is ("skip" in pattern)


# -- sines -----------------------------------------------------------------------


class Harmonic(Known):
    """Answers a sine with itself and a share of its second harmonic, beside an offset."""

    def __init__(self, share: float, amplitude: float) -> None:
        super().__init__(there=FIN_PORT)
        self.share, self.amplitude = share, amplitude

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """A cosine of twice the angle is one less two squared sines."""
        return command + self.share * self.amplitude * (1.0 - 2.0 * (command / self.amplitude) ** 2) + 1.0


# Of the response's variance the fundamental has 1/(1 + share^2): the least allowed is 0.9.
@pytest.mark.parametrize(("share", "sine"), [(0.0, True), (0.32, True), (0.35, False), (2.0, False)])
def test_a_response_that_is_no_sine_has_no_gain(share: float, sine: bool) -> None:
    (found,) = describing_function(Harmonic(share, 0.02), [{}], 0.02, [10.0])
    assert bool(np.isfinite(found)) is sine
    if sine:  # of 400 rows, four cycles, the last is one more: so much of a harmonic gets in
        assert found == pytest.approx(1.0, abs=2.0 * share / 400 + 1e-9)


@pytest.mark.parametrize(("lag", "expected"), [(0.02, 1.0), (0.1, 1.0)])
def test_the_bandwidth_of_a_first_order_lag(lag: float, expected: float) -> None:
    found, = describing_function(Lag(lag), [{}], 0.02, [1.0 / (2 * pi * lag)] if lag < 0.08 else [2.0])
    at = 1.0 if lag < 0.08 else 2.0 * 2 * pi * lag
    assert found == pytest.approx(expected / (1.0 + 1j * at), rel=1e-3)
    ((three, ninety),) = measure(Test("sine", 0.02), Lag(lag), [{}], ("bandwidth_3db", "bandwidth_90deg"),
                                 ("minimum", "minimum"))
    # 3 dB are 0.9977 of half the power; bisected to 2 in 1000. 90 deg it never lags.
    assert three == pytest.approx(max((10**0.3 - 1.0) ** 0.5 / (2 * pi * lag), BANDWIDTHS[0]), rel=2e-3)
    assert ninety == BANDWIDTHS[1]


class Lag(Known):
    """A first-order lag [s], exact for the lines between the rows of the command."""

    def __init__(self, lag: float) -> None:
        super().__init__(there=FIN_PORT)
        self.lag = lag

    def angle(self, command: Any, moment: Any, step: float) -> Any:
        """Solve every row exactly."""
        from scipy import signal
        continuous = tuple(np.array([[each]]) for each in (-1.0 / self.lag, 1.0 / self.lag, 1.0, 0.0))
        _, found, _ = signal.dlsim(signal.cont2discrete(continuous, step, "foh"), command)
        return found[:, 0]


BANDWIDTH = """name = "{name}"
test = {{ kind = "sine", amplitude = "1 deg" }}
figure = "bandwidth_3db"
{sense} = "{limit} Hz"
"""


def test_a_bandwidth_beyond_those_looked_for_is_a_bound(tmp_path: Path) -> None:
    wide, narrow = Play(half=0.0, there=FIN_PORT), Lag(0.5)
    path = specified(tmp_path, BANDWIDTH.format(name="least", sense="minimum", limit=59),
                     BANDWIDTH.format(name="most", sense="maximum", limit=59))
    specification = load_requirements(path, wide.parameters)
    found = by_name(wide, specification)
    assert [(j.measured, j.beyond, j.passed) for j in found.values()] == [(60.0, True, True), (60.0, True, False)]
    assert [j.more + j.more_margin for j in found.values()] == ["> > ", "> < "]  # the margin to a maximum is less
    assert "> 60 Hz, required >= 59 Hz" in str(found["least"])
    found = by_name(narrow, specification)
    assert [(j.measured, j.beyond, j.passed) for j in found.values()] == [(2.0, True, False), (2.0, True, True)]
    assert "< 2 Hz" in str(found["least"])
    within = by_name(Lag(0.02), specification)["least"]
    assert (within.beyond, within.more) == (False, "")


@pytest.mark.parametrize(("measured", "sense", "limit", "passed"), [
    (60.0, ">=", 30.0, True), (60.0, ">=", 70.0, False), (60.0, "<=", 30.0, False), (60.0, "<=", 70.0, False),
    (2.0, "<=", 3.0, True), (2.0, "<=", 1.0, False), (2.0, ">=", 3.0, False), (2.0, ">=", 1.0, False)])
def test_a_bound_passes_only_where_it_decides(measured: float, sense: str, limit: float, passed: bool) -> None:
    assert Judged("", "x", "X", measured, sense, limit, "Hz", beyond=True).passed is passed


@pytest.mark.parametrize("limit", ["1.9", "2", "60", "100"])
def test_a_limit_that_no_search_can_decide_is_refused(limit: str, tmp_path: Path) -> None:
    """Of a unit beyond the highest frequency nothing says whether it is beyond the limit, too."""
    path = specified(tmp_path, BANDWIDTH.format(name="least", sense="minimum", limit=limit))
    with pytest.raises(EmcasError, match=r"mine\.toml: requirements\.least.*between 2 and 60 Hz"):
        load_requirements(path, load_parameters())


# -- one verdict wherever it shows -----------------------------------------------

ROWS = (Judged("a", "met", "Met", 0.5, "<=", 1.0, "deg", "by hand"),
        Judged("a", "missed", "Missed", 2.0, "<=", 1.0, "deg", "by hand"),
        Judged("b", "none", "None", None, ">=", 1.0, "Hz", "no value, as it stops"),
        Judged("b", "bound", "Bound", 60.0, ">=", 10.0, "Hz", beyond=True),
        Judged("c", "left", "Left", None, "<=", 1.0, "A", "this actuator has no motor_current", skipped=True))


def test_json_junit_and_terminal_agree(tmp_path: Path) -> None:
    console = Console(record=True, width=200)
    console.print(summary_table("criterion", ROWS))
    lines = {j.name: line for j in ROWS for line in console.export_text(clear=False).splitlines() if j.name in line}
    writers.write_json({"rows": [j.as_dict() for j in ROWS]}, tmp_path / "out.json")
    document = {row["name"]: row for row in json.loads((tmp_path / "out.json").read_text("utf-8"))["rows"]}
    for j in ROWS:
        case = j.junit_case("emcas")
        kinds = [type(result).__name__ for result in case.result]
        expected = [] if j.passed else ["Skipped"] if j.skipped else ["Failure"]
        assert kinds == expected
        assert document[j.name]["passed"] is j.passed
        assert document[j.name]["margin"] == j.margin
        assert ("ok" if j.passed else "not judged" if j.skipped else "FAIL") in lines[j.name]
        if kinds == ["Failure"]:
            assert case.result[0].message == str(j)
    assert "> 60" in lines["bound"]


# -- files of requirements -------------------------------------------------------

STEP = 'test = { kind = "step", amplitude = "5 deg" }'
MISTAKES = [
    ('name = "a"\ntest = { kind = "stp", amplitude = "5 deg" }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test.kind = stp: did you mean step? there is step, slew, load, release, sine, linear, repeat"),
    ('name = "a"\ntest = { amplitude = "5 deg" }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test", "expected a table with a kind; there is step"),
    ('name = "a"\ntest = { kind = "step" }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test: amplitude is missing"),
    ('name = "a"\ntest = { kind = "load", torque = "5 deg" }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test.torque = 5 deg: ", "N.m"),
    ('name = "a"\ntest = { kind = "load", torque = "5 N*m", amplitude = 1 }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test: unknown key 'amplitude'"),
    (f'name = "a"\n{STEP}\nfigure = "riple"\nmaximum = "1 deg"',
     "requirements.a.figure = riple: a step test has no such figure; did you mean ripple?"),
    (f'name = "a"\n{STEP}\nfigure = "bandwidth_3db"\nminimum = "10 Hz"',
     "requirements.a.figure = bandwidth_3db: a step test has no such figure; there is rise_time"),
    ('name = "a"\nfigure = "ripple"\nmaximum = "1 deg"', "requirements.a.figure = ripple: needs a test, such as"),
    (f'name = "a"\n{STEP}\nmaximum = "1 deg"', "requirements.a: figure is missing; there is name, title, test"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "1 deg"\nminimum = "1 deg"',
     "requirements.a: needs either maximum or minimum"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"', "requirements.a: needs either maximum or minimum"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "1 s"', "requirements.a.maximum = 1 s: ", "rad"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = 1', "requirements.a.maximum = 1: ", "with a unit"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "-1 deg"', "requirements.a.maximum = -1 deg: must be above 0"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "nan deg"', "requirements.a.maximum = nan deg: "),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "inf deg"', "requirements.a.maximum = inf deg: "),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "1 deg"\ncases = ["cold"]',
     "requirements.a: there is no case cold; there is nominal"),
    ('name = "a"\ntest = { kind = "step", amplitude = "45 deg" }\nfigure = "ripple"\nmaximum = "1 deg"',
     "requirements.a.test.amplitude = 45 deg: is beyond command.limit = 20 deg"),
    (f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "1 deg"\nlimit = 3', "requirements.a: unknown key 'limit'"),
    (f'{STEP}\nfigure = "ripple"\nmaximum = "1 deg"', "requirements.[0]: name is missing"),
]


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake[1][:60])
def test_a_mistake_is_one_line_with_file_entry_and_remedy(mistake: tuple[str, ...], tmp_path: Path) -> None:
    table, *said = mistake
    with pytest.raises(EmcasError) as raised:
        load_requirements(specified(tmp_path, table), load_parameters())
    (line,) = str(raised.value).splitlines()
    assert line.startswith(f"{tmp_path / 'mine.toml'}: ")
    assert all(each in line for each in said), line


def test_two_of_a_name_and_none_at_all(tmp_path: Path) -> None:
    good = f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "1 deg"'
    for tables, said in (((good, good), r"mine\.toml: requirements\.a.*: appears twice"),
                         ((), r"mine\.toml: .*requirements")):
        with pytest.raises(EmcasError, match=said):
            load_requirements(specified(tmp_path, *tables), load_parameters())


def test_a_figure_that_the_actuator_lacks_needs_to_be_optional(tmp_path: Path) -> None:
    lacked = f'name = "a"\n{STEP}\nfigure = "rms_current"\nmaximum = "1 A"\n'
    base = load_parameters(model="electrohydraulic")
    with pytest.raises(EmcasError) as raised:
        load_requirements(specified(tmp_path, lacked), base)
    (line,) = str(raised.value).splitlines()
    assert "requirements.a" in line
    assert "this actuator has no motor_current (electrohydraulic)" in line
    assert "optional" in line  # the remedy
    (row,) = judge(ParameterSubject(base), load_requirements(specified(tmp_path, lacked + "optional = true"), base))
    assert (row.skipped, row.passed) == (True, False)


@pytest.mark.parametrize(("limit", "expected"), [("0.1 deg", 0.1), ("0.001 rad", degrees(1e-3)), ("6 arcmin", 0.1)])
def test_limits_in_any_unit_of_the_quantity(limit: str, expected: float, tmp_path: Path) -> None:
    parameters = load_parameters()
    specification = load_requirements(
        specified(tmp_path, f'name = "a"\n{STEP}\nfigure = "ripple"\nmaximum = "{limit}"'), parameters)
    (row,) = judge(ParameterSubject(parameters), specification)
    assert (row.unit, row.sense) == ("deg", "<=")
    assert row.limit == pytest.approx(expected, abs=1e-9)  # shown to nine places


@pytest.mark.parametrize("kind", list(KINDS))
def test_every_figure_of_every_kind_of_test_is_measured(kind: str) -> None:
    """Of a sound unit each has a value; a name without one would fail wherever a file has it."""
    test = {"load": Test(kind, torque=50.0), "release": Test(kind, torque=50.0, settle=0.3)}.get(
        kind, Test(kind, radians(5.0), 0.6, torque=-20.0 if kind in ("slew", "step") else 100.0))
    ((*found,),) = measure(test, ParameterSubject(load_parameters()), [{}], KINDS[kind], ["maximum"] * len(KINDS[kind]))
    assert np.all(np.isfinite(found)), dict(zip(KINDS[kind], found, strict=True))
    assert set(KINDS[kind]) <= set(FIGURES)


def test_the_worse_of_two_directions_is_by_the_sense_of_the_limit() -> None:
    subject = Answer(one_sided=0.25)
    figures = "held_angle", "held_angle", "held_error", "held_error"
    ((least, most, low, high),) = measure(Test("step", LEVEL), subject, [{}], figures,
                                          ("minimum", "maximum", "minimum", "maximum"))
    assert (least, most, low, high) == pytest.approx((0.75 * LEVEL, LEVEL, 0.0, 0.25 * LEVEL), abs=1e-12)


def test_rates_of_two_directions_are_compared_by_the_larger() -> None:
    class Lame(Known):
        """Goes at 2 rad/s, and back at 1.5."""

        def angle(self, command: Any, moment: Any, step: float) -> Any:
            """Row after row."""
            at, found = float(command[0]), []
            for level in command:
                at += min(max(level - at, -1.5 * step), 2.0 * step)
                found.append(at)
            return np.array(found)

    ((asymmetry, rate),) = measure(Test("slew", radians(20.0), 1.0), Lame(there=FIN_PORT), [{}],
                                   ("rate_asymmetry", "sustained_rate"), ("maximum", "minimum"))
    # The rows interpolate straight lines: rounding of some hundred sums.
    assert (asymmetry, rate) == pytest.approx((0.25, 1.5), rel=1e-9)


def test_the_units_are_judged_alike_beside_each_other() -> None:
    test, figures = Test("slew", radians(20.0), 0.6, -100.0), ("sustained_rate", "held_error")
    subject, senses = ParameterSubject(load_parameters()), ("minimum", "maximum")
    units: list[dict[str, float]] = [{}, {"motor.resistance": 0.4}, {"controller.position.kp": 40.0}]
    together = measure(test, subject, units, figures, senses)
    alone = np.concatenate([measure(test, subject, [unit], figures, senses) for unit in units])
    np.testing.assert_array_equal(together, alone)


def test_excitations_of_a_test_are_what_it_says(tmp_path: Path) -> None:
    """A slew begins where it is held; a load that goes was there before what is judged."""
    from emcas_fmu.bench.measure import excitation
    subject = ParameterSubject(load_parameters())
    slew: Excitation = excitation(Test("slew", 0.2, 0.5, -30.0), 1.0, subject)
    before = slew.time < slew.moves[-1].start - 1e-9
    assert set(slew.command[before]) == {-0.2}
    assert set(slew.command[~before]) == {0.2}
    gone = excitation(Test("release", torque=40.0, settle=0.7, duration=0.5), -1.0, subject)
    load = gone.columns["aero_torque"]
    assert set(load[gone.time >= gone.begin - 1e-9]) == {0.0}
    assert np.count_nonzero(load) == 700
    assert set(load[load != 0.0]) == {-40.0}
    low = excitation(Test("step", 0.1, supply=0.9), 1.0, subject)
    assert set(low.columns["supply_voltage"]) == {0.9 * float(subject.values["drive.supply_voltage"])}


def test_requirements_of_the_file_are_whole() -> None:
    """Every shipped one has what a page shows of it."""
    shipped_ones: Sequence[Requirement] = load_requirements(None, load_parameters()).requirements
    assert len({r.name for r in shipped_ones}) == len(shipped_ones)
    for r in shipped_ones:
        assert r.title
        assert r.source
        assert (r.source == "engineering choice") is bool(r.reason)
