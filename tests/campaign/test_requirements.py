"""Samples judged by requirements: the same figures whoever measures them, and the probability that each is met."""

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
from emcas_fmu.studies.campaign.study import Study, load_study
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
# A test of each kind, those of a supply and after use in a low supply; one that has no value.
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
# Half of the units clip their commands at 15 deg.
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
    """The file of a test of each kind."""
    path = tmp_path / "required.toml"
    path.write_text(REQUIRED, encoding="utf-8")
    return path


@pytest.fixture
def varied(write: Write, required: Path) -> Study:
    return load_study(write(VARIED), requirements=required)


def kept(study: Study, folder: Path, sizes: tuple[int, ...] = (9,)) -> str:
    """Rows of runs in this process, each of some samples, to the bit."""
    for size in sizes:
        with Store(folder, study) as store:
            in_process(study, store.missing()[:size], store.write, 2)
    with Store(folder, study) as store:
        assert not len(store.missing())
        return repr(store.table().to_pylist())


@pytest.mark.slow
def test_resumed_and_by_workers(varied: Study, tmp_path: Path, client: Any) -> None:
    rows = kept(varied, tmp_path / "alone")
    assert kept(varied, tmp_path / "resumed", (2, 3, 4)) == rows
    with Store(tmp_path / "workers", varied) as store:
        by_dask(client, varied, store.missing(), store.write, chunk=4)
        assert repr(store.table().to_pylist()) == rows


@settings(max_examples=3, deadline=None)
@given(st.permutations(range(6)), st.lists(st.integers(1, 5), max_size=2, unique=True))
def test_a_sample_alone(tmp_path_factory: pytest.TempPathFactory, order: list[int], cuts: list[int]) -> None:
    folder = tmp_path_factory.mktemp("alone")
    for name, text in (("varied", VARIED), ("required", REQUIRED)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "varied.toml", requirements=folder / "required.toml")
    plan, drawn = study, study.draw(range(6))
    drawn[2, 0] = -1.0  # refused
    subject = sample.subject_of(plan)
    alone = [sample.listed(sample.together(plan, [k], drawn[[k]], subject))[0] for k in range(6)]
    assert [row["status"] for row in alone].count("failed") == 1
    for part in np.split(np.array(order), sorted(cuts)):
        for row in sample.listed(sample.together(plan, part.tolist(), drawn[part], subject)):
            assert repr(row) == repr(alone[row["index"]])


def test_figures_are_those_of_validate(varied: Study, required: Path) -> None:
    """Each sample as a parameter set of its own: the share of its supply, and a case over what was drawn."""
    plan, drawn = varied, varied.draw([0, 1])
    drawn[:, 1] = 28.0, 39.0
    found = sample.listed(sample.rows(plan, [0, 1], drawn))
    cases = set()
    for row, values in zip(found, drawn, strict=True):
        parameters = load_parameters().with_values(dict(zip(
            ("motor.torque_constant", "drive.supply_voltage", "friction.temperature"), values[:3].tolist(),
            strict=True)))
        (figures,) = evaluate(ParameterSubject(parameters), load_requirements(required, parameters), [{}])
        for name in ("overshoot", "loaded_rate", "phase_margin", "bandwidth", "repeatable"):
            both = [f for f in figures if f.requirement.name == name]
            worst = max(both, key=lambda f: f.requirement.sign * f.measured)
            assert row[f"requirement.{name}"] == worst.measured
            cases.add(worst.case.name)
        assert np.isnan(row["requirement.never"])
    assert cases == {"nominal", "cold"}
    # At 70 % of 28 V the back-EMF takes what is left; by the shipped 39 V both would be as fast.
    slow, fast = (row["requirement.loaded_rate"] for row in found)
    assert slow < 0.9 * fast


@pytest.mark.slow
@pytest.mark.fmu
def test_an_fmu_gives_the_kernels_figures(write: Write, required: Path, native: Path) -> None:
    by_unit, by_kernel = (load_study(write(VARIED), fmu, requirements=required) for fmu in (native, None))
    assert_same_rows(by_unit, by_kernel, by_kernel.draw([0, 1]))


def test_half_of_the_samples_miss(write: Write, tmp_path: Path) -> None:
    """5 of 10: between 18.7 and 81.3 % in the tables of Clopper and Pearson; the other is met by all."""
    (tmp_path / "half.toml").write_text(HALF, encoding="utf-8")
    done = campaign(write(LIMITED), "--output", tmp_path / "out", "--workers", 0, "--requirements",
                    tmp_path / "half.toml")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    half, all_ = found["requirements"]["each"]
    assert (half["name"], half["met"], half["samples"], half["share"]) == ("range", 5, 10, 0.5)
    assert (half["low"], half["high"]) == pytest.approx((0.1871, 0.8129), abs=5e-5)  # to the digits of the tables
    assert (all_["met"], all_["high"]) == (10, 1.0)
    assert found["requirements"]["all"] == {key: half[key] for key in ("met", "samples", "share", "low", "high")}
    spread = next(f for f in found["figures"] if f["name"] == "requirement.range")
    assert spread["worst"][0]["value"] == pytest.approx(radians(15.0), abs=radians(0.05))  # an encoder's accuracy
    assert {e["factor"] for e in spread["sensitivities"]} == {"command.limit", "motor.resistance"}
    text = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    for shown in (done.output, text):
        assert "50.0 % (18.7 % … 81.3 %)" in shown
        assert "≥ 69.1 %" in shown
    assert "Requirements and the samples that meet them: the specification" in text
    assert "Range of the fin" in text
    assert f"--requirements {tmp_path / 'half.toml'}" in text


