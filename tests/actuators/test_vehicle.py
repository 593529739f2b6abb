"""Effects of the vehicle's rotation on its actuators."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, radians, sin, tan
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import simulator
from emcas_fmu.reference.plant import simulate as integrate
from emcas_fmu.simulation import Array, simulate, simulate_fins
from tests.own_actuator.example import MODEL
from tests.runs import run_both_kernels

TIME = np.round(np.arange(301) * 1e-3, 12)
# All inputs of motion: an oscillating roll of 3 Hz and 60 rad/s, coning, accelerations.
MOTION: dict[str, Array] = {
    "fin_command": np.where(TIME > 0.05, radians(15.0), 0.0), "aero_torque": -30.0 * np.sin(8.0 * TIME),
    "acceleration.x": np.full_like(TIME, -20.0), "acceleration.z": 50.0 * np.sin(10.0 * TIME),
    "attitude.roll": np.full_like(TIME, 0.3),
    "angular_rate.x": 60.0 * np.sin(6.0 * np.pi * TIME), "angular_acceleration.x": 360.0 * np.pi * np.cos(
        6.0 * np.pi * TIME),
    "angular_rate.y": 3.0 * np.sin(20.0 * TIME), "angular_acceleration.y": 60.0 * np.cos(20.0 * TIME),
    "angular_rate.z": 4.0 * np.cos(15.0 * TIME), "angular_acceleration.z": -60.0 * np.sin(15.0 * TIME)}
MOUNTING: dict[str, Any] = {"mounting.azimuth": 0.8, "mounting.station": -2.5, "loads.gravity": True}


def arguments(inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Return inputs as arguments of `simulate`, whose names have `__` for a dot."""
    return {name.replace(".", "__"): value for name, value in inputs.items()}


def values_of(model: str = "nonlinear", **changes: Any) -> dict[str, Any]:
    """Return an actuator's values without an encoder, with those changes that apply to it."""
    parameters = load_parameters(model=model)
    return dict(parameters.with_values(parameters.having({"encoder.enabled": False, **changes})).values)


def without_rotation(values: Mapping[str, Any], model: str = "nonlinear") -> Any:
    """Return the fin angle [rad] under the same inputs without the vehicle's rotation."""
    inputs = {name: column for name, column in MOTION.items() if not name.startswith("angular")}
    return simulate(values, 0.3, model=model, **arguments(inputs))["fin_angle"]


def test_nonlinear_against_its_independent_integration() -> None:
    """The limit is 0.002 deg, 0.0003 deg measured; the rotation moves the fin by 0.17 deg."""
    values = values_of("nonlinear", **MOUNTING)
    angle = run_both_kernels(values, 0.3, "nonlinear", **arguments(MOTION))["fin_angle"]
    expected = integrate(values, {"time": TIME, **MOTION})["fin_angle"]
    assert degrees(np.abs(angle - expected).max()) < 0.002
    assert degrees(np.abs(angle - without_rotation(values)).max()) > 0.1


def test_a_user_s_actuator_against_its_independent_integration() -> None:
    """The limit is 0.0002 deg, as without rotation (tests/own_actuator); 8e-5 deg measured."""
    values = dict(load_parameters(model=MODEL).with_values(MOUNTING).values)
    angle = simulate(values, 0.3, 1e-3, model=MODEL, **arguments(MOTION))["fin_angle"]
    expected = simulator(MODEL)(values, {"time": TIME, **MOTION})["fin_angle"]
    assert degrees(np.abs(angle - expected).max()) < 2e-4
    assert degrees(np.abs(angle - without_rotation(values, MODEL)).max()) > 0.05


@pytest.mark.parametrize("model", NAMES)
def test_hinge_torque_includes_the_moment_of_the_rotation(model: str) -> None:
    """The expected moment is that of the inertia about the hinge, without the rotor. Rounding is 1e-12 of some 100 N.m.
    """
    values = values_of(model, **{"mounting.azimuth": 0.7})
    p, q, r, acceleration = 40.0, 2.0, -5.0, 30.0
    inputs = arguments({"angular_rate.x": p, "angular_rate.y": q, "angular_rate.z": r, "angular_acceleration.x": 400.0,
                        "angular_acceleration.y": acceleration, "fin_command": radians(10.0)})
    out = simulate({**values, **{f"mass.{part}": 0.0 for part in ("fin", "shaft", "fork")}}, 0.1, 1e-3, model=model,
                   **inputs)
    inertia = sum(values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    across = cos(0.7) * r - sin(0.7) * q
    angle = out["fin_angle"]
    expected = inertia * (0.5 * (p**2 - across**2) * np.sin(2.0 * angle) + p * across * np.cos(2.0 * angle)
                          - cos(0.7) * acceleration)
    np.testing.assert_allclose(out["hinge_torque"], expected, rtol=0, atol=1e-10)
    assert np.ptp(angle) > 0.1


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "habibi", "ozkan", "ristanovic", "linear"])
def test_roll_acceleration_acts_on_the_rotor_like_a_moment_on_the_fin(model: str) -> None:
    """A moment of -R J A_x on the fin has the effect of A_x on the rotor, with any drive line."""
    values = values_of(model, **{f"friction.coulomb.{side}[{k}]": 0.0 for side in ("positive", "negative")
                              for k in range(7)}, **{"drive_line.backlash": 0.0, "compensation.gain": 0.0,
                                                     "friction.fin_coulomb": 0.0})
    rotor = values["inertia.motor"] + values["inertia.screw"]
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    if model in ("nonlinear", "elastic"):  # the other actuators have a constant ratio
        ratio *= 1.0 + tan(values["kinematics.initial_angle"])**2
    rolled = simulate(values, 0.02, 1e-4, model=model, enable=False, angular_acceleration__x=500.0)
    pushed = simulate(values, 0.02, 1e-4, model=model, enable=False, aero_torque=-500.0 * rotor * ratio)
    # 450 rad/s2 at the motor turn the fin by -0.085 deg in 20 ms. The lever's ratio changes by 0.03 %. An elastic drive
    # line deflects differently, by 0.0014 deg or 1.7 %, since the forces act on its opposite ends.
    assert degrees(rolled["fin_angle"][-1]) < -0.05
    assert rolled["fin_angle"][-1] == pytest.approx(pushed["fin_angle"][-1], rel=0.03 if model == "elastic" else 5e-3)


