"""Friction that grows with the fin's load and varies over a revolution: closed forms, neutral values, back ends."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+uneven"
SIZES = {"uneven.load_share": 0.03, "uneven.ripple": 0.2}  # of plain bearings and a ball screw
# Constant friction of 0.2 N.m at the motor, nothing else: neither damping nor mass about the hinge.
DRY: dict[str, Any] = {
    **{f"friction.coulomb.{way}[{power}]": 0.2 * (power == 0)
       for way in ("positive", "negative") for power in range(7)},
    "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0, "friction.fin_viscous": 0.0,
    "friction.fin_coulomb": 0.0, "inertia.fin": 1e-9, "inertia.shaft": 0.0, "inertia.fork": 0.0, "mass.fin": 0.0,
    "mass.shaft": 0.0, "mass.fork": 0.0, "loads.gravity": False}


INPUTS: Any = {"fin_command": lambda t: 0.1 * sin(30.0 * t), "aero_torque": lambda t: -40.0 * cos(50.0 * t)}


def values(changes: Mapping[str, Any]) -> dict[str, Any]:
    return {**load_parameters(model=MODEL).values, **changes}


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "worm-gear", "nonlinear+stribeck", "nonlinear+lugre"])
def test_the_defaults_change_no_bit(model: str) -> None:
    plain, extended = load_parameters(model=model).values, load_parameters(model=f"{model}+uneven").values
    before = simulate(plain, 0.1, kernel="python", model=model, **INPUTS)
    after = simulate({**extended, "uneven.phase": 0.7}, 0.1, kernel="python", model=f"{model}+uneven", **INPUTS)
    assert all(np.array_equal(before[name], after[name]) for name in before)
    moved = simulate({**extended, **SIZES}, 0.1, kernel="python", model=f"{model}+uneven", **INPUTS)
    assert not np.array_equal(before["fin_angle"], moved["fin_angle"])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("phase", [0.0, pi])
def test_a_load_breaks_away_where_it_exceeds_both_frictions(share: float, phase: float) -> None:
    """(1 - s) T_a/R = C_m (1 + a cos(theta_0)) at zero: with the drive off, under a load that rises by 1 N.m a step."""
    p = values({**DRY, "uneven.load_share": share, "uneven.ripple": 0.3, "uneven.phase": phase})
    ratio = p["kinematics.moment_arm"] / p["screw.lead"] / cos(p["kinematics.initial_angle"]) ** 2
    load = np.arange(101) * 1.0
    run = simulate(p, 0.1, kernel="python", model=MODEL, enable=False, aero_torque=load)
    # That of the last step at whose end the motor is at rest.
    held = load[np.argmax(run["motor_angle"] != run["motor_angle"][0]) - 2]
    assert held <= 0.2 * (1.0 + 0.3 * cos(phase)) * ratio / (1.0 - share) < held + 1.0


def stopping(tick: float) -> tuple[float, float]:
    """Return the error [rad] of the motor angle at which a coasting motor stops, and the way [rad] until then.

    J w^2/2 = C (theta - theta_1 + a (sin(theta - theta_0) - sin(theta_1 - theta_0))).
    """
    ripple, phase, friction = 0.9, 0.4, 0.6
    p = values({**DRY, "friction.coulomb.positive[0]": friction, "uneven.load_share": 0.0, "uneven.ripple": ripple,
                "uneven.phase": phase, "solver.max_tick": tick, "fin.start_angle": radians(-20.0)})
    inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * p["screw.lead"] ** 2
    run = simulate(p, 0.4, kernel="python", model=MODEL, fin_command=radians(20.0), enable=lambda t: t < 0.0305)
    first, last = 32, -1
    begin, speed = run["motor_angle"][first], run["motor_speed"][first]
    assert run["motor_speed"][last] == 0.0

    def left(angle: float) -> float:
        way = angle - begin + ripple * (sin(angle - phase) - sin(begin - phase))
        return float(friction * way - 0.5 * inertia * speed**2)

    exact = brentq(left, begin, begin + 1e3, xtol=1e-12)
    return abs(run["motor_angle"][last] - exact), exact - begin


def test_a_coasting_motor_loses_its_energy_to_friction() -> None:
    """Of second order in the tick, over several revolutions."""
    (coarse, way), (fine, _), (finest, _) = stopping(4e-4), stopping(2e-4), stopping(1e-4)
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert finest < 2e-5  # 2e-7 rad at the fin; the reversal's event is within 1e-5 rad
    assert way > 4.0 * pi


def test_back_ends_agree_to_the_bit() -> None:
    p = values({"uneven.load_share": 0.1, "uneven.ripple": 0.3})
    one, other = (simulate(p, 0.1, kernel=kernel, model=MODEL, **INPUTS) for kernel in ("python", "compiled"))
    assert all(np.array_equal(one[name], other[name]) for name in one)
