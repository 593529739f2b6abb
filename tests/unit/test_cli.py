"""The command line: outputs, messages and exit codes."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest

from emcas_fmu import __version__
from emcas_fmu.bench.excitation import csv_file
from emcas_fmu.reference.files import read_csv
from emcas_fmu.runtime import compiler
from tests.commands import emcas, refusal

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("example", ["emcas build", "emcas explore", "emcas init my_actuator", "emcas parameters",
                                     "emcas reference", "emcas simulate", "emcas validate"])
def test_help_has_examples(example: str) -> None:
    done = emcas(example.split()[1], "--help")
    assert done.exit_code == 0
    assert example in done.output


def test_version_is_printed() -> None:
    assert __version__ in emcas("--version").output


def test_parameters_are_printed_as_table_and_json() -> None:
    assert "kinematics.moment_arm" in emcas("parameters").output
    records = json.loads(emcas("parameters", "--json").output)
    arm = next(r for r in records if r["name"] == "kinematics.moment_arm")
    assert (arm["value"], arm["unit"], arm["source"]) == (0.05, "m", "estimate")
    assert {r["source"] for r in records} == {"thesis", "derived", "estimate"}


def test_unknown_parameter_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[motor]\nresistence = "1 Ohm"\n', encoding="utf-8")
    message = refusal("parameters", "-p", file)
    assert "motor.resistence" in message
    assert "motor.resistance" in message
    assert "Traceback" not in message


def test_warnings_are_printed_on_standard_error(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[motor]\ntorque_constant = "0.1 N*m/A"\nback_emf_constant = "0.173 V*s/rad"\n', encoding="utf-8")
    warning = "warning: motor.torque_constant = 0.1 N*m/A and motor.back_emf_constant = 0.173 V*s/rad"
    listed = emcas("parameters", "-p", file, "--json")
    assert listed.exit_code == 0
    assert warning in listed.stderr
    assert json.loads(listed.stdout)
    for options in (("-p", file), ("--fins", "3", "--fin", f"2={file}")):
        built = emcas("build", *options, "-o", tmp_path / "x.fmu")
        assert built.exit_code == 0
        assert built.stderr.count(warning) == 1
    assert "warning" not in emcas("parameters").stderr


def test_commands_warn_outside_the_temperatures_of_measured_friction(tmp_path: Path) -> None:
    cold, fmu, folder = tmp_path / "cold.toml", tmp_path / "cold.fmu", tmp_path / "folder"
    cold.write_text('friction.temperature = "-40 degC"\n', encoding="utf-8")
    for command in (("parameters", "-p", cold), ("simulate", "--step", "5", "-p", cold),
                    ("build", "-o", fmu, "-p", cold), ("validate", cold, "--case", "step_plus1"),
                    ("validate", fmu, "--case", "step_plus1"),
                    ("baseline", "record", cold, "-o", folder), ("baseline", "check", "-p", cold, "-b", folder),
                    ("reference", "--case", "step_plus1", "--directory", folder, "-p", cold)):
        done = emcas(*command)
        assert done.stderr.count("warning: friction.temperature = -40 degC is outside") == 1, command
    cold.write_text('friction.temperature = "-6 degC"\n', encoding="utf-8")
    assert "warning" not in emcas("parameters", "-p", cold).stderr


def test_build_writes_an_fmu_or_refuses(tmp_path: Path) -> None:
    target = tmp_path / "EMCAS.fmu"
    done = emcas("build", "--output", target)
    assert done.exit_code == 0
    assert "GUID" in done.output
    assert target.is_file()
    for arguments, message in (
        (("--output", tmp_path / "x.zip"), ".fmu"), (("--output", tmp_path / "none" / "x.fmu"), "no folder"),
        (("--backend", "cobol", "--output", target), "choose python or native"),
        (("--platform", "linux64", "--output", target), "are for backend native"),
        (("--backend", "native", "--platform", "vax", "--output", target), "choose from linux64, win64, darwin64"),
        (("--backend", "native", "--cc", "no-such-cc", "--output", target), "there is no such program"),
        (("--backend", "native", "--cc", "gcc 'x", "--output", target), "is no command line"),
        (("--backend", "native", "--cc", "false", "--output", target), "does not answer"),
        (("--backend", "native", "--cc", "cc", "--platform", "darwin64", "--output", target),
         "leave cc out to use zig"),
        (("--parameters", tmp_path / "none.toml", "--output", target), "none.toml"),
    ):
        assert message in refusal("build", *arguments)
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
def test_reference_writes_and_checks_responses(tmp_path: Path) -> None:
    case = ("--case", "step_plus1", "--directory", tmp_path)
    assert emcas("reference", *case).exit_code == 0
    assert emcas("reference", "--check", *case).exit_code == 0
    stored = tmp_path / "EMCAS_step_plus1_ref.csv"
    lines = stored.read_text(encoding="utf-8").splitlines()
    time, angle, *rest = lines[-1].split(",")
    stored.write_text("\n".join([*lines[:-1], ",".join([time, str(float(angle) + 1e-3), *rest])]) + "\n",
                      encoding="utf-8")
    assert emcas("reference", "--check", *case).exit_code == 1
    assert emcas("reference", "--check", "--case", "nonsense").exit_code == 2


def test_brackets_in_messages_are_printed(tmp_path: Path) -> None:
    file = tmp_path / "a[red].toml"
    file.write_text('[motor]\nresistance = "[/red] Ohm"\n', encoding="utf-8")
    message = refusal("parameters", "-p", file)
    assert "a[red].toml" in message
    assert "[/red]" in message


@pytest.mark.slow
def test_changed_parameters_need_their_own_references(tmp_path: Path) -> None:
    """Without them nothing is judged, and a message says so."""
    file, fmu, folder = tmp_path / "mine.toml", tmp_path / "Mine.fmu", tmp_path / "references"
    file.write_text('[kinematics]\nmoment_arm = "45 mm"\n', encoding="utf-8")
    assert emcas("build", "-p", file, "-o", fmu).exit_code == 0
    unjudged = emcas("validate", fmu, "--case", "step_plus1")
    assert unjudged.exit_code == 1
    output = " ".join(unjudged.output.split())
    assert "emcas reference --parameters" in output
    assert "nothing was judged: the runs have no reference of these parameters" in output
    assert emcas("reference", "--case", "step_plus1", "-p", file, "--directory", folder).exit_code == 0
    assert emcas("validate", fmu, "--case", "step_plus1", "--directory", folder).exit_code == 0
    assert emcas("reference", "--check", "-p", file).exit_code == 2  # the shipped references have other parameters


def test_native_build_without_a_compiler_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiler, "zig", lambda: None)
    message = refusal("build", "--backend", "native", "--output", tmp_path / "EMCAS.fmu")
    assert "pip install 'emcas-fmu[native]'" in message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.drawn
def test_simulate_writes_a_step_response(tmp_path: Path) -> None:
    table, page, figures = tmp_path / "r.csv", tmp_path / "r.html", tmp_path / "r.json"
    done = emcas("simulate", "--step", "10 deg", "--torque", "-50 N*m", "--stop", "0.3", "-o", table, "--plot", page,
                 "--json", figures)
    assert done.exit_code == 0, done.stderr
    measured = json.loads(figures.read_text(encoding="utf-8"))
    assert abs(measured["fin_angle_final_deg"] - 10.0) < 0.5
    assert 200.0 < measured["peak_rate_deg_per_s"] < 300.0
    columns = read_csv(table)
    assert columns["time"][-1] == 0.3
    assert set(columns["aero_torque"]) == {-50.0}
    assert "<svg" in page.read_text(encoding="utf-8")


def test_case_and_its_input_file_give_the_same_response(tmp_path: Path) -> None:
    """With both kernels."""
    stored, exact = ROOT / "models" / "reference" / "EMCAS_step_in.csv", tmp_path / "exact.toml"
    exact.write_text("[encoder]\nenabled = false\n", encoding="utf-8")  # as in reference cases
    file = ("--input", stored, "--parameters", exact)
    results, target = [], tmp_path / "r.csv"
    for options in (("--case", "step"), file, (*file, "--kernel", "python")):
        assert emcas("simulate", *options, "--output", target).exit_code == 0
        results.append(read_csv(target))
    for other in results[1:]:
        assert all((results[0][name] == other[name]).all() for name in other)


def test_input_files_are_sampled_and_checked(tmp_path: Path) -> None:
    file = tmp_path / "in.csv"
    file.write_text('"time", "fin_command"\n0,0\n0.01,0\n0.01,0.1\n0.02,0.2\n', encoding="utf-8")
    command = csv_file(file, 2.5e-3, None).columns["fin_command"].tolist()
    assert command == pytest.approx([0, 0, 0, 0, 0.1, 0.125, 0.15, 0.175, 0.2])  # jumps at 10 ms, ramps after it
    for text, message in (("fin_command\n1\n", "no column time"), ("time,rudder\n0,1\n", "rudder is not an input"),
                          ("time\n0\n", "no column of an input"), ("time,enable\n1,1\n0,1\n", "backwards"),
                          ("time,fin_command\n0,nan\n1,0\n", "non-finite"),
                          ("time,fin_command\n0,x\n", "table of numbers"), ("", "table of numbers"),
                          ("time,enable\n", "table of numbers"), ("time;enable\n0;1\n", "by commas, not semicolons"),
                          ("time,enable\n0,1\n1,1,0\n", "line 3 has 3 values for 2 columns"),
                          ("time,enable\n-1,1\n1,1\n", "0 or later"), ("time,enable\n0,1\n", "1 to"),
                          ("time,enable,enable\n0,1,1\n1,1,1\n", "occurs twice")):
        file.write_text(text, encoding="utf-8")
        assert message in refusal("simulate", "--input", file)


@pytest.mark.parametrize(("arguments", "message"), [
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
def test_simulate_refuses_wrong_options(arguments: tuple[str, ...], message: str) -> None:
    assert message in refusal("simulate", *arguments)


@pytest.mark.parametrize("arguments", [
    ["tune", "s.toml", "--requirements", "p.toml", "-o", "p.toml"], ["fit", "-p", "p.toml", "-o", "p.toml"],
    ["simulate", "--input", "r.csv", "--output", "r.csv"], ["tune", "s.toml", "-o", "s.toml"],
    ["baseline", "check", "p.toml", "-b", "base", "--markdown", "p.toml"],
    ["baseline", "check", "p.toml", "-b", "base", "--json", "base/drift.json"],
    ["analyse", "-p", "r.json", "--json", "r.json"], ["identify", "drive", "r.json", "--json", "r.json"],
    ["campaign", "r.json", "--json", "r.json"], ["ssp", "check", "r.json", "--json", "r.json"]])
def test_inputs_are_not_overwritten(arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("base").mkdir()
    names = ["p.toml", "s.toml", "r.csv", "r.json", "base/drift.json"]
    for name in names:
        Path(name).write_text("# mine\n", encoding="utf-8")
    assert "would be overwritten" in refusal(*arguments)
    assert {Path(name).read_text(encoding="utf-8") for name in names} == {"# mine\n"}


def test_two_outputs_in_one_file_are_refused(tmp_path: Path) -> None:
    assert "two outputs" in refusal("tune", "-o", tmp_path / "x.toml", "--journal", tmp_path / "x.toml")


@pytest.mark.parametrize("command", ["validate", "report", "baseline record", "baseline check"])
def test_fins_are_counted_from_1(command: str) -> None:
    message = refusal(*command.split(), "EMCAS4.fmu", "--fin", "0")
    assert "--fin" in message
    assert "equal to 1" in message


def test_fit_accepts_only_the_nonlinear_actuator(tmp_path: Path) -> None:
    """Another model, or its parameters, give an error of one line; a wrong name gives the usual error."""
    own, slip = tmp_path / "own.toml", tmp_path / "slip.toml"
    own.write_text('motor.resistance = "1 Ohm"\nspring.rate = "4 N/m"\nspring.preload = "1 N"\n', encoding="utf-8")
    slip.write_text('motor.resistence = "1 Ohm"\n', encoding="utf-8")
    for arguments, message in ((("--model", "elastic"), "error: --model elastic: emcas fit needs the parameters of"),
                               (("-p", str(own)), "nonlinear actuator, which has no spring.rate, spring.preload; give"),
                               (("-p", str(slip)), "unknown parameter; did you mean motor.resistance?")):
        done = emcas("fit", *arguments)
        assert done.exit_code == 2
        assert message in done.stderr
        assert len(done.stderr.splitlines()) == 1
