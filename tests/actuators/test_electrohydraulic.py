"""The electrohydraulic actuator: closed forms, invariants, limits and rules."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, degrees, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.simulation import simulate
from tests.runs import run_both_kernels

MODEL = "electrohydraulic"
VALUES = dict(load_parameters(model=MODEL).values)
# An ideal transducer, and gains that stay if the shipped ones change.
PLAIN = {**VALUES, "transducer.resolution": 0.0, "controller.position.kp": 90.0, "controller.position.ki": 500.0,
         "controller.position.setpoint_weight": 1.0}
FRICTIONLESS = {**PLAIN, "friction.fin_coulomb": 0.0, "cylinder.coulomb_friction": 0.0}
SUPPLY, TANK = VALUES["hydraulic_supply.pressure"], VALUES["tank.pressure"]
AREA, LEAK, BETA = (VALUES[n] for n in ("cylinder.area", "cylinder.internal_leakage", "oil.bulk_modulus"))
Signal = float | bool | Callable[[float], float]


def run(values: dict[str, Any], stop: float, step: float = 1e-3, **inputs: Signal) -> dict[str, Any]:
    return simulate(values, stop, step, "auto", MODEL, **inputs)


def lever(angle: float, values: dict[str, Any] = VALUES) -> tuple[float, float]:
    """Return the piston's displacement over the fin angle [m/rad] and its slope [m/rad2]."""
    lever_angle = angle + values["kinematics.initial_angle"]
    ratio = values["kinematics.moment_arm"] / cos(lever_angle)**2
    return ratio, 2.0 * ratio * tan(lever_angle)


