"""LuGre friction at the motor: closed forms, an independent integration, and energy."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import exp, factorial, log, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.namespace import with_values
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError
from emcas_fmu.physics import mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.steppers.electrical import Motor
from emcas_fmu.steppers.lugre import advance, shares
from emcas_fmu.steppers.rigid import stops
from tests.marks import slow
from tests.runs import input_levels, run_both_kernels, run_within_stops
from tests.simulation import acting, nested

from . import runs
from .friction_reference import IDEAL, Bristle, stribeck
from .runs import NO_COULOMB, WAYS

MODEL = "nonlinear+lugre"
LEVEL = 0.2  # N.m
# A constant Coulomb friction, no viscous friction, and no more friction at low speed.
PLAIN = {**NO_COULOMB, **{f"friction.coulomb.{way}[0]": LEVEL for way in WAYS},
         **{f"friction.viscous.{way}": 0.0 for way in WAYS}, "lugre.static_ratio": 1.0}
values_of = partial(runs.values_of, model=MODEL)


def _disabled_run(overrides: Mapping[str, Any], stop: float, torque: Any) -> dict[str, Any]:
    """Return a run under a hinge moment, with the drive disabled."""
    return simulate(values_of(overrides), stop, model=MODEL, enable=False, aero_torque=torque)


def _ratio(values: Mapping[str, Any], fin: Any = 0.0) -> Any:
    lever = np.cos(fin + values["kinematics.initial_angle"])
    return values["kinematics.moment_arm"] / values["screw.lead"] / lever**2


# -- presliding -------------------------------------------------------------------

def test_deflection_under_a_small_torque() -> None:
    """The bristles deflect by z = T/sigma_0, and the motor turns by -(C/sigma_0) ln(1 - T/C)."""
    values = values_of(PLAIN)
    small = 0.05 * LEVEL * _ratio(values)
    run = _disabled_run(PLAIN, 3.0, lambda t: small * min(t, 1.0))
    stiffness = values["lugre.stiffness"]
    applied = small / _ratio(values, run["fin_angle"][-1])
    assert run["bristle_deflection"][-1] == pytest.approx(applied / stiffness, rel=1e-9)
    assert run["friction_torque"][-1] == pytest.approx(applied, rel=1e-9)
    # The closed form is that of monotonous motion. Each step of the ramp makes a swing of a thousandth of the way.
    assert run["motor_angle"][-1] == pytest.approx(-LEVEL / stiffness * log(1.0 - applied / LEVEL), rel=1e-3)


def test_small_oscillations_have_the_frequency_of_bristles_and_inertia() -> None:
    overrides = {**PLAIN, "lugre.damping": 0.0, "solver.max_tick": 1e-4}
    run = _disabled_run(overrides, 0.5, lambda t: 0.05 if t < 1e-3 else 0.0)
    p = nested(values_of(overrides), MODEL)
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    angle = run["motor_angle"][20:] - run["motor_angle"][20:].mean()
    up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    times = (up - angle[up] / (angle[up + 1] - angle[up])) * 1e-3
    frequency = (len(times) - 1) / (times[-1] - times[0])
    # The midpoint rule lengthens a period by (w h)^2/12 = 6e-5, interpolation between samples by less. Slip is of
    # second order in the amplitude, which is 2e-3 of breakaway.
    assert 2.0 * pi * frequency == pytest.approx(sqrt(p.lugre.stiffness / inertia), rel=2e-4)


def test_presliding_has_its_hysteresis_loop() -> None:
    """From each reversal the torque follows dT/dx = sigma_0 (1 -+ T/C) over the motor angle x, an exponential."""
    values = values_of(PLAIN)
    largest, period = 0.8 * LEVEL * _ratio(values), 20.0
    run = _disabled_run(PLAIN, 15.0, lambda t: largest * sin(2.0 * pi * t / period))
    x, torque = run["motor_angle"], run["friction_torque"]
    slope = values["lugre.stiffness"] / LEVEL
    turn = int(np.argmax(x))
    first = LEVEL * (1.0 - np.exp(-slope * x[:turn]))
    back = -LEVEL + (torque[turn] + LEVEL) * np.exp(slope * (x[turn:] - x[turn]))
    # sigma_1 at the speed of 5e-3 rad/s and the load's steps add 2e-4 N.m.
    assert torque[:turn] == pytest.approx(first, abs=5e-4)
    assert torque[turn:] == pytest.approx(back, abs=5e-4)
    remanent = x[turn + int(np.argmin(np.abs(torque[turn:])))]
    assert remanent == pytest.approx(x[turn] - log(1.0 + torque[turn] / LEVEL) / slope, abs=5e-5)
    assert remanent > 0.5 * x[turn] > 0.5 / slope  # a wide loop


def test_in_a_slow_ramp_breakaway_is_the_static_ratio() -> None:
    """The torque tends to s C; it is less in a faster ramp, a known property of the model.

    The slow ramp is 0.03 N.m/s at the motor.
    """
    overrides = {**PLAIN, "lugre.static_ratio": 1.5}
    largest = []
    for rate in (2.0, 200.0):
        run = _disabled_run(overrides, 0.4 * _ratio(values_of()) / rate, lambda t, rate=rate: rate * t)
        largest.append(run["friction_torque"].max() / LEVEL)
        away = np.flatnonzero(run["motor_speed"] > 1.0)[0]
        assert run["motor_angle"][away - 1] < 0.2  # some bristle lengths
    assert largest[0] == pytest.approx(1.5, rel=0.02)
    assert largest[1] < largest[0]


@pytest.mark.parametrize("damping", [0.0, 0.046, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 1.5])
def test_friction_never_exceeds_breakaway(damping: float, ratio: float) -> None:
    """Also at fast reversals, where a damping of more than g/|w| would add to s C."""
    overrides = {**PLAIN, "lugre.damping": damping, "lugre.static_ratio": ratio}
    run = simulate(values_of(overrides), 0.1, 2e-4, model=MODEL, fin_command=lambda t: 0.1 if t < 0.03 else -0.1)
    assert run["motor_speed"].min() < -50.0 < 50.0 < run["motor_speed"].max()
    # The error of the predicted speed changes the deflection by 1e-4.
    assert 0.99 * LEVEL < np.abs(run["friction_torque"]).max() < ratio * LEVEL * (1.0 + 1e-3)


def test_steady_sliding_has_the_friction_of_its_speed() -> None:
    """It is g(w) with the polynomial of the direction and the hinge's share; the rest of the torque is viscous."""
    overrides = {"friction.viscous.positive": 0.1, "friction.viscous.negative": 0.1, "friction.fin_coulomb": 5.0,
                 "lugre.static_ratio": 1.5, "lugre.stribeck_speed": 2.0}
    values = values_of(overrides)
    plant = Bristle(values)
    for torque in (60.0, 30.0, -60.0):
        run = _disabled_run(overrides, 0.6, torque)
        for k in (300, 500, 590):
            speed, fin, ratio = run["motor_speed"][k], run["fin_angle"][k], plant.ratio(run["fin_angle"][k])
            level = plant.coulomb(fin, speed) * stribeck(1.5, 2.0, speed) + 5.0 / ratio
            assert abs(speed) > 1.0
            # Bristles follow in C/(sigma_0 w), 10 ms and less; the angle changes g by 1e-2 a second.
            assert run["friction_torque"][k] == pytest.approx(np.sign(speed) * level, rel=2e-3)
            assert torque / ratio - 0.1 * speed == pytest.approx(run["friction_torque"][k], rel=5e-3)


