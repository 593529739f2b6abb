"""The trajectory generator and its feed-forward: limits, how well the plant follows, and what does not change."""

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
from emcas_fmu.control import trajectory
from emcas_fmu.control.trajectory import Motion
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.tuning.evaluate import evaluate
from emcas_fmu.studies.tuning.study import shipped_study
from tests.marks import others_slow, slow

SET = "two-degrees-of-freedom"
MODEL = "nonlinear+filters+trajectory"
TWO = load_parameters(SET)
FOLLOWING = [name for name in NAMES if POSITION_LOOP in get(name).provides]
FED_FORWARD = [name for name in FOLLOWING if get(name).feed_forward is not None]
# A drive with whatever voltage its current needs, and a plant without dry friction, read in fine counts: only the
# feed-forward is left.
EXACT: Mapping[str, Any] = {
    "drive.supply_voltage": 1000.0, "drive.current_offset": 0.0, "encoder.pulses": 1_000_000, "compensation.gain": 0.0,
    "controller.speed_limit": 400.0,
    "friction.coulomb.positive": [0.0] * 7, "friction.coulomb.negative": [0.0] * 7,
    "friction.viscous.negative": TWO.values["friction.viscous.positive"], "controller.load_observer": 0.0}


def _step(angle: float, at: float = 0.05) -> Any:
    return lambda t: radians(angle) if t >= at - 1e-9 else 0.0


def _motion(values: Mapping[str, Any], commands: list[float]) -> list[Motion]:
    """The motion to commands [rad], one for each sample."""
    p, moved = get(MODEL).namespace(values), [Motion(0.0, 0.0, 0.0, 0.0, 0.0)]
    for command in commands:
        last = moved[-1]
        moved.append(trajectory.move(FLOATS, p, last.next_angle, last.next_rate, last.acceleration, command))
    return moved[1:]


@settings(max_examples=15)
@given(commands=st.lists(st.floats(-0.35, 0.35), min_size=1, max_size=4), frequency=st.floats(30.0, 270.0),
       damping=st.floats(0.7, 1.5))
def test_no_motion_is_beyond_its_limits_and_every_one_arrives(
        commands: list[float], frequency: float, damping: float) -> None:
    values = TWO.with_values({"trajectory.natural_frequency": frequency, "trajectory.damping": damping}).values
    moved = _motion(values, [c for c in commands for _ in range(900)])
    rates, accelerations = (np.array([getattr(m, name) for m in moved]) for name in ("next_rate", "acceleration"))
    within = 1.0 + 1e-9  # rounding
    assert np.max(np.abs(accelerations)) <= values["trajectory.acceleration_limit"] * within
    assert np.max(np.abs(np.diff(accelerations))) <= values["trajectory.jerk_limit"] * 1e-3 * within
    # The jerk limit ends an acceleration within a_max/j_max, the rate limit is met as long later.
    late = values["trajectory.acceleration_limit"] ** 2 / values["trajectory.jerk_limit"]
    assert np.max(np.abs(rates)) <= values["trajectory.rate_limit"] + late
    # 0.9 s are ten time constants 2 z/W of the slowest motion, after a braking of 0.1 s: 0.35 e^-8 are left.
    assert moved[-1].next_angle == pytest.approx(commands[-1], abs=2e-4)


@pytest.mark.parametrize("angle", [1.0, 5.0, 20.0])
def test_a_motion_arrives_without_more_overshoot_than_its_damping_has(angle: float) -> None:
    """exp(-pi z/sqrt(1 - z^2)) of a linear system of second order; a braking that was late would overshoot by more."""
    moved = _motion(TWO.values, [radians(angle)] * 400)
    linear = np.exp(-pi * 0.85 / np.sqrt(1.0 - 0.85**2))
    assert max(m.next_angle for m in moved) < radians(angle) * (1.0 + linear)


