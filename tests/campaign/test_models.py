"""Campaigns of actuators with extensions: their variables, FMUs and stores, and the detection of faults."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isnan, radians
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions import fault_list
from emcas_fmu.motions import LEAD_IN
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import library
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.campaign import extension_outputs, sample
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.experiments import excitation
from emcas_fmu.studies.campaign.store import Store, identity
from emcas_fmu.studies.campaign.study import Campaign, load_study
from emcas_fmu.support.files import models_directory

from .conftest import A_STEP, SMALL, Write, assert_same_rows, campaign, native_fmu, rows_of

FAULTS = """
[campaign]
samples = 6
[base]
model = "nonlinear+faults"
[vary."fault.jam.begin"]
distribution = "uniform"
low = "0.1 s"
high = "0.2 s"
[vary."fault.jam.end"]
levels = ["0 s", "1000 s"]
[experiments.fly]
kind = "sine"
amplitude = "10 deg"
frequency = "2 Hz"
duration = "1 s"
"""
HOMED = """
[campaign]
samples = 2
[base]
model = "nonlinear+homing"
[vary."fin.start_angle"]
distribution = "uniform"
low = "-5 deg"
high = "5 deg"
[inputs.home]
kind = "step"
before = false
after = true
at = "20 ms"
[inputs.aero_torque]
kind = "spring"
stiffness = "50 N.m/rad"
[experiments.home]
kind = "hold"
amplitude = "2 deg"
duration = "0.3 s"
"""


@pytest.fixture(scope="module")
def faults_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of the default actuator with faults."""
    return native_fmu("nonlinear+faults", tmp_path_factory.mktemp("faults"))


def test_campaign_without_a_model_adds_nothing_to_identity_or_rows(small: Campaign) -> None:
    """Older stores of such a campaign can be continued."""
    assert small.model == "nonlinear"
    assert "model" not in identity(small)
    assert extension_outputs.observed(small) == {}
    assert sample.subject_of(small).model == "nonlinear"


def test_fault_is_recorded_in_words_status_and_time(write: Write) -> None:
    """The row agrees with the outputs of a direct simulation."""
    study = load_study(write(FAULTS))
    jammed, sound = rows_of(study, [0, 1], np.array([[0.15, 1000.0], [0.15, 0.0]]))
    angle = radians(10.0)
    values = load_parameters(model="nonlinear+faults").with_values(
        {"fault.jam.begin": 0.15, "fault.jam.end": 1000.0}).values
    direct = simulate(values, LEAD_IN + 1.0, model="nonlinear+faults",
                      fin_command=lambda t: angle * np.sin(4.0 * np.pi * max(t - LEAD_IN, 0.0)))
    first = np.argmax(direct["built_in_test"] > 0.0)
    assert jammed["fly.fault_word_first"] == pytest.approx(0.15 - LEAD_IN, abs=1.01e-3)
    assert jammed["fly.built_in_test_first"] == pytest.approx(direct["time"][first] - LEAD_IN, abs=1e-9)
    assert jammed["fly.fault_word_ever"] == jammed["fly.fault_word_final"] == 1
    ever = np.bitwise_or.reduce(direct["built_in_test"].astype(int))
    assert jammed["fly.built_in_test_ever"] == ever != 0
    assert "tracking" in extension_outputs.observed(study)["fly.built_in_test_ever"].flags(int(ever))
    assert jammed["fly.status_final"] == "failed"
    assert (sound["fly.fault_word_ever"], sound["fly.built_in_test_ever"]) == (0, 0)
    assert isnan(sound["fly.fault_word_first"])
    assert sound["fly.status_final"] == "operational"


@pytest.mark.parametrize("compiled", [True, False])
def test_input_and_flag_of_an_extension(write: Write, monkeypatch: pytest.MonkeyPatch, compiled: bool) -> None:
    """With a spring and in both kernels, the input `home` starts the search, and `homed` is not set before."""
    if not compiled:
        monkeypatch.setattr(library, "available", lambda *_: False)
    study = load_study(write(HOMED))
    (row,) = rows_of(study, [0], np.array([[0.02]]))
    assert (row["status"], row["error"]) == ("ok", "")
    assert (row["home.status_final"], row["home.homed_final"], row["home.homed_share"]) == ("homing", False, 0.0)
    made = excitation(study.experiments[0], study.base, study.numbers, study.model)
    status = sample.subject_of(study).run(made).columns["status"]
    assert status[np.searchsorted(made.time, LEAD_IN + 0.015)] == 2.0  # unreferenced
    assert status[np.searchsorted(made.time, LEAD_IN + 0.03)] == 3.0


