"""The command line: output, messages, exit codes."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emcas_fmu import __version__
from emcas_fmu.bench.excitation import csv_file
from emcas_fmu.cli import app
from emcas_fmu.reference.files import read_csv
from emcas_fmu.runtime import compiler

ROOT = Path(__file__).resolve().parents[2]


def emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.parametrize("command", ["build", "explore", "parameters", "reference", "simulate", "validate"])
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
    assert {r["source"] for r in records} == {"thesis", "derived", "estimate"}


def test_bad_parameter_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[motor]\nresistence = "1 Ohm"\n', encoding="utf-8")
    done = emcas("parameters", "-p", str(file))
    assert done.exit_code == 2
    said = done.stderr.replace("\n", "")
    assert "motor.resistence" in said
    assert "motor.resistance" in said  # what was meant
    assert "Traceback" not in said


def test_warnings_leave_standard_output_alone(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[motor]\ntorque_constant = "0.1 N*m/A"\nback_emf_constant = "0.173 V*s/rad"\n', encoding="utf-8")
    said = "warning: motor.torque_constant = 0.1 N*m/A and motor.back_emf_constant = 0.173 V*s/rad"
    listed = emcas("parameters", "-p", str(file), "--json")
    assert listed.exit_code == 0
    assert said in listed.stderr
    assert json.loads(listed.stdout)
    one = emcas("build", "-p", str(file), "-o", str(tmp_path / "one.fmu"))
    single = emcas("build", "--fins", "3", "--fin", f"2={file}", "-o", str(tmp_path / "three.fmu"))
    for built in (one, single):
        assert built.exit_code == 0
        assert built.stderr.count(said) == 1
    assert "warning" not in emcas("parameters").stderr


def test_commands_warn_where_friction_was_not_tested(tmp_path: Path) -> None:
    cold, fmu, made = tmp_path / "cold.toml", tmp_path / "cold.fmu", tmp_path / "made"
    cold.write_text('friction.temperature = "-40 degC"\n', encoding="utf-8")
    for command in (("parameters", "-p", cold), ("simulate", "--step", "5", "-p", cold),
                    ("build", "-o", fmu, "-p", cold), ("validate", cold, "--case", "step_plus1"),
                    ("validate", fmu, "--case", "step_plus1"),
                    ("baseline", "record", cold, "-o", made), ("baseline", "check", "-p", cold, "-b", made),
                    ("reference", "--case", "step_plus1", "--directory", made, "-p", cold)):
        done = emcas(*map(str, command))
        assert done.stderr.count("warning: friction.temperature = -40 degC is outside") == 1, command
    cold.write_text('friction.temperature = "-6 degC"\n', encoding="utf-8")
    assert "warning" not in emcas("parameters", "-p", str(cold)).stderr


def test_build_and_its_refusals(tmp_path: Path) -> None:
    target = tmp_path / "EMCAS.fmu"
    done = emcas("build", "--output", str(target))
    assert done.exit_code == 0
    assert "GUID" in done.output
    assert target.is_file()
    for arguments, said in (
        (("--output", str(tmp_path / "x.zip")), ".fmu"),
        (("--output", str(tmp_path / "none" / "x.fmu")), "no folder"),
        (("--backend", "cobol", "--output", str(target)), "choose python or native"),
        (("--platform", "linux64", "--output", str(target)), "are for backend native"),
        (("--backend", "native", "--platform", "vax", "--output", str(target)), "choose from linux64, win64, darwin64"),
        (("--backend", "native", "--cc", "no-such-cc", "--output", str(target)), "there is no such program"),
        (("--backend", "native", "--cc", "false", "--output", str(target)), "does not answer"),
        (("--backend", "native", "--cc", "cc", "--platform", "darwin64", "--output", str(target)),
         "leave cc out to use zig"),
        (("--parameters", str(tmp_path / "none.toml"), "--output", str(target)), "none.toml"),
    ):
        refused = emcas("build", *arguments)
        assert refused.exit_code == 2, arguments
        assert said in refused.stderr.replace("\n", "")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["EMCAS.fmu"]


def test_build_fmu_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["build_fmu.py", "--output", "My.fmu", "--no-references"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "build_fmu.py"), run_name="__main__")
    assert not ended.value.code
    assert "My.fmu" in capsys.readouterr().out
    assert (tmp_path / "My.fmu").is_file()


@pytest.mark.slow
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


@pytest.mark.slow
def test_references_of_ones_own_parameters(tmp_path: Path) -> None:
    """A user's actuator is judged against references made for it; a message says if it is not."""
    file, fmu, folder = tmp_path / "mine.toml", tmp_path / "Mine.fmu", tmp_path / "references"
    file.write_text('[kinematics]\nmoment_arm = "45 mm"\n', encoding="utf-8")
    assert emcas("build", "-p", str(file), "-o", str(fmu)).exit_code == 0
    told = emcas("validate", str(fmu), "--case", "step_plus1")
    assert told.exit_code == 1
    output = " ".join(told.output.split())
    assert "emcas reference --parameters" in output
    assert "nothing was judged: the runs have no reference of these parameters" in output
    assert emcas("reference", "--case", "step_plus1", "-p", str(file), "--directory", str(folder)).exit_code == 0
    assert emcas("validate", str(fmu), "--case", "step_plus1", "--directory", str(folder)).exit_code == 0
    assert emcas("reference", "--check", "-p", str(file)).exit_code == 2  # those shipped are of other parameters


