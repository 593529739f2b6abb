"""The gains that `emcas tune` returns: judged as written, rounded, and never worse than the initial gains."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import floor, log10, nan
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.pages import numbers
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.tuning import optimise
from emcas_fmu.studies.tuning.evaluate import Evaluation, Journal, Judgement, evaluate, share
from emcas_fmu.studies.tuning.optimise import Tuning, rounded, tune
from emcas_fmu.studies.tuning.output import objectives, rows, summary, verdict, write_json, write_report, write_tuned
from emcas_fmu.studies.tuning.pictures import trade
from emcas_fmu.studies.tuning.study import Study, load_study
from tests.marks import slow
from tests.own_actuator.example import MODEL

Judge = Callable[[Study, Sequence[Mapping[str, float]]], list[Evaluation]]
STEPS = """
[cases.nominal]
[[requirements]]
name = "settling"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "settling_time"
maximum = "60 ms"
[[requirements]]
name = "overshoot"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "overshoot"
maximum = "2 %"
[[requirements]]
name = "rise"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "rise_time"
maximum = "25 ms"
"""
LOOPS = ("controller.position.kp", 1.3), ("controller.position.setpoint_weight", 1.05)
DIRECT = ("controller.kp", 2.0), ("controller.ki", 3.0)


def study_of(model: str, tunables: Sequence[tuple[str, float]], folder: Path, start: Mapping[str, float]) -> Study:
    """Return a small study. A tunable's bounds are its shipped value divided and multiplied by its factor.

    The values `start` replace those of the tuned set.
    """
    base = load_parameters(model=model)
    units = {e.variable.name: e.variable.unit for e in base.entries}
    bounds = [f'"{name}" = {{ lower = "{base.values[name] / factor:.6g} {units[name]}", upper = '
              f'"{base.values[name] * factor:.6g} {units[name]}" }}' for name, factor in tunables]
    path = folder / "study.toml"
    path.write_text("[tunables]\n" + "\n".join(bounds) + STEPS, encoding="utf-8")
    return load_study(path, base.with_values(dict(start)))


def third_digit(gains: Mapping[str, float], study: Study) -> list[dict[str, float]]:
    """Return all gains within the bounds that differ in one gain by one unit of its third digit."""
    units = {t.name: 10.0 ** (floor(log10(gains[t.name])) - 2) for t in study.tunables}
    return [{**gains, t.name: value} for t in study.tunables
            for value in (gains[t.name] - units[t.name], gains[t.name] + units[t.name]) if t.lower <= value <= t.upper]


def evaluation_of_file(result: Tuning, folder: Path) -> Evaluation:
    """Write the tuned gains, read the file, and return its evaluation."""
    write_tuned(result, folder / "tuned.toml", "emcas tune")
    values = load_parameters(folder / "tuned.toml", model=result.study.base.model).values
    (found,) = evaluate(result.study, [{t.name: float(values[t.name]) for t in result.study.tunables}])
    return found


@pytest.mark.parametrize("seed", [1, *slow(2)])
@pytest.mark.parametrize(("model", "tunables"), [
    ("nonlinear", LOOPS), (MODEL, DIRECT),
    *slow(*((name, LOOPS) for name in ("worm-gear", "clutch", "electrohydraulic", "electrohydrostatic")))],
    ids=lambda value: Path(value).stem if isinstance(value, str) else "")
def test_returned_gains_are_no_worse_than_the_initial_ones(
        model: str, tunables: Sequence[tuple[str, float]], seed: int, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch) -> None:
    """The search begins with the shipped gains, and again with the unrounded best gains of the first search."""
    monkeypatch.setattr(optimise, "_POPULATION", 4)
    monkeypatch.setattr(optimise, "_LOCAL", 6)
    first = tune(study_of(model, tunables, tmp_path, {}), seed, 1)
    exact = min(first.evaluated, key=lambda e: e.objective)
    again = tune(study_of(model, tunables, tmp_path, exact.gains), seed, 1)
    for result in (first, again):
        assert result.best.objective <= result.before.objective
        assert evaluation_of_file(result, tmp_path) == result.best
    assert again.before == exact


# -- a landscape with a cliff -------------------------------------------------------------


def landscape(share: Sequence[float], cliff: float) -> Judge:
    """Return an objective that falls with both gains, and jumps up where the first gain exceeds `cliff`."""
    def judge(study: Study, gains: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        def evaluation(values: Mapping[str, float]) -> Evaluation:
            first, second = (values[t.name] / t.upper for t in study.tunables)
            value = 1.0 + share[0] * (1.0 - first) + share[1] * (1.0 - second) ** 2
            return Evaluation(dict(values), (Judgement("settling", "nominal", value, value + (
                0.7 if first > cliff else 0.0)),))

        return [evaluation(values) for values in gains]

    return judge


PAIR = ("controller.position.kp", 1.3), ("controller.velocity.kp", 1.2)


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.tuples(st.floats(0.01, 2.0), st.floats(0.0, 2.0)), cliff=st.floats(0.8, 1.0),
       start=st.tuples(st.floats(0.75, 1.3), st.floats(0.8, 1.2)), seed=st.integers(0, 5),
       interrupted=st.none() | st.integers(1, 60))
def test_returned_gains_keep_away_from_a_cliff(
        share: tuple[float, float], cliff: float, start: tuple[float, float], seed: int, interrupted: int | None,
        tmp_path: Path) -> None:
    """Also if Ctrl-C ends the search after any number of evaluations."""
    shipped = load_parameters().values
    study = study_of("nonlinear", PAIR, tmp_path, {
        name: shipped[name] * factor for (name, _), factor in zip(PAIR, start, strict=True)})
    judge, calls = landscape(share, cliff), 0

    def judged(study: Study, gains: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        nonlocal calls
        calls += 1
        if calls == interrupted:
            raise KeyboardInterrupt
        return judge(study, gains)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimise, "evaluate", judged)
        try:
            result = tune(study, seed, 3)
        except KeyboardInterrupt:  # before the first evaluation
            assert interrupted == 1
            return
    assert result.best.objective <= result.before.objective
    assert [result.best] == judge(study, [result.best.gains])
    largest = max(e.objective for e in judge(study, [result.best.gains, *third_digit(result.best.gains, study)]))
    if result.nearby == result.nearby:  # nan if Ctrl-C came before the neighbours were judged
        assert result.nearby == pytest.approx(largest, rel=1e-9)  # the neighbours differ by rounding
    if not result.stopped:
        worst = max(e.objective for e in judge(study, [result.before.gains, *third_digit(result.before.gains, study)]))
        assert largest <= worst * (1.0 + 1e-9)
    if result.best != result.before:
        assert result.best.gains == rounded(result.best.gains, study)


def test_best_gains_are_not_returned_if_rounding_makes_them_much_worse(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cliff is at 99.99 % of the upper bound: three digits are too coarse for it."""
    monkeypatch.setattr(optimise, "evaluate", landscape((0.2, 0.1), 0.9999))
    result = tune(study_of("nonlinear", PAIR, tmp_path, {}), 1, 12)
    assert min(e.objective for e in result.evaluated) < result.best.objective <= result.before.objective
    assert result.nearby < 1.1


