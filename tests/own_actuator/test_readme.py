"""The declarations that the README shows, exactly as printed there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import read_csv
from emcas_fmu.simulation import simulate

from .example import FILE, FOLDER, MODEL, changed

_DECLARATION = re.compile(r"^ACTUATOR = em\.Actuator\(\n.*?^\)\n", re.DOTALL | re.MULTILINE)


def block(name: str) -> str:
    """Return a block of the README by its name."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(rf"<!-- run: {name} -->\n```python\n(.*?)```", page, re.DOTALL)
    return str(shown)


def test_stick_and_slip(tmp_path: Path) -> None:
    """The friction of 24 N.m holds the fin on a spring of 600 N.m/rad up to 0.04 rad."""
    path = tmp_path / "stick_slip.py"
    path.write_text(block("stick-slip"), encoding="utf-8")
    values = load_parameters(model=str(path)).with_values({"fin.start_angle": 0.039}).values
    held, moved = (simulate(values, 0.1, model=str(path), aero_torque=torque)["fin_angle"] for torque in (0.0, -1.0))
    assert (held == 0.039).all()
    assert moved[-1] < 0.039


@pytest.mark.parametrize("changes", [(), (("lambda ops, p:", "lambda ops, p, interval:"),)],
                         ids=["as shown", "of the interval"])
def test_its_declaration_runs_on_a_line_of_two(changes: tuple[tuple[str, str], ...], tmp_path: Path) -> None:
    (whole,) = _DECLARATION.findall(FILE.read_text(encoding="utf-8"))
    # The declaration there leaves the faults out.
    model = changed(tmp_path, (whole, block("declaration")), ('    "fault.demagnetised.share": 0.6,\n', ""), *changes)
    (tmp_path / "direct_drive_reference.py").write_text("", encoding="utf-8")
    columns = []
    for name in (str(model), MODEL):
        done = CliRunner().invoke(app, ["simulate", "--model", name, "--fins", "2", "--step", "5", "--stop", "0.1",
                                        "--set", "bus.source_resistance=0.05", "-o", str(tmp_path / "r.csv")])
        assert done.exit_code == 0, done.output
        columns.append(read_csv(tmp_path / "r.csv"))
    one, other = columns
    assert all(np.array_equal(one[column], other[column]) for column in other)
    assert np.min(one["bus_voltage"]) < 38.9
