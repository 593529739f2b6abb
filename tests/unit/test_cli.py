"""The command line: output, messages, exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emcas_fmu import __version__
from emcas_fmu.cli import app

ROOT = Path(__file__).resolve().parents[2]


def emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.parametrize("command", ["build", "parameters", "reference", "validate"])
def test_help_has_examples(command: str) -> None:
    done = emcas(command, "--help")
    assert done.exit_code == 0
    assert f"emcas {command}" in done.output


def test_version() -> None:
    assert __version__ in emcas("--version").output


def test_parameters_table_and_json() -> None:
    assert "kinematics.moment_arm" in emcas("parameters").output
    records = json.loads(emcas("parameters", "--json").output)
    arm = next(r for r in records if r["name"] == "kinematics.moment_arm")
    assert (arm["value"], arm["unit"], arm["source"]) == (0.05, "m", "estimate")
    assert {r["source"] for r in records} == {"seed", "derived", "estimate"}


def test_bad_parameter_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[motor]\nresistence = "1 Ohm"\n', encoding="utf-8")
    done = emcas("parameters", "-p", str(file))
    assert done.exit_code == 2
    said = done.stderr.replace("\n", "")
    assert "motor.resistence" in said
    assert "motor.resistance" in said  # what was meant
    assert "Traceback" not in said


def test_build_and_its_refusals(tmp_path: Path) -> None:
    target = tmp_path / "EMCAS.fmu"
    done = emcas("build", "--output", str(target))
    assert done.exit_code == 0
    assert "GUID" in done.output
    assert target.is_file()
    for arguments, said in (
        (("--output", str(tmp_path / "x.zip")), ".fmu"),
        (("--output", str(tmp_path / "none" / "x.fmu")), "no folder"),
        (("--backend", "cobol", "--output", str(target)), "cobol"),
        (("--parameters", str(tmp_path / "none.toml"), "--output", str(target)), "none.toml"),
    ):
        refused = emcas("build", *arguments)
        assert refused.exit_code == 2, arguments
        assert said in refused.stderr.replace("\n", "")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["EMCAS.fmu"]


def test_build_fmu_script(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, str(ROOT / "build_fmu.py"), "--output", "My.fmu"], cwd=tmp_path,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "My.fmu" in done.stdout
    assert (tmp_path / "My.fmu").is_file()


def test_reference_regenerates_and_compares(tmp_path: Path) -> None:
    one = ("--case", "step_plus1", "--directory", str(tmp_path))
    assert emcas("reference", *one).exit_code == 0
    assert emcas("reference", "--check", *one).exit_code == 0
    stored = tmp_path / "EMCAS_step_plus1_ref.csv"
    lines = stored.read_text(encoding="utf-8").splitlines()
    time, angle, *rest = lines[-1].split(",")
    stored.write_text("\n".join([*lines[:-1], ",".join([time, str(float(angle) + 1e-3), *rest])]) + "\n",
                      encoding="utf-8")
    assert emcas("reference", "--check", *one).exit_code == 1
    assert emcas("reference", "--check", "--case", "nonsense").exit_code == 2


def test_messages_are_no_markup(tmp_path: Path) -> None:
    file = tmp_path / "a[red].toml"
    file.write_text('[motor]\nresistance = "[/red] Ohm"\n', encoding="utf-8")
    done = emcas("parameters", "-p", str(file))
    assert done.exit_code == 2
    assert "a[red].toml" in done.stderr.replace("\n", "")
    assert "[/red]" in done.stderr


def test_references_of_ones_own_parameters(tmp_path: Path) -> None:
    """A user's actuator is judged against references made for it, and told so where it is not."""
    file, fmu, folder = tmp_path / "mine.toml", tmp_path / "Mine.fmu", tmp_path / "references"
    file.write_text('[kinematics]\nmoment_arm = "45 mm"\n', encoding="utf-8")
    assert emcas("build", "-p", str(file), "-o", str(fmu)).exit_code == 0
    told = emcas("validate", str(fmu), "--case", "step_plus1")
    assert told.exit_code == 1
    assert "emcas reference --parameters" in told.output.replace("\n", " ")
    assert emcas("reference", "--case", "step_plus1", "-p", str(file), "--directory", str(folder)).exit_code == 0
    assert emcas("validate", str(fmu), "--case", "step_plus1", "--directory", str(folder)).exit_code == 0
    assert emcas("reference", "-p", str(file)).exit_code == 2  # would overwrite the shipped ones
