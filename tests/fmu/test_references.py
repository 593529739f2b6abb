"""Embedded references: a user can repeat them from the archive alone, and their files claim only what is true."""

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
from emcas_fmu.reference.cases import CASES, STEP_AND_LOAD
from emcas_fmu.simulation import simulate
from emcas_fmu.ssp.archive import SSV, parse, violations

from ..docs.recipes import ROOT, recipes
from ..own_actuator.example import MODEL as DIRECT_DRIVE
from ..own_actuator.example import changed

LIMIT = 0.002  # deg, the limit of `emcas validate`
INDEPENDENT, RECORDED = "experiment/validation", "experiment/smoke-test"
PAGE = "use/references.md"
CUSTOM = {"motor.resistance": 0.3, "friction.fin_coulomb": 3.0}


def repeated(unit: Path, folder: Path) -> dict[str, tuple[str, float]]:
    """Run the program of docs/use/references.md; return role and largest difference [deg] of each experiment."""
    program = recipes(PAGE)["fmpy"][1] + "\nimport sys\nassert 'emcas_fmu' not in sys.modules\n"
    (folder / "EMCAS.fmu").write_bytes(unit.read_bytes())
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=folder, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    return printed(done.stdout)


def printed(text: str) -> dict[str, tuple[str, float]]:
    """Return role and difference [deg] by experiment from the program's output."""
    return {name: (role, float(difference))
            for role, name, difference in re.findall(r"^(\S+) (\S+): (\S+) deg$", text, re.MULTILINE)}


Make = Callable[[Callable[..., Path], Path], Path]


def shipped(*arguments: Any, **options: Any) -> Make:
    """Return a function that returns the shared FMU of the default actuator."""
    return lambda shipped_unit, _: shipped_unit(*arguments, **options)


def built(model: str, **options: Any) -> Make:
    """Return a function that builds an FMU of a model."""
    return lambda _, folder: build(load_parameters(model=model), folder / "unit.fmu", **options).path


def custom(_: Callable[..., Path], folder: Path) -> Path:
    return build(load_parameters().with_values(CUSTOM), folder / "unit.fmu").path


STORED, ONE, FINS = ["step", "load_opposing", "cold", "sag"], ["step_and_load"], ["fins"]


@pytest.mark.parametrize("tick", [0.7e-3, 0.2e-3])
def test_text_states_the_error_of_the_stepping(tick: float) -> None:
    """The difference between the core with this tick and the independent integration."""
    parameters = load_parameters().with_values({**CUSTOM, "solver.max_tick": tick})
    contents, *_ = reference_files(FmuInterface(1), (parameters,), FORMATS["2"])
    (stated,) = re.findall(r"differs from these results by up to (\S+) deg", contents[TEXT].decode())
    case = files.suited(STEP_AND_LOAD, parameters.model, parameters.values)
    inputs: dict[str, Any] = {name: column for name, column in case.inputs().items() if name != "time"}
    run = simulate({**parameters.values, **case.overrides}, case.stop_time, case.step, **inputs)
    error = np.max(np.abs(run["fin_angle"] - responses.response(parameters, case)["fin_angle"]))
    assert float(stated) == pytest.approx(math.degrees(error), rel=0.05)  # the text has two digits


