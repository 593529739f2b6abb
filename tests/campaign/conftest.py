"""A small campaign, and Dask workers to share."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

SMALL = """
[campaign]
samples = 24
seed = 5

[vary."motor.torque_constant"]
distribution = "normal"
sd = "3 %"

[vary."motor.back_emf_constant"]
follows = "motor.torque_constant"

[vary."friction.temperature"]
distribution = "uniform"
low = "-6 degC"
high = "24 degC"

[inputs.aero_torque]
kind = "constant"
value = { distribution = "uniform", low = "-40 N.m", high = "0 N.m" }

[experiments.step]
kind = "step"
amplitude = "5 deg"
duration = "0.3 s"
"""


ODD = ("true", "3", "-0.5", "inf", '"x"', "[]", "[1]", "{}", "{ a = 1 }", "[{ a = 1 }]", '[["x"]]', "1979-05-27")


def replaced(text: str, odd: str) -> Iterator[str]:
    """A file with something odd in the place of one value after the other, and of one table after the other."""
    for place in re.finditer(r"(?<== ).*$", text, re.MULTILINE):
        yield text[:place.start()] + odd + text[place.end():]
    for name in dict.fromkeys(re.findall(r"^\[+(\w+)", text, re.MULTILINE)):
        yield f"{name} = {odd}\n" + re.sub(rf"^\[+{name}\b[^\[]*", "", text, flags=re.MULTILINE)


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a campaign file."""
    def written(text: str = SMALL) -> Path:
        path = tmp_path / "small.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A Dask client with two worker processes."""
    from emcas_fmu.studies.campaign.run import local_client

    with local_client(2) as ready:
        yield ready
