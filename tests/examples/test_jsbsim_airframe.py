"""Damping, axial force, masses and areas of the rocket agree with hand calculation from the documented sizes.

The sizes are repeated here in SI: a wrong unit or sign in the aircraft file is detected.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians, sin

import numpy as np
import pytest

from examples.jsbsim.vehicle import FINS, FOOT, POUND_FORCE, Array, Launch, Rocket

STEP = 1e-5  # s, so short that the flight condition does not change
STILL = np.zeros(3)
NORTH = Launch(attitude=(0.0, 0.0, 0.0))
MASS, INERTIA = 300.0, (5.0, 400.0, 400.0)  # kg, kg.m2
DIAMETER, FIN_AREA = 0.3, (0.30 + 0.16) / 2.0 * 0.28  # m, m2: mean of root and tip chord, times span
CENTRE, HINGES, NOSE, SIDE = 2.05, 3.77, 0.42, 2.14  # m behind the tip; the last is where cross-flow acts
UPWASH = 1.0 + 0.15 / (0.15 + 0.28)  # at the fins, by the body
SLUG = POUND_FORCE / FOOT  # kg


def launched(rates: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Rocket:
    """Return the rocket one step after its launch with body rates [rad/s] and fins at 0."""
    rocket = Rocket(STEP, replace(NORTH, body_rates=rates))
    rocket.advance(np.zeros(4), STILL)
    return rocket


def moments(rocket: Rocket) -> Array:
    """Return the body moments [N.m] about the centre of gravity, shape (3,)."""
    return np.array([rocket[f"moments/{n}-total-lbsft"] for n in "lmn"]) * POUND_FORCE * FOOT


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("rate", [0.1, -0.1])
def test_damping_of_pitch_and_yaw(axis: int, rate: float) -> None:
    """The rate inclines the flow at the fins by upwash times rate times arm over speed.

    Four fins at 45 deg have in each plane the force of two fins. The nose's force depends on the flow at the centre of
    gravity and cancels in the difference. 1 %: within the step the nose turns by 0.4 % of the flow at the fins, and
    there is cross-flow lift at 0.02 deg of incidence.
    """
    rates = [0.0, 0.0, 0.0]
    rates[axis] = rate
    rocket = launched((rates[0], rates[1], rates[2]))
    state = rocket.state()
    arm = HINGES - CENTRE
    expected = -2.0 * state.dynamic_pressure * FIN_AREA * rocket["aero/fin/slope"] * UPWASH * arm**2 / state.speed
    turning, still = moments(rocket), moments(launched())
    assert (turning - still)[axis] / rate == pytest.approx(expected, rel=0.01)
    assert turning[axis] * rate < 0.0


@pytest.mark.parametrize("angle", [10.0, -10.0])
def test_axial_force_of_deflected_fins(angle: float) -> None:
    """The force is normal to the chord. 0.1 %: the file's rounded square feet."""
    rocket = Rocket(STEP, NORTH)
    rocket.advance(np.zeros(4), STILL)
    before = rocket["forces/fbx-aero-lbs"]
    delta = radians(angle)
    rocket = Rocket(STEP, NORTH)
    rocket.advance(np.full(4, delta), STILL)
    pressure, slope = rocket.state().dynamic_pressure, rocket["aero/fin/slope"]
    normal = pressure * FIN_AREA * sin(abs(delta)) * (slope * np.cos(delta) + 1.2 * sin(abs(delta)))
    axial = (rocket["forces/fbx-aero-lbs"] - before) * POUND_FORCE
    assert before < 0.0
    assert axial == pytest.approx(-len(FINS) * normal * sin(abs(delta)), rel=1e-3)


def test_axial_force_of_the_body() -> None:
    """The coefficient is 0.45 at Mach 2 for the body's cross-section. 2 %: Mach 1.98 at launch, and a rounded table."""
    rocket = launched()
    area = pi * DIAMETER**2 / 4.0
    force = rocket["forces/fbx-aero-lbs"] * POUND_FORCE
    assert force == pytest.approx(-rocket.state().dynamic_pressure * area * 0.45, rel=0.02)


def test_jsbsim_has_the_documented_masses_and_sizes() -> None:
    """1e-4 is JSBSim's rounding of units."""
    rocket = launched()
    for name, inertia in zip(("ixx", "iyy", "izz"), INERTIA, strict=True):
        assert rocket[f"inertia/{name}-slugs_ft2"] * SLUG * FOOT**2 == pytest.approx(inertia, rel=1e-4)
    assert rocket["inertia/mass-slugs"] * SLUG == pytest.approx(MASS, rel=1e-4)
    assert rocket["inertia/cg-x-in"] * FOOT / 12.0 == pytest.approx(CENTRE, rel=1e-4)
    assert rocket["metrics/Sw-sqft"] * FOOT**2 == pytest.approx(pi * DIAMETER**2 / 4.0, rel=1e-4)
    assert rocket["metrics/bw-ft"] * FOOT == rocket["metrics/cbarw-ft"] * FOOT == pytest.approx(DIAMETER, rel=1e-4)


def test_angular_acceleration_is_moment_over_inertia() -> None:
    """1 % is the change within a few steps; JSBSim's second-order integrator needs one step to start."""
    wind = np.array([0.0, -20.0, -20.0])
    rocket = Rocket(STEP, NORTH)
    for _ in range(3):
        before = rocket.advance(np.full(4, radians(2.0)), wind)
    acting = moments(rocket)
    after = rocket.advance(np.full(4, radians(2.0)), wind)
    np.testing.assert_allclose((after.body_rates - before.body_rates) / STEP, acting / INERTIA, rtol=0.01)


def test_moment_of_a_cross_wind_agrees_with_hand_calculation() -> None:
    """Nose, cross-flow and fins about the centre of gravity. 2 %: rounded feet, and curvature of the lift."""
    rocket = Rocket(STEP, NORTH)
    state = rocket.advance(np.zeros(4), np.array([0.0, 0.0, -10.0]))
    up, area, pressure = 10.0 / state.speed, pi * DIAMETER**2 / 4.0, state.dynamic_pressure
    nose = 2.0 * pressure * area * up
    across = 0.7 * 1.2 * 1.11 * pressure * up**2
    flow = UPWASH * up * np.cos(radians(45.0))  # across each fin
    fin = pressure * FIN_AREA * flow * (rocket["aero/fin/slope"] + 1.2 * flow)
    tail = 4.0 * np.cos(radians(45.0)) * fin
    expected = nose * (CENTRE - NOSE) + across * (CENTRE - SIDE) - tail * (HINGES - CENTRE)
    assert moments(rocket)[1] == pytest.approx(expected, rel=0.02)
