"""Pages of actuators other than the default one: loads, errors and limits are theirs."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, capabilities, get
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import judge
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import RATED
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.analyse import SECTIONS
from emcas_fmu.studies.analysis.envelope import envelope
from emcas_fmu.studies.analysis.final_values import final_values
from emcas_fmu.studies.report import accuracy, stiffness
from emcas_fmu.studies.report.acceptance import carry_out
from emcas_fmu.studies.report.outcome import Rig


def rig(model: str = "nonlinear") -> Rig:
    """Return the rig for an actuator's default set."""
    return Rig(ParameterSubject(load_parameters(model=model)))


@pytest.mark.parametrize("model", NAMES)
def test_rated_load_does_not_stall_the_actuator(model: str) -> None:
    """The rated load of the requirements is one against which the fin reaches the end of its range."""
    parameters = load_parameters(model=model)
    load = load_requirements(None, parameters).rated_load
    assert load == {"servo": 5.0}.get(model, RATED)
    limit = ParameterSubject(parameters).command_limit
    run = simulate(parameters.values, 1.0, model=model, fin_command=limit, aero_torque=-load)
    assert run["fin_angle"][-1] > 0.9 * limit
    assert Rig(ParameterSubject(parameters)).load == load
    assert Rig(ParameterSubject(parameters), 7.0).load == 7.0


@pytest.mark.parametrize(("model", "share"), [("worm-gear", 0.0), ("series-clutch", 0.0), ("nonlinear", 0.8)])
def test_a_load_that_friction_holds_leaves_no_error(model: str, share: float) -> None:
    """A worm or no-back that locks holds the load. The default screw's friction carries about a fifth of 100 N.m."""
    row = final_values(load_parameters(model=model).values, model=model)["p"]
    assert row["load_error_deg"] < -0.5
    assert row["simulated_load_error_deg"] == pytest.approx(share * row["load_error_deg"], abs=0.05)


@pytest.mark.parametrize("model", NAMES)
def test_only_a_motor_fixed_to_the_screw_makes_a_rod(model: str) -> None:
    provides = get(model).provides
    rod = provides.issuperset(SECTIONS["modes"][1])
    expected = capabilities.SCREW_AND_LEVER in provides and "clutch" not in model
    assert rod == expected
    for extension in ("stribeck", "lugre", "efficiency", "heat"):
        assert get(f"nonlinear+{extension}").provides.issuperset(SECTIONS["modes"][1]), extension


@pytest.mark.parametrize("model", ["servo", "clutch"])
def test_an_envelope_does_not_advise_an_extension_that_is_refused(model: str) -> None:
    with pytest.raises(EmcasError) as error:
        envelope(load_parameters(model=model), 10.0)
    assert f" {model}+heat" not in str(error.value)


def test_a_fin_that_creeps_has_no_threshold_at_the_start_of_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worm gear's fin still creeps after a motion. Its threshold does not count this as an answer."""
    creeping = rig("worm-gear")
    detected, words = accuracy.detected_motion(creeping.subject)
    assert words.startswith("1 % of the accuracy")
    starts: list[Any] = []

    def search(moves: Any, low: float, high: float) -> float:
        starts.append(moves(low))
        return high

    monkeypatch.setattr(accuracy, "smallest", search)
    accuracy.threshold(creeping)
    assert starts == [False] * 6
    assert detected > 0.0


@pytest.mark.parametrize("model", NAMES)
def test_inputs_without_effect_are_those_that_are_declared(model: str) -> None:
    """A load moves every other fin at full command against it, and a low supply slows every other one down."""
    parameters = load_parameters(model=model)
    subject = ParameterSubject(parameters)
    load = load_requirements(None, parameters).rated_load
    changes: dict[str, float] = {"aero_torque": -2.0 * load}
    if subject.supply and subject.actuator.supply:
        changes[subject.supply] = 0.3 * subject.actuator.supply.input.initial(parameters.values)

    def response(**inputs: Any) -> Any:
        return simulate(parameters.values, 0.15, model=model, fin_command=subject.command_limit, **inputs)["fin_angle"]

    fixed = {name for name, value in changes.items() if np.array_equal(response(), response(**{name: value}))}
    assert fixed == subject.actuator.without_effect


def test_requirements_on_loads_that_have_no_effect_are_not_judged() -> None:
    subject = ParameterSubject(load_parameters(model="second-order"))
    specification = load_requirements(None, subject.parameters)
    verdicts = {j.name: j for j in judge(subject, specification)}
    for r in specification.requirements:
        loaded = bool(r.test and r.test.torque and r.test.kind != "repeat")
        assert not loaded or verdicts[r.name].skipped, r.name
    assert verdicts["load_step"].note == "aero_torque has no effect on this actuator's motion"
    assert verdicts["repeatable"].passed
    outcome = stiffness.measure(Rig(subject))
    assert (outcome.groups, outcome.stopped) == ({}, "")
    assert set(outcome.not_applicable.values()) == {"aero_torque has no effect on this actuator's motion"}
    assert set(outcome.not_applicable) == {q.key for q in stiffness.QUANTITIES}


def test_a_threshold_at_the_start_of_the_search_is_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accuracy, "smallest", lambda moves, low, high: low)
    groups = accuracy.threshold(rig()).groups
    for group in groups.values():
        assert [group.shown(q)[:2] for q in accuracy.THRESHOLD] == ["≤ ", "≤ "]


@pytest.mark.parametrize(("model", "share", "hinge"), [("elastic", 1.0, 2.0), ("nonlinear+stribeck", 1.3, 0.0),
                                                       ("nonlinear+lugre", 1.26, 0.0)])
def test_breakaway_is_not_the_twist_of_a_fin_that_stays(model: str, share: float, hinge: float) -> None:
    """Friction at the motor, times the ratio, and at the hinge hold the fin; shaft, gap and bristles yield before.

    2 % is the ratio of the bisection's moments, half a percent the ramp's and the friction's dependence on the angle.
    """
    def moved_by(name: str) -> float:
        groups = stiffness.measure(rig(name)).groups
        return float(groups["breakaway"].figures["positive_n_m"])

    assert moved_by(model) == pytest.approx(share * moved_by("nonlinear") + hinge, rel=0.025)


def test_breakaway_of_a_fin_with_a_small_range() -> None:
    """A fin that breaks away comes to rest at its stop, less than 1 deg away."""
    small = {"fin.stop_angle": radians(0.9), "command.limit": radians(0.8)}
    wide, narrow = (stiffness.measure(Rig(ParameterSubject(load_parameters().with_values(changed)))).groups
                    for changed in ({}, small))
    assert narrow["breakaway"].figures == wide["breakaway"].figures


def test_inputs_without_effect_exist() -> None:
    with pytest.raises(EmcasError, match="without_effect: there is no input aero_torqe; did you mean aero_torque"):
        replace(get("second-order"), without_effect=frozenset({"aero_torqe"}))


def test_a_requirement_on_a_figure_that_does_not_apply_is_not_judged(tmp_path: Path) -> None:
    """The report of an actuator that no load moves ends with a verdict on a stiffness figure, not with an error."""
    path = tmp_path / "mine.toml"
    path.write_text("[[requirements]]\nname = 'breaks'\nfigure = 'dynamic_stiffness.breakaway.positive_n_m'\n"
                    "maximum = '20 N*m'\noptional = true\n", encoding="utf-8")
    parameters = load_parameters(model="second-order")
    result = carry_out(ParameterSubject(parameters), specification=load_requirements(path, parameters))
    (judged,) = result.judged
    assert judged.skipped
    assert "aero_torque has no effect" in judged.note