@pytest.mark.parametrize("base", others_slow(FOLLOWING, lambda name: name in (NONLINEAR, "servo")))
def test_without_a_natural_frequency_nothing_changes(base: str) -> None:
    inputs: dict[str, Any] = {
        "fin_command": lambda t: 0.15 * sin(20.0 * t) + 0.1 * (t > 0.1), "aero_torque": lambda t: 3.0 * sin(9.0 * t),
        "enable": lambda t: not 0.2 < t < 0.25}
    plain, extended = (simulate(load_parameters(model=model).values, 0.4, model=model, **inputs)
                       for model in (base, f"{base}+trajectory"))
    assert all(np.array_equal(plain[name], extended[name]) for name in plain)


@pytest.mark.parametrize("angle", [1.0, 5.0, 20.0])
def test_the_plant_follows_the_motion_a_response_time_later(angle: float) -> None:
    """With an exact model, without noise and limits, feedback has nothing to do."""
    values = TWO.with_values(EXACT).values
    run = simulate(values, 0.3, model=MODEL, fin_command=_step(angle))
    moved = [0.0] * 50 + [m.angle for m in _motion(values, [radians(angle)] * 251)]
    delay = values["drive.transport_delay"] + values["motor.inductance"] / (
        values["motor.resistance"] + values["drive.kp"])
    expected = np.interp(run["time"] - delay, np.arange(len(moved)) * 1e-3, moved)
    # The lag of the current is a delay here, its voltage step L di/dt none: some 0.1 ms of the way where a changes.
    assert np.max(np.abs(run["fin_angle"] - expected)) < 0.006 * radians(angle)


@pytest.mark.parametrize(("name", "rows"), [("step_plus20", 220), *slow(("load_opposing", 851), ("sag", 1001))])
def test_independent_integration(name: str, rows: int) -> None:
    """At the limits of the motion, and where the drive cannot follow, within the 0.002 deg of every reference."""
    (case,) = (each for each in files.cases(MODEL, TWO.values) if each.name == name)
    values, inputs = {**TWO.values, **case.overrides}, {key: column[:rows] for key, column in case.inputs().items()}
    expected = files.simulator(MODEL)(values, inputs)
    columns: dict[str, Any] = {key: column for key, column in inputs.items() if key != "time"}
    run = simulate(values, float(inputs["time"][-1]), float(inputs["time"][1]), model=MODEL, **columns)
    assert degrees(np.max(np.abs(run["fin_angle"] - expected["fin_angle"]))) < 0.002


@cache
def _supplied(voltage: float, model: str = MODEL) -> Mapping[str, Any]:
    values = TWO.values if model == MODEL else load_parameters().values
    return simulate(values, 1.2, model=model, supply_voltage=voltage,
                    fin_command=lambda t: radians(20.0 if t >= 0.35 else -20.0))


@pytest.mark.parametrize("voltage", [39.0, 30.0, 20.0])
def test_a_drive_that_cannot_follow_slows_the_motion_down(voltage: float) -> None:
    """A slew of 40 deg ends within the accuracy of 0.2 deg, from half the voltage too; the thesis's loops overshoot."""
    overshoot = degrees(np.max(_supplied(voltage)["fin_angle"])) - 20.0
    assert overshoot < 0.2
    if voltage == 20.0:
        assert degrees(np.max(_supplied(voltage, NONLINEAR)["fin_angle"])) - 20.0 > 0.5


def test_a_motion_that_is_slowed_down_never_turns_around() -> None:
    """A fin that is pushed away at rest is not followed: the drive holds with all it has."""
    run = simulate(TWO.values, 2.0, model=MODEL, aero_torque=lambda t: 400.0 if t >= 0.2 else 0.0)
    shipped = simulate(load_parameters().values, 2.0, aero_torque=lambda t: 400.0 if t >= 0.2 else 0.0)
    assert np.max(run["fin_angle"]) < np.max(shipped["fin_angle"])


LOADS: Mapping[str, Any] = {
    "a load that the drive hardly holds": lambda t: -345.0,
    "a load beyond the stall that goes": lambda t: -420.0 if t < 0.8 else 0.0,
    "a gust in the motion": lambda t: -450.0 if 0.08 < t < 0.2 else 0.0,
}