def test_initial_gains_are_returned_if_none_are_better(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = study_of("nonlinear", PAIR, tmp_path, {"controller.position.kp": 51.2345678})

    def judged(study: Study, gains: Sequence[Mapping[str, float]]) -> list[Evaluation]:
        shares = [1.0 if each["controller.position.kp"] == 51.2345678 else 2.0 for each in gains]
        return [Evaluation(dict(each), (Judgement("rise", "nominal", share, share),))
                for each, share in zip(gains, shares, strict=True)]

    monkeypatch.setattr(optimise, "evaluate", judged)
    result = tune(study, 1, 1)
    assert result.unimproved
    assert not result.stopped
    assert "found no gains better than the initial ones, which are returned" in verdict(result)
    write_tuned(result, tmp_path / "kept.toml", "emcas tune")
    kept = load_parameters(tmp_path / "kept.toml")
    assert kept.values == study.base.values
    assert [e.source for e in kept.entries] == [e.source for e in study.base.entries]


def test_rounded_gains_lie_between_their_bounds(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text('[tunables]\n"controller.position.kp" = { lower = "53.9612 1/s", upper = "53.9634 1/s" }\n' + STEPS,
                    encoding="utf-8")
    study = load_study(path, load_parameters())
    (t,) = study.tunables
    for value, expected in ((53.9620001, 53.962), (53.9612, 53.9612), (53.9634, 53.963), (53.96125, 53.9612),
                            (53.9640, 53.963)):
        assert rounded({t.name: value}, study) == {t.name: expected}
    assert optimise.neighbours({t.name: 53.962}, study) == []


# -- page and messages -----------------------------------------------------------------------


def shown(study: Study, measured: float, folder: Path) -> tuple[Tuning, str, dict[str, Any]]:
    """Return a result whose first requirement has the measured value [SI], its page and its JSON."""
    requirement = study.requirements[0]
    gains = {t.name: 51.23456 for t in study.tunables}
    judgement = Judgement(requirement.name, "nominal", measured, share(requirement, measured))
    others = tuple(Judgement(r.name, "nominal", 0.5 * r.limit, 0.5) for r in study.requirements[1:])
    best = Evaluation(gains, (judgement, *others))
    result = Tuning(study, 1, best, best, nan, (best,), (best.objective,), False)
    write_report(result, folder / "t.html")
    write_json(result, folder / "t.json", "emcas tune")
    return (result, (folder / "t.html").read_text(encoding="utf-8"),
            json.loads((folder / "t.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("off", [-1e-3, -1e-12, 0.0, 1e-12, 1e-8, 2e-6, 3e-5, 1e-4, 4e-3, 0.3])
def test_figure_shown_equal_to_its_limit_meets_it(off: float, tmp_path: Path) -> None:
    study = study_of("nonlinear", PAIR[:1], tmp_path, {})
    result, page, document = shown(study, study.requirements[0].limit * (1.0 + off), tmp_path)
    row = rows(result, result.best)[0]
    assert row["met"] is document["requirements"][0]["met"] is (off <= 1e-9)
    text, limit = (numbers.with_unit(value, row["unit"], row["limit"]) for value in (row["measured"], row["limit"]))
    assert row["met"] or text != limit
    assert f"{'✓' if row['met'] else '✗'} {text}" in page
    assert f"≤ {limit}" in page
    share = numbers.percent(row["margin"])
    assert f">{share}<" in page
    assert (share[0] == "−") is (off > 1e-9)
    assert share not in ("−0 %", "-0 %")
    if not row["met"]:
        assert f"has a margin of {share}" in verdict(result)
        assert "the returned gains miss settling" in verdict(result)


@pytest.mark.parametrize(("off", "margin", "objective"), [
    (0.3, "−30 %", "1.3"), (1.5e6, "−900 % or less", "10 or more")])
def test_margin_and_objective_far_beyond_the_limit_are_shown_as_bounds(off: float, margin: str, objective: str,
                                                                       tmp_path: Path) -> None:
    study = study_of("nonlinear", PAIR[:1], tmp_path, {})
    result, page, _ = shown(study, study.requirements[0].limit * (1.0 + off), tmp_path)
    assert f"has a margin of {margin};" in verdict(result)
    assert f"<td class=\"n\">{margin}</td>" in page
    assert margin in list(summary(result).columns[4].cells)
    assert objectives(result) == f"objective: {objective} initial, {objective} returned"
    result = replace(result, nearby=result.best.objective)
    nearby = objective if off > 1.0 else f"at most {objective}"
    assert f"; {nearby} if the third digit" in objectives(result)


def test_returned_objective_never_looks_worse_than_the_initial_one(tmp_path: Path) -> None:
    study = study_of("nonlinear", PAIR[:1], tmp_path, {})
    result, _, _ = shown(study, study.requirements[0].limit * 1.3001, tmp_path)
    judged = [replace(j, share=j.share * 1.3003 / 1.3001) for j in result.best.judgements]
    before = replace(result, before=replace(result.best, judgements=tuple(judged)))
    assert objectives(before).startswith("objective: 1.3005 initial, 1.3003 returned")


@pytest.mark.drawn
def test_axes_of_the_trade_off_are_shares(tmp_path: Path) -> None:
    """The share of a minimum is its reciprocal: measured/limit would be met above 1."""
    study = study_of("nonlinear", PAIR[:1], tmp_path, {})
    result, _, _ = shown(study, study.requirements[0].limit, tmp_path)
    (axes,) = trade(result, "settling", "rise", -1.0).figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("share of settling", "share of rise")


@pytest.mark.drawn
def test_page_and_json_have_the_returned_gains_and_objective(tmp_path: Path) -> None:
    study = study_of("nonlinear", PAIR[:1], tmp_path, {})
    result, page, document = shown(study, 0.9 * study.requirements[0].limit, tmp_path)
    assert "51.23456" in page
    assert document["objective"] == {"before": result.before.objective, "returned": result.best.objective,
                                     "nearby": None}
    assert f"{numbers.number(result.best.objective)} returned" in objectives(result)
    assert f"{numbers.number(result.best.objective)} returned" in page


def test_figure_beside_a_limit_has_more_digits_only_if_it_would_look_equal() -> None:
    for value, limit in pairwise((35.0, 34.99961, 0.0, 1.2345678, float("inf"), 12345.6, -3.0)):
        assert numbers.beside(value, limit) == numbers.number(value) or numbers.number(value) == numbers.number(limit)
    assert numbers.beside(34.99961, 35.0) == "34.9996"
    assert numbers.beside(35.0, 35.0) == "35"
    assert [numbers.percent(share) for share in (0.0, -0.0, 0.1234, -0.0001, 2e-5, -0.74)] == [
        "0 %", "0 %", "12 %", "−0.01 %", "0.002 %", "−74 %"]


def test_command_returns_no_worse_gains(tmp_path: Path) -> None:
    study_of("nonlinear", LOOPS, tmp_path, {})
    figures, made = tmp_path / "t.json", tmp_path / "tuned.toml"
    result = CliRunner().invoke(app, ["tune", str(tmp_path / "study.toml"), "--generations", "1", "--workers", "1",
                                      "--json", str(figures), "--output", str(made), "--journal",
                                      str(tmp_path / "journal.jsonl")])
    assert result.exit_code in (0, 1), result.output
    objective = json.loads(figures.read_text(encoding="utf-8"))["objective"]
    assert objective["returned"] <= objective["before"]
    study = load_study(tmp_path / "study.toml", load_parameters())
    values = load_parameters(made).values
    (afresh,) = evaluate(study, [{t.name: float(values[t.name]) for t in study.tunables}])
    assert afresh.objective == objective["returned"]
    assert Journal(tmp_path / "journal.jsonl", study).find(afresh.gains) == afresh
    assert "returned" in result.output
