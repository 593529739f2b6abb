"""FMUs with `--names flat`: the same variables under names without dots and brackets."""

from __future__ import annotations

import re
import zipfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from emcas_fmu.actuators import get
from emcas_fmu.bench.excitation import reference_case, step_to
from emcas_fmu.bench.fmu_subject import FmuSubject, open_subject
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.description import terminals_and_icons
from emcas_fmu.fmi.fmi3.arrays import arrays
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import SPELLINGS, FmuInterface, flat
from emcas_fmu.fmi.native import names_header
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.variables import parameter
from tests.fmu.built import slave_class
from tests.fmu.test_description import KINDS
from tests.marks import slow

ROOT = Path(__file__).resolve().parents[2]
WORD = re.compile(r"[a-z]\w*")
# One FMU of each back end.
QUICK = {("python", "2", 1), ("native", "3", 4)}
each_unit = pytest.mark.parametrize("unit", [
    pytest.param((backend, fmi, fins), marks=() if (backend, fmi, fins) in QUICK else pytest.mark.slow,
                 id=f"{backend}-{fmi}-{fins}")
    for backend, fmi in (("python", "2"), ("native", "2"), ("native", "3")) for fins in (1, 4)])


@pytest.mark.parametrize("fins", [1, 2, *slow(8)])
def test_flat_names_are_distinct_words(fins: int) -> None:
    """For every actuator and its extensions, of scalars and of FMI 3.0's arrays."""
    for kind in KINDS:
        unit = FmuInterface(fins, kind, "flat")
        for names in ([v.name for v in unit.variables], [v.variable.name for v in arrays(unit)]):
            spelt = [unit.spelt(name) for name in names]
            assert len(set(spelt)) == len(spelt)
            assert all(WORD.fullmatch(name) for name in spelt)


def test_names_with_equal_flat_names_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = get("second-order")
    ambiguous = replace(shipped, parameters=(*shipped.parameters,
                                             parameter("solver_max.tick", "s", 0.0, 1.0, "a slip")))
    monkeypatch.setattr("emcas_fmu.fmi.interface.get", lambda _: ambiguous)
    assert FmuInterface(1, "second-order").spelt("solver_max.tick") == "solver_max.tick"
    with pytest.raises(EmcasError, match=r"solver\.max_tick and solver_max\.tick would both be solver_max_tick"):
        FmuInterface(1, "second-order", "flat")
    with pytest.raises(EmcasError, match="names round: choose structured or flat"):
        FmuInterface(1, "second-order", "round")


def test_texts_contain_flat_names_only() -> None:
    """In descriptions and messages each name with a dot is replaced, and nothing else is changed."""
    names_of: dict[str, set[str]] = defaultdict(set)  # names with dots that the text must not contain
    for kind in KINDS:
        unit = FmuInterface(2, kind, "flat")
        names = {v.name for v in unit.actuator.parameters if flat(v.name) != v.name}
        for text in (*(v.description for v in unit.variables), *(rule.message for rule in unit.actuator.all_rules)):
            names_of[unit.respelt(text)] |= names
    dotted = re.compile("|".join(rf"(?<!\w){re.escape(name)}(?!\w)" for name in set[str]().union(*names_of.values())))
    assert [text for text, names in names_of.items() if not names.isdisjoint(dotted.findall(text))] == []
    unit = FmuInterface(4, "nonlinear+heat", "flat")
    text = "a fin[2].fin.stop_angle of 0.1 N.m; motor.* and friction.table, e.g. friction.table.viscous[0]"
    assert unit.respelt(text) == (
        "a fin2_fin_stop_angle of 0.1 N.m; motor_* and friction_table, e.g. friction_table_viscous0")
    assert FmuInterface(4).respelt("fin[2].fin.stop_angle") == "fin[2].fin.stop_angle"


@pytest.mark.parametrize("fmi", FORMATS)
def test_header_has_the_same_macros_with_flat_names(fmi: str) -> None:
    structured, flat = (names_header(FmuInterface(4, "nonlinear", names), "{}", FORMATS[fmi]) for names in SPELLINGS)
    assert re.findall("#define .* /", structured) == re.findall("#define .* /", flat)
    assert ("fin2_motor_speed" if fmi == "2" else "fins_motor_speed") in flat
    assert not re.search(r"/\* [\w]*[.\[]", flat)


@pytest.mark.parametrize("arrays", [False, True])
def test_terminals_have_the_names_of_the_variables(arrays: bool) -> None:
    members = [e.attrib[key] for e in terminals_and_icons(FmuInterface(4, "nonlinear", "flat"), arrays).iter(
        "TerminalMemberVariable") for key in ("variableName", "memberName")]
    assert {"acceleration_x", "fins_fin_angle" if arrays else "fin3_fin_angle"} < set(members)
    assert all(map(WORD.fullmatch, members))