@pytest.mark.parametrize("load", LOADS)
def test_a_motion_that_was_slowed_down_arrives(load: str) -> None:
    """Whatever stopped the fin, the motion goes on: the end is the command, within a hold of dry friction."""
    run = simulate(TWO.values, 3.0, model=MODEL, fin_command=_step(20.0), aero_torque=LOADS[load])
    assert degrees(run["fin_angle"][-1]) == pytest.approx(20.0, abs=0.02)


@pytest.mark.parametrize("fault", ["jam", "brown_out", "drive_loss"])
def test_a_motion_arrives_after_a_fault(fault: str) -> None:
    parameters = load_parameters(SET, model="nonlinear+faults").with_values(
        {f"fault.{fault}.begin": 0.08, f"fault.{fault}.end": 0.5})
    run = simulate(parameters.values, 3.0, model=parameters.model, fin_command=_step(20.0))
    assert degrees(run["fin_angle"][-1]) == pytest.approx(20.0, abs=0.02)


def test_a_servo_without_integral_goes_on_under_a_load() -> None:
    """It droops under a load as without a trajectory, and is not stopped by it."""
    plain, extended = (
        simulate(load_parameters(model=model).with_values(changes).values, 2.0, model=model, fin_command=_step(20.0),
                 aero_torque=-8.0)
        for model, changes in (("servo", {}), ("servo+trajectory", {"trajectory.natural_frequency": 100.0})))
    assert degrees(abs(plain["fin_angle"][-1] - extended["fin_angle"][-1])) < 0.5  # of dry friction, either side


@pytest.mark.parametrize("base", others_slow(FED_FORWARD, lambda name: name in (NONLINEAR, "electrohydraulic")))
def test_a_start_away_from_zero_is_at_rest(base: str) -> None:
    """0.02 deg: the drift of what valve or bristles let creep, and a count."""
    model, angle = f"{base}+trajectory", radians(15.0)
    values = load_parameters(model=model).with_values(
        {"trajectory.natural_frequency": 100.0, "fin.start_angle": angle}).values
    run = simulate(values, 0.3, model=model, fin_command=angle)
    assert degrees(np.max(np.abs(run["fin_angle"] - angle))) < 0.02


def test_a_command_at_its_limit_is_no_saturation() -> None:
    run = simulate(TWO.values, 1.0, model=MODEL, fin_command=_step(20.0))
    assert not np.any(run["saturated"][-300:])
    beyond = simulate(TWO.values, 1.0, model=MODEL, fin_command=_step(21.0))
    assert np.all(beyond["saturated"][-300:])


@pytest.mark.parametrize(("changes", "words"), [
    ({"trajectory.jerk_limit": 5e4}, r"jerk_limit = 50000 .*at least 1\.5.*= 72562\.5"),
    ({"trajectory.jerk_limit": 72562.0}, "brakes too late"),
    ({"trajectory.jerk_limit": 72563.0}, ""),
    ({"trajectory.natural_frequency": 501.0, "trajectory.damping": 1.0, "trajectory.jerk_limit": 1e6},
     "too fast for samples"),
    ({"trajectory.natural_frequency": 499.0, "trajectory.damping": 1.0, "trajectory.jerk_limit": 1e6}, ""),
])
def test_a_motion_that_could_not_brake_in_time_is_refused(changes: Mapping[str, float], words: str) -> None:
    """On either side of 1.5 a w, and of samples with 2 zeta w T = 1."""
    with pytest.raises(ParameterError, match=words) if words else nullcontext():
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


def test_what_the_shipped_set_gives() -> None:
    """The figures of docs/model/control.md that a step shows; its margins are those of emcas analyse."""
    step = simulate(TWO.values, 0.4, model=MODEL, fin_command=_step(1.0))
    off = np.abs(np.degrees(step["fin_angle"]) - 1.0) > 0.02
    assert step["time"][off][-1] - 0.05 <= 0.045
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