# -- numbers ----------------------------------------------------------------------

@pytest.mark.parametrize("x", [0.0, 1e-300, 1e-9, 1e-3, 0.0199999, 0.02, 0.3, 1.0, 40.0, 1e6, 1e25])
def test_shares_of_the_exponential(x: float) -> None:
    computed = shares(FLOATS, x)
    if x < 1.0:
        exact = [sum((-x)**k / factorial(k + n) for k in range(20)) for n in (0, 1, 2)]
    else:
        exact = [exp(-x), (1.0 - exp(-x)) / x, (x - 1.0 + exp(-x)) / x**2]
    # At the change of formula, 0.02, the truncation x^5/2520 is 1e-12 and the cancellation 1e-16/x^2 2e-13.
    assert computed == pytest.approx(exact, rel=2e-12, abs=1e-300)


@pytest.mark.parametrize(("overrides", "stop", "torque", "step"), [
    ({"friction.fin_coulomb": 5.0, "lugre.static_ratio": 1.5}, 0.1, 0.0, False),
    *slow(({"lugre.stiffness": 200.0, "lugre.damping": 0.0}, 0.06, -20.0, True), ({}, 0.1, -20.0, True),
          ({"lugre.static_ratio": 2.0, "lugre.stribeck_speed": 1e-3}, 0.1, -20.0, True))])
def test_independent_integration_agrees_to_second_order(overrides: Mapping[str, Any], stop: float, torque: float,
                                                        step: bool) -> None:
    """Radau at 1e-9 integrates a step of 0.5 deg with reversals, or a ramp of 0.3 deg/s."""
    values = values_of({**IDEAL, **overrides})

    def command(t: float) -> float:
        return radians(0.5) * (t > 0.01) if step else radians(0.3) * t

    exact, _ = Bristle(values, torque).closed_loop(stop, command)
    errors = []
    for tick in (2e-4, 1e-4, 5e-5, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, stop, model=MODEL, fin_command=command, aero_torque=torque)
        errors.append(np.abs(run["fin_angle"] - exact).max())
    # A reversal, a kink of |w|, is anywhere in a tick, so that orders scatter: over three halvings from 1.9 to 2.5.
    assert 1.8 < log(errors[0] / errors[-1]) / log(8.0) < 2.6, errors
    assert np.degrees(errors[1]) < 1e-5  # at the default tick