def test_a_percentage_of_a_case_is_of_the_sample(write: Write, tmp_path: Path) -> None:
    """Of a resistance that varies, 130 % is of each sample's, as it is of a unit that is built that way."""
    hot = '[cases.hot]\n"motor.resistance" = "130 %"\n"inertia.fin" = "0.05 kg*m^2"\n'
    (tmp_path / "hot.toml").write_text(hot + HALF, encoding="utf-8")
    specification = load_study(write(LIMITED), requirements=tmp_path / "hot.toml").specification
    values = {"motor.resistance": pytest.approx(1.3 * 0.2), "inertia.fin": 0.05, "command.limit": 0.3}
    assert specification.cases[0].of({"motor.resistance": 0.2, "inertia.fin": 0.02, "command.limit": 0.3}) == values
    nominal = load_parameters().values["motor.resistance"]
    assert specification.cases[0].of({})["motor.resistance"] == pytest.approx(1.3 * nominal)


def test_a_sample_that_failed_meets_nothing(write: Write, tmp_path: Path) -> None:
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


def test_sensitivities_leave_out_what_does_not_reach_it(varied: Study, tmp_path: Path) -> None:
    """The load of the experiments is no load of a requirement's test."""
    rows = sample.failed(varied, range(9), varied.draw(range(9)), [""] * 9)
    rows |= {"status": ["ok"] * 9, **dict.fromkeys(sample.columns(varied), np.arange(9.0))}
    rows = {name: [*column] * 2 for name, column in rows.items()} | {"index": np.arange(18)}
    with Store(tmp_path / "out", varied) as store:
        store.write(rows)
        found = summarise(varied, store.table())
    acting = {e.factor for e in found.by_name["requirement.overshoot"].effects}
    assert acting == {"motor.torque_constant", "drive.supply_voltage", "friction.temperature"}
    assert "inputs.aero_torque.value" in {e.factor for e in found.by_name["step.energy"].effects}


@pytest.mark.parametrize("n", [1, 24, 1000, 10**6])
def test_where_none_failed(n: int) -> None:
    """Of Clopper and Pearson then (alpha/2)^(1/n); to the last digits of a quantile of the beta distribution."""
    bound = 0.025 ** (1.0 / n)
    assert list(Chance(None, n, n).interval) == pytest.approx([bound, 1.0], rel=1e-12)
    assert list(Chance(None, 0, n).interval) == pytest.approx([0.0, 1.0 - bound], rel=1e-9)  # a small difference
    said = float(str(Chance(None, n, n)).split()[1]) / 100.0
    assert bound - 0.1 * (1.0 - bound) <= said <= bound


@pytest.mark.parametrize(("met", "n", "said"), [
    (24, 24, "≥ 85.7 %"), (1000, 1000, "≥ 99.63 %"), (0, 24, "≤ 14.3 %"),
    (999, 1000, "99.90 % (99.44 % … 99.9975 %)")])
def test_in_words(met: int, n: int, said: str) -> None:
    assert str(Chance(None, met, n)) == said


def test_other_requirements_are_another_campaign(write: Write, required: Path, tmp_path: Path) -> None:
    file = write(VARIED)
    Store(tmp_path / "out", load_study(file, requirements=required)).close()
    required.write_text(REQUIRED.replace('"the specification"', '"another edition"'), encoding="utf-8")
    Store(tmp_path / "out", load_study(file, requirements=required)).close()  # who says so decides nothing
    required.write_text(REQUIRED.replace('"10 Hz"', '"11 Hz"'), encoding="utf-8")
    with pytest.raises(CampaignError, match=r"requirements\.bandwidth\.minimum: 10\.0 then, 11\.0 now"):
        Store(tmp_path / "out", load_study(file, requirements=required))
    with pytest.raises(CampaignError, match=r"requirements\.\w+\.\w+: .* then, nothing now"):
        Store(tmp_path / "out", load_study(file))


def test_the_shipped_ones_and_what_an_actuator_has_not(write: Write) -> None:
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


def test_no_experiment_is_called_so(write: Write) -> None:
    with pytest.raises(CampaignError, match="must not be requirement"):
        load_study(write(VARIED.replace("[experiments.step]", "[experiments.requirement]")))
