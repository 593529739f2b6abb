"""The independent integration against closed forms, conservation laws and itself at a tighter tolerance."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files
from emcas_fmu.reference.cases import CASES, ReferenceCase
from emcas_fmu.reference.controllers import Controllers
from emcas_fmu.reference.drive import ON_LIMIT, Motor
from emcas_fmu.reference.plant import Plant, simulate
from tests.default_actuator import THESIS_LOOPS

Array = NDArray[np.floating[Any]]
Values = Mapping[str, Any]


@pytest.fixture
def values(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The shipped parameters with the thesis's controllers."""
    return {**values, **THESIS_LOOPS}


INPUTS = Plant(load_parameters().values).inputs()
LOCKED = {"friction.fin_coulomb": 1e6}
COULOMB = [f"friction.coulomb.{side}[{order}]" for side in ("positive", "negative") for order in range(7)]
VISCOUS = ["friction.viscous.positive", "friction.viscous.negative"]
FRICTIONLESS = dict.fromkeys(COULOMB + VISCOUS, 0.0)


def rows(duration: float, **columns: float | Array) -> dict[str, Array]:
    """Return columns with rows 1 ms apart; a number makes a constant column."""
    time = np.arange(round(duration * 1e3) + 1) * 1e-3
    return {"time": time} | {name: np.broadcast_to(value, time.shape) for name, value in columns.items()}


def step_to(degrees: float, duration: float, at: float = 0.01) -> dict[str, Array]:
    inputs = rows(duration)
    return inputs | {"fin_command": np.where(inputs["time"] > at - 5e-4, math.radians(degrees), 0.0)}


# Motor and drive ------------------------------------------------------------------------------------------


def test_clipped_drive_charges_the_winding_exponentially(values: Values) -> None:
    overridden = {**values, **LOCKED, "drive.current_offset": 50.0}
    result = simulate(overridden, rows(0.02, supply_voltage=10.0))
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    # The drive is clipped at 10 V until Kp (50 A - i) = 10 V, at 48 A; 10 V / 0.25 ohm make only 40 A.
    expected = 10.0 / resistance * -np.expm1(-result["time"] * resistance / inductance)
    # At most 200 steps in 20 ms, each with a relative error of 1e-11 of 40 A, which decays.
    np.testing.assert_allclose(result["motor_current"], expected, rtol=0, atol=1e-9)
    assert set(result["motor_voltage"]) == {10.0}


def current_loop(values: Values, reference: float) -> Array:
    """Return the matrix of the unclipped loop for (current, xi, 1) with a locked motor."""
    kp, ki, inductance = values["drive.kp"], values["drive.ki"], values["motor.inductance"]
    slope = [-(values["motor.resistance"] + kp) / inductance, 1 / inductance, kp * reference / inductance]
    return np.array([slope, [-ki, 0.0, ki * reference], [0.0, 0.0, 0.0]])


def test_free_drive_follows_the_linear_current_loop(values: Values) -> None:
    # Ki is far above its default, so that the integral matters within 50 ms.
    overridden = {**values, **LOCKED, "drive.current_offset": 2.0, "drive.ki": 200.0}
    result = simulate(overridden, rows(0.05))
    expected = [(expm(current_loop(overridden, 2.0) * t) @ [0.0, 0.0, 1.0])[0] for t in result["time"]]
    # expm is exact to 1e-13; the integration errs by 1e-11 per step.
    np.testing.assert_allclose(result["motor_current"], expected, rtol=0, atol=1e-9)


