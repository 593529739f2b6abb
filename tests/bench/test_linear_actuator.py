"""The loops of a linearised actuator agree with the circuit's closed form and with each other."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.frequency import evaluate
from emcas_fmu.parameters import load_parameters

Values = Mapping[str, Any]
HERTZ = np.array([0.3, 3.0, 30.0, 120.0])


@pytest.fixture(scope="module")
def linear(values: Values) -> LinearActuator:
    """The default actuator with setpoint weight 1: command and measured angle act alike."""
    return LinearActuator({**values, "controller.position.setpoint_weight": 1.0})


def test_current_loop_is_the_closed_form_of_winding_and_rotor(values: Values, linear: LinearActuator) -> None:
    """Open loop (k_p + k_i/s) (J s + b)/((L s + R) (J s + b) + K_t K_e), with inertia and friction at the motor."""
    s = 2j * pi * HERTZ
    ratio, lead = linear.point.ratio, values["screw.lead"]
    inertia = (values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2
               + (values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]) / ratio**2)
    viscous = 0.5 * (values["friction.viscous.positive"] + values["friction.viscous.negative"])
    rotor = inertia * s + viscous
    winding = values["motor.inductance"] * s + values["motor.resistance"]
    expected = (values["drive.kp"] + values["drive.ki"] / s) * rotor / (
        winding * rotor + values["motor.torque_constant"] * values["motor.back_emf_constant"])
    np.testing.assert_allclose(evaluate(linear.loop("current"), HERTZ), expected, rtol=1e-9)  # rounding


def test_command_response_is_the_closed_position_loop(linear: LinearActuator) -> None:
    """The measured angle is the fin angle at the sample: L/(1 + L) is exact up to rounding."""
    loop = evaluate(linear.loop("position"), HERTZ)
    np.testing.assert_allclose(evaluate(linear.command_to_angle, HERTZ), loop / (1.0 + loop), rtol=1e-8)


def test_reference_loop_contains_velocity_and_position_loop(linear: LinearActuator) -> None:
    """All feedback passes through the reference: its 1 + L is the product of 1 + L of both loops."""
    reference, velocity, position = (1.0 + evaluate(linear.loop(name), HERTZ)
                                     for name in ("reference", "velocity", "position"))
    np.testing.assert_allclose(reference, velocity * position, rtol=1e-8)


def test_loops_do_not_depend_on_the_setpoint_weight(values: Values, linear: LinearActuator) -> None:
    other = LinearActuator({**values, "controller.position.setpoint_weight": 0.5})
    for name in ("current", "velocity", "position", "reference"):
        np.testing.assert_allclose(evaluate(other.loop(name), HERTZ), evaluate(linear.loop(name), HERTZ), rtol=1e-9)
    assert np.abs(evaluate(other.command_to_angle, HERTZ[1:2])) < np.abs(evaluate(linear.command_to_angle, HERTZ[1:2]))


@pytest.mark.parametrize("loop", ["velocity", "position"])
def test_trajectory_generator_changes_no_loop(values: Values, linear: LinearActuator, loop: str) -> None:
    gains = {name: values[name] for name in values if name.startswith("controller.")}
    filters = {"filters.speed_bandwidth": 0.0, "filters.notch_frequency": 0.0}
    generator = load_parameters("two-degrees-of-freedom").with_values({**gains, **filters})
    assert generator.values["trajectory.natural_frequency"] > 0.0
    other = LinearActuator(generator.values, model=generator.model)
    # The two equilibria are solved separately and differ by rounding.
    assert evaluate(other.loop(loop), HERTZ) == pytest.approx(evaluate(linear.loop(loop), HERTZ), rel=1e-6)


def test_integral_acts_behind_a_trajectory_generator() -> None:
    """|L| at 0.1 Hz depends on the fin angle only by the lever's ratio, within 10 %: the integral is frozen at none."""
    base = load_parameters("two-degrees-of-freedom")
    gains = [abs(evaluate(LinearActuator(base.values, angle, model=base.model).loop("reference"), np.array([0.1]))[0])
             for angle in (0.0, 0.05, 0.1)]
    assert gains == pytest.approx([gains[0]] * 3, rel=0.1)


def test_latency_delays_only_the_response_to_the_command(values: Values, linear: LinearActuator) -> None:
    late = LinearActuator({**linear.values, "command.latency": 3e-3})
    delay = np.exp(-2j * pi * HERTZ * 3.0 * linear.period)
    assert late.period == values["controller.sample_time"]
    np.testing.assert_allclose(evaluate(late.command_to_angle, HERTZ), evaluate(linear.command_to_angle, HERTZ) * delay,
                               rtol=1e-8)
    np.testing.assert_allclose(evaluate(late.load_to_angle, HERTZ), evaluate(linear.load_to_angle, HERTZ), rtol=1e-8)
    np.testing.assert_allclose(evaluate(late.loop("reference"), HERTZ), evaluate(linear.loop("reference"), HERTZ),
                               rtol=1e-8)


def test_integral_action_removes_steady_errors(linear: LinearActuator) -> None:
    lowest = np.array([1e-4])  # Hz, far below the frequency of the integral action
    assert np.abs(evaluate(linear.command_to_angle, lowest)) == pytest.approx(1.0, abs=1e-4)
    assert np.abs(evaluate(linear.load_to_angle, lowest)) < 1e-6  # rad/(N.m)
    assert linear.stable


def test_rational_approximation_is_accurate_at_low_frequencies(linear: LinearActuator) -> None:
    """It lacks the half-sample lag of the measured speed. The difference is 0.3 % at 3 Hz, and smaller below."""
    slow = np.array([0.3, 1.0, 3.0])
    rational, exact = (evaluate(made[:, 0], slow) for made in (linear.rational(), linear.closed))
    np.testing.assert_allclose(rational, exact, rtol=0.005)
