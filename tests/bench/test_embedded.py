"""References embedded in an FMU, read from handwritten files."""

from __future__ import annotations

from pathlib import Path

import pytest

from emcas_fmu.bench.references import embedded
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.references import EXPERIMENTS, FOLDER, MANIFEST

NAMES = {"fin_command": "fins.fin_command[1]", "fin_angle": "fins.fin_angle[1]", "motor.resistance": "fins.r[1]",
         "enable": "enable"}
EXPERIMENT = """<Experiments>
<Experiment name="{name}" description="A step" stepSize="0.001" stopTime="0.002">
<Parameters source="set%20one.ssv"/><Stimuli source="in.csv"/><References source="out.csv"/>
</Experiment></Experiments>"""
PARAMETERS = """<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 version="1.0" name="one"><ssv:Parameters>
<ssv:Parameter name="fins.r"><ssv:String value="0.1 0.2"/></ssv:Parameter>
<ssv:Parameter name="enable"><ssv:Boolean value="true"/></ssv:Parameter>
<ssv:Parameter name="other"><ssv:Real value="3.5"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>"""


def write_references(root: Path, name: str = "step", role: str = "validation", source: str = "e.xml") -> Path:
    """Write the embedded references of two fins below `root`, and return their folder."""
    folder = root / FOLDER
    folder.mkdir(parents=True)
    (folder / MANIFEST).write_text(
        f'<fmiLayeredStandardManifest><Related source="{source}" type="{EXPERIMENTS}" role="experiment/{role}"/>'
        f'<Related source="e.xml" type="text/plain" role="experiment/validation"/></fmiLayeredStandardManifest>')
    (folder / "e.xml").write_text(EXPERIMENT.format(name=name))
    (folder / "set one.ssv").write_text(PARAMETERS)
    (folder / "in.csv").write_text("time,fins.fin_command\n0,0 1\n0.001,0.5 1.5\n0.002,0.5 2\n")
    (folder / "out.csv").write_text("time,fins.fin_angle\n0,0 0\n0.001,7 8\n0.002,9 10\n")
    return folder


def test_values_of_the_named_fin_are_read(tmp_path: Path) -> None:
    write_references(tmp_path)
    (case,) = embedded(tmp_path, Path("EMCAS2.fmu"), NAMES, "nonlinear")
    assert (case.name, case.title, case.step, case.stop_time) == ("step", "A step", 1e-3, 2e-3)
    assert case.start_values == {"motor.resistance": 0.2, "enable": True}
    assert case.inputs["fin_command"].tolist() == [1.0, 1.5, 2.0]
    assert case.reference["fin_angle"].tolist() == [0.0, 8.0, 10.0]  # second elements
    assert case.reference["time"].tolist() == [0.0, 1e-3, 2e-3]
    assert (case.model, case.independent) == ("nonlinear", True)


@pytest.mark.parametrize(("role", "independent"), [("validation", True), ("smoke-test", False)])
def test_role_determines_whether_a_reference_is_independent(tmp_path: Path, role: str, independent: bool) -> None:
    write_references(tmp_path, role=role)
    (case,) = embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear")
    assert case.independent is independent


def test_missing_manifest_or_other_role_gives_no_references(tmp_path: Path) -> None:
    assert embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear") == ()
    write_references(tmp_path, role="other")
    assert embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear") == ()


def test_shipped_case_has_its_kind(tmp_path: Path) -> None:
    write_references(tmp_path, "chirp_1deg")
    (case,) = embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear")
    assert case.kind == "sweep"


@pytest.mark.parametrize(("file", "text"), [
    ("e.xml", "<Experiments"), ("out.csv", "time\n0\n"), ("in.csv", "a,b\n1,2\n"), ("set one.ssv", "no XML")])
def test_error_of_an_unreadable_file_names_the_remedy(tmp_path: Path, file: str, text: str) -> None:
    (write_references(tmp_path) / file).write_text(text)
    with pytest.raises(EmcasError, match=r"EMCAS\.fmu: the references inside cannot be read .* build it again"):
        embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear")


def test_source_outside_the_fmu_is_refused(tmp_path: Path) -> None:
    write_references(tmp_path, source="../../../../secret.xml")
    with pytest.raises(EmcasError, match="is outside the FMU"):
        embedded(tmp_path, Path("EMCAS.fmu"), NAMES, "nonlinear")