def _both_models(overrides: Mapping[str, Any], stop: float, **inputs: Any) -> tuple[dict[str, Any], float]:
    """Return a run with LuGre friction, and its largest difference of the fin angle [deg] to the nonlinear model."""
    values = values_of(IDEAL, overrides)
    plain = {name: value for name, value in values.items() if not name.startswith("lugre.")}
    run, expected = simulate(values, stop, model=MODEL, **inputs), simulate(plain, stop, **inputs)
    return run, float(np.degrees(np.abs(run["fin_angle"] - expected["fin_angle"]).max()))


def test_without_friction_it_is_the_nonlinear_model() -> None:
    run, difference = _both_models(NO_COULOMB, 0.3, fin_command=lambda t: 0.05 * sin(40.0 * t), aero_torque=-30.0)
    # The nonlinear model ends steps at reversals; the ticks' own error is 1e-5 deg.
    assert difference < 2e-5
    assert np.abs(run["friction_torque"]).max() < 1e-11


def test_stiff_bristles_tend_to_exact_stick() -> None:
    # The deflection C/sigma_0 is 1e-3 rad at 200 N.m/rad, 1e-3 deg at the fin; the loop makes it several times larger.
    soft, stiff = (_both_models({"lugre.static_ratio": 1.0, "lugre.stiffness": stiffness, "solver.max_tick": 2e-5},
                                1.0, fin_command=lambda t: 0.005 * sin(10.0 * t))[1] for stiffness in (200.0, 20_000.0))
    assert soft < 0.01
    assert stiff < soft / 10.0


_OFF = acting(enabled=False)


@settings(derandomize=True, max_examples=30)
@given(stiffness=st.floats(1e-3, 1e6), damping=st.sampled_from([0.0, 1e-3, 0.05, 1.0]),
       ratio=st.floats(1.0, 10.0), width=st.sampled_from([1e-3, 1.0, 1e3]),
       level=st.sampled_from([0.0, 1e-6, 0.2, 5.0]), speed=st.floats(-300.0, 300.0),
       stretch=st.floats(-1.5, 1.5), h=st.sampled_from([1e-6, 1e-4, 1e-3]))
def test_bristles_create_no_energy(stiffness: float, damping: float, ratio: float, width: float, level: float,
                                   speed: float, stretch: float, h: float) -> None:
    """J w^2/2 + sigma_0 z^2/2 never grows, also with coarse ticks and with bristles stretched beyond breakaway."""
    values = values_of(PLAIN, {f"friction.coulomb.{way}[0]": level for way in WAYS}, {
        "lugre.damping": damping, "lugre.static_ratio": ratio, "lugre.stribeck_speed": width})
    p = with_values(nested(values, MODEL, constant_ratio=True), {"lugre.stiffness": stiffness})
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    s, z = Motor(0.0, speed, 0.0, 0.0), stretch * ratio * max(level, 1e-3) / stiffness
    before = 0.5 * inertia * speed**2 + 0.5 * stiffness * z**2
    for _ in range(100):
        s, z, _ = advance(FLOATS, p, s, z, _OFF, h)
        after = 0.5 * inertia * s.motor_speed**2 + 0.5 * stiffness * z**2
        assert after <= before * (1.0 + 1e-12) + 1e-300
        before = after


def test_steady_sliding_does_not_ring() -> None:
    """The speed falls monotonously and the torque is g, at 100 rad/s and 100 bristle lengths in a tick."""
    p = with_values(nested(values_of(PLAIN), MODEL, constant_ratio=True), {"lugre.stiffness": 20_000.0})
    s, z, speeds = Motor(-20.0, 100.0, 0.0, 0.0), 0.0, [100.0]
    for _ in range(200):
        s, z, _ = advance(FLOATS, p, s, z, _OFF, 1e-4)
        speeds.append(s.motor_speed)
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    # The error of the predicted mean speed: 1e-4 where a tick changes 100 rad/s by 0.07.
    assert -np.diff(speeds) == pytest.approx(LEVEL / inertia * 1e-4, rel=5e-3)


# -- stops and random inputs ------------------------------------------------------