def test_screw_loss_acts_on_the_fin_s_inertia_but_not_on_the_rotor_s() -> None:
    """A rotor that lags behind the roll drives the fin through the screw, and feels the fin's inertia with its loss.

    Without friction, from rest: (J_r + e J_l) w' = -J_r A_x with e = 1/forward.
    """
    model = "nonlinear+efficiency"
    values = values_of(model, **{f"friction.coulomb.{side}[{k}]": 0.0 for side in ("positive", "negative")
                              for k in range(7)}, **{
        "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0, "efficiency.forward": 0.5,
        "efficiency.backward": 0.2, "inertia.fin": 5.0})
    rotor = values["inertia.motor"] + values["inertia.screw"]
    ratio = values["kinematics.moment_arm"] / values["screw.lead"] * (1.0 + tan(values["kinematics.initial_angle"])**2)
    load = (values["mass.nut"] * values["screw.lead"]**2
            + (5.0 + values["inertia.shaft"] + values["inertia.fork"]) / ratio**2)
    stop = 2e-3
    out = simulate(values, stop, 1e-4, model=model, enable=False, angular_acceleration__x=500.0)
    expected = -500.0 * rotor / (rotor + load / 0.5) * stop
    # The fin turns by 3e-5 rad, over which the lever's ratio is constant; centrifugal terms are 1e-5.
    assert out["motor_speed"][-1] == pytest.approx(expected, rel=1e-3)
    assert out["screw_loss"][-1] > 0.0


def test_rotation_acts_on_a_free_fin_with_its_shaft_without_the_fork() -> None:
    """In a roll a free fin moves away from zero, J d'' = J p^2 sin d cos d."""
    model, p = "nonlinear+faults", 20.0
    start = radians(3.0)
    values = values_of(model, **{"fault.free_fin.begin": 0.0, "fault.free_fin.end": 1.0, "fin.start_angle": start,
                              "inertia.fork": 0.3, "mass.fork": 0.0, "mass.fin": 0.0, "mass.shaft": 0.0})
    out = simulate(values, 0.05, 1e-4, model=model, enable=False, angular_rate__x=p)
    # For small angles d = start cosh(p t), from 3 to 4.6 deg; there sin d cos d is 0.4 % less than d.
    expected = start * np.cosh(p * (out["time"] - 1e-3))
    assert out["fin_angle"][-1] == pytest.approx(expected[-1], rel=0.03)
    moment = (values["inertia.fin"] + values["inertia.shaft"]) * p**2 * np.sin(out["fin_angle"]) * np.cos(
        out["fin_angle"])
    np.testing.assert_allclose(out["hinge_torque"][20:], moment[20:], rtol=1e-12)


def test_a_jam_holds_the_fin_at_any_roll_acceleration() -> None:
    values = values_of("nonlinear+faults", **{"fault.jam.begin": 0.0, "fault.jam.end": 1.0})
    out = simulate(values, 0.1, 1e-3, model="nonlinear+faults", angular_acceleration__x=3000.0)
    assert np.ptp(out["fin_angle"][2:]) == 0.0


def test_rotation_acts_on_each_fin_by_its_azimuth() -> None:
    """Each of four fins moves as alone, to the bit; opposite fins have opposite moments of the pitch acceleration."""
    sets = [values_of("nonlinear", **{"mounting.azimuth": radians(90.0 * k), "mounting.station": -2.0})
            for k in range(4)]
    motion = {"angular_rate.x": 30.0, "angular_acceleration.y": 80.0}
    fins = simulate_fins(sets, 0.1, **arguments({**motion, "fin_command": 0.05}))
    for k, values in enumerate(sets, 1):
        alone = simulate(values, 0.1, kernel="python", **arguments({**motion, "fin_command": 0.05}))
        assert np.array_equal(fins[f"fin[{k}].hinge_torque"], alone["hinge_torque"])
        assert np.array_equal(fins[f"fin[{k}].fin_angle"], alone["fin_angle"])
    assert fins["fin[1].hinge_torque"][0] == pytest.approx(-fins["fin[3].hinge_torque"][0], rel=1e-9)