def test_history_is_the_run_of_the_same_row(write: Write) -> None:
    """Also if a factor has its base value: with `homing.required` true the actuator does not move before homing."""
    study = load_study(write("""
        [campaign]
        method = "grid"
        [base]
        model = "nonlinear+homing"
        [vary."homing.required"]
        levels = [true, false]
        """ + A_STEP))
    rows = rows_of(study, [0, 1], study.draw([0, 1]))
    for index, required in ((0, True), (1, False)):
        response = sample.history(study, study.experiments[0], index)
        assert response.sets[0].values["homing.required"] is required
        assert bool(np.any(response.columns["fin_angle"])) is not required
        assert isnan(rows[index]["step.rise_time"]) is required


def test_real_outputs_of_an_extension_have_smallest_last_and_largest_value(write: Write) -> None:
    text = FAULTS.replace("nonlinear+faults", "nonlinear+heat")
    text = text.replace("fault.jam.begin", "heat.case_start_rise").replace("0.1 s", "0 K").replace("0.2 s", "60 K")
    head, rest = text.split('[vary."fault.jam.end"]')
    study = load_study(write(head + rest[rest.index("[experiments"):]))
    cold, warm = rows_of(study, [0, 1], np.array([[0.0], [60.0]]))
    rise = warm["fly.case_temperature_final"] - cold["fly.case_temperature_final"]
    assert rise == pytest.approx(60.0, abs=1.0)  # the case loses a part of it to the winding
    for row in (cold, warm):
        low, last, high = (row[f"fly.winding_temperature_{end}"] for end in ("smallest", "final", "largest"))
        assert low <= last <= high
    assert sample.columns(study)["fly.winding_temperature_final"].unit == "degC"


def test_another_model_is_another_campaign(write: Write, tmp_path: Path) -> None:
    study = load_study(write(FAULTS))
    with Store(tmp_path / "out", study) as store:
        store.write(sample.rows(study, [0, 1], study.draw([0, 1])))
        schema = store.table().schema
    assert schema.field("fly.status_final").type == pa.string()
    assert schema.field("fly.fault_word_ever").type == pa.int64()
    other = load_study(write(FAULTS), model="elastic+faults")
    assert other.guid != study.guid
    with pytest.raises(CampaignError, match=r"model: 'nonlinear\+faults' then, 'elastic\+faults' now"):
        Store(tmp_path / "out", other)
    with Store(tmp_path / "out", load_study(write(FAULTS))) as again:  # the same model continues
        assert again.missing().tolist() == [2, 3, 4, 5]


def test_failed_sample_has_no_words_and_no_status(write: Write, tmp_path: Path) -> None:
    study = load_study(write(FAULTS))
    rows = sample.rows(study, [0], np.array([[-1.0, 0.0]]))
    (row,) = sample.listed(rows)
    assert row["status"] == "failed"
    assert "fault.jam.begin = -1 is below its minimum" in row["error"]
    assert row["fly.status_final"] is row["fly.fault_word_ever"] is None
    with Store(tmp_path / "out", study) as store:
        store.write(rows)
        assert store.table().num_rows == 1


@pytest.mark.fmu
def test_fmu_contains_its_model(write: Write, faults_fmu: Path) -> None:
    """Its file name does not name the model. Figures, words and status equal those of the kernel."""
    plain = FAULTS.replace('[base]\nmodel = "nonlinear+faults"\n', "")
    by_fmu, by_model = load_study(write(plain), faults_fmu), load_study(write(FAULTS))
    assert by_fmu.model == "nonlinear+faults"
    assert by_fmu.guid == by_model.guid
    assert_same_rows(by_fmu, by_model, [[0.15, 1000.0], [0.12, 0.0]])
    with pytest.raises(EmcasError, match=r"its model is nonlinear\+faults, but nonlinear\+heat is requested"):
        load_study(write(plain), faults_fmu, model="nonlinear+heat")


