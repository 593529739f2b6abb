"""A campaign of an FMU with several fins runs the chosen fin with its parameters."""

from __future__ import annotations

from pathlib import Path

import pytest

from emcas_fmu.bench.fmu_subject import FmuSubject
from emcas_fmu.studies.campaign import sample
from emcas_fmu.studies.campaign.store import identity
from emcas_fmu.studies.campaign.study import load_study

from .conftest import SMALL, Write, assert_same_rows, campaign, native_fmu, rows_of

pytestmark = pytest.mark.fmu


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of two fins, the second with a higher winding resistance; the parameter file is in the same folder."""
    folder = tmp_path_factory.mktemp("pair")
    (folder / "worn.toml").write_text('[motor]\nresistance = "0.4 Ohm"\n', encoding="utf-8")
    return native_fmu("nonlinear", folder, fins=2, files={2: folder / "worn.toml"})


def test_fin_has_the_figures_of_its_parameters(write: Write, pair: Path) -> None:
    """On a stiff bus the fins do not interact: each agrees with a single actuator, as an FMU of one fin does."""
    file = write(SMALL)
    by_fin = {fin: load_study(file, pair, fin) for fin in (None, 1, 2)}
    assert by_fin[None] == by_fin[1]
    assert identity(by_fin[1]) != identity(by_fin[2])
    alone = {1: load_study(file), 2: load_study(write(f'[base]\nparameters = "{pair.parent / "worn.toml"}"\n{SMALL}'))}
    drawn = alone[1].draw([0])
    for fin, study in alone.items():
        assert_same_rows(by_fin[fin], study, drawn)
        subject = sample.subject_of(by_fin[fin])
        assert isinstance(subject, FmuSubject)
        assert subject.fmu.names["fin_command"] == f"fin[{fin}].fin_command"
    sound, worn = (rows_of(study, [0], drawn)[0] for study in alone.values())
    assert worn["step.net_energy"] > 1.1 * sound["step.net_energy"]


def test_campaign_file_may_choose_the_fin(write: Write, pair: Path) -> None:
    file = write(f'[base]\nfmu = "{pair}"\nfin = 2\n{SMALL}')
    assert load_study(file).base["motor.resistance"] == 0.4
    assert load_study(file, fin=1).base["motor.resistance"] != 0.4


def test_missing_fin_is_refused(write: Write, pair: Path, tmp_path: Path) -> None:
    for fin, message in ((3, "has 2 fins, there is no fin 3"), (0, "--fin")):
        result = campaign(write(SMALL), "--fmu", pair, "--fin", fin, "--output", tmp_path / "out")
        assert result.exit_code == 2
        assert message in " ".join(result.stderr.split())
        assert not (tmp_path / "out").exists()


def test_page_names_the_fin(write: Write, pair: Path, tmp_path: Path) -> None:
    few = write(SMALL.replace("samples = 24", "samples = 2"))
    result = campaign(few, "--fmu", pair, "--fin", 2, "--output", tmp_path / "out", "--workers", 0)
    assert result.exit_code == 0, result.output
    page = (tmp_path / "out" / "summary.html").read_text(encoding="utf-8")
    assert "--fin 2" in page
    assert "the FMU, fin 2" in page
