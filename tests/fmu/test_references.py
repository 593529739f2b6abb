"""References inside the FMU: a stranger repeats them from the archive, and they say no more than is so."""

from __future__ import annotations

import csv
import math
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest

from emcas_fmu.fmi import references
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.fmi.package import build
from emcas_fmu.fmi.references import FOLDER, MANIFEST, TEXT, reference_files
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files, responses
from emcas_fmu.reference.cases import CASES, STEP_AND_LOAD, Case
from emcas_fmu.simulation import simulate
from emcas_fmu.ssp.archive import SSV, parse, violations

from ..docs.recipes import ROOT, recipes
from ..own_actuator.example import MODEL as DIRECT_DRIVE
from ..own_actuator.example import changed

LIMIT = 0.002  # deg, that of `emcas validate`
INDEPENDENT, RECORDED = "experiment/validation", "experiment/smoke-test"
PAGE = "use/references.md"
CUSTOM = {"motor.resistance": 0.3, "friction.fin_coulomb": 3.0}


def by_stranger(unit: Path, folder: Path) -> dict[str, tuple[str, float]]:
    """Role and largest difference [deg] by experiment, as the page's program has them in a separate process."""
    program = recipes(PAGE)["fmpy"][1] + "\nimport sys\nassert 'emcas_fmu' not in sys.modules\n"
    (folder / "EMCAS.fmu").write_bytes(unit.read_bytes())
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=folder, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    return {name: (role, float(off))
            for role, name, off in re.findall(r"^(\S+) (\S+): (\S+) deg$", done.stdout, re.MULTILINE)}


Make = Callable[[Callable[..., Path], Path], Path]


def shipped(*arguments: Any, **options: Any) -> Make:
    """Gives the default actuator's unit, which other tests use, too."""
    return lambda shipped_unit, _: shipped_unit(*arguments, **options)


def of(model: str, **options: Any) -> Make:
    return lambda _, folder: build(load_parameters(model=model), folder / "unit.fmu", **options).path


def custom(_: Callable[..., Path], folder: Path) -> Path:
    return build(load_parameters().with_values(CUSTOM), folder / "unit.fmu").path


STORED, ONE, FINS = ["step", "load_opposing", "cold", "sag"], ["step_and_load"], ["fins"]


@pytest.mark.parametrize("tick", [0.7e-3, 0.2e-3])
def test_the_text_says_how_far_the_stepping_was_off(tick: float) -> None:
    parameters = load_parameters().with_values({**CUSTOM, "solver.max_tick": tick})
    contents, *_ = reference_files(FmuInterface(1), (parameters,), FORMATS["2"])
    (said,) = re.findall(r"differs from these results by up to (\S+) deg", contents[TEXT].decode())
    case = files.suited(STEP_AND_LOAD, parameters.model, parameters.values)
    inputs: dict[str, Any] = {name: column for name, column in case.inputs().items() if name != "time"}
    run = simulate({**parameters.values, **case.overrides}, case.stop_time, case.step, **inputs)
    off = np.max(np.abs(run["fin_angle"] - responses.response(parameters, case)["fin_angle"]))
    assert float(said) == pytest.approx(math.degrees(off), rel=0.05)  # of two digits


@pytest.mark.fmu
@pytest.mark.parametrize(("make", "names", "role"), [
    pytest.param(shipped("python", 4), FINS, INDEPENDENT, id="four fins"),
    pytest.param(shipped(fmi="3"), STORED, INDEPENDENT, id="FMI 3.0"),
    pytest.param(shipped(fins=4, fmi="3"), FINS, INDEPENDENT, id="FMI 3.0, four fins", marks=pytest.mark.slow),
    pytest.param(shipped(fins=4, names="flat"), FINS, INDEPENDENT, id="flat", marks=pytest.mark.slow),
    pytest.param(of("elastic+heat+homing+faults"), ONE, RECORDED, id="options", marks=pytest.mark.slow),
    pytest.param(custom, ONE, INDEPENDENT, id="custom"),
    pytest.param(of("second-order"), ONE, RECORDED, id="second-order"),
    pytest.param(of("nonlinear+homing+faults"), STORED, INDEPENDENT, id="neutral options", marks=pytest.mark.slow),
    *(pytest.param(of(name), ONE, INDEPENDENT, id=name, marks=pytest.mark.slow) for name in (
        "electrohydraulic", "electrohydrostatic", "worm-gear", "worm-gear-elastic", "clutch", "series-clutch")),
    pytest.param(of(DIRECT_DRIVE), ONE, INDEPENDENT, id="own actuator", marks=pytest.mark.slow),
    pytest.param(of("clutch+faults", fins=3), FINS, INDEPENDENT, id="three clutches", marks=pytest.mark.slow)])
