"""The shipped study finds the shipped gains, to the percentage in their notes."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emcas_fmu.cli import app
from emcas_fmu.parameters import load_parameters

GAINS = ("controller.position.kp", "controller.position.ki", "controller.position.setpoint_weight",
         "controller.velocity.kp", "controller.antiwindup")
# Requirements that the shipped gains miss, and their largest ratio to the limit: see docs/model/control.md.
MISSED = {"load_step": 1.09, "rise_1deg": 1.03}


@pytest.mark.slow
def test_recorded_command_finds_the_shipped_gains(tmp_path: Path) -> None:
    found, figures = tmp_path / "tuned.toml", tmp_path / "tuned.json"
    result = CliRunner().invoke(app, ["tune", "--seed", "1", "--workers", str(os.cpu_count() or 1), "--output",
                                      str(found), "--json", str(figures)])
    assert result.exit_code == 1, result.output  # some requirements are missed
    shipped, tuned = load_parameters().values, load_parameters(found).values
    notes = {e.variable.name: e.note for e in load_parameters().entries}
    for name in GAINS:
        (within,) = re.findall(r"Within (\d+) % of what `emcas tune --seed 1`", notes[name])
        assert shipped[name] == pytest.approx(tuned[name], rel=0.01 * int(within)), name
    found_figures = json.loads(figures.read_text(encoding="utf-8"))
    missed = {row["requirement"]: 1.0 - row["margin"] for row in found_figures["requirements_before"]
              if not row["met"]}
    assert set(missed) == set(MISSED)
    assert all(missed[name] <= share for name, share in MISSED.items())
    objective = found_figures["objective"]
    assert objective["returned"] <= objective["before"] < 1.01 * objective["returned"]
    assert objective["nearby"] < 1.01 * objective["returned"]  # also with the third digit changed
