"""The electrohydraulic actuator's shipped gains meet its shipped study in every case, and steps do not overshoot."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path

import pytest

from emcas_fmu.files import named_sets
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import shipped_study

MODEL = "electrohydraulic"
GAINS = ("controller.position.kp", "controller.position.ki", "controller.position.setpoint_weight")


def test_the_study_is_the_actuators() -> None:
    study = shipped_study(load_parameters(model=MODEL))
    assert tuple(t.name for t in study.tunables) == GAINS
    assert tuple(t.name for t in shipped_study(load_parameters()).tunables) != GAINS
    assert not any(t.bound(study.base.values[t.name]) for t in study.tunables if not t.name.endswith("weight"))


@pytest.mark.slow
@pytest.mark.parametrize("files", [(), (named_sets()["proportional-valve"],)])
def test_the_shipped_gains_meet_every_requirement(files: tuple[Path, ...]) -> None:
    study = shipped_study(load_parameters(files, model=MODEL))
    if files:  # what the set was chosen by
        study = replace(study, cases=tuple(case for case in study.cases if case.name == "nominal"))
    found = evaluate(study, {name: study.base.values[name] for name in GAINS})
    assert {j.requirement: j.measured for j in found.judgements if j.share > 1.0} == {}


@pytest.mark.parametrize("size", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("files", [(), (named_sets()["proportional-valve"],)])
def test_steps_overshoot_by_less_than_5_percent(files: tuple[Path, ...], size: float) -> None:
    values = load_parameters(files, model=MODEL).values
    found = simulate(values, 0.5, model=MODEL, fin_command=radians(size))["fin_angle"]
    assert 0.98 * radians(size) < found.max() < 1.05 * radians(size)
