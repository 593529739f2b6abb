"""The electrohydrostatic actuator: closed forms, invariants, and what its controller is tuned for."""

from __future__ import annotations

from math import degrees, log, radians, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.parameters import ParameterError
from emcas_fmu.simulation import simulate

from .electrohydrostatic import BASE, DRY, EXACT, MODEL, lever, run_of, values_of

Array = np.ndarray[Any, Any]
LOCKED = {"pump.coulomb_friction": 1e3}  # N.m, more than any pressure makes of the pump


def leakage(values: Any) -> float:
    """Of a chamber under pressure whose other side is refilled [m3/(s.Pa)]."""
    return float(values["pump.leakage"] + values["cylinder.internal_leakage"] + values["pump.case_leakage"])


# -- closed forms -----------------------------------------------------------------


def test_a_held_pump_yields_by_its_leakage() -> None:
    """w = C_t T/(A r)^2, 14 deg/s under 100 N.m."""
    torque = 100.0
    values = values_of({**DRY, **LOCKED, "fin.start_angle": radians(-1.0)})
    run = run_of({**DRY, **LOCKED, "fin.start_angle": radians(-1.0)}, 0.6, enable=False, aero_torque=torque)
    at = np.flatnonzero(run["fin_angle"] > 0.0)[0]
    # 100 N.m compress the chamber by some degrees at first.
    assert run["time"][at] > 0.0
    area = values["cylinder.area"] * lever(values, run["fin_angle"][-1])
    expected = leakage(values) * torque / area**2
    # 1 %: viscous friction of the piston, and the reservoir is not at 0 pressure.
    assert run["fin_rate"][-1] == pytest.approx(expected, rel=0.01)
    assert degrees(expected) == pytest.approx(13.9, rel=0.1)  # the lever's ratio at the end is a little larger


@pytest.mark.parametrize(("share", "holds"), [(0.95, True), (1.05, False)])
def test_the_relief_valve_sets_the_largest_load(share: float, holds: bool) -> None:
    """A p_rv r at a fin angle of 0: the dry friction of fin and seals is 2 % of it."""
    stiff = {"relief_valve.conductance": 1e-9}
    values = values_of(stiff)
    load = share * values["cylinder.area"] * values["relief_valve.pressure"] * lever(values)
    run = run_of(stiff, 1.0, aero_torque=lambda t: -load * min(t / 0.1, 1.0))
    # The lever holds the greater load at a greater angle.
    assert (abs(run["fin_angle"][-1]) < radians(0.5)) == holds
    assert (run["fin_angle"][-1] < radians(-2.0)) != holds
    difference = run["pressure_1"] - run["pressure_2"]
    # Above its setting the valve takes the flow of the pump, at most 6.4e-5 m3/s, at 0.1 MPa.
    assert np.abs(difference[run["time"] > 0.5]).max() < values["relief_valve.pressure"] * 1.01


