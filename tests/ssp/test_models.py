"""Archives of a model with options: own variables, enumerations, variants of faults, and what each host makes of it."""

from __future__ import annotations

import subprocess
import sys
from math import radians
from pathlib import Path
from typing import Any

import pytest

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.ssp.archive import SSC, SSD, SspError, parse, read_archive, write_archive
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.structure import read_variant
from emcas_fmu.ssp.variants import variant_files
from emcas_fmu.ssp.write import write_ssp
from examples.ssp_hosts import hosts
from tests.fmu.built import lean
from tests.hosts.host import difference
from tests.marks import others_slow

from .conftest import emcas, valid_documents
from .test_hosts import OTHERS, ROOT, SAME, printed, run

pytestmark = pytest.mark.fmu
MODEL = "nonlinear+homing+faults"
JAMMED = """
[fin2.fault.jam]
begin = "0.05 s"
end = "0.2 s"
[fin3.fault.drive_loss]
active = true
"""


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The native FMU of the model, for this platform, whose fins stand known at zero."""
    folder = tmp_path_factory.mktemp("options")
    (folder / "known.toml").write_text("[homing]\nrequired = false\n", encoding="utf-8")
    known = load_parameters(folder / "known.toml", model=MODEL)
    return lean(known, folder / "unit.fmu")


@pytest.fixture(scope="module")
def archive(unit: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive with a variant in which fin 2 is jammed for a while and fin 3 has no drive."""
    folder = tmp_path_factory.mktemp("archive")
    (folder / "jammed.toml").write_text(JAMMED, encoding="utf-8")
    files = variant_files([f"jammed={folder / 'jammed.toml'}"])
    return write_ssp(folder / "own.ssp", unit, variant_files=files).path


def test_own_variables_are_connectors_of_their_types(archive: Path) -> None:
    """The FMU determines the model. Items of enumerations are in the structure, under the name connectors give."""
    read = read_variant(archive, "jammed")
    actuator = get(MODEL)
    assert {(fin, c.name, c.kind, c.type) for (fin, _), c in read.connectors.items()} == {
        (fin, v.name, v.causality, v.kind) for fin in read.sources for v in actuator.inputs + actuator.outputs}
    assert read.connectors["fin4", "home"].kind == "input"
    assert valid_documents(archive)
    root = parse(read_archive(archive)["SystemStructure.ssd"], "")
    prefixes = {node.get("name"): node.prefix for node in root.iter(f"{{{SSD}}}Connector")}
    assert {name for name, prefix in prefixes.items() if prefix == "enumeration"} == {"status"}
    (listed,) = root.iterfind(f"{{{SSD}}}Enumerations/{{{SSC}}}Enumeration")
    assert listed.get("name") == "status"
    assert [(i.get("name"), i.get("value")) for i in listed][3] == ("operational", "4")


def test_a_variant_of_faults(archive: Path) -> None:
    values = read_variant(archive, "jammed").values
    assert values["fin2", "fault.jam.end"] == 0.2
    assert values["fin1", "fault.jam.end"] == 0.0
    assert values["fin3", "fault.drive_loss.active"] is True
    assert check(archive).findings == ()


@pytest.fixture(scope="module")
def expected(archive: Path) -> dict[str, Any]:
    """The jammed system in fmpy."""
    return run("fmpy", archive, "jammed")


def test_faults_show_in_the_system(expected: dict[str, Any]) -> None:
    words = {i: [row[k] for k in (40, 100, 240) for row in [expected[f"fin{i}.fault_word"]]] for i in (1, 2, 3)}
    assert words == {1: [0, 0, 0], 2: [0, 1, 0], 3: [8, 8, 8]}
    stuck = expected["fin2.motor_angle"][60:190]
    assert max(stuck) == min(stuck)
    assert set(expected["fin1.status"][:249]) == {4.0}
    assert expected["fin1.status"][-1] == 1.0  # disabled at the end
    assert expected["fin1.homed"][0] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("host", OTHERS)
def test_the_same_in_the_other_hosts(host: str, archive: Path, expected: dict[str, Any]) -> None:
    """But for enumerations, which neither knows."""
    found = run(host, archive, "jammed")
    states = {f"fin{i}.status" for i in range(1, 5)}
    assert set(expected) - set(found) == states
    assert difference({name: values for name, values in expected.items() if name not in states}, found) < SAME