def test_a_stranger_repeats_them(make: Make, names: list[str], role: str, shipped_unit: Callable[..., Path],
                                 tmp_path: Path) -> None:
    found = by_stranger(make(shipped_unit, tmp_path), tmp_path)
    assert list(found) == names
    assert all(each == role and off <= LIMIT for each, off in found.values()), found


@pytest.mark.fmu
@pytest.mark.parametrize("backend", ["python", "native"])
def test_the_page_says_what_the_default_one_gives(backend: str, units: Mapping[str, Path], tmp_path: Path) -> None:
    found = by_stranger(units[backend], tmp_path)
    shown = re.findall(r"^(\S+) (\S+): (\S+) deg$", (ROOT / "docs" / PAGE).read_text("utf-8"), re.MULTILINE)
    assert found == {name: (role, float(off)) for role, name, off in shown}
    assert all(off <= LIMIT for _, off in found.values())


@pytest.mark.fmu
def test_the_start_values_are_part_of_it(fmu: Path, tmp_path: Path) -> None:
    """With its encoder the unit is further off than the limit: the comparison sees it."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(tmp_path / "encoder.fmu", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, content.replace(b'"false"', b'"true"') if name.endswith(".ssv") else content)
    assert all(off > 10 * LIMIT for _, off in by_stranger(tmp_path / "encoder.fmu", tmp_path).values())


# What the files are ---------------------------------------------------------------------------------------


def made(model: str = "nonlinear", fins: int = 1, values: Mapping[str, Any] | None = None
         ) -> tuple[dict[str, bytes], tuple[str, ...]]:
    parameters = load_parameters(model=model).with_values(values or {})
    return reference_files(FmuInterface(fins, model), [parameters] if fins == 1 else fin_sets(parameters, fins),
                           FORMATS["2"])[:2]


def xml(contents: Mapping[str, bytes], name: str) -> Element:
    return fromstring(contents[f"{FOLDER}/{name}"])


@pytest.mark.parametrize(("model", "fins"), [("nonlinear", 1), ("nonlinear", 4), ("second-order", 2),
                                             ("elastic+homing", 1)])
def test_the_manifest_names_every_file(model: str, fins: int) -> None:
    """Roles and attributes are those of the schema of FMI-LS-REF, by which the files were checked by hand."""
    contents, warnings = made(model, fins)
    assert not warnings
    manifest = xml(contents, MANIFEST)
    space = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"
    assert manifest.tag == "fmiReferences"
    assert manifest.attrib == {
        f"{space}name": "org.fmi-standard.fmi-ls-ref", f"{space}version": "1.0.0-beta.1",
        f"{space}description": "Layered Standard providing information on related files included in an FMU."}
    related = {each.attrib["source"]: each.attrib for each in manifest}
    assert {f"{FOLDER}/{name}" for name in related if not name.startswith("..")} == {
        name for name in contents if name.startswith("extra/")} - {f"{FOLDER}/{MANIFEST}"}
    assert {name for name in related if name.startswith("..")} == {f"../../{TEXT}"}
    roles = {"exp": ("application/x-ma-hs-experiments", {INDEPENDENT, RECORDED}),
             "ssv": ("application/x-ssp-parameter-set", {"parameter"}), "csv": ("text/csv", {"other", "result"}),
             "txt": ("text/plain", {"document"})}
    for name, attributes in related.items():
        kind, allowed = roles[name.rpartition(".")[2]]
        assert attributes["type"] == kind
        assert attributes["role"] in allowed
        assert attributes["description"]


@pytest.mark.parametrize(("model", "fins"), [("nonlinear", 1), ("nonlinear", 4), ("elastic+homing", 2)])
def test_names_are_the_units(model: str, fins: int) -> None:
    contents, _ = made(model, fins)
    unit = FmuInterface(fins, model)
    causality = {v.name: v.causality for v in unit.variables}
    for name, content in contents.items():
        if name.endswith(".csv"):
            first, *rows = csv.reader(content.decode().splitlines())
            assert first[0] == "time"
            assert {causality[each] for each in first[1:]} == {"input" if name.endswith("_in.csv") else "output"}
            assert all(math.isfinite(float(cell)) for row in rows for cell in row)
        if name.endswith(".ssv"):
            root = parse(content, name)
            assert violations(root, SSV) == []
            given = {each.get("name"): each[0].get("value") for each in root.iterfind(f".//{{{SSV}}}Parameter")}
            switches = {unit.name("encoder.enabled", fin) for fin in range(fins)}
            assert switches <= given.keys() <= {n for n, each in causality.items() if each == "parameter"}
            assert all(given[each] == "false" for each in switches)
    for experiment in xml(contents, "validation.exp" if model == "nonlinear" else "smoke-test.exp"):
        assert {each.tag: each.attrib["source"] for each in experiment} == {
            tag: f"{experiment.attrib['name']}{ending}" for tag, ending in (
                ("Parameters", ".ssv"), ("Stimuli", "_in.csv"), ("References", "_ref.csv"))}


def test_each_fin_moves_as_none_other() -> None:
    contents, _ = made(fins=4)
    header, *rows = csv.reader(contents[f"{FOLDER}/fins_ref.csv"].decode().splitlines())
    angles = {name: math.degrees(float(rows[-1][k])) for k, name in enumerate(header) if name.endswith("fin_angle")}
    # What is left of an overshoot at the end, a degree of 20 at most.
    assert list(angles) == [f"fin[{fin}].fin_angle" for fin in (1, 2, 3, 4)]
    assert list(angles.values()) == pytest.approx([10.0, -5.0, 20.0, -1.0], rel=0.05)


def test_fins_of_their_own_parameters_have_their_own_responses() -> None:
    unit = FmuInterface(2, "second-order")
    alike, _ = made("second-order", 2)
    slow = load_parameters(model="second-order").with_values({"second_order.natural_frequency": 150.0})
    contents, *_ = reference_files(unit, [load_parameters(model="second-order"), slow], FORMATS["2"])
    ours, theirs = (np.loadtxt(each[f"{FOLDER}/fins_ref.csv"].decode().splitlines()[1:], delimiter=",").T
                    for each in (contents, alike))
    header = contents[f"{FOLDER}/fins_ref.csv"].decode().splitlines()[0].split(",")
    first, second = header.index("fin[1].fin_angle"), header.index("fin[2].fin_angle")
    assert np.array_equal(ours[first], theirs[first])
    assert not np.array_equal(ours[second], theirs[second])


@pytest.mark.parametrize(("model", "file", "said"), [
    ("nonlinear+faults", "validation.exp", "independent integration (emcas_fmu.reference.simulate)"),
    ("nonlinear+heat", "smoke-test.exp", "no independent\nintegration of nonlinear+heat in this case"),
    ("linear", "smoke-test.exp", "no independent\nintegration of linear in this case")])
def test_no_independence_is_claimed_that_is_not_there(model: str, file: str, said: str) -> None:
    contents, _ = made(model)
    assert [name for name in contents if name.endswith(".exp")] == [f"{FOLDER}/{file}"]
    assert said in contents[TEXT].decode()


def test_a_fault_makes_it_a_record() -> None:
    """One that changes something in a case takes that one's reference: at 0.9 s the fin moves in the sag alone."""
    contents, _ = made("nonlinear+faults", values={"fault.jam.begin": 0.9, "fault.jam.end": 2.0})
    experiments = {name: [each.attrib["name"] for each in xml(contents, name)]
                   for name in ("validation.exp", "smoke-test.exp")}
    assert experiments == {"validation.exp": ["step", "load_opposing", "cold"], "smoke-test.exp": ["sag"]}


