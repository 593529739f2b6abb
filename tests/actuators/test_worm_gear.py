"""The worm gear against closed forms: efficiencies, torques, self-locking, stall, symmetry, energy, rules."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from math import atan, cos, exp, isclose, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.bench.metrics import sustained_rate
from emcas_fmu.namespace import namespace
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import worm
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import load_study
from emcas_fmu.support.files import models_directory
from tests.marks import slow
from tests.runs import input_levels, run_both_kernels, run_within_stops

MODEL = "worm-gear"
# Friction falls from 0.15 at rest to 0.04 in motion: the worm locks at rest, but a load keeps a moving worm turning.
FALLING = {"worm.friction": 0.04, "worm.static_ratio": 3.75}
QUICK = settings(derandomize=True, max_examples=20)


@cache
def shipped() -> Mapping[str, Any]:
    return load_parameters(model=MODEL).values


def values(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    return {**shipped(), **(overrides or {})}


def run(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(values({"encoder.enabled": False, **overrides}), stop, step, model=MODEL, **inputs)


def efficiencies(v: Mapping[str, Any], mu: float | None = None) -> tuple[float, float]:
    """Return forward and backward efficiency from the power of the forces between two sliding flanks.

    The forces are a normal force of 1, with components along the worm's rim, along its axis and radial, and friction
    along the thread.
    """
    mu, lead = v["worm.friction"] if mu is None else mu, atan(v["worm.starts"] / v["worm.diameter_quotient"])
    alpha = v["worm.pressure_angle"]
    normal = np.array([sin(lead) * cos(alpha), cos(lead) * cos(alpha), sin(alpha)])
    thread = np.array([cos(lead), -sin(lead), 0.0])
    rim, axial = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    ratios = []
    for friction in (mu, -mu):  # the motor drives the load; the load drives the motor, with opposite friction
        force = normal + friction * thread
        ratios.append(sin(lead) * force @ axial / (cos(lead) * force @ rim))  # power at the wheel over that at the worm
    return float(ratios[0]), 1.0 / float(ratios[1])


@QUICK
@given(starts=st.integers(1, 6), quotient=st.floats(6.0, 20.0), alpha=st.floats(0.2, 0.5), mu=st.floats(0.01, 0.3),
       speed=st.floats(-400.0, 400.0))
def test_efficiencies_follow_from_the_forces(starts: int, quotient: float, alpha: float, mu: float,
                                             speed: float) -> None:
    v = {**{name: value for name, value in shipped().items() if name.startswith("worm.")}, "worm.starts": starts,
         "worm.diameter_quotient": quotient, "worm.pressure_angle": alpha, "worm.friction": mu}
    p = namespace(v)
    forward, backward = worm.forward(FLOATS, p, speed), worm.backward(FLOATS, p, speed)
    limit = cos(alpha) * starts / quotient
    assume(not isclose(mu, limit, rel_tol=1e-9))  # where rounding decides
    expected = efficiencies(v)
    assert forward == pytest.approx(expected[0], rel=1e-12)
    # Rounding; near the limit of self-locking it is that of a difference of numbers near 1.
    assert backward == pytest.approx(expected[1], rel=1e-12, abs=1e-12)
    assert max(forward, backward) < 1.0
    assert (backward < 0.0) == (mu > limit)


@pytest.mark.parametrize("alpha", [14.5, 20.0, 30.0])
def test_a_worm_at_the_limit_of_self_locking_is_less_than_half_efficient(alpha: float) -> None:
    """The efficiency is (1 - tan^2 lambda)/2 for any pressure angle: the thesis's 50 %."""
    v = {**shipped(), "worm.starts": 2, "worm.pressure_angle": radians(alpha),
         "worm.friction": 0.2 * cos(radians(alpha))}
    p = get(MODEL).plant(v)
    assert worm.forward(FLOATS, p, 0.0) == pytest.approx(0.5 * (1.0 - 0.2**2), rel=1e-12)
    assert worm.backward(FLOATS, p, 0.0) == pytest.approx(0.0, abs=1e-15)


def test_friction_falls_with_the_sliding_speed() -> None:
    v = values({**FALLING, "worm.stribeck_speed": 0.2})
    p = get(MODEL).plant(v)
    lead = atan(v["worm.starts"] / v["worm.diameter_quotient"])
    # On the pitch diameter of 15 mm the sliding speed along the thread is w r/cos(lambda).
    speed = 0.2 * cos(lead) / 7.5e-3
    for w, mu in ((0.0, 0.15), (speed, 0.04 + 0.11 * exp(-1.0)), (-speed, 0.04 + 0.11 * exp(-1.0)), (1e3, 0.04)):
        assert worm.coefficient(FLOATS, p, w) == pytest.approx(mu, rel=1e-12)


