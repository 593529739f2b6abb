"""The trajectory generator and its feed-forward: limits of the motion, errors of the plant, and neutral values."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from functools import cache
from math import degrees, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NAMES, NONLINEAR, get
from emcas_fmu.actuators.capabilities import POSITION_LOOP
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.control import trajectory
from emcas_fmu.control.trajectory import Motion
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import shipped_study
from tests.marks import others_slow, slow
from tests.runs import assert_equal

from .runs import NO_COULOMB, case_error

SET = "two-degrees-of-freedom"
MODEL = "nonlinear+filters+trajectory"
TWO = load_parameters(SET)
FOLLOWING = [name for name in NAMES if POSITION_LOOP in get(name).provides]
FED_FORWARD = [name for name in FOLLOWING if get(name).feed_forward is not None]
# With a high supply voltage, fine counts and no dry friction only the feed-forward determines the motion.
EXACT: Mapping[str, Any] = {
    **NO_COULOMB, "drive.supply_voltage": 1000.0, "drive.current_offset": 0.0, "encoder.pulses": 1_000_000,
    "compensation.gain": 0.0, "controller.speed_limit": 400.0,
    "friction.viscous.negative": TWO.values["friction.viscous.positive"], "controller.load_observer": 0.0}


def _step(angle: float, at: float = 0.05) -> Any:
    return lambda t: radians(angle) if t >= at - 1e-9 else 0.0


def _motion(values: Mapping[str, Any], commands: list[float]) -> list[Motion]:
    """Return the motion to commands [rad], one for each sample."""
    p, motions = get(MODEL).namespace(values), [Motion(0.0, 0.0, 0.0, 0.0, 0.0)]
    for command in commands:
        last = motions[-1]
        motions.append(trajectory.move(FLOATS, p, last.next_angle, last.next_rate, last.acceleration, command))
    return motions[1:]


@settings(max_examples=15)
@given(commands=st.lists(st.floats(-0.35, 0.35), min_size=1, max_size=4), frequency=st.floats(30.0, 270.0),
       damping=st.floats(0.7, 1.5))
def test_a_motion_is_within_its_limits_and_reaches_its_command(
        commands: list[float], frequency: float, damping: float) -> None:
    values = TWO.with_values({"trajectory.natural_frequency": frequency, "trajectory.damping": damping}).values
    motions = _motion(values, [c for c in commands for _ in range(900)])
    rates, accelerations = (np.array([getattr(m, name) for m in motions]) for name in ("next_rate", "acceleration"))
    within = 1.0 + 1e-9  # rounding
    assert np.max(np.abs(accelerations)) <= values["trajectory.acceleration_limit"] * within
    assert np.max(np.abs(np.diff(accelerations))) <= values["trajectory.jerk_limit"] * 1e-3 * within
    # The jerk limit needs a_max/j_max to end an acceleration, in which the rate exceeds its limit.
    excess = values["trajectory.acceleration_limit"] ** 2 / values["trajectory.jerk_limit"]
    assert np.max(np.abs(rates)) <= values["trajectory.rate_limit"] + excess
    # The slowest motion, W = 30/s and z = 1.5, has the time constant 1/(W (z - sqrt(z^2 - 1))) = 87 ms. After 0.1 s at
    # the limits, nine of them leave 0.7 e^-9 = 9e-5.
    assert motions[-1].next_angle == pytest.approx(commands[-1], abs=2e-4)


@pytest.mark.parametrize("angle", [1.0, 5.0, 20.0])
def test_a_motion_overshoots_by_no_more_than_a_linear_system(angle: float) -> None:
    """A linear system of second order with a damping of 0.85, less than the set's, overshoots by
    exp(-pi z/sqrt(1 - z^2)); late braking would overshoot by more."""
    motions = _motion(TWO.values, [radians(angle)] * 400)
    linear = np.exp(-pi * 0.85 / np.sqrt(1.0 - 0.85**2))
    assert max(m.next_angle for m in motions) < radians(angle) * (1.0 + linear)


@pytest.mark.parametrize("base", others_slow(FOLLOWING, lambda name: name in (NONLINEAR, "servo")))
def test_without_a_natural_frequency_no_bit_changes(base: str) -> None:
    inputs: dict[str, Any] = {
        "fin_command": lambda t: 0.15 * sin(20.0 * t) + 0.1 * (t > 0.1), "aero_torque": lambda t: 3.0 * sin(9.0 * t),
        "enable": lambda t: not 0.2 < t < 0.25}
    assert_equal(*(simulate(load_parameters(model=model).values, 0.4, model=model, **inputs)
                   for model in (f"{base}+trajectory", base)))


@pytest.mark.parametrize("angle", [1.0, 5.0, 20.0])
def test_the_plant_follows_the_motion_after_the_response_time(angle: float) -> None:
    """With an exact model, without noise and limits, the feed-forward alone moves the plant."""
    values = TWO.with_values(EXACT).values
    run = simulate(values, 0.3, model=MODEL, fin_command=_step(angle))
    angles = [0.0] * 50 + [m.angle for m in _motion(values, [radians(angle)] * 251)]
    delay = values["drive.transport_delay"] + values["motor.inductance"] / (
        values["motor.resistance"] + values["drive.kp"])
    expected = np.interp(run["time"] - delay, np.arange(len(angles)) * 1e-3, angles)
    # The current's lag is approximated by a delay, and the voltage L di/dt is neglected: an error of some 0.1 ms of the
    # motion when the acceleration changes.
    assert np.max(np.abs(run["fin_angle"] - expected)) < 0.006 * radians(angle)


@pytest.mark.parametrize(("name", "rows"), [("step_plus20", 220), *slow(("load_opposing", 851), ("sag", 1001))])
def test_independent_integration_agrees(name: str, rows: int) -> None:
    """At the limits of the motion, and if the drive cannot follow, within the 0.002 deg of every reference."""
    assert case_error(MODEL, TWO.values, name, rows) < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("load", [500.0, -420.0])
def test_independent_integration_agrees_after_an_overload(load: float) -> None:
    """Also for a slew 0.2 s after its end; the error is 0.0015 deg at most."""
    case = files.cases(MODEL, TWO.values)[0]
    values, time = {**TWO.values, **case.overrides}, np.arange(1001) * 1e-3
    inputs: dict[str, Any] = {name: np.full(len(time), column[0]) for name, column in case.inputs().items()}
    inputs |= {"fin_command": np.radians(np.where(time >= 0.6, -15.0, 15.0)),
               "aero_torque": np.where((time >= 0.1) & (time < 0.4), load, 0.0)}
    exact = files.simulator(MODEL)(values, {**inputs, "time": time})
    del inputs["time"]
    run = simulate(values, 1.0, model=MODEL, **inputs)
    assert np.degrees(np.max(np.abs(run["fin_angle"] - exact["fin_angle"]))) < 0.002


@cache
def _supplied(voltage: float, model: str = MODEL) -> Mapping[str, Any]:
    values = TWO.values if model == MODEL else load_parameters().values
    return simulate(values, 1.2, model=model, supply_voltage=voltage,
                    fin_command=lambda t: radians(20.0 if t >= 0.35 else -20.0))


@pytest.mark.parametrize("voltage", [39.0, 30.0, 20.0])
def test_a_drive_at_its_limit_slows_the_motion_down(voltage: float) -> None:
    """A slew of 40 deg overshoots by less than 0.2 deg, also at half the voltage; the shipped loops overshoot by more.
    """
    overshoot = degrees(np.max(_supplied(voltage)["fin_angle"])) - 20.0
    assert overshoot < 0.2
    if voltage == 20.0:
        assert degrees(np.max(_supplied(voltage, NONLINEAR)["fin_angle"])) - 20.0 > 0.5


def test_a_motion_that_is_slowed_down_never_turns_around() -> None:
    """A load moves the fin away from rest: the motion does not follow it, and the drive resists fully."""
    two, shipped = (simulate(values, 2.0, model=model, aero_torque=lambda t: 400.0 if t >= 0.2 else 0.0)
                    for values, model in ((TWO.values, MODEL), (load_parameters().values, NONLINEAR)))
    assert np.max(two["fin_angle"]) < np.max(shipped["fin_angle"])


LOADS: Mapping[str, Any] = {
    "just below the stall torque": lambda t: -345.0,
    "above the stall torque for 0.8 s": lambda t: -420.0 if t < 0.8 else 0.0,
    "gust during the motion": lambda t: -450.0 if 0.08 < t < 0.2 else 0.0,
}


@pytest.mark.parametrize("load", LOADS)
def test_a_motion_slowed_down_by_a_load_reaches_its_command(load: str) -> None:
    """The final angle is the command, to the error at which dry friction stops the fin."""
    run = simulate(TWO.values, 3.0, model=MODEL, fin_command=_step(20.0), aero_torque=LOADS[load])
    assert degrees(run["fin_angle"][-1]) == pytest.approx(20.0, abs=0.02)


def test_motion_and_feed_forward_do_not_run_away_while_a_load_holds_the_fin() -> None:
    run = simulate(TWO.values, 23.0, model=MODEL, fin_command=radians(-15.0),
                   aero_torque=lambda t: 500.0 if t < 20.0 else 0.0)
    assert degrees(run["fin_angle"][-1]) == pytest.approx(-15.0, abs=0.02)


def _overloaded(kind: str, load: float, hold: float, slew: tuple[float, float] | None) -> Mapping[str, Any]:
    """Simulate a load, a multiple of the rated one, for `hold` [s], and 0.2 s after it a slew between angles [deg].

    Without a slew the command is 0. The end of the load is at 0.5 s + `hold`.
    """
    parameters, end = load_parameters(SET, model=kind), 0.5 + hold
    torque, (first, last) = load * load_requirements(None, parameters).rated_load, slew or (0.0, 0.0)
    return simulate(parameters.values, end + 2.0, model=parameters.model,
                    fin_command=lambda t: radians(first if t < end + 0.2 - 1e-9 else last),
                    aero_torque=lambda t: torque if 0.5 <= t < end - 1e-9 else 0.0)


@pytest.mark.parametrize("kind", others_slow(FED_FORWARD, lambda name: name == NONLINEAR))
@pytest.mark.parametrize("slew", [(-15.0, 15.0), *slow(((0.0, 10.0),), ((15.0, -15.0),), ((0.0, -10.0),))])
def test_slew_after_an_overload_begins_at_once(kind: str, slew: tuple[float, float]) -> None:
    """The fin passes the middle at most 10 ms later than without a load (4 ms: a rest of motion). With an integral that
    winds up, `nonlinear` is 450 ms late."""
    first, last = np.radians(slew)

    def middle(load: float, hold: float) -> float:
        run = _overloaded(kind, load, hold, slew)
        before = (run["fin_angle"] - 0.5 * (first + last)) * np.sign(last - first) < 0.0
        return float(run["time"][before][-1]) - hold

    for hold in (0.2, 1.5):
        undisturbed = middle(0.0, hold)
        late = {load: middle(load, hold) - undisturbed for load in (5.0, -5.0, 4.0, -4.0, 1.2, -1.2)}
        assert max(late.values()) < 0.010, late


@pytest.mark.parametrize("load", [5.0, -5.0])
def test_fin_returns_from_an_overload_directly(load: float) -> None:
    """Within 0.2 deg after 160 ms, of which the rate limit needs 100 ms; what the integral gains on the way back moves
    it past by 0.14 deg. With an integral that winds up it passes by 0.6 deg and returns after 440 ms."""
    run = _overloaded(NONLINEAR, load, 1.5, None)
    after = run["time"] > 2.0
    angle, time = np.sign(load) * np.degrees(run["fin_angle"][after]), run["time"][after] - 2.0
    assert angle[0] > 20.0
    assert np.min(angle) > -0.17
    assert time[np.abs(angle) > 0.2][-1] < 0.19
    assert np.ptp(angle[-500:]) < 0.01  # at rest: no limit cycle


def test_a_motion_that_slows_down_is_fed_forward_in_proportion() -> None:
    """A slew of 30 deg against twice the rated load takes 145 ms; without the feed-forward it takes 180 ms."""
    run = simulate(TWO.values, 1.5, model=MODEL, fin_command=lambda t: radians(15.0 if t >= 0.6 else -15.0),
                   aero_torque=-200.0)
    outside = np.abs(run["fin_angle"] - radians(15.0)) > radians(0.5)
    assert run["time"][outside][-1] - 0.6 < 0.16


@given(rate=st.floats(-5.0, 5.0), acceleration=st.floats(-300.0, 300.0), distance=st.floats(-1.0, 1.0))
def test_a_motion_loses_at_most_its_travel(rate: float, acceleration: float, distance: float) -> None:
    p, period = get(MODEL).namespace(TWO.values), TWO.values["controller.sample_time"]
    after = rate + period * acceleration
    travel = 0.5 * period * (rate + after)
    lost, share = trajectory.excess(FLOATS, p, Motion(0.0, rate, acceleration, travel, after), distance)
    assert 0.0 <= share <= 1.0
    assert lost == pytest.approx(share * travel, rel=1e-12)  # rounding of the quotient


@pytest.mark.parametrize("fault", ["jam", "brown_out", "drive_loss"])
def test_a_motion_reaches_its_command_after_a_fault(fault: str) -> None:
    parameters = load_parameters(SET, model="nonlinear+faults").with_values(
        {f"fault.{fault}.begin": 0.08, f"fault.{fault}.end": 0.5})
    run = simulate(parameters.values, 3.0, model=parameters.model, fin_command=_step(20.0))
    assert degrees(run["fin_angle"][-1]) == pytest.approx(20.0, abs=0.02)


def test_the_steady_error_of_a_servo_without_integral_does_not_stop_the_motion() -> None:
    """Under a load the final angle is that of the servo without a trajectory."""
    plain, extended = (
        simulate(load_parameters(model=model).with_values(changes).values, 2.0, model=model, fin_command=_step(20.0),
                 aero_torque=-8.0)
        for model, changes in (("servo", {}), ("servo+trajectory", {"trajectory.natural_frequency": 100.0})))
    assert degrees(abs(plain["fin_angle"][-1] - extended["fin_angle"][-1])) < 0.5  # dry friction in either direction


@pytest.mark.parametrize("base", others_slow(FED_FORWARD, lambda name: name in (NONLINEAR, "electrohydraulic")))
def test_a_start_away_from_zero_is_at_rest(base: str) -> None:
    """To 0.02 deg: creep of valve or bristles, and a count."""
    model, angle = f"{base}+trajectory", radians(15.0)
    values = load_parameters(model=model).with_values(
        {"trajectory.natural_frequency": 100.0, "fin.start_angle": angle}).values
    run = simulate(values, 0.3, model=model, fin_command=angle)
    assert degrees(np.max(np.abs(run["fin_angle"] - angle))) < 0.02


def test_only_a_command_beyond_its_limit_saturates() -> None:
    run = simulate(TWO.values, 1.0, model=MODEL, fin_command=_step(20.0))
    assert not np.any(run["saturated"][-300:])
    beyond = simulate(TWO.values, 1.0, model=MODEL, fin_command=_step(21.0))
    assert np.all(beyond["saturated"][-300:])


@pytest.mark.parametrize(("changes", "message"), [
    ({"trajectory.jerk_limit": 5e4}, r"jerk_limit = 50000 .*at least 72562\.5 "),
    ({"trajectory.jerk_limit": 72562.0}, "brakes too late"),
    ({"trajectory.jerk_limit": 72563.0}, ""),
    ({"trajectory.natural_frequency": 501.0, "trajectory.damping": 1.0, "trajectory.jerk_limit": 1e6},
     "too fast for samples"),
    ({"trajectory.natural_frequency": 499.0, "trajectory.damping": 1.0, "trajectory.jerk_limit": 1e6}, ""),
])
def test_limits_that_prevent_braking_in_time_are_refused(changes: Mapping[str, float], message: str) -> None:
    """Just below and above the jerk limit 1.5 a w, and the natural frequency with 2 zeta w T = 1."""
    with pytest.raises(ParameterError, match=message) if message else nullcontext():
        TWO.with_values(changes)


@pytest.mark.parametrize("base", others_slow(FED_FORWARD, lambda name: name in (NONLINEAR, "electrohydraulic")))
def test_no_feed_forward_is_too_strong(base: str) -> None:
    """A motion of 16 Hz is slow for every actuator: of a step of 1 deg feedback and friction add 2 % to its 1.5 %."""
    model = f"{base}+trajectory"
    values = load_parameters(model=model).with_values({"trajectory.natural_frequency": 100.0}).values
    run = simulate(values, 0.5, model=model, fin_command=_step(1.0))
    assert degrees(np.max(run["fin_angle"])) < 1.035


@pytest.mark.parametrize("base", others_slow(FED_FORWARD, lambda name: name == NONLINEAR))
def test_enabling_begins_where_the_fin_is(base: str) -> None:
    """At its command a fin that is enabled does not move, whatever was commanded while it was disabled."""
    model = f"{base}+trajectory"
    values = load_parameters(model=model).with_values({"trajectory.natural_frequency": 100.0}).values
    run = simulate(values, 0.6, model=model, enable=lambda t: t < 0.1 or t >= 0.4,
                   fin_command=lambda t: radians(5.0) if 0.1 <= t < 0.39 else 0.0)
    still = run["time"] > 0.4
    assert degrees(np.max(np.abs(run["fin_angle"][still]))) < 0.02  # drift of what valve or bristles let creep


def test_after_homing_the_motion_begins_where_the_fin_is() -> None:
    parameters = load_parameters(SET, model="nonlinear+homing")
    run = simulate(parameters.values, 6.0, model=parameters.model, home=True, fin_command=radians(5.0))
    ready = int(np.argmax(run["homed"]))
    assert ready
    rates = np.diff(run["fin_angle"][ready:]) / 1e-3
    # The rate of 5 deg by the generator, and nothing faster: a reference that jumped would be at the rate limit.
    alone = simulate(TWO.values, 0.5, model=MODEL, fin_command=_step(5.0))
    assert np.max(rates) < 1.1 * np.max(alone["fin_rate"])
    assert degrees(run["fin_angle"][-1]) == pytest.approx(5.0, abs=0.01)


def test_a_slow_bus_leaves_the_rate_alone() -> None:
    """Commands every 8 ms: the motion moves on between them."""
    values = TWO.with_values({"command.update_time": 8e-3}).values
    slow, fast = (simulate(each, 0.3, model=MODEL, fin_command=_step(10.0)) for each in (values, TWO.values))
    late = (np.argmax(slow["fin_angle"] > 0.08) - np.argmax(fast["fin_angle"] > 0.08)) * 1e-3
    assert 0.0 <= late <= 8e-3
    assert np.max(slow["fin_rate"]) == pytest.approx(np.max(fast["fin_rate"]), rel=0.02)


def test_a_delay_of_too_many_samples_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"sample_time = 0\.0001 s: a reference acts after 0\.00381429 s"):
        TWO.with_values({"controller.sample_time": 1e-4})


def test_a_set_brings_its_extension(tmp_path: Path) -> None:
    assert TWO.model == MODEL
    assert load_parameters(SET, model="elastic+faults").model == "elastic+filters+trajectory+faults"
    before = load_parameters().with_values({"fin.start_angle": 0.1})
    assert load_parameters(SET, before).values["fin.start_angle"] == 0.1
    for text in ('extends = "+heat"', "extends = []", "extends = [1]"):
        (tmp_path / "wrong.toml").write_text(text, encoding="utf-8")
        with pytest.raises(ParameterError, match=r"extends = .*write a list of names"):
            load_parameters(tmp_path / "wrong.toml")
    (tmp_path / "unknown.toml").write_text('extends = ["+haet"]', encoding="utf-8")
    with pytest.raises(ParameterError, match=r"unknown\.toml: .*there is no extension 'haet'.*heat"):
        load_parameters(tmp_path / "unknown.toml")


def test_the_shipped_set_has_the_step_responses_of_the_documentation() -> None:
    """The figures are in docs/model/control.md."""
    step = simulate(TWO.values, 0.4, model=MODEL, fin_command=_step(1.0))
    outside = np.abs(np.degrees(step["fin_angle"]) - 1.0) > 0.02
    assert step["time"][outside][-1] - 0.05 <= 0.045
    load = simulate(TWO.values, 0.8, model=MODEL, aero_torque=lambda t: 100.0 if t >= 0.1 else 0.0)
    angle = np.abs(np.degrees(load["fin_angle"]))
    assert np.max(angle) <= 0.35
    assert load["time"][angle > 0.05][-1] - 0.1 <= 0.150


@pytest.mark.slow
def test_the_shipped_set_meets_its_study_in_every_case() -> None:
    study = shipped_study(TWO)
    (found,) = evaluate(study, [{t.name: TWO.values[t.name] for t in study.tunables}])
    assert len(study.cases) == 8
    assert {(j.requirement, j.case): j.measured for j in found.judgements if j.share > 1.0} == {}
