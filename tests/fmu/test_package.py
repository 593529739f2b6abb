"""The archive is valid, complete and reproducible, and works beside other FMUs in one process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring, tostring

import fmpy
import pytest
from fmpy import extract, instantiate_fmu, read_model_description
from fmpy.validation import validate_fmu
from lxml import etree

from emcas_fmu import __author__, __copyright__, __date__, __version__
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.description import about
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import parameters_hash
from emcas_fmu.runtime import compiler
from tests.default_actuator import INPUTS, OUTPUTS, PARAMETERS, VARIABLES

from .built import both

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = Path(fmpy.__file__).parent / "schema"
pytestmark = pytest.mark.fmu


@pytest.fixture(scope="module", params=["python", "native"])
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def unit(units: Mapping[str, Path], backend: str) -> Path:
    return units[backend]


@pytest.fixture(scope="module")
def description(unit: Path) -> Element:
    with zipfile.ZipFile(unit) as archive:
        return fromstring(archive.read("modelDescription.xml"))


def test_fmpy_finds_no_errors(unit: Path) -> None:
    assert validate_fmu(str(unit)) == []


def test_every_variable_is_described(description: Element) -> None:
    units = {u.attrib["name"] for u in description.findall("UnitDefinitions/Unit")}
    scalars = description.findall("ModelVariables/ScalarVariable")
    assert [s.attrib["name"] for s in scalars] == [v.name for v in VARIABLES]
    for scalar in scalars:
        assert scalar.attrib["description"]
        if scalar[0].tag == "Real":
            assert scalar[0].attrib["unit"] in units
    unknowns = description.findall("ModelStructure/InitialUnknowns/Unknown")
    assert len(unknowns) == len(description.findall("ModelStructure/Outputs/Unknown")) == len(OUTPUTS)


def test_capabilities(description: Element, backend: str) -> None:
    options = description.find("CoSimulation")
    assert options is not None
    assert options.attrib["canGetAndSetFMUstate"] == options.attrib["canSerializeFMUstate"] == "true"
    assert options.attrib["canHandleVariableCommunicationStepSize"] == "true"
    # pythonfmu's wrapper ignores input derivatives.
    assert options.attrib["canInterpolateInputs"] == {"python": "false", "native": "true"}[backend]
    assert options.attrib["needsExecutionTool"] == "false"  # both contain the model itself
    assert options.attrib.get("providesDirectionalDerivative", "false") == "false"


def test_start_values_are_exact(unit: Path) -> None:
    values = load_parameters().values
    described = {v.name: v for v in read_model_description(str(unit)).modelVariables}
    for v in PARAMETERS:
        start = described[v.name].start
        assert (start == "true") == values[v.name] if v.kind == "Boolean" else float(start) == values[v.name]
    assert float(described["supply_voltage"].start) == values["drive.supply_voltage"]
    assert {v.name for v in INPUTS} == {n for n, v in described.items() if v.causality == "input"}


def test_declared_dependencies_of_outputs_are_the_observed_ones(unit: Path, description: Element) -> None:
    """An output has dependencies exactly if it reacts to an input without a step."""
    folder = extract(str(unit))
    model = read_model_description(folder)
    slave = instantiate_fmu(folder, model, "CoSimulation")
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    reference = {v.name: v.valueReference for v in model.modelVariables}
    slave.setBoolean([reference["loads.gravity"]], [True])
    slave.exitInitializationMode()
    slave.setReal([reference["fin_command"], reference["aero_torque"], reference["attitude.roll"],
                   reference["attitude.pitch"]], [0.2, -30.0, 0.3, 0.2])

    def outputs() -> dict[str, float]:
        return {v.name: (slave.getReal if v.kind == "Real" else slave.getBoolean)([reference[v.name]])[0]
                for v in OUTPUTS}

    names = [v.name for v in VARIABLES]
    declared = {names[int(u.attrib["index"]) - 1]: {names[int(i) - 1] for i in u.attrib["dependencies"].split()}
                for u in description.findall("ModelStructure/Outputs/Unknown")}
    reacts: dict[str, set[str]] = {v.name: set() for v in OUTPUTS}
    # During a slew, so that every output that can react does react.
    for k in range(100):
        slave.doStep(k * 1e-3, 1e-3)
        before = outputs()
        for v in INPUTS:
            get, put = (slave.getReal, slave.setReal) if v.kind == "Real" else (slave.getBoolean, slave.setBoolean)
            value = get([reference[v.name]])[0]
            put([reference[v.name]], [not value] if v.kind == "Boolean" else [value * 0.5 + 0.01])
            after = outputs()
            put([reference[v.name]], [value])
            for name in before:
                if after[name] != before[name]:
                    reacts[name].add(v.name)
    slave.terminate()
    slave.freeInstance()
    for name, inputs in reacts.items():
        assert inputs <= declared[name], name
    assert {n for n, inputs in declared.items() if inputs} == {n for n, inputs in reacts.items() if inputs}


@pytest.mark.drawn
def test_second_build_gives_the_same_bytes(tmp_path: Path) -> None:
    first = build(load_parameters(), tmp_path / "a.fmu")
    second = build(load_parameters(), tmp_path / "b.fmu")
    assert first.path.read_bytes() == second.path.read_bytes()


def test_build_in_another_process_gives_the_same_bytes(fmu: Path, tmp_path: Path) -> None:
    """With another hash seed and another time zone."""
    code = ("from pathlib import Path; from emcas_fmu.fmi.package import build;"
            "from emcas_fmu.parameters import load_parameters; build(load_parameters(), Path('c.fmu'))")
    environment = {**os.environ, "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, env=environment)
    assert (tmp_path / "c.fmu").read_bytes() == fmu.read_bytes()


def test_guid_follows_the_interface(fmu: Path, tmp_path: Path) -> None:
    same = build(load_parameters(), tmp_path / "same.fmu")
    other = build(load_parameters().with_values({"controller.position.kp": 50.0}), tmp_path / "other.fmu",
                  references=False)
    assert read_model_description(str(fmu)).guid == same.guid != other.guid


def read(path: Path, name: str) -> str:
    with zipfile.ZipFile(path) as archive:
        return archive.read(name).decode()


def test_author_licence_and_date(unit: Path, description: Element, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                 ) -> None:
    """The date is that of the version, or SOURCE_DATE_EPOCH."""
    attributes = description.attrib
    assert (attributes["author"], attributes["copyright"], attributes["license"]) == (__author__, __copyright__, "MIT")
    assert attributes["generationDateAndTime"] == f"{__date__}T00:00:00Z"
    experiment = description.find("DefaultExperiment")
    assert experiment is not None
    assert float(experiment.attrib["tolerance"]) == 1e-4
    licence = read(unit, "documentation/licenses/license.txt")
    assert (ROOT / "LICENSE").read_text(encoding="utf-8") in licence
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    later = build(load_parameters(), tmp_path / "later.fmu")
    assert 'generationDateAndTime="1970-01-02T00:00:00Z"' in read(later.path, "modelDescription.xml")
    assert later.guid == attributes["guid"]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "tomorrow")
    with pytest.raises(EmcasError, match="SOURCE_DATE_EPOCH=tomorrow"):
        build(load_parameters(), tmp_path / "never.fmu")


def test_license_txt_names_every_other_licence(unit: Path, backend: str) -> None:
    licence = read(unit, "documentation/licenses/license.txt")
    with zipfile.ZipFile(unit) as archive:
        files = {name for name in archive.namelist() if name.startswith("documentation/licenses/")}
    assert ("pythonfmu-license.txt" in licence) == (backend == "python")  # a native FMU contains no foreign code
    assert files == {"documentation/licenses/license.txt",
                     *(["documentation/licenses/pythonfmu-license.txt"] if backend == "python" else [])}


def test_description_and_version_distinguish_parameter_sets(description: Element, tmp_path: Path) -> None:
    file, slow = tmp_path / "my_actuator.toml", tmp_path / "slow.toml"
    file.write_text('controller.position.kp = "50 1/s"\ndrive.supply_voltage = "28 V"\n', encoding="utf-8")
    slow.write_text('controller.speed_limit = "200 rad/s"\n', encoding="utf-8")
    shipped, mine = load_parameters(), load_parameters(file)
    four = fin_sets(shipped, 4, "plus", {2: slow})
    attributes = [about(FmuInterface(len(sets)), sets, "") for sets in (
        [mine], [load_parameters([file, slow])], [shipped.with_values({"controller.position.kp": 50.0})],
        fin_sets(shipped, 4), four, [mine.with_values({"controller.position.kp": 51.0})])]
    assert description.attrib["description"].endswith("current loops; default parameters")
    assert description.attrib["version"] == __version__
    assert [each["description"].rpartition("loops; ")[2] for each in attributes] == [
        "2 values changed by my_actuator.toml", "3 values changed by my_actuator.toml, slow.toml", "1 value changed",
        "4 fins on one bus; fins at 45, 135, 225, 315 deg; default parameters",
        "4 fins on one bus; fins at 0, 90, 180, 270 deg; 1 value changed by slow.toml",
        "2 values changed by my_actuator.toml"]
    versions = [each["version"] for each in attributes]
    assert len(set(versions)) == len(versions)
    assert versions[0] == f"{__version__}+{parameters_hash(mine.values)[:8]}"
    assert versions[3] == __version__


@pytest.mark.parametrize(("name", "message"), [("EMCAS.zip", "must end in .fmu"), ("missing/EMCAS.fmu", "no folder")])
def test_bad_output_path_is_refused(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(EmcasError, match=message):
        build(load_parameters(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_python_fmu_contains_its_files(fmu: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        assert archive.testzip() is None
        names = set(archive.namelist())
    assert {"modelDescription.xml", "model.png", "documentation/index.html", "documentation/licenses/license.txt",
            "documentation/externalDependencies.txt", "terminalsAndIcons/terminalsAndIcons.xml",
            "binaries/linux64/EMCAS.so", "binaries/win64/EMCAS.dll"} <= names
    assert any(n.startswith("extra/") and n.endswith("_ref.csv") for n in names)
    assert not any("__pycache__" in n for n in names)


def test_python_fmus_in_one_process_keep_their_own_code(fmu: Path, tmp_path: Path) -> None:
    """Two FMUs of this package with different parameters, and one from pythonfmu itself."""
    (tmp_path / "other_slave.py").write_text(textwrap.dedent("""
        from pythonfmu import Fmi2Slave, Fmi2Causality, Real
        class Other(Fmi2Slave):
            def __init__(self, **kwargs):
                super().__init__(**kwargs)
                self.y = 0.0
                self.register_variable(Real("y", causality=Fmi2Causality.output))
            def do_step(self, current_time, step_size):
                self.y += step_size
                return True
    """))
    subprocess.run([sys.executable, "-m", "pythonfmu", "build", "-f", "other_slave.py"], cwd=tmp_path, check=True,
                   capture_output=True)
    slow = build(load_parameters().with_values({"controller.position.kp": 20.0}), tmp_path / "Slow.fmu",
                 references=False).path
    code = textwrap.dedent(f"""
        import json, warnings
        from fmpy import simulate_fmu
        def run(path, **more):
            return simulate_fmu(path, stop_time=0.1, output_interval=1e-3, **more)
        ours = lambda p: float(run(p, start_values={{"fin_command": 0.1}}, output=["fin_angle"])["fin_angle"][-1])
        first, slow = ours({str(fmu)!r}), ours({str(slow)!r})
        other = float(run("Other.fmu")["y"][-1])
        print(json.dumps([first, slow, other, ours({str(fmu)!r}), ours({str(slow)!r})]))
    """)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    first, slow_angle, other, again, slow_again = json.loads(done.stdout.splitlines()[-1])
    assert other == pytest.approx(0.1)
    assert first == again != slow_angle == slow_again
    assert abs(first - 0.1) < abs(slow_angle - 0.1)


@pytest.mark.slow
def test_python_oo_builds_the_same_bytes(tmp_path: Path) -> None:
    """`python -OO` removes docstrings and assertions; the FMU contains the source's."""
    code = ("import sys; from pathlib import Path; from types import SimpleNamespace\n"
            "sys.modules['emcas_fmu.fmi.pictures'] = SimpleNamespace(response_pictures=lambda _: ())  # no Matplotlib\n"
            "from emcas_fmu.parameters import load_parameters; from tests.fmu.built import both\n"
            "both(load_parameters(), Path(sys.argv[1]))\n")
    for name in ("with", "without"):
        (tmp_path / name).mkdir()
    subprocess.run([sys.executable, "-OO", "-c", code, tmp_path / "without"], cwd=ROOT, check=True)
    for backend, path in both(load_parameters(), tmp_path / "with").items():
        assert (tmp_path / "without" / f"{backend}.fmu").read_bytes() == path.read_bytes()


