"""The program that couples two halves prints how far they are from the whole."""

from __future__ import annotations

import re

import pytest
import typer
from typer.testing import CliRunner

from examples.hardware_in_the_loop.run import run

PROGRAM = typer.Typer()
PROGRAM.command()(run)


def printed(*options: str) -> float:
    """Return the largest difference [deg] that it prints."""
    done = CliRunner().invoke(PROGRAM, ["--stop", "0.1", *options])
    assert done.exit_code == 0, done.output
    found = re.search(r"largest difference (\S+) deg", done.output)
    assert found is not None
    return float(found[1])


@pytest.mark.fmu
def test_program() -> None:
    assert printed() == 0.0
    assert 0.1 < printed("--at-once") < 1.0
    assert 0.05 < printed("--own-controller") < 3.0


def test_refusal() -> None:
    done = CliRunner().invoke(PROGRAM, ["--model", "second-order"])
    assert done.exit_code == 2
    assert "second-order has none" in " ".join(done.output.split())
