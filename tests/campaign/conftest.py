"""A small campaign, and Dask workers to share."""

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
from emcas_fmu.studies.campaign.study import Study, load_study

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
    """A file with something odd in the place of one value after the other, and of one table after the other."""
    for place in re.finditer(r"(?<== ).*$", text, re.MULTILINE):
        yield text[:place.start()] + odd + text[place.end():]
    for name in dict.fromkeys(re.findall(r"^\[+(\w+)", text, re.MULTILINE)):
        yield f"{name} = {odd}\n" + re.sub(rf"^\[+{name}\b[^\[]*", "", text, flags=re.MULTILINE)


def campaign(*arguments: object) -> Result:
    """What `emcas campaign` does with these arguments."""
    return CliRunner().invoke(app, ["campaign", *map(str, arguments)])


def native_unit(model: str, folder: Path, **more: Any) -> Path:
    """The native FMU of an actuator, for this platform, under a file name that says nothing."""
    return lean(load_parameters(model=model), folder / "unit.fmu", **more)


def rows_of(study: Study, indices: Sequence[int], drawn: Any) -> list[dict[str, Any]]:
    """The rows of samples, one by one."""
    return sample.listed(sample.rows(study, indices, drawn))


def row_of(plan: Study, index: int, drawn: Sequence[float], subject: Subject) -> dict[str, Any]:
    """The row of a sample alone."""
    (row,) = sample.listed(sample.together(plan, [index], np.array([drawn]), subject))
    return row


def assert_same_rows(by_unit: Study, by_kernel: Study, drawn: Any) -> None:
    """Figures divide by rates and heights no smaller than 1e-3; trajectories are within 1e-9 rad."""
    indices = range(len(drawn))
    pairs = zip(*(rows_of(study, indices, np.array(drawn)) for study in (by_unit, by_kernel)),
                strict=True)
    for one, other in pairs:
        assert one["status"] == "ok"
        exact = [name for name in one if not isinstance(one[name], float)]
        assert {name: one.pop(name) for name in exact} == {name: other.pop(name) for name in exact}
        assert one == pytest.approx(other, rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a campaign file."""
    def written(text: str) -> Path:
        path = tmp_path / "small.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.fixture
def small(write: Write) -> Study:
    """The small campaign."""
    return load_study(write(SMALL))


@pytest.fixture
def store(small: Study, tmp_path: Path) -> Iterator[Store]:
    """A folder for its results."""
    with Store(tmp_path / "out", small) as opened:
        yield opened


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A Dask client with two worker processes."""
    with local_client(2) as ready:
        yield ready
