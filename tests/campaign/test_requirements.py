"""Samples judged by requirements: figures as `emcas validate` measures them, and probabilities that they are met."""

from __future__ import annotations

import json
from math import inf, nan, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import evaluate
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign import sample
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.quantiles import Chance
from emcas_fmu.studies.campaign.run import by_dask, in_process
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study
from emcas_fmu.studies.campaign.summary import summarise

from .conftest import A_STEP, Write, assert_same_rows, campaign

VARIED = """
[campaign]
samples = 9
[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"
[vary."drive.supply_voltage"]
levels = ["28 V", "39 V"]
[vary."friction.temperature"]
distribution = "uniform"
low = "-6 degC"
high = "24 degC"
[inputs.aero_torque]
kind = "constant"
value = { distribution = "uniform", low = "-40 N.m", high = "0 N.m" }
""" + A_STEP
# Tests of every kind except `release`; one is at low supply voltage, and one never has a value.
REQUIRED = """
[cases.nominal]
[cases.cold]
"friction.temperature" = "-40 degC"
[[requirements]]
name = "overshoot"
test = { kind = "step", amplitude = "5 deg" }
figure = "overshoot"
maximum = "10 %"
source = "the specification"
[[requirements]]
name = "loaded_rate"
test = { kind = "slew", amplitude = "100 %", torque = "-100 N*m", supply = "70 %" }
figure = "sustained_rate"
minimum = "150 deg/s"
source = "the specification"
[[requirements]]
name = "load"
test = { kind = "load", torque = "100 N*m" }
figure = "time_to_accuracy"
maximum = "1 s"
[[requirements]]
name = "bandwidth"
test = { kind = "sine", amplitude = "1 deg" }
figure = "bandwidth_3db"
minimum = "10 Hz"
cases = ["nominal"]
[[requirements]]
name = "phase_margin"
test = { kind = "linear" }
figure = "phase_margin"
minimum = "30 deg"
[[requirements]]
name = "repeatable"
test = { kind = "repeat", amplitude = "100 %", torque = "400 N*m" }
figure = "repeat_error"
maximum = "0.2 deg"
cases = ["nominal"]
[[requirements]]
name = "never"
test = { kind = "step", amplitude = "5 deg", torque = "-5000 N*m" }
figure = "rise_time"
maximum = "1 s"
"""
NAMES = ("overshoot", "loaded_rate", "load", "bandwidth", "phase_margin", "repeatable", "never")
HALF = """
[[requirements]]
name = "range"
title = "Range of the fin"
test = { kind = "step", amplitude = "20 deg", duration = "1 s" }
figure = "held_angle"
minimum = "19.8 deg"
source = "the specification"
[[requirements]]
name = "rate"
test = { kind = "slew", amplitude = "10 deg" }
figure = "peak_rate"
minimum = "10 deg/s"
"""
# Half of the samples clip their commands at 15 deg.
LIMITED = """
[campaign]
method = "grid"
[vary."command.limit"]
levels = ["15 deg", "20 deg"]
[vary."motor.resistance"]
low = "0.2 Ohm"
high = "0.3 Ohm"
count = 5
""" + A_STEP


@pytest.fixture
def required(tmp_path: Path) -> Path:
    """The requirements file REQUIRED."""
    path = tmp_path / "required.toml"
    path.write_text(REQUIRED, encoding="utf-8")
    return path


@pytest.fixture
def varied(write: Write, required: Path) -> Campaign:
    return load_study(write(VARIED), requirements=required)


def rows_in_process(study: Campaign, folder: Path, sizes: tuple[int, ...] = (9,)) -> str:
    """Run the samples in this process, `sizes` of them per run, and return all rows as exact text."""
    for size in sizes:
        with Store(folder, study) as store:
            in_process(study, store.missing()[:size], store.write, 2)
    with Store(folder, study) as store:
        assert not len(store.missing())
        return repr(store.table().to_pylist())


@pytest.mark.slow
def test_resumed_runs_and_workers_give_the_same_rows(varied: Campaign, tmp_path: Path, client: Any) -> None:
    rows = rows_in_process(varied, tmp_path / "alone")
    assert rows_in_process(varied, tmp_path / "resumed", (2, 3, 4)) == rows
    with Store(tmp_path / "workers", varied) as store:
        by_dask(client, varied, store.missing(), store.write, chunk=4)
        assert repr(store.table().to_pylist()) == rows


