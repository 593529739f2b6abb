"""A small campaign, and Dask workers to share."""

from __future__ import annotations

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
    from emcas_fmu.campaign.run import local_client

    with local_client(2) as ready:
        yield ready
