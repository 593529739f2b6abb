"""The loops of a linearised actuator: against the circuit's closed form, and against each other."""

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
    """A setpoint weight of 1, so that command and measured angle act alike."""
    return LinearActuator({**values, "controller.position.setpoint_weight": 1.0})


def test_the_current_loop_is_that_of_winding_and_rotor(values: Values, linear: LinearActuator) -> None:
    """L = (k_p + k_i/s) (J s + b)/((L s + R) (J s + b) + K_t K_e), with inertia and friction at the motor."""
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


def test_the_position_loop_closes_to_the_command_response(linear: LinearActuator) -> None:
    """L/(1 + L) from command to measured angle; the measured angle is the fin's of the sample, exact up to rounding."""
    loop = evaluate(linear.loop("position"), HERTZ)
    np.testing.assert_allclose(evaluate(linear.command_to_angle, HERTZ), loop / (1.0 + loop), rtol=1e-8)


def test_the_inner_loops_are_in_the_outer_one(linear: LinearActuator) -> None:
    """All feedback passes the reference: 1 + L of it is 1 + L of the velocity loop times 1 + L of the position loop."""
    reference, velocity, position = (1.0 + evaluate(linear.loop(name), HERTZ)
                                     for name in ("reference", "velocity", "position"))
    np.testing.assert_allclose(reference, velocity * position, rtol=1e-8)


def test_the_loops_do_not_depend_on_the_setpoint_weight(values: Values, linear: LinearActuator) -> None:
    other = LinearActuator({**values, "controller.position.setpoint_weight": 0.5})
    for name in ("current", "velocity", "position", "reference"):
        np.testing.assert_allclose(evaluate(other.loop(name), HERTZ), evaluate(linear.loop(name), HERTZ), rtol=1e-9)
    assert np.abs(evaluate(other.command_to_angle, HERTZ[1:2])) < np.abs(evaluate(linear.command_to_angle, HERTZ[1:2]))


@pytest.mark.parametrize("loop", ["velocity", "position"])
def test_a_trajectory_generator_is_in_no_loop(values: Values, linear: LinearActuator, loop: str) -> None:
    base = load_parameters("two-degrees-of-freedom")
    generated = base.with_values({name: values[name] for name in values if name.startswith("controller.")})
    generated = generated.with_values({"filters.speed_bandwidth": 0.0, "filters.notch_frequency": 0.0})
    assert generated.values["trajectory.natural_frequency"] > 0.0
    other = LinearActuator(generated.values, model=generated.model)
    # Within the rounding of two solutions at rest.
    assert evaluate(other.loop(loop), HERTZ) == pytest.approx(evaluate(linear.loop(loop), HERTZ), rel=1e-6)


def test_the_integral_acts_behind_a_trajectory_generator() -> None:
    """At any rest: |L| of 0.1 Hz differs by the lever's ratio, within 10 %, and not by an integral that is held."""
    base = load_parameters("two-degrees-of-freedom")
    gains = [abs(evaluate(LinearActuator(base.values, angle, model=base.model).loop("reference"), np.array([0.1]))[0])
             for angle in (0.0, 0.05, 0.1)]
    assert gains == pytest.approx([gains[0]] * 3, rel=0.1)


def test_latency_only_delays_the_response_to_the_command(values: Values, linear: LinearActuator) -> None:
    late = LinearActuator({**linear.values, "command.latency": 3e-3})
    delay = np.exp(-2j * pi * HERTZ * 3.0 * linear.period)
    assert late.period == values["controller.sample_time"]
    np.testing.assert_allclose(evaluate(late.command_to_angle, HERTZ), evaluate(linear.command_to_angle, HERTZ) * delay,
                               rtol=1e-8)
    np.testing.assert_allclose(evaluate(late.load_to_angle, HERTZ), evaluate(linear.load_to_angle, HERTZ), rtol=1e-8)
    np.testing.assert_allclose(evaluate(late.loop("reference"), HERTZ), evaluate(linear.loop("reference"), HERTZ),
                               rtol=1e-8)


def test_the_final_values_are_those_of_integral_action(linear: LinearActuator) -> None:
    lowest = np.array([1e-4])  # Hz: far below the integral's 1/s
    assert np.abs(evaluate(linear.command_to_angle, lowest)) == pytest.approx(1.0, abs=1e-4)
    assert np.abs(evaluate(linear.load_to_angle, lowest)) < 1e-6  # rad/(N.m)
    assert linear.stable


def test_the_rational_approximation_is_that_at_low_frequencies(linear: LinearActuator) -> None:
    """The lag of the measured speed, half a sample, is not in it: it was measured as 0.3 % at 3 Hz and falls below."""
    slow = np.array([0.3, 1.0, 3.0])
    rational, exact = (evaluate(made[:, 0], slow) for made in (linear.rational(), linear.closed))
    np.testing.assert_allclose(rational, exact, rtol=0.005)
