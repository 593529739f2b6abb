"""Every tool runs every actuator, or refuses it for a reason in docs/tools/README.md."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu import simulate
from emcas_fmu.actuators import NAMES, get
from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import compiler, library
from tests import studies
from tests.fmu.built import lean
from tests.own_actuator.example import FOLDER
from tests.own_actuator.example import MODEL as DIRECT_DRIVE

# The option sets of tests/extensions/test_together.py.
TOGETHER = ("nonlinear+lugre+heat+homing+supply+faults", "elastic+stribeck+efficiency+heat+homing+supply+faults",
            "ristanovic+stribeck+efficiency+heat+homing+supply+faults", "second-order+faults")
FURTHER = tuple(str(FOLDER / f"{name}.py") for name in ("strain_wave", "hot_gas"))
ACTUATORS = (*NAMES, DIRECT_DRIVE, *FURTHER, *TOGETHER)
# Its cases are not marked slow: the tools have no other tests of a user's actuator. All others together take minutes.
ALWAYS = (DIRECT_DRIVE,)
PAGE = Path(__file__).resolve().parents[2] / "docs" / "tools" / "README.md"


def gain(model: str) -> tuple[str, str, str]:
    """Return a gain or natural frequency of an actuator, and texts of 95 and 105 % of its value."""
    base = load_parameters(model=model)
    parameter = next(v for v in get(model).parameters
                     if v.name in ("controller.position.kp", "controller.kp", "second_order.natural_frequency"))
    lower, upper = (f"{share * base.values[parameter.name]!r} {parameter.unit}" for share in (0.95, 1.05))
    return parameter.name, lower, upper


def written(folder: Path, text: str) -> str:
    """Write a text to a file, and return its path; a parameter file without text changes nothing."""
    path = folder / "written.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def unit(folder: Path, model: str) -> str:
    """Build an actuator's FMU for this platform; without an FMU, `ssp` builds one for every platform."""
    return str(lean(load_parameters(model=model), folder / "unit.fmu"))


def record(folder: Path, model: str) -> str:
    """Write the step response of an actuator to a file, and return its path."""
    path = folder / "record.csv"
    simulate(load_parameters(model=model), stop=0.2, fin_command="2 deg").write_csv(path)
    return str(path)


TOOLS: dict[str, Callable[[Path, str], list[str]]] = {
    "parameters": lambda folder, model: [],
    "init": lambda folder, model: [str(folder / "mine")],
    "build": lambda folder, model: ["-o", str(folder / "one.fmu")],
    "build --fins": lambda folder, model: ["--fins", "4", "-o", str(folder / "four.fmu")],
    "simulate": lambda folder, model: ["--step", "2", "--stop", "0.1", "-o", str(folder / "a.csv")],
    "simulate --fins": lambda folder, model: ["--fins", "2", "--step", "2", "--stop", "0.06"],
    "validate": lambda folder, model: ["--case", "step_plus1", "--report", str(folder / "v.html")],
    "report": lambda folder, model: ["-o", str(folder / "r.html"), "--json", str(folder / "r.json")],
    "compare": lambda folder, model: ["default", "--report", str(folder / "c.html")],
    "baseline": lambda folder, model: ["record", written(folder, ""), "-o", str(folder / "baseline")],
    "tune": lambda folder, model: [
        written(folder, studies.tuning(*gain(model))), "--generations", "1", "--workers", "1"],
    "calibrate": lambda folder, model: [record(folder, model), "--free", gain(model)[0], "--compare", "fin_angle"],
    "analyse": lambda folder, model: [  # with a smaller command limit, hence fewer amplitudes
        "-p", written(folder, '[command]\nlimit = "4 deg"\n'), "--json", str(folder / "analysis.json")],
    "campaign": lambda folder, model: [
        written(folder, studies.campaign(gain(model)[0])), "-o", str(folder / "c"), "--workers", "0"],
    "ssp": lambda folder, model: [
        *(() if model in ALWAYS else ("--fmu", unit(folder, model))), "-o", str(folder / "four.ssp")],
    "explore": lambda folder, model: ["-o", str(folder / "e.html")],
    "reference": lambda folder, model: ["--directory", str(folder), "--case", "step_plus1"],
}


def reasons(tool: str) -> list[str]:
    """Return the messages with which the tool refuses actuators: the texts in quotes in its row of the page."""
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{tool.split()[0]}`")]
    assert rows, f"{PAGE.name} has no row of {tool}"
    return re.findall(r"“([^”]+)”", " ".join(rows))


# ssp compiles for every platform, explore for browsers; these libraries do not run here.
CROSS_COMPILING = ("explore", "ssp")
# tests/acceptance, analysis, fmu and campaign have quick tests of these tools with a user's actuator.
TESTED_QUICKLY = ("report", "analyse", "build --fins", "campaign")
# tests/acceptance runs `emcas report` of these actuators, and tests/explore runs the pages of these.
TESTED_ELSEWHERE = {"report": {*NAMES, TOGETHER[1]}, "explore": {*NAMES, DIRECT_DRIVE, *TOGETHER}}
CASES = [(model, tool) for model in ACTUATORS for tool in TOOLS if model not in TESTED_ELSEWHERE.get(tool, ())]


@pytest.mark.parametrize(("model", "tool"), [
    pytest.param(model, tool, id=f"{Path(model).stem}-{tool}", marks=[
        *([pytest.mark.drawn] if model in ALWAYS or tool == "build" else []),
        *([] if model in ALWAYS and tool not in (*CROSS_COMPILING, *TESTED_QUICKLY) else [pytest.mark.slow])])
    for model, tool in CASES])
def test_tool_runs_an_actuator_or_gives_the_documented_reason(model: str, tool: str, tmp_path: Path,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 1 means missed requirements: the thesis's do not apply to actuators of other kinds."""
    monkeypatch.chdir(tmp_path)
    command, arguments = tool.split()[0], TOOLS[tool](tmp_path, model)
    if tool in CROSS_COMPILING and library.available(model):  # after the kernel for this machine has been compiled
        monkeypatch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
    done = CliRunner().invoke(app, [command, *arguments, "--model", model])
    if done.exit_code == 2:
        message = " ".join(done.stderr.split())
        assert any(reason in message for reason in reasons(tool)), message
        return
    codes = (0, 1) if command in ("validate", "report", "tune", "calibrate") else (0,)
    assert done.exit_code in codes, done.output + done.stderr