@pytest.mark.fmu
@pytest.mark.parametrize(("make", "names", "role"), [
    pytest.param(shipped("python", 4), FINS, INDEPENDENT, id="four fins"),
    pytest.param(shipped(fmi="3"), STORED, INDEPENDENT, id="FMI 3.0"),
    pytest.param(shipped(fins=4, fmi="3"), FINS, INDEPENDENT, id="FMI 3.0, four fins", marks=pytest.mark.slow),
    pytest.param(shipped(fins=4, names="flat"), FINS, INDEPENDENT, id="flat", marks=pytest.mark.slow),
    pytest.param(built("elastic+heat+homing+faults"), ONE, RECORDED, id="options", marks=pytest.mark.slow),
    pytest.param(custom, ONE, INDEPENDENT, id="custom"),
    pytest.param(built("second-order"), ONE, RECORDED, id="second-order"),
    pytest.param(built("nonlinear+homing+faults"), STORED, INDEPENDENT, id="neutral options", marks=pytest.mark.slow),
    *(pytest.param(built(name), ONE, INDEPENDENT, id=name, marks=pytest.mark.slow) for name in (
        "electrohydraulic", "electrohydrostatic", "worm-gear", "worm-gear-elastic", "clutch", "series-clutch")),
    pytest.param(built(DIRECT_DRIVE), ONE, INDEPENDENT, id="own actuator", marks=pytest.mark.slow),
    pytest.param(built("clutch+faults", fins=3), FINS, INDEPENDENT, id="three clutches", marks=pytest.mark.slow)])
def test_documented_program_repeats_the_references(make: Make, names: list[str], role: str,
                                                   shipped_unit: Callable[..., Path], tmp_path: Path) -> None:
    results = repeated(make(shipped_unit, tmp_path), tmp_path)
    assert list(results) == names
    assert all(each == role and difference <= LIMIT for each, difference in results.values()), results


@pytest.mark.fmu
@pytest.mark.parametrize("backend", ["python", "native"])
def test_page_shows_the_output_for_the_default_fmu(backend: str, units: Mapping[str, Path], tmp_path: Path) -> None:
    results = repeated(units[backend], tmp_path)
    assert results == printed((ROOT / "docs" / PAGE).read_text("utf-8"))
    assert all(difference <= LIMIT for _, difference in results.values())


