"""`emcas tune`: measurements, the search, its journal, and errors."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from math import degrees, nan, radians
from pathlib import Path
from subprocess import PIPE, Popen
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.bench import subject
from emcas_fmu.bench.frequency_response import frequency_response
from emcas_fmu.bench.linear.actuator import LinearActuator, sound
from emcas_fmu.bench.linear.frequency import margins
from emcas_fmu.bench.measure import Test, describing_function, measure
from emcas_fmu.bench.metrics import step_metrics
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.reference.cases import CASES
from emcas_fmu.runtime.compiled import Tables
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import HOPELESS, Evaluation, Journal, Judgement, evaluate, share
from emcas_fmu.studies.tuning.optimise import Tuning, _evaluated, _processes, tune
from emcas_fmu.studies.tuning.output import at_bounds, verdict, write_json, write_report, write_tuned
from emcas_fmu.studies.tuning.pictures import conflict, front, shares
from emcas_fmu.studies.tuning.study import Study, StudyError, load_study
from emcas_fmu.support.files import models_directory
from tests.campaign.conftest import ODD, replaced
from tests.own_actuator.example import MODEL, changed

SHIPPED = ParameterSubject(load_parameters())
SMALL = """
[tunables]
"controller.position.kp" = { lower = "20 1/s", upper = "150 1/s" }
"controller.velocity.kp" = { lower = "0.02 V*s/rad", upper = "0.15 V*s/rad" }

[cases.nominal]

[cases.cold]
"friction.temperature" = "-6 degC"

[[requirements]]
name = "rise"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "rise_time"
maximum = "%s"

[[requirements]]
name = "overshoot"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "overshoot"
maximum = "10 %%"
cases = ["nominal"]
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL % "20 ms", encoding="utf-8")
    return path


@pytest.fixture
def study(small: Path) -> Study:
    return load_study(small, load_parameters())


def emcas(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["tune", *map(str, arguments)])


# -- measurements ------------------------------------------------------------------


def test_step_figures_are_the_worse_of_two_simulated_directions() -> None:
    values = dict(load_parameters().values)
    (rise, overshoot), again = measure(Test("step", radians(5), 0.6), SHIPPED, [{}, {}], ("rise_time", "overshoot"),
                                       ("maximum", "maximum"))
    assert (rise, overshoot) == tuple(again)
    worst_rise, worst_overshoot = 0.0, 0.0
    for sign in (1.0, -1.0):
        command = np.where(np.arange(651) > 49, sign * radians(5), 0.0)
        run = simulate(values, 0.65, fin_command=command)
        found = step_metrics(run["time"] - 0.05, run["fin_angle"], 0.0, sign * radians(5))
        worst_rise = max(worst_rise, found["rise_time"])
        worst_overshoot = max(worst_overshoot, found["overshoot"])
    assert rise == pytest.approx(worst_rise, rel=1e-9)  # rounding of times
    assert overshoot == pytest.approx(worst_overshoot, rel=1e-9)


def test_negative_torque_opposes_a_slew_in_both_directions() -> None:
    rates = [measure(Test("slew", radians(20), 0.6, torque), SHIPPED, [{}], ("sustained_rate",), ("minimum",)).item()
             for torque in (-100.0, 0.0, 100.0)]
    assert rates == sorted(rates)
    assert degrees(rates[0]) > 200.0


def test_bandwidth_of_sines_agrees_with_the_sweep_of_the_validation() -> None:
    """The sweep's frequency response is accurate to 1.5 %."""
    values = dict(load_parameters().values)
    case = next(c for c in CASES if c.name == "chirp_1deg")
    command = case.inputs()["fin_command"]
    sweep = simulate(values, case.stop_time, case.step, fin_command=command)
    expected = frequency_response(sweep["time"], command, sweep["fin_angle"], 0.5, 24.0)
    (found,) = measure(Test("sine", radians(1)), SHIPPED, [{}], ("bandwidth_3db", "bandwidth_90deg"), ("minimum",) * 2)
    if not np.isnan(expected.bandwidth):  # with faster gains it is beyond the sweep
        assert found[0] == pytest.approx(expected.bandwidth, rel=0.04)
    assert found[1] == pytest.approx(expected.phase_bandwidth, rel=0.04)