@settings(max_examples=3, deadline=None)
@given(st.permutations(range(6)), st.lists(st.integers(1, 5), max_size=2, unique=True))
def test_row_does_not_depend_on_the_samples_computed_with_it(
        tmp_path_factory: pytest.TempPathFactory, order: list[int], cuts: list[int]) -> None:
    folder = tmp_path_factory.mktemp("alone")
    for name, text in (("varied", VARIED), ("required", REQUIRED)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "varied.toml", requirements=folder / "required.toml")
    drawn = study.draw(range(6))
    drawn[2, 0] = -1.0  # refused
    subject = sample.subject_of(study)
    alone = [sample.listed(sample.together(study, [k], drawn[[k]], subject))[0] for k in range(6)]
    assert [row["status"] for row in alone].count("failed") == 1
    for part in np.split(np.array(order), sorted(cuts)):
        for row in sample.listed(sample.together(study, part.tolist(), drawn[part], subject)):
            assert repr(row) == repr(alone[row["index"]])


def test_figures_equal_those_of_a_parameter_set_with_the_drawn_values(varied: Campaign, required: Path) -> None:
    """A low supply is relative to the drawn voltage, and cases apply to the drawn parameters."""
    study, drawn = varied, varied.draw([0, 1])
    drawn[:, 1] = 28.0, 39.0
    found = sample.listed(sample.rows(study, [0, 1], drawn))
    cases = set()
    for row, values in zip(found, drawn, strict=True):
        parameters = load_parameters().with_values(dict(zip(
            ("motor.torque_constant", "drive.supply_voltage", "friction.temperature"), values[:3].tolist(),
            strict=True)))
        (figures,) = evaluate(ParameterSubject(parameters), load_requirements(required, parameters), [{}])
        for name in ("overshoot", "loaded_rate", "phase_margin", "bandwidth", "repeatable"):
            cases_of_figure = [f for f in figures if f.requirement.name == name]
            worst = max(cases_of_figure, key=lambda f: f.requirement.sign * f.measured)
            assert row[f"requirement.{name}"] == worst.measured
            cases.add(worst.case.name)
        assert np.isnan(row["requirement.never"])
    assert cases == {"nominal", "cold"}
    # 70 % of 28 V leaves less voltage above the back-EMF. If both were relative to 39 V, the rates would be equal.
    slow, fast = (row["requirement.loaded_rate"] for row in found)
    assert slow < 0.9 * fast


@pytest.mark.slow
@pytest.mark.fmu
def test_fmu_gives_the_kernels_figures(write: Write, required: Path, native: Path) -> None:
    by_fmu, by_kernel = (load_study(write(VARIED), fmu, requirements=required) for fmu in (native, None))
    assert_same_rows(by_fmu, by_kernel, by_kernel.draw([0, 1]))


def test_probability_that_a_requirement_is_met(write: Write, tmp_path: Path) -> None:
    """5 of 10 samples meet one requirement: 18.7 to 81.3 % by Clopper and Pearson's tables. All meet the other."""
    (tmp_path / "half.toml").write_text(HALF, encoding="utf-8")
    result = campaign(write(LIMITED), "--output", tmp_path / "out", "--workers", 0, "--requirements",
                      tmp_path / "half.toml")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    half, all_ = summary["requirements"]["each"]
    assert (half["name"], half["met"], half["samples"], half["share"]) == ("range", 5, 10, 0.5)
    assert (half["low"], half["high"]) == pytest.approx((0.1871, 0.8129), abs=5e-5)  # digits of the tables
    assert (all_["met"], all_["high"]) == (10, 1.0)
    assert summary["requirements"]["all"] == {key: half[key] for key in ("met", "samples", "share", "low", "high")}
    spread = next(f for f in summary["figures"] if f["name"] == "requirement.range")
    assert spread["worst"][0]["value"] == pytest.approx(radians(15.0), abs=radians(0.05))  # the encoder's accuracy
    assert {e["factor"] for e in spread["sensitivities"]} == {"command.limit", "motor.resistance"}
    text = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    for shown in (result.output, text):
        assert "50.0 % (18.7 % … 81.3 %)" in shown
        assert "≥ 69.1 %" in shown
    assert "Requirements and the samples that meet them: the specification" in text
    assert "Range of the fin" in text
    assert f"--requirements {tmp_path / 'half.toml'}" in text


def test_percentage_in_a_case_is_relative_to_the_drawn_value(write: Write, tmp_path: Path) -> None:
    hot = '[cases.hot]\n"motor.resistance" = "130 %"\n"inertia.fin" = "0.05 kg*m^2"\n'
    (tmp_path / "hot.toml").write_text(hot + HALF, encoding="utf-8")
    specification = load_study(write(LIMITED), requirements=tmp_path / "hot.toml").specification
    values = {"motor.resistance": pytest.approx(1.3 * 0.2), "inertia.fin": 0.05, "command.limit": 0.3}
    assert specification.cases[0].of({"motor.resistance": 0.2, "inertia.fin": 0.02, "command.limit": 0.3}) == values
    nominal = load_parameters().values["motor.resistance"]
    assert specification.cases[0].of({})["motor.resistance"] == pytest.approx(1.3 * nominal)


