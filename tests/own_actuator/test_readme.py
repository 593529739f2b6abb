"""The README of own actuators: its code runs or is an excerpt of an example, and its messages are the real ones."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.actuators import capabilities, external, get
from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.homing import EXTENSION
from emcas_fmu.parameters import load_parameters
from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.reference.files import read_csv
from emcas_fmu.simulation import simulate
from tests import studies

from .example import FILE, FOLDER, MODEL, changed
from .test_trial import STATES, inverted, stepped_by

_DECLARATION = re.compile(r"^ACTUATOR = em\.Actuator\(\n.*?^\)\n", re.DOTALL | re.MULTILINE)


def block(name: str) -> str:
    """Return a block of the README by its name."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(rf"<!-- run: {name} -->\n```\w*\n(.*?)```", page, re.DOTALL)
    return str(shown)


def test_every_block_is_run_or_an_excerpt() -> None:
    """In excerpts `...` stands for omitted code; comments are not compared."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?:<!-- (run|excerpt)(?:: [\w-]+)? -->\n)?```(\w*)\n(.*?)```", page, re.DOTALL)
    assert [text for kind, _, text in blocks if not kind] == []
    written = _plain(FILE.read_text(encoding="utf-8"))
    parts = [_plain(part) for kind, _, text in blocks if kind == "excerpt" for part in re.split(r"\.\.\.|\n", text)]
    assert len(parts) > 20
    assert [part for part in parts if part not in written] == []


def _plain(text: str) -> str:
    """Return Python without comments, spaces and line ends."""
    return re.sub(r"\s+", "", re.sub(r"(?m)#.*$", "", text))


# Each message of the README, in its order: changes of the example, and of a parameter file beside it.
_DAMPING = "- p.hinge.damping * x.fin_rate"
_MESSAGES: tuple[tuple[tuple[tuple[str, str], ...], str | None], ...] = (
    ((("p.spring.stiffness * x", "p.spring.stifness * x"),), None),
    ((("    clipped = ops", "    if demand > 0.0: pass\n    clipped = ops"),), None),
    ((("    clipped = ops", "    demand % 2.0\n    clipped = ops"),), None),
    ((('"fin_rate": torque / inertia', '"fin_rte": torque / inertia'),), None),
    ((('"A", "motor current", 10.0', '"A", "motor current", 0.0'),), None),
    ((('"spring.stiffness", "N.m/rad"', '"spring.stiffness", "N.m/rod"'),), None),
    ((('"spring.stiffness": "20 N*m/rad", ', ""),), None),
    ((), "fin.stop_angle = '25 rad'\n"),
    ((("from pathlib", "import random\nfrom pathlib"), (_DAMPING, "- random.random() * x.fin_rate")), None),
    (((_DAMPING, _DAMPING.replace("-", "+")),), None),
    ((("load = em.fin_port.hinge_torque(ops, p, x.fin_angle, u)", "load = 0.0"),), None),
    ((("    sample=sample,", '    initial=lambda ops, p, start: {"fin_angle": 0.1}, sample=sample,'),), None),
    (((_DAMPING, ""),), None),
    ((('"motor_current": x', '"fin_angle": 57.3 * x.fin_angle, "motor_current": x'),), None),
    ((('"motor_current": x', '"measured_fin_angle": -u.measured_fin_angle, "motor_current": x'),), None),
    ((("ops.where(ops.both(inputs.enable, limited), 1.0, 0.0)", "0.0"),), None),
    ((('"supply_power": voltage', '"supply_power": -voltage'),), None),
    (inverted("ops.fabs(x.fin_angle) - p.fin.stop_angle"), None),
    (((_DAMPING, "- 1e-3 / x.fin_rate"),), None),
    (stepped_by(f"{STATES}, 0.0 * h"), None),
)


def message(folder: Path, changes: tuple[tuple[str, str], ...], beside: str | None,
            caplog: pytest.LogCaptureFixture) -> str:
    """Return the error or warning of a simulation of the changed example, with files as the README names them."""
    path = changed(folder, *changes, name="direct_drive.py")
    if beside is not None:
        path.with_suffix(".toml").write_text(beside, encoding="utf-8")
    try:
        simulate(load_parameters(model=str(path)).values, 0.01, kernel="python", model=str(path))
        said = caplog.messages[-1]
    except (EmcasError, ArithmeticError) as error:
        said = str(error)
    return said.replace(f"{folder}/", "")


@pytest.mark.slow
def test_messages_are_those_that_appear(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    shown = "".join(re.findall(r"<!-- run: messages -->\n```\n(.*?)```", page, re.DOTALL)).splitlines()
    for k, (line, (changes, beside)) in enumerate(zip(shown, _MESSAGES, strict=True)):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert message(folder, changes, beside, caplog) == line


def test_a_value_with_a_source(tmp_path: Path) -> None:
    (entry,) = re.findall(r'"motor\.resistance": \{.*?\}', block("values"))
    path = changed(tmp_path, ('"motor.resistance": "0.5 Ohm"', entry))
    sources = {e.variable.name: e.source for e in load_parameters(model=str(path)).entries}
    assert (sources["motor.resistance"], sources["spring.stiffness"]) == ("datasheet", "estimate")


def test_entry_points_have_the_right_group() -> None:
    assert tomllib.loads(block("package"))["project"]["entry-points"].keys() == {external.GROUP}


def run(line: str) -> Result:
    """Run a command of the README where the user is, with the example where it is."""
    words = shlex.split(line.replace("examples/own_actuator", str(FOLDER)), comments=True)
    return CliRunner().invoke(app, words[1:] if words[0] == "emcas" else ["build", *words[2:]])


def commands(*only: str) -> list[str]:
    """Return the lines of the README's blocks of commands, or those that begin with one of `only`."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    lines = "".join(re.findall(r"<!-- run -->\n```sh\n(.*?)```", page, re.DOTALL)).splitlines()
    return [line for line in lines if line.startswith(only or "")]