def test_python_fmu_contains_the_modules_of_pythonfmu_for_a_slave(fmu: Path) -> None:
    """No module that builds FMUs; the package name is unique in the host's process."""
    with zipfile.ZipFile(fmu) as archive:
        modules = [Path(name) for name in archive.namelist() if "/pythonfmu/" in name]
    assert {path.stem for path in modules} == {
        "__init__", "_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables"}
    assert all(path.parts[1].startswith("emcas_") for path in modules)


def test_building_changes_neither_modules_nor_search_path(tmp_path: Path) -> None:
    before, path = dict(sys.modules), list(sys.path)
    build(load_parameters(), tmp_path / "EMCAS.fmu")
    assert sys.path == path
    assert {name for name in set(sys.modules) - set(before) if name.startswith("emcas")} == set()
    assert all(sys.modules.get(name) is module for name, module in before.items())


def test_descriptions_follow_the_schemas(unit: Path) -> None:
    with zipfile.ZipFile(unit) as archive:
        for name, schema in (("modelDescription.xml", "fmi2/fmi2ModelDescription.xsd"),
                             ("terminalsAndIcons/terminalsAndIcons.xml", "fmi3/fmi3TerminalsAndIcons.xsd")):
            checker = etree.XMLSchema(etree.parse(str(SCHEMAS / schema)))
            assert checker.validate(etree.fromstring(archive.read(name))), checker.error_log
        assert archive.read("terminalsAndIcons/icon.png") == archive.read("model.png")


