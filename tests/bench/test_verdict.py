"""Figures agree with closed forms, and an actuator that misses a requirement never passes."""

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
from scipy import signal

from emcas_fmu.bench import metrics, writers
from emcas_fmu.bench.excitation import step_to
from emcas_fmu.bench.measure import BANDWIDTHS, TESTS, Test, describing_function, excitation, measure
from emcas_fmu.bench.metrics import FIGURES, Array, hold_figures
from emcas_fmu.bench.requirements import NOMINAL, Case, Specification, load_requirements
from emcas_fmu.bench.runs import Run
from emcas_fmu.bench.subject import ParameterSubject, Subject
from emcas_fmu.bench.verdict import Judged, Measured, all_passed, in_words, judge, judged, summary_table
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters

from .subjects import FIN_PORT, Broken, Known, Play

TIME = np.arange(3001) * 1e-3  # a hold of 3 s, whose last third begins in row 2000
LEVEL = radians(5.0)


def requirements_file(folder: Path, *tables: str, start: str = "") -> Path:
    """Write a file of requirements after the text `start`, and return its path."""
    path = folder / "mine.toml"
    path.write_text(start + "".join(f"[[requirements]]\n{table}\n" for table in tables), encoding="utf-8")
    return path


def by_name(subject: Subject, specification: Specification, *names: str) -> dict[str, Judged]:
    """Return the verdicts by name: of all requirements of a specification, or of the named ones."""
    chosen = tuple(r for r in specification.requirements if not names or r.name in names)
    return {j.name: j for j in judge(subject, replace(specification, requirements=chosen))}


def judge_default(changes: Mapping[str, float], *names: str) -> dict[str, Judged]:
    """Judge the default actuator with changed parameters by the named judge_default requirements."""
    parameters = load_parameters().with_values(dict(changes))
    return by_name(ParameterSubject(parameters), load_requirements(None, parameters), *names)


# -- figures against closed forms ------------------------------------------------


@pytest.mark.parametrize(("offset", "size"), [(0.0, 0.02), (0.03, 0.02), (-0.04, 0.01), (0.0, 0.0)])
def test_hold_figures_of_a_sine_about_an_offset(offset: float, size: float) -> None:
    """The sine of 5 Hz has its crests on rows, whole cycles in the last third, and its mean in the last row."""
    found = hold_figures(TIME, LEVEL + offset + size * np.sin(2 * pi * 5.0 * TIME), LEVEL)
    exact = {"held_error": abs(offset) + size, "ripple": 2.0 * size, "steady_error": offset,
             "held_angle": LEVEL + offset - size}
    assert {name: found[name] for name in exact} == pytest.approx(exact, abs=1e-12)  # rounding of 1e3 rows
    assert found["time_to_accuracy"] >= (2.9 if offset or size else 0.0)  # 0.2 deg is left in each cycle


def test_hold_figures_are_measured_from_the_first_row_of_the_last_third() -> None:
    for row, measured in ((1999, 0.0), (2000, 0.1), (3000, 0.1)):
        angle = np.where(np.arange(3001) == row, 0.1, 0.0)
        found = hold_figures(TIME, angle, 0.0)
        assert (found["held_error"], found["ripple"]) == (measured, measured)


def _step_run(angle: Array, **others: Array) -> Run:
    """Return a run of a step to LEVEL from columns that begin at the step; before it they are zero."""
    step = step_to(LEVEL, 3.0)
    before = len(step.time) - len(TIME)
    columns = {name: np.append(np.zeros(before), column) for name, column in {"fin_angle": angle, **others}.items()}
    return Run(step, {"time": step.time, **columns}, None, (), 0.0)