def test_failed_sample_meets_no_requirement(write: Write, tmp_path: Path) -> None:
    (tmp_path / "half.toml").write_text(HALF, encoding="utf-8")
    study = load_study(write(LIMITED), requirements=tmp_path / "half.toml")
    drawn = study.draw(range(10))
    good = {**sample.failed(study, range(8), drawn[:8], [""] * 8), "status": ["ok"] * 8,
            **dict.fromkeys(sample.columns(study), np.ones(8)),
            "requirement.rate": np.array([1.0, 1.0, 1.0, 1.0, nan, inf, 0.0, radians(10.0)])}
    with Store(tmp_path / "out", study) as store:
        store.write(good)
        store.write(sample.failed(study, [8, 9], drawn[8:], ["odd"] * 2))
        found = summarise(study, store.table())
    assert [(c.met, c.samples) for c in found.chances] == [(8, 10), (5, 10), (5, 10)]


def test_inputs_of_experiments_have_no_sensitivity_on_requirements(varied: Campaign, tmp_path: Path) -> None:
    rows = sample.failed(varied, range(9), varied.draw(range(9)), [""] * 9)
    rows |= {"status": ["ok"] * 9, **dict.fromkeys(sample.columns(varied), np.arange(9.0))}
    rows = {name: [*column] * 2 for name, column in rows.items()} | {"index": np.arange(18)}
    with Store(tmp_path / "out", varied) as store:
        store.write(rows)
        found = summarise(varied, store.table())
    factors = {e.factor for e in found.by_name["requirement.overshoot"].effects}
    assert factors == {"motor.torque_constant", "drive.supply_voltage", "friction.temperature"}
    assert "inputs.aero_torque.value" in {e.factor for e in found.by_name["step.net_energy"].effects}


@pytest.mark.parametrize("n", [1, 24, 1000, 10**6])
def test_bound_if_all_or_none_of_the_samples_meet_a_requirement(n: int) -> None:
    """Clopper and Pearson's bound is then (alpha/2)^(1/n); SciPy's quantile of the beta distribution rounds."""
    bound = 0.025 ** (1.0 / n)
    assert list(Chance(None, n, n).interval) == pytest.approx([bound, 1.0], rel=1e-12)
    assert list(Chance(None, 0, n).interval) == pytest.approx([0.0, 1.0 - bound], rel=1e-9)  # a small difference
    shown = float(str(Chance(None, n, n)).split()[1]) / 100.0
    assert bound - 0.1 * (1.0 - bound) <= shown <= bound


@pytest.mark.parametrize(("met", "n", "text"), [
    (24, 24, "≥ 85.7 %"), (1000, 1000, "≥ 99.63 %"), (0, 24, "≤ 14.3 %"),
    (999, 1000, "99.90 % (99.44 % … 99.9975 %)")])
def test_probability_as_shown(met: int, n: int, text: str) -> None:
    assert str(Chance(None, met, n)) == text


def test_changed_requirement_is_another_campaign(write: Write, required: Path, tmp_path: Path) -> None:
    file = write(VARIED)
    Store(tmp_path / "out", load_study(file, requirements=required)).close()
    required.write_text(REQUIRED.replace('"the specification"', '"another edition"'), encoding="utf-8")
    Store(tmp_path / "out", load_study(file, requirements=required)).close()  # the source does not matter
    required.write_text(REQUIRED.replace('"10 Hz"', '"11 Hz"'), encoding="utf-8")
    with pytest.raises(CampaignError, match=r"requirements\.bandwidth\.minimum: 10\.0 then, 11\.0 now"):
        Store(tmp_path / "out", load_study(file, requirements=required))
    with pytest.raises(CampaignError, match=r"requirements\.\w+\.\w+: .* then, nothing now"):
        Store(tmp_path / "out", load_study(file))


def test_shipped_requirements_that_an_actuator_lacks_are_left_out(write: Write) -> None:
    study = load_study(write(VARIED), requirements="shipped")
    assert study.specification.file == "requirements.toml"
    assert not study.left_out
    simple = A_STEP + ('[base]\nmodel = "second-order"\n[vary."second_order.natural_frequency"]\n'
                       'distribution = "uniform"\nlow = "80 %"\nhigh = "120 %"\n')
    study = load_study(write(simple), requirements="shipped")
    left_out = {j.name: j.note for j in study.left_out}
    assert left_out["rest_current"] == "this actuator has no motor_current"
    assert "requirement.rest_current" not in sample.columns(study)
    assert "requirement.accuracy_20deg" in sample.columns(study)


def test_experiment_must_not_be_named_requirement(write: Write) -> None:
    with pytest.raises(CampaignError, match="must not be requirement"):
        load_study(write(VARIED.replace("[experiments.step]", "[experiments.requirement]")))
