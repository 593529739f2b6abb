"""The equations against independent derivations at random states."""

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
from emcas_fmu.steppers.electrical import Plant, electrical_mode
from emcas_fmu.steppers.rigid import friction_speed
from tests.default_actuator import namespace

from ..simulation import acting, simulate

RANDOM = np.random.default_rng(20)


def _rotation(axis: str, angle: float) -> np.ndarray:
    """Turns coordinates into a frame turned by `angle` about `axis`."""
    c, s = cos(angle), sin(angle)
    return {"x": np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), "y": np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]),
            "z": np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])}[axis]


@pytest.mark.parametrize("seed", range(100))
def test_equation_of_motion_in_the_fin_coordinate(values: Mapping[str, Any], seed: int) -> None:
    """The fin's acceleration from (2.15)-(2.17) as they stand, against the motor-coordinate form."""
    random = np.random.default_rng(seed)
    case = {**values, "friction.fin_viscous": random.uniform(0, 2), "friction.fin_coulomb": random.uniform(0, 20),
            "kinematics.initial_angle": random.uniform(-0.3, 0.3)}
    p = namespace(case)
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
    alpha = random.uniform(-500, 500)  # what turns with the vehicle takes its torque
    moment -= (case["inertia.motor"] + case["inertia.screw"]) * ratio * alpha
    expected = moment / (j_ft + j_t * ratio**2)
    m = mechanics.coefficients(FLOATS, p, motor, loads.NONE.replace(aero_torque=aero, f_x=f_x, alpha_x=alpha))
    torque = (drive.torque(p, current) + m.load - np.sign(rate) * mechanics.breakaway(FLOATS, p, m, speed)
              - mechanics.damping(FLOATS, p, m, speed) * speed + m.centrifugal * speed**2)
    acceleration = torque / m.inertia
    actual = (acceleration - slope * rate**2) / ratio
    # Terms of 1e4 rad/s2 cancel to the sum: rounding 1e-16 * 1e4 * a few operations.
    assert actual == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_loads_against_rotation_matrices(values: Mapping[str, Any], seed: int) -> None:
    """(2.27)-(2.45) and the vehicle's rotation with whole matrices and cross products.

    What turns about the hinge is two masses at the ends of a chord through it; every mass feels the acceleration of
    its place, that of its motion with the fin (Coriolis) too.
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
    rate, faster = random.uniform(-20, 20, 3), random.uniform(-100, 100, 3)

    def relative(place: np.ndarray, rate: np.ndarray, faster: np.ndarray) -> np.ndarray:
        """Return the acceleration of a place [m] that moves with a turning body, from that of its origin."""
        return np.cross(faster, place) + np.cross(rate, np.cross(rate, place))

    to_fin = _rotation("x", case["mounting.azimuth"])
    hinge = acceleration + relative(np.array([case["mounting.station"], 0.0, 0.0]), rate, faster)
    force = to_fin @ (gravity - hinge)
    turn = _rotation("y", fin).T  # a right-handed turn of the body, not of the frame
    moment = sum(np.cross(turn @ c, case[f"mass.{part}"] * force)[1] for part, c in centers.items())
    inertia = case["inertia.fin"] + case["inertia.shaft"] + case["inertia.fork"]
    span, sweeping = 0.3, random.uniform(-5, 5)
    for end in (span, -span):
        at = turn @ np.array([end, 0.0, 0.0])
        moving = np.cross([0.0, sweeping, 0.0], at)
        felt = relative(at, to_fin @ rate, to_fin @ faster) + 2.0 * np.cross(to_fin @ rate, moving)
        moment -= np.cross(at, 0.5 * inertia / span**2 * felt)[1]
    made = loads.motion_loads(FLOATS, p, *acceleration.tolist(), float(roll), float(pitch), 0.0, *rate.tolist(),
                              *faster.tolist())
    tangent = kinematics.lever_tangent(FLOATS, p, kinematics.motor_angle(FLOATS, p, float(fin)))
    # Sums of a few terms of order 1000: rounding.
    assert made.f_x == pytest.approx(force[0], abs=1e-12 * 1000)
    assert loads.hinge_moment(FLOATS, p, tangent, made) == pytest.approx(moment, abs=1e-12 * 1000)
    assert loads.hinge_moment_at(FLOATS, p, float(fin), made) == pytest.approx(moment, abs=1e-12 * 1000)
    assert loads.nut_force(FLOATS, p, made) == pytest.approx(case["mass.nut"] * force[0], abs=1e-12 * 1000)
    assert mechanics.rotor_torque(p, made) == pytest.approx(
        -(case["inertia.motor"] + case["inertia.screw"]) * faster[0])


@pytest.mark.parametrize(("rate", "moment"), [(60.0, 69.0), (20.0, 7.7), (-60.0, 69.0)])
def test_a_steady_roll_turns_the_fin_away_from_zero(values: Mapping[str, Any], rate: float, moment: float) -> None:
    """J p^2 sin d cos d of the default unit, to the digits that are written here: 2 %."""
    p, still = namespace(values), (0.0, 0.0, 0.0)
    made = loads.motion_loads(FLOATS, p, *still, *still, rate, 0.0, 0.0, *still)
    for side in (1.0, -1.0):
        assert loads.hinge_moment_at(FLOATS, p, side * radians(20), made) == pytest.approx(side * moment, rel=0.02)


def test_the_rotor_resists_the_roll_s_acceleration(values: Mapping[str, Any]) -> None:
    """(J_motor + J_screw) R of the default unit at 500 rad/s2 is 9 N.m about the hinge, 2 % of what is written here."""
    p = namespace(values)
    m = mechanics.coefficients(FLOATS, p, 0.0, loads.NONE.replace(alpha_x=500.0))
    assert m.load * m.ratio == pytest.approx(-9.0, rel=0.02)
    assert m.rotor == m.load


def test_gravity_signs(values: Mapping[str, Any]) -> None:
    """Nose up pulls the nut back; a centre of mass ahead of the hinge sinks: a turn about -y."""
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
    """At the points of the table, half way between them, and held beyond; at 24 degC to the bit."""
    plain = namespace({**values, **{f"friction.table.{kind}[{i}]": 1.0 for kind in ("coulomb", "viscous")
                                    for i in range(5)}})
    p = namespace({**values, "friction.temperature": temperature})
    rounding = 0.0 if temperature == 24.0 else 1e-12
    for direction in (1.0, -1.0):
        reference = friction.coulomb(FLOATS, plain, direction, 0.1)
        assert friction.coulomb(FLOATS, p, direction, 0.1) == pytest.approx(coulomb * reference, rel=rounding, abs=0.0)
        reference = friction.viscous(FLOATS, plain, direction)
        assert friction.viscous(FLOATS, p, direction) == pytest.approx(viscous * reference, rel=rounding, abs=0.0)


def test_current_rises_as_an_rl_circuit(values: Mapping[str, Any]) -> None:
    """Stuck rotor under full voltage: i = V/R (1 - exp(-t R/L)) while clipped, exactly."""
    case = {**values, "friction.fin_coulomb": 1e4, "drive.transport_delay": 0.0, "drive.current_offset": 0.0,
            "encoder.enabled": False}
    result = simulate(case, 0.7e-3, step=0.1e-3, fin_command=radians(20))
    tau = case["motor.inductance"] / case["motor.resistance"]
    expected = 39.0 / case["motor.resistance"] * (1 - np.exp(-result["time"] / tau))
    assert result["motor_voltage"][-1] == 39.0
    # A closed form on both sides: rounding.
    np.testing.assert_allclose(result["motor_current"], expected, rtol=1e-12)
    assert set(result["fin_angle"]) == {0.0}


def test_coasting_speed_decays_as_viscous_friction_says(values: Mapping[str, Any]) -> None:
    """Held by the bus at no command, driven by a constant hinge moment: steady speed = moment balance."""
    case = {**values, "friction.fin_viscous": 50.0, "fin.stop_angle": radians(60), "fin.start_angle": radians(-40),
            "kinematics.initial_angle": 0.0, **{f"friction.coulomb.positive[{k}]": 0.0 for k in range(7)}}
    result = simulate(case, 0.4, aero_torque=30.0, enable=False)
    p = namespace(case)
    late = -1
    ratio = kinematics.reduction_ratio(FLOATS, p, tan(result["fin_angle"][late]))
    damping = 50.0 + ratio**2 * case["friction.viscous.positive"]
    # Quasi-steady: the ratio changes by 1 % in the time constant M/b = 25 ms, so does the balance.
    assert result["fin_rate"][late] == pytest.approx(30.0 / damping, rel=0.03)


def test_disabled_drive_is_open(values: Mapping[str, Any]) -> None:
    result = simulate(values, 0.2, fin_command=0.3, aero_torque=40.0, enable=lambda t: t < 0.05)
    off = result["time"] > 0.0505
    assert np.all(result["motor_current"][off] == 0.0)
    assert np.all(result["supply_power"][off] == 0.0)
    assert np.any(result["motor_current"][~off] != 0.0)
    np.testing.assert_allclose(result["motor_voltage"][off], 0.11 * result["motor_speed"][off], rtol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
def test_the_demand_slides_along_its_limit_where_it_grows(values: Mapping[str, Any], side: float, share: float,
                                                          stays: bool) -> None:
    """At the limit, with a current that rises, d(demand)/dt = K_i (i_ref - i) - K_p di/dt of the free demand decides.

    `share` is that of the first of its terms in the second.
    """
    i_ref, current, supply = 30.0, 24.0, 39.0
    case = {**values, "drive.kp": 5.0, "motor.resistance": 0.25, "motor.inductance": 6e-4, "drive.current_limit": 60.0,
            "motor.back_emf_constant": 0.11}
    speed = 240.0
    rise = (supply - 0.25 * current - 0.11 * speed) / 6e-4  # 11 kA/s
    case["drive.ki"] = share * 5.0 * rise / (i_ref - current)
    p = namespace(case)
    plant = Plant(0.0, side * speed, side * current, side * (supply - 5.0 * (i_ref - current)))
    reference = (side * i_ref - p.drive.current_offset) / p.drive.current_gain
    mode = electrical_mode(FLOATS, p, plant, acting(reference, supply=supply), 1e-4)
    assert mode.at_limit == 1.0
    assert (mode.stays, mode.side) == (float(stays), side * stays)


def test_the_inductive_voltage_leaves_the_rest_of_the_supply(values: Mapping[str, Any]) -> None:
    """Phasors by hand: 4 pole pairs, 200 rad/s, 0.6 mH and 50 A make 24 V across; of 26 V they leave 10 V."""
    p = namespace({**values, "motor.pole_pairs": 4, "motor.inductance": 6e-4})
    assert drive.voltage_limit(FLOATS, p, 26.0, -200.0, 50.0) == pytest.approx(10.0, rel=1e-14)
    assert drive.voltage_limit(FLOATS, p, 24.0 - 1e-9, 200.0, -50.0) == 0.0
    none = namespace({**values, "motor.pole_pairs": 0})
    assert drive.voltage_limit(FLOATS, none, 26.0, -200.0, 50.0) == 26.0


@pytest.mark.parametrize("pairs", [0, 4, 9])
@pytest.mark.parametrize("current", [0.0, 20.0, 60.0])
def test_the_steady_current_and_the_knee_take_the_whole_supply(values: Mapping[str, Any], pairs: int, current: float
                                                               ) -> None:
    p = namespace({**values, "motor.pole_pairs": pairs})
    speed = drive.knee_speed(FLOATS, p, 39.0, current)
    across = pairs * speed * p.motor.inductance * current
    # A root of rounded squares of some 1e3 V^2.
    assert hypot(p.motor.resistance * current + p.motor.back_emf_constant * speed, across) == pytest.approx(39.0)
    assert drive.steady_current(FLOATS, p, 39.0, speed) == pytest.approx(current, abs=1e-9)
    assert drive.knee_speed(FLOATS, p, 0.9 * p.motor.resistance * 60.0, 60.0) == 0.0


def test_the_current_error_is_what_the_reference_within_its_limit_lacks(values: Mapping[str, Any]) -> None:
    """A motor held by a locked fin: steady, kp (i_ref - i) + xi = R i, and the supply's 39 V cap the rest."""
    held = {**values, "friction.fin_coulomb": 1e4, "drive.ki": 0.0, "controller.position.ki": 0.0,
            "compensation.gain": 0.0, "drive.current_offset": 0.0}
    run = simulate(held, 0.2, fin_command=0.02, enable=lambda t: t < 0.15)
    i_ref = held["drive.current_gain"] * run["drive_reference"][100]
    assert 1.0 < i_ref < held["drive.current_limit"]
    resistance, kp = held["motor.resistance"], held["drive.kp"]
    assert run["current_error"][100] == pytest.approx(i_ref * resistance / (resistance + kp), rel=1e-9)
    assert run["motor_current"][100] + run["current_error"][100] == pytest.approx(i_ref, rel=1e-12)
    assert np.all(run["current_error"][152:] == 0.0)
    # Beyond the limit the error is to the limit.
    far = simulate(held, 0.1, fin_command=0.3)
    assert far["motor_current"][-1] + far["current_error"][-1] == pytest.approx(held["drive.current_limit"], rel=1e-12)


