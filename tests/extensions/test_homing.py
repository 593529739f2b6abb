"""Homing on the hard stops: from anywhere, when disabled, what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.errors import EmcasError
from emcas_fmu.extensions.status import DISABLED, HOMING, OPERATIONAL, UNREFERENCED
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.simulation import simulate
from tests.default_actuator import OUTPUTS
from tests.marks import slow

from .homing_run import BASE, COUNT, INITIAL, RATIO, SPEED, STOP, assert_sound, motor, phases, run_of, since

# -- a run ------------------------------------------------------------------------


@settings(derandomize=True, max_examples=20)
@given(start=st.floats(-STOP, STOP), positive=st.booleans(), encoder=st.booleans(), command=st.floats(-0.35, 0.35))
def test_homes_from_anywhere(start: float, positive: bool, encoder: bool, command: float) -> None:
    run = run_of({"fin.start_angle": start, "homing.positive_first": positive, "encoder.enabled": encoder}, 8.0,
               home=lambda t: t > 0.0995, fin_command=command)
    assert phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
    # Nobody knew where it was; then the reading is floored to a count, and the zero exact: rigid stops are met to
    # rounding, both alike. What is shown at a sample is of the step that begins there.
    assert run["measured_fin_angle"][0] == pytest.approx(0.0, abs=1e-15)
    known = np.flatnonzero(run["homed"])[1:]
    error = run["fin_angle"][known - 1] - run["measured_fin_angle"][known]
    assert np.all(error > -1e-9)
    assert np.all(error < (COUNT / RATIO if encoder else 0.0) + 1e-9)
    assert run["fin_angle"][-1] == pytest.approx(np.clip(command, -radians(20), radians(20)), abs=radians(0.05))
    # Both ways at the mean rate in motor angle, two stalls and the time at zero. Besides, each stall waits for the
    # push to reach its limit, and the target for the motor to catch up: within 0.03 s each, five times.
    first = STOP if positive else -STOP
    span = motor(STOP) - motor(-STOP)
    travel = abs(motor(first) - motor(start)) + span + abs(motor(first) - span * (1 if positive else -1))
    least = travel / span * 2.0 * STOP / SPEED + 3.0 * 0.1
    took = since(run, OPERATIONAL) - 0.1
    assert least - 0.02 <= took <= least + 0.15
    assert_sound(run)


def test_the_stops_stop_it_and_hold_the_push() -> None:
    run = run_of({"fin.start_angle": 0.1}, 7.0, home=True)
    stalled = (run["at_stop"] > 0.0) & (run["status"] == HOMING)
    angles = run["fin_angle"][stalled]
    assert {round(float(a), 9) for a in angles} == {round(STOP, 9), round(-STOP, 9)}
    # As long as the stall, what comes before its limit, and the drive's delay of the way back (3.7 ms).
    assert stalled.sum() * 1e-3 == pytest.approx(2 * 0.1, abs=2 * 0.05)
    assert np.abs(run["drive_reference"][run["status"] == HOMING]).max() == 1.0
    # Where the belief jumps, at the second stop, the speed measured does not: pushed away from it at once.
    (jump,) = np.flatnonzero(np.abs(np.diff(run["measured_fin_angle"])) > 0.05) + 1
    assert run["drive_reference"][jump - 1] == -1.0
    assert run["drive_reference"][jump] > 0.0
    # Slow on the way: within a tenth of the speed beyond start and turns, where the lever makes it vary with 1/R.
    underway = (run["status"] == HOMING) & (np.abs(run["fin_rate"]) > 0.5 * SPEED)
    mean = (motor(STOP) - motor(-STOP)) / (2.0 * STOP)
    expected = SPEED * mean / (RATIO / np.cos(run["fin_angle"] + INITIAL)**2)
    assert np.median(np.abs(run["fin_rate"][underway]) / expected[underway]) == pytest.approx(1.0, abs=0.02)


def test_one_stop_only_and_either_encoder() -> None:
    quick = run_of({"homing.verify": False}, 4.0, home=True)
    assert phases(quick) == [UNREFERENCED, HOMING, OPERATIONAL]
    assert quick["fin_angle"].min() > -radians(0.5)  # zero is passed by the loop's overshoot, 0.17 deg at this speed
    assert abs(quick["fin_angle"][-1] - quick["measured_fin_angle"][-1]) < COUNT / RATIO
    # On the fin a count is 0.044 deg, and the speed measured a comb of 44 deg/s: it shakes, and knows a count's worth.
    on_fin = run_of({"encoder.on_fin": True, "fin.start_angle": -0.3}, 8.0, home=True, fin_command=0.1)
    assert phases(on_fin) == [UNREFERENCED, HOMING, OPERATIONAL]
    known = np.flatnonzero(on_fin["homed"])[1:]
    error = on_fin["fin_angle"][known - 1] - on_fin["measured_fin_angle"][known]
    assert np.all((error > -1e-9) & (error < COUNT + 1e-9))


@pytest.mark.parametrize("model", ["elastic", "habibi", "ozkan", "ristanovic"])
def test_every_model_with_a_motor(model: str) -> None:
    run = run_of({"fin.start_angle": -0.2}, 9.0, f"{model}+homing", home=True, fin_command=0.1)
    assert phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.1))


def test_gap_and_give_cancel_out_of_the_zero() -> None:
    """Both stops are met with the same error; one alone leaves half the gap and the give of the push."""
    def error(verify: bool) -> float:
        run = run_of({"fin.start_angle": 0.1, "homing.verify": verify}, 7.0, "elastic+homing", home=True)
        assert run["status"][-1] == OPERATIONAL
        return float(motor(run["measured_fin_angle"][-1]) - run["motor_angle"][-1])

    values = load_parameters(model="elastic").values
    lead = values["screw.lead"]
    half_gap = 0.5 * values["drive_line.backlash"] / lead
    compliance = values["drive_line.torsional_compliance"] + (
        values["drive_line.axial_compliance"] + 1.0 / values["drive_line.contact_stiffness"]) / lead**2
    # Wound up by the push and the impact, the motor's friction (0.3 N.m at a stop) holds it anywhere between these.
    push, friction = 8.19 * values["motor.torque_constant"], 0.3
    alone = -error(False) - half_gap
    assert (push - friction) * compliance < alone < (push + friction) * compliance + COUNT
    # Of both stops: what the friction of both directions differs by, 0.06 N.m, and the rounding to counts.
    assert abs(error(True)) < 0.06 * compliance + 1.5 * COUNT


def test_cold_and_loaded() -> None:
    for load in (-25.0, 25.0):
        run = run_of({"friction.temperature": -6.0}, 8.0, home=True, aero_torque=load)
        assert phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]
        assert_sound(run)


# -- commands ---------------------------------------------------------------------


def test_not_asked_it_stays_unreferenced_and_still() -> None:
    run = run_of({"fin.start_angle": 0.2}, 1.0, fin_command=-0.3, aero_torque=5.0)
    assert np.all(run["status"] == UNREFERENCED)
    assert np.all(run["fin_angle"] == run["fin_angle"][0])
    assert not np.any(run["motor_current"])
    assert np.all(run["tracking_error"] == -0.3 - run["fin_angle"])
    # The bridge is open: a load beyond friction moves the fin.
    assert run_of({}, 1.0, fin_command=-0.3, aero_torque=40.0)["fin_angle"][-1] == pytest.approx(STOP, rel=1e-9)


@pytest.mark.parametrize("more", [{}, {"encoder.enabled": False}, {"encoder.on_fin": True}])
@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_without_need_it_is_the_plain_model(model: str, more: Mapping[str, Any]) -> None:
    values = load_parameters(model=model).with_values({"fin.start_angle": 0.1, **more}).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.3 if t < 0.2 else -0.5, "aero_torque": -50.0,
                              "enable": lambda t: not 0.3 < t < 0.32}
    plain = simulate(values, 0.5, model=model, **inputs)
    run = run_of({"fin.start_angle": 0.1, "homing.required": False, **more}, 0.5, f"{model}+homing", **inputs)
    for v in OUTPUTS:
        assert np.array_equal(plain[v.name], run[v.name]), v.name
    assert phases(run) == [OPERATIONAL, DISABLED, OPERATIONAL]


def test_homing_again_and_edges() -> None:
    """A level is not an edge; an edge during a run or while disabled is ignored."""
    run = run_of({}, 16.0, home=lambda t: 0.1 < t < 0.3 or 1.0 < t < 7.0 or t > 8.0, fin_command=0.1)
    assert phases(run) == [UNREFERENCED, HOMING, OPERATIONAL, HOMING, OPERATIONAL]
    assert np.flatnonzero(np.diff(run["homed"]) < 0.0)[0] * 1e-3 == pytest.approx(8.0, abs=2e-3)
    settled = np.abs(run["time"] - 7.9) < 0.05
    assert run["fin_angle"][settled] == pytest.approx(0.1, abs=radians(0.05))
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.05))
    assert_sound(run)
    late = run_of({}, 0.5, home=lambda t: t > 0.1, enable=lambda t: t > 0.2)
    assert phases(late) == [DISABLED, UNREFERENCED]


def test_disabled_in_a_run_it_knows_nothing() -> None:
    run = run_of({}, 9.0, home=lambda t: t < 0.5 or t > 2.0, enable=lambda t: not 1.0 <= t + 1e-9 < 1.2,
               fin_command=0.3)
    assert phases(run) == [UNREFERENCED, HOMING, DISABLED, UNREFERENCED, HOMING, OPERATIONAL]
    between = (run["time"] > 1.2) & (run["time"] < 2.0)
    assert np.ptp(run["fin_angle"][between]) == 0.0
    assert not np.any(run["motor_current"][between])


# -- refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(("overrides", "said"), [
    ({"homing.reference_limit": 12.0}, ["homing.reference_limit = 12 V", "drive.reference_limit = 10 V"]),
    # (125 + 1.02 for the lever + 2.5 0.2) deg at 20 deg/s + 0.3 + 0.3 s
    ({"homing.timeout": 6.56}, ["homing.timeout = 6.56 s", "above 6.926"]),
    # 24 rad/s at 0.3 kg.m2e-3 and 0.6 N.m, after 3.7 ms: 14.6 ms
    ({"homing.stall_time": 0.0145}, ["homing.stall_time = 0.0145 s", "raise homing.stall_time"]),
    ({"homing.reference_limit": 0.3}, ["torque of 0.27027 N.m", "friction of 0.29"]),
    ({"homing.speed": radians(100.0), "homing.stall_time": 0.05}, ["homing.stall_time = 0.05 s"]),
    ({"homing.speed": radians(101.0)}, ["homing.speed", "must be within"]),
    ({"homing.speed": 0.0}, ["homing.speed", "must be within"]),
    ({"homing.stall_time": -1.0}, ["homing.stall_time", "must be within"]),
])
def test_bad_values_are_refused(overrides: Mapping[str, Any], said: list[str]) -> None:
    with pytest.raises(ParameterError) as refused:
        BASE.with_values(overrides)
    assert all(word in str(refused.value) for word in said), refused.value


@pytest.mark.parametrize("model", ["nonlinear", "ristanovic", *slow("elastic", "habibi", "ozkan")])
@pytest.mark.parametrize("speed", [2.0, 20.0])
def test_the_least_time_and_stall_accepted_are_enough(model: str, speed: float) -> None:
    """A clear way from the farthest start, either way round."""
    own = load_parameters(model=f"{model}+homing")
    for first in (1.0, -1.0):
        given = {"homing.speed": radians(speed), "fin.start_angle": -first * STOP, "homing.positive_first": first > 0.0,
                 "homing.stall_time": {2.0: 0.0049, 20.0: 0.0147}[speed]}
        with pytest.raises(ParameterError) as refused:
            own.with_values({**given, "homing.timeout": 0.1})
        least = float(str(refused.value).split("above ")[1].split(" s:")[0])
        run = simulate(own.with_values({**given, "homing.timeout": least + 1e-3}).values, least + 0.1,
                       model=f"{model}+homing", home=True)
        assert run["status"][-1] == OPERATIONAL


def test_return_tolerance_ends_the_return() -> None:
    """The overshoot of 0.17 deg is out of it: within all through the last stall time, and not just before."""
    tolerance = radians(0.05)
    run = run_of({"homing.return_tolerance": tolerance}, 8.0, home=True)
    ready = int(np.argmax(run["homed"]))
    held = np.abs(motor(run["measured_fin_angle"])[ready - 99:ready]) / RATIO
    # Counts per fin angle are the mean's, 1.08 times those at zero.
    assert held.max() <= tolerance * 1.08 + COUNT / RATIO
    assert np.abs(run["measured_fin_angle"][ready - 120:ready - 100]).max() > tolerance
    # What is in the way of nothing: a wide one is quicker.
    wide = run_of({"homing.return_tolerance": 10.0 * tolerance}, 8.0, home=True)
    assert since(wide, OPERATIONAL) < since(run, OPERATIONAL) - 0.01


def test_at_a_turn_the_integral_is_zero() -> None:
    """The error wound up against a stop, 25 ms of the way at 57 rad/s2 and up, would take the speed fed forward back:
    right after it is the loop of a fin at rest with the homing speed as command, at its limit."""
    run = run_of({"fin.start_angle": 0.2}, 6.0, home=True)
    u, p = run["drive_reference"], BASE.values
    first, second = np.flatnonzero(np.diff(np.sign(u)) * (np.abs(u[:-1]) == 1.0))[:2]
    integral = p["controller.position.ki"] * 0.025 * SPEED * RATIO * 0.075
    assert p["controller.velocity.kp"] * integral > 0.4  # what it would be less by
    assert (u[first], u[second]) == (1.0, -1.0)
    assert u[first + 2] == -1.0
    assert u[second + 2] == 1.0


def test_models_it_is_not_for() -> None:
    with pytest.raises(EmcasError, match="homing needs a drive whose reference has a limit; second-order has none"):
        get("second-order+homing")
    with pytest.raises(EmcasError, match="homing needs a drive whose reference has a limit; linear has none"):
        get("linear+homing")
    with pytest.raises(ParameterError, match="no such parameter"):
        load_parameters(model=NONLINEAR).with_values({"homing.speed": 0.1})