@pytest.mark.parametrize(("mu", "torque"), [(0.1, -100.0), (0.1, 100.0), (0.05, 100.0), (0.05, -100.0)])
def test_motor_torque_against_and_with_a_load(mu: float, torque: float) -> None:
    """Besides friction it is T/(N eta_f) against a load T, and -eta_b T/N with it, positive if the worm locks."""
    rate = radians(30.0)
    v = values({"worm.friction": mu})
    shown = run({"worm.friction": mu}, 0.6, fin_command=lambda t: rate * t, aero_torque=torque)
    steady = slice(500, 600)
    forward, backward = efficiencies(v)
    speed = float(np.mean(shown["motor_speed"][steady]))
    load = (v["friction.fin_coulomb"] - torque) / 60.0  # against the motion
    expected = 0.1 + 5e-4 * speed + load * (1.0 / forward if load > 0.0 else backward)
    # The integral still settles: up to 5 rad/s2 accelerate 2.9e-4 kg.m2.
    assert np.mean(shown["motor_torque"][steady]) == pytest.approx(expected, abs=1.5e-3)
    loss = load * (1.0 / forward - 1.0 if load > 0.0 else backward - 1.0) * speed
    assert np.mean(shown["worm_loss"][steady]) == pytest.approx(loss, rel=1e-3)
    if torque > 0.0 and mu > 0.094:
        assert np.all(shown["supply_power"][steady] > 0.0)  # no power returns to the supply


@QUICK
@given(mu=st.floats(0.0941, 0.5), load=st.floats(-1e6, 1e6), start=st.floats(-0.4, 0.4))
def test_locks_to_the_bit_under_any_load(mu: float, load: float, start: float) -> None:
    """With a friction above cos(20 deg)/10 = 0.09397 no load moves the fin of a disabled motor."""
    shown = run({"worm.friction": mu, "fin.start_angle": start}, 0.1, enable=False,
                aero_torque=lambda t: load if t < 0.05 else -load)
    assert len(set(shown["fin_angle"])) == 1
    assert shown["fin_angle"][0] == pytest.approx(start, abs=1e-15)
    assert not shown["worm_loss"].any()


@pytest.mark.parametrize("mu", [0.02, 0.05, 0.09])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_load_drives_a_worm_that_does_not_lock(mu: float, side: float) -> None:
    v = values({"worm.friction": mu})
    _, backward = efficiencies(v)
    breakaway = v["friction.fin_coulomb"] + 0.1 * 60.0 / backward
    ends = [run({"worm.friction": mu}, 0.1, enable=False, aero_torque=side * share * breakaway)["fin_angle"][-1]
            for share in (0.999, 1.001)]
    assert ends[0] == 0.0
    assert side * ends[1] > 0.0


def test_stall_load_is_the_largest_that_the_motor_moves() -> None:
    """It is N eta_f (K_t I - C_m) = 187 N.m, less the friction of the fin shaft."""
    v = values()
    forward, _ = efficiencies(v)
    quick = {"drive.ki": 200.0}  # with the shipped gain the last 5 % of the current take minutes
    stall = 60.0 * forward * (v["motor.torque_constant"] * v["drive.current_limit"] - 0.1)
    assert stall == pytest.approx(187.0, abs=1.0)
    largest = stall - v["friction.fin_coulomb"]
    angles = [run(quick, 0.6, fin_command=radians(20.0), aero_torque=-share * largest)["fin_angle"]
              for share in (0.98, 1.001)]
    assert angles[0][-1] > radians(5.0)
    assert not angles[1].any()


@pytest.mark.parametrize("overrides", [{}, FALLING])
def test_symmetric_actuator_has_mirrored_response(overrides: Mapping[str, Any]) -> None:
    def response(side: float) -> Any:
        shown = run({**overrides, "drive.current_offset": 0.0}, 0.4,
                    fin_command=lambda t: side * radians(15.0) * (1.0 if t < 0.2 else -1.0),
                    aero_torque=lambda t: side * 80.0 * sin(30.0 * t))
        return np.stack([shown[name] for name in ("fin_angle", "fin_rate", "motor_current", "motor_voltage")])

    # Without an encoder, which rounds down, a change of all signs is exact in floating point.
    np.testing.assert_array_equal(response(1.0), -response(-1.0))


