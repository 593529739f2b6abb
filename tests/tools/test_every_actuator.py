"""Every actuator through every tool: what a tool refuses, docs/tools/README.md gives the reason for."""

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
# A user's, for which the tools have no other tests; the others take minutes together.
ALWAYS = (DIRECT_DRIVE,)
PAGE = Path(__file__).resolve().parents[2] / "docs" / "tools" / "README.md"


def gain(model: str) -> tuple[str, str, str]:
    """A parameter that an actuator of any kind has, and 95 and 105 % of it: a gain, or how fast the fin follows."""
    base = load_parameters(model=model)
    parameter = next(v for v in get(model).parameters
                     if v.name in ("controller.position.kp", "controller.kp", "second_order.natural_frequency"))
    lower, upper = (f"{share * base.values[parameter.name]!r} {parameter.unit}" for share in (0.95, 1.05))
    return parameter.name, lower, upper


def written(folder: Path, text: str) -> str:
    """A file with a text; a parameter file that changes nothing has none."""
    path = folder / "written.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def unit(folder: Path, model: str) -> str:
    """Return an actuator's FMU for this platform; without one `ssp` builds for every platform, as for ALWAYS."""
    return str(lean(load_parameters(model=model), folder / "unit.fmu"))


def recorded(folder: Path, model: str) -> str:
    """A record of an actuator's step."""
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
    "calibrate": lambda folder, model: [recorded(folder, model), "--free", gain(model)[0], "--compare", "fin_angle"],
    "analyse": lambda folder, model: [  # within a limit that fewer amplitudes reach than the shipped one
        "-p", written(folder, '[command]\nlimit = "4 deg"\n'), "--json", str(folder / "analysis.json")],
    "campaign": lambda folder, model: [
        written(folder, studies.campaign(gain(model)[0])), "-o", str(folder / "c"), "--workers", "0"],
    "ssp": lambda folder, model: [
        *(() if model in ALWAYS else ("--fmu", unit(folder, model))), "-o", str(folder / "four.ssp")],
    "explore": lambda folder, model: ["-o", str(folder / "e.html")],
    "reference": lambda folder, model: ["--directory", str(folder), "--case", "step_plus1"],
}


def reasons(tool: str) -> list[str]:
    """What the page says `emcas TOOL` refuses with: the texts in quotes in its row."""
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{tool.split()[0]}`")]
    assert rows, f"{PAGE.name} has no row of {tool}"
    return re.findall(r"“([^”]+)”", " ".join(rows))


# ssp compiles for every platform, explore for browsers; what is compiled for them is not run.
ELSEWHERE = ("explore", "ssp")
# Of a user's actuator tests/acceptance, analysis, fmu and campaign have quick tests, too.
DEAR = ("report", "analyse", "build --fins", "campaign")
# tests/acceptance runs `emcas report` of the shipped actuators and of an elastic line with options; tests/explore
# makes and runs the pages of all but FURTHER.
OTHERS = {"report": {*NAMES, TOGETHER[1]}, "explore": {*NAMES, DIRECT_DRIVE, *TOGETHER}}
CASES = [(model, tool) for model in ACTUATORS for tool in TOOLS if model not in OTHERS.get(tool, ())]


@pytest.mark.parametrize(("model", "tool"), [
    pytest.param(model, tool, id=f"{Path(model).stem}-{tool}", marks=[
        *([pytest.mark.drawn] if model in ALWAYS or tool == "build" else []),
        *([] if model in ALWAYS and tool not in (*ELSEWHERE, *DEAR) else [pytest.mark.slow])])
    for model, tool in CASES])
def test_a_tool_serves_an_actuator_or_says_why_not(model: str, tool: str, tmp_path: Path,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 1 is a verdict: the thesis's requirements are not those of an actuator of another kind."""
    monkeypatch.chdir(tmp_path)
    command, arguments = tool.split()[0], TOOLS[tool](tmp_path, model)
    if tool in ELSEWHERE and library.available(model):  # the kernel that runs here is compiled as ever
        monkeypatch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
    done = CliRunner().invoke(app, [command, *arguments, "--model", model])
    if done.exit_code == 2:
        said = " ".join(done.stderr.split())
        assert any(reason in said for reason in reasons(tool)), said
        return
    judged = (0, 1) if command in ("validate", "report", "tune", "calibrate") else (0,)
    assert done.exit_code in judged, done.output + done.stderr
