"""The dual clutch actuator against closed forms, invariants and an independent integration."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from emcas_fmu.actuators import get
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import coupled, kinematics
from emcas_fmu.reference import clutch as reference
from tests.marks import slow
from tests.simulation import acting, simulate

from .checks import convergence_order
from .engaging import INPUT_PROFILES, assert_locks, ratio, run_profile
from .hammers import random_inputs

MODEL = "clutch"
ACTUATOR = get(MODEL)


@pytest.fixture(scope="module")
def values() -> Mapping[str, Any]:
    """The shipped parameters with exact measurement: counts of the encoder would make the motor chatter."""
    return {**load_parameters(model=MODEL).values, "encoder.enabled": False}


# -- closed forms ------------------------------------------------------------------


def _constant_torques(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with which torques are constant: no friction, no motor torque, nearly constant ratio and flux.

    The heat of the clutch also stays in it.
    """
    zero = {name: 0.0 for name in values if name.startswith(("friction.coulomb", "friction.viscous", "friction.fin"))}
    return {**values, **zero, "motor.coulomb_friction": 0.0, "motor.viscous_friction": 0.0,
            "motor.torque_constant": 1e-6, "motor.back_emf_constant": 0.0, "motor.resistance": 1e4,
            "kinematics.initial_angle": 0.0, "screw.lead": 1e-6, "mass.nut": 0.0, "clutch.residual": 0.0,
            "clutch.bias_current": 0.0, "clutch.heat_capacity": 1.0, "clutch.thermal_resistance": 1e6}


@pytest.mark.parametrize(("torque", "share"), [(2.0, 0.0), (3.0, 0.5), (1.0, -0.8)])
def test_time_and_energy_until_a_clutch_locks(values: Mapping[str, Any], torque: float, share: float) -> None:
    """t = dw/a and E = T_c dw^2/(2 a), a = T_c/J_1 + (T_c - T_L)/J_2; the load T_L is a share of the torque T_c."""
    v = _constant_torques(values)
    p = ACTUATOR.namespace(v)
    current = torque / v["clutch.rated_torque"] * v["clutch.rated_current"]
    u = acting(current / v["drive.current_gain"]).replace(aero_torque=-share * torque * ratio(v))
    x = Record(**{**ACTUATOR.start(FLOATS, p), "motor_speed": 50.0, "coil_current_1": current, "flux_1": current})
    driving = v["inertia.motor"] + v["clutch.driving_inertia"]
    fin = (v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]) / ratio(v)**2
    driven = v["inertia.screw"] + v["clutch.driven_inertia"] + fin
    approach = torque / driving + torque * (1.0 - share) / driven
    assert_locks(ACTUATOR, v, x, u, torque, approach)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stall_and_holding_load(values: Mapping[str, Any], side: float) -> None:
    """With T from the current limit, a fin at rest starts against loads below n (T - C_s) - C_f.

    Loads above n (T + C_s) + C_f drive it back.
    """
    limit = values["drive.current_limit"]
    # The two clutches' residual torques cancel, and so do their bias torques.
    torque = (1.0 - values["clutch.residual"]) * values["clutch.rated_torque"] / values["clutch.rated_current"] * limit
    dry = values["friction.coulomb.positive[0]"]
    moving = ratio(values) * (torque - dry) - values["friction.fin_coulomb"]
    holding = ratio(values) * (torque + dry) + values["friction.fin_coulomb"]
    p = ACTUATOR.namespace(values)
    bias = values["clutch.bias_current"]
    coils = dict(zip(("1", "2") if side > 0.0 else ("2", "1"), (limit + bias, bias), strict=True))
    x = Record(**{**ACTUATOR.start(FLOATS, p), **{f"coil_current_{k}": i for k, i in coils.items()},
                  **{f"flux_{k}": i for k, i in coils.items()}})
    for load, starts in ((0.999 * moving, side), (1.001 * moving, 0.0), (0.999 * holding, 0.0),
                         (1.001 * holding, -side)):
        u = acting(side * limit / values["drive.current_gain"]).replace(aero_torque=-side * load)
        moved, _ = ACTUATOR.step(FLOATS, p, x, u, 1e-6)
        assert np.sign(moved["screw_speed"]) == starts, load