@pytest.mark.parametrize("overrides", [{}, {"worm.friction": 0.05}, FALLING])
@pytest.mark.parametrize("torque", [60.0, -60.0])
def test_energy(overrides: Mapping[str, Any], torque: float) -> None:
    """The work of motor and load equals the losses (worm, friction, hinge) and stored energy; the worm only loses."""
    step = 1e-5
    changed = {**overrides, "solver.max_tick": step, "friction.fin_viscous": 1.0}
    v = values(changed)
    shown = run(changed, 0.15, step, fin_command=lambda t: 0.05 * sin(40.0 * t), aero_torque=torque)
    speed, rate = shown["motor_speed"], shown["fin_rate"]
    powers = {"motor": shown["motor_torque"] * speed, "load": shown["hinge_torque"] * rate, "worm": shown["worm_loss"],
              "friction": 0.1 * np.abs(speed) + 5e-4 * speed**2, "hinge": 2.0 * np.abs(rate) + rate**2}
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}
    stored = 0.5 * ((v["inertia.motor"] + v["inertia.worm"]) * speed**2 + 0.06 * rate**2)
    # Of 7 J; torques and the worm's loss jump within a row at reversals.
    assert work["motor"] + work["load"] == pytest.approx(
        work["worm"] + work["friction"] + work["hinge"] + stored[-1] - stored[0], abs=1e-3)
    assert shown["worm_loss"].min() >= 0.0
    assert work["worm"] > 1.0


def test_falling_friction_locks_at_rest_and_not_in_motion() -> None:
    """A worm at rest holds a load that keeps a worm turning whose motor is disabled in motion."""
    def disabled(overrides: Mapping[str, Any], begin: float) -> Any:
        return run(overrides, 1.0, fin_command=lambda t: radians(30.0) * t, aero_torque=100.0,
                   enable=lambda t: t < begin)["fin_angle"]

    assert not disabled(FALLING, 0.0).any()
    assert disabled(FALLING, 0.2)[-1] == pytest.approx(radians(25.0), rel=1e-9)  # at its stop
    constant = disabled({}, 0.2)
    # (0.1 + 0.064 98/60) N.m brake 2.9e-4 kg.m2 from 31 rad/s within 1.3 deg of the fin.
    assert constant[200] < constant[-1] == constant[-300] < constant[200] + radians(1.3)


def test_deviation_of_the_worm_friction_equals_a_changed_friction() -> None:
    """The controllers do not read the friction of the flanks, so its nominal value does not matter."""
    one, other = (run(changes, 0.2, fin_command=0.1, aero_torque=-50.0)["fin_angle"] for changes in (
        {"worm.friction": 0.12}, {"worm.friction": 0.1, "deviation.worm.friction": 0.2}))
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)  # 0.1 times 1.2 is rounded


@pytest.mark.parametrize("overrides", [{}, FALLING])
def test_kernels_agree(overrides: Mapping[str, Any]) -> None:
    run_both_kernels(values({**overrides, "worm.starts": 2, "worm.teeth": 61}), 0.2, MODEL, 0.37e-3,
                     fin_command=lambda t: 0.2 * sin(25.0 * t), aero_torque=lambda t: 120.0 * sin(60.0 * t),
                     enable=lambda t: t < 0.15)


def test_a_load_drives_the_worm_during_vibration() -> None:
    """Vibration halves the friction; afterwards the worm holds the new position."""
    model = f"{MODEL}+faults"
    shaken = load_parameters(model=model).with_values({"fault.lost_lock.begin": 0.1, "fault.lost_lock.end": 0.14})
    fin = simulate(shaken.values, 0.5, model=model, enable=False, aero_torque=100.0)["fin_angle"]
    assert not fin[:101].any()
    assert radians(1.0) < fin[-1] < radians(25.0)
    assert len(set(fin[-50:])) == 1


