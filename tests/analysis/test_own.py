"""The linear analysis of a user's actuator: limits, singular plants, dead bands, and margins to both sides."""

from __future__ import annotations

from dataclasses import replace
from math import inf, log10, pi, radians
from pathlib import Path
from typing import Any

import control as ct
import numpy as np
import pytest

from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator, obstacle
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import judge
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.studies.analysis.analyse import analyse
from emcas_fmu.studies.analysis.report import figures_of, tables, write_report
from tests.own_actuator.example import changed

GRID = np.array([0.5, 2.0, 7.0, 12.0, 40.0])
SPRING = "- p.spring.stiffness * x.fin_angle"
RATES = 'return {"fin_angle": x.fin_rate, "fin_rate": torque / inertia, "current": rise / p.motor.inductance}'
CONTROL = "c.kp * (c.setpoint_weight * command - x.fin_angle) + x.integral - c.kd * x.fin_rate"
INTEGRAL = "c.ki * (command - x.fin_angle)"
Change = tuple[str, str]


def rates(states: str = "", **changes: str) -> tuple[Change, Change]:
    """Return changes of the example's text: changed or additional derivatives, and additional states."""
    derivatives = {"fin_angle": "x.fin_rate", "fin_rate": "torque / inertia",
                   "current": "rise / p.motor.inductance", **changes}
    text = ", ".join(f'"{name}": {rate}' for name, rate in derivatives.items())
    return (RATES, f"return {{{text}}}"), ('em.State("current", "A")', f'em.State("current", "A"){states}')


def mine(folder: Path, *changes: Change, name: str = "mine.py") -> ParameterSet:
    """Return the parameters of the example with changed texts and a command limit of 4 deg."""
    model = str(changed(folder, *changes, name=name))
    return load_parameters(model=model).with_values({"command.limit": radians(4.0)})


def response(parameters: ParameterSet, at: float = 0.0) -> Any:
    linear = LinearActuator(parameters.values, radians(at), -20.0, parameters.model)
    return frequency.evaluate(linear.command_to_angle, GRID)


@pytest.mark.parametrize("limited", [
    "ops.clip(p.spring.stiffness * x.fin_angle, -0.3, 0.3)",
    "ops.maximum(ops.minimum(p.spring.stiffness * x.fin_angle, 0.3), -0.3)"])
def test_limit_in_the_plant_is_linearised_on_each_side(tmp_path: Path, limited: str) -> None:
    """The moment of a spring is limited to 0.3 N.m, at 0.86 deg: beyond that angle the stiffness is zero."""
    limit, plain = mine(tmp_path, (SPRING, f"- {limited}")), mine(tmp_path, name="plain.py")
    free = plain.with_values({"spring.stiffness": 0.0})
    np.testing.assert_allclose(response(limit, 0.5), response(plain), rtol=1e-9)  # exact Jacobians: rounding
    np.testing.assert_allclose(response(limit, 2.0), response(free), rtol=1e-9)
    assert np.max(np.abs(response(plain) / response(free) - 1.0)) > 1e-3


def test_limit_in_the_controllers_is_linearised_on_each_side(tmp_path: Path) -> None:
    """The gain rises with the angle, between 1 and 1.5 deg."""
    gain = f"ops.clip(x.fin_angle / {radians(1.0)!r}, 1.0, 1.5) * c.kp"
    scheduled = mine(tmp_path, ("demand = c.kp * (c.setpoint_weight * command - x.fin_angle)",
                                f"demand = {gain} * (command - x.fin_angle)"))
    plain = mine(tmp_path, (CONTROL, CONTROL.replace("c.setpoint_weight * ", "")), name="plain.py")
    for at, factor in ((0.5, 1.0), (3.0, 1.5)):
        raised = plain.with_values({"controller.kp": factor * plain.values["controller.kp"]})
        np.testing.assert_allclose(response(scheduled, at), response(raised, at), rtol=1e-9)


def test_response_at_the_command_limit_is_that_at_zero(tmp_path: Path) -> None:
    parameters = mine(tmp_path)
    np.testing.assert_allclose(response(parameters, 4.0), response(parameters, 0.0), rtol=1e-9)