def test_native_build_without_a_compiler_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiler, "zig", lambda: None)
    refused = emcas("build", "--backend", "native", "--output", str(tmp_path / "EMCAS.fmu"))
    assert refused.exit_code == 2
    assert "pip install 'emcas-fmu[native]'" in refused.stderr.replace("\n", "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.drawn
def test_simulate_a_step(tmp_path: Path) -> None:
    table, page, figures = tmp_path / "r.csv", tmp_path / "r.html", tmp_path / "r.json"
    done = emcas("simulate", "--step", "10 deg", "--torque", "-50 N*m", "--stop", "0.3", "-o", str(table), "--plot",
                 str(page), "--json", str(figures))
    assert done.exit_code == 0, done.stderr
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert abs(found["fin_angle_final_deg"] - 10.0) < 0.5
    assert 200.0 < found["peak_rate_deg_per_s"] < 300.0
    columns = read_csv(table)
    assert columns["time"][-1] == 0.3
    assert set(columns["aero_torque"]) == {-50.0}
    assert "<svg" in page.read_text(encoding="utf-8")


def test_simulate_a_case_and_a_file_alike(tmp_path: Path) -> None:
    """A reference case by its name, and from its stored file of inputs, by either kernel."""
    stored, exact = ROOT / "models" / "reference" / "EMCAS_step_in.csv", tmp_path / "exact.toml"
    exact.write_text("[encoder]\nenabled = false\n", encoding="utf-8")  # as trajectories are compared
    alike = ("--input", str(stored), "--parameters", str(exact))
    ways = (("--case", "step"), alike, (*alike, "--kernel", "python"))
    results = []
    for i, way in enumerate(ways):
        target = tmp_path / f"{i}.csv"
        assert emcas("simulate", *way, "--output", str(target)).exit_code == 0
        results.append(read_csv(target))
    for other in results[1:]:
        assert all((results[0][name] == other[name]).all() for name in other)


def test_input_files_are_sampled_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "in.csv"
    file.write_text('"time", "fin_command"\n0,0\n0.01,0\n0.01,0.1\n0.02,0.2\n', encoding="utf-8")
    found = csv_file(file, 2.5e-3, None).columns["fin_command"].tolist()
    assert found == pytest.approx([0, 0, 0, 0, 0.1, 0.125, 0.15, 0.175, 0.2])  # jumps at 10 ms, ramps after it
    for text, said in (("fin_command\n1\n", "no column time"), ("time,rudder\n0,1\n", "rudder is not an input"),
                       ("time\n0\n", "no column of an input"), ("time,enable\n1,1\n0,1\n", "backwards"),
                       ("time,fin_command\n0,nan\n1,0\n", "non-finite"),
                       ("time,fin_command\n0,x\n", "table of numbers"),
                       ("", "table of numbers"), ("time,enable\n", "table of numbers"),
                       ("time;enable\n0;1\n", "by commas, not semicolons"),
                       ("time,enable\n0,1\n1,1,0\n", "line 3 has 3 values for 2 columns"),
                       ("time,enable\n-1,1\n1,1\n", "0 or later"),
                       ("time,enable,enable\n0,1,1\n1,1,1\n", "occurs twice"), ("time,enable\n0,1\n", "1 to")):
        file.write_text(text, encoding="utf-8")
        refused = emcas("simulate", "--input", str(file))
        assert refused.exit_code == 2, text
        assert said in refused.stderr.replace("\n", ""), refused.stderr


@pytest.mark.parametrize(("arguments", "said"), [
    ((), "one of --case, --input and --step"), (("--case", "step", "--step", "1"), "one of"),
    (("--case", "nonsense"), "there is step, step_plus1"), (("--step", "1", "--stop", "-1"), "--stop"),
    (("--step", "1", "--set", "encoder.multiplier=3"), "error: --set encoder.multiplier = 3 must be 1, 2 or 4"),
    (("--step", "1", "--set", "drive.kp=-1"), "error: --set drive.kp = -1.0 V/A: is -1 V/A; it must"),
    (("--step", "1", "--plot", "r.gif"), ".html, .svg"), (("--case", "step", "--stop", "1"), "a case has its own"),
    (("--step", "1", "--kernel", "fortran"), "auto, compiled, python"),
    (("--step", "1", "--layout", "plus"), "add --fins"), (("--case", "stp"), "did you mean step"),
    (("--step", "1", "--torque", "1e300"), "--torque 1e300: must be within -100000 .. 100000 N.m"),
    (("--step", "nan"), "--step nan: is not a finite number"), (("--step", "1e9"), "within -180 .. 180 deg"),
    (("--step", "5 N"), "--step 5 N: the unit N does not measure"),
    (("--step", "1", "--interval", "1"), "steps of 1 s"), (("--step", "1", "--interval", "1e-12"), "steps of"),
    (("--step", "1", "--interval", "0.3"), "not a whole number of steps"),
    (("--step", "1", "--stop", "0.02"), "a later end"), (("--case", "step", "--torque", "1"), "belongs to --step")])
def test_simulate_refuses(arguments: tuple[str, ...], said: str) -> None:
    refused = emcas("simulate", *arguments)
    assert refused.exit_code == 2
    assert said in refused.stderr.replace("\n", "")


@pytest.mark.parametrize("arguments", [
    ["tune", "s.toml", "--requirements", "p.toml", "-o", "p.toml"], ["fit", "-p", "p.toml", "-o", "p.toml"],
    ["simulate", "--input", "r.csv", "--output", "r.csv"], ["tune", "s.toml", "-o", "s.toml"],
    ["baseline", "check", "p.toml", "-b", "base", "--markdown", "p.toml"],
    ["baseline", "check", "p.toml", "-b", "base", "--json", "base/drift.json"],
    ["analyse", "-p", "r.json", "--json", "r.json"], ["identify", "drive", "r.json", "--json", "r.json"],
    ["campaign", "r.json", "--json", "r.json"], ["ssp", "check", "r.json", "--json", "r.json"]])
def test_inputs_are_not_written_over(arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("base").mkdir()
    names = ["p.toml", "s.toml", "r.csv", "r.json", "base/drift.json"]
    for name in names:
        Path(name).write_text("# mine\n", encoding="utf-8")
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2
    assert "would be overwritten" in " ".join(done.stderr.split())
    assert {Path(name).read_text(encoding="utf-8") for name in names} == {"# mine\n"}


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    target = str(tmp_path / "x.toml")
    done = CliRunner().invoke(app, ["tune", "-o", target, "--journal", target])
    assert done.exit_code == 2
    assert "two outputs" in " ".join(done.stderr.split())


@pytest.mark.parametrize("command", ["validate", "report", "baseline record", "baseline check"])
def test_fins_are_counted_from_1(command: str) -> None:
    """Fin 0 would be that of no fin."""
    done = CliRunner().invoke(app, [*command.split(), "EMCAS4.fmu", "--fin", "0"])
    assert done.exit_code == 2
    assert "--fin" in done.stderr
    assert "equal to 1" in done.stderr


def test_fit_is_of_the_nonlinear_actuator(tmp_path: Path) -> None:
    """Another model, or its parameters, cause one line; a misspelt name is reported as usual."""
    own, slip = tmp_path / "own.toml", tmp_path / "slip.toml"
    own.write_text('motor.resistance = "1 Ohm"\nspring.rate = "4 N/m"\nspring.preload = "1 N"\n', encoding="utf-8")
    slip.write_text('motor.resistence = "1 Ohm"\n', encoding="utf-8")
    for arguments, said in ((("--model", "elastic"), "error: --model elastic: emcas fit needs the parameters of"),
                            (("-p", str(own)), "nonlinear actuator, which has no spring.rate, spring.preload; give"),
                            (("-p", str(slip)), "unknown parameter; did you mean motor.resistance?")):
        done = CliRunner().invoke(app, ["fit", *arguments])
        assert done.exit_code == 2
        assert said in done.stderr
        assert len(done.stderr.splitlines()) == 1