def test_dry_flanks_lower_the_stall_load_even_after_the_fault_ends() -> None:
    model = f"{MODEL}+faults"
    common = {"drive.ki": 200.0, "encoder.enabled": False}
    dry = {"fault.dry_flanks.begin": 0.0, "fault.dry_flanks.end": 0.01}
    # The load is between both stall loads, 60 eta_f 6.5 N.m less 2 N.m.
    load = -0.5 * sum(60.0 * efficiencies(shipped(), mu)[0] * 6.5 - 2.0 for mu in (0.10, 0.15))
    ends = [simulate(load_parameters(model=model).with_values({**common, **changes}).values, 0.5, model=model,
                     fin_command=0.2, aero_torque=load)["fin_angle"][-1] for changes in ({}, dry)]
    assert ends[0] > 0.1
    assert ends[1] == 0.0


@settings(QUICK, max_examples=15)
@given(levels=input_levels(8), starts=st.integers(1, 12), mu=st.floats(0.0, 0.3), ratio=st.floats(1.0, 3.0))
def test_outputs_are_finite_and_the_worm_only_loses_power(levels: list[Any], starts: int, mu: float, ratio: float
                                                          ) -> None:
    v = values({"encoder.enabled": False, "worm.starts": starts, "worm.friction": mu, "worm.static_ratio": ratio})
    assert run_within_stops(v, MODEL, levels)["worm_loss"].min() >= 0.0


@pytest.mark.parametrize(("overrides", "message"), [
    ({"worm.starts": 12, "worm.diameter_quotient": 4.0, "worm.friction": 0.2, "worm.static_ratio": 2.0},
     r"is 0\.4; above 0\.31.* no motor turns the worm under load"),
    ({"inertia.motor": 1e-9, "inertia.worm": 0.0, "worm.friction": 0.3}, "lower worm.friction or worm.static_ratio"),
    ({"worm.friction": 2.0}, "it must be within 0 .. 1"),
])
def test_unsuitable_values_are_refused(overrides: Mapping[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        load_parameters(model=MODEL).with_values(overrides)


@pytest.mark.slow
def test_the_shipped_gains_meet_their_study() -> None:
    """Every requirement is met in every case; a step by 1 deg overshoots by less than 5 %."""
    study = load_study(models_directory() / "tuning" / "worm-gear.toml", load_parameters(model=MODEL))
    (judged,) = evaluate(study, [{t.name: shipped()[t.name] for t in study.tunables}])
    assert not [j for j in judged.judgements if j.share > 1.0]
    (overshoot,) = (j.measured for j in judged.judgements if (j.requirement, j.case) == ("overshoot_1deg", "nominal"))
    assert overshoot < 0.05


def test_no_variable_belongs_to_screw_or_lever() -> None:
    actuator = get(MODEL)
    names = {v.name for v in (*actuator.outputs, *actuator.parameters)}
    assert not {name for name in names if "screw" in name or "kinematics" in name}
    assert names.isdisjoint({"nut_position", "mass.nut"})
    assert {v.description for v in actuator.parameters if "fork" in v.name} == {
        text.format(axis=axis) for axis in "xz" for text in (
            "worm wheel inertia about the hinge", "worm wheel mass",
            "{axis} coordinate of the worm wheel's centre of mass, from the hinge at fin_angle 0")}


def test_sliding_speed_is_along_the_pitch_helix() -> None:
    p = get(MODEL).plant(values())
    # In a turn of the worm, a point of the thread moves by pi q m along the rim and by pi m z_1 along the axis.
    turn = sqrt((np.pi * 15e-3)**2 + (np.pi * 1.5e-3)**2)
    assert worm.sliding_speed(FLOATS, p, 2.0 * np.pi) == pytest.approx(turn, rel=1e-12)


@pytest.mark.parametrize("model", [MODEL, *slow("worm-gear-elastic")])
def test_the_rate_of_table_2_holds_over_the_whole_travel(model: str) -> None:
    """In slews from -20 to 20 deg and back against 100 N.m, the mean over the middle 60 % is 200 deg/s or more."""
    travel = radians(20.0)
    turns = np.arange(0.5, 3.0, 0.5)

    def towards(t: float) -> float:
        return 1.0 if np.searchsorted(turns, t, side="right") % 2 else -1.0

    shown = simulate(load_parameters(model=model).values, 3.0, model=model, fin_command=lambda t: travel * towards(t),
                     aero_torque=lambda t: -100.0 * towards(t))
    for turn in turns:
        slew = slice(round(1e3 * turn), round(1e3 * turn) + 400)
        time, angle = shown["time"][slew], shown["fin_angle"][slew]
        rate = sustained_rate(time, angle, turn, travel * towards(turn + 0.1))
        assert float(np.degrees(rate)) >= 200.0
