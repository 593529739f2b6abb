"""Homing on the hard stops: from any start, while disabled, and refused parameters."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.extensions.status import DISABLED, HOMING, OPERATIONAL, UNREFERENCED
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import slow
from tests.runs import assert_equal

from .homing_run import (
    BASE,
    COUNT,
    INITIAL,
    RATIO,
    SPEED,
    STOP,
    assert_sound,
    first_time,
    motor,
    phases,
    run_of,
    zero_error,
)

HOMED = [UNREFERENCED, HOMING, OPERATIONAL]

# -- a run ------------------------------------------------------------------------

@settings(derandomize=True, max_examples=20)
@given(start=st.floats(-STOP, STOP), positive=st.booleans(), encoder=st.booleans(), command=st.floats(-0.35, 0.35))
def test_homes_from_any_start(start: float, positive: bool, encoder: bool, command: float) -> None:
    run = run_of({"fin.start_angle": start, "homing.positive_first": positive, "encoder.enabled": encoder}, 8.0,
                 home=lambda t: t > 0.0995, fin_command=command)
    assert phases(run) == HOMED
    # Before homing the measured angle starts at 0. Rigid stops are met to rounding, so that the zero is exact and the
    # measured angle is floored to a count.
    assert run["measured_fin_angle"][0] == pytest.approx(0.0, abs=1e-15)
    error = zero_error(run)
    assert np.all(error > -1e-9)
    assert np.all(error < (COUNT / RATIO if encoder else 0.0) + 1e-9)
    assert run["fin_angle"][-1] == pytest.approx(np.clip(command, -radians(20), radians(20)), abs=radians(0.05))
    # Three ways at the mean rate in motor angle, two stalls and the time at zero. In addition, each stall waits until
    # the push is at its limit, and the target waits for the motor: five times 0.03 s at most.
    first = STOP if positive else -STOP
    span = motor(STOP) - motor(-STOP)
    travel = abs(motor(first) - motor(start)) + span + abs(motor(first) - span * (1 if positive else -1))
    least = travel / span * 2.0 * STOP / SPEED + 3.0 * 0.1
    assert least - 0.02 <= first_time(run, OPERATIONAL) - 0.1 <= least + 0.15
    assert_sound(run)


def test_homing_pushes_against_both_stops_and_turns_at_once() -> None:
    run = run_of({"fin.start_angle": 0.1}, 7.0, home=True)
    stalled = (run["at_stop"] > 0.0) & (run["status"] == HOMING)
    angles = run["fin_angle"][stalled]
    assert {round(float(a), 9) for a in angles} == {round(STOP, 9), round(-STOP, 9)}
    # Each stall lasts 0.1 s, the time until the push is at its limit, and the drive's delay (3.7 ms) at the turn.
    assert stalled.sum() * 1e-3 == pytest.approx(2 * 0.1, abs=2 * 0.05)
    assert np.abs(run["drive_reference"][run["status"] == HOMING]).max() == 1.0
    # At the second stop the measured angle jumps, but not the measured speed: the drive turns at once.
    (jump,) = np.flatnonzero(np.abs(np.diff(run["measured_fin_angle"])) > 0.05) + 1
    assert run["drive_reference"][jump - 1] == -1.0
    assert run["drive_reference"][jump] > 0.0
    # Between the stops the motor has a constant speed, and the fin's rate varies with 1/R.
    moving = (run["status"] == HOMING) & (np.abs(run["fin_rate"]) > 0.5 * SPEED)
    mean = (motor(STOP) - motor(-STOP)) / (2.0 * STOP)
    expected = SPEED * mean / (RATIO / np.cos(run["fin_angle"] + INITIAL)**2)
    assert np.median(np.abs(run["fin_rate"][moving]) / expected[moving]) == pytest.approx(1.0, abs=0.02)


def test_homing_on_one_stop() -> None:
    run = run_of({"homing.verify": False}, 4.0, home=True)
    assert phases(run) == HOMED
    assert run["fin_angle"].min() > -radians(0.5)  # the loop overshoots zero by 0.17 deg at this speed
    assert abs(run["fin_angle"][-1] - run["measured_fin_angle"][-1]) < COUNT / RATIO


def test_homing_with_an_encoder_on_the_fin() -> None:
    """A count is 0.044 deg at the fin, and the measured speed is a multiple of 44 deg/s: the fin shakes."""
    run = run_of({"encoder.on_fin": True, "fin.start_angle": -0.3}, 8.0, home=True, fin_command=0.1)
    assert phases(run) == HOMED
    error = zero_error(run)
    assert np.all((error > -1e-9) & (error < COUNT + 1e-9))


@pytest.mark.parametrize("model", ["elastic", "habibi", "ozkan", "ristanovic"])
def test_homing_of_other_models(model: str) -> None:
    run = run_of({"fin.start_angle": -0.2}, 9.0, f"{model}+homing", home=True, fin_command=0.1)
    assert phases(run) == HOMED
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.1))


def test_with_both_stops_gap_and_compliance_do_not_displace_the_zero() -> None:
    """Both stops have the same error; with one stop the error is half the gap and the twist under the push."""
    def error(verify: bool) -> float:
        run = run_of({"fin.start_angle": 0.1, "homing.verify": verify}, 7.0, "elastic+homing", home=True)
        assert run["status"][-1] == OPERATIONAL
        return float(motor(run["measured_fin_angle"][-1]) - run["motor_angle"][-1])

    values = load_parameters(model="elastic").values
    lead = values["screw.lead"]
    half_gap = 0.5 * values["drive_line.backlash"] / lead
    compliance = values["drive_line.torsional_compliance"] + (
        values["drive_line.axial_compliance"] + 1.0 / values["drive_line.contact_stiffness"]) / lead**2
    # Push and impact twist the line; the motor's friction (0.3 N.m at a stop) holds the twist between these limits.
    push, friction = 8.19 * values["motor.torque_constant"], 0.3
    twist = -error(False) - half_gap
    assert (push - friction) * compliance < twist < (push + friction) * compliance + COUNT
    # With both stops the frictions of both directions differ by 0.06 N.m, and angles are rounded to counts.
    assert abs(error(True)) < 0.06 * compliance + 1.5 * COUNT


def test_homing_of_a_cold_and_loaded_actuator() -> None:
    for load in (-25.0, 25.0):
        run = run_of({"friction.temperature": -6.0}, 8.0, home=True, aero_torque=load)
        assert phases(run) == HOMED
        assert_sound(run)


# -- commands ---------------------------------------------------------------------

def test_before_homing_the_bridge_is_open() -> None:
    run = run_of({"fin.start_angle": 0.2}, 1.0, fin_command=-0.3, aero_torque=5.0)
    assert np.all(run["status"] == UNREFERENCED)
    assert np.all(run["fin_angle"] == run["fin_angle"][0])
    assert not np.any(run["motor_current"])
    assert np.all(run["tracking_error"] == -0.3 - run["fin_angle"])
    # A load beyond friction moves the fin.
    assert run_of({}, 1.0, fin_command=-0.3, aero_torque=40.0)["fin_angle"][-1] == pytest.approx(STOP, rel=1e-9)


@pytest.mark.parametrize("more", [{}, {"encoder.enabled": False}, {"encoder.on_fin": True}])
@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_if_homing_is_not_required_no_bit_changes(model: str, more: Mapping[str, Any]) -> None:
    values = load_parameters(model=model).with_values({"fin.start_angle": 0.1, **more}).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.3 if t < 0.2 else -0.5, "aero_torque": -50.0,
                              "enable": lambda t: not 0.3 < t < 0.32}
    plain = simulate(values, 0.5, model=model, **inputs)
    run = run_of({"fin.start_angle": 0.1, "homing.required": False, **more}, 0.5, f"{model}+homing", **inputs)
    assert_equal(run, plain)
    assert phases(run) == [OPERATIONAL, DISABLED, OPERATIONAL]


def test_a_rising_edge_starts_homing_again() -> None:
    """A constant level does not; an edge is ignored during homing or while disabled."""
    run = run_of({}, 16.0, home=lambda t: 0.1 < t < 0.3 or 1.0 < t < 7.0 or t > 8.0, fin_command=0.1)
    assert phases(run) == [*HOMED, HOMING, OPERATIONAL]
    assert np.flatnonzero(np.diff(run["homed"]) < 0.0)[0] * 1e-3 == pytest.approx(8.0, abs=2e-3)
    settled = np.abs(run["time"] - 7.9) < 0.05
    assert run["fin_angle"][settled] == pytest.approx(0.1, abs=radians(0.05))
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=radians(0.05))
    assert_sound(run)
    late = run_of({}, 0.5, home=lambda t: t > 0.1, enable=lambda t: t > 0.2)
    assert phases(late) == [DISABLED, UNREFERENCED]


def test_disabled_during_homing_the_actuator_is_unreferenced() -> None:
    run = run_of({}, 9.0, home=lambda t: t < 0.5 or t > 2.0, enable=lambda t: not 1.0 <= t + 1e-9 < 1.2,
                 fin_command=0.3)
    assert phases(run) == [UNREFERENCED, HOMING, DISABLED, *HOMED]
    between = (run["time"] > 1.2) & (run["time"] < 2.0)
    assert np.ptp(run["fin_angle"][between]) == 0.0
    assert not np.any(run["motor_current"][between])


# -- refusals ---------------------------------------------------------------------

@pytest.mark.parametrize(("overrides", "words"), [
    ({"homing.reference_limit": 12.0}, ["homing.reference_limit = 12 V", "drive.reference_limit = 10 V"]),
    # (125 + 1.02 for the lever + 2.5 0.2) deg at 20 deg/s + 0.3 + 0.3 s
    ({"homing.timeout": 6.56}, ["homing.timeout = 6.56 s", "above 6.926"]),
    # 24 rad/s at 0.29e-3 kg.m2 and 0.63 N.m, after 3.7 ms: 14.6 ms
    ({"homing.stall_time": 0.0145}, ["homing.stall_time = 0.0145 s", "raise homing.stall_time"]),
    ({"homing.reference_limit": 0.3}, ["torque of 0.27027 N.m", "friction of 0.29"]),
    ({"homing.speed": radians(100.0), "homing.stall_time": 0.05}, ["homing.stall_time = 0.05 s"]),
    ({"homing.speed": radians(101.0)}, ["homing.speed", "must be within"]),
    ({"homing.speed": 0.0}, ["homing.speed", "must be within"]),
    ({"homing.stall_time": -1.0}, ["homing.stall_time", "must be within"]),
])
def test_bad_values_are_refused(overrides: Mapping[str, Any], words: list[str]) -> None:
    with pytest.raises(ParameterError) as refused:
        BASE.with_values(overrides)
    assert all(word in str(refused.value) for word in words), refused.value


@pytest.mark.parametrize("model", ["nonlinear", "ristanovic", *slow("elastic", "habibi", "ozkan")])
@pytest.mark.parametrize("speed", [2.0, 20.0])
def test_the_least_timeout_and_stall_time_are_enough(model: str, speed: float) -> None:
    """From the farthest start, in either direction."""
    parameters = load_parameters(model=f"{model}+homing")
    for first in (1.0, -1.0):
        changes = {"homing.speed": radians(speed), "homing.stall_time": {2.0: 0.0049, 20.0: 0.0147}[speed],
                   "fin.start_angle": -first * STOP, "homing.positive_first": first > 0.0}
        with pytest.raises(ParameterError) as refused:
            parameters.with_values({**changes, "homing.timeout": 0.1})
        least = float(str(refused.value).split("above ")[1].split(" s:")[0])
        run = simulate(parameters.with_values({**changes, "homing.timeout": least + 1e-3}).values, least + 0.1,
                       model=f"{model}+homing", home=True)
        assert run["status"][-1] == OPERATIONAL


def test_return_tolerance_ends_the_return() -> None:
    """The fin is within the tolerance through the last stall time; before it the overshoot of 0.17 deg was outside."""
    tolerance = radians(0.05)
    run = run_of({"homing.return_tolerance": tolerance}, 8.0, home=True)
    ready = int(np.argmax(run["homed"]))
    error = np.abs(motor(run["measured_fin_angle"])[ready - 99:ready]) / RATIO
    # The tolerance is in motor angle at the mean ratio, 1.08 times the ratio at zero.
    assert error.max() <= tolerance * 1.08 + COUNT / RATIO
    assert np.abs(run["measured_fin_angle"][ready - 120:ready - 100]).max() > tolerance
    wide = run_of({"homing.return_tolerance": 10.0 * tolerance}, 8.0, home=True)
    assert first_time(wide, OPERATIONAL) < first_time(run, OPERATIONAL) - 0.01


def test_at_a_turn_the_integral_is_zero() -> None:
    """Otherwise the error integrated during a push, 25 ms of the way, would oppose the speed feed-forward.

    Right after the turn the reference is that of a fin at rest with the homing speed as command: at its limit.
    """
    run = run_of({"fin.start_angle": 0.2}, 6.0, home=True)
    u, p = run["drive_reference"], BASE.values
    first, second = np.flatnonzero(np.diff(np.sign(u)) * (np.abs(u[:-1]) == 1.0))[:2]
    integral = p["controller.position.ki"] * 0.025 * SPEED * RATIO * 0.075
    assert p["controller.velocity.kp"] * integral > 0.4  # V, of 1 V
    assert (u[first], u[second]) == (1.0, -1.0)
    assert u[first + 2] == -1.0
    assert u[second + 2] == 1.0


def test_a_model_without_the_extension_has_no_homing_parameter() -> None:
    with pytest.raises(ParameterError, match="no such parameter"):
        load_parameters(model=NONLINEAR).with_values({"homing.speed": 0.1})