SINGULAR = {
    "an integrator": rates(fin_angle="u.reference", fin_rate="0.0", current="0.0"),
    "a static plant": rates(fin_angle="30.0 * (0.1 * u.reference - x.fin_angle)", fin_rate="0.0", current="0.0"),
    "an undamped mode beside": rates(', em.State("q", "rad"), em.State("qd", "rad/s")', q="x.qd",
                                     qd="-400.0 * x.q + 0.1 * x.fin_rate"),
    "a redundant state": rates(', em.State("copy", "rad")', copy="3.0 * x.fin_rate",
                               fin_rate="(torque + 0.01 * x.copy) / inertia"),
    "a state that integrates at rest": rates(', em.State("a", "rad"), em.State("b", "rad")', a="x.b", b="0.0"),
    "a dead-beat loop": (*rates(fin_angle="1000.0 * u.reference", fin_rate="0.0", current="0.0"),
                         (CONTROL, "(command - x.fin_angle) * 0.001 / p.controller.sample_time"), (INTEGRAL, "0.0")),
}
REFUSED: dict[str, tuple[tuple[Change, ...], str]] = {
    "two integrators": (rates(fin_rate="50.0 * u.reference"), "unstable .* lower the gains"),
    "a mode beyond all numbers": (rates(', em.State("q", "rad")', q="1e6 * x.q"),
                                  "beyond all numbers .* check the signs"),
    "a fixed fin": (rates(fin_angle="0.0", fin_rate="0.0", current="0.0"), "does not react to a small reference"),
    "a clock": (rates(', em.State("clock", "s")', clock="1.0"), "d/dt of clock does not become 0"),
    "a root of 0": (rates(fin_rate="(torque - ops.sqrt(ops.fabs(x.fin_rate))) / inertia"),
                    "d/dt of fin_rate has no finite slope, .* make `derivatives` smooth"),
    "a logarithm of 0": (rates(fin_rate="(torque + ops.log(x.fin_angle)) / inertia"),
                         "d/dt of fin_rate is not finite; make `derivatives` smooth"),
    "a root of 0 in the controllers": (((CONTROL, f"ops.sqrt(ops.fabs(command - x.fin_angle)) + {CONTROL}"),),
                                       "the controllers have no finite value or slope, .* make `sample` smooth"),
}


@pytest.mark.parametrize("plant", SINGULAR)
def test_singular_plant_has_bandwidth_and_margins(tmp_path: Path, plant: str) -> None:
    parameters = mine(tmp_path, *SINGULAR[plant])
    linear = LinearActuator(parameters.values, radians(1.0), model=parameters.model)
    assert linear.stable
    assert frequency.response(linear.command_to_angle).gain[0] == pytest.approx(1.0, abs=0.2)
    assert frequency.margins(linear.loop("reference")).gain_db > 1.0


