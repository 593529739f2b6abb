"""Archives of an actuator with extensions: further variables, enumerations and faults, in each host."""

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
from .test_hosts import OTHERS, ROOT, SAME, output, run

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
    """The native FMU for this platform; it needs no homing run."""
    folder = tmp_path_factory.mktemp("options")
    (folder / "homed.toml").write_text("[homing]\nrequired = false\n", encoding="utf-8")
    return lean(load_parameters(folder / "homed.toml", model=MODEL), folder / "unit.fmu")


@pytest.fixture(scope="module")
def archive(unit: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive with a variant in which fin 2 jams for 0.15 s and the drive of fin 3 has failed."""
    folder = tmp_path_factory.mktemp("archive")
    (folder / "jammed.toml").write_text(JAMMED, encoding="utf-8")
    files = variant_files([f"jammed={folder / 'jammed.toml'}"])
    return write_ssp(folder / "own.ssp", unit, variant_files=files).path


def test_variables_of_extensions_are_connectors_with_their_types(archive: Path) -> None:
    """The structure contains the items of the enumeration `status`."""
    variant = read_variant(archive, "jammed")
    actuator = get(MODEL)
    assert {(fin, c.name, c.kind, c.type) for (fin, _), c in variant.connectors.items()} == {
        (fin, v.name, v.causality, v.kind) for fin in variant.sources for v in actuator.inputs + actuator.outputs}
    assert variant.connectors["fin4", "home"].kind == "input"
    assert valid_documents(archive)
    root = parse(read_archive(archive)["SystemStructure.ssd"], "")
    prefixes = {node.get("name"): node.prefix for node in root.iter(f"{{{SSD}}}Connector")}
    assert {name for name, prefix in prefixes.items() if prefix == "enumeration"} == {"status"}
    (enumeration,) = root.iterfind(f"{{{SSD}}}Enumerations/{{{SSC}}}Enumeration")
    assert enumeration.get("name") == "status"
    assert [(i.get("name"), i.get("value")) for i in enumeration][3] == ("operational", "4")


def test_variant_has_the_faults_of_each_fin(archive: Path) -> None:
    values = read_variant(archive, "jammed").values
    assert values["fin2", "fault.jam.end"] == 0.2
    assert values["fin1", "fault.jam.end"] == 0.0
    assert values["fin3", "fault.drive_loss.active"] is True
    assert check(archive).findings == ()


@pytest.fixture(scope="module")
def expected(archive: Path) -> dict[str, Any]:
    """The jammed system in fmpy."""
    return run("fmpy", archive, "jammed")


def test_faults_affect_their_fins_only(expected: dict[str, Any]) -> None:
    words = {i: [expected[f"fin{i}.fault_word"][k] for k in (40, 100, 240)] for i in (1, 2, 3)}
    assert words == {1: [0, 0, 0], 2: [0, 1, 0], 3: [8, 8, 8]}
    angles = expected["fin2.motor_angle"][60:190]
    assert max(angles) == min(angles)
    assert set(expected["fin1.status"][:249]) == {4.0}
    assert expected["fin1.status"][-1] == 1.0  # disabled at the end
    assert expected["fin1.homed"][0] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("host", OTHERS)
def test_outputs_in_the_other_hosts_equal_fmpys(host: str, archive: Path, expected: dict[str, Any]) -> None:
    """The other hosts have no enumerations."""
    outputs = run(host, archive, "jammed")
    states = {f"fin{i}.status" for i in range(1, 5)}
    assert set(expected) - set(outputs) == states
    assert difference({name: values for name, values in expected.items() if name not in states}, outputs) < SAME


def test_check_warns_of_enumerations_that_libcosim_cannot_read(archive: Path, expected: dict[str, Any], tmp_path: Path
                                                               ) -> None:
    """libcosim alone would end the process at an enumeration connector with the prefix `ssd`; the example does not."""
    contents = read_archive(archive)
    for name in list(contents):
        if name.endswith(".ssd"):
            contents[name] = contents[name].replace(b"enumeration:Connector", b"ssd:Connector")
    write_archive(contents, tmp_path / "usual.ssp")
    warnings = [f for f in check(tmp_path / "usual.ssp").warnings if f.place == "connector fin1.status"]
    assert "at which libcosim ends the process" in warnings[0].message
    outputs = run("libcosimpy", tmp_path / "usual.ssp", "jammed")
    assert outputs["fin2.fin_angle"] == expected["fin2.fin_angle"]


@pytest.mark.slow
def test_libcosim_and_ecos_alone_open_the_archive(archive: Path) -> None:
    azimuths = [float(line.split()[0]) for line in output("libcosimpy", archive, "-", "plain").splitlines()]
    assert azimuths == pytest.approx([radians(a) for a in (45, 135, 225, 315)])
    assert len(output("ecospy", archive, "nominal", "plain").splitlines()) == 4


@pytest.mark.parametrize("host", others_slow(hosts.HOSTS, lambda host: host == "fmpy"))
def test_enumeration_is_read_or_refused_with_a_reason(host: str, archive: Path) -> None:
    """In a separate process, because Ecos and libcosim may crash at the end of a process that has used others."""
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


def test_fmu_of_a_wrong_or_unknown_model_is_refused(unit: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                    ) -> None:
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


def test_command_builds_an_fmu_of_the_model(tmp_path: Path, unit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    models = []

    def build(parameters: Any, output: Path, *_: Any, **__: Any) -> Any:
        models.append(parameters.model)
        output.write_bytes(unit.read_bytes())
        return type("Built", (), {"path": output})

    monkeypatch.setattr("emcas_fmu.ssp.write.build", build)
    emcas("--model", "nonlinear+faults+homing", "-o", tmp_path / "a.ssp")
    assert models == [MODEL]
    assert "resources/EMCAS_homing_faults.fmu" in read_archive(tmp_path / "a.ssp")
