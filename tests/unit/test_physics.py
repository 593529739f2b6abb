"""The equations against independent derivations and closed forms."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, hypot, radians, sin, tan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from emcas_fmu.actuators import NAMES, capabilities, get
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import clutched_screw, drive, friction, kinematics, loads, mechanics, stick
from emcas_fmu.steppers.electrical import Motor, electrical_mode
from emcas_fmu.steppers.rigid import friction_speed
from tests.default_actuator import namespace

from ..simulation import acting, simulate


def _rotation(axis: str, angle: float) -> np.ndarray:
    """Return the matrix that converts coordinates to a frame rotated by an angle [rad] about an axis."""
    c, s = cos(angle), sin(angle)
    return {"x": np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), "y": np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]),
            "z": np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])}[axis]


@pytest.mark.parametrize("seed", range(100))
def test_equation_of_motion_in_the_fin_coordinate(values: Mapping[str, Any], seed: int) -> None:
    """The fin's acceleration from the thesis's (2.15)-(2.17), against the equations in the motor's coordinate."""
    random = np.random.default_rng(seed)
    case = {**values, "friction.fin_viscous": random.uniform(0, 2), "friction.fin_coulomb": random.uniform(0, 20),
            "kinematics.initial_angle": random.uniform(-0.3, 0.3)}
    fin, rate, current = random.uniform(-0.4, 0.4), random.uniform(-6, 6), random.uniform(-60, 60)
    aero, f_x = random.uniform(-150, 150), random.uniform(-100, 100)
    d, lead = case["kinematics.moment_arm"], case["screw.lead"]
    phi = fin + case["kinematics.initial_angle"]
    ratio = d / lead / cos(phi) ** 2
    slope = 2 * ratio * tan(phi)
    j_t = case["inertia.motor"] + case["inertia.screw"] + case["mass.nut"] * lead**2
    j_ft = case["inertia.fin"] + case["inertia.shaft"] + case["inertia.fork"]
    side = "positive" if rate > 0 else "negative"
    coulomb = sum(case[f"friction.coulomb.{side}[{k}]"] * (degrees(fin) / 20) ** k for k in range(7))
    viscous = case[f"friction.viscous.{side}"]
    moment = (ratio * case["motor.torque_constant"] * current - ratio**2 * viscous * rate
              - j_t * ratio * slope * rate**2 - case["friction.fin_viscous"] * rate + aero
              + lead * ratio * case["mass.nut"] * f_x
              - np.sign(rate) * (ratio * coulomb + case["friction.fin_coulomb"]))
    no_masses = {**case, **{f"mass.{part}": 0.0 for part in ("fin", "shaft", "fork")}}

    p = namespace(no_masses)
    motor, speed = kinematics.motor_angle(FLOATS, p, fin), ratio * rate
    alpha = random.uniform(-500, 500)  # of the vehicle's roll, which accelerates the rotor, too
    moment -= (case["inertia.motor"] + case["inertia.screw"]) * ratio * alpha
    expected = moment / (j_ft + j_t * ratio**2)
    m = mechanics.coefficients(FLOATS, p, motor, loads.NONE.replace(aero_torque=aero, f_x=f_x, alpha_x=alpha))
    torque = (drive.torque(p, current) + m.load - np.sign(rate) * mechanics.breakaway(FLOATS, p, m, speed)
              - mechanics.damping(FLOATS, p, m, speed) * speed + m.centrifugal * speed**2)
    acceleration = torque / m.inertia
    actual = (acceleration - slope * rate**2) / ratio
    # Rounding of a sum in which terms of 1e4 rad/s2 cancel: 1e-16 * 1e4 * a few operations.
    assert actual == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_loads_against_rotation_matrices(values: Mapping[str, Any], seed: int) -> None:
    """The thesis's equations (2.27)-(2.45) and the vehicle's rotation, with complete matrices and cross products.

    Two masses at the ends of a chord through the hinge replace the inertia about the hinge. Each has the acceleration
    of its position, including the Coriolis acceleration of its motion with the fin.
    """
    random = np.random.default_rng(seed)
    case = {**values, "loads.gravity": True, "mounting.azimuth": random.uniform(-3, 3),
            "mounting.station": random.uniform(-3, 3)}
    centers = {part: random.uniform(-0.1, 0.1, 3) for part in ("fin", "shaft", "fork")}
    for part, center in centers.items():
        case[f"center_of_mass.{part}.x"], case[f"center_of_mass.{part}.z"] = center[0], center[2]
    p = namespace(case)
    roll, pitch, yaw, fin = random.uniform(-1.5, 1.5, 4) * np.array([2, 1, 2, 0.25])
    acceleration = random.uniform(-100, 100, 3)
    gravity = _rotation("x", roll) @ _rotation("y", pitch) @ _rotation("z", yaw) @ np.array([0, 0, 9.80665])
    rate, alpha = random.uniform(-20, 20, 3), random.uniform(-100, 100, 3)

    def relative(point: np.ndarray, rate: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """Return the acceleration of a point [m] of a rotating body relative to the body's origin."""
        return np.cross(alpha, point) + np.cross(rate, np.cross(rate, point))

    to_fin = _rotation("x", case["mounting.azimuth"])
    hinge = acceleration + relative(np.array([case["mounting.station"], 0.0, 0.0]), rate, alpha)
    force = to_fin @ (gravity - hinge)
    turn = _rotation("y", fin).T  # a right-handed rotation of the body, not of the frame
    moment = sum(np.cross(turn @ c, case[f"mass.{part}"] * force)[1] for part, c in centers.items())
    inertia = case["inertia.fin"] + case["inertia.shaft"] + case["inertia.fork"]
    span, fin_rate = 0.3, random.uniform(-5, 5)
    for end in (span, -span):
        point = turn @ np.array([end, 0.0, 0.0])
        velocity = np.cross([0.0, fin_rate, 0.0], point)
        total = relative(point, to_fin @ rate, to_fin @ alpha) + 2.0 * np.cross(to_fin @ rate, velocity)
        moment -= np.cross(point, 0.5 * inertia / span**2 * total)[1]
    u = loads.motion_loads(FLOATS, p, *acceleration.tolist(), float(roll), float(pitch), 0.0, *rate.tolist(),
                           *alpha.tolist())
    tangent = kinematics.lever_tangent(FLOATS, p, kinematics.motor_angle(FLOATS, p, float(fin)))
    # Rounding of sums of a few terms of order 1000.
    assert u.f_x == pytest.approx(force[0], abs=1e-12 * 1000)
    assert loads.hinge_moment(FLOATS, p, tangent, u) == pytest.approx(moment, abs=1e-12 * 1000)
    assert loads.hinge_moment_at(FLOATS, p, float(fin), u) == pytest.approx(moment, abs=1e-12 * 1000)
    assert loads.nut_force(FLOATS, p, u) == pytest.approx(case["mass.nut"] * force[0], abs=1e-12 * 1000)
    assert mechanics.rotor_torque(p, u) == pytest.approx(-(case["inertia.motor"] + case["inertia.screw"]) * alpha[0])


@pytest.mark.parametrize(("rate", "moment"), [(60.0, 69.0), (20.0, 7.7), (-60.0, 69.0)])
def test_steady_roll_turns_the_fin_away_from_zero(values: Mapping[str, Any], rate: float, moment: float) -> None:
    """The moment J p^2 sin d cos d of the default actuator; it is rounded here, by up to 2 %."""
    p, still = namespace(values), (0.0, 0.0, 0.0)
    u = loads.motion_loads(FLOATS, p, *still, *still, rate, 0.0, 0.0, *still)
    for side in (1.0, -1.0):
        assert loads.hinge_moment_at(FLOATS, p, side * radians(20), u) == pytest.approx(side * moment, rel=0.02)


def test_rotor_resists_roll_acceleration(values: Mapping[str, Any]) -> None:
    """The moment (J_motor + J_screw) R alpha of the default actuator at 500 rad/s2 is 9 N.m, within 2 %."""
    p = namespace(values)
    m = mechanics.coefficients(FLOATS, p, 0.0, loads.NONE.replace(alpha_x=500.0))
    assert m.load * m.ratio == pytest.approx(-9.0, rel=0.02)
    assert m.rotor == m.load


def test_signs_of_gravity_and_acceleration(values: Mapping[str, Any]) -> None:
    """Nose up, gravity pulls the nut back; a centre of mass ahead of the hinge gives a negative moment."""
    p = namespace({**values, "loads.gravity": True, "kinematics.initial_angle": 0.0, "center_of_mass.fin.x": 0.1,
                   "center_of_mass.fork.z": 0.0})
    still = (0.0, 0.0, 0.0)
    nose_up = loads.motion_loads(FLOATS, p, *still, 0.0, radians(30), 0.0, *still, *still)
    assert nose_up.f_x < 0 < nose_up.f_z
    level = loads.level(FLOATS, p)
    assert loads.hinge_moment(FLOATS, p, 0.0, level) == pytest.approx(-0.1 * values["mass.fin"] * 9.80665)
    thrust = loads.motion_loads(FLOATS, p, 50.0, 0.0, 0.0, *still, *still, *still)
    assert loads.nut_force(FLOATS, p, thrust) == pytest.approx(-50.0 * values["mass.nut"])


@pytest.mark.parametrize(("temperature", "coulomb", "viscous"), [
    (24.0, 1.0, 1.0), (-6.0, 1.25, 1.6), (9.0, 1.125, 1.3), (-40.0, 1.6, 2.7), (-23.0, 1.425, 2.15), (-90.0, 1.6, 2.7),
    (37.0, 0.95, 0.835), (71.0, 0.85, 0.48), (150.0, 0.85, 0.48)])
def test_friction_follows_temperature(values: Mapping[str, Any], temperature: float, coulomb: float,
                                      viscous: float) -> None:
    """At the table's points, halfway between them, and constant beyond them; at 24 degC to the bit."""
    unscaled = namespace({**values, **{f"friction.table.{kind}[{i}]": 1.0 for kind in ("coulomb", "viscous")
                                       for i in range(5)}})
    p = namespace({**values, "friction.temperature": temperature})
    rounding = 0.0 if temperature == 24.0 else 1e-12
    for direction in (1.0, -1.0):
        reference = friction.coulomb(FLOATS, unscaled, direction, 0.1)
        assert friction.coulomb(FLOATS, p, direction, 0.1) == pytest.approx(coulomb * reference, rel=rounding, abs=0.0)
        reference = friction.viscous(FLOATS, unscaled, direction)
        assert friction.viscous(FLOATS, p, direction) == pytest.approx(viscous * reference, rel=rounding, abs=0.0)


def test_current_rises_as_an_rl_circuit(values: Mapping[str, Any]) -> None:
    """Locked rotor at the voltage limit: i = V/R (1 - exp(-t R/L))."""
    case = {**values, "friction.fin_coulomb": 1e4, "drive.transport_delay": 0.0, "drive.current_offset": 0.0,
            "encoder.enabled": False}
    result = simulate(case, 0.7e-3, step=0.1e-3, fin_command=radians(20))
    tau = case["motor.inductance"] / case["motor.resistance"]
    expected = 39.0 / case["motor.resistance"] * (1 - np.exp(-result["time"] / tau))
    assert result["motor_voltage"][-1] == 39.0
    # The actuator uses the closed form, too: rounding.
    np.testing.assert_allclose(result["motor_current"], expected, rtol=1e-12)
    assert set(result["fin_angle"]) == {0.0}


def test_viscous_friction_limits_the_rate_of_a_driven_fin(values: Mapping[str, Any]) -> None:
    """The drive is disabled; at constant speed viscous friction equals the hinge moment."""
    case = {**values, "friction.fin_viscous": 50.0, "fin.stop_angle": radians(60), "fin.start_angle": radians(-40),
            "kinematics.initial_angle": 0.0, **{f"friction.coulomb.positive[{k}]": 0.0 for k in range(7)}}
    result = simulate(case, 0.4, aero_torque=30.0, enable=False)
    ratio = kinematics.reduction_ratio(FLOATS, namespace(case), tan(result["fin_angle"][-1]))
    damping = 50.0 + ratio**2 * case["friction.viscous.positive"]
    # The speed is not quite constant: the ratio changes by 1 % within the time constant M/b, 25 ms.
    assert result["fin_rate"][-1] == pytest.approx(30.0 / damping, rel=0.03)


def test_disabled_drive_has_no_current(values: Mapping[str, Any]) -> None:
    result = simulate(values, 0.2, fin_command=0.3, aero_torque=40.0, enable=lambda t: t < 0.05)
    off = result["time"] > 0.0505
    assert np.all(result["motor_current"][off] == 0.0)
    assert np.all(result["supply_power"][off] == 0.0)
    assert np.any(result["motor_current"][~off] != 0.0)
    np.testing.assert_allclose(result["motor_voltage"][off], 0.11 * result["motor_speed"][off], rtol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
def test_voltage_demand_stays_at_its_limit_while_it_grows(values: Mapping[str, Any], side: float, share: float,
                                                          stays: bool) -> None:
    """It grows if K_i (i_ref - i) - K_p di/dt > 0; `share` is the ratio of the two terms."""
    i_ref, current, supply = 30.0, 24.0, 39.0
    case = {**values, "drive.kp": 5.0, "motor.resistance": 0.25, "motor.inductance": 6e-4, "drive.current_limit": 60.0,
            "motor.back_emf_constant": 0.11}
    speed = 240.0
    rise = (supply - 0.25 * current - 0.11 * speed) / 6e-4  # 11 kA/s
    case["drive.ki"] = share * 5.0 * rise / (i_ref - current)
    p = namespace(case)
    plant = Motor(0.0, side * speed, side * current, side * (supply - 5.0 * (i_ref - current)))
    reference = (side * i_ref - p.drive.current_offset) / p.drive.current_gain
    mode = electrical_mode(FLOATS, p, plant, acting(reference, supply=supply), 1e-4)
    assert mode.at_limit == 1.0
    assert (mode.stays, mode.side) == (float(stays), side * stays)


def test_inductive_voltage_reduces_the_voltage_limit(values: Mapping[str, Any]) -> None:
    """With 4 pole pairs, 200 rad/s, 0.6 mH and 50 A it is 24 V; sqrt(26^2 - 24^2) V = 10 V remain of 26 V."""
    p = namespace({**values, "motor.pole_pairs": 4, "motor.inductance": 6e-4})
    assert drive.voltage_limit(FLOATS, p, 26.0, -200.0, 50.0) == pytest.approx(10.0, rel=1e-14)
    assert drive.voltage_limit(FLOATS, p, 24.0 - 1e-9, 200.0, -50.0) == 0.0
    none = namespace({**values, "motor.pole_pairs": 0})
    assert drive.voltage_limit(FLOATS, none, 26.0, -200.0, 50.0) == 26.0


@pytest.mark.parametrize("pairs", [0, 4, 9])
@pytest.mark.parametrize("current", [0.0, 20.0, 60.0])
def test_current_at_the_knee_needs_the_whole_supply(values: Mapping[str, Any], pairs: int, current: float) -> None:
    p = namespace({**values, "motor.pole_pairs": pairs})
    speed = drive.knee_speed(FLOATS, p, 39.0, current)
    inductive = pairs * speed * p.motor.inductance * current
    # pytest.approx permits 1e-6, the root of rounded squares of 1e3 V^2 needs less.
    assert hypot(p.motor.resistance * current + p.motor.back_emf_constant * speed, inductive) == pytest.approx(39.0)
    assert drive.steady_current(FLOATS, p, 39.0, speed) == pytest.approx(current, abs=1e-9)
    assert drive.knee_speed(FLOATS, p, 0.9 * p.motor.resistance * 60.0, 60.0) == 0.0


def test_current_error_is_the_limited_reference_minus_the_current(values: Mapping[str, Any]) -> None:
    """With a locked fin and no drive integral, kp (i_ref - i) = R i."""
    locked = {**values, "friction.fin_coulomb": 1e4, "drive.ki": 0.0, "controller.position.ki": 0.0,
            "compensation.gain": 0.0, "drive.current_offset": 0.0}
    run = simulate(locked, 0.2, fin_command=0.02, enable=lambda t: t < 0.15)
    i_ref = locked["drive.current_gain"] * run["drive_reference"][100]
    assert 1.0 < i_ref < locked["drive.current_limit"]
    resistance, kp = locked["motor.resistance"], locked["drive.kp"]
    assert run["current_error"][100] == pytest.approx(i_ref * resistance / (resistance + kp), rel=1e-9)
    assert run["motor_current"][100] + run["current_error"][100] == pytest.approx(i_ref, rel=1e-12)
    assert np.all(run["current_error"][152:] == 0.0)
    # A reference above the current limit is replaced by the limit.
    run = simulate(locked, 0.1, fin_command=0.3)
    total = run["motor_current"][-1] + run["current_error"][-1]
    assert total == pytest.approx(locked["drive.current_limit"], rel=1e-12)


def test_actuators_with_a_current_loop_have_a_current_error() -> None:
    for actuator in map(get, NAMES):
        has_error = "current_error" in {v.name for v in actuator.outputs}
        assert has_error == (capabilities.CURRENT_LOOP in actuator.provides), actuator.name


@given(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-0.6, 0.6), st.floats(-9.0, 9.0), st.booleans(), st.booleans())
def test_landed_position_is_between_the_stops_and_at_rest_at_a_stop(direction: float, position: float, speed: float,
                                                                    halted: bool, struck: bool) -> None:
    slide = stick.Slide(direction, 1.0, -1.0)
    landed, rate = stick.landed(FLOATS, slide, 0.5, (0.4, 1.0), (position, speed), halted, struck and direction != 0.0)
    assert abs(landed) <= 0.5
    if direction and (struck or direction * position >= 0.5):
        assert (landed, rate) == (direction * 0.5, 0.0)
    elif direction and halted:
        assert (landed, rate) == (min(max(position, -0.5), 0.5), 0.0)
    else:
        assert rate == speed


@pytest.mark.parametrize("damping", [0.3, 1.0, 1.6])
def test_second_order_actuator_follows_its_equation_exactly(damping: float) -> None:
    w, h, angle, rate, command = 90.0, 7e-3, 0.02, -0.4, 0.05
    actuator, values = get("second-order"), load_parameters(model="second-order").values
    p = actuator.namespace({**values, "second_order.natural_frequency": w, "second_order.damping": damping})
    u: Any = Record(enabled=True, reference=command)
    at_end, used = actuator.step(FLOATS, p, Record(fin_angle=angle, fin_rate=rate), u, h)
    error, speed = expm(np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]]) * h) @ (angle - command, rate)
    assert used == h
    # For two equal roots, the actuator uses roots that differ by sqrt(1e-9) of their size: (w h)^2 1e-9/6 = 7e-11.
    assert at_end == pytest.approx({"fin_angle": command + error, "fin_rate": speed}, rel=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_second_order_actuator_rests_at_its_stop_until_it_turns_back(side: float) -> None:
    actuator, values = get("second-order"), load_parameters(model="second-order").values
    p, stop = actuator.namespace(values), values["fin.stop_angle"]

    def stepped(begin: float, rate: float, reference: float) -> Any:
        u: Any = Record(enabled=True, reference=side * reference)
        return actuator.step(FLOATS, p, Record(fin_angle=side * begin, fin_rate=side * rate), u, 1e-3)[0]

    out, back = stepped(stop - 1e-3, 3.0, stop), stepped(stop + 1e-3, -0.1, 0.0)
    assert out == {"fin_angle": side * stop, "fin_rate": 0.0}
    assert side * back["fin_rate"] < 0.0


@pytest.mark.parametrize("felt", [1.0, -0.5])
def test_load_margin_of_a_clutched_screw_has_the_sign_of_its_mode(felt: float) -> None:
    """The margin becomes negative when the load no longer fits the efficiency, forward or backward, of the mode."""
    for load in (3.0, -2.0):
        train = clutched_screw.Train(rotor=1e-4, screw=2e-4, behind_inertia=0.0, rotor_torque=1.0, screw_torque=0.0,
                                     dry=0.1, capacity=2.0, sliding=(0.2, 0.2), load=(load, load), behind=0.0, high=1.0,
                                     low=-1.0, forward=1.0, backward=-0.5)
        motion = clutched_screw.Directions(screw=1.0, rotor=1.0, clutch=1.0, felt=felt)
        margins = clutched_screw.margins(FLOATS, train, motion, 5.0, 9.0)
        assert margins["load"] == (load if felt == train.forward else -load)


@pytest.mark.parametrize(("ratio", "expected"), [(1.0, 5.0), (1.1, 7.0), (3.75, 7.0)])
def test_falling_friction_of_a_worm_acts_at_the_speed_of_mid_step(ratio: float, expected: float) -> None:
    """With the speed at its begin the step would be of first order. Constant friction needs no prediction."""
    values = {**load_parameters(model="worm-gear").values, "worm.static_ratio": ratio}
    assert friction_speed(FLOATS, get("worm-gear").namespace(values), Record(motor_speed=5.0), lambda: 7.0) == expected