@pytest.mark.fmu
def test_program_uses_the_start_values(fmu: Path, tmp_path: Path) -> None:
    """If the start values leave the encoder on, the differences are far above the limit."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(tmp_path / "encoder.fmu", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, content.replace(b'"false"', b'"true"') if name.endswith(".ssv") else content)
    assert all(difference > 10 * LIMIT for _, difference in repeated(tmp_path / "encoder.fmu", tmp_path).values())


# Contents of the files ------------------------------------------------------------------------------------


def files_and_warnings(model: str = "nonlinear", fins: int = 1, values: Mapping[str, Any] | None = None
                       ) -> tuple[dict[str, bytes], tuple[str, ...]]:
    parameters = load_parameters(model=model).with_values(values or {})
    return reference_files(FmuInterface(fins, model), [parameters] if fins == 1 else fin_sets(parameters, fins),
                           FORMATS["2"])[:2]


def xml(contents: Mapping[str, bytes], name: str) -> Element:
    return fromstring(contents[f"{FOLDER}/{name}"])


@pytest.mark.parametrize(("model", "fins"), [("nonlinear", 1), ("nonlinear", 4), ("second-order", 2),
                                             ("elastic+homing", 1)])
def test_manifest_lists_every_file_with_its_role(model: str, fins: int) -> None:
    """Roles and attributes follow the schema of FMI-LS-REF, with which the files were validated by hand."""
    contents, warnings = files_and_warnings(model, fins)
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
def test_tables_and_start_values_have_names_of_the_fmus_variables(model: str, fins: int) -> None:
    contents, _ = files_and_warnings(model, fins)
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
            starts = {each.get("name"): each[0].get("value") for each in root.iterfind(f".//{{{SSV}}}Parameter")}
            switches = {unit.name("encoder.enabled", fin) for fin in range(fins)}
            assert switches <= starts.keys() <= {n for n, each in causality.items() if each == "parameter"}
            assert all(starts[each] == "false" for each in switches)
    for experiment in xml(contents, "validation.exp" if model == "nonlinear" else "smoke-test.exp"):
        assert {each.tag: each.attrib["source"] for each in experiment} == {
            tag: f"{experiment.attrib['name']}{ending}" for tag, ending in (
                ("Parameters", ".ssv"), ("Stimuli", "_in.csv"), ("References", "_ref.csv"))}


def test_each_fin_has_its_own_motion() -> None:
    contents, _ = files_and_warnings(fins=4)
    header, *rows = csv.reader(contents[f"{FOLDER}/fins_ref.csv"].decode().splitlines())
    angles = {name: math.degrees(float(rows[-1][k])) for k, name in enumerate(header) if name.endswith("fin_angle")}
    # An overshoot is still decaying at the end: at most 1 deg of 20.
    assert list(angles) == [f"fin[{fin}].fin_angle" for fin in (1, 2, 3, 4)]
    assert list(angles.values()) == pytest.approx([10.0, -5.0, 20.0, -1.0], rel=0.05)


def test_fin_with_other_parameters_has_another_response() -> None:
    unit = FmuInterface(2, "second-order")
    equal, _ = files_and_warnings("second-order", 2)
    slow = load_parameters(model="second-order").with_values({"second_order.natural_frequency": 150.0})
    different, *_ = reference_files(unit, [load_parameters(model="second-order"), slow], FORMATS["2"])
    one, other = (np.genfromtxt(contents[f"{FOLDER}/fins_ref.csv"].decode().splitlines(), delimiter=",", names=True,
                                deletechars="") for contents in (equal, different))
    assert np.array_equal(one["fin[1].fin_angle"], other["fin[1].fin_angle"])
    assert not np.array_equal(one["fin[2].fin_angle"], other["fin[2].fin_angle"])


@pytest.mark.parametrize(("model", "file", "statement"), [
    ("nonlinear+faults", "validation.exp", "independent integration (emcas_fmu.reference.plant)"),
    ("nonlinear+heat", "smoke-test.exp", "no independent\nintegration of nonlinear+heat in this case"),
    ("linear", "smoke-test.exp", "no independent\nintegration of linear in this case")])
def test_text_claims_independence_only_of_an_independent_integration(model: str, file: str, statement: str) -> None:
    contents, _ = files_and_warnings(model)
    assert [name for name in contents if name.endswith(".exp")] == [f"{FOLDER}/{file}"]
    assert statement in contents[TEXT].decode()


def test_case_with_an_active_fault_is_only_a_smoke_test() -> None:
    """The jam at 0.9 s affects only the case `sag`, in which the fin still moves."""
    contents, _ = files_and_warnings("nonlinear+faults", values={"fault.jam.begin": 0.9, "fault.jam.end": 2.0})
    experiments = {name: [each.attrib["name"] for each in xml(contents, name)]
                   for name in ("validation.exp", "smoke-test.exp")}
    assert experiments == {"validation.exp": ["step", "load_opposing", "cold"], "smoke-test.exp": ["sag"]}


def test_references_can_be_omitted(tmp_path: Path) -> None:
    path = build(load_parameters(), tmp_path / "EMCAS.fmu", references=False).path
    with zipfile.ZipFile(path) as archive:
        assert not [name for name in archive.namelist() if name.startswith("extra/") or name == TEXT]


# Cache of the responses -----------------------------------------------------------------------------------


@pytest.fixture
def integrations(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Mapping[str, Any]]:
    """Replace the integration by a quick function, and return a list of the parameter sets that it integrates."""
    sets: list[Mapping[str, Any]] = []

    def simulate(values: Mapping[str, Any], inputs: Mapping[str, Any]) -> Mapping[str, Any]:
        sets.append(values)
        return {"time": inputs["time"], "fin_angle": inputs["fin_command"] / 3.0}

    monkeypatch.setattr(files, "simulator", lambda model: simulate)
    monkeypatch.setattr(responses, "cache_directory", lambda: tmp_path)
    return sets


def test_a_response_is_integrated_once(integrations: list[Mapping[str, Any]]) -> None:
    parameters = load_parameters().with_values(CUSTOM)
    first, second = (responses.response(parameters, STEP_AND_LOAD) for _ in range(2))
    assert len(integrations) == 1
    assert {name: column.tolist() for name, column in first.items()} == {
        name: column.tolist() for name, column in second.items()}
    responses.response(parameters.with_values({"solver.max_tick": 1e-4}), STEP_AND_LOAD)  # the integration has no tick
    assert len(integrations) == 1
    responses.response(parameters.with_values({"motor.resistance": 0.31}), STEP_AND_LOAD)
    responses.response(parameters, CASES[0])
    assert len(integrations) == 3


def test_cache_deletes_the_oldest_responses(integrations: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch,
                                            tmp_path: Path) -> None:
    monkeypatch.setattr(responses, "_KEPT", 2)
    for resistance in (0.31, 0.32, 0.33):
        responses.response(load_parameters().with_values({"motor.resistance": resistance}), STEP_AND_LOAD)
    assert len(list((tmp_path / "references").iterdir())) == 2


def test_shipped_responses_are_not_integrated(integrations: list[Mapping[str, Any]]) -> None:
    files_and_warnings()
    files_and_warnings(fins=4)
    assert not integrations


def test_without_a_cache_folder_each_response_is_integrated(integrations: list[Mapping[str, Any]],
                                                            monkeypatch: pytest.MonkeyPatch) -> None:
    def unwritable() -> Path:
        raise OSError("read-only")

    monkeypatch.setattr(responses, "cache_directory", unwritable)
    for _ in range(2):
        responses.response(load_parameters().with_values(CUSTOM), STEP_AND_LOAD)
    assert len(integrations) == 2


def test_azimuth_matters_only_with_gravity() -> None:
    """Without gravity the shipped responses hold for a fin at any azimuth."""
    turned = load_parameters().with_values({"mounting.azimuth": "45 deg"})
    (step,) = (case for case in CASES if case.name == "step")
    assert responses.shipped(turned, step) is not None
    assert responses.shipped(turned.with_values({"loads.gravity": True}), step) is None


@pytest.mark.parametrize(("result", "message"), [
    ("parameters['spring']", "KeyError('spring')"), ("{'time': inputs['time']}", "KeyError('fin_angle')"),
    ("{**inputs, 'fin_angle': inputs['fin_command'] * float('nan')}", "fin_angle is not finite"),
    ("{**inputs, 'fin_angle': inputs['fin_command'][1:]}", "shape")])
def test_failed_integration_is_a_warning_and_leaves_a_smoke_test(result: str, message: str, tmp_path: Path) -> None:
    path = changed(tmp_path, ("direct_drive_reference.py", "broken.py"))
    (tmp_path / "broken.py").write_text(f"def simulate(parameters, inputs):\n    return {result}\n")
    contents, warnings = files_and_warnings(str(path))
    assert len(warnings) == 1
    assert warnings[0].startswith("the independent integration of step_and_load failed (")
    assert message in warnings[0]
    assert f"{FOLDER}/smoke-test.exp" in contents


def test_large_difference_from_the_integration_is_a_warning(integrations: list[Mapping[str, Any]]) -> None:
    _, (warning,) = files_and_warnings(values=CUSTOM)
    assert len(integrations) == 1
    assert re.match(r"step_and_load: fin_angle differs by up to 6\.\d deg from the independent integration", warning)


def test_rounding_of_another_machine_does_not_change_the_digits() -> None:
    """All values are changed by 1e-12 of themselves.

    Step sizes that are 3 % different change the integration's values by 1e-15 rad and 5e-12 A. The chance that this
    change moves one of the 1755 values across a rounding limit of its six digits is below 1 %.
    """
    parameters = load_parameters().with_values(CUSTOM)
    unit = FmuInterface(1)
    columns = responses.response(parameters, files.suited(STEP_AND_LOAD, parameters.model, parameters.values))
    changed_columns = {name: column * (1.0 + 1e-12) for name, column in columns.items()}
    assert files.csv_text(references._rounded(unit, changed_columns)) == files.csv_text(
        references._rounded(unit, columns))
