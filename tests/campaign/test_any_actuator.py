"""Campaigns of a user's actuator, and of an actuator without motor and supply, by kernel, FMU and Dask workers."""

from __future__ import annotations

import json
import shutil
from math import isnan, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.metrics import figures_of
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import LEAD_IN, STEP
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign import experiments, sample
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.experiments import excitation
from emcas_fmu.studies.campaign.run import by_dask, in_process
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import load_study

from .conftest import A_STEP, Write, assert_same_rows, campaign, native_fmu, rows_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_actuator"
DIRECT = A_STEP + """
[campaign]
samples = 12
[base]
model = "direct_drive.py"
[vary."spring.stiffness"]
distribution = "uniform"
low = "50 %"
high = "150 %"
[inputs.aero_torque]
kind = "constant"
value = { distribution = "uniform", low = "-5 N.m", high = "5 N.m" }
[experiments.pulled]
kind = "sine"
amplitude = "5 deg"
frequency = "3 Hz"
duration = "0.3 s"
[experiments.pulled.inputs.aero_torque]
kind = "spring"
stiffness = "20 N.m/rad"
"""
SECOND_ORDER = A_STEP + """
[campaign]
samples = 12
[base]
model = "second-order"
[vary."second_order.natural_frequency"]
distribution = "uniform"
low = "80 %"
high = "120 %"
[experiments.sweep]
kind = "chirp"
amplitude = "1 deg"
low = "1 Hz"
high = "30 Hz"
duration = "3 s"
"""
POWER = ["peak_power", "peak_returned_power", "mean_power", "rms_power", "net_energy", "energy_drawn",
         "energy_returned"]
CURRENT = ["current_ripple", "peak_current", "rms_current"]


@pytest.fixture
def direct(write: Write, tmp_path: Path) -> Path:
    """A campaign file that names the user's actuator by a path relative to itself."""
    shutil.copy(EXAMPLE / "direct_drive.py", tmp_path)
    return write(DIRECT)


def assert_fmu_gives_kernel_rows(file: Path, fmu: Path) -> None:
    by_kernel, by_fmu = load_study(file), load_study(file, fmu)
    assert by_fmu.guid == by_kernel.guid
    assert_same_rows(by_fmu, by_kernel, by_kernel.draw([0, 1]))


def test_users_actuator_runs_with_the_drawn_stiffness_and_load(direct: Path) -> None:
    """A stiffer spring needs more energy. The peak current equals that of a direct simulation."""
    study = load_study(direct)
    assert {name for name in sample.columns(study) if name.startswith("pulled.")} == {
        f"pulled.{name}" for name in figures_of("usage")}
    soft, stiff, loaded = rows_of(study, [0, 1, 2], np.array([[10.0, 0.0], [30.0, 0.0], [10.0, -4.0]]))
    assert {row["status"] for row in (soft, stiff, loaded)} == {"ok"}
    assert stiff["step.net_energy"] > soft["step.net_energy"]
    assert not any(isnan(row[name]) for row in (soft, stiff, loaded) for name in sample.columns(study))
    columns = ParameterSubject(load_parameters(model=study.model)).run(
        excitation(study.experiments[0], study.base, {**study.numbers, "inputs.aero_torque.value": -4.0}, study.model),
        {"spring.stiffness": 10.0}).columns
    assert loaded["step.peak_current"] == pytest.approx(
        np.abs(columns["motor_current"][round(LEAD_IN / STEP):]).max(), rel=1e-6)


def test_energy_of_an_actuator_without_delay_agrees_with_finer_rows(direct: Path) -> None:
    """The rows of 20 us are themselves off by about a third of the tolerance of 1.2 %."""
    study = load_study(direct)
    (row,) = rows_of(study, [0], np.array([[20.0, 0.0]]))
    made = excitation(study.experiments[0], study.base, {**study.numbers, "inputs.aero_torque.value": 0.0}, study.model)
    fine = sample.subject_of(study).run(made, {"spring.stiffness": 20.0}, substeps=50, fine=[experiments.POWER]).columns
    power = fine[experiments.POWER][round(LEAD_IN / STEP) * 50:]
    assert row["step.net_energy"] == pytest.approx(np.trapezoid(power, dx=STEP / 50), rel=0.012)
    assert row["step.rms_power"] == pytest.approx(np.sqrt(np.mean(power**2)), rel=0.012)


