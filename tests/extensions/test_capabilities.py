"""Each capability on an actuator that has it and nothing else, through every extension and tool that needs it."""

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
from emcas_fmu.studies.analysis.analyse import SECTIONS, analyse
from emcas_fmu.studies.analysis.report import figures_of, write_report
from tests.marks import others_slow
from tests.own_actuator.least import least, written

ALL = tuple(capabilities.NEEDED_VARIABLES)
FEW = others_slow(ALL, lambda words: words in ALL[::4])
DEAR = others_slow(ALL, lambda words: words == capabilities.CASCADE)  # dozens of seconds for all


def loaded(folder: Path, *provided: str, extension: str = "") -> ParameterSet:
    return load_parameters(model=written(folder, *provided) + extension)


def moves(parameters: ParameterSet, **changes: object) -> None:
    """A step of 3 deg and a load, in generated code."""
    values = parameters.with_values(dict(changes)).values
    run = simulate(values, 0.1, model=parameters.model, kernel="python", fin_command=radians(3.0), aero_torque=-5.0)
    assert all(np.isfinite(column).all() for column in run.values())


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_an_extension_needs_no_more_than_it_says(extension: str, tmp_path: Path) -> None:
    parameters = loaded(tmp_path, *get_extension(extension).needs, extension=f"+{extension}")
    moves(parameters)
    if extension == "homing":
        moves(parameters, **{"homing.required": True})


@pytest.mark.parametrize("words", FEW)
def test_faults_and_monitors_need_no_more_than_they_say(words: str, tmp_path: Path) -> None:
    """Those that a capability adds, all active at once."""
    parameters = loaded(tmp_path, words, extension="+faults")
    actuator = get(parameters.model)
    moves(parameters, **{f"fault.{fault.name}.active": True for fault in fault_list.possible(actuator)})
    assert len(monitors.possible(actuator)) >= 2


def test_faults_and_monitors_of_several_capabilities(tmp_path: Path) -> None:
    for monitor in monitors.MONITORS:
        folder = tmp_path / monitor.name
        folder.mkdir()
        moves(loaded(folder, *monitor.needs, extension="+faults"))


@pytest.mark.parametrize("words", DEAR)
def test_the_analysis_needs_no_more_than_it_says(words: str, tmp_path: Path) -> None:
    parameters = loaded(tmp_path, *dict.fromkeys((POSITION_LOOP, words))).with_values({"command.limit": "2 deg"})
    found = analyse(parameters, locus_name="controller.kp")
    json.dumps(figures_of(found), allow_nan=False)
    write_report(found, tmp_path / "page.html")


@pytest.mark.drawn
@pytest.mark.parametrize("section", others_slow(SECTIONS, lambda section: section == "modes"))
def test_a_section_of_the_analysis_needs_no_more_than_it_says(section: str, tmp_path: Path) -> None:
    needs = dict.fromkeys((POSITION_LOOP, *SECTIONS[section][1]))
    parameters = loaded(tmp_path, *needs).with_values({"command.limit": "2 deg"})
    found = analyse(parameters, locus_name="controller.kp")
    assert section not in found.left_out
    json.dumps(figures_of(found), allow_nan=False)
    write_report(found, tmp_path / "page.html")


FIGURES: dict[str, tuple[tuple[str, ...], str, Callable[[ParameterSet], object]]] = {
    "envelope": (envelope.NEEDS, "+heat", lambda parameters: envelope.envelope(parameters, 10.0)),
    "capability": (capability.NEEDS, "", lambda parameters: capability.capability(parameters.values, parameters.model)),
    "figures of parameters": ((*capability.NEEDS, capabilities.SCREW_AND_LEVER), "", overview.amounts_to),
    "stall": (capability.NEEDS, "", lambda parameters: list(overview.stalled(parameters, 1e6))),
}


@pytest.mark.parametrize("figure", FIGURES)
def test_a_figure_needs_no_more_than_it_says(figure: str, tmp_path: Path) -> None:
    needs, extension, compute = FIGURES[figure]
    assert compute(loaded(tmp_path, *dict.fromkeys(needs), extension=extension))


@pytest.mark.parametrize("words", DEAR)
def test_the_other_commands_need_no_more_than_the_fin_port(words: str, tmp_path: Path) -> None:
    model = written(tmp_path, words)
    for command in (["parameters"], ["build", "-o", str(tmp_path / "one.fmu"), "--backend", "python"],
                    ["init", str(tmp_path / "mine")], ["simulate", "--step", "2", "--stop", "0.1"]):
        done = CliRunner().invoke(app, [command[0], "--model", model, *command[1:]])
        assert done.exit_code == 0, (command[0], done.output)


@pytest.mark.parametrize("words", [words for words in ALL if capabilities.NEEDED_PARAMETERS[words]])
def test_a_parameter_of_shared_equations_is_asked_for(words: str) -> None:
    actuator = least(words)
    name = capabilities.NEEDED_PARAMETERS[words][-1]
    fields = {field: getattr(actuator, field) for field in ("states", "controller_states", "sample", "derivatives",
                                                            "output_values", "supply", "encoder", "outputs")}
    without = tuple(v for v in actuator.parameters if v.name != name)
    with pytest.raises(EmcasError, match=f"which needs {name}"):
        Actuator(name="less", title="less", parameters=without, provides=frozenset({words}), **fields)
