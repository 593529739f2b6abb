"""The hydraulic actuators' shipped gains meet their shipped studies in every case, and steps do not overshoot."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.bench.measure import describing_function
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import shipped_study
from emcas_fmu.support.files import named_sets

MODEL, PUMP = "electrohydraulic", "electrohydrostatic"
GAINS = ("controller.position.kp", "controller.position.ki", "controller.position.setpoint_weight")


def test_shipped_study_tunes_the_actuators_gains() -> None:
    study = shipped_study(load_parameters(model=MODEL))
    assert tuple(t.name for t in study.tunables) == GAINS
    assert tuple(t.name for t in shipped_study(load_parameters()).tunables) != GAINS
    assert not any(t.bound(study.base.values[t.name]) for t in study.tunables if not t.name.endswith("weight"))


@pytest.mark.slow
@pytest.mark.parametrize("files", [(), (named_sets()["proportional-valve"],)])
def test_shipped_gains_meet_every_requirement(files: tuple[Path, ...]) -> None:
    study = shipped_study(load_parameters(files, model=MODEL))
    if files:  # the set was tuned for this case only
        study = replace(study, cases=tuple(case for case in study.cases if case.name == "nominal"))
    (found,) = evaluate(study, [{name: study.base.values[name] for name in GAINS}])
    assert {j.requirement: j.measured for j in found.judgements if j.share > 1.0} == {}


@pytest.mark.slow
def test_shipped_gains_of_the_pump_meet_every_requirement() -> None:
    study = shipped_study(load_parameters(model=PUMP))
    (found,) = evaluate(study, [{t.name: study.base.values[t.name] for t in study.tunables}])
    assert {(j.requirement, j.case): j.measured for j in found.judgements if j.share > 1.0} == {}


def test_pump_follows_small_sines_only_with_friction_compensation() -> None:
    """The gain at 10 Hz and 0.1 deg is above -3 dB = 0.71; without compensation dry friction holds the fin."""
    subject = ParameterSubject(load_parameters(model=PUMP))
    gains = [{"compensation.gain": gain} for gain in (1.0, 0.0)]
    compensated, uncompensated = np.abs(describing_function(subject, gains, radians(0.1), [10.0] * 2))
    assert compensated > 0.71
    assert not uncompensated >= 0.1  # nan if the response is not a sine


def test_pump_does_not_hunt_if_friction_is_30_percent_less_than_its_compensation() -> None:
    """30 % is the scatter of a lot. At rest, loaded or not, the fin stays within the transducer's resolution."""
    values = load_parameters(model=PUMP).with_values({"deviation.friction.coulomb": -0.3}).values
    for torque in (0.0, 50.0):
        run = simulate(values, 2.0, model=PUMP, fin_command=radians(5.0), aero_torque=torque)
        rest = run["fin_angle"][run["time"] > 1.0]
        assert rest.max() - rest.min() < values["transducer.resolution"]


@pytest.mark.parametrize("size", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("files", [(), (named_sets()["proportional-valve"],)])
def test_steps_overshoot_by_less_than_5_percent(files: tuple[Path, ...], size: float) -> None:
    values = load_parameters(files, model=MODEL).values
    found = simulate(values, 0.5, model=MODEL, fin_command=radians(size))["fin_angle"]
    assert 0.98 * radians(size) < found.max() < 1.05 * radians(size)
