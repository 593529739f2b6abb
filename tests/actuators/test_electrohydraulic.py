"""The electrohydraulic actuator: closed forms, invariants and what happens at its limits."""

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

MODEL = "electrohydraulic"
VALUES = dict(load_parameters(model=MODEL).values)
# Without steps of the transducer, gains that do not move with the shipped ones.
PLAIN = {**VALUES, "transducer.resolution": 0.0, "controller.position.kp": 90.0, "controller.position.ki": 500.0,
         "controller.position.setpoint_weight": 1.0}
FRICTIONLESS = {**PLAIN, "friction.fin_coulomb": 0.0, "cylinder.coulomb_friction": 0.0}
SUPPLY, TANK = VALUES["hydraulic_supply.pressure"], VALUES["tank.pressure"]
AREA, LEAK, BETA = (VALUES[n] for n in ("cylinder.area", "cylinder.internal_leakage", "oil.bulk_modulus"))
Signal = float | bool | Callable[[float], float]


def run(values: dict[str, Any], stop: float, step: float = 1e-3, **inputs: Signal) -> dict[str, Any]:
    return simulate(values, stop, step, "auto", MODEL, **inputs)


def lever(angle: float, values: dict[str, Any] = VALUES) -> tuple[float, float]:
    """The piston's displacement per angle [m/rad] and its slope [m/rad2]."""
    at = angle + values["kinematics.initial_angle"]
    ratio = values["kinematics.moment_arm"] / cos(at)**2
    return ratio, 2.0 * ratio * tan(at)