def test_motion_figures_of_a_first_order_response() -> None:
    lag = 0.4
    remainder = np.exp(-TIME / lag)
    found = metrics.motion_figures(_step_run(LEVEL * (1.0 - remainder), fin_rate=LEVEL / lag * remainder,
                                             motor_current=3.0 + np.sin(2 * pi * 10.0 * TIME)), -1)
    begin, end = exp(-2.0 / lag), exp(-3.0 / lag)
    exact = {"rise_time": lag * log(9.0), "time_to_90_percent": lag * log(10.0), "settling_time": lag * log(50.0),
             "time_to_accuracy": lag * log(LEVEL / metrics.ACCURACY), "overshoot": 0.0, "peak_rate": LEVEL / lag,
             "held_error": LEVEL * begin, "held_angle": LEVEL * (1.0 - begin), "ripple": LEVEL * (begin - end),
             "sustained_rate": 0.6 * LEVEL / (lag * log(4.0)), "current_ripple": (0.5 * 1000 / 1001) ** 0.5}
    # Interpolation between rows is off by at most (h/lag)^2/8 of the remainder: 1e-6.
    assert {name: found[name] for name in exact} == pytest.approx(exact, rel=1e-5)
    # The mean over rows counts both ends fully, the integral half: 1 row in 2000.
    assert found["steady_error"] == pytest.approx(-LEVEL * lag * (begin - end), rel=1e-3)
    assert set(found) == set(metrics.figures_of("jump"))


