"""Extensions and tools run on an actuator that provides the capabilities they need, and no others."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import radians
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.actuators import EXTENSIONS, capabilities, get, get_extension
from emcas_fmu.actuators.capabilities import POSITION_LOOP
from emcas_fmu.actuators.declaration import Actuator
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions import fault_list, monitors
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies import overview
from emcas_fmu.studies.analysis import capability, envelope
from emcas_fmu.studies.analysis.analyse import SECTIONS, Analysis, analyse
from emcas_fmu.studies.analysis.report import figures_of, write_report
from tests.marks import others_slow
from tests.own_actuator.least import least, written

ALL = tuple(capabilities.NEEDED_VARIABLES)
FEW = others_slow(ALL, lambda needed: needed in ALL[::4])
EXPENSIVE = others_slow(ALL, lambda needed: needed == capabilities.CASCADE)  # all take a minute


def loaded(folder: Path, *provided: str, extension: str = "") -> ParameterSet:
    return load_parameters(model=written(folder, *provided) + extension)


def assert_finite_run(parameters: ParameterSet, **changes: object) -> None:
    """Check that a step of 3 deg under a load is finite, in generated code."""
    values = parameters.with_values(dict(changes)).values
    run = simulate(values, 0.1, model=parameters.model, kernel="python", fin_command=radians(3.0), aero_torque=-5.0)
    assert all(np.isfinite(column).all() for column in run.values())


def assert_report(folder: Path, *provided: str) -> Analysis:
    """Return the analysis of an actuator after a check that its figures are finite and its page can be written."""
    parameters = loaded(folder, *dict.fromkeys(provided)).with_values({"command.limit": "2 deg"})
    result = analyse(parameters, locus_name="controller.kp")
    json.dumps(figures_of(result), allow_nan=False)
    write_report(result, folder / "page.html")
    return result


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_an_extension_needs_only_the_capabilities_it_names(extension: str, tmp_path: Path) -> None:
    parameters = loaded(tmp_path, *get_extension(extension).needs, extension=f"+{extension}")
    assert_finite_run(parameters)
    if extension == "homing":
        assert_finite_run(parameters, **{"homing.required": True})


@pytest.mark.parametrize("needed", FEW)
def test_faults_and_monitors_need_only_the_capabilities_they_name(needed: str, tmp_path: Path) -> None:
    """All faults and monitors that a capability makes possible are active at once."""
    parameters = loaded(tmp_path, needed, extension="+faults")
    actuator = get(parameters.model)
    assert_finite_run(parameters, **{f"fault.{fault.name}.active": True for fault in fault_list.possible(actuator)})
    assert len(monitors.possible(actuator)) >= 2


def test_a_monitor_that_needs_several_capabilities(tmp_path: Path) -> None:
    for monitor in monitors.MONITORS:
        folder = tmp_path / monitor.name
        folder.mkdir()
        assert_finite_run(loaded(folder, *monitor.needs, extension="+faults"))


@pytest.mark.parametrize("needed", EXPENSIVE)
def test_the_analysis_needs_only_the_capabilities_it_names(needed: str, tmp_path: Path) -> None:
    assert_report(tmp_path, POSITION_LOOP, needed)


@pytest.mark.drawn
@pytest.mark.parametrize("section", others_slow(SECTIONS, lambda section: section == "modes"))
def test_a_section_of_the_analysis_needs_only_the_capabilities_it_names(section: str, tmp_path: Path) -> None:
    assert section not in assert_report(tmp_path, POSITION_LOOP, *SECTIONS[section][1]).left_out


FIGURES: dict[str, tuple[tuple[str, ...], str, Callable[[ParameterSet], object]]] = {
    "envelope": (envelope.NEEDS, "+heat", lambda parameters: envelope.envelope(parameters, 10.0)),
    "capability": (capability.NEEDS, "", lambda parameters: capability.capability(parameters.values, parameters.model)),
    "figures of parameters": ((*capability.NEEDS, capabilities.SCREW_AND_LEVER), "", overview.amounts_to),
    "stall": (capability.NEEDS, "", lambda parameters: list(overview.stalled(parameters, 1e6))),
}


@pytest.mark.parametrize("figure", FIGURES)
def test_a_figure_needs_only_the_capabilities_it_names(figure: str, tmp_path: Path) -> None:
    needs, extension, compute = FIGURES[figure]
    assert compute(loaded(tmp_path, *dict.fromkeys(needs), extension=extension))


@pytest.mark.parametrize("needed", EXPENSIVE)
def test_the_other_commands_need_only_the_fin_port(needed: str, tmp_path: Path) -> None:
    model = written(tmp_path, needed)
    for command in (["parameters"], ["build", "-o", str(tmp_path / "one.fmu"), "--backend", "python"],
                    ["init", str(tmp_path / "mine")], ["simulate", "--step", "2", "--stop", "0.1"]):
        done = CliRunner().invoke(app, [command[0], "--model", model, *command[1:]])
        assert done.exit_code == 0, (command[0], done.output)


@pytest.mark.parametrize("needed", [needed for needed in ALL if capabilities.NEEDED_PARAMETERS[needed]])
def test_a_capability_without_its_parameter_is_refused(needed: str) -> None:
    actuator = least(needed)
    name = capabilities.NEEDED_PARAMETERS[needed][-1]
    fields = {field: getattr(actuator, field) for field in ("states", "controller_states", "sample", "derivatives",
                                                            "output_values", "supply", "encoder", "outputs")}
    without = tuple(v for v in actuator.parameters if v.name != name)
    with pytest.raises(EmcasError, match=f"which needs {name}"):
        Actuator(name="least", title="least", parameters=without, provides=frozenset({needed}), **fields)
