"""Tools with a user's actuator: their texts and figures are about this actuator."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import fin_port, get
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.fault_list import FAULTS
from emcas_fmu.extensions.status import STATUS
from emcas_fmu.fmi.pictures import response_pictures
from emcas_fmu.pages import provenance
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.studies.compare.sets import load_sets
from emcas_fmu.studies.overview import in_words, offered, remaining_estimates
from emcas_fmu.studies.tuning.study import shipped_study
from tests import studies

from .example import FOLDER, MODEL, changed

HOT_GAS = str(FOLDER / "hot_gas.py")
REQUIREMENTS = """
[[requirements]]
name = "rise"
test = { kind = "step", amplitude = "2 deg", duration = "0.3 s" }
figure = "rise_time"
maximum = "10 s"
"""


def emcas(*arguments: object) -> str:
    """Return the output of a command, which must end with exit code 0."""
    done = CliRunner().invoke(app, list(map(str, arguments)))
    assert done.exit_code == 0, done.output + done.stderr
    return done.output


def test_files_and_installed_actuators_are_compared(installed: Path, tmp_path: Path) -> None:
    path, figures = tmp_path / "mine.toml", tmp_path / "c.json"
    path.write_text(REQUIREMENTS, encoding="utf-8")
    emcas("compare", MODEL, f"{HOT_GAS}+faults", "direct", "nonlinear", "--requirements", path, "--json", figures)
    sets = json.loads(figures.read_text(encoding="utf-8"))["sets"]
    assert [each["model"] for each in sets] == ["direct-drive", "hot-gas+faults", "direct-drive", "nonlinear"]
    rises = [each["requirements"][0]["measured"] for each in sets]
    assert rises[0] == rises[2] < rises[1]


def test_descriptions_of_a_gas_actuator_mention_no_motor_drive() -> None:
    """The general description of `enable` fits every actuator."""
    described = {v.name: v.description for a in (get(f"{HOT_GAS}+faults"),) for v in (*a.inputs, *a.parameters)}
    described |= dict(STATUS.items) | {f.name: f.description for f in FAULTS if f.name in ("drive_loss", "brown_out")}
    assert described["enable"].startswith("false: the spool is centred")
    assert [text for text in described.values() if re.search("bridge|drive's", text)] == []
    assert "drive" not in fin_port.ENABLE.description


@pytest.mark.parametrize(("model", "count"), [(MODEL, 1), ("second-order", 1), ("nonlinear", 4)])
def test_variants_of_the_current_loop_are_compared_only_for_actuators_with_one(model: str, count: int) -> None:
    assert len(load_sets((), model)) == count


def test_a_user_s_estimate_is_not_called_shipped() -> None:
    values = load_parameters(model=f"{HOT_GAS}+faults")
    words, estimates = in_words(values, remaining_estimates(values)), remaining_estimates(values)
    shipped = {name for each in estimates if each.shipped for name in each.names}
    assert {"valve.clearance", "monitor.minimum_pressure", "gas_supply.pressure"}.isdisjoint(shipped)
    assert {"fin.stop_angle", "monitor.persistence"} <= shipped  # declared by the port and an extension
    count = sum(len(each.names) for each in estimates)
    assert words == (f"estimates: {count} of {len(values.entries)} values, {count - len(shipped)} of your actuator and "
                     f"{len(shipped)} shipped")


def test_emcas_parameters_does_not_call_a_user_s_estimate_shipped(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("spring.stiffness = '25 N*m/rad'\n", encoding="utf-8")
    said = emcas("parameters", "--model", MODEL, "-p", path)
    assert "Still estimates: " in said
    records = {r["name"]: r for r in json.loads(emcas("parameters", "--model", MODEL, "--json"))}
    assert [(records[name]["remaining_estimate"], records[name]["shipped_estimate"])
            for name in ("spring.stiffness", "fin.stop_angle")] == [(True, False), (True, True)]
    assert "shipped" not in emcas("parameters", "--model", MODEL, "--sensitivity", "0")


def test_an_installed_actuator_has_values_to_fill_in(installed: Path, tmp_path: Path) -> None:
    """Its declaration names no file."""
    base = load_parameters(model="direct")
    assert offered(base).keys() == offered(load_parameters(model=MODEL)).keys()
    assert not any(each.shipped for each in remaining_estimates(base) if "spring.stiffness" in each.names)
    emcas("init", tmp_path / "new", "--model", "direct")
    text = (tmp_path / "new" / "actuator.toml").read_text(encoding="utf-8")
    assert "#stiffness" in text
    assert "shipped" not in text


def test_a_missing_value_of_a_fault_names_the_user_s_file(tmp_path: Path) -> None:
    path = changed(tmp_path, ('    "fault.demagnetised.share": 0.6,\n', ""))
    with pytest.raises(ParameterError, match=re.escape(f"{path}: fault.demagnetised.share: missing")):
        load_parameters(model=f"{path}+faults")


def test_the_page_of_an_fmu_may_have_a_current_without_a_voltage() -> None:
    strain_wave = load_parameters(model=str(FOLDER / "strain_wave.py"))
    _, slew = response_pictures(strain_wave)
    assert "current [A]" in slew.svg
    assert "voltage [V]" not in slew.svg


def test_validate_lists_only_outputs_of_the_reference(tmp_path: Path) -> None:
    """The reference of the example has no motor voltage; without one, a note says how to make it."""
    emcas("reference", "--model", MODEL, "--directory", tmp_path, "--case", "step_plus1")
    said = emcas("validate", "--model", MODEL, "--directory", tmp_path, "--case", "step_plus1")
    assert "current [A]" in said
    assert "voltage [V]" not in said
    without = " ".join(emcas("validate", "--model", MODEL, "--case", "step_plus1").split())
    assert "`emcas reference` with this --model writes references for --directory" in without


@pytest.mark.parametrize(("model", "words"), [
    ("direct", "the parameters of direct-drive"), (MODEL, "the parameters of direct_drive.py"),
    ("elastic+heat", "the shipped parameters")])
def test_pages_name_the_owner_of_the_parameters(installed: Path, model: str, words: str) -> None:
    assert provenance.shipped(model) == words


def test_tools_of_the_nonlinear_actuator_refuse_other_parameters(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("spring.stiffness = '25 N*m/rad'\ngas.exponent = 1.3\n", encoding="utf-8")
    record = tmp_path / "a.csv"
    record.write_text("time\n0\n", encoding="utf-8")
    for command, words in ((["fit"], "emcas fit"), (["identify", "drive", str(record)], "emcas identify drive")):
        done = CliRunner().invoke(app, [*command, "-p", str(path)])
        assert done.exit_code == 2
        assert (f"{words} needs the parameters of the nonlinear actuator, which has no spring.stiffness, gas.exponent"
                in " ".join(done.stderr.split()))


def test_error_asks_for_a_study_with_the_actuator_s_parameters() -> None:
    with pytest.raises(EmcasError, match=r"study for this actuator's parameters .*: controller\.kp, controller"):
        shipped_study(load_parameters(model=MODEL))


def test_pages_have_no_empty_tables(tmp_path: Path) -> None:
    """One set has no differences, and two samples have no sensitivities."""
    requirements, page = tmp_path / "mine.toml", tmp_path / "page.html"
    requirements.write_text(REQUIREMENTS, encoding="utf-8")
    emcas("compare", MODEL, "--requirements", requirements, "--report", page)
    assert "<td>none</td>" not in page.read_text(encoding="utf-8")
    study = tmp_path / "study.toml"
    study.write_text(studies.campaign("controller.kp"), encoding="utf-8")
    emcas("campaign", study, "--model", MODEL, "-o", tmp_path / "c", "--workers", "0", "--report", page)
    text = page.read_text(encoding="utf-8")
    assert "<p>There are none: there are too few samples" in text
    assert "<td>none</td>" not in text
