"""The dual clutch actuator: closed forms, what must always hold, and an integration that shares no code with it."""

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
from emcas_fmu.physics import coupled
from emcas_fmu.reference import clutch as reference
from tests.marks import slow
from tests.simulation import acting, simulate

from .engaging import assert_locks, ratio
from .hammers import hammered

MODEL = "clutch"
ACTUATOR = get(MODEL)


@pytest.fixture(scope="module")
def values() -> Mapping[str, Any]:
    """The shipped parameters, without the encoder's chatter."""
    return {**load_parameters(model=MODEL).values, "encoder.enabled": False}


# -- closed forms ------------------------------------------------------------------


def _plain(values: Mapping[str, Any], **changes: float) -> dict[str, Any]:
    """No friction, a motor without torque, a lever so long that the ratio stays, fluxes that stay, heat that stays."""
    still = {name: 0.0 for name in values if name.startswith(("friction.coulomb", "friction.viscous", "friction.fin"))}
    return {**values, **still, "motor.coulomb_friction": 0.0, "motor.viscous_friction": 0.0,
            "motor.torque_constant": 1e-6, "motor.back_emf_constant": 0.0, "motor.resistance": 1e4,
            "kinematics.initial_angle": 0.0, "screw.lead": 1e-6, "mass.nut": 0.0, "clutch.residual": 0.0,
            "clutch.bias_current": 0.0, "clutch.heat_capacity": 1.0, "clutch.thermal_resistance": 1e6, **changes}


@pytest.mark.parametrize(("torque", "share"), [(2.0, 0.0), (3.0, 0.5), (1.0, -0.8)])
def test_time_and_energy_until_a_clutch_locks(values: Mapping[str, Any], torque: float, share: float) -> None:
    """t = dw/a and E = T_c dw^2/(2 a), a = T_c/J_1 + (T_c - T_L)/J_2, with a load T_L of a share of the torque."""
    v = _plain(values)
    p = ACTUATOR.namespace(v)
    begin, current = 50.0, torque / v["clutch.rated_torque"] * v["clutch.rated_current"]
    u = acting(current / v["drive.current_gain"]).replace(aero_torque=-share * torque * ratio(v))
    x = Record(**{**ACTUATOR.start(FLOATS, p), "motor_speed": begin, "coil_current_1": current, "flux_1": current})
    driving = v["inertia.motor"] + v["clutch.driving_inertia"]
    fin = (v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]) / ratio(v)**2
    driven = v["inertia.screw"] + v["clutch.driven_inertia"] + fin
    approach = torque / driving + torque * (1.0 - share) / driven
    assert_locks(ACTUATOR, v, x, u, torque, approach)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_fin_stalls_where_the_torque_ends(values: Mapping[str, Any], side: float) -> None:
    """n ((1 - bias) (1 - r) T_r - C_s) - C_f: a fin at rest starts against less, and is driven back by more."""
    limit = values["drive.current_limit"]
    # Residual torques cancel, and so does the bias.
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


def test_holding_a_load_costs_heat_of_slip(values: Mapping[str, Any]) -> None:
    """The motor turns on: omega_m (T/n + 2 C), with what friction holds of it either way."""
    load = 100.0
    run = simulate(values, 2.0, model=MODEL, fin_command=0.0, aero_torque=-load)
    speed, n = run["motor_speed"][-1], ratio(values, run["fin_angle"][-1])
    heat = run["slip_power_1"][-1] + run["slip_power_2"][-1]
    biased = values["clutch.residual"] + (1.0 - values["clutch.residual"]) * (
        values["clutch.bias_current"] / values["clutch.rated_current"])
    expected = speed * (load / n + 2.0 * biased * values["clutch.rated_torque"])
    friction = values["friction.coulomb.positive[0]"] + values["friction.fin_coulomb"] / n
    assert abs(heat - expected) <= speed * friction
    # And the supply gives it: with the copper's heat, the coils' and the motor's friction.
    current = run["motor_torque"][-1] / values["motor.torque_constant"]
    lost = values["motor.resistance"] * current**2 + sum(
        values["coil.resistance"] * run[f"coil_current_{k}"][-1]**2 for k in (1, 2))
    lost += (values["motor.coulomb_friction"] + values["motor.viscous_friction"] * speed) * speed
    # At rest, except for a creep of the integral that friction hides.
    assert run["supply_power"][-1] == pytest.approx(heat + lost, rel=1e-3)


def test_a_motor_without_supply_comes_to_rest_with_all(values: Mapping[str, Any]) -> None:
    """Both clutches locked and both bodies at rest: a small load changes no bit."""
    run = simulate(values, 1.0, model=MODEL, supply_voltage=0.0, fin_command=0.0,
                   aero_torque=lambda t: 3.0 * sin(20.0 * t))
    assert run["motor_speed"][0] > 300.0
    assert np.all(run["motor_speed"][-300:] == 0.0)
    assert np.all(run["screw_speed"][-300:] == 0.0)
    assert len(set(run["fin_angle"][-300:])) == 1
    assert np.all(run["supply_power"] == 0.0)


