"""The report finds wrong actuators by the row that names the cause, and passes sound ones (docs/tools/verdict.md)."""

from __future__ import annotations

from itertools import islice

import pytest

from emcas_fmu.actuators import NAMES
from emcas_fmu.parameters import load_parameters

from ..docs.recipes import ROOT
from ..docs.test_tables import script

script("make_tables")  # make_verdict imports it
verdict = script("make_verdict")
PLANTED = [(kind, k) for kind, defects in verdict.DEFECTS.items() for k in range(len(defects))]
# One defect each: unstable, limit cycle, wind-up, memory, weak, inexact, late.
_QUICK = {"velocity gain × 2.2", "position gain 190 1/s", "no anti-windup at the drive's limit", "drive of 30 A",
          "velocity integral unwound though its gain is 0 (controller line)", "lever arm +2 % as built",
          "command 10 ms late"}
_SLOW = {"worm-gear-elastic", "electrohydrostatic", "electrohydraulic", "clutch"}
_SLOWER = {"habibi", "ozkan", "elastic", "series-clutch"}  # only the shipped set of these is judged in a quick test


def _is_quick(kind: str, number: int) -> bool:
    """Return whether a defect's case is not marked slow: some of the default actuator, the first of some others."""
    if kind == "nonlinear":
        return verdict.DEFECTS[kind][number].what in _QUICK
    return kind not in _SLOW | _SLOWER and not number


@pytest.mark.parametrize(("kind", "number"), [
    pytest.param(kind, k, id=f"{kind}: {verdict.DEFECTS[kind][k].what}",
                 marks=() if _is_quick(kind, k) else pytest.mark.slow)
    for kind, k in PLANTED])
def test_wrong_actuator_fails_the_row_that_names_the_cause(kind: str, number: int) -> None:
    """Or it fails no row, and the page says why."""
    defect, failed = verdict.DEFECTS[kind][number], verdict.failing(kind, number)
    assert bool(defect.causes) is not bool(defect.why)
    assert {*failed} & {*defect.causes} or (defect.why and not failed), failed


def test_every_actuator_has_at_least_three_detectable_defects() -> None:
    assert {*verdict.DEFECTS} == {*NAMES}
    assert min(sum(bool(d.causes) for d in defects) for defects in verdict.DEFECTS.values()) >= 3


@pytest.mark.parametrize("kind", ["nonlinear", "linear", "second-order", "ristanovic"])
def test_two_sound_units_pass(kind: str) -> None:
    units = verdict._judged(load_parameters(model=kind), list(islice(verdict.sound(kind), 2)))
    assert [{*verdict._failed(unit)} - {*verdict.missed(kind)} for unit in units] == [set()] * 2


def test_shipped_actuators_meet_all_rows_except_ristanovic() -> None:
    missed = {kind: verdict.missed(kind) for kind in verdict.DEFECTS if kind not in _SLOW}
    assert {kind: rows for kind, rows in missed.items() if rows} == {
        "ristanovic": ("settling", "gain_margin", "phase_margin")}


@pytest.mark.slow
@pytest.mark.parametrize("kind", verdict.DEFECTS)
def test_every_sound_unit_passes(kind: str) -> None:
    assert verdict.falsely_failing(kind) == ((),) * verdict.samples(kind)


@pytest.mark.slow
def test_page_is_up_to_date() -> None:
    text = (ROOT / "docs/tools/verdict.md").read_text(encoding="utf-8")
    renewed = script("make_tables").renewed(text, verdict.TABLES["tools/verdict.md"])
    assert renewed == text, "run python docs/figures/make_verdict.py"