def test_drive_glides_on_the_limit_where_neither_clipped_nor_free_can_last(values: Values) -> None:
    # 1.9 A through 6 ohm need 11.4 V. The demand reaches the limit of 10 V while the current still rises: with a
    # constant integral it would fall below the limit, with a free one it would exceed it. So 5 (1.9 - i) + xi = 10.
    overridden = {**values, **LOCKED, "drive.current_offset": 1.9, "drive.ki": 2000.0, "motor.resistance": 6.0}
    inputs = rows(0.02)
    inputs["supply_voltage"] = np.where(inputs["time"] < 0.0095, 10.0, 20.0)
    result = simulate(overridden, inputs)
    start = [10.0 / 6.0, 10.0 - 5.0 * (1.9 - 10.0 / 6.0), 1.0]
    # The demand is integrated: rounding of 90 steps at 10 V.
    assert result["motor_voltage"][10] == pytest.approx(10.0, abs=1e-12)
    matrix = current_loop(overridden, 1.9)
    expected = [(expm(matrix * (t - 0.01)) @ start)[0] for t in result["time"][10:]]
    # As above; after 90 time constants L/R = 0.1 ms the current is 10 V / 6 ohm.
    np.testing.assert_allclose(result["motor_current"][10:], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("acceleration", [2e4, -2e4])
def test_a_gliding_demand_follows_a_limit_that_moves(values: Values, side: int, acceleration: float) -> None:
    """With pole pairs, the voltage limit depends on speed and current; it falls or rises while the demand glides on it.
    """
    plant = Plant({**values, "motor.pole_pairs": 4})
    around = plant.surroundings({**INPUTS, "supply_voltage": 30.0}, 5.0)
    start = Motor(300.0, side * 20.0, 0.0, acceleration)
    start = start._replace(integral=side * plant.limit(start, around) - plant.demand(start, around))
    current_slope, integral_slope = plant.electrical(start, side * ON_LIMIT, around)

    def beyond(time: float) -> float:
        m = Motor(start.speed + acceleration * time, start.current + current_slope * time,
                  start.integral + integral_slope * time)
        return side * plant.demand(m, around) - plant.limit(m, around)

    # Central differences over 20 ns have 1e-4 V/s of curvature and rounding; the limit changes by 1e3 V/s or more.
    assert abs(plant.limit(start, around) - 30.0) > 0.1
    assert (beyond(1e-8) - beyond(-1e-8)) / 2e-8 == pytest.approx(0.0, abs=1e-3)


def test_demand_passes_from_one_limit_to_the_other_where_both_are_0() -> None:
    """The inductive voltage then needs the whole supply. The response does not depend on further rows between those
    at which inputs change: each row determines the drive's mode anew."""
    values, between = {**load_parameters().values, "encoder.enabled": False, "motor.pole_pairs": 5}, 10
    coarse = rows(0.12, supply_voltage=39.0)
    coarse["fin_command"] = 0.32 * np.sin(70.0 * coarse["time"])
    fine = {name: np.repeat(column, between) for name, column in coarse.items()}
    fine["time"] = np.arange(len(fine["time"])) * 1e-3 / between
    few, many = simulate(values, coarse), simulate(values, fine)
    assert np.count_nonzero((many["motor_voltage"] == 0.0) & (np.abs(many["motor_current"]) > 10.0)) > 10
    # Measured: 2e-11 deg, of the integrator's tolerance. A drive that is free between limits of 0 makes 0.1 deg.
    np.testing.assert_allclose(few["fin_angle"], many["fin_angle"][::between], rtol=0.0, atol=math.radians(1e-8))


def test_integral_is_constant_while_the_voltage_is_clipped(values: Values) -> None:
    # At 10 V of 50 A * 5 V/A the drive is clipped for 20 ms. An error of more than 10 A with a gain of 1000 V/(A s)
    # would integrate to 200 V. Then the supply recovers and the loop settles.
    overridden = {**values, **LOCKED, "drive.current_offset": 50.0, "drive.ki": 1000.0}
    inputs = rows(0.03)
    inputs["supply_voltage"] = np.where(inputs["time"] < 0.0195, 10.0, 400.0)
    result = simulate(overridden, inputs)
    # With xi = 0 at the recovery, the current does not overshoot its reference.
    assert result["motor_current"].max() < 50.0
    assert result["motor_current"][-1] > 49.0


def test_disabled_bridge_is_open(values: Values) -> None:
    inputs = rows(0.08, fin_command=math.radians(10.0))
    inputs["enable"] = (np.abs(inputs["time"] - 0.04) > 0.0105).astype(float)  # off from 30 to 50 ms
    result = simulate({**values, "encoder.enabled": False}, inputs)
    off = slice(31, 51)  # rows are left limits: at 30 ms the bridge still drives, at 50 ms it is still open
    assert np.all(result["motor_current"][off] == 0.0)
    assert np.all(result["drive_reference"][off] == 0.0)
    plant = Plant(values)
    emf = [
        plant.p["motor.back_emf_constant"] * (plant.ratio(angle) * rate)
        for angle, rate in zip(result["fin_angle"], result["fin_rate"])
    ]
    np.testing.assert_array_equal(result["motor_voltage"][off], np.array(emf)[off])
    assert abs(result["motor_current"][30]) > 1.0
    assert abs(result["motor_current"][55]) > 1.0


# Mechanics ------------------------------------------------------------------------------------------------


def test_resting_fin_does_not_creep(values: Values) -> None:
    plant = Plant(values)
    breakaway = plant.coulomb(0.0, 1)
    result = simulate(values, rows(0.05, aero_torque=0.99 * breakaway, enable=0.0))
    assert np.all(result["fin_angle"] == 0.0)
    assert np.all(result["fin_rate"] == 0.0)
    result = simulate(values, rows(0.05, aero_torque=1.01 * breakaway, enable=0.0))
    assert result["fin_angle"][-1] > 0.0


@pytest.mark.parametrize("moment", [40.0, -40.0])
def test_work_of_the_load_becomes_kinetic_energy_and_friction_heat(values: Values, moment: float) -> None:
    # With constant Coulomb friction at the motor, its heat is C_m |theta_m| on any path.
    overridden = {**values, **FRICTIONLESS, "friction.fin_coulomb": 3.0}
    overridden |= {"friction.coulomb.positive[0]": 0.2, "friction.coulomb.negative[0]": 0.2}
    result = simulate(overridden, rows(0.14, aero_torque=moment, enable=0.0))
    plant = Plant(overridden)
    angle, rate = result["fin_angle"], result["fin_rate"]
    inertia = [plant.fin_inertia + plant.motor_inertia * plant.ratio(d) ** 2 for d in angle]
    kinetic = [0.5 * m * w * w for m, w in zip(inertia, rate)]
    heat = [0.2 * abs(plant.motor_angle(d)) + 3.0 * abs(d) for d in angle]
    assert 0.1 < abs(angle[-1]) < plant.stop
    # The balance holds only if M' = 2 J_t R R'. Steps err by 1e-11 of some 10 J.
    np.testing.assert_allclose(np.add(kinetic, heat), moment * angle, rtol=0, atol=1e-9)


def test_stop_is_inelastic_and_the_fin_leaves_it_under_a_load(values: Values) -> None:
    inputs = rows(0.44, enable=0.0)
    inputs["aero_torque"] = np.select([inputs["time"] < 0.3, inputs["time"] < 0.4], [60.0, -5.0], -60.0)
    result = simulate(values, inputs)
    at_stop = result["fin_angle"] == values["fin.stop_angle"]
    # 60 N.m move the fin to its stop; then 12 N.m of friction hold it there against 5 N.m.
    assert at_stop[290:401].all()
    assert result["fin_angle"].max() == values["fin.stop_angle"]
    assert np.all(result["fin_rate"][at_stop] == 0.0)
    assert not at_stop[410:].any()


def test_moment_of_gravity_and_acceleration_is_the_slope_of_a_potential(values: Values) -> None:
    overridden = {**values, "loads.gravity": True, "mounting.azimuth": 0.7}
    plant = Plant(overridden)
    row = {name: float(start) for name, start in INPUTS.items()}
    row |= {"acceleration.x": 30.0, "acceleration.z": -12.0, "attitude.roll": 0.4, "attitude.pitch": -0.3}
    around = plant.surroundings(row, 0.0)
    # Specific force g_b - a_b in the body frame, then rotated about x by the azimuth.
    g = 9.80665
    body = np.array(
        [-g * math.sin(-0.3), g * math.sin(0.4) * math.cos(0.3), g * math.cos(0.4) * math.cos(0.3)]
    )
    body -= [30.0, 0.0, -12.0]
    c, s = math.cos(0.7), math.sin(0.7)
    force = np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) @ body

    def work(delta: float) -> float:
        turn = np.array([[math.cos(delta), math.sin(delta)], [-math.sin(delta), math.cos(delta)]])
        total = values["mass.nut"] * values["screw.lead"] * plant.motor_angle(delta) * force[0]
        for part in ("fin", "shaft", "fork"):
            centre = [values[f"center_of_mass.{part}.{axis}"] for axis in "xz"]
            total += values[f"mass.{part}"] * float(force[[0, 2]] @ (turn @ centre))
        return float(total)

    for delta in (-0.3, 0.0, 0.2):
        slope = (work(delta + 1e-5) - work(delta - 1e-5)) / 2e-5
        # Central differences: truncation is 1e-10 times the third derivative (some N.m), rounding 1e-11.
        assert plant.loads(delta, around) == pytest.approx(slope, abs=1e-8)