def hydraulic_mode(values: Any) -> complex:
    """Of fin and pump, both free, on the oil: its pole, from parameters alone.

    dp' = k (D w - A r W - C dp), k = 2 beta/V_0, with inertia and damping on each side: what these take of the mode is
    in proportion to how it moves them.
    """
    k = 2.0 * values["oil.bulk_modulus"] / values["cylinder.dead_volume"]
    ratio = lever(values)
    fin = values["cylinder.moving_mass"] * ratio**2
    fin += sum(values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    sides = ((values["cylinder.area"] * ratio, fin, values["cylinder.viscous_friction"] * ratio**2),
             (values["pump.displacement"], values["inertia.motor"], values["pump.viscous_friction"]))
    total = sum(a**2 / inertia for a, inertia, _ in sides)
    across = values["pump.leakage"] + values["cylinder.internal_leakage"] + 0.5 * values["pump.case_leakage"]
    decay = 0.5 * (k * across + sum(a**2 / inertia * b / inertia for a, inertia, b in sides) / total)
    return complex(-decay, sqrt(k * total))


def test_the_hydraulic_mode() -> None:
    poles = LinearActuator(BASE.values, model=MODEL).continuous.poles()
    expected = hydraulic_mode(BASE.values)
    near = min(poles, key=lambda pole: abs(pole - expected))
    # Small damping ratio: its square, and what rounds the modal shares, are below 1 %.
    assert abs(near) == pytest.approx(abs(expected), rel=0.01)
    assert -near.real / abs(near) == pytest.approx(-expected.real / abs(expected), rel=0.02)


def test_the_hydraulic_mode_rings_in_steps() -> None:
    """Friction and check valves away, a pulse on the fin: the period of the pressure difference."""
    quiet = {**DRY, "check_valve.conductance": 0.0, "solver.max_tick": 1e-5}
    run = run_of(quiet, 0.05, 2e-5, enable=False, aero_torque=lambda t: 2.0 if t < 1e-4 else 0.0)
    swing = run["pressure_1"] - run["pressure_2"]
    up = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    times = run["time"][up] - swing[up] * 2e-5 / (swing[up + 1] - swing[up])
    found = 2.0 * np.pi * (len(times) - 1) / (times[-1] - times[0])
    # The fin drifts by less than 0.1 deg meanwhile, ROS2 lengthens the period by (w h)^2/6 at most.
    assert found == pytest.approx(abs(hydraulic_mode(values_of(quiet))), rel=0.005)


def test_a_load_that_drives_returns_power() -> None:
    """A steady slew with the load: what the pump gets from the oil, less friction, against the winding's resistance."""
    start, torque = radians(-15.0), 100.0
    values = values_of({**EXACT, "fin.start_angle": start})
    run = run_of({**EXACT, "fin.start_angle": start}, 0.6, aero_torque=lambda t: torque * min(t / 0.1, 1.0),
                 fin_command=lambda t: start + radians(100.0) * max(t - 0.25, 0.0))
    k = int(np.flatnonzero(run["fin_angle"] > 0.0)[0])
    angle, rate = run["fin_angle"][k], run["fin_rate"][k]
    ratio = lever(values, angle)
    area = values["cylinder.area"] * ratio
    friction = (values["friction.fin_coulomb"] + ratio * values["cylinder.coulomb_friction"]
                + values["cylinder.viscous_friction"] * ratio**2 * rate)
    drop = (torque - friction) / area  # Pa, from the chamber that is driven to the other
    speed = (area * rate - leakage(values) * drop) / values["pump.displacement"]
    left = values["pump.displacement"] * drop - values["pump.coulomb_friction"] - (
        values["pump.pressure_friction"] * drop + values["pump.viscous_friction"] * speed)
    current = -left / values["motor.torque_constant"]
    expected = current * (values["motor.resistance"] * current + values["motor.back_emf_constant"] * speed)
    assert expected < 0.0
    # What is not steady: the fin's inertia at some deg/s2, the lever that closes. 5 % are found.
    assert np.mean(run["supply_power"][k - 10:k + 10]) == pytest.approx(expected, rel=0.1)


# -- invariants -------------------------------------------------------------------


def test_the_account_of_energy_closes() -> None:
    """Source, reservoir and load put in what motion, oil and winding keep and friction, leakage and copper take."""
    step, still = 2e-5, {**EXACT, "solver.max_tick": 2e-5, "kinematics.initial_angle": 0.0}
    v = values_of(still)
    run = run_of(still, 0.12, step, fin_command=radians(12.0), aero_torque=-40.0)
    angle, rate, one, two, speed, current = (run[name] for name in (
        "fin_angle", "fin_rate", "pressure_1", "pressure_2", "motor_speed", "motor_current"))
    ratio = v["kinematics.moment_arm"] / np.cos(angle)**2
    moved = v["cylinder.area"] * v["kinematics.moment_arm"] * np.tan(angle)
    drop, refill = one - two, v["reservoir.pressure"] - v["check_valve.cracking_pressure"]
    check = sum(v["check_valve.conductance"] * np.maximum(refill - p, 0.0) * p for p in (one, two))
    case = sum(v["pump.case_leakage"] * (v["reservoir.pressure"] - p) * p for p in (one, two))
    given = run["motor_voltage"] * current + check + case - 40.0 * rate
    dry = v["friction.fin_coulomb"] + ratio * v["cylinder.coulomb_friction"]
    taken = (v["motor.resistance"] * current**2
             + np.abs(speed) * (v["pump.coulomb_friction"] + v["pump.pressure_friction"] * np.abs(drop))
             + v["pump.viscous_friction"] * speed**2 + np.abs(rate) * dry
             + v["cylinder.viscous_friction"] * (ratio * rate)**2
             + (v["pump.leakage"] + v["cylinder.internal_leakage"]) * drop**2
             # V p^2/(2 beta) of a chamber whose volume changes: of the order of p/beta of the piston's power.
             - v["cylinder.area"] * ratio * rate * (one**2 - two**2) / (2.0 * v["oil.bulk_modulus"]))
    fin = sum(v[f"inertia.{part}"] for part in ("fin", "shaft", "fork")) + v["cylinder.moving_mass"] * ratio**2
    kept = 0.5 * (fin * rate**2 + v["inertia.motor"] * speed**2 + v["motor.inductance"] * current**2
                  + ((v["cylinder.dead_volume"] + moved) * one**2 + (v["cylinder.dead_volume"] - moved) * two**2)
                  / v["oil.bulk_modulus"])

    def until(power: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])

    assert np.abs(drop).max() < v["relief_valve.pressure"]  # it has no part in this
    total = until(np.abs(run["motor_voltage"] * current))[-1]
    # 0.2 % of what went through the motor's terminals: trapezoids of 0.02 ms over the drive's jumps of some kV/s.
    assert np.abs(until(given - taken) - (kept - kept[0])).max() < 2e-3 * total