def test_holding_a_load_dissipates_slip_power(values: Mapping[str, Any]) -> None:
    """The motor keeps turning, so slip takes omega_m (T/n + 2 C); friction may hold a part of the load T."""
    load = 100.0
    run = simulate(values, 2.0, model=MODEL, fin_command=0.0, aero_torque=-load)
    speed, n = run["motor_speed"][-1], ratio(values, run["fin_angle"][-1])
    heat = run["slip_power_1"][-1] + run["slip_power_2"][-1]
    biased = values["clutch.residual"] + (1.0 - values["clutch.residual"]) * (
        values["clutch.bias_current"] / values["clutch.rated_current"])
    expected = speed * (load / n + 2.0 * biased * values["clutch.rated_torque"])
    friction = values["friction.coulomb.positive[0]"] + values["friction.fin_coulomb"] / n
    assert abs(heat - expected) <= speed * friction
    # The supply provides this power, and the losses of winding, coils and motor friction.
    current = run["motor_torque"][-1] / values["motor.torque_constant"]
    lost = values["motor.resistance"] * current**2 + sum(
        values["coil.resistance"] * run[f"coil_current_{k}"][-1]**2 for k in (1, 2))
    lost += (values["motor.coulomb_friction"] + values["motor.viscous_friction"] * speed) * speed
    # The state is steady, except for a slow change of the integral below what friction holds.
    assert run["supply_power"][-1] == pytest.approx(heat + lost, rel=1e-3)


def test_without_supply_motor_and_fin_come_to_rest(values: Mapping[str, Any]) -> None:
    """Both clutches lock and both bodies stay at rest to the bit under a small load."""
    run = simulate(values, 1.0, model=MODEL, supply_voltage=0.0, fin_command=0.0,
                   aero_torque=lambda t: 3.0 * sin(20.0 * t))
    assert run["motor_speed"][0] > 300.0
    assert np.all(run["motor_speed"][-300:] == 0.0)
    assert np.all(run["screw_speed"][-300:] == 0.0)
    assert len(set(run["fin_angle"][-300:])) == 1
    assert np.all(run["supply_power"] == 0.0)


# -- stick and slip ----------------------------------------------------------------

_torque = st.floats(-10.0, 10.0)
_limit = st.sampled_from([0.0, 0.1, 1.0]) | st.floats(0.0, 5.0)
_speed = st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-10.0, 10.0)


@settings(derandomize=True, max_examples=75)
@given(torques=st.tuples(_torque, _torque), inertias=st.tuples(st.floats(1e-5, 1e-2), st.floats(1e-5, 1e-2)),
       limits=st.lists(_limit, min_size=5, max_size=5), screw=_speed, motor=_speed | st.just(None))
def test_chosen_directions_are_consistent(torques: Any, inertias: Any, limits: list[float], screw: float,
                                          motor: float | None) -> None:
    """A contact that starts to slide accelerates that way; a sticking one has no acceleration and is within its limit.

    At rest, friction torques exist that balance the torques. Until an event, event margins are above 0.
    """
    motor = screw if motor is None else motor
    dry = [coupled.Dry(limits[0], limits[1]), *(coupled.Dry(t, t) for t in limits[2:])]
    bodies = coupled.Bodies(inertias, torques, dry)
    signs = coupled.directions(FLOATS, bodies, screw, motor)
    rates = coupled.accelerations(FLOATS, bodies, signs)
    contacts = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])  # relative speeds from screw and motor
    speeds, accelerations = contacts @ (screw, motor), contacts @ rates
    scale = np.abs(rates).max() + 1e-9
    edge = 1e-8 * max(limits)  # a torque within 1e-9 of up to four limits counts as overcome
    margins = coupled.margins(FLOATS, bodies, signs, screw, motor)
    assert min(margins.values()) >= -edge
    if screw == motor == 0.0 and any(signs):
        assert min(coupled.margins(FLOATS, bodies, (0.0,) * 4, 0.0, 0.0).values()) <= edge
    if screw == motor == 0.0 and not any(signs):
        bounds = [(-d.low * (1.0 + 1e-9), d.high * (1.0 + 1e-9)) for d in dry]
        assert rates == (0.0, 0.0)
        assert linprog(np.zeros(4), A_eq=contacts.T, b_eq=torques, bounds=bounds).success
        return
    holding = coupled.friction_torques(FLOATS, bodies, signs)
    for k, sign in enumerate(signs):
        if speeds[k] != 0.0:
            assert sign == np.sign(speeds[k])
        elif sign:
            # A torque within 1e-9 of its limit counts as overcome; rounding may then leave the contact at rest.
            assert sign * accelerations[k] >= -1e-6 * scale - 1e-8 * max(limits) / min(inertias)
        else:
            assert abs(accelerations[k]) <= 1e-9 * scale
            assert -dry[k].low * (1.0 + 1e-9) <= holding[k] <= dry[k].high * (1.0 + 1e-9)