def test_actuators_with_a_current_loop_have_a_current_error() -> None:
    for name in NAMES:
        has = "current_error" in {v.name for v in get(name).outputs}
        assert has == (capabilities.CURRENT_LOOP in get(name).provides), name


@given(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-0.6, 0.6), st.floats(-9.0, 9.0), st.booleans(), st.booleans())
def test_what_lands_is_between_its_stops_and_rests_against_one(direction: float, place: float, speed: float,
                                                               halted: bool, struck: bool) -> None:
    slide = stick.Slide(direction, 1.0, -1.0)
    where, rate = stick.landed(FLOATS, slide, 0.5, (0.4, 1.0), (place, speed), halted, struck and direction != 0.0)
    assert abs(where) <= 0.5
    if direction and (struck or direction * place >= 0.5):
        assert (where, rate) == (direction * 0.5, 0.0)
    elif direction and halted:
        assert (where, rate) == (min(max(place, -0.5), 0.5), 0.0)
    else:
        assert rate == speed


@pytest.mark.parametrize("damping", [0.3, 1.0, 1.6])
def test_a_second_order_actuator_follows_its_equation_exactly(damping: float) -> None:
    w, h, angle, rate, command = 90.0, 7e-3, 0.02, -0.4, 0.05
    actuator, values = get("second-order"), load_parameters(model="second-order").values
    p = actuator.namespace({**values, "second_order.natural_frequency": w, "second_order.damping": damping})
    u: Any = Record(enabled=True, reference=command)
    at_end, used = actuator.step(FLOATS, p, Record(fin_angle=angle, fin_rate=rate), u, h)
    error, speed = expm(np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]]) * h) @ (angle - command, rate)
    assert used == h
    # Of two equal roots, the equations are those of roots apart by sqrt(1e-9) of their size: (w h)^2 1e-9/6 = 7e-11.
    assert at_end == pytest.approx({"fin_angle": command + error, "fin_rate": speed}, rel=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_second_order_actuator_rests_at_its_stop_until_it_turns_back(side: float) -> None:
    actuator, values = get("second-order"), load_parameters(model="second-order").values
    p, stop = actuator.namespace(values), values["fin.stop_angle"]

    def stepped(begin: float, rate: float, reference: float) -> Any:
        u: Any = Record(enabled=True, reference=side * reference)
        return actuator.step(FLOATS, p, Record(fin_angle=side * begin, fin_rate=side * rate), u, 1e-3)[0]

    out, back = stepped(stop - 1e-3, 3.0, stop), stepped(stop + 1e-3, -0.1, 0.0)
    assert out == {"fin_angle": side * stop, "fin_rate": 0.0}
    assert side * back["fin_rate"] < 0.0


@pytest.mark.parametrize("felt", [1.0, -0.5])
def test_the_margin_of_a_clutched_screw_s_load_is_the_load(felt: float) -> None:
    """It is negative where the load is not that of its e: the screw drives it, or it drives the screw."""
    for load in (3.0, -2.0):
        t = clutched_screw.Train(rotor=1e-4, screw=2e-4, behind_inertia=0.0, rotor_torque=1.0, screw_torque=0.0,
                                 dry=0.1, capacity=2.0, sliding=(0.2, 0.2), load=(load, load), behind=0.0, high=1.0,
                                 low=-1.0, forward=1.0, backward=-0.5)
        m = clutched_screw.Motion(screw=1.0, rotor=1.0, clutch=1.0, felt=felt)
        margins = clutched_screw.margins(FLOATS, t, m, 5.0, 9.0)
        assert margins["load"] == (load if felt == t.forward else -load)


@pytest.mark.parametrize(("ratio", "expected"), [(1.0, 5.0), (1.1, 7.0), (3.75, 7.0)])
def test_friction_of_a_worm_that_falls_acts_at_the_speed_of_mid_step(ratio: float, expected: float) -> None:
    """At the speed of its begin the step would be of first order; friction that does not fall needs no prediction."""
    values = {**load_parameters(model="worm-gear").values, "worm.static_ratio": ratio}
    assert friction_speed(FLOATS, get("worm-gear").namespace(values), Record(motor_speed=5.0), lambda: 7.0) == expected
