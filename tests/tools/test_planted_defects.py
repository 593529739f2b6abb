"""Wrong actuators are found by the row that names their cause, and sound ones pass (docs/tools/verdict.md)."""

from __future__ import annotations

from itertools import islice

import pytest

from emcas_fmu.parameters import load_parameters

from ..docs.recipes import ROOT
from ..docs.test_tables import script

script("make_tables")  # which the other imports
verdict = script("make_verdict")
PLANTED = [(kind, k) for kind, defects in verdict.DEFECTS.items() for k in range(len(defects))]
# One of each sort: unstable, hunting, winding up, remembering, weak, inexact, late.
_QUICK = {"velocity gain × 2.2", "position gain 190 1/s", "no anti-windup at the drive's limit", "drive of 30 A",
          "velocity integral unwound though its gain is 0 (controller line)", "lever arm +2 % as built",
          "command 10 ms late"}


@pytest.mark.parametrize(("kind", "number"), [
    pytest.param(kind, k, id=f"{kind}: {verdict.DEFECTS[kind][k].what}",
                 marks=() if kind == "nonlinear" and verdict.DEFECTS[kind][k].what in _QUICK else pytest.mark.slow)
    for kind, k in PLANTED])
def test_a_wrong_actuator_fails_by_the_row_that_names_its_cause(kind: str, number: int) -> None:
    defect = verdict.DEFECTS[kind][number]
    assert {*verdict.failing(kind, number)} & {*defect.causes}, verdict.failing(kind, number)


def test_sound_units_pass() -> None:
    """Three of those that the slow test goes through."""
    units = verdict._judged(load_parameters(), list(islice(verdict.sound("nonlinear"), 3)))
    assert [[j.name for j in unit if not j.passed] for unit in units] == [[]] * 3


@pytest.mark.slow
@pytest.mark.parametrize("kind", verdict.DEFECTS)
def test_every_sound_unit_passes(kind: str) -> None:
    assert verdict.falsely_failing(kind) == ((),) * verdict.SAMPLES


@pytest.mark.slow
def test_the_page_is_not_stale() -> None:
    text = (ROOT / "docs/tools/verdict.md").read_text(encoding="utf-8")
    renewed = script("make_tables").renewed(text, verdict.TABLES["tools/verdict.md"])
    assert renewed == text, "run python docs/figures/make_verdict.py"