# -- invariants --------------------------------------------------------------------

COMMON = settings(derandomize=True, max_examples=15,
                  suppress_health_check=[HealthCheck.function_scoped_fixture])


@COMMON
@given(profile=INPUT_PROFILES)
def test_no_power_returns_to_the_supply_and_slip_only_heats(values: Mapping[str, Any], profile: list[Any]) -> None:
    run = run_profile(MODEL, values, profile)
    assert all(np.isfinite(column).all() for column in run.values())
    assert run["supply_power"].min() >= 0.0
    assert min(run["slip_power_1"].min(), run["slip_power_2"].min()) >= 0.0
    assert min(run["coil_current_1"].min(), run["coil_current_2"].min()) >= -1e-12
    assert np.diff(run["clutch_temperature"]).min() > -1e-9 + (
        (values["friction.temperature"] - run["clutch_temperature"].max())
        / values["clutch.thermal_resistance"] / values["clutch.heat_capacity"] * 1e-3)


@COMMON
@given(profile=INPUT_PROFILES)
def test_symmetric_actuator_has_mirrored_response(values: Mapping[str, Any], profile: list[Any]) -> None:
    """With command and load reversed, the fin moves the other way and the clutches exchange their currents."""
    v = {**values, "kinematics.initial_angle": 0.0}
    one, other = run_profile(MODEL, v, profile), run_profile(MODEL, v, profile, -1.0)
    # The forward difference quotients of ROS2 are not mirrored; this leaves some 1e-9 of the values.
    assert other["fin_angle"] == pytest.approx(-one["fin_angle"], abs=1e-6)
    assert other["coil_current_1"] == pytest.approx(one["coil_current_2"], abs=1e-6)
    assert other["supply_power"] == pytest.approx(one["supply_power"], abs=1e-2)


def test_energy_of_a_stroke(values: Mapping[str, Any]) -> None:
    """The work of supply and load equals the losses (slip, copper, coils, suppressors, friction) and stored energy."""
    v, step = {**values, "solver.max_tick": 1e-5}, 5e-6
    run = simulate(v, 0.2, step, model=MODEL, fin_command=0.25, aero_torque=-80.0)
    screw, motor = run["screw_speed"], run["motor_speed"]
    current = run["motor_torque"] / v["motor.torque_constant"]
    # At the default temperature friction tables are 1, and the friction polynomials are constants.
    powers = {"supply": run["supply_power"], "load": run["hinge_torque"] * run["fin_rate"],
              "slip": run["slip_power_1"] + run["slip_power_2"], "copper": v["motor.resistance"] * current**2,
              "motor": v["motor.coulomb_friction"] * np.abs(motor) + v["motor.viscous_friction"] * motor**2,
              "screw": v["friction.coulomb.positive[0]"] * np.abs(screw) + v["friction.viscous.positive"] * screw**2,
              "fin": v["friction.fin_coulomb"] * np.abs(run["fin_rate"])}
    powers["coils"], powers["suppressors"] = np.zeros_like(screw), np.zeros_like(screw)
    for k in (1, 2):
        coil = run[f"coil_current_{k}"]
        voltage = v["coil.resistance"] * coil + v["coil.inductance"] * np.gradient(coil, step)
        powers["coils"] += v["coil.resistance"] * coil**2
        powers["suppressors"] += np.maximum(-voltage, 0.0) * coil
    work = {name: float(np.trapezoid(power, dx=step)) for name, power in powers.items()}
    assert all(work[name] >= 0.0 for name in work if name != "load"), work

    def stored(k: int) -> float:
        turning = v["inertia.screw"] + v["clutch.driven_inertia"] + v["mass.nut"] * v["screw.lead"]**2
        fin = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
        rotor = v["inertia.motor"] + v["clutch.driving_inertia"]
        coils = run["coil_current_1"][k]**2 + run["coil_current_2"][k]**2
        return float(0.5 * (turning * screw[k]**2 + fin * run["fin_rate"][k]**2 + rotor * motor[k]**2
                            + v["coil.inductance"] * coils))

    entered, lost = work["supply"] + work["load"], sum(work.values()) - work["supply"] - work["load"]
    # Trapezoids at rows of 5 us: 3e-5 J measured, of more than 5 J.
    assert entered == pytest.approx(lost + stored(-1) - stored(0), abs=1e-3)
    assert work["slip"] > 5.0


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("distance", [1e-11, 1e-8, 1e-6, 1e-4])
def test_screw_just_before_its_stop_comes_to_rest_there(values: Mapping[str, Any], side: float, distance: float
                                                        ) -> None:
    """The distance falls slowly at first: a step may pass the stop although the estimated time of this event is later.
    A screw that went on beyond the stop would be driven by the friction that represents the stop."""
    p = ACTUATOR.namespace(values)
    at_stop = float(kinematics.motor_angle(FLOATS, p, side * values["fin.stop_angle"]))
    u = acting().replace(aero_torque=side * 300.0)
    for speed in (0.0, 0.04, 0.3):
        x = Record(**{**ACTUATOR.start(FLOATS, p), "screw_angle": at_stop - side * distance,
                      "screw_speed": side * speed, "motor_speed": 278.0})
        # 300 N.m turn the screw by 1e-3 rad in 2 ms.
        left = 2e-3
        while left > 1e-12:
            moved, used = ACTUATOR.step(FLOATS, p, x, u, left)
            x, left = x.replace(**moved), left - used
            assert side * x.screw_angle <= side * at_stop * (1.0 + 1e-15)
        assert (x.screw_angle, x.screw_speed) == (pytest.approx(at_stop, rel=1e-15), 0.0)
        assert 200.0 < x.motor_speed < 343.0


