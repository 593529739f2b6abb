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
from tests.runs import run_both_kernels

from .checks import oscillation_frequency
from .electrohydrostatic import BASE, DRY, EXACT, MODEL, lever, run_of, values_of

Array = np.ndarray[Any, Any]
LOCKED = {"pump.coulomb_friction": 1e3}  # N.m, more than any pressure turns


def leakage(values: Any) -> float:
    """Return the leakage [m3/(s.Pa)] of a chamber under pressure while the other chamber is refilled."""
    return float(values["pump.leakage"] + values["cylinder.internal_leakage"] + values["pump.case_leakage"])


# -- closed forms -----------------------------------------------------------------


def test_fin_rate_with_a_locked_pump_follows_from_leakage() -> None:
    """w = C_t T/(A r)^2, 14 deg/s under 100 N.m."""
    torque, locked = 100.0, {**DRY, **LOCKED, "fin.start_angle": radians(-1.0)}
    values, run = values_of(locked), run_of(locked, 0.6, enable=False, aero_torque=torque)
    # The load first compresses the chamber.
    assert run["time"][np.flatnonzero(run["fin_angle"] > 0.0)[0]] > 0.0
    area = values["cylinder.area"] * lever(values, run["fin_angle"][-1])
    expected = leakage(values) * torque / area**2
    # Viscous friction of the piston and the reservoir's pressure change the rate by up to 1 %.
    assert run["fin_rate"][-1] == pytest.approx(expected, rel=0.01)
    assert degrees(expected) == pytest.approx(13.9, rel=0.1)  # the lever's ratio at the end is a little larger


@pytest.mark.parametrize(("share", "holds"), [(0.95, True), (1.05, False)])
def test_the_relief_valve_sets_the_largest_load(share: float, holds: bool) -> None:
    """The largest load at a fin angle of 0 is A p_rv r; dry friction of fin and seals adds 2 %."""
    stiff = {"relief_valve.conductance": 1e-9}
    values = values_of(stiff)
    load = share * values["cylinder.area"] * values["relief_valve.pressure"] * lever(values)
    run = run_of(stiff, 1.0, aero_torque=lambda t: -load * min(t / 0.1, 1.0))
    # Beyond the largest load the fin gives way until the lever's greater ratio holds it.
    assert (abs(run["fin_angle"][-1]) < radians(0.5)) == holds
    assert (run["fin_angle"][-1] < radians(-2.0)) != holds
    difference = run["pressure_1"] - run["pressure_2"]
    # The valve passes the largest flow of the pump, 6.4e-5 m3/s, at 0.1 MPa above its setting.
    assert np.abs(difference[run["time"] > 0.5]).max() < values["relief_valve.pressure"] * 1.01


def hydraulic_mode(values: Any) -> complex:
    """Return the pole of fin and pump, both free, on the oil.

    dp' = k (D w - A r W - C dp), k = 2 beta/V_0. Each side damps the mode in proportion to its motion in the mode.
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
    nearest = min(poles, key=lambda pole: abs(pole - expected))
    # The formula holds for small damping ratios, whose square is below 1 %.
    assert abs(nearest) == pytest.approx(abs(expected), rel=0.01)
    assert -nearest.real / abs(nearest) == pytest.approx(-expected.real / abs(expected), rel=0.02)


def test_a_pulse_excites_the_hydraulic_mode() -> None:
    """Without dry friction and check valves, the pressure difference oscillates at the mode's frequency."""
    quiet = {**DRY, "check_valve.conductance": 0.0, "solver.max_tick": 1e-5}
    run = run_of(quiet, 0.05, 2e-5, enable=False, aero_torque=lambda t: 2.0 if t < 1e-4 else 0.0)
    found = 2.0 * np.pi * oscillation_frequency(run["pressure_1"] - run["pressure_2"], 2e-5)
    # The fin drifts by less than 0.1 deg, and ROS2 lengthens the period by at most (w h)^2/6.
    assert found == pytest.approx(abs(hydraulic_mode(values_of(quiet))), rel=0.005)