def test_overshoot_of_a_damped_oscillation() -> None:
    """The error exp(-s t) cos(w t) has its first negative peak at w t = pi - atan(s/w)."""
    decay, omega = 8.0, 2 * pi * 5.0
    response = LEVEL * (1.0 - np.exp(-decay * TIME) * np.cos(omega * TIME))
    found = metrics.motion_figures(_step_run(response, fin_rate=TIME), -1)
    peak = (pi - atan(decay / omega)) / omega
    # The peak is up to half a row from a row: the largest sample is lower by at most about (w h)^2/8.
    assert found["overshoot"] == pytest.approx(-exp(-decay * peak) * cos(omega * peak), rel=2e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rest_figures_after_a_load_is_released(sign: float) -> None:
    decay, omega, size = 5.0, 2 * pi * 4.0, radians(3.0)
    rest = replace(step_to(0.0, 3.0), begin=0.5)
    time = rest.time
    load = sign * np.where(time < 0.5, 100.0, 0.0)
    after = np.maximum(time - 0.5, 0.0)
    angle = sign * size * np.exp(-decay * after) * np.cos(omega * after)
    columns = {"time": time, "fin_angle": angle, "motor_current": np.sin(2 * pi * 10.0 * time)}
    found = metrics.rest_figures(Run(rest.holding({"aero_torque": load}), columns, None, (), 0.0))
    peak = (pi - atan(decay / omega)) / omega
    assert found["rebound"] == pytest.approx(-size * exp(-decay * peak) * cos(omega * peak), rel=2e-4)
    last_third = after[time >= time[-1] - (time[-1] - 0.5) / 3.0 - 1e-9][0]
    assert found["held_error"] <= size * exp(-decay * last_third)
    assert found["current_ripple"] == pytest.approx(0.5**0.5, rel=1e-2)  # one cycle is incomplete
    assert set(found) == set(metrics.figures_of("rest"))


def test_usage_figures_of_a_sine() -> None:
    """All outputs are ten cycles of a sine of 1 with an offset of 1/2; before the command they are 9."""
    excited = step_to(0.0, 1.0)
    since = excited.time - excited.begin
    values = np.where(since < -1e-9, 9.0, 0.5 + np.sin(2 * pi * 10.0 * since))
    outputs = {name for figure in metrics.figures_of("usage").values() for name in figure.needs}
    found = metrics.usage_figures(Run(excited, {"time": excited.time, **dict.fromkeys(outputs, values)}, None, (), 0.0))
    assert set(found) == set(metrics.figures_of("usage"))
    assert found["peak_current"] == pytest.approx(1.5, rel=1e-3)
    assert found["peak_power"] == pytest.approx(1.5, rel=1e-3)
    assert found["peak_returned_power"] == pytest.approx(0.5, rel=1e-3)
    assert found["rms_tracking_error"] == pytest.approx(0.75**0.5, rel=1e-3)  # the last row is the first of a cycle
    assert found["rms_power"] == pytest.approx(0.75**0.5, rel=1e-6)
    assert found["mean_power"] == pytest.approx(0.5, rel=1e-6)
    assert found["net_energy"] == pytest.approx(0.5, rel=1e-6)
    # The positive part of 1/2 + sin x has the integral 3^(1/2) + 2 pi/3 over a cycle; the trapezoids at its two ends
    # are off by at most h^2/8 times the slope of 3^(1/2)/2, h = 0.063.
    assert found["energy_drawn"] == pytest.approx((3**0.5 + 2 * pi / 3) / (2 * pi), abs=2e-4)
    assert found["energy_returned"] == pytest.approx(found["energy_drawn"] - found["net_energy"])
    assert found["saturated_share"] == pytest.approx(0.5, abs=0.011)  # rows at the level count or not, by rounding


class Oscillating(Known):
    """Follows the previous row's command plus a 5 Hz sine of `amplitude` [rad]; negative angles lack `shortfall`."""

    def __init__(self, amplitude: float = 0.0, shortfall: float = 0.0) -> None:
        super().__init__(outputs=FIN_PORT)
        self.amplitude, self.shortfall = amplitude, shortfall

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        time = step * np.arange(len(command))
        command = np.append(command[0] if command[0] < 0.0 else 0.0, command[:-1])
        return command * (1.0 - self.shortfall * (command < 0.0)) + self.amplitude * np.sin(2 * pi * 5.0 * time)


def test_oscillation_with_zero_mean_fails_rest_and_accuracy() -> None:
    subject, size = Oscillating(radians(0.6)), radians(0.6)
    specification = load_requirements(None, subject.parameters)
    found = by_name(subject, specification, "rest", "accuracy_20deg", "rest_loaded", "torque_reserve")
    assert not any(j.passed for j in found.values())
    assert found["rest"].measured == pytest.approx(2.0 * degrees(size), rel=1e-9)
    assert found["accuracy_20deg"].measured == pytest.approx(degrees(size), rel=1e-9)
    ((steady, ripple),) = measure(Test("step", LEVEL, 3.0), subject, [{}], ("steady_error", "ripple"),
                                  ("maximum", "maximum"))
    assert steady < 1e-3 * size < ripple
    at_rest = by_name(Oscillating(), specification, *found)
    assert all(j.passed for j in at_rest.values())


# -- verdicts of actuators -------------------------------------------------------


def test_hunting_actuator_fails_and_the_notes_say_why() -> None:
    names = "rest", "rest_current", "gain_margin", "phase_margin", "bandwidth_1deg", "lag", "settling"
    hunting = judge_default({"controller.position.kp": 190.0}, *names)
    assert [name for name in names if hunting[name].passed] == []
    assert hunting["rest"].measured is not None
    assert hunting["rest"].measured > 1.0  # deg peak to peak
    for name in ("bandwidth_1deg", "lag", "gain_margin", "phase_margin", "settling"):
        assert hunting[name].measured is None
        assert "no value" in str(hunting[name])
    assert "unstable" in hunting["gain_margin"].note
    assert "not a sine" in hunting["lag"].note
    assert "not met by the end" in hunting["settling"].note
    assert all(j.passed for j in judge_default({}, *names).values())


def test_clipped_command_misses_the_range_and_the_note_says_so() -> None:
    found = judge_default({"command.limit": radians(15.0)}, "range", "accuracy_20deg", "rest")
    assert (found["range"].passed, found["accuracy_20deg"].passed, found["rest"].passed) == (False, False, True)
    assert found["range"].measured == pytest.approx(15.0, abs=0.01)
    assert "commands are clipped to 15 deg" in str(found["range"])
    assert "clipped" not in found["rest"].note  # it is a step to 100 % of the clipped range
    assert "clipped" not in judge_default({}, "range")["range"].note
    # A slew of 20 deg at 5 deg never travels far enough for a rate.
    assert judge_default({"command.limit": radians(5.0)}, "unloaded_rate")["unloaded_rate"].note.startswith(
        "commands are clipped to 5 deg; the response never reaches")


class OneSided(Oscillating):
    """Reaches only 90 % of the command on one side."""

    def __init__(self, side: float) -> None:
        super().__init__()
        self.side = side

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        angle = super().angle(command, torque, step)
        return np.where(self.side * angle > 0.0, 0.9 * angle, angle)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_verdict_is_that_of_the_worse_direction(side: float) -> None:
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


def test_verdict_is_that_of_the_worst_case_and_names_it(tmp_path: Path) -> None:
    parameters = load_parameters()
    subject = ParameterSubject(parameters)
    tables = RISE, RISE.replace('"rise"', '"sound"') + "cases = ['nominal', 'narrow']\n"
    found = by_name(subject, load_requirements(requirements_file(tmp_path, *tables, start=CASES), parameters))
    assert (found["rise"].passed, found["rise"].case) == (False, "slow")
    assert "worst in the case slow" in found["rise"].how
    assert found["sound"].passed
    # The case judged alone gives the same number.
    slow = by_name(ParameterSubject(parameters.with_values(
        {"controller.position.kp": 0.5 * float(parameters.values["controller.position.kp"])})),
        load_requirements(requirements_file(tmp_path, RISE), parameters))["rise"]
    assert slow.measured == found["rise"].measured


@pytest.mark.parametrize("value", [nan, inf, -inf, None])
@pytest.mark.parametrize("sense", ["<=", ">="])
def test_missing_or_infinite_value_never_passes(value: float | None, sense: str) -> None:
    row = Judged("", "x", "X", value, sense, 1.0, "deg")
    assert (row.passed, row.margin, row.margin_percent) == (False, None, None)
    assert not all_passed([row])
    assert not all_passed([replace(row, measured=1.0), row])


def test_figure_without_a_value_is_worse_than_any_number_and_says_why() -> None:
    parameters = load_parameters()
    subject = ParameterSubject(parameters)
    named = {r.name: r for r in load_requirements(None, parameters).requirements}
    for name, bad, said in (("settling", nan, "never reaches"), ("settling", inf, "not met by the end"),
                            ("gain_margin", nan, "is unstable"), ("gain_margin", inf, "never reaches the value")):
        wanted = named[name]
        figures = [Measured(wanted, case, value) for case, value in (
            (NOMINAL, 1e9), (Case("odd", {}), bad), (NOMINAL, 0.01))]
        row = judged(wanted, figures, subject)
        assert (row.measured, row.passed, row.skipped) == (None, False, False)
        assert said in str(row)
        assert writers.plain(row.as_dict())["measured"] is None


def test_run_that_ends_early_has_no_figures_and_passes_nothing() -> None:
    subject = Broken()
    found = by_name(subject, load_requirements(None, subject.parameters))
    measured_in_runs = [j for j in found.values() if not j.figure.endswith("_margin")]
    assert len(measured_in_runs) > 20
    assert all(j.measured is None and not j.passed and not j.skipped for j in measured_in_runs)
    assert all("no value" in str(j) and "the run ended early" in j.note for j in measured_in_runs)


def test_skipped_requirement_is_neither_met_nor_missed() -> None:
    subject = Play(half_width=1e-6, outputs=FIN_PORT)
    found = by_name(subject, load_requirements(None, subject.parameters), "rest", "rest_current", "rated_current")
    assert [j.skipped for j in found.values()] == [False, True, True]
    assert [j.passed for j in found.values()] == [True, False, False]
    assert found["rest_current"].note == "this actuator has no motor_current"
    assert in_words(list(found.values())) == "the one requirement is met; 2 more were not judged"
    assert all_passed(list(found.values()))
    assert not all_passed([j for j in found.values() if j.skipped])


@pytest.mark.parametrize("pattern", [p for n in range(4) for p in product(["ok", "fail", "skip"], repeat=n)],
                         ids=lambda pattern: "-".join(pattern) or "none")
def test_all_pass_if_one_is_met_and_none_is_missed(pattern: Sequence[str]) -> None:
    rows = [Judged("", "x", "X", {"ok": 0.5, "fail": 2.0, "skip": None}[each], "<=", 1.0, "deg", skipped=each == "skip")
            for each in pattern]
    assert all_passed(rows) is ("ok" in pattern and "fail" not in pattern)
    said = in_words(rows)
    assert said.partition(": ")[2] == ", ".join(["x"] * pattern.count("fail"))
    assert said.startswith(("all ", "the one ")) is all_passed(rows)
    assert ("not judged" in said) is ("skip" in pattern)


# -- sines -----------------------------------------------------------------------


class Harmonic(Known):
    """Answers a sine with the sine, `share` times its second harmonic, and an offset."""

    def __init__(self, share: float, amplitude: float) -> None:
        super().__init__(outputs=FIN_PORT)
        self.share, self.amplitude = share, amplitude

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        # cos(2 x) = 1 - 2 sin(x)^2
        return command + self.share * self.amplitude * (1.0 - 2.0 * (command / self.amplitude) ** 2) + 1.0


# The fundamental has 1/(1 + share^2) of the response's variance; 0.9 is required: share <= 1/3.
@pytest.mark.parametrize(("share", "sine"), [(0.0, True), (0.32, True), (0.35, False), (2.0, False)])
def test_response_that_is_not_a_sine_has_no_gain(share: float, sine: bool) -> None:
    (found,) = describing_function(Harmonic(share, 0.02), [{}], 0.02, [10.0])
    assert bool(np.isfinite(found)) is sine
    if sine:  # the judged rows are one more than whole cycles: this leaks 1/400 of the harmonic
        assert found == pytest.approx(1.0, abs=2.0 * share / 400 + 1e-9)


class Ending(Known):
    """Follows the command exactly, and ends its runs with an error after 1 s."""

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        return command

    def run(self, *arguments: Any, **more: Any) -> Run:
        whole = super().run(*arguments, **more)
        return replace(whole, columns={name: column[:1001] for name, column in whole.columns.items()}, stopped=1.0)


def test_sine_has_a_gain_if_its_run_ends_after_the_fitted_cycles() -> None:
    """The sine of 2 Hz makes the run of 10 Hz longer than the 0.6 s that it needs alone."""
    alone = describing_function(Ending(outputs=FIN_PORT), [{}], 0.02, [10.0])
    one, other = describing_function(Ending(outputs=FIN_PORT), [{}, {}], 0.02, [10.0, 2.0])
    assert one == alone == pytest.approx(1.0, abs=1e-9)
    assert np.isnan(other)


@pytest.mark.parametrize(("lag", "frequency"), [(0.02, 1.0 / (2 * pi * 0.02)), (0.1, 2.0)])
def test_bandwidth_of_a_first_order_lag(lag: float, frequency: float) -> None:
    (response,) = describing_function(Lag(lag), [{}], 0.02, [frequency])
    assert response == pytest.approx(1.0 / (1.0 + 2j * pi * frequency * lag), rel=1e-3)
    ((three, ninety),) = measure(Test("sine", 0.02), Lag(lag), [{}], ("bandwidth_3db", "bandwidth_90deg"),
                                 ("minimum", "minimum"))
    # At -3 dB 1 + (w lag)^2 = 10^0.3; the bisection ends within 2 in 1000. The lag never reaches 90 deg.
    assert three == pytest.approx(max((10**0.3 - 1.0) ** 0.5 / (2 * pi * lag), BANDWIDTHS[0]), rel=2e-3)
    assert ninety == BANDWIDTHS[1]


class Lag(Known):
    """A first-order lag [s], solved exactly for a command that is linear between rows."""

    def __init__(self, lag: float) -> None:
        super().__init__(outputs=FIN_PORT)
        self.lag = lag

    def angle(self, command: Any, torque: Any, step: float) -> Any:
        continuous = tuple(np.array([[each]]) for each in (-1.0 / self.lag, 1.0 / self.lag, 1.0, 0.0))
        _, response, _ = signal.dlsim(signal.cont2discrete(continuous, step, "foh"), command)
        return response[:, 0]


BANDWIDTH = """name = "{name}"
test = {{ kind = "sine", amplitude = "1 deg" }}
figure = "bandwidth_3db"
{sense} = "{limit} Hz"
"""


def test_bandwidth_outside_the_searched_range_is_a_bound(tmp_path: Path) -> None:
    wide, narrow = Play(half_width=0.0, outputs=FIN_PORT), Lag(0.5)
    path = requirements_file(tmp_path, BANDWIDTH.format(name="least", sense="minimum", limit=59),
                             BANDWIDTH.format(name="most", sense="maximum", limit=59))
    specification = load_requirements(path, wide.parameters)
    found = by_name(wide, specification)
    assert [(j.measured, j.beyond, j.passed) for j in found.values()] == [(60.0, True, True), (60.0, True, False)]
    # The margin to a minimum is larger than shown, the margin to a maximum is smaller.
    assert [j.more + j.more_margin for j in found.values()] == ["> > ", "> < "]
    assert "> 60 Hz, required >= 59 Hz" in str(found["least"])
    found = by_name(narrow, specification)
    assert [(j.measured, j.beyond, j.passed) for j in found.values()] == [(2.0, True, False), (2.0, True, True)]
    assert "< 2 Hz" in str(found["least"])
    within = by_name(Lag(0.02), specification)["least"]
    assert (within.beyond, within.more) == (False, "")


@pytest.mark.parametrize(("measured", "sense", "limit", "passed"), [
    (60.0, ">=", 30.0, True), (60.0, ">=", 70.0, False), (60.0, "<=", 30.0, False), (60.0, "<=", 70.0, False),
    (2.0, "<=", 3.0, True), (2.0, "<=", 1.0, False), (2.0, ">=", 3.0, False), (2.0, ">=", 1.0, False)])
def test_bound_passes_only_if_all_values_beyond_it_do(measured: float, sense: str, limit: float, passed: bool) -> None:
    assert Judged("", "x", "X", measured, sense, limit, "Hz", beyond=True).passed is passed


@pytest.mark.parametrize("limit", ["1.9", "2", "60", "100"])
def test_bandwidth_limit_outside_the_searched_range_is_refused(limit: str, tmp_path: Path) -> None:
    path = requirements_file(tmp_path, BANDWIDTH.format(name="least", sense="minimum", limit=limit))
    with pytest.raises(EmcasError, match=r"mine\.toml: requirements\.least.*between 2 and 60 Hz"):
        load_requirements(path, load_parameters())


# -- one verdict in every output -------------------------------------------------

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

STEP = '{ kind = "step", amplitude = "5 deg" }'


def table(**changes: str | None) -> str:
    """Return a valid table of a requirement with changed entries; None removes an entry."""
    entries = {"name": '"a"', "test": STEP, "figure": '"ripple"', "maximum": '"1 deg"', **changes}
    return "\n".join(f"{key} = {value}" for key, value in entries.items() if value is not None)


# Changed entries of a valid table, and parts of the error.
MISTAKES: list[tuple[dict[str, str | None], tuple[str, ...]]] = [
    ({"test": '{ kind = "stp", amplitude = "5 deg" }'},
     ("requirements.a.test.kind = stp: did you mean step? there is step, slew, load, release, sine, linear, repeat",)),
    ({"test": '{ amplitude = "5 deg" }'}, ("requirements.a.test", "expected a table with a kind; there is step")),
    ({"test": '{ kind = "step" }'}, ("requirements.a.test: amplitude is missing",)),
    ({"test": '{ kind = "load", torque = "5 deg" }'}, ("requirements.a.test.torque = 5 deg: ", "N.m")),
    ({"test": '{ kind = "load", torque = "5 N*m", amplitude = 1 }'},
     ("requirements.a.test: unknown key 'amplitude'",)),
    ({"figure": '"riple"'},
     ("requirements.a.figure = riple: a step test has no such figure; did you mean ripple?",)),
    ({"figure": '"bandwidth_3db"', "maximum": None, "minimum": '"10 Hz"'},
     ("requirements.a.figure = bandwidth_3db: a step test has no such figure; there is rise_time",)),
    ({"test": None}, ("requirements.a.figure = ripple: needs a test, such as",)),
    ({"figure": None}, ("requirements.a: figure is missing; there is name, title, test",)),
    ({"minimum": '"1 deg"'}, ("requirements.a: needs either maximum or minimum",)),
    ({"maximum": None}, ("requirements.a: needs either maximum or minimum",)),
    ({"maximum": '"1 s"'}, ("requirements.a.maximum = 1 s: ", "rad")),
    ({"maximum": "1"}, ("requirements.a.maximum = 1: ", "with a unit")),
    ({"maximum": '"-1 deg"'}, ("requirements.a.maximum = -1 deg: must be above 0",)),
    ({"maximum": '"nan deg"'}, ("requirements.a.maximum = nan deg: ",)),
    ({"maximum": '"inf deg"'}, ("requirements.a.maximum = inf deg: ",)),
    ({"cases": '["cold"]'}, ("requirements.a: there is no case cold; there is nominal",)),
    ({"test": '{ kind = "step", amplitude = "45 deg" }'},
     ("requirements.a.test.amplitude = 45 deg: is beyond command.limit = 20 deg",)),
    ({"limit": "3"}, ("requirements.a: unknown key 'limit'",)),
    ({"name": None}, ("requirements.[0]: name is missing",))]


@pytest.mark.parametrize(("changes", "message"), MISTAKES, ids=[message[0][:60] for _, message in MISTAKES])
def test_error_is_one_line_with_file_entry_and_remedy(
        changes: dict[str, str | None], message: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(EmcasError) as raised:
        load_requirements(requirements_file(tmp_path, table(**changes)), load_parameters())
    (line,) = str(raised.value).splitlines()
    assert line.startswith(f"{tmp_path / 'mine.toml'}: ")
    assert all(part in line for part in message), line


def test_duplicate_names_and_empty_files_are_refused(tmp_path: Path) -> None:
    for tables, message in (((table(), table()), r"mine\.toml: requirements\.a.*: appears twice"),
                            ((), r"mine\.toml: .*requirements")):
        with pytest.raises(EmcasError, match=message):
            load_requirements(requirements_file(tmp_path, *tables), load_parameters())


def test_figure_that_the_actuator_lacks_must_be_optional(tmp_path: Path) -> None:
    current = {"figure": '"rms_current"', "maximum": '"1 A"'}
    base = load_parameters(model="electrohydraulic")
    with pytest.raises(EmcasError) as raised:
        load_requirements(requirements_file(tmp_path, table(**current)), base)
    (line,) = str(raised.value).splitlines()
    assert "requirements.a" in line
    assert "this actuator has no motor_current (electrohydraulic)" in line
    assert "optional" in line  # the remedy
    optional = load_requirements(requirements_file(tmp_path, table(**current, optional="true")), base)
    (row,) = judge(ParameterSubject(base), optional)
    assert (row.skipped, row.passed) == (True, False)


@pytest.mark.parametrize(("limit", "expected"), [("0.1 deg", 0.1), ("0.001 rad", degrees(1e-3)), ("6 arcmin", 0.1)])
def test_limit_may_have_any_unit_of_its_quantity(limit: str, expected: float, tmp_path: Path) -> None:
    parameters = load_parameters()
    specification = load_requirements(requirements_file(tmp_path, table(maximum=f'"{limit}"')), parameters)
    (row,) = judge(ParameterSubject(parameters), specification)
    assert (row.unit, row.sense) == ("deg", "<=")
    assert row.limit == pytest.approx(expected, abs=1e-9)  # rounded to nine decimals


@pytest.mark.parametrize("kind", list(TESTS))
def test_every_figure_of_every_excitation_has_a_finite_value(kind: str) -> None:
    test = {"load": Test(kind, torque=50.0), "release": Test(kind, torque=50.0, settle=0.3)}.get(
        kind, Test(kind, radians(5.0), 0.6, torque=-20.0 if kind in ("slew", "step") else 100.0))
    names = TESTS[kind].figures
    ((*found,),) = measure(test, ParameterSubject(load_parameters()), [{}], names, ["maximum"] * len(names))
    assert np.all(np.isfinite(found)), dict(zip(names, found, strict=True))
    assert set(names) <= set(FIGURES)


def test_worse_direction_depends_on_the_sense_of_the_limit() -> None:
    subject = Oscillating(shortfall=0.25)
    figures = "held_angle", "held_angle", "held_error", "held_error"
    ((least, most, low, high),) = measure(Test("step", LEVEL), subject, [{}], figures,
                                          ("minimum", "maximum", "minimum", "maximum"))
    assert (least, most, low, high) == pytest.approx((0.75 * LEVEL, LEVEL, 0.0, 0.25 * LEVEL), abs=1e-12)


def test_rate_asymmetry_is_relative_to_the_faster_direction() -> None:
    class Asymmetric(Known):
        """Follows the command with at most 2 rad/s in the positive and 1.5 rad/s in the negative direction."""

        def angle(self, command: Any, torque: Any, step: float) -> Any:
            angle, angles = float(command[0]), []
            for level in command:
                angle += min(max(level - angle, -1.5 * step), 2.0 * step)
                angles.append(angle)
            return np.array(angles)

    ((asymmetry, rate),) = measure(Test("slew", radians(20.0), 1.0), Asymmetric(outputs=FIN_PORT), [{}],
                                   ("rate_asymmetry", "sustained_rate"), ("maximum", "minimum"))
    # A straight line is interpolated exactly: only some hundred sums round.
    assert (asymmetry, rate) == pytest.approx((0.25, 1.5), rel=1e-9)


def test_variants_measured_together_equal_variants_measured_alone() -> None:
    test, figures = Test("slew", radians(20.0), 0.6, -100.0), ("sustained_rate", "held_error")
    subject, senses = ParameterSubject(load_parameters()), ("minimum", "maximum")
    variants: list[dict[str, float]] = [{}, {"motor.resistance": 0.4}, {"controller.position.kp": 40.0}]
    together = measure(test, subject, variants, figures, senses)
    alone = np.concatenate([measure(test, subject, [variant], figures, senses) for variant in variants])
    np.testing.assert_array_equal(together, alone)


def test_excitations_of_slew_release_and_low_supply() -> None:
    """A slew begins at the opposite amplitude; a released load acts before the judged part; `supply` is a ratio."""
    subject = ParameterSubject(load_parameters())
    slew = excitation(Test("slew", 0.2, 0.5, -30.0), 1.0, subject)
    before = slew.time < slew.moves[-1].start - 1e-9
    assert set(slew.command[before]) == {-0.2}
    assert set(slew.command[~before]) == {0.2}
    release = excitation(Test("release", torque=40.0, settle=0.7, duration=0.5), -1.0, subject)
    load = release.columns["aero_torque"]
    assert set(load[release.time >= release.begin - 1e-9]) == {0.0}
    assert np.count_nonzero(load) == 700
    assert set(load[load != 0.0]) == {-40.0}
    low = excitation(Test("step", 0.1, supply=0.9), 1.0, subject)
    assert set(low.columns["supply_voltage"]) == {0.9 * float(subject.values["drive.supply_voltage"])}


def test_every_shipped_requirement_has_title_source_and_reason() -> None:
    requirements = load_requirements(None, load_parameters()).requirements
    assert len({r.name for r in requirements}) == len(requirements)
    for r in requirements:
        assert r.title
        assert r.source
        assert (r.source == "engineering choice") is bool(r.reason)
