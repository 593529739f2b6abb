"""Parameter sets by name: the shipped ones, and the message for an unknown name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import click
import pytest
from click.testing import CliRunner as ClickRunner
from typer.main import get_command
from typer.testing import CliRunner

from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.cli import app
from emcas_fmu.commands.common import parameter_arguments
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.support.files import named_sets

SETS = named_sets()
MODELS = {"heat-published-motor": "nonlinear+heat", "hinge-stiffness": "elastic",
          "screw-efficiency-095": "nonlinear+efficiency", "worm-falling-friction": "worm-gear",
          "proportional-valve": "electrohydraulic", "xl330": "servo"}


@pytest.mark.parametrize("name", SETS)
def test_every_shipped_set_is_sound_and_says_where_it_is_from(name: str) -> None:
    entries = load_parameters(name, model=MODELS.get(name, "nonlinear")).entries
    changed = [e for e in entries if e.file == f"{name}.toml"]
    assert changed
    assert all(e.source and e.note for e in changed)
    first, *_ = SETS[name].read_text(encoding="utf-8").splitlines()
    assert first.startswith("# ")


def test_a_set_by_name_goes_over_the_defaults_and_below_later_files(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("drive.kp = '4 V/A'\n", encoding="utf-8")
    values, own = load_parameters().values, load_parameters(["drive-pi", mine]).values
    assert {name for name in values if values[name] != own[name]} == {"drive.kp", "drive.ki"}
    # The zero at kp/ki cancels the winding's time constant L/R; the file has it to the whole V/(A s).
    pi = load_parameters("drive-pi").values
    assert pi["drive.ki"] == pytest.approx(
        pi["drive.kp"] * values["motor.resistance"] / values["motor.inductance"], abs=0.5)


def test_a_file_of_the_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive-pi").write_text("drive.ki = '7 V/(A*s)'\n", encoding="utf-8")
    assert load_parameters("drive-pi").values["drive.ki"] == 7.0


def test_a_name_that_is_none_is_told_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"drive-p: there is neither .* did you mean drive-pi\?; the sets are"):
        load_parameters("drive-p")
    with pytest.raises(ParameterError, match=r"none\.toml: cannot be read"):
        load_parameters("none.toml")


@pytest.mark.parametrize(("name", "model"), [
    ("proportional-valve", "electrohydrostatic"), ("robust", "series-clutch"), ("drive-pi", "ristanovic"),
    ("heat-published-motor", "nonlinear"), ("worm-falling-friction", "nonlinear"), ("load-observer", "ristanovic")])
def test_a_set_made_for_another_actuator_is_refused(name: str, model: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name}: is made for .* and not for {model}, .*: leave it out, or "):
        load_parameters(name, model=model)


MADE_FOR = [(name, model if model[0] != "+" else f"nonlinear{model}") for name, path in SETS.items()
            for file in (path, *path.with_suffix("").glob("*.toml"))
            for model in tomllib.loads(file.read_text(encoding="utf-8"))["made_for"]]


@pytest.mark.parametrize(("name", "model"), [
    *MADE_FOR, ("robust", "elastic+faults"), ("heat-published-motor", "ristanovic+heat")])
def test_a_set_is_taken_by_what_it_is_made_for(name: str, model: str) -> None:
    found = load_parameters(name, model=model)
    assert any(e.file in (f"{name}.toml", f"{name}/{model}.toml") for e in found.entries)
    assert not found.unused


def test_a_file_says_what_it_is_made_for(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("made_for = ['elastic']\ndrive.kp = '4 V/A'\n", encoding="utf-8")
    assert load_parameters(mine, model="elastic").values["drive.kp"] == 4.0
    with pytest.raises(ParameterError, match=r"mine\.toml: is made for elastic \(made_for\) and not for nonlinear"):
        load_parameters(mine)
    mine.write_text("made_for = 'elastic'\n", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"made_for = 'elastic': write a list"):
        load_parameters(mine)


def test_commands_take_a_name() -> None:
    shown = CliRunner().invoke(app, ["parameters", "-p", "drive-scaled", "--json"])
    assert next(e["value"] for e in json.loads(shown.stdout) if e["name"] == "drive.kp") == 1.04
    refused = CliRunner().invoke(app, ["parameters", "-p", "drive-scale"])
    assert refused.exit_code == 2
    assert "did you mean drive-scaled?" in refused.stderr
    with open_subject(SETS["drive-pi"]) as subject:
        assert subject.identification.file == "drive-pi.toml"
        assert set(subject.identification.differences) == {"drive.ki"}


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command with its words; of a group, the group's own too."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))


COMMANDS = dict(commands(get_command(app)))  # type: ignore[arg-type]


def takers(*names: str) -> list[tuple[str, ...]]:
    """The commands that have a parameter of one of the names."""
    return [words for words, command in COMMANDS.items() if any(p.name in names for p in command.params)]


def given(words: tuple[str, ...], *arguments: str) -> dict[str, Any]:
    """Arguments of a command, without executing it."""
    seen: dict[str, Any] = {}
    with patch.object(COMMANDS[words], "callback", lambda **values: seen.update(values)):
        done = ClickRunner().invoke(COMMANDS[words], arguments)
    assert done.exit_code == 0, done.output
    return seen


@pytest.mark.parametrize("words", takers("parameters"), ids=" ".join)
def test_every_command_with_parameters_takes_the_name_of_a_set(words: tuple[str, ...]) -> None:
    needed = {"identify": ["measured.csv"], "calibrate": ["measured.csv", "--free", "motor.resistance"]}
    assert given(words, *needed.get(words[0], []), "-p", "drive-pi")["parameters"] == [SETS["drive-pi"]]


@pytest.mark.parametrize("words", takers("article", "subject"), ids=" ".join)
def test_every_command_with_a_subject_takes_the_name_of_a_set(words: tuple[str, ...]) -> None:
    seen = given(words, "load-observer")
    assert SETS["load-observer"] in (seen.get("article"), seen.get("subject"))


def test_a_set_is_written_by_its_name_into_a_command() -> None:
    assert parameter_arguments([SETS["drive-pi"], Path("a.toml")]) == ["--parameters", "drive-pi", "--parameters",
                                                                     "a.toml"]


def test_a_reported_quantity_is_of_a_set_by_name(tmp_path: Path) -> None:
    bench, out = Path(__file__).resolve().parents[2] / "examples/identification_bench/records", str(tmp_path / "x.toml")
    done = CliRunner().invoke(app, ["identify", "backlash", str(bench / "backlash.csv"), "-o", out, "-p", "drive-pi"])
    assert done.exit_code == 0, done.output
    assert load_parameters(out).values == load_parameters("drive-pi").values


def test_the_sets_are_listed() -> None:
    listed = json.loads(CliRunner().invoke(app, ["parameters", "--sets", "--json"]).stdout)
    assert [entry["name"] for entry in listed] == list(SETS)
    assert all(entry["description"] and not entry["description"].startswith("#") for entry in listed)
    table = CliRunner().invoke(app, ["parameters", "--sets"])
    assert table.exit_code == 0
    assert all(name in table.stdout for name in SETS)
    for others in (["-p", "drive-pi"], ["--model", "nonsense"]):
        refused = CliRunner().invoke(app, ["parameters", "--sets", *others])
        assert refused.exit_code == 2
        assert "leave --parameters and --model out" in refused.stderr