def test_gain_of_a_slow_sine_is_one() -> None:
    # Without integral action the closed loop is a lag of 1/kp = 1/60 s; 0.5 Hz is pi rad/s.
    changes = {"encoder.enabled": False, "controller.position.kp": 60.0, "controller.position.ki": 0.0,
               "controller.position.setpoint_weight": 1.0}
    (gain,) = describing_function(SHIPPED, [changes], radians(5), [0.5])
    assert abs(gain) == pytest.approx(1.0, abs=0.02)
    assert np.angle(gain) == pytest.approx(-np.pi / 60.0, rel=0.2)  # friction is not fully compensated


MARGINS = ("gain_margin", "phase_margin", "delay_margin")


@pytest.mark.parametrize(("model", "name"), [
    (NONLINEAR, "controller.position.kp"), ("elastic+heat+homing+faults", "controller.position.kp"),
    (MODEL, "controller.kp")])
@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_margins_are_those_of_the_analysis(model: str, name: str, factor: float) -> None:
    base = load_parameters(model=model)
    plain = sound(base)
    values = {**plain.values, name: factor * float(plain.values[name])}
    expected = margins(LinearActuator(values, model=plain.model).loop("reference"))
    (found,) = measure(Test("linear"), ParameterSubject(base), [{name: values[name]}], MARGINS, ("minimum",) * 3)
    # A cubic spline interpolates a coarser grid of 7 % steps.
    assert found == pytest.approx([expected.gain_db, expected.phase, expected.delay], rel=1e-4)


def test_unstable_loop_has_no_margins() -> None:
    unstable = {"controller.velocity.kp": 10.0 * SHIPPED.values["controller.velocity.kp"]}
    assert np.isnan(measure(Test("linear"), SHIPPED, [unstable], MARGINS, ("minimum",) * 3)).all()


@pytest.mark.parametrize(("sense", "limit", "measured", "expected"), [
    ("maximum", 2.0, 1.0, 0.5), ("minimum", 2.0, 4.0, 0.5), ("minimum", 2.0, 0.0, HOPELESS),
    ("minimum", 2.0, -1.0, HOPELESS), ("maximum", 2.0, nan, HOPELESS), ("maximum", 2.0, float("inf"), HOPELESS)])
def test_share_of_the_limit(study: Study, sense: str, limit: float, measured: float, expected: float) -> None:
    requirement = study.requirements[0].model_copy(update={"maximum": None, sense: limit})
    assert share(requirement, measured) == expected


# -- the study -----------------------------------------------------------------------


def test_shipped_study_has_the_cases_figures_and_limits_of_the_requirements() -> None:
    study = load_study(models_directory() / "tuning.toml", load_parameters())
    assert {"nominal", "cold", "sag"} <= {c.name for c in study.cases}
    assert {"steady_error", "sustained_rate", "bandwidth_3db", "overshoot", "rise_time", "settling_time", "rms_current",
            "gain_margin", "phase_margin"} <= {r.figure for r in study.requirements}
    assert {r.test.torque for r in study.requirements if r.test} >= {-100.0, 0.0, 100.0}
    limits = {r.name: r for r in load_requirements(None, study.base).requirements if "Table 2" in r.source}
    assert limits.keys() & {r.name for r in study.requirements} >= {"loaded_rate", "bandwidth_1deg", "bandwidth_3p5deg"}
    for r in study.requirements:
        if r.name in limits:  # both files contain the limits of Table 2
            assert r.sense == limits[r.name].sense, r.name
            assert r.limit == pytest.approx(limits[r.name].limit, rel=1e-12), r.name