# Sampled controllers --------------------------------------------------------------------------------------


@pytest.mark.parametrize("on_fin", [False, True])
def test_encoder_speed_is_the_difference_of_floored_counts(values: Values, on_fin: bool) -> None:
    # Without position gain the reference speed is 0, and u = -Kp_vel * measured speed, that of the motor's encoder.
    overridden = {**values, "encoder.on_fin": on_fin, "controller.position.kp": 0.0, "controller.position.ki": 0.0}
    plant, count = Plant(overridden), 2 * math.pi / (2048 * 4)
    path = [0.0, -1e-4, 2e-3, 0.0105, 0.0104]
    controllers = Controllers(plant, plant)
    before = 0
    for delta in path:
        counts = math.floor(plant.motor_angle(delta) / count)
        speed = (counts - before) * count / overridden["controller.sample_time"]
        before = counts
        expected = -overridden["controller.velocity.kp"] * speed
        # The true rate, here 1e3 rad/s, must not matter. Rounding of 10 V.
        u = controllers.sample(delta, 1e3, 0.0, True)
        assert u == pytest.approx(max(-10.0, min(10.0, expected)), abs=1e-12)


@pytest.mark.parametrize(("command", "band"), [(0.1, 1.0), (-0.1, -1.0), (2e-4, None), (-2e-4, None)])
def test_compensation_is_the_friction_voltage_within_the_speed_band(
    values: Values, command: float, band: float | None
) -> None:
    # Without velocity gain the reference is the compensation, which -6 degC must not change.
    overridden = {**values, "controller.velocity.kp": 0.0, "encoder.enabled": False, "friction.temperature": -6.0}
    plant = Plant(overridden)
    if band is None:  # within the band, in proportion to the reference speed Kp_pos theta_m(command)
        reference = overridden["controller.position.kp"] * plant.motor_angle(command)
        band = reference / overridden["compensation.speed_band"]
        assert abs(band) < 1.0
    side = "positive" if command > 0 else "negative"
    friction = overridden[f"friction.coulomb.{side}[0]"]  # the polynomial at delta = 0
    expected = friction / overridden["motor.torque_constant"] / overridden["drive.current_gain"] * band
    # Some ten roundings of 0.2 V.
    u = Controllers(plant, plant).sample(0.0, 0.0, command, True)
    assert u == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(("celsius", "coulomb", "viscous"), [
    (24.0, 1.0, 1.0), (9.0, 1.125, 1.3), (-6.0, 1.25, 1.6), (-23.0, 1.425, 2.15), (-60.0, 1.6, 2.7),
    (37.0, 0.95, 0.835), (90.0, 0.85, 0.48)])