def test_a_symmetric_plant_answers_symmetrically() -> None:
    even = {**EXACT, "kinematics.initial_angle": 0.0, "drive.current_offset": 0.0}
    one, other = (run_of(even, 0.3, fin_command=lambda t, s=s: s * radians(12.0) * np.sign(np.sin(30.0 * t)),
                         aero_torque=-50.0 * s) for s in (1.0, -1.0))
    # Rounding, and what friction makes of it.
    np.testing.assert_allclose(one["fin_angle"], -other["fin_angle"], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(one["pressure_1"], other["pressure_2"], rtol=0.0, atol=1e3)


def test_the_low_side_sits_at_the_refill_pressure() -> None:
    for sign in (1.0, -1.0):
        run = run_of({}, 2.0, aero_torque=100.0 * sign)
        low = run["pressure_1" if sign > 0.0 else "pressure_2"][-1]
        refill = BASE.values["reservoir.pressure"] - BASE.values["check_valve.cracking_pressure"]
        # The check valve passes what leaks to the case: 1.4e-7 m3/s at 1.4 kPa.
        assert low == pytest.approx(refill, abs=3e3)


@pytest.mark.parametrize("torque", [6.0, -6.0])
def test_what_friction_holds_rests_to_the_bit(torque: float) -> None:
    run = run_of({"fin.start_angle": 0.1}, 1.0, enable=False, aero_torque=torque)
    assert np.all(run["fin_angle"] == 0.1)
    assert np.all(run["fin_rate"] == 0.0)
    assert np.all(run["motor_speed"] == 0.0)
    # A little more and the fin yields by leakage, the pump still at rest.
    run = run_of({"fin.start_angle": 0.1}, 1.0, enable=False, aero_torque=torque * 1.5)
    assert abs(run["fin_angle"][-1] - 0.1) > radians(0.1)
    assert np.all(run["motor_speed"] == 0.0)


angles, loads = st.floats(-20.0, 20.0), st.floats(-500.0, 500.0)


@settings(max_examples=12)
@given(first=angles, second=angles, load=loads, reservoir=st.sampled_from([0.0, 0.1e6, 0.7e6]),
       supply=st.floats(1.0, 60.0), enabled=st.booleans(), bypass=st.floats(0.0, 1.0))
def test_pressures_and_angle_stay_in_bounds(first: float, second: float, load: float, reservoir: float, supply: float,
                                            enabled: bool, bypass: float) -> None:
    values = values_of({"reservoir.pressure": reservoir, "bypass_valve.opening": bypass})
    run = run_of({"reservoir.pressure": reservoir, "bypass_valve.opening": bypass}, 0.25,
                 fin_command=lambda t: radians(first if t < 0.12 else second), supply_voltage=supply,
                 aero_torque=lambda t: load if t > 0.05 else 0.0, enable=lambda t: enabled or t < 0.1)
    assert np.abs(run["fin_angle"]).max() <= values["fin.stop_angle"]
    # From the smallest chamber there is to the largest, all of it a void: p = p_v - beta_c ln(V/V_0).
    swept = values["cylinder.area"] * values["kinematics.moment_arm"] * np.tan(
        values["fin.stop_angle"] + values["kinematics.initial_angle"])
    ways = values["cylinder.dead_volume"] + np.array([1.0, -1.0]) * swept
    lowest = values["oil.cavitation_pressure"] - values["oil.cavitated_modulus"] * log(ways[0] / ways[1])
    assert min(run["pressure_1"].min(), run["pressure_2"].min()) > lowest
    assert np.all(np.abs(run["motor_voltage"][run["time"] < 0.1]) <= supply * (1.0 + 1e-12))


def test_both_back_ends_agree_to_the_bit() -> None:
    """Through voids, the relief valve, a stop, the voltage limit and a disabled drive."""
    values = values_of({"reservoir.pressure": 0.05e6})
    one, other = (simulate(values, 0.12, kernel=kernel, model=MODEL, supply_voltage=25.0,
                           fin_command=lambda t: radians(15.0 if t < 0.04 else -15.0),
                           aero_torque=lambda t: 450.0 if t > 0.06 else 50.0, enable=lambda t: t < 0.1)
                  for kernel in ("compiled", "python"))
    for name, column in one.items():
        np.testing.assert_array_equal(column, other[name], err_msg=name)


def test_a_disabled_drive_lets_the_pump_turn() -> None:
    def moved(opens: bool) -> float:
        run = run_of({"bypass_valve.opens_disabled": opens}, 0.35, enable=lambda t: t < 0.3, aero_torque=60.0)
        off = run["time"] > 0.3
        assert np.all(run["motor_current"][off] == 0.0)
        assert np.all(run["supply_power"][off] == 0.0)
        return float(run["fin_angle"][-1] - run["fin_angle"][300])

    closed, open_ = moved(False), moved(True)
    # 60 N.m are 1.05 N.m at the pump, which has 0.11 N.m of friction; the bypass passes a hundred times the leakage.
    assert radians(1.0) < closed < 0.75 * open_


# -- what it is tuned for ---------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [1.0, 5.0, 10.0])
def test_steps_overshoot_by_5_percent_at_most(size: float, sign: float) -> None:
    run = run_of({}, 1.0, fin_command=sign * radians(size))
    assert np.max(sign * np.degrees(run["fin_angle"])) <= 1.05 * size


@pytest.mark.parametrize(("torque", "needed"), [(0.0, 220.0), (100.0, 200.0)])
def test_rates_of_table_2(torque: float, needed: float) -> None:
    """Against the load, between -10 and 10 deg of a slew of 40 deg."""
    run = run_of({}, 1.2, fin_command=lambda t: radians(-20.0 if t < 0.6 else 20.0), aero_torque=-torque)
    angle, slew = np.degrees(run["fin_angle"]), run["time"] > 0.6
    crossed = [float(np.interp(at, angle[slew][:150], run["time"][slew][:150])) for at in (-10.0, 10.0)]
    assert 20.0 / (crossed[1] - crossed[0]) > 1.05 * needed  # with a margin
    assert abs(angle[-1] - 20.0) < 0.2


@pytest.mark.parametrize("size", [1.0, 3.5])
def test_bandwidth_of_table_2(size: float) -> None:
    run = run_of({}, 1.0, fin_command=lambda t: radians(size) * np.sin(2.0 * np.pi * 10.0 * t))
    last = run["time"][:-1] >= 0.7
    share = np.abs(np.mean(run["fin_angle"][:-1][last] * np.exp(-20j * np.pi * run["time"][:-1][last]))) * 2.0
    assert share > radians(size) / sqrt(2.0) * 1.05


def test_a_cylinder_too_short_for_its_stroke_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"cylinder\.dead_volume = 5e-06 m3 must be more than"):
        values_of({"cylinder.dead_volume": 5e-6})