def test_a_fin_pressed_against_a_stop_rests_exactly() -> None:
    """It leaves the stop when the torque exceeds the bristles' in the other direction."""
    run = _disabled_run({}, 0.5, lambda t: 100.0 if t < 0.3 else -100.0)
    hit = int(np.argmax(run["at_stop"]))
    assert 20 < hit < 250
    assert np.ptp(run["motor_angle"][hit:301]) == 0.0
    assert np.all(run["motor_speed"][hit:301] == 0.0)
    assert np.ptp(run["bristle_deflection"][hit:301]) == 0.0
    assert run["fin_angle"][hit] == pytest.approx(radians(25.0), rel=1e-12)
    assert not run["at_stop"][302]
    assert run["fin_angle"][-1] < 0.0
    # Without a load stretched bristles push the motor back by a few of their lengths, 1.3 0.25/20 rad.
    released = _disabled_run({}, 0.5, lambda t: 100.0 if t < 0.3 else 0.0)
    way = released["motor_angle"][300] - released["motor_angle"][-1]
    assert 0.0 < way < 3.0 * 1.3 * 0.25 / 20.0


def test_the_drive_moves_the_fin_to_a_stop_and_away() -> None:
    values = values_of({"fin.stop_angle": radians(20.0)})
    run = simulate(values, 0.6, model=MODEL, fin_command=lambda t: 0.4 if t < 0.3 else 0.0, aero_torque=60.0)
    assert np.all(run["at_stop"][150:300] > 0.0)
    assert np.ptp(run["motor_angle"][150:300]) == 0.0
    assert run["fin_angle"][-1] == pytest.approx(0.0, abs=radians(0.2))


def _at_the_stop(press: float, reference: float, h: float) -> tuple[float, float]:
    """Return the duration [s] of a step of at most `h` at the upper stop, and the press [N.m] on the stop at its end.
    """
    p = nested(values_of(), MODEL)
    torque = 0.3
    load = mechanics.coefficients(FLOATS, p, stops(FLOATS, p)[1]).load
    deflection = (torque + load - press) / p.lugre.stiffness
    s = Motor(stops(FLOATS, p)[1], 0.0, torque / p.motor.torque_constant, 0.0)
    end, deflection_after, duration = advance(FLOATS, p, s, deflection, acting(reference, supply=900.0), h)
    assert (end.motor_angle, end.motor_speed, deflection_after) == (s.motor_angle, 0.0, deflection)
    return duration, p.motor.torque_constant * end.motor_current + load - p.lugre.stiffness * deflection


def test_a_step_ends_when_the_fin_leaves_a_stop() -> None:
    """The current falls below the balance of torques within the tick."""
    duration, press = _at_the_stop(0.1, -5.0, 1e-3)
    assert 1e-6 < duration < 0.9e-3
    # The closed form has the mean integral of the whole tick: 1.5e-7 N.m.
    assert press == pytest.approx(0.0, abs=1e-6)
    # 1 mN.m pull from the stop, but the current rises at once: the fin is at the stop for the whole tick.
    duration, press = _at_the_stop(-1e-3, 5.0, 1e-3)
    assert duration == 1e-3
    assert press > 0.1


@pytest.mark.kernel(MODEL)
@settings(derandomize=True, max_examples=50)
@given(levels=input_levels(6), stiffness=st.sampled_from([1e-3, 0.5, 20.0, 250.0]),
       damping=st.sampled_from([0.0, 0.05, 1.0]),
       ratio=st.floats(1.0, 10.0), dry=st.sampled_from([0.0, 50.0]), cold=st.sampled_from([0.0, 1.25]),
       tick=st.sampled_from([2e-5, 1e-4, 1e-3]))
def test_any_inputs_give_finite_outputs_within_the_stops(
        levels: list[Any], stiffness: float, damping: float, ratio: float, dry: float, cold: float,
        tick: float) -> None:
    run_within_stops(values_of({"lugre.stiffness": stiffness, "lugre.damping": damping, "lugre.static_ratio": ratio,
                          "friction.fin_coulomb": dry, "friction.table.coulomb[1]": cold,
                          "friction.temperature": -6.0, "solver.max_tick": tick}), MODEL, levels)


def test_kernels_agree() -> None:
    """Through voltage limits, stops and a disabled drive."""
    run = run_both_kernels(
        values_of({"fin.stop_angle": radians(20.0)}), 0.5, MODEL, enable=lambda t: not 0.1 < t < 0.2,
        fin_command=lambda t: 0.34 if sin(20.0 * t) > 0.0 else -0.34, aero_torque=lambda t: 200.0 * sin(20.0 * t))
    assert 0.05 < run["at_stop"].mean() < 0.9


# -- refusals ---------------------------------------------------------------------

def test_bristles_too_stiff_for_the_tick_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"lugre\.stiffness = 600 N\.m/rad must be at most 583\..* 0\.0007 s"):
        values_of({"lugre.stiffness": 600.0, "solver.max_tick": 7e-4})
    assert values_of({"lugre.stiffness": 600.0, "solver.max_tick": 6e-4})
