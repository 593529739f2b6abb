"""Fixtures of the campaign tests: a small campaign, its folder, and Dask workers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.bench.subject import Subject
from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign import sample
from emcas_fmu.studies.campaign.run import local_client
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import Campaign, load_study

from ..fmu.built import lean

Write = Callable[[str], Path]
A_STEP = """
[experiments.step]
kind = "step"
amplitude = "5 deg"
duration = "0.3 s"
"""
BASIC = """
[campaign]
samples = 24
seed = 5

[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"

[vary."friction.temperature"]
distribution = "uniform"
low = "-6 degC"
high = "24 degC"

[inputs.aero_torque]
kind = "constant"
value = { distribution = "uniform", low = "-40 N.m", high = "0 N.m" }
""" + A_STEP
SMALL = BASIC + """
[vary."motor.back_emf_constant"]
follows = "motor.torque_constant"
"""
GRID = """
[campaign]
method = "grid"
[vary."motor.resistance"]
low = "0.2 Ohm"
high = "0.3 Ohm"
count = 4
[vary."friction.temperature"]
levels = ["-6 degC", "10 degC", "24 degC"]
[vary."encoder.enabled"]
levels = [true, false]
[experiments.a]
kind = "hold"
amplitude = "0 deg"
"""
ODD = ("true", "3", "-0.5", "inf", '"x"', "[]", "[1]", "{}", "{ a = 1 }", "[{ a = 1 }]", '[["x"]]', "1979-05-27")


def replaced(text: str, odd: str) -> Iterator[str]:
    """Yield a TOML text with each value in turn, then each table in turn, replaced by an odd value."""
    for value in re.finditer(r"(?<== ).*$", text, re.MULTILINE):
        yield text[:value.start()] + odd + text[value.end():]
    for name in dict.fromkeys(re.findall(r"^\[+(\w+)", text, re.MULTILINE)):
        yield f"{name} = {odd}\n" + re.sub(rf"^\[+{name}\b[^\[]*", "", text, flags=re.MULTILINE)


def campaign(*arguments: object) -> Result:
    """Run `emcas campaign` with these arguments."""
    return CliRunner().invoke(app, ["campaign", *map(str, arguments)])


def native_fmu(model: str, folder: Path, **more: Any) -> Path:
    """Build the native FMU of an actuator for this platform. The file name does not name the model."""
    return lean(load_parameters(model=model), folder / "unit.fmu", **more)


def rows_of(study: Campaign, indices: Sequence[int], drawn: Any) -> list[dict[str, Any]]:
    """Return the rows of samples as a list."""
    return sample.listed(sample.rows(study, indices, drawn))


def row_of(study: Campaign, index: int, drawn: Sequence[float], subject: Subject) -> dict[str, Any]:
    """Return the row of one sample."""
    (row,) = sample.listed(sample.together(study, [index], np.array([drawn]), subject))
    return row


def assert_same_rows(by_fmu: Campaign, by_kernel: Campaign, drawn: Any) -> None:
    """Compare rows: trajectories agree within 1e-9 rad, and figures divide them by 1e-3 or more."""
    for row, expected in zip(*(rows_of(study, range(len(drawn)), np.array(drawn)) for study in (by_fmu, by_kernel)),
                             strict=True):
        assert row["status"] == "ok"
        exact = [name for name in row if not isinstance(row[name], float)]
        assert {name: row.pop(name) for name in exact} == {name: expected.pop(name) for name in exact}
        assert row == pytest.approx(expected, rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Function that writes a campaign file and returns its path."""
    def write_file(text: str) -> Path:
        path = tmp_path / "small.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


@pytest.fixture
def small(write: Write) -> Campaign:
    return load_study(write(SMALL))


@pytest.fixture
def store(small: Campaign, tmp_path: Path) -> Iterator[Store]:
    """The result folder of the small campaign."""
    with Store(tmp_path / "out", small) as opened:
        yield opened


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A Dask client with two worker processes."""
    with local_client(2) as connected:
        yield connected