def test_a_unit_may_be_without(tmp_path: Path) -> None:
    path = build(load_parameters(), tmp_path / "EMCAS.fmu", references=False).path
    with zipfile.ZipFile(path) as archive:
        assert not [name for name in archive.namelist() if name.startswith("extra/") or name == TEXT]


# Where the responses come from ----------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Mapping[str, Any]]:
    """The parameters that were integrated, by something quick, with a cache of its own."""
    seen: list[Mapping[str, Any]] = []

    def simulate(values: Mapping[str, Any], inputs: Mapping[str, Any]) -> Mapping[str, Any]:
        seen.append(values)
        return {"time": inputs["time"], "fin_angle": inputs["fin_command"] / 3.0}

    monkeypatch.setattr(files, "simulator", lambda model: simulate)
    monkeypatch.setattr(responses, "cache_directory", lambda: tmp_path)
    return seen


def test_a_response_is_integrated_once(counted: list[Mapping[str, Any]]) -> None:
    parameters = load_parameters().with_values(CUSTOM)
    first, second = (responses.response(parameters, STEP_AND_LOAD) for _ in range(2))
    assert len(counted) == 1
    assert {name: column.tolist() for name, column in first.items()} == {
        name: column.tolist() for name, column in second.items()}
    responses.response(parameters.with_values({"solver.max_tick": 1e-4}), STEP_AND_LOAD)  # none of the integration's
    assert len(counted) == 1
    responses.response(parameters.with_values({"motor.resistance": 0.31}), STEP_AND_LOAD)
    responses.response(parameters, CASES[0])
    assert len(counted) == 3


