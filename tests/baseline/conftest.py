"""Baselines recorded by the command."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app


def emcas(*arguments: str | Path, code: int = 0) -> str:
    """Return the output of `emcas baseline`, which must exit with `code`."""
    result = CliRunner().invoke(app, ["baseline", *map(str, arguments)])
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return str(result.output)


def record(folder: Path, *arguments: str | Path, article: str | Path = "actuator.toml", code: int = 0) -> str:
    """Record an article of the folder in the folder's baseline, and return the output."""
    return emcas("record", folder / article, "--output", folder / "baseline", *arguments, code=code)


def check(folder: Path, *arguments: str | Path, article: str | Path = "actuator.toml", code: int = 0) -> str:
    """Compare an article of the folder with the folder's baseline, and return the output."""
    return emcas("check", folder / article, "--baseline", folder / "baseline", *arguments, code=code)


def edit(file: Path, old: str, new: str) -> None:
    """Replace a text in a file, which must contain it."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.fixture(scope="session")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the shipped parameters as `actuator.toml` and their baseline."""
    folder = tmp_path_factory.mktemp("shipped")
    (folder / "actuator.toml").write_text("")
    record(folder)
    return folder


@pytest.fixture
def folder(shipped: Path, tmp_path: Path) -> Path:
    """A copy of the folder `shipped`, which a test may change."""
    return Path(shutil.copytree(shipped, tmp_path / "repository"))


SHORT = """schema = "emcas-baseline/1"
[limits.figures]
rise_time = { absolute = "0.5 ms", relative = "1 %" }
[limits.trajectories]
sample_time = "10 ms"
fin_angle = "0.05 deg"
[case.only]
kind = "step"
amplitude = "5 deg"
duration = "0.3 s"
"""


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """A folder with a baseline of one short case."""
    (tmp_path / "actuator.toml").write_text("")
    (tmp_path / "baseline").mkdir()
    (tmp_path / "baseline/baseline.toml").write_text(SHORT)
    record(tmp_path)
    return tmp_path
