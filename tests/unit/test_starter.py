"""`emcas init` writes the files of a study for every actuator, or refuses."""

from __future__ import annotations

import os
import re
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.main import get_command

from emcas_fmu.actuators import NAMES
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.cli import app
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.studies import starter
from emcas_fmu.studies.campaign import study as campaign
from emcas_fmu.studies.overview import offered
from emcas_fmu.studies.tuning.study import load_study
from emcas_fmu.support.files import models_directory
from tests.commands import emcas, refusal
from tests.marks import others_slow
from tests.own_actuator.example import MODEL as DIRECT_DRIVE

MODELS = (*NAMES, "nonlinear+lugre+heat+homing+supply+faults", "elastic+stribeck+efficiency+heat+homing+supply+faults",
          DIRECT_DRIVE)
each_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: Path(model).stem)
_VALUE = re.compile(r"^#([\w.]+ = )", re.MULTILINE)


@cache
def shipped(model: str) -> ParameterSet:
    return load_parameters(model=model)


@each_model
def test_unchanged_file_gives_the_shipped_set(model: str, tmp_path: Path) -> None:
    path = tmp_path / "actuator.toml"
    path.write_text(starter.parameter_text(shipped(model)), encoding="utf-8")
    assert load_parameters(path, model=model) == shipped(model)


@each_model
@given(st.data())
@settings(max_examples=4)
def test_uncommented_values_are_the_shipped_ones(model: str, tmp_path_factory: pytest.TempPathFactory,
                                                 data: st.DataObject) -> None:
    """Any selection of the values."""
    text = starter.parameter_text(shipped(model))
    lines = len(_VALUE.findall(text))
    assert lines == len(offered(shipped(model))) > 0
    chosen = data.draw(st.one_of(st.just(set(range(lines))), st.sets(st.integers(0, lines - 1))))
    number = iter(range(lines))
    path = tmp_path_factory.mktemp("filled") / "actuator.toml"
    path.write_text(_VALUE.sub(lambda match: match[1] if next(number) in chosen else match[0], text), encoding="utf-8")
    filled = load_parameters(path, model=model)
    assert filled.values == shipped(model).values
    assert filled.warnings == shipped(model).warnings
    of_user = {e.variable.name.partition("[")[0] for e in filled.entries if e.source == "user"}
    assert of_user == {name for i, name in enumerate(names(text)) if i in chosen}


def names(text: str) -> list[str]:
    """Return the names of the values in their order, with their tables."""
    result, table = [], ""
    for line in text.splitlines():
        if line.startswith("["):
            table = line.strip("[]") + "."
        elif match := _VALUE.match(line):
            result.append(table + match[1].removesuffix(" = "))
    return result


# Loading a campaign takes a second or two for each actuator.
@pytest.mark.parametrize("model", others_slow(MODELS, lambda model: model in ("electrohydraulic", DIRECT_DRIVE)),
                         ids=lambda model: Path(model).stem)
def test_written_studies_are_the_shipped_ones_and_can_be_loaded(model: str, tmp_path: Path) -> None:
    base = shipped(model)
    assert emcas("init", tmp_path, "--model", model).exit_code == 0
    expected = replace(load_requirements(None, base), file="requirements.toml")
    assert load_requirements(tmp_path / "requirements.toml", base) == expected
    assert campaign.load_study(tmp_path / "campaign.toml").factors
    tuned = tmp_path / "tuning.toml"
    if tuned.exists():
        assert load_study(tuned, base).requirements
        assert tuned.read_bytes() in {path.read_bytes() for path in (*(models_directory() / "tuning").iterdir(),
                                                                     models_directory() / "tuning.toml")}
    elif model in NAMES:
        assert model in ("linear", "second-order", "ristanovic", "worm-gear-elastic")


@pytest.mark.parametrize("model", ["nonlinear", "second-order", DIRECT_DRIVE], ids=lambda model: Path(model).stem)
def test_commands_of_the_readme_exist(model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert emcas("init", tmp_path, "--model", model).exit_code == 0
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tuned.toml").touch()
    block = re.findall(r"```sh\n(.*?)```", (tmp_path / "README.md").read_text(encoding="utf-8"), re.DOTALL)[0]
    program: Any = get_command(app)
    for line in block.splitlines():
        _, name, *arguments = shlex.split(line, comments=True)
        command = program.commands[name]
        assert command.make_context(name, arguments).params


def test_campaign_leaves_out_missing_parameters_and_inputs() -> None:
    text = starter.campaign_text(shipped("electrohydraulic"))
    assert "supply_voltage" not in text
    assert "[experiments.sag]" not in text
    assert '[vary."inertia.fin"]' in text
    assert '[vary."motor.resistance"]' in starter.campaign_text(shipped("nonlinear"))


@pytest.mark.parametrize(("model", "friction", "stiffness"), [("nonlinear", "2", "250"), ("servo", "0.1", "12.5")])
def test_moments_of_the_campaign_are_scaled_by_the_rated_load(model: str, friction: str, stiffness: str) -> None:
    """250 N.m/rad would stall the servo at 4 deg."""
    text = starter.campaign_text(shipped(model))
    assert f'mean = "{friction} N.m"' in text
    assert f'low = "0 N.m/rad", high = "{stiffness} N.m/rad"' in text
    assert "39 V: down" not in text


def test_written_files_and_the_next_command_are_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = emcas("init", "mine")
    assert done.exit_code == 0
    for name in ("actuator.toml", "tuning.toml", "campaign.toml", "requirements.toml", "README.md"):
        assert f"written mine/{name}" in done.output
        assert (tmp_path / "mine" / name).is_file()
    assert "cd mine && emcas parameters -p actuator.toml" in done.output


def test_existing_files_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "actuator.toml").write_text("mine", encoding="utf-8")
    message = refusal("init", tmp_path)
    assert "actuator.toml: exists already" in message
    assert "README.md" not in message
    assert [path.name for path in tmp_path.iterdir()] == ["actuator.toml"]
    assert (tmp_path / "actuator.toml").read_text(encoding="utf-8") == "mine"
    assert emcas("init", tmp_path, "--force").exit_code == 0
    assert load_parameters(tmp_path / "actuator.toml") == shipped("nonlinear")


def test_wrong_arguments_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    for arguments, message in (((file,), "is a file"), ((file / "below",), "is a file"),
                               ((tmp_path / "new", "--model", "nonlinaer"), "did you mean nonlinear?")):
        done = emcas("init", *arguments)
        assert done.exit_code == 2
        assert message in done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="this user may write to every folder")
def test_folder_without_write_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "cannot be written" in refusal("init", tmp_path / "new")
    tmp_path.chmod(0o700)
