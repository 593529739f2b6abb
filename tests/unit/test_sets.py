"""Shipped parameter sets by name, and the message about an unknown name."""

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

from emcas_fmu.bench.fmu_subject import open_subject
from emcas_fmu.cli import app
from emcas_fmu.commands.common import parameter_arguments
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.support.files import named_sets
from tests.commands import emcas, refusal

SETS = named_sets()
MODELS = {"heat-published-motor": "nonlinear+heat", "hinge-stiffness": "elastic",
          "screw-efficiency-095": "nonlinear+efficiency", "worm-falling-friction": "worm-gear",
          "proportional-valve": "electrohydraulic", "xl330": "servo"}


@pytest.mark.parametrize("name", SETS)
def test_every_shipped_set_is_valid_and_has_sources(name: str) -> None:
    entries = load_parameters(name, model=MODELS.get(name, "nonlinear")).entries
    changed = [e for e in entries if e.file == f"{name}.toml"]
    assert changed
    assert all(e.source and e.note for e in changed)
    first, *_ = SETS[name].read_text(encoding="utf-8").splitlines()
    assert first.startswith("# ")


def test_named_set_overrides_the_defaults_but_not_later_files(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("drive.kp = '4 V/A'\n", encoding="utf-8")
    values, own = load_parameters().values, load_parameters(["drive-pi", mine]).values
    assert {name for name in values if values[name] != own[name]} == {"drive.kp", "drive.ki"}
    # The zero at kp/ki cancels the winding's time constant L/R; the file contains ki rounded to 1 V/(A s).
    pi = load_parameters("drive-pi").values
    assert pi["drive.ki"] == pytest.approx(
        pi["drive.kp"] * values["motor.resistance"] / values["motor.inductance"], abs=0.5)


def test_file_is_preferred_to_a_set_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive-pi").write_text("drive.ki = '7 V/(A*s)'\n", encoding="utf-8")
    assert load_parameters("drive-pi").values["drive.ki"] == 7.0


def test_unknown_name_gives_the_nearest_name() -> None:
    with pytest.raises(ParameterError, match=r"drive-p: there is neither .* did you mean drive-pi\?; the sets are"):
        load_parameters("drive-p")
    with pytest.raises(ParameterError, match=r"none\.toml: cannot be read"):
        load_parameters("none.toml")


@pytest.mark.parametrize(("name", "model"), [
    ("proportional-valve", "electrohydrostatic"), ("robust", "series-clutch"), ("drive-pi", "ristanovic"),
    ("heat-published-motor", "nonlinear"), ("worm-falling-friction", "nonlinear"), ("load-observer", "ristanovic")])
def test_set_for_another_actuator_is_refused(name: str, model: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name}: is made for .* and not for {model}, .*: leave it out, or "):
        load_parameters(name, model=model)


MADE_FOR = [(name, model if model[0] != "+" else f"nonlinear{model}") for name, path in SETS.items()
            for file in (path, *path.with_suffix("").glob("*.toml"))
            for model in tomllib.loads(file.read_text(encoding="utf-8"))["made_for"]]


@pytest.mark.parametrize(("name", "model"), [
    *MADE_FOR, ("robust", "elastic+faults"), ("heat-published-motor", "ristanovic+heat")])
def test_set_is_accepted_for_its_actuators(name: str, model: str) -> None:
    chosen = load_parameters(name, model=model)
    assert any(e.file in (f"{name}.toml", f"{name}/{model}.toml") for e in chosen.entries)
    assert not chosen.unused


def test_file_with_made_for_is_refused_for_other_actuators(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("made_for = ['elastic']\ndrive.kp = '4 V/A'\n", encoding="utf-8")
    assert load_parameters(mine, model="elastic").values["drive.kp"] == 4.0
    with pytest.raises(ParameterError, match=r"mine\.toml: is made for elastic \(made_for\) and not for nonlinear"):
        load_parameters(mine)
    mine.write_text("made_for = 'elastic'\n", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"made_for = 'elastic': write a list"):
        load_parameters(mine)


def test_command_accepts_the_name_of_a_set() -> None:
    records = json.loads(emcas("parameters", "-p", "drive-scaled", "--json").stdout)
    assert next(e["value"] for e in records if e["name"] == "drive.kp") == 1.04
    assert "did you mean drive-scaled?" in refusal("parameters", "-p", "drive-scale")
    with open_subject(SETS["drive-pi"]) as subject:
        assert subject.identification.file == "drive-pi.toml"
        assert set(subject.identification.differences) == {"drive.ki"}


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Yield every command with its words, including groups and their commands."""
    for name, command in group.commands.items():
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))


COMMANDS = dict(commands(get_command(app)))  # type: ignore[arg-type]


def commands_with(*names: str) -> list[tuple[str, ...]]:
    """Return the commands that have a parameter with one of the names."""
    return [words for words, command in COMMANDS.items() if any(p.name in names for p in command.params)]


def parse(words: tuple[str, ...], *arguments: str) -> dict[str, Any]:
    """Return a command's parsed arguments, without executing it."""
    parsed: dict[str, Any] = {}
    with patch.object(COMMANDS[words], "callback", lambda **values: parsed.update(values)):
        done = ClickRunner().invoke(COMMANDS[words], arguments)
    assert done.exit_code == 0, done.output
    return parsed


@pytest.mark.parametrize("words", commands_with("parameters"), ids=" ".join)
def test_every_command_with_parameters_accepts_the_name_of_a_set(words: tuple[str, ...]) -> None:
    needed = {"identify": ["measured.csv"], "calibrate": ["measured.csv", "--free", "motor.resistance"]}
    assert parse(words, *needed.get(words[0], []), "-p", "drive-pi")["parameters"] == [SETS["drive-pi"]]


@pytest.mark.parametrize("words", commands_with("article", "subject"), ids=" ".join)
def test_every_command_with_a_subject_accepts_the_name_of_a_set(words: tuple[str, ...]) -> None:
    parsed = parse(words, "load-observer")
    assert SETS["load-observer"] in (parsed.get("article"), parsed.get("subject"))


def test_printed_command_contains_the_name_of_a_set() -> None:
    assert parameter_arguments([SETS["drive-pi"], Path("a.toml")]) == ["--parameters", "drive-pi", "--parameters",
                                                                     "a.toml"]


def test_identified_parameters_are_based_on_a_named_set(tmp_path: Path) -> None:
    bench, out = Path(__file__).resolve().parents[2] / "examples/identification_bench/records", tmp_path / "x.toml"
    done = emcas("identify", "backlash", bench / "backlash.csv", "-o", out, "-p", "drive-pi")
    assert done.exit_code == 0, done.output
    assert load_parameters(out).values == load_parameters("drive-pi").values


def test_sets_are_listed() -> None:
    listed = json.loads(emcas("parameters", "--sets", "--json").stdout)
    assert [entry["name"] for entry in listed] == list(SETS)
    assert all(entry["description"] and not entry["description"].startswith("#") for entry in listed)
    table = emcas("parameters", "--sets")
    assert table.exit_code == 0
    assert all(name in table.stdout for name in SETS)
    for others in (["-p", "drive-pi"], ["--model", "nonsense"]):
        assert "leave --parameters and --model out" in refusal("parameters", "--sets", *others)