def fin_inertia(angle: float = 0.0) -> float:
    fin = sum(VALUES[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    return fin + VALUES["cylinder.moving_mass"] * lever(angle)[0]**2


def load_flow(spool: float, load_pressure: float) -> float:
    """Flow to the cylinder [m3/s] of a matched valve, of edges with a root that is sharp."""
    def edge(z: float) -> float:
        return (z + sqrt(z * z + VALUES["valve.lap"]**2)) / 2.0

    above, below = ((SUPPLY - TANK + sign * load_pressure) / 2.0 for sign in (-1.0, 1.0))
    k = VALUES["valve.rated_flow"] / sqrt(VALUES["valve.rated_pressure"] / 2.0)
    return k * (edge(spool) * sqrt(above) - edge(-spool) * sqrt(below))


# -- closed forms -----------------------------------------------------------------


@pytest.mark.parametrize(("torque", "published"), [(0.0, 276.3), (-100.0, 211.6), (100.0, 331.6)])
def test_rate_of_the_open_valve(torque: float, published: float) -> None:
    """Q_r sqrt((p_s - p_t - P_L)/dp_r) = A R w + C_ip P_L, with P_L of load, friction and the piston's mass."""
    ratio, bend = lever(0.0)
    dry = VALUES["friction.fin_coulomb"] + ratio * VALUES["cylinder.coulomb_friction"]
    viscous = VALUES["friction.fin_viscous"] + ratio**2 * VALUES["cylinder.viscous_friction"]

    def balance(rate: float) -> float:
        swing = VALUES["cylinder.moving_mass"] * ratio * bend * rate**2
        load = (dry + viscous * rate + swing - torque) / (AREA * ratio)
        return load_flow(1.0, load) - AREA * ratio * rate - LEAK * load

    expected = brentq(balance, 0.0, 20.0)
    wide = {**PLAIN, "controller.position.kp": 1e4}
    found = run(wide, 0.4, 1e-4, fin_command=lambda t: radians(-20.0 if t < 0.2 else 20.0),
                aero_torque=lambda t: torque if t > 0.2 else 0.0)
    slewing = found["time"] > 0.2
    rate = float(np.interp(0.0, found["fin_angle"][slewing], found["fin_rate"][slewing]))
    # The rate falls with the lever as the fin turns, which takes some of the pressure: 0.3 % are found.
    assert rate == pytest.approx(expected, rel=0.005)
    # What docs/model/electrohydraulic.md says, to the arm of 50 mm in place of R: cos(5 deg)^2, 0.8 %.
    assert degrees(expected) == pytest.approx(published, rel=0.008)


def test_hydraulic_frequency_and_damping() -> None:
    """w_h = sqrt(4 beta A^2 R^2/(V_t J)); at null each edge lets lap/2 through, of which the flow falls with p_L."""
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


def test_stall() -> None:
    """A R (p_s - p_t) and friction: the open valve moves the fin against less, and gives way to more."""
    ratio = lever(0.0)[0]
    dry = VALUES["friction.fin_coulomb"] + ratio * VALUES["cylinder.coulomb_friction"]
    stall = AREA * ratio * (SUPPLY - TANK)
    wide = {**PLAIN, "controller.position.kp": 1e4}
    # Edges with a lap that leak take 0.01 % of the pressure, leakage across the piston C_ip p/(K sqrt(p)) squared, 1 %.
    for torque, moves in ((0.975 * stall - dry, 1.0), (1.005 * stall + dry, -1.0)):
        # On the load's side before the command: from rest at 0, the valve open.
        load = [0.0] * 10 + [-torque] * 91
        found = simulate(wide, 0.1, model=MODEL, fin_command=radians(5.0), aero_torque=load)
        assert moves * (found["fin_angle"][-1] - found["fin_angle"][40]) > radians(0.05)


def test_droop_of_proportional_control() -> None:
    """Against a load a flow of K_ce P_L leaks, which the spool has to let in: an error without integral action."""
    torque = 100.0
    p = {**FRICTIONLESS, "controller.position.ki": 0.0}
    found = run(p, 1.0, aero_torque=torque)["fin_angle"][-1]
    load = -torque / (AREA * lever(found)[0])
    spool = brentq(lambda z: load_flow(z, load) - LEAK * load, -1.0, 1.0)
    speed = spool * VALUES["valve.rated_flow"] / AREA
    piston = VALUES["kinematics.moment_arm"] * (tan(found + VALUES["kinematics.initial_angle"])
                                                - tan(VALUES["kinematics.initial_angle"]))
    # The smoothed root differs from a sharp one by (dp_0/dp)^2/4, 5e-5 at the smallest drop here.
    assert -piston * p["controller.position.kp"] == pytest.approx(speed, rel=1e-3)
    # And with integral action none is left.
    assert abs(run(FRICTIONLESS, 1.0, aero_torque=torque)["fin_angle"][-1]) < radians(1e-3)


@pytest.mark.parametrize(("angle", "torque"), [(0.0, 0.0), (15.0, -80.0), (-12.0, 60.0)])
def test_pressures_of_a_matched_valve_at_rest(angle: float, torque: float) -> None:
    found = run(FRICTIONLESS, 1.5, fin_command=radians(angle), aero_torque=torque)
    total = found["pressure_1"][-1] + found["pressure_2"][-1]
    assert total == pytest.approx(SUPPLY + TANK, rel=1e-6)  # what a slow mode of 0.1 s leaves after 1.5 s
    assert (found["pressure_1"][-1] - found["pressure_2"][-1]) * AREA * lever(radians(angle))[0] == pytest.approx(
        -torque, abs=0.01)


# -- invariants -------------------------------------------------------------------


def test_energy() -> None:
    """Line and load do what throttling, leakage, friction and the check valves lose and oil and fin store."""
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
    drawn, returned = edges[0][0] + edges[1][0], edges[2][0] + edges[3][0]
    np.testing.assert_allclose(found["supply_power"][1:], (supply * drawn)[1:], rtol=1e-9, atol=1e-6)
    dry = p["friction.fin_coulomb"] + ratio * p["cylinder.coulomb_friction"]
    viscous = p["friction.fin_viscous"] + ratio**2 * p["cylinder.viscous_friction"]
    losses = {"throttling": sum(flow * drop for flow, drop in edges), "leakage": LEAK * (one - two)**2,
              "dry friction": dry * np.abs(rate), "viscous friction": viscous * rate**2,
              "return": TANK * returned}
    for name, loss in losses.items():
        assert np.all(loss >= 0.0), name
    time = found["time"]
    inertia = sum(p[f"inertia.{part}"] for part in ("fin", "shaft", "fork")) + p["cylinder.moving_mass"] * ratio**2
    way = p["kinematics.moment_arm"] * (np.tan(angle + p["kinematics.initial_angle"])
                                        - tan(p["kinematics.initial_angle"]))
    # Flows are of volume at constant density: what p dV does between p^2/(2 beta) V is left out, p/beta of the work.
    stored = 0.5 * inertia * rate**2
    pressed = sum(float(np.sum((p["cylinder.dead_volume"] + side * AREA * (way[1:] + way[:-1]) / 2.0)
                               * np.diff(chamber**2) / (2.0 * BETA))) for side, chamber in ((1.0, one), (-1.0, two)))
    source = np.trapezoid(found["supply_power"], time)
    work = np.trapezoid(80.0 * np.sin(30.0 * (time - step / 2)) * rate, time)
    lost = sum(np.trapezoid(loss, time) for loss in losses.values())
    left = stored[-1] - stored[0] + pressed
    assert source > 50.0
    # The trapezia of signals that jump with the samples and the supply: 25000 steps, of which 500 have a jump.
    assert source + work - lost == pytest.approx(left, abs=2e-3 * source)


@settings(max_examples=15)
@given(st.floats(-20.0, 20.0), st.floats(-150.0, 150.0), st.booleans())
def test_a_symmetric_plant_is_symmetric(command: float, torque: float, enable: bool) -> None:
    p = {**PLAIN, "kinematics.initial_angle": 0.0}
    one, other = (run(p, 0.1, fin_command=side * radians(command), aero_torque=side * torque, enable=enable)
                  for side in (1.0, -1.0))
    for name in ("fin_angle", "fin_rate", "valve_position"):
        np.testing.assert_allclose(one[name], -other[name], rtol=0, atol=1e-9)
    np.testing.assert_allclose(one["pressure_1"], other["pressure_2"], rtol=1e-9)


def test_stick_leaves_the_angle_to_the_bit() -> None:
    """Pressures move, below what friction holds."""
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
def test_pressures_stay_at_or_above_nothing(case: dict[str, Any]) -> None:
    """Whatever line, tank and load: steps come to their end, and no chamber is pulled below a void."""
    p = {**VALUES, **{n: case[n] for n in ("valve.lap", "tank.pressure", "valve.null_shift")}}
    found = run(p, 0.1, fin_command=case["fin_command"], enable=case["enable"],
                supply_pressure=lambda t: 21e6 if t < 0.02 else case["supply_pressure"],
                aero_torque=lambda t: case["aero_torque"] * np.cos(case["frequency"] * t) if t > 0.03 else 0.0)
    for name, column in found.items():
        assert np.all(np.isfinite(column)), name
    assert min(found["pressure_1"].min(), found["pressure_2"].min()) >= 0.0
    assert np.abs(found["fin_angle"]).max() <= VALUES["fin.stop_angle"]
    assert np.abs(found["valve_position"]).max() <= 1.0


def test_a_chamber_is_refilled_from_the_tank() -> None:
    """The line lost and a load that drags: no pressure is further below the tank's than the check valve's drop."""
    found = run(VALUES, 0.3, 1e-4, aero_torque=lambda t: 200.0 * np.sin(50.0 * t), enable=False,
                supply_pressure=lambda t: SUPPLY if t < 0.02 else 0.0)
    lowest = min(found["pressure_1"].min(), found["pressure_2"].min())
    ratio = max(lever(angle)[0] for angle in found["fin_angle"])
    # Out of the chamber go what the piston sweeps and, through half the lap, what runs back into the line.
    k = VALUES["valve.rated_flow"] / sqrt(VALUES["valve.rated_pressure"] / 2.0)
    flow = AREA * ratio * np.abs(found["fin_rate"]).max() + k * VALUES["valve.lap"] / 2.0 * sqrt(TANK)
    assert TANK > lowest >= TANK - flow / VALUES["check_valve.conductance"]


def test_a_load_turns_the_flow_back_into_the_line() -> None:
    """Beyond the stall an open valve lets the oil out: the line takes power."""
    found = run(VALUES, 0.2, fin_command=radians(10.0), aero_torque=lambda t: -500.0 if t > 0.05 else 0.0)
    assert found["pressure_1"].max() > SUPPLY
    assert found["supply_power"].min() < -100.0
    assert found["at_stop"][-1]


def test_disabled_the_valve_centres_and_the_oil_holds() -> None:
    found = run(VALUES, 0.5, fin_command=radians(10.0), enable=lambda t: t < 0.2, aero_torque=-100.0)
    assert abs(found["valve_position"][-1]) < 1e-3
    # What leaks holds it to K_ce T/(A R)^2, 12 deg/s: a free fin would be at its stop in a tenth of the time.
    assert found["fin_angle"][200] > found["fin_angle"][-1] > 0.0


def test_hard_over_and_an_oil_with_air() -> None:
    """What faults do to parameters: no reference, the null at the end of the stroke; a softer spring."""
    over = run({**VALUES, "valve.null_shift": 2.0}, 0.3)
    assert over["at_stop"][-1]
    soft, stiff = (run({**VALUES, "oil.bulk_modulus": beta}, 0.2, aero_torque=lambda t: 150.0 if t > 0.05 else 0.0)
                   for beta in (2e8, 7e8))
    assert soft["fin_angle"].max() > 1.2 * stiff["fin_angle"].max()


def test_what_the_controller_does_not_know() -> None:
    """A lever as built 1 % longer than known: the transducer is on the fin, so that the angle is right all the same.
    """
    built = {**VALUES, "deviation.kinematics.moment_arm": 0.01, "deviation.valve.rated_flow": 0.1,
             "deviation.kinematics.initial_angle": radians(0.5)}
    found, plain = (run(p, 0.6, fin_command=radians(10.0)) for p in (built, VALUES))
    assert degrees(found["fin_angle"][-1]) == pytest.approx(10.0, abs=0.01)
    # 10 % of flow are 10 % of the rate, less 1 % of the arm, 0.2 % of the angle and what viscous friction takes.
    assert 1.05 < found["fin_rate"].max() / plain["fin_rate"].max() < 1.09


# -- rules ------------------------------------------------------------------------


def test_a_stroke_that_the_dead_volume_has_not_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"cylinder\.dead_volume = 5e-06 m3 must be more than the volume"):
        run({**VALUES, "cylinder.dead_volume": 5e-6}, 0.01)


@pytest.mark.slow
def test_both_back_ends_give_the_same_bits() -> None:
    python, native = (simulate(VALUES, 0.2, kernel=kernel, model=MODEL, fin_command=radians(10.0),
                               aero_torque=lambda t: 300.0 * np.sin(60.0 * t),
                               supply_pressure=lambda t: SUPPLY if t < 0.1 else 0.0)
                      for kernel in ("python", "compiled"))
    for name, column in python.items():
        np.testing.assert_array_equal(column, native[name], err_msg=name)


def test_a_margin_that_first_grows_costs_no_events() -> None:
    """A chamber a hair above the tank's pressure as the fin leaves a stop: its zero is not where a secant has it."""
    def pieces(*levels: Any) -> Any:
        return lambda t: levels[min(int((t + 1e-9) / 0.011), 3)]

    found = run(VALUES, 0.05, fin_command=0.0, aero_torque=pieces(4358.0, 4178.0, 3529.0, -4288.0),
                enable=pieces(True, True, False, True), supply_pressure=pieces(24.18e6, 25.77e6, 0.0, 13.58e6))
    assert np.all(np.isfinite(found["pressure_1"]))