@pytest.mark.slow
def test_workers_import_a_users_file(direct: Path, tmp_path: Path, client: Any) -> None:
    study = load_study(direct)
    with Store(tmp_path / "there", study) as there, Store(tmp_path / "here", study) as here:
        by_dask(client, study, there.missing(), there.write, chunk=3)
        in_process(study, here.missing(), here.write)
        assert repr(there.table().to_pylist()) == repr(here.table().to_pylist())


def test_changed_users_file_is_another_campaign(direct: Path, tmp_path: Path) -> None:
    study = load_study(direct)
    Store(tmp_path / "out", study).close()
    declaration = tmp_path / "direct_drive.py"
    declaration.write_text(declaration.read_text(encoding="utf-8") + "# changed\n", encoding="utf-8")
    with pytest.raises(CampaignError, match="model_sha256"):
        Store(tmp_path / "out", load_study(direct))
    sample._opened.cache_clear()
    with pytest.raises(CampaignError, match=r"direct_drive\.py: is not the file with which the campaign began"):
        rows_of(study, [0], np.array([[20.0, 0.0]]))


@pytest.mark.slow
def test_command_runs_a_users_file(direct: Path, write: Write, tmp_path: Path) -> None:
    file = write(DIRECT.replace('[base]\nmodel = "direct_drive.py"\n', ""))
    result = campaign(file, "--output", tmp_path / "out", "--workers", 0, "--model", tmp_path / "direct_drive.py")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["model"], summary["left_out"], summary["done"]) == ("direct-drive", {}, 12)
    page = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    assert "model direct-drive" in page
    assert "left out" not in page


@pytest.mark.fmu
def test_fmu_of_a_users_actuator_gives_the_kernels_rows(direct: Path, tmp_path: Path) -> None:
    model = str(tmp_path / "direct_drive.py")
    fmu = native_fmu(model, tmp_path)
    assert_fmu_gives_kernel_rows(direct, fmu)
    direct.write_text(DIRECT.replace('[base]\nmodel = "direct_drive.py"\n', ""), encoding="utf-8")
    with pytest.raises(EmcasError, match="does not contain its model; pass the model with which the FMU was built"):
        load_study(direct, fmu)
    assert load_study(direct, fmu, model=model).actuator.name == "direct-drive"


@pytest.mark.slow
def test_actuator_without_motor_and_supply_has_no_figures_of_power_and_current(write: Write, tmp_path: Path) -> None:
    study = load_study(write(SECOND_ORDER))
    assert not {name.partition(".")[2] for name in sample.columns(study)} & {*POWER, *CURRENT}
    slow, quick = rows_of(study, [0, 1], np.array([[60.0], [120.0]]))
    # The -90 deg frequency of a second-order system is its natural frequency; hold and delay lower it.
    assert quick["sweep.bandwidth_90deg"] > 1.3 * slow["sweep.bandwidth_90deg"]
    assert slow["step.rise_time"] > 1.3 * quick["step.rise_time"]
    assert 0.0 < slow["step.peak_rate"] < radians(1000.0)
    result = campaign(tmp_path / "small.toml", "--output", tmp_path / "out", "--workers", 0)
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["left_out"] == {"this actuator has no supply_power": POWER,
                                   "this actuator has no motor_current": CURRENT}
    page = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    assert f"{', '.join(POWER)}: left out (this actuator has no supply_power)." in page


@pytest.mark.fmu
def test_fmu_without_motor_and_supply_gives_the_kernels_rows(write: Write, tmp_path: Path) -> None:
    assert_fmu_gives_kernel_rows(write(SECOND_ORDER), native_fmu("second-order", tmp_path))