# -- what sticks and what slides ---------------------------------------------------

_torque = st.floats(-10.0, 10.0)
_limit = st.sampled_from([0.0, 0.1, 1.0]) | st.floats(0.0, 5.0)
_speed = st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-10.0, 10.0)


@settings(derandomize=True, max_examples=75)
@given(torques=st.tuples(_torque, _torque), inertias=st.tuples(st.floats(1e-5, 1e-2), st.floats(1e-5, 1e-2)),
       limits=st.lists(_limit, min_size=5, max_size=5), screw=_speed, motor=_speed | st.just(None))
def test_directions_are_those_that_hold(torques: Any, inertias: Any, limits: list[float], screw: float,
                                        motor: float | None) -> None:
    """Sliding follows the acceleration; what sticks has none and is within its limit; at rest a solution exists.

    Margins are above 0 up to that.
    """
    motor = screw if motor is None else motor
    dry = [coupled.Dry(limits[0], limits[1]), *(coupled.Dry(t, t) for t in limits[2:])]
    bodies = coupled.Bodies(inertias, torques, dry)
    signs = coupled.directions(FLOATS, bodies, screw, motor)
    rates = coupled.accelerations(FLOATS, bodies, signs)
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    speeds, faster = rows @ (screw, motor), rows @ rates
    scale = np.abs(rates).max() + 1e-9
    edge = 1e-8 * max(limits)  # friction counts as overcome within 1e-9 of up to four limits
    margins = coupled.margins(FLOATS, bodies, signs, screw, motor)
    assert min(margins.values()) >= -edge
    if screw == motor == 0.0 and any(signs):
        assert min(coupled.margins(FLOATS, bodies, (0.0,) * 4, 0.0, 0.0).values()) <= edge
    if screw == motor == 0.0 and not any(signs):
        bounds = [(-d.low * (1.0 + 1e-9), d.high * (1.0 + 1e-9)) for d in dry]
        assert rates == (0.0, 0.0)
        assert linprog(np.zeros(4), A_eq=rows.T, b_eq=torques, bounds=bounds).success
        return
    holding = coupled.friction_torques(FLOATS, bodies, signs)
    for k, sign in enumerate(signs):
        if speeds[k] != 0.0:
            assert sign == np.sign(speeds[k])
        elif sign:
            # Overcome within 1e-9 of a limit it may stand still by rounding.
            assert sign * faster[k] >= -1e-6 * scale - 1e-8 * max(limits) / min(inertias)
        else:
            assert abs(faster[k]) <= 1e-9 * scale
            assert -dry[k].low * (1.0 + 1e-9) <= holding[k] <= dry[k].high * (1.0 + 1e-9)


# -- what must always hold ---------------------------------------------------------

_profile = st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-350.0, 350.0), st.booleans(), st.floats(0.0, 60.0)),
                    min_size=1, max_size=6)
COMMON = settings(derandomize=True, max_examples=15,
                  suppress_health_check=[HealthCheck.function_scoped_fixture])