@pytest.mark.fmu
def test_fmu_without_its_model_needs_an_option(write: Write, faults_fmu: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emcas_fmu.bench.fmu.model_of", lambda name: None)
    plain = FAULTS.replace('[base]\nmodel = "nonlinear+faults"\n', "")
    with pytest.raises(EmcasError, match=r"does not contain its model; pass the model with which the FMU was built"):
        load_study(write(plain), faults_fmu)
    assert load_study(write(FAULTS), faults_fmu).model == "nonlinear+faults"


@pytest.mark.parametrize(("text", "message"), [
    (SMALL + '[vary."fault.jam.begin"]\ndistribution = "uniform"\nlow = "0 s"\nhigh = "1 s"\n',
     "'fault.jam.begin' of the nonlinear model; nonlinear+faults has one"),
    (SMALL + '[inputs.home]\nkind = "constant"\nvalue = true\n', "'home' of the nonlinear model; nonlinear+homing has"),
    ('[base]\nmodel = "nonlinear+fault"\n' + SMALL, "base.model = nonlinear+fault: there is no extension 'fault'; did"),
    ('[base]\nmodel = "linear+lugre"\n' + SMALL, "base.model = linear+lugre"),
    ('[base]\nmodel = 3\n' + SMALL, "base.model = 3: must be a string"),
])
def test_error_names_the_entry_and_the_remedy(write: Write, text: str, message: str) -> None:
    with pytest.raises(CampaignError) as caught:
        load_study(write(text))
    assert message in str(caught.value)


def row(faults: int, monitors: int, begin: float, first: float) -> Mapping[str, Any]:
    """Return the outputs for a sample's fault word, built-in test word and their first times [s]."""
    return {"fly.fault_word_ever": faults, "fly.built_in_test_ever": monitors, "fly.fault_word_first": begin,
            "fly.built_in_test_first": first, "fly.fault_word_final": faults, "fly.built_in_test_final": monitors,
            "fly.status_final": "failed" if monitors else "operational"}


def test_findings_of_rows_with_known_results(write: Write) -> None:
    never = float("nan")
    table = pa.Table.from_pylist([
        row(0, 0, never, never), row(0, 2, never, 0.4),  # a false alarm
        row(1, 3, 0.2, 0.5), row(1, 1, 0.3, 0.4), row(1, 0, 0.3, never),
        row(1, 1, 0.3, 0.1),  # detected before the fault
        row(5, 8, 0.1, 0.9)])
    study = load_study(write(FAULTS))
    none, jam, several = extension_outputs.findings(study, table)
    assert (none.fault, none.samples, none.found) == (extension_outputs.NONE, 2, 1)
    assert (jam.fault, jam.samples, jam.found, jam.before) == ("jam", 4, 2, 1)
    assert (jam.delay, jam.longest) == pytest.approx((0.2, 0.3))
    assert (jam.monitors["tracking"], jam.monitors["stall"]) == (3, 1)
    assert (several.fault, several.samples, several.found) == (extension_outputs.SEVERAL, 1, 1)
    counts = extension_outputs.tallies(study, table)
    assert counts["fly.status_final"] == {"failed": 5, "operational": 2}
    assert counts["fly.fault_word_ever"] == {"jam": 5, "none": 2, "hard_over": 1}
    assert [*extension_outputs.findings(load_study(write(SMALL)), table)] == []
    second_order = load_study(write(FAULTS), model="second-order+faults")  # has neither motor nor bus to monitor
    found = extension_outputs.findings(second_order, table)
    assert [list(f.monitors) for f in found] == [["tracking", "command"]] * 3


def test_findings_name_a_fault_of_a_users_actuator(write: Write) -> None:
    bit = 2 ** len(fault_list.FAULTS)
    table = pa.Table.from_pylist([row(bit, 1, 0.2, 0.5), row(bit, 0, 0.3, float("nan"))])
    direct = Path(__file__).parents[2] / "examples" / "own_actuator" / "direct_drive.py"
    study = load_study(write(FAULTS), model=f"{direct}+faults")
    (found,) = extension_outputs.findings(study, table)
    assert (found.fault, found.samples, found.found) == ("demagnetised", 2, 1)
    assert found.delay == pytest.approx(0.3)
    assert extension_outputs.tallies(study, table)["fly.fault_word_ever"] == {"demagnetised": 2}


@pytest.mark.slow
@pytest.mark.drawn
def test_shipped_campaign_of_faults(tmp_path: Path) -> None:
    """Page, JSON and terminal show the findings; the page's command contains --model."""
    text = (models_directory() / "campaign_faults.toml").read_text(encoding="utf-8")
    file, folder = tmp_path / "few.toml", tmp_path / "out"
    file.write_text(text.replace("samples = 2000", "samples = 30"), encoding="utf-8")
    result = campaign(file, "--output", folder, "--workers", 0, "--model", "nonlinear+heat+faults")
    assert result.exit_code == 0, result.output
    assert "their detection by the built-in test" in result.output
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["model"] == "nonlinear+heat+faults"
    assert sum(f["samples"] for f in summary["findings"]) == 30
    assert {t["name"] for t in summary["tallies"]} >= {"fly.status_final", "fly.built_in_test_ever"}
    assert "512 (encoder_reversed)" in campaign(file, "--only", 3).output
    page = (folder / "summary.html").read_text(encoding="utf-8")
    assert "Faults, and their detection by the built-in test" in page
    assert "--model nonlinear+heat+faults" in page