def test_friction_is_linear_between_the_points_of_its_table(
    values: Values, celsius: float, coulomb: float, viscous: float
) -> None:
    warm, now = Plant(values), Plant({**values, "friction.temperature": celsius})
    for side in (1, -1):
        # The ratios of models/emcas.toml; rounding of numbers near 1.
        assert now.coulomb(0.2, side) / warm.coulomb(0.2, side) == pytest.approx(coulomb, abs=1e-14)
        assert now.viscous[side] / warm.viscous[side] == pytest.approx(viscous, abs=1e-14)


# The closed loop ------------------------------------------------------------------------------------------


def test_small_signals_follow_the_sampled_linear_model(values: Values) -> None:
    overridden = {**values, **FRICTIONLESS, "kinematics.initial_angle": 0.0, "drive.current_offset": 0.0}
    overridden |= {"encoder.enabled": False, "compensation.gain": 0.0, "friction.viscous.positive": 5e-4}
    overridden |= {"friction.viscous.negative": 5e-4}
    command = 1e-4
    result = simulate(overridden, rows(0.1, fin_command=command))
    expected = linear_response(overridden, command, len(result["time"]))
    # cos^-2 differs from 1 by delta^2 = 1e-8, which makes about 1e-12 rad.
    np.testing.assert_allclose(result["fin_angle"], expected, rtol=0, atol=1e-11)
    assert expected[-1] == pytest.approx(command, rel=0.1)  # except for overshoot


