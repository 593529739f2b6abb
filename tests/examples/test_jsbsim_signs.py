"""Signs, sizes and balances of the rocket agree with its geometry in SI."""

from __future__ import annotations

import shutil
from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from examples.jsbsim import vehicle
from examples.jsbsim.autopilot import MIXER, Autopilot, Gains, attitude_error
from examples.jsbsim.vehicle import AZIMUTHS, FINS, FOOT, POUND_FORCE, STATION, Array, Launch, Rocket, State

STEP = 1e-4  # s, so short that the launch condition does not change
MOMENTS = ("moments/l-total-lbsft", "moments/m-total-lbsft", "moments/n-total-lbsft")
STILL = np.zeros(3)
NORTH = Launch(attitude=(0.0, 0.0, 0.0))
AREA, ARM, LEVER, CHORD, HINGE = 0.0644, 1.72, 0.275, 0.237, 0.41  # m2, m, m, m, of the chord


def moments(fins: Array, wind: Array = STILL) -> tuple[Array, Rocket]:
    """Return the body moments [N.m] about the centre of gravity in level flight to the north, and the rocket."""
    rocket = Rocket(STEP, NORTH)
    rocket.advance(fins, wind)
    return np.array([rocket[name] for name in MOMENTS]) * POUND_FORCE * FOOT, rocket


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("angle", [5.0, -12.0])
def test_moments_of_one_fin_agree_with_hand_calculation(k: int, angle: float) -> None:
    """0.1 % is for the file's rounded feet and square feet."""
    fins = np.zeros(4)
    fins[k] = delta = radians(angle)
    found, rocket = moments(fins)
    state = rocket.state()
    normal = state.dynamic_pressure * AREA * (rocket["aero/fin/slope"] * sin(delta) * cos(delta)
                                              + 1.2 * sin(delta) * abs(sin(delta)))
    side = normal * cos(delta)
    expected = np.array([-LEVER * side, -ARM * cos(AZIMUTHS[k]) * side, -ARM * sin(AZIMUTHS[k]) * side])
    np.testing.assert_allclose(found, expected, atol=1e-3 * ARM * abs(side))
    behind = (0.477 - HINGE) * CHORD  # centre of pressure at Mach 2; the flight begins within 0.5 % of it
    assert state.hinge_moments[k] == pytest.approx(-normal * behind, rel=0.01)
    assert np.all(np.abs(np.delete(state.hinge_moments, k)) < 1e-3 * abs(state.hinge_moments[k]))


def test_mixer_gives_a_positive_moment_about_the_demanded_axis_only() -> None:
    """1e-3 is for the file's rounding."""
    for axis in range(3):
        demand = np.zeros(3)
        demand[axis] = radians(3.0)
        found, _ = moments(MIXER @ demand)
        assert found[axis] > 0.0
        assert np.all(np.abs(np.delete(found, axis)) < 1e-3 * found[axis])


def test_autopilot_reduces_the_error_and_damps() -> None:
    """If the attitude is below the commanded one, the moment is positive; a positive rate reduces it."""
    rocket = Rocket(STEP, NORTH)
    state = rocket.advance(np.zeros(4), STILL)
    for axis in range(3):
        wanted = state.attitude.copy()
        wanted[axis] += radians(1.0)
        found, _ = moments(Autopilot(Gains()).update(state, wanted).fins)
        assert found[axis] > 0.0
        rates = np.zeros(3)
        rates[axis] = 0.1
        damped, _ = moments(Autopilot(Gains()).update(replace(state, body_rates=rates), wanted).fins)
        assert damped[axis] < found[axis]


def test_attitude_error_is_the_turn_about_body_axes() -> None:
    """At 90 deg of roll body y points down: a pitch error is a turn about -z, a heading error a turn about +y."""
    actual = np.array([pi / 2, 0.2, 0.7])
    error = attitude_error(actual, np.array([pi / 2, 0.201, 0.7]))
    np.testing.assert_allclose(error, [0.0, 0.0, -1e-3], atol=1e-6)
    error = attitude_error(np.array([pi / 2, 0.0, 0.7]), np.array([pi / 2, 0.0, 0.701]))
    np.testing.assert_allclose(error, [0.0, 1e-3, 0.0], atol=1e-6)


def test_static_stability_and_hinge_moment_in_a_cross_wind() -> None:
    """The nose turns into a wind from below and from the right; the hinge moment of a lifted fin is restoring."""
    updraft, rocket = moments(np.zeros(4), np.array([0.0, 0.0, -20.0]))
    assert rocket["velocities/w-aero-fps"] > 0.0
    assert updraft[1] < 0.0
    assert abs(updraft[0]) + abs(updraft[2]) < 1e-3 * abs(updraft[1])
    assert np.sign(rocket.state().hinge_moments).tolist() == (-np.sign(np.cos(AZIMUTHS))).tolist()
    right, rocket = moments(np.zeros(4), np.array([0.0, -20.0, 0.0]))  # blowing west, flying north
    assert rocket["velocities/v-aero-fps"] > 0.0
    assert right[2] > 0.0
    assert right[2] == pytest.approx(-updraft[1], rel=1e-3)  # the fins are symmetric in both planes
    # The static margin, moment over normal force, is 2 to 4 calibres for such a rocket.
    normal = abs(rocket["forces/fby-total-lbs"]) * POUND_FORCE
    assert 2.0 < right[2] / normal / 0.3 < 4.0


