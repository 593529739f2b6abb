"""The shipped gains are, to the percentage that their notes say, what the shipped study finds."""

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
# What the shipped gains miss, as shares of the limit: docs/model/control.md says where.
GIVES_WAY = {"load_step": 1.09, "rise_1deg": 1.03}


@pytest.mark.slow
def test_the_recorded_command_gives_the_shipped_gains(tmp_path: Path) -> None:
    found, figures = tmp_path / "tuned.toml", tmp_path / "tuned.json"
    done = CliRunner().invoke(app, ["tune", "--seed", "1", "--workers", str(os.cpu_count() or 1), "--output",
                                    str(found), "--json", str(figures)])
    assert done.exit_code == 1, done.output  # not all can be had
    shipped, tuned = load_parameters().values, load_parameters(found).values
    notes = {e.variable.name: e.note for e in load_parameters().entries}
    for name in GAINS:
        (within,) = re.findall(r"Within (\d+) % of what `emcas tune --seed 1`", notes[name])
        assert shipped[name] == pytest.approx(tuned[name], rel=0.01 * int(within)), name
    # Before the search the shipped gains are judged.
    found_figures = json.loads(figures.read_text(encoding="utf-8"))
    missed = {row["requirement"]: 1.0 - row["margin"] for row in found_figures["requirements_before"]
              if not row["met"]}
    assert set(missed) == set(GIVES_WAY)
    assert all(missed[name] <= share for name, share in GIVES_WAY.items())
    objective = found_figures["objective"]
    assert objective["returned"] <= objective["before"] < 1.01 * objective["returned"]
    assert objective["nearby"] < 1.01 * objective["returned"]  # nor does a third digit more or less cost a percent