def linear_response(p: Values, command: float, count: int) -> list[float]:
    """Return the fin angle [rad] of (2.18 - 2.26) with sampled controllers, exact between samples."""
    n = p["kinematics.moment_arm"] / p["screw.lead"]
    fin = p["inertia.fin"] + p["inertia.shaft"] + p["inertia.fork"]
    inertia = p["inertia.motor"] + p["inertia.screw"] + p["mass.nut"] * p["screw.lead"] ** 2 + fin / n**2
    viscous, inductance = p["friction.viscous.positive"], p["motor.inductance"]
    kp, ki, gain = p["drive.kp"], p["drive.ki"], p["drive.current_gain"]
    # States: motor angle, motor speed, current, drive integral, DAC value that has reached the drive.
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1, 1:3] = -viscous / inertia, p["motor.torque_constant"] / inertia
    a[2, 1:] = -p["motor.back_emf_constant"], -p["motor.resistance"] - kp, 1.0, kp * gain
    a[2] /= inductance
    a[3, 2], a[3, 4] = -ki, ki * gain
    period = p["controller.sample_time"]
    late, remainder = divmod(p["drive.transport_delay"], period)
    before, after = expm(a * remainder), expm(a * (period - remainder))
    state, integral, values, angles = np.zeros(5), 0.0, [0.0] * int(late), []
    for _ in range(count):
        angles.append(state[0] / n)
        error = command * n - state[0]
        speed = p["controller.position.kp"] * error + integral
        integral += period * p["controller.position.ki"] * error
        values.append(p["controller.velocity.kp"] * (speed - state[1]))
        state = before @ state
        state[4] = values.pop(0)
        state = after @ state
    return angles


def test_tighter_tolerance_changes_the_fin_angle_by_less_than_1e_10_rad(
    values: Values, monkeypatch: pytest.MonkeyPatch
) -> None:
    overridden, inputs = {**values, "encoder.enabled": False}, step_to(20.0, 0.12)
    usual = simulate(overridden, inputs)
    rtol, _, max_step = Plant.accuracy
    monkeypatch.setattr(Plant, "accuracy", Plant.accuracy._replace(rtol=rtol / 10, max_step=max_step / 3))
    tight = simulate(overridden, inputs)
    # A hundredth of the required accuracy of the independent integration, 1e-8 rad.
    assert np.max(np.abs(usual["fin_angle"] - tight["fin_angle"])) < 1e-10
    # The run must include the voltage limit and a high rate.
    assert usual["motor_voltage"].max() == 39.0
    assert np.degrees(usual["fin_rate"].max()) > 220.0


def test_output_grid_does_not_change_the_trajectory(values: Values) -> None:
    coarse = simulate(values, step_to(5.0, 0.06))
    time = np.arange(4 * 60 + 1) * 0.25e-3
    fine = simulate(values, {"time": time, "fin_command": np.where(time > 0.0099, math.radians(5.0), 0.0)})
    # Another grid has other integration steps: the difference is integration error, as above.
    np.testing.assert_allclose(fine["fin_angle"][::4], coarse["fin_angle"], rtol=0, atol=1e-10)


@pytest.mark.parametrize("on_fin", [False, True])
def test_encoder_leaves_the_fin_within_its_resolution(values: Values, on_fin: bool) -> None:
    # With a very fine resolution an encoder measures the true angle, and the true rate averaged over a sample.
    overridden = {**values, "encoder.on_fin": on_fin, "encoder.pulses": 10**8}
    coarse = simulate({**values, "encoder.on_fin": on_fin}, step_to(5.0, 0.1))["fin_angle"]
    fine = simulate(overridden, step_to(5.0, 0.1))["fin_angle"]
    # A count is 7.7e-4 rad of the motor, or of the fin with an encoder there.
    count = 2 * math.pi / 8192 / (1 if on_fin else Plant(values).ratio(0.0))
    assert 0.0 < np.max(np.abs(coarse - fine)) < 30 * count
    assert fine[-1] == pytest.approx(math.radians(5.0), rel=0.1)  # except for overshoot


# Cases and files ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case_starts_at_rest_and_uses_interface_inputs(case: ReferenceCase) -> None:
    inputs = case.inputs()
    assert inputs["time"][-1] == case.stop_time
    assert set(inputs) - {"time"} <= set(INPUTS)
    lead_in = inputs["time"] < 0.0495
    assert lead_in.sum() == 50
    assert not inputs["fin_command"][lead_in].any()
    # Nine decimals are stored.
    assert np.max(np.abs(inputs["fin_command"])) == pytest.approx(case.amplitude, abs=1e-9, rel=1e-4)


def test_names_of_cases_are_unique() -> None:
    assert len({case.name for case in CASES}) == len(CASES)