def test_enumerations_under_the_usual_prefix(archive: Path, expected: dict[str, Any], tmp_path: Path) -> None:
    """Over which libcosim would end the process; the check says so."""
    contents = read_archive(archive)
    for name in list(contents):
        if name.endswith(".ssd"):
            contents[name] = contents[name].replace(b"enumeration:Connector", b"ssd:Connector")
    write_archive(contents, tmp_path / "usual.ssp")
    told = [f for f in check(tmp_path / "usual.ssp").warnings if f.place == "connector fin1.status"]
    assert "at which libcosim ends the process" in told[0].message
    found = run("libcosimpy", tmp_path / "usual.ssp", "jammed")
    assert found["fin2.fin_angle"] == expected["fin2.fin_angle"]


@pytest.mark.slow
def test_the_file_as_it_is_in_libcosim_and_ecos(archive: Path) -> None:
    rows = [line.split()[0] for line in printed("libcosimpy", archive, "-", "plain").splitlines()]
    assert [float(row) for row in rows] == pytest.approx([radians(a) for a in (45, 135, 225, 315)])
    assert len(printed("ecospy", archive, "nominal", "plain").splitlines()) == 4


@pytest.mark.parametrize("host", others_slow(hosts.HOSTS, lambda host: host == "fmpy"))
def test_a_state_is_read_or_refused_with_a_reason(host: str, archive: Path) -> None:
    """In a separate process: Ecos and libcosim do not end well in this one after others."""
    program = ("import sys; from pathlib import Path; from examples.ssp_hosts import hosts\n"
               "from emcas_fmu.ssp.archive import SspError\n"
               f"try:\n  system = hosts.open(Path({str(archive)!r}), {host!r})\n"
               "except SspError as error:\n  print('absent', error); sys.exit()\n"
               "system.set('fin1.home', False)\nsystem.step()\n"
               "try:\n  print('state', system.get('fin1.status'), type(system.get('fin1.fault_word')).__name__)\n"
               "except SspError as error:\n  print(error)\nsystem.close()\n")
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr[-2000:]
    if "absent" in done.stdout:
        pytest.skip(done.stdout)
    assert ("state 4 int" if host == "fmpy" else "has no enumerations") in done.stdout


def test_the_command_and_its_refusals(unit: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert f"its model is {MODEL}, but nonlinear+faults is requested" in emcas(
        "--fmu", unit, "--model", "nonlinear+faults", code=2)
    assert "there is no extension 'fault'" in emcas("--model", "elastic+fault", code=2)
    (tmp_path / "hot.toml").write_text('[fin1.heat]\ncase_start_rise = "40 K"\n', encoding="utf-8")
    assert f"the {MODEL} actuator has no such parameter" in emcas(
        "--fmu", unit, "--variant", "hot=hot.toml", code=2)
    monkeypatch.setattr("emcas_fmu.bench.fmu.model_of", lambda name: None)
    with pytest.raises(EmcasError, match="does not contain its model; pass the model with which the FMU was built"):
        write_ssp(tmp_path / "a.ssp", unit)
    with pytest.raises(SspError, match=r"is not an FMU of one actuator of the model nonlinear\+heat: it lacks"):
        write_ssp(tmp_path / "a.ssp", unit, model="nonlinear+heat")
    assert write_ssp(tmp_path / "a.ssp", unit, model=MODEL).report.findings == ()


def test_without_an_fmu_one_of_the_model_is_built(tmp_path: Path, unit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def instead(parameters: Any, output: Path, *_: Any, **__: Any) -> Any:
        asked.append(parameters.model)
        output.write_bytes(unit.read_bytes())
        return type("Built", (), {"path": output})

    monkeypatch.setattr("emcas_fmu.ssp.write.build", instead)
    emcas("--model", "nonlinear+faults+homing", "-o", tmp_path / "a.ssp")
    assert asked == [MODEL]
    assert "resources/EMCAS_homing_faults.fmu" in read_archive(tmp_path / "a.ssp")
