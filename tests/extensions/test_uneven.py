"""Friction that grows with the fin's load and varies over a revolution: closed forms, neutral values, equal kernels."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.runs import assert_equal, run_both_kernels

from .runs import NO_COULOMB, WAYS

MODEL = "nonlinear+uneven"
EFFECTIVE = {"uneven.load_share": 0.03, "uneven.ripple": 0.2}  # plain bearings and a ball screw
# A constant friction of 0.2 N.m at the motor; no damping and no mass about the hinge.
DRY: dict[str, Any] = {
    **NO_COULOMB, **{f"friction.coulomb.{way}[0]": 0.2 for way in WAYS},
    "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0, "friction.fin_viscous": 0.0,
    "friction.fin_coulomb": 0.0, "inertia.fin": 1e-9, "inertia.shaft": 0.0, "inertia.fork": 0.0, "mass.fin": 0.0,
    "mass.shaft": 0.0, "mass.fork": 0.0, "loads.gravity": False}
INPUTS: Any = {"fin_command": lambda t: 0.1 * sin(30.0 * t), "aero_torque": lambda t: -40.0 * cos(50.0 * t)}


def values_of(changes: Mapping[str, Any]) -> dict[str, Any]:
    return {**load_parameters(model=MODEL).values, **changes}


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "worm-gear", "nonlinear+stribeck", "nonlinear+lugre"])
def test_the_defaults_change_no_bit(model: str) -> None:
    plain, extended = load_parameters(model=model).values, load_parameters(model=f"{model}+uneven").values
    before = simulate(plain, 0.1, kernel="python", model=model, **INPUTS)
    after = simulate({**extended, "uneven.phase": 0.7}, 0.1, kernel="python", model=f"{model}+uneven", **INPUTS)
    assert_equal(after, before)
    uneven = simulate({**extended, **EFFECTIVE}, 0.1, kernel="python", model=f"{model}+uneven", **INPUTS)
    assert not np.array_equal(before["fin_angle"], uneven["fin_angle"])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("phase", [0.0, pi])
def test_a_load_breaks_away_where_it_exceeds_both_frictions(share: float, phase: float) -> None:
    """With a disabled drive the fin breaks away at zero if (1 - s) T_a/R exceeds C_m (1 + a cos(theta_0))."""
    p = values_of({**DRY, "uneven.load_share": share, "uneven.ripple": 0.3, "uneven.phase": phase})
    ratio = p["kinematics.moment_arm"] / p["screw.lead"] / cos(p["kinematics.initial_angle"]) ** 2
    load = np.arange(101) * 1.0  # N.m, one more in each step
    run = simulate(p, 0.1, kernel="python", model=MODEL, enable=False, aero_torque=load)
    # The load of the last step that the motor ends at rest.
    largest = load[np.argmax(run["motor_angle"] != run["motor_angle"][0]) - 2]
    assert largest <= 0.2 * (1.0 + 0.3 * cos(phase)) * ratio / (1.0 - share) < largest + 1.0


def coasting(tick: float) -> tuple[float, float]:
    """Return the error [rad] of the motor angle at which a coasting motor stops, and its way [rad].

    J w^2/2 = C (theta - theta_1 + a (sin(theta - theta_0) - sin(theta_1 - theta_0))).
    """
    ripple, phase, friction = 0.9, 0.4, 0.6
    p = values_of({**DRY, "friction.coulomb.positive[0]": friction, "uneven.load_share": 0.0, "uneven.ripple": ripple,
                "uneven.phase": phase, "solver.max_tick": tick, "fin.start_angle": radians(-20.0)})
    inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * p["screw.lead"] ** 2
    run = simulate(p, 0.4, kernel="python", model=MODEL, fin_command=radians(20.0), enable=lambda t: t < 0.0305)
    first, last = 32, -1
    begin, speed = run["motor_angle"][first], run["motor_speed"][first]
    assert run["motor_speed"][last] == 0.0

    def energy_deficit(angle: float) -> float:
        way = angle - begin + ripple * (sin(angle - phase) - sin(begin - phase))
        return float(friction * way - 0.5 * inertia * speed**2)

    exact = brentq(energy_deficit, begin, begin + 1e3, xtol=1e-12)
    return abs(run["motor_angle"][last] - exact), exact - begin


def test_a_coasting_motor_loses_its_energy_to_friction() -> None:
    """To second order in the tick, over several revolutions."""
    (coarse, way), (fine, _), (finest, _) = coasting(4e-4), coasting(2e-4), coasting(1e-4)
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert finest < 2e-5  # 2e-7 rad at the fin; the reversal's event is within 1e-5 rad
    assert way > 4.0 * pi


def test_kernels_agree() -> None:
    run_both_kernels(values_of({"uneven.load_share": 0.1, "uneven.ripple": 0.3}), 0.1, MODEL, **INPUTS)