def test_percentage_in_a_case_is_relative_to_the_tuned_set(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text((SMALL % "20 ms").replace("[cases.nominal]", '[cases.nominal]\n"inertia.fin" = "150 %"'),
                    encoding="utf-8")
    base = load_parameters().with_values({"inertia.fin": "0.1 kg*m^2"})
    assert load_study(path, base).cases[0].values["inertia.fin"] == pytest.approx(0.15, rel=1e-12)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('figure = "rise_time"', 'figure = "rise_tim"', "did you mean rise_time"),
    ('figure = "rise_time"', 'figure = "bandwidth_3db"', "a step test has no such figure"),
    ('"20 ms"', '"20 deg"', "does not measure"), ('"20 ms"', '"-1 ms"', "above 0"),
    ("maximum = ", "maximun = ", "did you mean maximum"), ('kind = "step"', 'kind = "hop"', "there is step, slew"),
    ('cases = ["nominal"]', 'cases = ["warm"]', "there is no case warm"),
    ('name = "overshoot"', 'name = "rise"', "twice"),
    ("friction.temperature", "friction.temperatur", "friction.temperature"), ('"-6 degC"', '"1e9 degC"', "temperature"),
    ('lower = "20 1/s"', 'lower = "-1 1/s"', "0 < lower"),
    ('lower = "20 1/s"', 'lower = "0 1/s"', "has no 0; write a small value such as 0.15 1/s"),
    ('lower = "20 1/s"', 'lower = "20 m"', "does not measure"),
    ('amplitude = "2 deg"', 'amplitude = "0 deg"', "amplitude above 0"), ("[tunables]", "[tunable]", "tunables"),
    ('cases = ["nominal"]', "cases = []", "at least one"),
    ('cases = ["nominal"]', 'cases = "nominal"', "must be a list"),
    ('cases = ["nominal"]', "cases = 5", "must be a list"), ('name = "overshoot"', 'name = ["os"]', "must be a string"),
    ('amplitude = "2 deg"', 'amplitude = "60 deg"', "beyond command.limit"),
    ("[cases.nominal]", '[cases.nominal]\n"controller.position.kp" = "300 %"', "is one of the tunables"),
    ('duration = "0.3 s"', 'duration = "1 ms"', "duration"), ("[[requirements]]", "[[", "is not valid TOML")])