def test_both_back_ends_have_one_model_description(units: Mapping[str, Path]) -> None:
    """Except for capabilities and generation tool."""
    texts = []
    for unit in units.values():
        with zipfile.ZipFile(unit) as archive:
            root = fromstring(archive.read("modelDescription.xml"))
        root.remove(root.find("CoSimulation"))  # type: ignore[arg-type]
        root.attrib.pop("generationTool")
        texts.append(tostring(root))
    assert texts[0] == texts[1]


def test_page_describes_the_back_end_of_its_fmu(unit: Path, backend: str, description: Element) -> None:
    """Requirements, capabilities and responses to wrong calls differ between the back ends."""
    with zipfile.ZipFile(unit) as archive:
        page = " ".join(archive.read("documentation/index.html").decode().split())
        names = archive.namelist()
    facts = {"python": ("Python 3.10 or later", "does not interpolate", "or use input derivatives", "is logged",
                        "affects no step", "every step is then discarded", "A wrong GUID is not detected"),
             "native": ("needs no other software", "fmi2SetRealInputDerivatives", "fmi2Error", "repeat the call",
                        "A wrong GUID is refused")}
    assert {fact for each in facts.values() for fact in each if fact in page} == set(facts[backend])
    options = description.find("CoSimulation")
    assert options is not None
    assert ("or change linearly" in page) == (options.attrib["canInterpolateInputs"] == "true")
    assert ("externalDependencies.txt" in page) == ("documentation/externalDependencies.txt" in names)
    assert f"The FMU has binaries for {', '.join(sorted(read_platforms(unit)))}." in page