def test_an_aiding_load_returns_power_to_the_supply() -> None:
    """In a steady slew with the load, the oil drives the pump; friction and the winding take a part of the power."""
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
    drop = (torque - friction) / area  # Pa, between the chambers
    speed = (area * rate - leakage(values) * drop) / values["pump.displacement"]
    shaft_torque = values["pump.displacement"] * drop - values["pump.coulomb_friction"] - (
        values["pump.pressure_friction"] * drop + values["pump.viscous_friction"] * speed)
    current = -shaft_torque / values["motor.torque_constant"]
    expected = current * (values["motor.resistance"] * current + values["motor.back_emf_constant"] * speed)
    assert expected < 0.0
    # The slew is not quite steady: the fin accelerates a little, and the lever's ratio changes. 5 % measured.
    assert np.mean(run["supply_power"][k - 10:k + 10]) == pytest.approx(expected, rel=0.1)


# -- invariants -------------------------------------------------------------------


def test_energy() -> None:
    """The work of supply, reservoir and load equals the losses (friction, leakage, copper) and the stored energy."""
    step, changes = 2e-5, {**EXACT, "solver.max_tick": 2e-5, "kinematics.initial_angle": 0.0}
    v = values_of(changes)
    run = run_of(changes, 0.12, step, fin_command=radians(12.0), aero_torque=-40.0)
    angle, rate, one, two, speed, current = (run[name] for name in (
        "fin_angle", "fin_rate", "pressure_1", "pressure_2", "motor_speed", "motor_current"))
    ratio = v["kinematics.moment_arm"] / np.cos(angle)**2
    displaced = v["cylinder.area"] * v["kinematics.moment_arm"] * np.tan(angle)
    drop, refill = one - two, v["reservoir.pressure"] - v["check_valve.cracking_pressure"]
    check = sum(v["check_valve.conductance"] * np.maximum(refill - p, 0.0) * p for p in (one, two))
    case = sum(v["pump.case_leakage"] * (v["reservoir.pressure"] - p) * p for p in (one, two))
    entering = run["motor_voltage"] * current + check + case - 40.0 * rate
    dry = v["friction.fin_coulomb"] + ratio * v["cylinder.coulomb_friction"]
    lost = (v["motor.resistance"] * current**2
            + np.abs(speed) * (v["pump.coulomb_friction"] + v["pump.pressure_friction"] * np.abs(drop))
            + v["pump.viscous_friction"] * speed**2 + np.abs(rate) * dry
            + v["cylinder.viscous_friction"] * (ratio * rate)**2
            + (v["pump.leakage"] + v["cylinder.internal_leakage"]) * drop**2
            # The energy V p^2/(2 beta) also changes with the volume, by p/beta of the piston's power.
            - v["cylinder.area"] * ratio * rate * (one**2 - two**2) / (2.0 * v["oil.bulk_modulus"]))
    fin = sum(v[f"inertia.{part}"] for part in ("fin", "shaft", "fork")) + v["cylinder.moving_mass"] * ratio**2
    stored = 0.5 * (fin * rate**2 + v["inertia.motor"] * speed**2 + v["motor.inductance"] * current**2
                    + ((v["cylinder.dead_volume"] + displaced) * one**2
                       + (v["cylinder.dead_volume"] - displaced) * two**2) / v["oil.bulk_modulus"])

    def integral(power: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])

    assert np.abs(drop).max() < v["relief_valve.pressure"]  # the relief valve stays closed
    total = integral(np.abs(run["motor_voltage"] * current))[-1]
    # Trapezoids of 0.02 ms over jumps of the drive's voltage: 0.2 % of the energy through the motor's terminals.
    assert np.abs(integral(entering - lost) - (stored - stored[0])).max() < 2e-3 * total