def test_error_names_the_mistake_in_a_study(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    text = SMALL % "20 ms"
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(StudyError) as caught:
        load_study(path, load_parameters())
    assert message in str(caught.value)
    assert "bad.toml" in str(caught.value)


@pytest.mark.parametrize("odd", ODD, ids=str)
def test_odd_value_at_any_position_gives_no_traceback(tmp_path: Path, odd: str) -> None:
    path = tmp_path / "odd.toml"
    for text in replaced(SMALL % "20 ms", odd):
        path.write_text(text, encoding="utf-8")
        with suppress(StudyError):
            load_study(path, load_parameters())


# -- the search ----------------------------------------------------------------------


def test_search_finds_better_gains_and_is_reproducible(study: Study) -> None:
    first, again = (tune(study, seed=3, generations=4) for _ in range(2))
    assert first.best.objective < first.before.objective
    assert first.best.gains == again.best.gains
    assert first.history == again.history
    assert first.history == tuple(np.minimum.accumulate(first.history))
    assert tune(study, seed=4, generations=4).history != first.history
    other = replace(study, base=study.base.with_values({"controller.position.kp": 100.0}))
    assert tune(other, seed=3, generations=4).best == first.best  # the initial gains do not matter
    assert all(type(j.measured) is type(j.share) is float for j in first.best.judgements)  # JSON has no NumPy numbers
    (checked,) = evaluate(study, [first.best.gains])
    assert checked == first.best  # the written gains give the reported figures


def test_gains_judged_together_equal_gains_judged_alone() -> None:
    """Each bisection of a bandwidth has its own frequencies."""
    shipped = load_study(models_directory() / "tuning.toml", load_parameters())
    study = replace(shipped, cases=tuple(case for case in shipped.cases if case.name in ("nominal", "light_dry")))
    gains = [{t.name: t.lower ** (1.0 - share) * t.upper ** share for t in study.tunables} for share in (0.0, 0.4, 1.0)]
    together = evaluate(study, gains)
    assert together == [evaluate(study, [each])[0] for each in gains]
    assert len({e.by_requirement()["bandwidth_1deg"].measured for e in together}) == len(gains)


@pytest.mark.parametrize(("count", "workers"), [(0, 2), (1, 1), (1, 3), (1, 20), (2, 3), (40, 2), (33, 1)])
def test_parts_contain_all_gains_and_cases(count: int, workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each gain has a judgement for each case, and no worker is idle if there is enough to compute."""
    study, gains = load_study(models_directory() / "tuning.toml", load_parameters()), [{"g": k} for k in range(count)]
    sizes: list[int] = []

    def judged(study: Study, gains: Sequence[Any]) -> list[Evaluation]:
        sizes.append(len(gains) * len(study.cases))
        return [Evaluation(each, tuple(Judgement("r", case.name, 0.0, 0.0) for case in study.cases)) for each in gains]

    monkeypatch.setattr("emcas_fmu.studies.tuning.optimise.evaluate", judged)
    found = [each for several in _evaluated(map, study, gains, workers) for each in several]
    assert [each.gains for each in found] == gains
    assert all([j.case for j in each.judgements] == [case.name for case in study.cases] for each in found)
    assert all(sizes)
    assert len(sizes) >= min(workers, count if count > 1 else count * len(study.cases))


@pytest.mark.slow
def test_workers_do_not_change_the_result(study: Study) -> None:
    alone, together = tune(study, generations=2), tune(study, generations=2, workers=2)
    assert alone.best == together.best
    assert alone.history == together.history


def test_error_if_a_worker_dies() -> None:
    with pytest.raises(EmcasError, match=r"^tune: one of 2 worker processes died .*; use fewer workers; .*$"), \
            _processes(2) as run:
        list(run(os._exit, [1]))


def test_stopped_search_is_continued(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal.jsonl"
    uninterrupted = tune(study, generations=3)
    count, limit = 0, 32  # evaluated gains

    class Killed(BaseException):
        pass

    def evaluate_up_to_limit(study: Study, gains: Sequence[Any]) -> list[Evaluation]:
        nonlocal count
        if count >= limit:
            raise Killed
        count += len(gains)
        return evaluate(study, gains)

    monkeypatch.setattr("emcas_fmu.studies.tuning.optimise.evaluate", evaluate_up_to_limit)
    with pytest.raises(Killed):
        tune(study, generations=3, journal=Journal(path, study))
    with path.open("a", encoding="utf-8") as file:
        file.write('{"gains": {"contr')  # killed while writing
    journal = Journal(path, study)
    assert len([*journal]) == count
    limit = len(uninterrupted.evaluated)
    assert tune(study, generations=3, journal=journal).best == uninterrupted.best
    assert count == len(uninterrupted.evaluated)  # no gains are evaluated twice
    assert len([*Journal(path, study)]) == len(uninterrupted.evaluated)


def test_journal_cut_at_any_byte_is_continued(study: Study, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    tune(study, generations=1, journal=Journal(path, study))
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    for size in (5, len(lines[0]), len(whole) - 1):
        path.write_bytes(whole[:size])
        journal = Journal(path, study)
        assert len([*journal]) == max(whole[:size].count(b"\n") - 1, 0)
        journal.add(Journal(None, study))
        tune(study, generations=1, journal=journal)
        assert sorted(path.read_bytes().splitlines()) == sorted(whole.splitlines())


def test_journal_of_another_study_is_refused(study: Study, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    Journal(path, study)
    other = load_study(models_directory() / "tuning.toml", load_parameters())
    with pytest.raises(StudyError, match="another study"):
        Journal(path, other)
    for foreign, refusal in (("nonsense\n", "not a journal"), ("nonsense", "not a journal"),
                             ('{"a": 1}', "another study")):
        path.write_text(foreign, encoding="utf-8")  # also a file of one line without an end is not overwritten
        with pytest.raises(StudyError, match=refusal):
            Journal(path, study)
        assert path.read_text(encoding="utf-8") == foreign


def test_gains_that_cannot_be_simulated_are_hopeless(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(sets: np.ndarray, inputs: Sequence[np.ndarray], step: float, outputs: Sequence[str], **_: Any) -> Tables:
        columns = {name: np.full((len(sets), inputs[0].shape[-1]), nan) for name in outputs}
        return Tables(columns, np.zeros(len(sets)), {k: ArithmeticError("gone") for k in range(len(sets))})

    def judged(*gains: dict[str, float]) -> list[set[float]]:
        return [{j.share for j in evaluation.judgements} for evaluation in evaluate(study, gains)]

    gains = {t.name: t.lower for t in study.tunables}
    (alone,) = judged(gains)
    assert alone != {HOPELESS}
    beyond = {**gains, "controller.sample_time": 1.0}  # beyond its limits
    assert judged(gains, beyond, gains) == [alone, {HOPELESS}, alone]
    monkeypatch.setattr(subject, "respond_all", fails)
    assert judged(gains) == [{HOPELESS}]


# -- conflicts -------------------------------------------------------------------------


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=30))
def test_front_contains_all_points_that_no_other_beats(points: list[tuple[int, int]]) -> None:
    found = front(points)
    for x, y in found:
        assert not any(a <= x and b <= y and (a, b) != (x, y) for a, b in points)
    assert {p for p in points if not any(a <= p[0] and b <= p[1] and (a, b) != p for a, b in points)} == set(found)


def test_conflict_is_the_pair_with_the_most_negative_correlation() -> None:
    def evaluation(x: float) -> Evaluation:
        shares = {"speed": x, "overshoot": 1.5 - x, "alike": x + 0.1, "constant": 0.3}
        return Evaluation({"g": x}, tuple(Judgement(n, "nominal", s, s) for n, s in shares.items()))

    evaluated = [evaluation(x) for x in np.linspace(0.5, 1.0, 20)]
    first, second, correlation = conflict(evaluated) or ("", "", 0.0)
    assert "overshoot" in (first, second)
    assert correlation < -0.99
    chosen = conflict(evaluated, ("speed", "alike"))
    assert chosen is not None
    assert chosen[:2] == ("speed", "alike")
    assert len(front(shares(evaluated, *chosen[:2]))) == 1  # no conflict: one point is best in both


# -- the command -------------------------------------------------------------------------


@pytest.mark.drawn
def test_command_writes_parameters_that_load(small: Path, tmp_path: Path) -> None:
    made = tmp_path / "tuned.toml"
    result = emcas(small, "-o", made, "--json", tmp_path / "t.json", "--report", tmp_path / "t.html",
                   "--generations", 3, "--workers", 1)
    assert result.exit_code == 0, result.output
    tuned = load_parameters(made)
    entry = next(e for e in tuned.entries if e.variable.name == "controller.position.kp")
    assert entry.source == "tuned"
    assert "--seed 1" in entry.note
    found = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert found["gains"]["controller.position.kp"] == entry.value
    assert found["met"] is True
    page = (tmp_path / "t.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 2
    assert "binding: " in result.output.replace("\n", " ")


def test_figure_that_is_never_reached_is_shown_as_not_reached(tmp_path: Path) -> None:
    """In one case the command limit of 1 deg clips the step of 2 deg."""
    path = tmp_path / "never.toml"
    text = SMALL.replace('"rise_time"', '"time_to_accuracy"') % "20 ms"
    path.write_text(text.replace("[cases.nominal]", '[cases.nominal]\n"command.limit" = "1 deg"'), encoding="utf-8")
    result = emcas(path, "--report", tmp_path / "t.html", "--json", tmp_path / "t.json", "--generations", 1,
                   "--workers", 1)
    assert result.exit_code == 1, result.output
    page = (tmp_path / "t.html").read_text(encoding="utf-8")
    for text in (result.output, page):
        assert "not reached" in text
        assert "inf ms" not in text
    assert "with a margin of −900 % or less" in result.stderr
    (row, _) = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))["requirements"]
    assert (row["figure"], row["measured"]) == ("time_to_accuracy", None)


def test_requirement_that_no_gains_meet_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "hard.toml"
    path.write_text(SMALL % "1 ms", encoding="utf-8")
    result = emcas(path, "--generations", 2, "--workers", 1)
    assert result.exit_code == 1
    message = " ".join(result.output.split())
    assert "the returned gains miss rise" in message
    assert "MISSED" in message
    # Standard error is no terminal: each generation gives a line.
    lines = re.findall(r"^tune (\d) of 3: global search, worst requirement \S+ with a margin of \S+ %$", result.stderr,
                       re.MULTILINE)
    assert lines == ["1", "2"]


@pytest.mark.parametrize(("arguments", "message"), [
    (("--pareto", "rise"), "--pareto must appear twice"),
    (("--pareto", "rise", "--pareto", "x"), "two different requirements among rise, overshoot"),
    (("--pareto", "rise", "--pareto", "rise"), "two different requirements among rise, overshoot"),
    (("--parameters", "none.toml"), "none.toml"), (("--output", "no/such/x.toml"), "there is no folder")])
def test_error_names_the_option_and_the_remedy(small: Path, arguments: tuple[str, ...], message: str) -> None:
    result = emcas(small, *arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


def test_written_file_contains_the_tuned_set_and_the_gains(small: Path, tmp_path: Path) -> None:
    mine, more, made = (tmp_path / name for name in ("mine.toml", "more.toml", "tuned.toml"))
    mine.write_text('motor.resistance = { value = 251, unit = "mOhm", source = "datasheet", note = "a note" }\n'
                    'controller.position.kp = "40 1/s"\nencoder.pulses = 1024\n', encoding="utf-8")
    more.write_text('"friction.coulomb.positive[1]" = "0.0123 N*m"\nencoder.pulses = 2048\n', encoding="utf-8")
    result = emcas(small, "-p", mine, "-p", more, "-o", made, "--generations", 1, "--workers", 1)
    assert result.exit_code in (0, 1), result.output
    tunables = ("controller.position.kp", "controller.velocity.kp")
    before, after = ({e.variable.name: e for e in load_parameters(files).entries} for files in ((mine, more), made))
    for name, entry in after.items():
        if name in tunables:
            assert entry.source == "tuned"
            assert f"--parameters {mine} --parameters {more}" in entry.note
        else:
            was = before[name]
            assert (entry.value, entry.source, entry.note) == (was.value, was.source, was.note), name


def test_sag_is_a_percentage_of_the_supply_voltage() -> None:
    def sag(base: ParameterSet) -> float:
        study = load_study(models_directory() / "tuning.toml", base)
        return float(next(c for c in study.cases if c.name == "sag").values["drive.supply_voltage"])

    assert sag(load_parameters()) == 35.0  # exactly: the shipped gains were tuned with it
    small = load_parameters().with_values({"drive.supply_voltage": 28.0})
    assert sag(small) == pytest.approx(28.0 * 35.0 / 39.0, rel=1e-12)  # the digits of the percentage


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal to a group of processes")
@pytest.mark.parametrize("evaluations", [pytest.param(0, marks=pytest.mark.slow), 5])
def test_ctrl_c_keeps_the_best_gains(small: Path, tmp_path: Path, evaluations: int) -> None:
    """In a terminal the signal also reaches the workers, possibly while they start."""
    made, figures, journal, loops = (
        tmp_path / name for name in ("tuned.toml", "t.json", "journal.jsonl", "loops.toml"))
    # With the shipped setpoint weight many gains do not overshoot, and the search ends too soon.
    loops.write_text("controller.position.setpoint_weight = 1\n", encoding="utf-8")
    command = [sys.executable, "-c", "from emcas_fmu.cli import app; app(prog_name='emcas')", "tune", small, "-o", made,
               "-p", loops, "--json", figures, "--journal", journal, "--workers", "2", "--generations", "1000"]
    with Popen(list(map(str, command)), stdout=PIPE, stderr=PIPE, text=True, start_new_session=True) as running:
        deadline = monotonic() + 60.0
        while not journal.is_file() or journal.read_bytes().count(b"\n") < 1 + evaluations:
            assert running.poll() is None, running.communicate()
            assert monotonic() < deadline
            sleep(0.01)
        os.killpg(running.pid, signal.SIGINT)
        output, errors = running.communicate(timeout=60)
    assert running.returncode == 130, errors
    assert "Traceback" not in errors
    if not made.exists():
        assert evaluations == 0
        assert "stopped before any gains were judged" in errors
        return
    assert "stopped by Ctrl-C, " in " ".join(output.split())
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["stopped"] is True
    values = load_parameters(made).values
    assert found["gains"] == {name: values[name] for name in found["gains"]}
    (afresh,) = evaluate(load_study(small, load_parameters(loops)), [found["gains"]])
    assert afresh.objective == found["objective"]["returned"] <= found["objective"]["before"]
    assert found["unimproved"] == (found["gains"] == found["before"])


def test_stopped_search_without_better_gains_returns_the_initial_set(
        study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(objective: Callable[[np.ndarray], object], bounds: Sequence[tuple[float, float]], **_: object) -> None:
        objective(np.array([[low] for low, _ in bounds]))
        raise KeyboardInterrupt

    monkeypatch.setattr("emcas_fmu.studies.tuning.optimise.differential_evolution", stop)
    result = tune(study)
    assert (result.unimproved, result.best) == (True, result.before)
    assert "found no gains better than the initial ones" in verdict(result)
    write_tuned(result, tmp_path / "kept.toml", "emcas tune")
    assert load_parameters(tmp_path / "kept.toml").entries == load_parameters().entries


def test_gains_at_a_bound_are_marked(study: Study, tmp_path: Path) -> None:
    first, *others = study.tunables
    assert first.bound(first.lower ** 0.02 * first.upper ** 0.98) == ""
    assert [t.bound(t.upper) for t in study.tunables] == ["upper"] * len(study.tunables)
    (before,) = evaluate(study, [{first.name: first.lower, **{t.name: (t.lower * t.upper) ** 0.5 for t in others}}])
    other = replace(before, gains={**before.gains, first.name: first.upper})
    assert Tuning(study, 1, before, before, nan, (before,), (before.objective,), False).at_bound == {}
    result = Tuning(study, 1, before, other, nan, (before,), (before.objective,), False)
    assert result.at_bound == {first.name: "lower"}
    assert f"(within 1 % of its logarithmic range): {first.name} = {first.lower:g}" in at_bounds(result)
    write_report(result, tmp_path / "t.html")
    assert (tmp_path / "t.html").read_text(encoding="utf-8").count("(near the bound)") == 1
    write_json(result, tmp_path / "t.json", "emcas tune")
    assert json.loads((tmp_path / "t.json").read_text())["at_bound"] == {first.name: "lower"}


# -- every actuator ------------------------------------------------------------------------

DIRECT = """
[tunables]
"controller.kp" = { lower = "100 V/rad", upper = "1000 V/rad" }
"controller.ki" = { lower = "1000 V/(rad.s)", upper = "20000 V/(rad.s)" }

[cases.nominal]

[cases.sag]
"drive.supply_voltage" = "90 %"

[[requirements]]
name = "rise"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "rise_time"
maximum = "20 ms"

[[requirements]]
name = "overshoot"
test = { kind = "slew", amplitude = "10 deg", torque = "-50 N.m", duration = "0.5 s", settle = "0.5 s" }
figure = "overshoot"
maximum = "3 %"
"""


@pytest.mark.slow
def test_users_actuator_is_tuned_and_built(tmp_path: Path) -> None:
    """The initial gains miss requirements, which the tuned gains meet."""
    study, bad, made, fmu = (tmp_path / name for name in ("direct.toml", "bad.toml", "tuned.toml", "tuned.fmu"))
    study.write_text(DIRECT, encoding="utf-8")
    bad.write_text('controller.kp = "120 V/rad"\ncontroller.ki = "1100 V/(rad.s)"\n', encoding="utf-8")
    result = emcas(study, "--model", MODEL, "-p", bad, "-o", made, "--report", tmp_path / "t.html", "--json",
                   tmp_path / "t.json", "--generations", 2, "--workers", 1)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert not all(row["met"] for row in found["requirements_before"])
    assert all(row["met"] for row in found["requirements"])
    assert found["model"] == "direct-drive"
    tuned = load_parameters(made, model=MODEL)
    assert {name: tuned.values[name] for name in found["gains"]} == found["gains"]
    assert "direct-drive" in (tmp_path / "t.html").read_text(encoding="utf-8")
    built = CliRunner().invoke(app, ["build", "--model", MODEL, "-p", str(made), "-o", str(fmu)])
    assert built.exit_code == 0, built.output
    starts = {v.name: v.start for v in read_model_description(fmu).modelVariables}
    assert float(starts["controller.kp"]) == found["gains"]["controller.kp"]


ORDER = """
[tunables]
"second_order.natural_frequency" = { lower = "30 rad/s", upper = "300 rad/s" }
[cases.nominal]
[[requirements]]
name = "rise"
test = { kind = "%s", amplitude = "2 deg" }
figure = "%s"
maximum = "%s"
"""


@pytest.mark.parametrize(("model", "changes"), [
    ("second-order", ()),
    pytest.param("elastic+heat+homing+faults", (
        ("second_order.natural_frequency", "controller.position.kp"), ("rad/s", "1/s")), marks=pytest.mark.slow)])
def test_command_tunes_other_actuators(tmp_path: Path, model: str, changes: tuple[tuple[str, str], ...]) -> None:
    path, text = tmp_path / "order.toml", ORDER % ("step", "rise_time", "30 ms")
    for old, new in changes:
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    result = emcas(path, "--model", model, "--generations", 1, "--workers", 1)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(("model", "study", "message"), [
    ("second-order", ORDER.replace(', amplitude = "2 deg"', "") % ("linear", "phase_margin", "30 deg"),
     "requirements.rise: phase_margin: margins need a sampled position loop, which this actuator does not have "
     "(second-order); with optional = true it is then not judged"),
    ("second-order", ORDER % ("step", "peak_current", "3 A"), "requirements.rise: peak_current: this actuator has no "
     "motor_current (second-order); with optional = true"),
    (MODEL, ORDER % ("step", "rise_time", "3 s"), "no such parameter; the tunable parameters are controller.kp, contr"),
    ("second-order", None, "model second-order: the shipped studies are for nonlinear")])
def test_error_names_what_the_actuator_lacks(tmp_path: Path, model: str, study: str | None, message: str) -> None:
    path = tmp_path / "order.toml"
    path.write_text(study or "", encoding="utf-8")
    result = emcas(*([path] if study else []), "--model", model)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())
    assert result.stderr.count("\n") == 1, result.stderr


def test_changed_users_file_changes_the_digest_of_a_study(tmp_path: Path) -> None:
    path = tmp_path / "direct.toml"
    path.write_text(DIRECT, encoding="utf-8")
    models = [str(changed(tmp_path, name="one.py")), str(changed(tmp_path, ("p.hinge.damping", "1.1 * p.hinge.damping"),
                                                                 name="two.py"))]
    one, two = (load_study(path, load_parameters(model=model)) for model in models)
    assert one.digest != two.digest
