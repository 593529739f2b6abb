"""The elastic drive line against closed forms, an independent integration and the rigid actuator."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, radians, sin, sqrt, tan, tanh
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.modes import load_rod, thesis_modes
from tests.default_actuator import THESIS_LOOPS
from tests.marks import slow
from tests.runs import input_levels, run_within_stops
from tests.simulation import nested

from .checks import convergence_order, oscillation_frequency
from .line import DRY, HINGE, MODEL, RIGID, SMOOTH, motor_angle_of, run_of, values_of

# -- modes ------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["axial", "torsional"])
def test_modes_of_table_1(mode: str) -> None:
    """With one spring, the inertia of Table 1 and a fin that hardly moves, the response to a pulse has the mode's peak.
    """
    base = values_of()
    nut = base["mass.nut"] * base["screw.lead"]**2
    other = {"axial": "torsional", "torsional": "axial"}[mode]
    run = run_of({**SMOOTH, "drive_line.backlash": 0.0, f"drive_line.{other}_compliance": 0.0,
                  "inertia.motor": load_rod()["thesis.inertia"] - base["inertia.screw"] - nut, "inertia.fin": 1e3},
                 2.0, 2e-4, enable=False, acceleration__x=lambda t: 50.0 if t < 1e-3 else 0.0)
    spectrum = np.abs(np.fft.rfft(run["motor_speed"], 1 << 17))  # the pulse is far shorter than a period
    peak = np.fft.rfftfreq(1 << 17, 2e-4)[np.argmax(spectrum)]
    expected = thesis_modes()[f"{mode}_hz"]
    assert expected == pytest.approx({"axial": 67.0, "torsional": 222.0}[mode], rel=0.01)
    assert peak == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("springs", ["both", "axial", "torsional"])
def test_free_mode_of_rotor_and_fin(springs: str) -> None:
    """Rotor and fin oscillate at sqrt(K (1/J_1 + 1/J_2)).

    The midpoint rule lengthens the period by (w h)^2/12: by 4e-3 with the shaft alone, at ticks of 0.02 ms.
    """
    rigid = {"both": {}, "axial": {"drive_line.torsional_compliance": 0.0},
             "torsional": {"drive_line.axial_compliance": 0.0}}[springs]
    values = values_of({**SMOOTH, **rigid, "drive_line.backlash": 0.0, "drive_line.axial_damping": 0.0,
                      "drive_line.torsional_damping": 0.0, "solver.max_tick": 2e-5})
    p = nested(values, MODEL)
    run = simulate(values, 0.1, 2e-5, model=MODEL, enable=False, aero_torque=lambda t: 50.0 if t < 2e-4 else 0.0)
    twist = run["motor_angle"] - motor_angle_of(values, run["fin_angle"])
    compliance = p.drive_line.torsional_compliance + p.drive_line.axial_compliance / p.screw.lead**2
    fin = drive_line.fin_side(FLOATS, p, 0.0).inertia
    expected = sqrt((1.0 / mechanics.screw_inertia(p) + 1.0 / fin) / compliance) / (2.0 * pi)
    # The fin's inertia at the motor depends on the lever's angle; it varies by less than 0.5 % during the motion.
    assert oscillation_frequency(np.diff(twist)[20:], 2e-5) == pytest.approx(expected, rel=6e-3)


# -- the rigid limit, independent integrations, convergence ------------------------


@pytest.mark.parametrize("on_fin", [False, True])
def test_rigid_drive_line_equals_the_nonlinear_actuator_to_the_bit(on_fin: bool) -> None:
    values = values_of({**RIGID, "encoder.on_fin": on_fin})
    plain = {name: value for name, value in values.items() if not name.startswith("drive_line.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
                              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.3 < t < 0.35}
    elastic, nonlinear = simulate(values, 0.5, model=MODEL, **inputs), simulate(plain, 0.5, **inputs)
    for name, expected in nonlinear.items():
        assert np.array_equal(elastic[name], expected), name


def test_stiff_drive_line_tends_to_the_nonlinear_actuator() -> None:
    def difference(share: float) -> float:
        values = values_of({"drive_line.axial_compliance": 1.2e-8 * share, "drive_line.torsional_compliance": 0.0,
                            "drive_line.backlash": 0.0})
        plain = {name: value for name, value in values.items() if not name.startswith("drive_line.")}
        runs = [simulate(v, 0.3, model=m, fin_command=0.1, aero_torque=-50.0)
                for v, m in ((values, MODEL), (plain, "nonlinear"))]
        return float(np.degrees(np.abs(runs[0]["fin_angle"] - runs[1]["fin_angle"]).max()))

    # 50 N.m deflect 2.1e5 N.m/rad by 0.014 deg, in proportion to the compliance; counts of 7e-4 deg remain.
    assert 0.01 < difference(1.0) < 0.05
    assert difference(1e-3) < 1e-3


def _integrated(v: Mapping[str, Any], stop: float, command: float, torque: float) -> Any:
    """Return the fin angle [rad] at the samples from forces along the screw, integrated by SciPy.

    Dry friction is softened: it reaches its limit at about 1e-3 rad/s of the rotor and 1/63 of this at the fin.
    """
    arm, lead, start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
    rotor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * lead**2
    fin_inertia = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    gap, supply = v["drive_line.backlash"], v["drive.supply_voltage"]
    springs = [(v["drive_line.axial_compliance"], v["drive_line.axial_damping"]),
               (v["drive_line.torsional_compliance"] * lead**2, v["drive_line.torsional_damping"] / lead**2)]
    if gap:
        springs.append((1.0 / v["drive_line.contact_stiffness"], v["drive_line.contact_damping"]))
    stiffnesses = [v[f"drive_line.{name}_stiffness"] for name in ("fork", "shaft", "structure")]
    about_hinge = sum(1.0 / k for k in stiffnesses if k)
    polynomial = {way: [v[f"friction.coulomb.{way}[{n}]"] for n in range(7)] for way in ("positive", "negative")}

    def force(stretch: float, rate: float, lever: float) -> float:
        in_series = [*springs, (lever**2 * about_hinge, v["drive_line.hinge_damping"] / lever**2)]
        compliance = sum(c for c, _ in in_series)
        damping = sum(d * (c / compliance)**2 for c, d in in_series)
        if not gap:
            return float(stretch / compliance + damping * rate)
        side = 1.0 if stretch > 0.0 else -1.0
        beyond = side * stretch - 0.5 * gap
        return float(side * max(beyond / compliance + damping * side * rate, 0.0)) if beyond > 0.0 else 0.0

    def slope(_: float, y: Any, i_ref: float) -> list[float]:
        theta, w, i, xi, fin, rate = y.tolist()  # floats are twice as fast as NumPy's numbers
        lever = arm / cos(fin + start)**2
        f = force(lead * theta - arm * (tan(fin + start) - tan(start)), lead * w - lever * rate, lever)
        way = "positive" if w > 0.0 else "negative"
        dry = sum(c * (fin / radians(20.0))**n for n, c in enumerate(polynomial[way])) * tanh(w / 1e-3)
        demand = v["drive.kp"] * (i_ref - i) + xi
        volts = max(-supply, min(supply, demand))
        return [w, (v["motor.torque_constant"] * i - v[f"friction.viscous.{way}"] * w - dry - lead * f) / rotor,
                (volts - v["motor.resistance"] * i - v["motor.back_emf_constant"] * w) / v["motor.inductance"],
                v["drive.ki"] * (i_ref - i) if abs(demand) < supply else 0.0, rate,
                (lever * f + torque - v["friction.fin_coulomb"] * tanh(rate / 1.6e-5)) / fin_inertia]

    y, integral, period, angles = np.zeros(6), 0.0, v["controller.sample_time"], [0.0]
    delayed = [0.0] * round(v["drive.transport_delay"] / period)
    for _ in range(round(stop / period)):
        error = arm / lead * (tan(command + start) - tan(start)) - y[0]
        raw = v["controller.position.kp"] * error + integral
        speed = float(np.clip(raw, -v["controller.speed_limit"], v["controller.speed_limit"]))
        integral += period * (v["controller.position.ki"] * error + v["controller.antiwindup"] * (speed - raw))
        delayed.append(float(np.clip(v["controller.velocity.kp"] * (speed - y[1]), -10.0, 10.0)))
        i_ref = float(np.clip(v["drive.current_gain"] * delayed.pop(0) + v["drive.current_offset"], -60.0, 60.0))
        y = solve_ivp(slope, (0.0, period), y, "Radau", args=(i_ref,), rtol=1e-9, atol=1e-10).y[:, -1]
        angles.append(y[4])
    return np.array(angles)


# The independent integration has the thesis's controllers, without encoder and compensation.
_IDEAL = {"encoder.enabled": False, "compensation.gain": 0.0, "drive.transport_delay": 3e-3, **THESIS_LOOPS}
_TICK_CASES: Any = (
    (5e-5, 0.05, 0.0, {}, 8e-4), (5e-5, 0.05, -30.0, {}, 4e-4), (0.0, 0.05, -30.0, {}, 4e-4),
    (5e-5, 0.3, 10.0, {}, 1e-3), (3e-4, 0.3, 10.0, {}, 5e-3), (5e-5, 0.3, 0.0, {}, 6e-3))


# Limits [deg] are about twice the measured 0.0002, 0.0004, 0.0002, 0.0001, 0.0005, 0.0022 and 0.0028. An unloaded fin
# crosses its gap on the way; in a wide one it bounces, and each contact enlarges the error that earlier ones have left.
@pytest.mark.parametrize(("gap", "command", "torque", "hinge", "limit", "stop"), [
    (5e-5, 0.3, 10.0, HINGE, 4e-4, 0.08),  # the error is largest at 0.071 s
    *slow(*((*case, 0.15) for case in _TICK_CASES))])
def test_default_tick_against_an_independent_integration(gap: float, command: float, torque: float,
                                                         hinge: Mapping[str, float], limit: float, stop: float) -> None:
    values = values_of({**_IDEAL, **hinge, "drive_line.backlash": gap})
    angle = simulate(values, stop, model=MODEL, fin_command=command, aero_torque=torque)["fin_angle"]
    assert np.degrees(np.abs(angle - _integrated(values, stop, command, torque)).max()) < limit


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("encoder", [False, True])
@pytest.mark.parametrize("step", [-10.0, 3.0, 20.0])
def test_an_unloaded_fin_comes_to_rest_in_its_gap_by_hinge_friction(step: float, encoder: bool) -> None:
    """Without this friction it keeps moving by up to the whole gap, 0.057 deg."""
    def drift(friction: float) -> float:
        run = run_of({"friction.fin_coulomb": friction, "encoder.enabled": encoder}, 2.0, fin_command=radians(step))
        return float(np.degrees(np.ptp(run["fin_angle"][1500:])))

    # After 1.5 s the position integral still moves the fin by up to 0.0006 deg; without friction 0.034 to 0.057 deg.
    assert drift(values_of()["friction.fin_coulomb"]) < 1.2e-3
    assert drift(0.0) > 0.02


@pytest.mark.parametrize(("step", "limit"), [(3.0, 8e-4), (20.0, 3e-3)])
def test_unloaded_steps_converge_to_second_order(step: float, limit: float) -> None:
    """Limits [deg] at the default tick, relative to ticks of 2 us, are twice the measured 0.0004 and 0.0015 deg."""
    def angle(tick: float) -> Any:
        return run_of({"encoder.enabled": False, "solver.max_tick": tick}, 0.4, fin_command=radians(step))["fin_angle"]

    fine = angle(2e-6)
    ticks = (1e-4, 5e-5, 2.5e-5)
    errors = [float(np.degrees(np.abs(angle(tick) - fine).max())) for tick in ticks]
    assert errors[1] < limit
    assert convergence_order(ticks, errors) == pytest.approx(2.0, abs=0.2), errors


@pytest.mark.slow
def test_second_order_convergence_through_contacts_and_voltage_limits() -> None:
    """There is no dry friction, which the independent integration softens."""
    values = values_of({**_IDEAL, **DRY})
    exact = _integrated(values, 0.15, 0.3, 10.0)
    ticks, errors = (2e-4, 1e-4, 5e-5, 2.5e-5), []
    for tick in ticks:
        run = simulate({**values, "solver.max_tick": tick}, 0.15, model=MODEL, fin_command=0.3, aero_torque=10.0)
        errors.append(np.abs(run["fin_angle"] - exact).max())
    assert convergence_order(ticks, errors) == pytest.approx(2.0, abs=0.15), errors


@pytest.mark.kernel(MODEL)
@settings(derandomize=True, max_examples=75)
@given(levels=input_levels(8), axial=st.sampled_from([0.0, 1e-12, 1e-8, 1e-5]),
       torsional=st.sampled_from([0.0, 1e-8, 1e-3, 1.0]), gap=st.sampled_from([0.0, 1e-6, 5e-5, 1e-3]),
       damping=st.sampled_from([0.0, 1e4, 1e7]), hinge=st.sampled_from([0.0, 1.0, 1e4, 1e9]),
       dry=st.sampled_from([0.0, 5.0]), on_fin=st.booleans(), tick=st.sampled_from([2e-5, 5e-5, 1e-3]))
def test_outputs_are_finite_and_the_fin_within_its_stops(
        levels: list[Any], axial: float, torsional: float, gap: float, damping: float, hinge: float, dry: float,
        on_fin: bool, tick: float) -> None:
    values = values_of({
        "drive_line.axial_compliance": axial, "drive_line.torsional_compliance": torsional, "drive_line.backlash": gap,
        "drive_line.contact_damping": damping, "friction.fin_coulomb": dry, "drive_line.shaft_stiffness": hinge,
        "drive_line.hinge_damping": 10.0 * hinge**0.5, "encoder.on_fin": on_fin, "solver.max_tick": tick})
    run_within_stops(values, MODEL, levels)


def test_friction_of_the_fin_holds_it_to_the_bit() -> None:
    run = run_of({"friction.fin_coulomb": 5.0}, 0.2, enable=False, aero_torque=lambda t: 4.9 if t < 0.1 else 5.1)
    assert np.ptp(run["fin_angle"][:101]) == 0.0
    assert run["fin_angle"][-1] > 1e-4
    assert not run["motor_angle"].any()  # its friction holds the rotor


@pytest.mark.parametrize(("name", "value"), [
    ("drive_line.axial_compliance", -1e-9), ("drive_line.torsional_compliance", -1.0), ("drive_line.backlash", -1e-6),
    ("drive_line.backlash", 0.02), ("drive_line.contact_stiffness", 0.0), ("drive_line.contact_damping", -1.0),
    ("drive_line.axial_damping", float("nan")), ("drive_line.backlash", "0.1 deg"),
    ("drive_line.shaft_stiffness", -1.0), ("drive_line.fork_stiffness", "1 N/m")])
def test_bad_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        values_of({name: value})