@pytest.mark.slow
def test_page_of_a_plant_without_bandwidth_and_load_response(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gain of the static plant is above -3 dB up to half the sample rate, and a load does not move it."""
    # The trial simulation would refuse it, since d/dt of its angle is not its rate.
    monkeypatch.setattr("emcas_fmu.runtime.trial.try_out", lambda *arguments: None)
    found = analyse(mine(tmp_path, *SINGULAR["a static plant"]))
    figures = figures_of(found)
    assert figures["linear"]["bandwidth_3db_hz"] is None
    assert len(tables(figures, "the reference")["margins"].rows) == 8
    write_report(found, tmp_path / "page.html")
    assert "gain margin down" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("plant", REFUSED)
def test_error_of_a_plant_that_cannot_be_linearised_is_one_line(tmp_path: Path, plant: str) -> None:
    changes, message = REFUSED[plant]
    with pytest.raises(EmcasError, match=message) as refused:
        analyse(mine(tmp_path, *changes))
    assert "\n" not in str(refused.value)


INSENSITIVE = {
    "a dead band": ("c.kp * ops.where(ops.fabs(command - x.fin_angle) > 1e-3, command - x.fin_angle, 0.0)"
                    " - c.kd * x.fin_rate"),
    "a quantiser": ("c.kp * ops.where(command - x.fin_angle > 1e-3, 1e-3, "
                    "ops.where(command - x.fin_angle < -1e-3, -1e-3, 0.0)) - c.kd * x.fin_rate"),
    "an off state": "ops.where(ops.fabs(command - x.fin_angle) > 1e-3, c.kp * (command - x.fin_angle), 0.0)",
}


@pytest.mark.parametrize("stiffness", [0.0, 20.0])
@pytest.mark.parametrize("law", INSENSITIVE)
def test_controllers_that_do_not_react_at_rest_are_refused(tmp_path: Path, law: str, stiffness: float) -> None:
    parameters = mine(tmp_path, (CONTROL, INSENSITIVE[law]), (INTEGRAL, "0.0"))
    parameters = parameters.with_values({"spring.stiffness": stiffness})
    with pytest.raises(EmcasError, match=r"the controllers do not react to a small deviation at rest .*dead band"):
        analyse(parameters)
    subject = ParameterSubject(parameters)
    chosen = load_requirements(None, parameters)
    linear = replace(chosen, requirements=tuple(r for r in chosen.requirements if r.test and r.test.kind == "linear"))
    # Linear requirements are not judged, for the reason that the analysis names.
    assert {(j.skipped, j.note) for j in judge(subject, linear)} == {(True, obstacle(parameters))}


def test_valve_with_overlap_is_refused(tmp_path: Path) -> None:
    parameters = mine(tmp_path, ("rise = voltage(ops, u)",
                                 "rise = ops.where(ops.fabs(u.reference) > 0.1, u.reference, 0.0)"))
    for at in (0.0, 2.0):
        with pytest.raises(EmcasError, match="the fin does not react to a small reference at rest"):
            analyse(parameters, radians(at))


# -- gain margins to both sides -----------------------------------------------------


def test_gain_margin_at_half_the_sample_rate() -> None:
    """L = K T/(z - 1) has the closed-loop pole 1 - K T, which is -1 at K T = 2: an oscillation at half the rate."""
    found = frequency.margins(ct.ss([[1.0]], [[0.5]], [[1.0]], [[0.0]], 1e-3))
    assert found.gain == pytest.approx(4.0, rel=1e-12)
    assert found.phase_crossover == pytest.approx(500.0)
    assert (found.reduction, found.down_db) == (0.0, inf)


def test_unstable_plant_needs_a_minimum_gain() -> None:
    """L = K/(s - 1) is stable for K > 1: at K = 1 a real pole is at s = 0."""
    found = frequency.margins(ct.ss([[1.0]], [[4.0]], [[1.0]], [[0.0]]))
    assert (found.gain, found.up_db) == (inf, inf)
    assert found.reduction == pytest.approx(0.25, rel=1e-12)
    assert found.reduction_crossover == 0.0
    assert found.gain_db == found.down_db == pytest.approx(20.0 * log10(4.0), rel=1e-12)


def test_loop_with_gain_margins_to_both_sides() -> None:
    """L = K (s + 1)^2/(s^3 (s/20 + 1)^2) has a phase of -180 deg at two frequencies."""
    numerator, lag = np.polymul([1.0, 1.0], [1.0, 1.0]), np.polymul([0.05, 1.0], [0.05, 1.0])
    loop = ct.ss(ct.tf(3.0 * numerator, np.polymul([1.0, 0.0, 0.0, 0.0], lag)))
    found = frequency.margins(loop, frequency.frequencies(100.0, 0.01))
    # 2 atan(w) - 2 atan(w/20) = 90 deg: tan of the difference is 1 at w^2/20 - 0.95 w + 1 = 0.
    slow, fast = sorted(np.roots([0.05, -0.95, 1.0]).real)
    for w, at, factor in ((fast, found.phase_crossover, found.gain),
                          (slow, found.reduction_crossover, found.reduction)):
        size = 3.0 * (1.0 + w**2) / (w**3 * (1.0 + (w / 20.0) ** 2))
        assert at == pytest.approx(w / (2.0 * pi), rel=1e-5)  # splines between 500 frequencies per decade
        assert factor == pytest.approx(1.0 / size, rel=1e-5)
    assert found.gain_db == min(found.up_db, found.down_db)
    for factor in (found.gain, found.reduction):
        grows = [np.max(ct.feedback(loop * factor * off, 1).poles().real) > 0.0 for off in (0.999, 1.001)]
        assert grows == [factor < 1.0, factor > 1.0]


def test_required_gain_margin_is_the_smaller_of_both(tmp_path: Path) -> None:
    """A hinge moment of +2 kN.m/rad diverges: with less gain the controllers do not hold the fin."""
    parameters = mine(tmp_path, (SPRING, "+ 2000.0 * x.fin_angle"))
    linear = LinearActuator(parameters.values, model=parameters.model)
    margins = frequency.margins(linear.loop("reference"))
    assert margins.down_db < margins.up_db
    ((measured,),) = measure(Test("linear"), ParameterSubject(parameters), [{}], ("gain_margin",), ("minimum",))
    assert measured == pytest.approx(margins.down_db, rel=1e-5)
    gains = ("controller.kp", "controller.ki", "controller.kd")
    stable = [LinearActuator({**parameters.values, **{name: factor * parameters.values[name] for name in gains}},
                             model=parameters.model).stable
              for factor in (0.999 * margins.reduction, 1.001 * margins.reduction, 0.999 * margins.gain,
                             1.001 * margins.gain)]
    assert stable == [False, True, True, False]
    figures = figures_of(analyse(parameters))["linear"]
    assert figures["gain_margin_db"] == figures["gain_margin_down_db"] == pytest.approx(margins.down_db, rel=1e-9)
    assert figures["loops"]["reference"]["gain_margin_up_db"] == pytest.approx(margins.up_db, rel=1e-9)
