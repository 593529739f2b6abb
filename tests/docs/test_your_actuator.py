"""The commands of docs/use/your_actuator.md run, and its conversions agree with a motor in d and q."""

from __future__ import annotations

import re
import shlex
import shutil
from math import sqrt
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.studies.tuning.study import load_study

from .recipes import ROOT, recipes

PAGE = "use/your_actuator.md"
BLOCKS = recipes(PAGE)
TEXT = (ROOT / "docs" / PAGE).read_text(encoding="utf-8")


def run(name: str, monkeypatch: pytest.MonkeyPatch, only: str = "") -> str:
    """Run the commands of a block, or only its commands `only`, and return the output; exit code 1 is a verdict."""
    output = ""
    for line in BLOCKS[name][1].splitlines():
        program, *arguments = shlex.split(line, comments=True)
        if program == "cd":
            monkeypatch.chdir(arguments[0])
        elif not only or arguments[0] == only:
            result = CliRunner().invoke(app, arguments)
            codes = (0, 1) if arguments[0] in ("tune", "report") else (0,)
            assert result.exit_code in codes, result.output + result.stderr
            assert "warning" not in result.stderr, result.stderr
            output += result.stdout
    return output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The reader's folder, in which the commands run; the parameter file contains the page's values."""
    monkeypatch.chdir(tmp_path)
    run("start", monkeypatch)
    filled = (tmp_path / "my_actuator" / "actuator.toml").read_text(encoding="utf-8")
    table = ""
    for line in BLOCKS["sheets"][1].splitlines():
        if line.startswith("["):
            table = line
        elif line:  # the reader removes the # and changes the value
            key = line.partition(" = ")[0]
            written = re.search(rf"{re.escape(table)}\n(?:[^\[].*\n|\n)*?(#{re.escape(key)} = .*)", filled)
            assert written, (table, key)
            filled = filled[:written.start(1)] + line + filled[written.end(1):]
    (tmp_path / "my_actuator" / "actuator.toml").write_text(filled, encoding="utf-8")
    return tmp_path / "my_actuator"


def test_every_block_is_run() -> None:
    assert sorted(BLOCKS) == ["bounds", "check", "checked", "finish", "made", "sheets", "start"]
    assert TEXT.count("\n```") == 2 * len(BLOCKS)


def test_set_made_for_other_actuators_is_refused(tmp_path: Path) -> None:
    (tmp_path / "set.toml").write_text(BLOCKS["made"][1], encoding="utf-8")
    for model in ("elastic", "nonlinear+heat"):
        load_parameters(tmp_path / "set.toml", model=model)
    with pytest.raises(ParameterError, match=r"is made for elastic, \+heat \(made_for\) and not for nonlinear"):
        load_parameters(tmp_path / "set.toml")


def test_completed_file_has_the_values_of_the_page(folder: Path) -> None:
    users = {e.variable.name for e in load_parameters(folder / "actuator.toml").entries if e.source == "user"}
    (folder / "page.toml").write_text(BLOCKS["sheets"][1], encoding="utf-8")
    page = load_parameters(folder / "page.toml")
    assert page.values == load_parameters(folder / "actuator.toml").values
    assert page.warnings == ()
    assert len(users) == sum(7 if isinstance(value, dict) and "value" in value else 1
                             for table in tomllib.loads(BLOCKS["sheets"][1]).values()
                             for value in (table.get("coulomb", table) if isinstance(table, dict) else {}).values())


def test_check_commands_print_the_lines_of_the_page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = run("check", monkeypatch)
    for line in BLOCKS["checked"][1].splitlines():
        assert line in output, output
    assert (folder / "step.html").is_file()


def test_fmu_is_built_and_the_estimates_are_counted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy("actuator.toml", "tuned.toml")  # instead of the search, which the slow test runs
    assert "still shipped estimates: 59 of 101 values" in run("finish", monkeypatch, "build")
    assert (folder / "MyActuator.fmu").is_file()


def widen(folder: Path) -> None:
    """Replace the shipped bounds by those of the page."""
    path = folder / "tuning.toml"
    text, bounds = path.read_text(encoding="utf-8"), BLOCKS["bounds"][1]
    begin = text.index("[tunables]")
    path.write_text(text[:begin] + bounds + text[text.index("\n\n", begin):], encoding="utf-8")


def test_bounds_of_the_page_fit_the_study(folder: Path) -> None:
    base = load_parameters(folder / "actuator.toml")
    before = load_study(folder / "tuning.toml", base)
    widen(folder)
    after = load_study(folder / "tuning.toml", base)
    assert [t.name for t in after.tunables] == [t.name for t in before.tunables]
    assert all(new.lower <= new.upper and new != old
               for new, old in zip(after.tunables, before.tunables, strict=True))


@pytest.mark.slow
def test_tuning_changes_only_the_controllers(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    widen(folder)
    run("finish", monkeypatch)
    for name in ("tuned.toml", "tuning.html", "MyActuator.fmu", "report.html"):
        assert (folder / name).is_file()
    tuned, before = (load_parameters(folder / name).values for name in ("tuned.toml", "actuator.toml"))
    changed = {name for name, value in tuned.items() if value != before[name]}
    assert changed
    assert all(name.startswith("controller.") for name in changed)


# -- conversions -------------------------------------------------------------------


def factors(begin: str) -> list[float]:
    """Return the factors of the page's rows that begin with a text."""
    return [float(number) for number in re.findall(rf"^\| {re.escape(begin)}.*?\| × ([\d.]+)", TEXT, re.MULTILINE)]


