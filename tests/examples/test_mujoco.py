"""Four fins on a body in MuJoCo, driven by FMUs whose output is the torque."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from math import radians, sin
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.parameters import load_parameters
from examples.hardware_in_the_loop.coupling import Half
from examples.mujoco import rig
from examples.mujoco.run import run
from tests.extensions.test_torque import whole
from tests.fmu.built import lean

PROGRAM = typer.Typer()
PROGRAM.command()(run)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lean(load_parameters(), tmp_path_factory.mktemp("mujoco") / "torque.fmu", interface="torque")


@pytest.fixture
def actuators(fmu: Path) -> Iterator[list[Half]]:
    with ExitStack() as opened:
        yield [opened.enter_context(Half(fmu)) for _ in rig.FINS]


@pytest.mark.fmu
def test_fin_moves_like_that_of_the_whole_actuator(actuators: list[Half]) -> None:
    """Without roll and gravity the fins do not interact, and agree with the actuator that contains its fin."""
    tail = rig.Rig(actuators)
    tail.model.dof_armature[tail.model.joint("roll").dofadr[0]] = 1e9  # kg.m2
    tail.model.opt.gravity[:] = 0.0
    rows = tail.run(0.3, lambda time: radians(60.0) if time > 0.02 else 0.0)
    arm = 0.03  # m from the hinge to the centre of pressure

    def air(time: float, angle: float, rate: float) -> float:
        return -rig.PRESSURE * rig.AREA * rig.SLOPE * arm * (sin(angle) + arm * rate / rig.SPEED)

    expected = whole(NONLINEAR, 0.299, air,
                     fin_command=lambda time: -rig.STIFFNESS * radians(60.0) if time > 0.02 else 0.0)
    for fin in rig.FINS:
        angles = rows[1:, rig.COLUMNS.index(f"{fin}_angle")]
        assert np.degrees(np.abs(angles - expected).max()) < 0.01
    assert np.degrees(np.ptp(expected)) > 5.0


@pytest.mark.fmu
@pytest.mark.parametrize("inertia", [0.25, 4.0])
def test_tail_rolls_to_its_command(actuators: list[Half], inertia: float) -> None:
    """It then rests with the fins at 0, for any inertia of the fins."""
    rows = rig.Rig(actuators, inertia=inertia).run(1.0, lambda time: 1.0)
    assert rows[-1, 1] == pytest.approx(1.0, abs=0.01)
    assert np.abs(rows[-100:, 2]).max() < 0.05  # rad/s; measured 0.023, by fins that stick at 0.002 deg
    assert np.degrees(np.abs(rows[-100:, rig.COLUMNS.index("fin1_angle")])).max() < 0.2


@pytest.mark.fmu
def test_program(tmp_path: Path) -> None:
    result = CliRunner().invoke(PROGRAM, ["--stop", "0.6", "--plot", str(tmp_path / "roll.svg")])
    assert result.exit_code == 0, result.output
    found = re.search(r"at 0.6 s: (\S+) deg", result.output)
    assert found is not None
    assert float(found[1]) == pytest.approx(60.0, abs=1.0)
    assert (tmp_path / "roll.svg").stat().st_size > 1000


@pytest.mark.parametrize(("arguments", "words"), [
    (("--model", "servo"), "torque needs a rigid drive line"),
    (("--step", "0"), "--step 0"), (("--stop", "nan"), "--stop nan"), (("--inertia", "-1"), "--inertia -1"),
    (("--plot", "roll.html"), "roll.html: the name of a plot must end in .svg, .png, .pdf")])
def test_error_names_the_option(arguments: tuple[str, str], words: str) -> None:
    result = CliRunner().invoke(PROGRAM, arguments)
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())