def _run(values: Mapping[str, Any], profile: list[Any], flip: float = 1.0, stop: float = 0.3) -> dict[str, Any]:
    at = np.minimum((np.arange(round(stop * 1e3) + 1) * len(profile)) // round(stop * 1e3 + 1), len(profile) - 1)
    command, load, enable, supply = (np.array(column, float)[at] for column in zip(*profile, strict=True))
    return simulate(values, stop, model=MODEL, fin_command=flip * command, aero_torque=flip * load, enable=enable,
                    supply_voltage=supply)


@COMMON
@given(profile=_profile)
def test_it_returns_no_power_and_heats_only(values: Mapping[str, Any], profile: list[Any]) -> None:
    run = _run(values, profile)
    assert all(np.isfinite(column).all() for column in run.values())
    assert run["supply_power"].min() >= 0.0
    # A locked clutch has none to the bit; one that just starts has rounding's sign.
    assert min(run["slip_power_1"].min(), run["slip_power_2"].min()) >= 0.0
    assert min(run["coil_current_1"].min(), run["coil_current_2"].min()) >= -1e-12
    assert np.diff(run["clutch_temperature"]).min() > -1e-9 + (
        (values["friction.temperature"] - run["clutch_temperature"].max())
        / values["clutch.thermal_resistance"] / values["clutch.heat_capacity"] * 1e-3)


@COMMON
@given(profile=_profile)
def test_a_symmetric_one_is_odd(values: Mapping[str, Any], profile: list[Any]) -> None:
    """One clutch is the other's mirror: command and load turned, the fin turns the other way."""
    v = {**values, "kinematics.initial_angle": 0.0}
    one, other = _run(v, profile), _run(v, profile, -1.0)
    # Difference quotients of ROS2 step the same way in both: some 1e-9 of it is left.
    assert other["fin_angle"] == pytest.approx(-one["fin_angle"], abs=1e-6)
    assert other["coil_current_1"] == pytest.approx(one["coil_current_2"], abs=1e-6)
    assert other["supply_power"] == pytest.approx(one["supply_power"], abs=1e-2)


def test_energy_of_a_stroke(values: Mapping[str, Any]) -> None:
    """Supply and load give what slip, copper, coils, suppressors and friction take, and what is stored."""
    v, step = {**values, "solver.max_tick": 1e-5}, 5e-6
    run = simulate(v, 0.2, step, model=MODEL, fin_command=0.25, aero_torque=-80.0)
    screw, motor = run["screw_speed"], run["motor_speed"]
    current = run["motor_torque"] / v["motor.torque_constant"]
    # Tables of friction are 1 at the default temperature, its polynomials constants.
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

    given, taken = work["supply"] + work["load"], sum(work.values()) - work["supply"] - work["load"]
    # Sums over jumps of voltage and slip are off by half a step of them: 2 kW times 5e-6 s, some hundred times.
    assert given == pytest.approx(taken + stored(-1) - stored(0), abs=0.2)
    assert work["slip"] > 5.0


def test_an_unloaded_slew_locks_a_clutch_to_the_bit(values: Mapping[str, Any]) -> None:
    run = simulate(values, 0.15, model=MODEL, fin_command=radians(20.0))
    locked = (run["motor_speed"] == run["screw_speed"]) & (run["screw_speed"] > 100.0)
    assert locked.sum() > 10
    assert np.all(run["slip_power_1"][locked] == 0.0)


def test_disabled_it_lets_go_and_turns_on(values: Mapping[str, Any]) -> None:
    """The residual torques cancel: the fin is at rest until its friction is overcome, and the motor turns."""
    p = ACTUATOR.namespace(values)
    holds = values["friction.coulomb.positive[0]"] * ratio(values) + values["friction.fin_coulomb"]
    for load, moves in ((0.98 * holds, False), (1.02 * holds, True)):
        run = simulate(values, 0.3, model=MODEL, fin_command=0.2, enable=False, aero_torque=load)
        assert bool(run["fin_angle"].max() > 1e-6) == moves
        assert run["motor_speed"].min() > 0.9 * p.motor.start_speed
        assert run["coil_current_1"][-1] < 1e-6


# -- an independent integration ----------------------------------------------------


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_it_is_an_independent_integration_to_second_order(values: Mapping[str, Any], seed: int) -> None:
    rows, values = 200, {**values, "clutch.share_1": 0.9, "clutch.temperature_coefficient": -0.01}
    inputs = hammered(seed, rows)
    exact = reference.simulate(values, {"time": np.arange(rows + 1) * 1e-3, **inputs})
    ticks, errors = [8e-4, 4e-4, 2e-4, 1e-4, 5e-5], []
    for tick in ticks:
        run = simulate({**values, "solver.max_tick": tick}, rows * 1e-3, model=MODEL, **inputs)
        errors.append(np.degrees(np.abs(run["fin_angle"] - exact["fin_angle"]).max()))
        assert np.abs(run["motor_speed"] - exact["motor_speed"]).max() < 1e3 * tick  # of 400 rad/s
    assert errors[2] < 0.002, errors  # the default tick
    # Events that move between ticks shift the fit of five points.
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    assert 1.6 < slope < 2.8, (slope, errors)


def test_a_jam_blocks_the_screw_and_makes_no_energy() -> None:
    """The motor goes on turning: what its clutches heat comes from the supply and from its own kinetic energy."""
    model, begin = f"{MODEL}+faults", 0.2
    values = {**load_parameters(model=model).values, "fault.jam.begin": begin, "fault.jam.end": 9.0}
    run = simulate(values, 1.0, model=model, fin_command=lambda t: 0.2 if t > begin - 0.05 else 0.0)
    jammed = run["time"] > begin + 0.001
    assert not np.ptp(run["fin_angle"][jammed])
    assert not run["screw_speed"][jammed].any()
    inertia = values["inertia.motor"] + values["clutch.driving_inertia"]
    kinetic = 0.5 * inertia * -np.diff(run["motor_speed"][jammed][[0, -1]] ** 2)[0]
    heat, drawn = (np.trapezoid(column[jammed], run["time"][jammed]) for column in (
        run["slip_power_1"] + run["slip_power_2"], run["supply_power"]))
    assert 0.0 < heat < drawn + kinetic