@pytest.mark.parametrize(("flux", "resistance", "inductance", "pairs", "amplitude", "speed"), [
    (0.0136, 0.11, 2.25e-4, 4, 70.0, 330.0), (0.05, 0.4, 1e-3, 1, 3.0, 20.0)])
def test_conversions_agree_with_a_field_oriented_motor_in_steady_motion(
        flux: float, resistance: float, inductance: float, pairs: int, amplitude: float, speed: float) -> None:
    """The motor is a star with phase values, in amplitude-invariant d and q; the page's factors have four digits."""
    v_q = resistance * amplitude + pairs * speed * flux
    v_d = -pairs * speed * inductance * amplitude
    torque = 1.5 * pairs * flux * amplitude
    rms, emf = amplitude / sqrt(2.0), pairs * flux  # phase values; emf in V per rad/s of the shaft
    per_star, per_delta = factors("resistance, inductance of a phase")
    per_rms, per_amplitude = factors("current, or A/V, rms")[0], factors("current, or A/V, amplitude")[0]
    r, inductive, delta = per_star * resistance, per_star * inductance, per_delta * 3.0 * resistance
    i = per_rms * rms
    k = factors("voltage constant, phase (star), amplitude")[0] * emf
    rel = 2e-4  # two factors of four digits
    assert delta == pytest.approx(r, rel=rel)
    assert i == pytest.approx(per_amplitude * amplitude, rel=rel)
    assert k * i == pytest.approx(torque, rel=rel)
    assert (r * i + k * speed) ** 2 + (pairs * speed * inductive * i) ** 2 == pytest.approx(
        3.0 * (v_q**2 + v_d**2), rel=4e-4)  # squares of factors with four digits
    assert r * i * i == pytest.approx(1.5 * resistance * amplitude**2, rel=4e-4)
    assert (r * i + k * speed) * i == pytest.approx(1.5 * v_q * amplitude, rel=4e-4)
    gain = factors("gain of the current loop")[0]  # 1 V of v_q per 1 A of amplitude
    assert gain * per_amplitude == pytest.approx(sqrt(3.0), rel=rel)
    for begin, sheet in (("voltage constant, phase (star), rms", emf / sqrt(2.0)),
                         ("voltage constant, line to line, rms", sqrt(1.5) * emf),
                         ("voltage constant, line to line, amplitude", sqrt(3.0) * emf),
                         ("torque constant, N·m/A rms", torque / rms),
                         ("torque constant, N·m/A of amplitude", torque / amplitude)):
        factor, = set(factors(begin))
        assert factor * sheet == pytest.approx(k, rel=rel), begin