def test_quick_commands_succeed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for line in commands("emcas simulate", "emcas parameters"):
        done = run(line)
        assert done.exit_code == 0, done.output + done.stderr


@pytest.mark.slow
def test_all_commands_succeed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 1 is a verdict: the actuator need not meet the shipped requirements."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_campaign.toml").write_text(studies.campaign("controller.kp"), encoding="utf-8")
    (tmp_path / "my_requirements.toml").write_text(block("requirements"), encoding="utf-8")
    for line in commands():
        done = run(line)
        judged = (0, 1) if line.split()[1] in ("validate", "report", "tune") else (0,)
        assert done.exit_code in judged, line + done.output + done.stderr


def test_error_about_a_capability_is_the_real_one() -> None:
    command, shown = block("needs").splitlines()
    said = run(command.removeprefix("$ ")).stderr
    assert said.replace(str(FOLDER), "…").rstrip() == shown


def test_all_that_homing_needs_is_named() -> None:
    """The README names each capability, variable and state that the example lacks."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"`homing` on `strain_wave` needs .*?\n\n", page, re.DOTALL)
    example = get(str(FOLDER / "strain_wave.py"))
    has = {each.name for kind in ("inputs", "outputs", "parameters", "states") for each in getattr(example, kind)}
    for need in set(EXTENSION.needs) - example.provides:
        constant = next(key for key, words in vars(capabilities).items() if words == need)
        needed = {constant, *capabilities.NEEDED_VARIABLES[need], *capabilities.NEEDED_STATES[need]} - has
        assert {name for name in needed if f"`{name}`" not in shown} == set(), need


def test_stick_slip_example_holds_up_to_its_friction(tmp_path: Path) -> None:
    """The friction of 24 N.m holds the fin on a spring of 600 N.m/rad up to 0.04 rad."""
    path = tmp_path / "stick_slip.py"
    path.write_text(block("stick-slip"), encoding="utf-8")
    values = load_parameters(model=str(path)).with_values({"fin.start_angle": 0.039}).values
    stuck, moving = (simulate(values, 0.1, model=str(path), aero_torque=torque)["fin_angle"] for torque in (0.0, -1.0))
    assert (stuck == 0.039).all()
    assert moving[-1] < 0.039


@pytest.mark.parametrize("changes", [(), (("lambda ops, p:", "lambda ops, p, interval:"),)],
                         ids=["as shown", "of the interval"])
def test_declaration_runs_with_two_fins_on_one_bus(changes: tuple[tuple[str, str], ...], tmp_path: Path) -> None:
    (whole,) = _DECLARATION.findall(FILE.read_text(encoding="utf-8"))
    # The README's declaration has no faults.
    model = changed(tmp_path, (whole, block("declaration")), ('    "fault.demagnetised.share": 0.6,\n', ""), *changes)
    (tmp_path / "direct_drive_reference.py").write_text("", encoding="utf-8")
    columns = []
    for name in (str(model), MODEL):
        done = CliRunner().invoke(app, ["simulate", "--model", name, "--fins", "2", "--step", "5", "--stop", "0.1",
                                        "--set", "bus.source_resistance=0.05", "-o", str(tmp_path / "r.csv")])
        assert done.exit_code == 0, done.output
        columns.append(read_csv(tmp_path / "r.csv"))
    one, other = columns
    assert all(np.array_equal(one[column], other[column]) for column in other)
    assert np.min(one["bus_voltage"]) < 38.9