def test_roll_damping_agrees_with_strip_theory() -> None:
    """L_p of four fins at 0.275 m."""
    rocket = Rocket(1e-3, NORTH)
    for _ in range(200):
        rocket.advance(np.full(4, radians(-1.0)), STILL)
    before = rocket.state()
    for _ in range(100):
        after = rocket.advance(np.zeros(4), STILL)
    rate = 4.0 * before.dynamic_pressure * AREA * rocket["aero/fin/slope"] * LEVER**2 / before.speed / 5.0
    assert before.body_rates[0] > 1.0
    # 3 %: speed and pressure fall by 1 % in 0.1 s, and there is cross-flow lift at incidences of a degree.
    assert np.log(before.body_rates[0] / after.body_rates[0]) == pytest.approx(0.1 * rate, rel=0.03)


def test_energy_balance_of_straight_flight() -> None:
    """Speed is the integral of the acceleration, and drag reduces the energy.

    0.2 % and 0.3 % are for the earth's rotation, and for gravity at one altitude.
    """
    rocket = Rocket(1e-3)
    first = state = rocket.state()
    work = drag = 0.0
    for _ in range(1000):
        # The path is the body's axis at these incidences.
        before, state = state, rocket.advance(np.zeros(4), STILL)
        work += 0.5 * (before.acceleration[0] + state.acceleration[0]) * 0.5 * (before.speed + state.speed) * 1e-3
        drag += rocket["accelerations/a-pilot-x-ft_sec2"] * FOOT * state.speed * 1e-3
        assert state.incidence < radians(0.2)
        assert np.max(np.abs(state.body_rates)) < radians(2.0)
    kinetic = 0.5 * (state.speed**2 - first.speed**2)
    assert kinetic == pytest.approx(work, rel=2e-3)
    assert drag < 0.0
    assert kinetic + 9.80 * (state.altitude - first.altitude) == pytest.approx(drag, rel=3e-3)


def test_acceleration_at_the_hinges_agrees_with_jsbsim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is computed from the acceleration of the centre of gravity, the rates and their derivatives.

    JSBSim uses the accelerations of the previous step. 1e-4 m/s2: it adds the earth's rotation to the rates.
    """
    def flight() -> list[State]:
        rocket = Rocket(1e-3)
        return [rocket.advance(np.radians([5, -3, 6, -2]) * np.sin(0.05 * k), STILL) for k in range(300)]

    of_centre = flight()
    shutil.copytree(Path(vehicle.__file__).parent / "aircraft", tmp_path / "aircraft")
    path = tmp_path / "aircraft/finned_rocket/finned_rocket.xml"
    text = path.read_text(encoding="utf-8")
    assert '"EYEPOINT" unit="M"> <x> 2.05' in text
    path.write_text(text.replace('"EYEPOINT" unit="M"> <x> 2.05', '"EYEPOINT" unit="M"> <x> 3.77'), encoding="utf-8")
    monkeypatch.setattr(vehicle, "__file__", str(tmp_path / "vehicle.py"))
    at_hinges, station = flight(), np.array([STATION, 0.0, 0.0])
    largest = 0.0
    for before, now, there in zip(of_centre, of_centre[1:], at_hinges[1:]):
        rotation = (np.cross(before.angular_acceleration, station)
                    + np.cross(now.body_rates, np.cross(now.body_rates, station)))
        np.testing.assert_allclose(now.acceleration + rotation, there.acceleration, atol=1e-4)
        # The mean derivative over a step differs by the derivative's change.
        slope = (now.body_rates - before.body_rates) / 1e-3
        assert np.abs(slope - now.angular_acceleration).max() < 15.0
        largest = max(largest, float(np.abs(now.angular_acceleration).max()))
    assert largest > 100.0


def test_tables_of_lift_slope_and_centre_of_pressure_agree_with_their_formulas() -> None:
    path = Path(vehicle.__file__).parent / "aircraft/finned_rocket/finned_rocket.xml"
    functions = {f.get("name"): f for f in ElementTree.parse(path).getroot().iter("function")}
    ratio = (2 * 0.28) ** 2 / (2 * AREA)

    def table(name: str) -> list[list[float]]:
        found = functions[name].find(".//tableData")
        assert found is not None
        assert found.text is not None
        return [[float(n) for n in row.split()] for row in found.text.split("\n") if row.strip()]

    compared = 0
    for mach, slope in table("aero/fin/slope"):
        if mach >= 1.35:
            beta = sqrt(mach**2 - 1.0)
            assert slope == pytest.approx(4.0 / beta * (1.0 - 1.0 / (2.0 * beta * ratio)), abs=0.03)
            compared += 1
    for mach, place in table("aero/fin/cp-behind-hinge-ft"):
        if mach >= 1.35:
            span = sqrt(mach**2 - 1.0) * ratio
            assert place == pytest.approx((span - 2.0 / 3.0) / (2.0 * span - 1.0), abs=0.002)
            compared += 1
    assert compared == 14


def test_azimuths_of_the_fmu_are_those_of_the_file() -> None:
    """In the file structural z points up."""
    path = Path(vehicle.__file__).parent / "aircraft/finned_rocket/finned_rocket.xml"
    for k, azimuth in zip(FINS, AZIMUTHS, strict=True):
        force = next(f for f in ElementTree.parse(path).getroot().iter("force") if f.get("name") == f"fin{k}")
        y, z = (float(force.findtext(f"location/{n}", "")) for n in "yz")
        assert degrees(np.arctan2(-z, y)) % 360.0 == pytest.approx(degrees(azimuth))
