"""A vehicle that turns: what its rotation does to the actuators that it carries."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, radians, sin, tan
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.files import simulator
from emcas_fmu.reference.simulate import simulate as integrate
from emcas_fmu.simulation import Array, simulate, simulate_fins
from tests.own_actuator.example import MODEL

TIME = np.round(np.arange(301) * 1e-3, 12)
# A roll to and fro at 3 Hz and 60 rad/s, coning, an acceleration that is not given at the hinge: all that there is.
WILD: dict[str, Array] = {
    "fin_command": np.where(TIME > 0.05, radians(15.0), 0.0), "aero_torque": -30.0 * np.sin(8.0 * TIME),
    "acceleration.x": np.full_like(TIME, -20.0), "acceleration.z": 50.0 * np.sin(10.0 * TIME),
    "attitude.roll": np.full_like(TIME, 0.3),
    "angular_rate.x": 60.0 * np.sin(6.0 * np.pi * TIME), "angular_acceleration.x": 360.0 * np.pi * np.cos(
        6.0 * np.pi * TIME),
    "angular_rate.y": 3.0 * np.sin(20.0 * TIME), "angular_acceleration.y": 60.0 * np.cos(20.0 * TIME),
    "angular_rate.z": 4.0 * np.cos(15.0 * TIME), "angular_acceleration.z": -60.0 * np.sin(15.0 * TIME)}
PLACE: dict[str, Any] = {"mounting.azimuth": 0.8, "mounting.station": -2.5, "loads.gravity": True}
TURNING = [name for name in WILD if name.startswith("angular")]


def dunder(inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Names as arguments."""
    return {name.replace(".", "__"): value for name, value in inputs.items()}


def set_of(model: str = "nonlinear", **changes: Any) -> dict[str, Any]:
    """An actuator's parameters without an encoder, with changes where it has them."""
    parameters = load_parameters(model=model)
    return dict(parameters.with_values(parameters.having({"encoder.enabled": False, **changes})).values)


def test_nonlinear_against_its_independent_integration() -> None:
    """Within 0.002 deg; measured 0.0003 deg, where the rotation moves the fin by 0.17 deg. Both kernels to the bit."""
    values = set_of("nonlinear", **PLACE)
    runs = [simulate(values, 0.3, 1e-3, kernel, **dunder(WILD)) for kernel in ("compiled", "python")]
    assert all(np.array_equal(runs[0][name], runs[1][name]) for name in runs[0])
    expected = integrate(values, {"time": TIME, **WILD})["fin_angle"]
    assert degrees(np.abs(runs[0]["fin_angle"] - expected).max()) < 0.002
    still = simulate(values, 0.3, 1e-3, **dunder({n: x for n, x in WILD.items() if n not in TURNING}))
    assert degrees(np.abs(runs[0]["fin_angle"] - still["fin_angle"]).max()) > 0.1


def test_a_user_s_actuator_against_its_independent_integration() -> None:
    """Within 0.0002 deg, as its cases without rotation (tests/own_actuator); measured 8e-5 deg."""
    values = dict(load_parameters(model=MODEL).with_values(PLACE).values)
    found = simulate(values, 0.3, 1e-3, model=MODEL, **dunder(WILD))
    expected = simulator(MODEL)(values, {"time": TIME, **WILD})["fin_angle"]
    assert degrees(np.abs(found["fin_angle"] - expected).max()) < 2e-4
    still = simulate(values, 0.3, 1e-3, model=MODEL, **dunder({n: x for n, x in WILD.items() if n not in TURNING}))
    assert degrees(np.abs(found["fin_angle"] - still["fin_angle"]).max()) > 0.05


