"""Four fins on a body in MuJoCo, turned by FMUs with torque out."""

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
def test_a_fin_moves_as_with_its_inertia_inside(actuators: list[Half]) -> None:
    """Without roll and weight each fin is alone in the air, as that of the ordinary actuator: within 0.01 deg."""
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
def test_the_tail_rolls(actuators: list[Half], inertia: float) -> None:
    """And comes to rest at the command, with the fins at 0, whatever their inertia is."""
    rows = rig.Rig(actuators, inertia=inertia).run(1.0, lambda time: 1.0)
    assert rows[-1, 1] == pytest.approx(1.0, abs=0.01)
    assert np.abs(rows[-100:, 2]).max() < 0.05  # rad/s, by fins that stick 0.002 deg from 0; measured 0.023
    assert np.degrees(np.abs(rows[-100:, rig.COLUMNS.index("fin1_angle")])).max() < 0.2


@pytest.mark.fmu
def test_program(tmp_path: Path) -> None:
    done = CliRunner().invoke(PROGRAM, ["--stop", "0.6", "--plot", str(tmp_path / "roll.svg")])
    assert done.exit_code == 0, done.output
    found = re.search(r"at 0.6 s: (\S+) deg", done.output)
    assert found is not None
    assert float(found[1]) == pytest.approx(60.0, abs=1.0)
    assert (tmp_path / "roll.svg").stat().st_size > 1000


@pytest.mark.parametrize(("arguments", "words"), [
    (("--model", "servo"), "torque needs a rigid drive line"),
    (("--plot", "roll.html"), "roll.html: the name of a plot must end in .svg, .png, .pdf")])
def test_refusal(arguments: tuple[str, str], words: str) -> None:
    done = CliRunner().invoke(PROGRAM, arguments)
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
