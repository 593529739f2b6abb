"""The linear model against an integration, its frequency response, a closed form and the nonlinear actuator."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from math import pi, radians
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emcas_fmu.reference.events import Array
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.simulation import simulate
from tests.default_actuator import THESIS_LOOPS
from tests.marks import others_slow

Values = Mapping[str, Any]


@pytest.fixture
def values(values: Values) -> Values:
    return {**values, **THESIS_LOOPS}


COMMAND = np.where(np.arange(301) >= 20, radians(1.0), 0.0)


def integrated(p: Values, command: Array) -> Array:
    """Return the fin angle [rad] from the same equations in the fin's coordinate, integrated from event to event."""
    n = p["kinematics.moment_arm"] / p["screw.lead"]
    fin = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
    total = fin + n**2 * (p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * p["screw.lead"] ** 2)
    viscous = n**2 * (p["friction.viscous.positive"] + p["friction.viscous.negative"]) / 2 + p["friction.fin_viscous"]
    period, delay = p["controller.sample_time"], p["drive.transport_delay"]

    def slope(_time: float, x: Array, active: float) -> list[float]:
        _, angle_rate, current, xi = x.tolist()
        i_ref = p["drive.current_gain"] * active
        voltage = p["drive.kp"] * (i_ref - current) + xi
        back = p["motor.back_emf_constant"] * n * angle_rate
        return [angle_rate, (n * p["motor.torque_constant"] * current - viscous * angle_rate) / total,
                (voltage - p["motor.resistance"] * current - back) / p["motor.inductance"],
                p["drive.ki"] * (i_ref - current)]

    state, integral, references, angles = np.zeros(4), 0.0, [], []
    for k in range(len(command)):
        angles.append(state[0])
        error = n * (command[k] - state[0])
        speed_reference = p["controller.position.kp"] * error + integral
        references.append(p["controller.velocity.kp"] * (speed_reference - n * state[1]))
        integral += period * p["controller.position.ki"] * error
        now = k * period
        arrivals = [(j, j * period + delay) for j in range(len(references))]
        cuts = [now, *(t for _, t in arrivals if now + 1e-9 < t < now + period - 1e-9), now + period]
        for begin, end in pairwise(cuts):
            arrived = [j for j, t in arrivals if t <= begin + 1e-9]
            active = references[arrived[-1]] if arrived else 0.0
            state = solve_ivp(slope, (begin, end), state, "Radau", args=(active,), rtol=1e-9, atol=1e-12).y[:, -1]
    return np.array(angles)


@pytest.mark.parametrize("delay", others_slow([0.0, 0.4e-3, 1e-3, 3.7e-3], lambda delay: delay == 3.7e-3))
def test_linear_model_agrees_with_an_integration(values: Values, delay: float) -> None:
    p = {**values, "drive.transport_delay": delay, "friction.fin_viscous": 2.0, "drive.ki": 40.0}
    command = COMMAND[:60]
    # Radau with a tolerance of 1e-9 has errors of some 1e-9 rad over 40 periods and angles of 0.02 rad.
    np.testing.assert_allclose(LinearModel(p).simulate(command), integrated(p, command), rtol=0, atol=2e-8)


def test_constant_command_is_followed_without_error(values: Values) -> None:
    for ki in (0.0, 60.0):
        model = LinearModel({**values, "controller.position.ki": ki})
        assert abs(model.frequency_response(np.array([1e-9]))[0]) == pytest.approx(1.0, abs=1e-6)


def test_response_is_proportional_to_the_command(values: Values) -> None:
    model = LinearModel(values)
    np.testing.assert_allclose(model.simulate(20.0 * COMMAND), 20.0 * model.simulate(COMMAND), rtol=1e-12)


@pytest.mark.parametrize("frequency", [2.0, 10.0, 20.0])
def test_frequency_response_agrees_with_a_settled_sine(values: Values, frequency: float) -> None:
    model = LinearModel(values)
    time = np.arange(14_000) * model.sample_time
    wave = np.exp(2j * pi * frequency * time)
    response = model.simulate(wave.imag)
    settled = time >= 12.0  # s: the slowest time constant, kp/ki, is 0.2 s; the rest is a whole number of periods
    ratio = np.sum(response[settled] * wave.conj()[settled]) / np.sum(wave.imag[settled] * wave.conj()[settled])
    assert ratio == pytest.approx(model.frequency_response(np.array([frequency]))[0], abs=2e-5)


def test_fast_sampling_approaches_the_continuous_loop(values: Values) -> None:
    p = {**values, "controller.sample_time": 1e-5}
    n = p["kinematics.moment_arm"] / p["screw.lead"]
    fin = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
    inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * p["screw.lead"] ** 2 + fin / n**2
    viscous = 0.5 * (p["friction.viscous.positive"] + p["friction.viscous.negative"])
    frequency = np.array([1.0, 5.0, 15.0, 30.0])
    s = 2j * pi * frequency
    impedance = p["motor.inductance"] * s + p["motor.resistance"]
    drive = p["drive.kp"] + p["drive.ki"] / s
    back = p["motor.back_emf_constant"] * p["motor.torque_constant"] / (inertia * s + viscous)
    torque = p["motor.torque_constant"] * drive / (impedance + drive + back)
    speed = torque * p["drive.current_gain"] / (inertia * s + viscous) * np.exp(-s * p["drive.transport_delay"])
    inner = p["controller.velocity.kp"] * speed / (1.0 + p["controller.velocity.kp"] * speed)
    outer = (p["controller.position.kp"] + p["controller.position.ki"] / s) * inner / s
    # The hold delays by half a sample, 5 us: 1e-3 rad at 30 Hz.
    np.testing.assert_allclose(LinearModel(p).frequency_response(frequency), outer / (1.0 + outer), rtol=2e-3)


def test_nonlinear_actuator_is_linear_for_small_commands(values: Values) -> None:
    p = {**values, "kinematics.initial_angle": 0.0, "encoder.enabled": False, "drive.current_offset": 0.0,
         "compensation.gain": 0.0, "friction.viscous.negative": values["friction.viscous.positive"]}
    p |= {name: 0.0 for name in p if name.startswith("friction.coulomb.")}
    command = 1e-4
    result = simulate(p, 0.2, fin_command=lambda t: command)
    expected = LinearModel(p).simulate(np.full(len(result["time"]), command))
    # The geometry's error is quadratic in the angle (1e-8 at 1e-4 rad); the error of the ticks is 1e-5 of a step.
    np.testing.assert_allclose(result["fin_angle"], expected, rtol=0, atol=2e-5 * command)
    assert expected[-1] == pytest.approx(command, rel=0.1)  # an overshoot has not decayed yet