def test_a_sag_is_a_share_of_the_supply() -> None:
    """With the default supply it is exactly from 39 to 28 V, as stored."""
    small = load_parameters().with_values({"drive.supply_voltage": 28.0})
    default, other = ({case.name: case for case in files.cases(each.model, each.values)}
                      for each in (load_parameters(), small))
    assert set(default["sag"].inputs()["supply_voltage"]) == {39.0, 28.0}
    assert default["sag"].title == "Supply sags from 39 to 28 V during a 40 deg slew and recovers"
    assert set(other["sag"].inputs()["supply_voltage"]) == {28.0, 20.1025641}
    assert other["sag"].title == "Supply sags from 28 to 20.1 V during a 40 deg slew and recovers"
    assert all(other[name] == case for name, case in default.items() if name != "sag")


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> ReferenceCase:
    """A case of 80 ms with an override, which replaces the others."""
    case = ReferenceCase("short", "A short step", "step", 0.08, math.radians(5.0),
                         lambda t: {"fin_command": np.where(t > 0.0495, math.radians(5.0), 0.0)},
                         {"friction.temperature": -6.0})
    monkeypatch.setattr(files, "CASES", [case])
    return case


def test_files_round_trip(short: ReferenceCase, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    files.regenerate(tmp_path, progress=lambda *state: seen.append(state))
    assert seen == [("short", 0, 1), ("short", 1, 1)]
    names = {"EMCAS_short_in.csv", "EMCAS_short_ref.csv", "EMCAS_short_ref.opt", "provenance.toml"}
    assert {path.name for path in tmp_path.iterdir()} == names

    text = (tmp_path / "EMCAS_short_ref.csv").read_text()
    assert text.splitlines()[0] == ",".join(("time", *Plant.names))
    assert len(text.splitlines()) == 1 + 81
    read = files.read_csv(tmp_path / "EMCAS_short_in.csv")
    for name, column in short.inputs().items():
        np.testing.assert_array_equal(read[name], column)

    options = dict(line.split(", ") for line in (tmp_path / "EMCAS_short_ref.opt").read_text().splitlines())
    assert options == {"StartTime": "0", "StopTime": "0.08", "StepSize": "0.001", "RelTol": "1e-11"}

    entry = files.read_provenance(tmp_path)["short"]
    assert entry["start_values"] == {"friction.temperature": -6.0}
    assert entry["command"] == "emcas reference"
    assert entry["sha256_ref"] == hashlib.sha256(text.encode()).hexdigest()


def test_interrupted_regeneration_changes_no_file(
        short: ReferenceCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files.regenerate(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    runs = iter([{"time": np.zeros(2), "fin_angle": np.ones(2)}])

    def interrupted(*_: object) -> Mapping[str, Array]:
        if (result := next(runs, None)) is None:
            raise KeyboardInterrupt
        return result

    monkeypatch.setattr(files, "CASES", [short, dataclasses.replace(short, name="another")])
    monkeypatch.setattr(files, "simulator", lambda _: interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.regenerate(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_regenerating_one_case_keeps_the_provenance_of_the_others(short: ReferenceCase, tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    another = dataclasses.replace(short, name="another")
    monkeypatch.setattr(files, "CASES", [short, another])
    files.regenerate(tmp_path, ["another"])
    files.regenerate(tmp_path, ["short"])
    assert list(files.read_provenance(tmp_path)) == ["short", "another"]
    (tmp_path / "provenance.toml").write_text("[half")
    with pytest.raises(EmcasError, match=r"provenance.toml: is not valid TOML: .*; make the reference files with"):
        files.regenerate(tmp_path, ["short"])
    files.regenerate(tmp_path)
    assert list(files.read_provenance(tmp_path)) == ["short", "another"]


def test_comparison_finds_a_changed_response(short: ReferenceCase, tmp_path: Path) -> None:
    files.regenerate(tmp_path)
    assert all(maximum <= tolerance for *_, maximum, tolerance in files.compare(tmp_path, ["short"]))
    path = tmp_path / "EMCAS_short_ref.csv"
    stored = files.read_csv(path)
    stored["fin_angle"][-1] += 1e-7
    path.write_text(files.csv_text(stored), encoding="utf-8")
    (bad,) = [d for d in files.compare(tmp_path) if d.maximum > d.tolerance]
    assert (bad.case, bad.variable) == ("short", "fin_angle")
    assert bad.maximum == pytest.approx(1e-7, rel=0.05)  # 1e-7 is stored with nine decimals


def test_unknown_case_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match="nonsense"):
        files.compare(tmp_path, ["nonsense"])
