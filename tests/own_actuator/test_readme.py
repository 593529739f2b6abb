"""The declaration that the README shows, exactly as printed there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.reference.files import read_csv

from .example import FILE, FOLDER, MODEL, changed

_DECLARATION = re.compile(r"^ACTUATOR = Actuator\(\n.*?^\)\n", re.DOTALL | re.MULTILINE)


def declaration() -> str:
    (shown,) = _DECLARATION.findall((FOLDER / "README.md").read_text(encoding="utf-8"))
    return str(shown)


@pytest.mark.parametrize("changes", [(), (("lambda ops, p:", "lambda ops, p, interval:"),)],
                         ids=["as shown", "of the interval"])
def test_its_declaration_runs_on_a_line_of_two(changes: tuple[tuple[str, str], ...], tmp_path: Path) -> None:
    (whole,) = _DECLARATION.findall(FILE.read_text(encoding="utf-8"))
    model = changed(tmp_path, (whole, declaration()), *changes)
    parameters = tmp_path / "mine.toml"  # of the faults, which the declaration there leaves out
    parameters.write_text(re.sub(r"\[fault.*", "", parameters.read_text(encoding="utf-8"), flags=re.DOTALL),
                          encoding="utf-8")
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