def test_the_oldest_responses_go(counted: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
                                 ) -> None:
    monkeypatch.setattr(responses, "_KEPT", 2)
    for resistance in (0.31, 0.32, 0.33):
        responses.response(load_parameters().with_values({"motor.resistance": resistance}), STEP_AND_LOAD)
    assert len(list((tmp_path / "references").iterdir())) == 2


def test_stored_responses_are_integrated_never(counted: list[Mapping[str, Any]]) -> None:
    made()
    made(fins=4)
    assert not counted


def test_without_a_cache_it_is_integrated_each_time(counted: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch
                                                    ) -> None:
    def none() -> Path:
        raise OSError("read-only")

    monkeypatch.setattr(responses, "cache_directory", none)
    for _ in range(2):
        responses.response(load_parameters().with_values(CUSTOM), STEP_AND_LOAD)
    assert len(counted) == 2


def test_gravity_makes_a_fins_place_matter(counted: list[Mapping[str, Any]]) -> None:
    """Of a fin without weight it is none of what a response follows from: four fins alike are stored."""
    turned = load_parameters().with_values({"mounting.azimuth": "45 deg"})
    assert responses.shipped(turned, named("step")) is not None
    assert responses.shipped(turned.with_values({"loads.gravity": True}), named("step")) is None


def named(name: str) -> Case:
    return next(case for case in CASES if case.name == name)


@pytest.mark.parametrize(("gives", "said"), [
    ("parameters['spring']", "KeyError('spring')"), ("{'time': inputs['time']}", "KeyError('fin_angle')"),
    ("{**inputs, 'fin_angle': inputs['fin_command'] * float('nan')}", "fin_angle is not finite"),
    ("{**inputs, 'fin_angle': inputs['fin_command'][1:]}", "shape")])
def test_an_integration_that_fails_is_said_and_replaced(gives: str, said: str, tmp_path: Path) -> None:
    path = changed(tmp_path, ("direct_drive_reference.py", "broken.py"))
    (tmp_path / "broken.py").write_text(f"def simulate(parameters, inputs):\n    return {gives}\n")
    contents, warnings = made(str(path))
    assert len(warnings) == 1
    assert warnings[0].startswith("the independent integration of step_and_load failed (")
    assert said in warnings[0]
    assert f"{FOLDER}/smoke-test.exp" in contents


def test_a_unit_that_is_off_its_integration_is_warned_of(counted: list[Mapping[str, Any]]) -> None:
    _, (warning,) = made(values=CUSTOM)
    assert len(counted) == 1
    assert re.match(r"step_and_load: fin_angle differs by up to 6\.\d deg from the independent integration", warning)


def test_digits_are_those_of_any_machine() -> None:
    """What another machine's rounding does to an integration changes no digit here.

    With other step sizes, 3 % off, the integration gives values that differ by 1e-15 rad and 5e-12 A; 1e-12 of every
    value is more. That an edge is so near to one of the 1757 numbers has a chance of less than 1 %.
    """
    parameters = load_parameters().with_values(CUSTOM)
    unit = FmuInterface(1)
    columns = responses.response(parameters, files.suited(STEP_AND_LOAD, parameters.model, parameters.values))
    other = {name: column * (1.0 + 1e-12) for name, column in columns.items()}
    assert files.csv_text(references._rounded(unit, other)) == files.csv_text(references._rounded(unit, columns))