@pytest.mark.parametrize("model", NAMES)
def test_every_actuator_shows_the_moment_about_its_hinge(model: str) -> None:
    """By the formula at the angle that is shown; the rotor's share is not in it. 1e-12 of some 100 N.m: rounding."""
    values = set_of(model, **{"mounting.azimuth": 0.7})
    p, q, r, faster = 40.0, 2.0, -5.0, 30.0
    given = dunder({"angular_rate.x": p, "angular_rate.y": q, "angular_rate.z": r, "angular_acceleration.x": 400.0,
                    "angular_acceleration.y": faster, "fin_command": radians(10.0)})
    out = simulate({**values, **{f"mass.{part}": 0.0 for part in ("fin", "shaft", "fork")}}, 0.1, 1e-3, model=model,
                   **given)
    inertia = sum(values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    across = cos(0.7) * r - sin(0.7) * q
    angle = out["fin_angle"]
    expected = inertia * (0.5 * (p**2 - across**2) * np.sin(2.0 * angle) + p * across * np.cos(2.0 * angle)
                          - cos(0.7) * faster)
    np.testing.assert_allclose(out["hinge_torque"], expected, rtol=0, atol=1e-10)
    assert np.ptp(angle) > 0.1


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "habibi", "ozkan", "ristanovic", "linear"])
def test_the_rotor_takes_its_share_of_a_roll_s_acceleration(model: str) -> None:
    """A moment of -R J A_x on the fin has the effect of A_x, with any drive line between motor and fin."""
    values = set_of(model, **{f"friction.coulomb.{side}[{k}]": 0.0 for side in ("positive", "negative")
                              for k in range(7)}, **{"drive_line.backlash": 0.0, "compensation.gain": 0.0,
                                                     "friction.fin_coulomb": 0.0})
    rotor = values["inertia.motor"] + values["inertia.screw"]
    ratio = values["kinematics.moment_arm"] / values["screw.lead"]
    if model in ("nonlinear", "elastic"):  # the others' is constant
        ratio *= 1.0 + tan(values["kinematics.initial_angle"])**2
    rolled = simulate(values, 0.02, 1e-4, model=model, enable=False, angular_acceleration__x=500.0)
    pushed = simulate(values, 0.02, 1e-4, model=model, enable=False, aero_torque=-500.0 * rotor * ratio)
    # 450 rad/s2 at the motor turn the fin by -0.085 deg in that time; the lever's ratio changes by 0.03 %, and an
    # elastic line is pushed from its two sides: it yields by 0.0014 deg, 1.7 %.
    assert degrees(rolled["fin_angle"][-1]) < -0.05
    assert rolled["fin_angle"][-1] == pytest.approx(pushed["fin_angle"][-1], rel=0.03 if model == "elastic" else 5e-3)


def test_a_loss_in_the_screw_leaves_what_turns_the_rotor_alone() -> None:
    """A rotor that lags behind the roll drives the fin through the screw, and feels the fin's load by its loss.

    Frictionless, from rest: (J_r + e J_l) w' = -J_r A_x with e = 1/forward, the motor driving.
    """
    model = "nonlinear+efficiency"
    values = set_of(model, **{f"friction.coulomb.{side}[{k}]": 0.0 for side in ("positive", "negative")
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
    # Over 3e-5 rad of the fin the lever is as it was; what turns faster is felt by its centrifugal term, 1e-5.
    assert out["motor_speed"][-1] == pytest.approx(expected, rel=1e-3)
    assert out["screw_loss"][-1] > 0.0


def test_a_broken_shaft_leaves_the_rotation_to_fin_and_shaft() -> None:
    """A fin that is free swings away from zero in a roll, J d'' = J p^2 sin d cos d; the fork is not part of it."""
    model, p = "nonlinear+faults", 20.0
    start = radians(3.0)
    values = set_of(model, **{"fault.free_fin.begin": 0.0, "fault.free_fin.end": 1.0, "fin.start_angle": start,
                              "inertia.fork": 0.3, "mass.fork": 0.0, "mass.fin": 0.0, "mass.shaft": 0.0})
    out = simulate(values, 0.05, 1e-4, model=model, enable=False, angular_rate__x=p)
    # For small angles d = start cosh(p t); 3 deg to 4.6 deg, of which sin d cos d is 0.4 % less.
    grown = start * np.cosh(p * (out["time"] - 1e-3))
    assert out["fin_angle"][-1] == pytest.approx(grown[-1], rel=0.03)
    shown = (values["inertia.fin"] + values["inertia.shaft"]) * p**2 * np.sin(out["fin_angle"]) * np.cos(
        out["fin_angle"])
    np.testing.assert_allclose(out["hinge_torque"][20:], shown[20:], rtol=1e-12)


def test_a_jammed_rotor_turns_with_the_vehicle() -> None:
    """A jam holds it for any roll acceleration: the fin is at rest to the bit."""
    values = set_of("nonlinear+faults", **{"fault.jam.begin": 0.0, "fault.jam.end": 1.0})
    out = simulate(values, 0.1, 1e-3, model="nonlinear+faults", angular_acceleration__x=3000.0)
    assert np.ptp(out["fin_angle"][2:]) == 0.0


def test_fins_of_a_unit_feel_it_each_by_its_azimuth() -> None:
    """Four fins of one vehicle are the four by themselves, to the bit; q' turns opposite ones opposite ways."""
    sets = [set_of("nonlinear", **{"mounting.azimuth": radians(90.0 * k), "mounting.station": -2.0}) for k in range(4)]
    motion = {"angular_rate.x": 30.0, "angular_acceleration.y": 80.0}
    unit = simulate_fins(sets, 0.1, **dunder({**motion, "fin_command": 0.05}))
    for k, values in enumerate(sets, 1):
        alone = simulate(values, 0.1, kernel="python", **dunder({**motion, "fin_command": 0.05}))
        assert np.array_equal(unit[f"fin[{k}].hinge_torque"], alone["hinge_torque"])
        assert np.array_equal(unit[f"fin[{k}].fin_angle"], alone["fin_angle"])
    assert unit["fin[1].hinge_torque"][0] == pytest.approx(-unit["fin[3].hinge_torque"][0], rel=1e-9)
