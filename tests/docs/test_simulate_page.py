"""The commands of docs/use/simulate.md for a jammed fin of four run, also with JSBSim."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from tests.hosts.host import missing

from .recipes import run_block

pytestmark = [pytest.mark.fmu, pytest.mark.slow]  # four fins in Python, and a rocket's flight
PAGE = "use/simulate.md"
JAM = 0.2  # s


def check(time: np.ndarray, jammed: np.ndarray, others: np.ndarray) -> None:
    """Check that the jammed fin is at rest from 1 ms after the jam, and that another fin moves."""
    after = time > JAM + 1e-3
    assert np.ptp(jammed[after]) == 0.0
    assert np.ptp(others[after]) > 0.1


def test_fin_jams_by_command(tmp_path: Path) -> None:
    run_block(PAGE, "jam", tmp_path)
    table = np.genfromtxt(tmp_path / "jam.csv", delimiter=",", names=True, deletechars="")
    check(table["time"], table["fin[2].fin_angle"], table["fin[1].fin_angle"])
    assert (tmp_path / "jam.html").stat().st_size > 10_000
    assert table["fin[1].fin_angle"].tolist() == table["fin[4].fin_angle"].tolist()


def test_fin_jams_in_a_rocket(tmp_path: Path) -> None:
    if importlib.util.find_spec("jsbsim") is None:
        missing("there is no jsbsim (pip install jsbsim)")
    from examples.jsbsim.flight import Manoeuvre, Turn
    from examples.jsbsim.fmu import Fmu
    from tests.examples.flying import flown

    run_block(PAGE, "jam_unit", tmp_path)
    turns = Manoeuvre("turns", "Pitch up and down", 0.4, (Turn(0.02, (0, 8, 0)), Turn(0.18, (0, -8, 0))))
    flight = flown(Fmu(tmp_path / "Jam.fmu"), turns)
    check(flight["time"], flight["fin2_rad"], flight["fin1_rad"])