def test_native_fmu_contains_its_sources(native: Path) -> None:
    with zipfile.ZipFile(native) as archive:
        names = set(archive.namelist())
        build_description = etree.fromstring(archive.read("sources/buildDescription.xml"))
    schema = etree.XMLSchema(etree.parse(str(SCHEMAS / "fmi3/fmi3BuildDescription.xsd")))
    assert schema.validate(build_description), schema.error_log
    assert {f.attrib["name"] for f in build_description.iter("SourceFile")} == {"fmi2.c"}
    assert {"sources/fmi2.c", "sources/core.h", "sources/kernel.h", "sources/model.h", "sources/interface.h",
            "sources/instance.h", "sources/life_cycle.h", "sources/states.h", "sources/rules.h",
            "sources/parameter_checks.h", "sources/EMCAS.h", "documentation/index.html",
            "documentation/licenses/license.txt"} <= names
    assert not any(n.startswith(("sources/fmi2F", "sources/fmi2T")) for n in names)  # an importer has FMI's headers
    assert not any(n.startswith("resources/") or n.endswith(".py") for n in names)
    assert "documentation/externalDependencies.txt" not in names


@pytest.mark.drawn
@pytest.mark.slow
def test_second_native_build_gives_the_same_bytes(native: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                  ) -> None:
    """With an empty compiler cache, in another folder and another time zone."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    monkeypatch.setattr(compiler, "cache_directory", lambda: tmp_path / "cache")
    (platform,) = read_platforms(native)
    again = build(load_parameters(), tmp_path / "EMCAS.fmu", "native", [platform])
    assert (tmp_path / "cache").is_dir()
    assert again.path.read_bytes() == native.read_bytes()


def read_platforms(unit: Path) -> set[str]:
    with zipfile.ZipFile(unit) as archive:
        return {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}


@pytest.mark.slow
def test_system_compiler_builds_a_valid_fmu(tmp_path: Path, native: Path) -> None:
    built = build(load_parameters(), tmp_path / "EMCAS.fmu", "native", cc="cc")
    assert list(built.platforms) == sorted(read_platforms(native))
    assert validate_fmu(str(built.path)) == []


def test_error_contains_the_compilers_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emcas_fmu.fmi.native.core_sources", lambda *_: {"core.h": "#error on purpose\n"})
    with pytest.raises(EmcasError, match="on purpose"):
        build(load_parameters(), tmp_path / "EMCAS.fmu", "native", cc="cc")
    assert list(tmp_path.iterdir()) == []