def test_an_unloaded_slew_locks_a_clutch_to_the_bit(values: Mapping[str, Any]) -> None:
    run = simulate(values, 0.15, model=MODEL, fin_command=radians(20.0))
    locked = (run["motor_speed"] == run["screw_speed"]) & (run["screw_speed"] > 100.0)
    assert locked.sum() > 10
    assert np.all(run["slip_power_1"][locked] == 0.0)


def test_disabled_fin_moves_beyond_its_friction_and_the_motor_keeps_turning(values: Mapping[str, Any]) -> None:
    """The residual torques of the clutches cancel, so only friction holds the fin."""
    p = ACTUATOR.namespace(values)
    friction = values["friction.coulomb.positive[0]"] * ratio(values) + values["friction.fin_coulomb"]
    for load, moves in ((0.98 * friction, False), (1.02 * friction, True)):
        run = simulate(values, 0.3, model=MODEL, fin_command=0.2, enable=False, aero_torque=load)
        assert bool(run["fin_angle"].max() > 1e-6) == moves
        assert run["motor_speed"].min() > 0.9 * p.motor.start_speed
        assert run["coil_current_1"][-1] < 1e-6


# -- an independent integration ----------------------------------------------------


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_second_order_convergence_to_the_independent_integration(values: Mapping[str, Any], seed: int) -> None:
    rows, values = 200, {**values, "clutch.share_1": 0.9, "clutch.temperature_coefficient": -0.01}
    inputs = random_inputs(seed, rows)
    exact = reference.simulate(values, {"time": np.arange(rows + 1) * 1e-3, **inputs})
    ticks, errors = [8e-4, 4e-4, 2e-4, 1e-4, 5e-5], []
    for tick in ticks:
        run = simulate({**values, "solver.max_tick": tick}, rows * 1e-3, model=MODEL, **inputs)
        errors.append(np.degrees(np.abs(run["fin_angle"] - exact["fin_angle"]).max()))
        assert np.abs(run["motor_speed"] - exact["motor_speed"]).max() < 1e3 * tick  # of 400 rad/s
    assert errors[2] < 0.002, errors  # the default tick
    # The position of events within ticks differs from tick to tick, which shifts the fit of five points.
    assert 1.6 < convergence_order(ticks, errors) < 2.8, errors


def test_jam_blocks_the_screw_and_creates_no_energy() -> None:
    """The motor keeps turning: the heat of slip comes from the supply and the motor's kinetic energy."""
    model, begin = f"{MODEL}+faults", 0.2
    values = {**load_parameters(model=model).values, "fault.jam.begin": begin, "fault.jam.end": 9.0}
    run = simulate(values, 1.0, model=model, fin_command=lambda t: 0.2 if t > begin - 0.05 else 0.0)
    jammed = run["time"] > begin + 0.001
    assert not np.ptp(run["fin_angle"][jammed])
    assert not run["screw_speed"][jammed].any()
    inertia = values["inertia.motor"] + values["clutch.driving_inertia"]
    kinetic = 0.5 * inertia * -np.diff(run["motor_speed"][jammed][[0, -1]] ** 2)[0]
    heat, supplied = (np.trapezoid(column[jammed], run["time"][jammed]) for column in (
        run["slip_power_1"] + run["slip_power_2"], run["supply_power"]))
    assert 0.0 < heat < supplied + kinetic