def test_messages_of_the_python_fmu_have_flat_names() -> None:
    unit = FmuInterface(2, "nonlinear", "flat")
    slave = slave_class(unit, [load_parameters().values] * 2)(instance_name="fin")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.set_real([unit.reference["fin[2].fin.stop_angle"]], [0.1])
    slave.exit_initialization_mode()
    assert slave.log_queue[-1].msg.startswith(
        "initialization refused: fin2: fin_stop_angle = 0.1 rad (5.72958 deg) must be at least command_limit")
    slave.set_real([unit.reference["fin[1].controller.position.kp"]], [-1.0])
    assert not slave.do_step(0.0, 1e-3)
    assert slave.log_queue[-1].msg.startswith("initialization was refused: fin2: ")


# -- built FMUs --------------------------------------------------------------------


@pytest.fixture(scope="module")
def build_shipped(shipped_unit: Callable[..., Path]) -> Callable[[str, str, int, str], Path]:
    """A function of back end, version of FMI, number of fins and kind of names; it returns the FMU's path."""
    return lambda backend, fmi, fins, names: shipped_unit(backend, fmi=fmi, fins=fins, names=names)


@pytest.mark.fmu
@each_unit
def test_results_with_flat_names_have_the_same_bits(build_shipped: Callable[..., Path], unit: tuple[str, str, int]
                                                    ) -> None:
    """The FMU's subject maps the usual names to the flat ones."""
    runs = []
    for key in ((*unit, names) for names in SPELLINGS):
        with open_subject(build_shipped(*key), fin=2 if unit[2] > 1 else None) as subject:
            assert isinstance(subject, FmuSubject)
            runs.append(subject.run(reference_case("load_opposing"), {"friction.temperature": 0.0,
                                                                      "friction.table.viscous[2]": 1.3}))
            assert subject.identification.differences == (("mounting.azimuth",) if unit[2] > 1 else ())
            assert len(subject.references) == (1 if unit[2] > 1 else 4)
    assert all(run.stopped is None for run in runs)
    assert runs[0].columns.keys() == runs[1].columns.keys() == {"time", *(v.name for v in get("nonlinear").outputs)}
    assert all(np.array_equal(column, runs[1].columns[name]) for name, column in runs[0].columns.items())
    assert np.ptp(runs[0].columns["fin_angle"]) > 0.5


@pytest.mark.fmu
@each_unit
def test_every_file_of_the_archive_has_flat_names(build_shipped: Callable[..., Path], unit: tuple[str, str, int]
                                                  ) -> None:
    path = build_shipped(*unit, "flat")
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
        listed = root.find("ModelVariables")
        assert listed is not None
        names = {v.attrib["name"] for v in listed}
        page = archive.read("documentation/index.html").decode()
        tables = [archive.read(name).decode().splitlines()[0] for name in archive.namelist() if name.endswith(".csv")]
        sets = [archive.read(name).decode() for name in archive.namelist() if name.endswith(".ssv")]
    assert root.attrib["variableNamingConvention"] == "flat"
    assert all(map(WORD.fullmatch, names))
    assert all(f"<code>{name}</code>" in page for name in names) or unit[1] == "3"
    columns = {column.partition("[")[0] for table in tables for column in table.replace('"', "").split(",")}
    parameters = {name.partition("[")[0] for text in sets for name in re.findall(r'Parameter name="([^"]+)"', text)}
    assert columns - {"time"} <= names
    assert parameters <= names
    assert parameters


@pytest.mark.fmu
def test_messages_of_the_native_fmu_have_flat_names(build_shipped: Callable[..., Path]) -> None:
    with open_subject(build_shipped("native", "2", 4, "flat"), fin=3) as subject:
        assert isinstance(subject, FmuSubject)
        messages: list[str] = []
        instance = subject.fmu.instance(lambda *arguments: messages.append(arguments[4].decode()))
        subject.fmu.set_starts(instance, {"fin.stop_angle": 0.1})
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        with pytest.raises(FMICallException):
            instance.exitInitializationMode()
        instance.freeInstance()
    assert any(message.startswith("fin3: fin_stop_angle = 0.1 rad") for message in messages)


@pytest.mark.fmu
def test_flat_names_of_a_users_actuator_need_its_model(tmp_path: Path) -> None:
    """The usual names cannot be found from flat ones alone."""
    own = ROOT / "examples" / "own_actuator" / "direct_drive.py"
    path = build(load_parameters(model=str(own)), tmp_path / "own.fmu", names="flat", references=False).path
    with open_subject(path, model=str(own)) as subject:
        assert subject.run(step_to(0.1, 0.2)).stopped is None
    with pytest.raises(EmcasError, match="model; pass the model with which the FMU was built"), open_subject(path):
        pass


@pytest.mark.drawn
@pytest.mark.fmu
def test_build_and_validate_accept_flat_names(build_shipped: Callable[..., Path], tmp_path: Path) -> None:
    path = tmp_path / "EMCAS.fmu"
    done = CliRunner().invoke(app, ["build", "--names", "flat", "-o", str(path)])
    assert done.exit_code == 0, done.output
    assert path.read_bytes() == build_shipped("python", "2", 1, "flat").read_bytes()
    done = CliRunner().invoke(app, ["validate", str(path), "--case", "step_plus20"])
    assert done.exit_code == 0, done.output
    refused = CliRunner().invoke(app, ["build", "--names", "round", "-o", str(path)])
    assert refused.exit_code == 2
    assert "names round: choose structured or flat" in refused.output
