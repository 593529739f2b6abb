"""The program that couples controllers and plant prints the largest difference from the whole actuator."""

from __future__ import annotations

import re

import pytest
import typer
from typer.testing import CliRunner

from examples.hardware_in_the_loop.run import run

PROGRAM = typer.Typer()
PROGRAM.command()(run)


def largest_difference(*options: str) -> float:
    """Run the program and return the largest difference [deg] that it prints."""
    result = CliRunner().invoke(PROGRAM, ["--stop", "0.1", *options])
    assert result.exit_code == 0, result.output
    found = re.search(r"largest difference (\S+) deg", result.output)
    assert found is not None
    return float(found[1])


@pytest.mark.fmu
def test_difference_of_the_coupled_halves() -> None:
    assert largest_difference() == 0.0
    assert 0.1 < largest_difference("--at-once") < 1.0
    assert 0.05 < largest_difference("--own-controller") < 3.0


@pytest.mark.fmu
@pytest.mark.parametrize("model", ["servo", "clutch"])
def test_own_controller_refuses_an_actuator_that_it_cannot_control(model: str) -> None:
    result = CliRunner().invoke(PROGRAM, ["--own-controller", "--model", model])
    assert result.exit_code == 2
    assert f"which {model} does not have" in " ".join(result.output.split())


def test_actuator_without_position_loop_is_refused() -> None:
    result = CliRunner().invoke(PROGRAM, ["--model", "second-order"])
    assert result.exit_code == 2
    assert "second-order has none" in " ".join(result.output.split())