def fin_inertia(angle: float = 0.0) -> float:
    fin = sum(VALUES[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    return fin + VALUES["cylinder.moving_mass"] * lever(angle)[0]**2


def load_flow(spool: float, load_pressure: float) -> float:
    """Return the flow to the cylinder [m3/s] of a matched valve, by the square root without the laminar range."""
    def edge(z: float) -> float:
        return (z + sqrt(z * z + VALUES["valve.lap"]**2)) / 2.0

    above, below = ((SUPPLY - TANK + sign * load_pressure) / 2.0 for sign in (-1.0, 1.0))
    k = VALUES["valve.rated_flow"] / sqrt(VALUES["valve.rated_pressure"] / 2.0)
    return k * (edge(spool) * sqrt(above) - edge(-spool) * sqrt(below))


# -- closed forms -----------------------------------------------------------------


@pytest.mark.parametrize(("torque", "published"), [(0.0, 275.0), (-100.0, 212.0), (100.0, 329.0)])
def test_rate_of_the_open_valve(torque: float, published: float) -> None:
    """Q_r sqrt((p_s - p_t - P_L)/dp_r) = A R w + C_ip P_L; P_L balances load, friction and the piston's inertia."""
    ratio, ratio_slope = lever(0.0)
    dry = VALUES["friction.fin_coulomb"] + ratio * VALUES["cylinder.coulomb_friction"]
    viscous = VALUES["friction.fin_viscous"] + ratio**2 * VALUES["cylinder.viscous_friction"]

    def balance(rate: float) -> float:
        inertial = VALUES["cylinder.moving_mass"] * ratio * ratio_slope * rate**2
        load = (dry + viscous * rate + inertial - torque) / (AREA * ratio)
        return load_flow(1.0, load) - AREA * ratio * rate - LEAK * load

    expected = brentq(balance, 0.0, 20.0)
    wide = {**PLAIN, "controller.position.kp": 1e4}
    found = run(wide, 0.4, 1e-4, fin_command=lambda t: radians(-20.0 if t < 0.2 else 20.0),
                aero_torque=lambda t: torque if t > 0.2 else 0.0)
    slewing = found["time"] > 0.2
    rate = float(np.interp(0.0, found["fin_angle"][slewing], found["fin_rate"][slewing]))
    # The lever changes the rate during the motion, which takes some pressure: 0.3 % measured.
    assert rate == pytest.approx(expected, rel=0.005)
    # docs/model/electrohydraulic.md has whole degrees per second.
    assert degrees(expected) == pytest.approx(published, abs=0.5)


def test_hydraulic_frequency_and_damping() -> None:
    """w_h = sqrt(4 beta A^2 R^2/(V_t J)); at null each edge is open by lap/2, and its flow falls with p_L."""
    lap, k = VALUES["valve.lap"], VALUES["valve.rated_flow"] / sqrt(VALUES["valve.rated_pressure"] / 2.0)
    ratio, volume, inertia = lever(0.0)[0], 2.0 * VALUES["cylinder.dead_volume"], fin_inertia()
    coefficient = LEAK + k * lap / 4.0 / sqrt((SUPPLY - TANK) / 2.0)
    viscous = VALUES["friction.fin_viscous"] + ratio**2 * VALUES["cylinder.viscous_friction"]
    frequency = sqrt(4.0 * BETA * (AREA * ratio)**2 / (volume * inertia))
    damping = (coefficient / (AREA * ratio) * sqrt(BETA * inertia / volume)
               + viscous / (4.0 * AREA * ratio) * sqrt(volume / (BETA * inertia)))
    poles = np.linalg.eigvals(LinearActuator(VALUES, model=MODEL).continuous.A)
    (mode,) = [pole for pole in poles if pole.imag > 0.0 and pole.real > -300.0]  # the spool's is at -754
    assert abs(mode) == pytest.approx(frequency, rel=0.02)
    assert -mode.real / abs(mode) == pytest.approx(damping, rel=0.02)


def test_stall_load_is_the_largest_that_the_open_valve_moves() -> None:
    """The stall load is A R (p_s - p_t) less friction; a load above A R (p_s - p_t) plus friction drives the fin back.
    """
    ratio = lever(0.0)[0]
    dry = VALUES["friction.fin_coulomb"] + ratio * VALUES["cylinder.coulomb_friction"]
    stall = AREA * ratio * (SUPPLY - TANK)
    wide = {**PLAIN, "controller.position.kp": 1e4}
    # Leaking edges take 0.01 % of the pressure, and leakage across the piston 1 %, (C_ip p/(K sqrt(p)))^2.
    for torque, moves in ((0.975 * stall - dry, 1.0), (1.005 * stall + dry, -1.0)):
        load = [0.0] * 10 + [-torque] * 91
        found = simulate(wide, 0.1, model=MODEL, fin_command=radians(5.0), aero_torque=load)
        assert moves * (found["fin_angle"][-1] - found["fin_angle"][40]) > radians(0.05)


def test_droop_of_proportional_control() -> None:
    """A load leaks a flow of K_ce P_L, which the spool must let in: without integral action this needs an error."""
    torque = 100.0
    p = {**FRICTIONLESS, "controller.position.ki": 0.0}
    found = run(p, 1.0, aero_torque=torque)["fin_angle"][-1]
    load = -torque / (AREA * lever(found)[0])
    spool = brentq(lambda z: load_flow(z, load) - LEAK * load, -1.0, 1.0)
    speed = spool * VALUES["valve.rated_flow"] / AREA
    piston = VALUES["kinematics.moment_arm"] * (tan(found + VALUES["kinematics.initial_angle"])
                                                - tan(VALUES["kinematics.initial_angle"]))
    # The laminar range changes the square root by (dp_0/dp)^2/4, 5e-5 at the smallest pressure drop here.
    assert -piston * p["controller.position.kp"] == pytest.approx(speed, rel=1e-3)
    # With integral action no error is left.
    assert abs(run(FRICTIONLESS, 1.0, aero_torque=torque)["fin_angle"][-1]) < radians(1e-3)


@pytest.mark.parametrize(("angle", "torque"), [(0.0, 0.0), (15.0, -80.0), (-12.0, 60.0)])
def test_pressures_of_a_matched_valve_at_rest(angle: float, torque: float) -> None:
    found = run(FRICTIONLESS, 1.5, fin_command=radians(angle), aero_torque=torque)
    total = found["pressure_1"][-1] + found["pressure_2"][-1]
    assert total == pytest.approx(SUPPLY + TANK, rel=1e-6)  # exp(-15) is left of a mode with 0.1 s
    assert (found["pressure_1"][-1] - found["pressure_2"][-1]) * AREA * lever(radians(angle))[0] == pytest.approx(
        -torque, abs=0.01)


# -- invariants -------------------------------------------------------------------


def test_energy() -> None:
    """The work of supply and load equals the losses (throttling, leakage, friction, return) and the stored energy."""
    step = 2e-5
    p = {**PLAIN, "solver.max_tick": step, "kinematics.initial_angle": radians(5.0)}
    found = run(p, 0.5, step, fin_command=lambda t: radians(15.0) if t < 0.25 else radians(-10.0),
                aero_torque=lambda t: 80.0 * np.sin(30.0 * t),
                supply_pressure=lambda t: SUPPLY if t < 0.3 - step / 2 else 0.6 * SUPPLY)
    angle, rate, one, two, spool = (found[n] for n in ("fin_angle", "fin_rate", "pressure_1", "pressure_2",
                                                       "valve_position"))
    supply = np.where(found["time"] < 0.3 + step / 2, SUPPLY, 0.6 * SUPPLY)
    ratio = p["kinematics.moment_arm"] / np.cos(angle + p["kinematics.initial_angle"])**2
    k = p["valve.rated_flow"] / sqrt(p["valve.rated_pressure"] / 2.0)
    root = np.sqrt(spool**2 + p["valve.lap"]**2)

    def through(opening: Any, drop: Any) -> Any:
        return k * opening / 2.0 * drop / (drop**2 + p["valve.laminar_pressure"]**2)**0.25

    edges = [(through(root + spool, supply - one), supply - one), (through(root - spool, supply - two), supply - two),
             (through(root - spool, one - TANK), one - TANK), (through(root + spool, two - TANK), two - TANK)]
    supplied, returned = edges[0][0] + edges[1][0], edges[2][0] + edges[3][0]
    np.testing.assert_allclose(found["supply_power"][1:], (supply * supplied)[1:], rtol=1e-9, atol=1e-6)
    dry = p["friction.fin_coulomb"] + ratio * p["cylinder.coulomb_friction"]
    viscous = p["friction.fin_viscous"] + ratio**2 * p["cylinder.viscous_friction"]
    losses = {"throttling": sum(flow * drop for flow, drop in edges), "leakage": LEAK * (one - two)**2,
              "dry friction": dry * np.abs(rate), "viscous friction": viscous * rate**2,
              "return": TANK * returned}
    for name, loss in losses.items():
        assert np.all(loss >= 0.0), name
    time = found["time"]
    inertia = sum(p[f"inertia.{part}"] for part in ("fin", "shaft", "fork")) + p["cylinder.moving_mass"] * ratio**2
    piston = p["kinematics.moment_arm"] * (np.tan(angle + p["kinematics.initial_angle"])
                                           - tan(p["kinematics.initial_angle"]))
    # Flows are volumes at constant density, so V p dp/beta is stored; the rest of the work is smaller by p/beta.
    kinetic = 0.5 * inertia * rate**2
    compression = sum(float(np.sum((p["cylinder.dead_volume"] + side * AREA * (piston[1:] + piston[:-1]) / 2.0)
                                   * np.diff(chamber**2) / (2.0 * BETA)))
                      for side, chamber in ((1.0, one), (-1.0, two)))
    source = np.trapezoid(found["supply_power"], time)
    work = np.trapezoid(80.0 * np.sin(30.0 * (time - step / 2)) * rate, time)
    lost = sum(np.trapezoid(loss, time) for loss in losses.values())
    assert source > 50.0
    # Trapezoids of signals that jump at 500 samples and with the supply, of 25000 rows.
    assert source + work - lost == pytest.approx(kinetic[-1] - kinetic[0] + compression, abs=2e-3 * source)


@settings(max_examples=15)
@given(st.floats(-20.0, 20.0), st.floats(-150.0, 150.0), st.booleans())
def test_symmetric_plant_has_mirrored_response(command: float, torque: float, enable: bool) -> None:
    p = {**PLAIN, "kinematics.initial_angle": 0.0}
    one, other = (run(p, 0.1, fin_command=side * radians(command), aero_torque=side * torque, enable=enable)
                  for side in (1.0, -1.0))
    for name in ("fin_angle", "fin_rate", "valve_position"):
        np.testing.assert_allclose(one[name], -other[name], rtol=0, atol=1e-9)
    np.testing.assert_allclose(one["pressure_1"], other["pressure_2"], rtol=1e-9)


def test_fin_sticks_to_the_bit() -> None:
    """The load changes the pressures, but stays below the friction."""
    found = run({**VALUES, "fin.start_angle": radians(3.0), "loads.gravity": False}, 0.3, enable=False,
                aero_torque=lambda t: 5.0 * np.sin(40.0 * t))
    assert set(found["fin_angle"].tolist()) == {radians(3.0)}
    assert set(found["fin_rate"].tolist()) == {0.0}


EXTREMES = st.fixed_dictionaries({
    "aero_torque": st.sampled_from([0.0, 100.0, 400.0, 1e3, 1e4, -1e5]), "frequency": st.sampled_from([0.0, 30., 300.]),
    "supply_pressure": st.sampled_from([0.0, 1e5, 5e6, 21e6, 1e8]), "fin_command": st.sampled_from([0.0, 0.3, -0.3]),
    "enable": st.booleans(), "valve.lap": st.sampled_from([0.0, 0.02, 1.0]),
    "tank.pressure": st.sampled_from([0.0, 0.35e6, 30e6]), "valve.null_shift": st.sampled_from([0.0, -1.0])})


@settings(max_examples=30)
@given(EXTREMES)
def test_outputs_are_finite_and_pressures_not_negative(case: dict[str, Any]) -> None:
    """This holds under extreme pressures of line and tank, loads, laps and null shifts."""
    p = {**VALUES, **{n: case[n] for n in ("valve.lap", "tank.pressure", "valve.null_shift")}}
    found = run(p, 0.1, fin_command=case["fin_command"], enable=case["enable"],
                supply_pressure=lambda t: 21e6 if t < 0.02 else case["supply_pressure"],
                aero_torque=lambda t: case["aero_torque"] * np.cos(case["frequency"] * t) if t > 0.03 else 0.0)
    for name, column in found.items():
        assert np.all(np.isfinite(column)), name
    assert min(found["pressure_1"].min(), found["pressure_2"].min()) >= 0.0
    assert np.abs(found["fin_angle"]).max() <= VALUES["fin.stop_angle"]
    assert np.abs(found["valve_position"]).max() <= 1.0


def test_a_fast_spool_reverses_within_a_tick_from_one_speed_limit_to_the_other() -> None:
    """In a tick this spool could change its speed by 50 times the limit."""
    p = {**VALUES, "valve.natural_frequency": 3e3, "valve.stroke_time": 0.05}
    found = run(p, 0.06, 1e-4, fin_command=lambda t: 0.3 if t < 0.04 else -0.3)
    position = found["valve_position"]
    assert position.max() > 0.7 > 0.5 > position[-1]
    assert np.abs(np.diff(position)).max() <= 1e-4 / 0.05 * (1.0 + 1e-9)


def test_a_chamber_is_refilled_from_the_tank() -> None:
    """With the supply lost and a load that moves the fin, pressures stay above tank pressure less the valves' drop."""
    found = run(VALUES, 0.3, 1e-4, aero_torque=lambda t: 200.0 * np.sin(50.0 * t), enable=False,
                supply_pressure=lambda t: SUPPLY if t < 0.02 else 0.0)
    lowest = min(found["pressure_1"].min(), found["pressure_2"].min())
    ratio = max(lever(angle)[0] for angle in found["fin_angle"])
    # The check valve replaces the flow that the piston displaces, and that through half the lap into the supply line.
    k = VALUES["valve.rated_flow"] / sqrt(VALUES["valve.rated_pressure"] / 2.0)
    flow = AREA * ratio * np.abs(found["fin_rate"]).max() + k * VALUES["valve.lap"] / 2.0 * sqrt(TANK)
    assert TANK > lowest >= TANK - flow / VALUES["check_valve.conductance"]


def test_a_load_beyond_stall_returns_power_to_the_supply() -> None:
    found = run(VALUES, 0.2, fin_command=radians(10.0), aero_torque=lambda t: -500.0 if t > 0.05 else 0.0)
    assert found["pressure_1"].max() > SUPPLY
    assert found["supply_power"].min() < -100.0
    assert found["at_stop"][-1]


def test_disabled_valve_centres_and_the_oil_holds_the_fin() -> None:
    found = run(VALUES, 0.5, fin_command=radians(10.0), enable=lambda t: t < 0.2, aero_torque=-100.0)
    assert abs(found["valve_position"][-1]) < 1e-3
    # Leakage allows K_ce T/(A R)^2 = 12 deg/s; a free fin would reach its stop in a tenth of the time.
    assert found["fin_angle"][200] > found["fin_angle"][-1] > 0.0


def test_null_shift_drives_hard_over_and_air_softens_the_oil() -> None:
    """These are the parameters that faults change."""
    hard_over = run({**VALUES, "valve.null_shift": 2.0}, 0.3)
    assert hard_over["at_stop"][-1]
    soft, stiff = (run({**VALUES, "oil.bulk_modulus": beta}, 0.2, aero_torque=lambda t: 150.0 if t > 0.05 else 0.0)
                   for beta in (2e8, 7e8))
    assert soft["fin_angle"].max() > 1.2 * stiff["fin_angle"].max()


def test_deviations_leave_the_final_angle_and_change_the_rate() -> None:
    """The transducer is on the fin, so a lever that is 1 % longer than nominal causes no error."""
    built = {**VALUES, "deviation.kinematics.moment_arm": 0.01, "deviation.valve.rated_flow": 0.1,
             "deviation.kinematics.initial_angle": radians(0.5)}
    found, plain = (run(p, 0.6, fin_command=radians(10.0)) for p in (built, VALUES))
    assert degrees(found["fin_angle"][-1]) == pytest.approx(10.0, abs=0.01)
    # 10 % more flow give 10 % more rate, less 1 % for the arm, 0.2 % for the angle, and viscous friction.
    assert 1.05 < found["fin_rate"].max() / plain["fin_rate"].max() < 1.09


# -- rules ------------------------------------------------------------------------


def test_dead_volume_below_the_displaced_volume_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"cylinder\.dead_volume = 5e-06 m3 must be more than the volume"):
        run({**VALUES, "cylinder.dead_volume": 5e-6}, 0.01)


@pytest.mark.slow
def test_kernels_agree() -> None:
    run_both_kernels(VALUES, 0.2, MODEL, fin_command=radians(10.0),
                     aero_torque=lambda t: 300.0 * np.sin(60.0 * t),
                     supply_pressure=lambda t: SUPPLY if t < 0.1 else 0.0)


def test_an_event_margin_that_first_grows_does_not_stall_the_run() -> None:
    """A chamber is slightly above tank pressure while the fin leaves a stop; a secant misses the margin's zero."""
    def levels_of_11_ms(*levels: Any) -> Any:
        return lambda t: levels[min(int((t + 1e-9) / 0.011), 3)]

    found = run(VALUES, 0.05, fin_command=0.0, aero_torque=levels_of_11_ms(4358.0, 4178.0, 3529.0, -4288.0),
                enable=levels_of_11_ms(True, True, False, True),
                supply_pressure=levels_of_11_ms(24.18e6, 25.77e6, 0.0, 13.58e6))
    assert np.all(np.isfinite(found["pressure_1"]))