def test_symmetric_plant_has_mirrored_response() -> None:
    symmetric = {**EXACT, "kinematics.initial_angle": 0.0, "drive.current_offset": 0.0}
    one, other = (run_of(symmetric, 0.3, fin_command=lambda t, s=s: s * radians(12.0) * np.sign(np.sin(30.0 * t)),
                         aero_torque=-50.0 * s) for s in (1.0, -1.0))
    # Rounding is left, which friction amplifies.
    np.testing.assert_allclose(one["fin_angle"], -other["fin_angle"], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(one["pressure_1"], other["pressure_2"], rtol=0.0, atol=1e3)


def test_unloaded_chamber_is_at_the_refill_pressure() -> None:
    for sign in (1.0, -1.0):
        run = run_of({}, 2.0, aero_torque=100.0 * sign)
        low = run["pressure_1" if sign > 0.0 else "pressure_2"][-1]
        refill = BASE.values["reservoir.pressure"] - BASE.values["check_valve.cracking_pressure"]
        # The check valve passes the leakage to the case, 1.4e-7 m3/s, at 1.4 kPa.
        assert low == pytest.approx(refill, abs=3e3)


@pytest.mark.parametrize("torque", [6.0, -6.0])
def test_fin_and_pump_stick_to_the_bit(torque: float) -> None:
    run = run_of({"fin.start_angle": 0.1}, 1.0, enable=False, aero_torque=torque)
    assert np.all(run["fin_angle"] == 0.1)
    assert np.all(run["fin_rate"] == 0.0)
    assert np.all(run["motor_speed"] == 0.0)
    # With a larger load the fin moves by leakage, and the pump stays at rest.
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
    # The lowest pressure of a chamber that is a void from its smallest to its largest volume: p_v - beta_c ln(V/V_0).
    displaced = values["cylinder.area"] * values["kinematics.moment_arm"] * np.tan(
        values["fin.stop_angle"] + values["kinematics.initial_angle"])
    volumes = values["cylinder.dead_volume"] + np.array([1.0, -1.0]) * displaced
    lowest = values["oil.cavitation_pressure"] - values["oil.cavitated_modulus"] * log(volumes[0] / volumes[1])
    assert min(run["pressure_1"].min(), run["pressure_2"].min()) > lowest
    assert np.all(np.abs(run["motor_voltage"][run["time"] < 0.1]) <= supply * (1.0 + 1e-12))


def test_kernels_agree() -> None:
    """The run includes voids, the relief valve, a stop, the voltage limit and a disabled drive."""
    run_both_kernels(values_of({"reservoir.pressure": 0.05e6}), 0.12, MODEL, supply_voltage=25.0,
                     fin_command=lambda t: radians(15.0 if t < 0.04 else -15.0),
                     aero_torque=lambda t: 450.0 if t > 0.06 else 50.0, enable=lambda t: t < 0.1)


def test_a_load_turns_the_pump_of_a_disabled_drive() -> None:
    def motion(opens: bool) -> float:
        run = run_of({"bypass_valve.opens_disabled": opens}, 0.35, enable=lambda t: t < 0.3, aero_torque=60.0)
        off = run["time"] > 0.3
        assert np.all(run["motor_current"][off] == 0.0)
        assert np.all(run["supply_power"][off] == 0.0)
        return float(run["fin_angle"][-1] - run["fin_angle"][300])

    # 60 N.m are 1.05 N.m at the pump, against 0.11 N.m of friction; the bypass has a hundred times the leakage.
    assert radians(1.0) < motion(False) < 0.75 * motion(True)


# -- requirements -----------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [1.0, 5.0, 10.0])
def test_steps_overshoot_by_5_percent_at_most(size: float, sign: float) -> None:
    run = run_of({}, 1.0, fin_command=sign * radians(size))
    assert np.max(sign * np.degrees(run["fin_angle"])) <= 1.05 * size


@pytest.mark.parametrize(("torque", "needed"), [(0.0, 220.0), (100.0, 200.0)])
def test_rates_of_table_2(torque: float, needed: float) -> None:
    """The rate is the mean between -10 and 10 deg of a slew by 40 deg, without and against a load."""
    run = run_of({}, 1.2, fin_command=lambda t: radians(-20.0 if t < 0.6 else 20.0), aero_torque=-torque)
    angle, slew = np.degrees(run["fin_angle"]), run["time"] > 0.6
    begin, end = (float(np.interp(x, angle[slew][:150], run["time"][slew][:150])) for x in (-10.0, 10.0))
    assert 20.0 / (end - begin) > 1.05 * needed  # with a margin of 5 %
    assert abs(angle[-1] - 20.0) < 0.2


@pytest.mark.parametrize("size", [1.0, 3.5])
def test_bandwidth_of_table_2(size: float) -> None:
    run = run_of({}, 1.0, fin_command=lambda t: radians(size) * np.sin(2.0 * np.pi * 10.0 * t))
    periods = run["time"][:-1] >= 0.7
    amplitude = np.abs(np.mean(run["fin_angle"][:-1][periods] * np.exp(-20j * np.pi * run["time"][:-1][periods]))) * 2.0
    assert amplitude > radians(size) / sqrt(2.0) * 1.05


def test_a_cylinder_too_short_for_its_stroke_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"cylinder\.dead_volume = 5e-06 m3 must be more than"):
        values_of({"cylinder.dead_volume": 5e-6})
