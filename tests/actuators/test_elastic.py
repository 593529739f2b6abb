"""The elastic drive line: against closed forms, an independent integration, and the rigid actuator."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, exp, hypot, pi, radians, sin, sqrt, tan, tanh
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emcas_fmu.actuators.two_inertias import Pair, advance
from emcas_fmu.analysis.modes import load_rod, thesis_modes
from emcas_fmu.integrate import Boundary
from emcas_fmu.kernels import compiled
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import drive_line, mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.tree import changed, tree

MODEL = "elastic"
BASE = load_parameters(model=MODEL)
DRY = {f"friction.coulomb.{way}[{n}]": 0.0 for way in ("positive", "negative") for n in range(7)}
SMOOTH = {**DRY, "friction.viscous.positive": 0.0, "friction.viscous.negative": 0.0}
RIGID = {"drive_line.axial_compliance": 0.0, "drive_line.torsional_compliance": 0.0, "drive_line.backlash": 0.0}


def _values(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    return BASE.replace(overrides or {}).values


def _run(overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(_values(overrides), stop, step, model=MODEL, **inputs)


# -- modes ------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["axial", "torsional"])
def test_the_modes_of_table_1(mode: str) -> None:
    """One spring at a time with all of Table 1's inertia on it and the fin held: the peak of the frequency response."""
    base = _values()
    nut = base["mass.nut"] * base["screw.lead"]**2
    other = {"axial": "torsional", "torsional": "axial"}[mode]
    run = _run({**SMOOTH, "drive_line.backlash": 0.0, f"drive_line.{other}_compliance": 0.0,
                "inertia.motor": load_rod()["thesis.inertia"] - base["inertia.screw"] - nut, "inertia.fin": 1e3},
               2.0, 2e-4, enable=False, acceleration__x=lambda t: 50.0 if t < 1e-3 else 0.0)
    spectrum = np.abs(np.fft.rfft(run["motor_speed"], 1 << 17))  # of a pulse far shorter than a period
    found = np.fft.rfftfreq(1 << 17, 2e-4)[np.argmax(spectrum)]
    modes = thesis_modes(load_rod())
    expected = modes.axial if mode == "axial" else modes.torsional
    assert expected == pytest.approx({"axial": 67.0, "torsional": 222.0}[mode], rel=0.01)
    assert found == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("springs", ["both", "axial", "torsional"])
def test_free_mode_of_rotor_and_fin(springs: str) -> None:
    """sqrt(K (1/J_1 + 1/J_2)); midpoint lengthens a period by (w h)^2/12, 4e-3 for the shaft alone at 0.02 ms."""
    rigid = {"both": {}, "axial": {"drive_line.torsional_compliance": 0.0},
             "torsional": {"drive_line.axial_compliance": 0.0}}[springs]
    values = _values({**SMOOTH, **rigid, "drive_line.backlash": 0.0, "drive_line.axial_damping": 0.0,
                      "drive_line.torsional_damping": 0.0, "solver.max_tick": 2e-5})
    p = tree(values)
    run = simulate(values, 0.1, 2e-5, model=MODEL, enable=False, aero_torque=lambda t: 50.0 if t < 2e-4 else 0.0)
    twist = run["motor_angle"] - kinematics_of_fin(values, run["fin_angle"])
    rate = np.diff(twist)[20:]
    crossings = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    times = crossings - rate[crossings] / (rate[crossings + 1] - rate[crossings])
    found = (len(times) - 1) / ((times[-1] - times[0]) * 2e-5)
    square = p.screw.lead**2
    compliance = sum(c for c in (p.drive_line.torsional_compliance, p.drive_line.axial_compliance / square))
    fin = drive_line.fin_side(FLOATS, p, 0.0, 0.0, 0.0, 0.0).inertia
    expected = sqrt((1.0 / mechanics.screw_inertia(p) + 1.0 / fin) / compliance) / (2.0 * pi)
    # The fin's share of the inertia varies with the lever's angle, by less than 0.5 % on this way.
    assert found == pytest.approx(expected, rel=6e-3)


def kinematics_of_fin(values: Mapping[str, Any], fin: Any) -> Any:
    start = values["kinematics.initial_angle"]
    return values["kinematics.moment_arm"] / values["screw.lead"] * (np.tan(fin + start) - np.tan(start))


# -- contact ----------------------------------------------------------------------


def _bare(overrides: Mapping[str, Any]) -> Any:
    """Parameters of two inertias with nothing but the line between them."""
    return changed(tree(_values({**SMOOTH, **overrides})), {"kinematics.constant_ratio": True})


_OFF = Boundary(0.0, 0.0, 0.0, 0.0, 39.0, False)


def _energy(p: Any, s: Pair) -> float:
    c = drive_line.line(FLOATS, p)
    deflection = s.angle - s.fin_angle
    pressed, flank = drive_line.pressed(FLOATS, c, deflection, s.speed - s.fin_speed)
    fin = drive_line.fin_side(FLOATS, p, s.fin_angle, 0.0, 0.0, 0.0).inertia
    kinetic = mechanics.screw_inertia(p) * s.speed**2 + fin * s.fin_speed**2
    return float(0.5 * (kinetic + (c.stiffness * (deflection - flank)**2 if pressed else 0.0)))


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.3, 0.8])
def test_bounce_is_its_closed_form(ratio: float) -> None:
    """A damped spring that never pulls gives back exp(-zeta phi/q) of the speed.

    Its force ends at the phase tan(phi) = 2 zeta q/(2 zeta^2 - 1) of the motion, q^2 = 1 - zeta^2.
    """
    p = _bare({**RIGID, "drive_line.backlash": 1e-4})
    fin = drive_line.fin_side(FLOATS, p, 0.0, 0.0, 0.0, 0.0).inertia
    mass = 1.0 / (1.0 / mechanics.screw_inertia(p) + 1.0 / fin) / p.screw.lead**2  # along the screw
    damping = 2.0 * ratio * sqrt(p.drive_line.contact_stiffness * mass)
    p = changed(p, {"drive_line.contact_damping": damping})
    q = sqrt(1.0 - ratio**2)
    expected = exp(-ratio / q * atan2(2.0 * ratio * q, 2.0 * ratio**2 - 1.0)) if ratio else 1.0
    s, h = Pair(0.0, 20.0, 0.0, 0.0, 0.0, -5.0), 1e-6
    momentum = mechanics.screw_inertia(p) * s.speed + fin * s.fin_speed
    while s.speed - s.fin_speed > 0.0 or s.angle - s.fin_angle > 0.0:
        s, _ = advance(FLOATS, p, s, _OFF, h)
    # Second order in the angle of a tick, w h = 4e-3; its end is placed better.
    assert (s.fin_speed - s.speed) / 25.0 == pytest.approx(expected, rel=1e-4)
    assert mechanics.screw_inertia(p) * s.speed + fin * s.fin_speed == pytest.approx(momentum, rel=1e-9)


_any_compliance = st.sampled_from([0.0, 1e-9, 1e-8, 1e-6])


@settings(deadline=None, derandomize=True, max_examples=60)
@given(axial=_any_compliance, torsional=st.sampled_from([0.0, 1e-3, 0.1]), gap=st.sampled_from([1e-5, 1e-4, 1e-3]),
       damping=st.sampled_from([0.0, 1e3, 1e5]), speeds=st.tuples(st.floats(-300, 300), st.floats(-300, 300)),
       offset=st.floats(-0.9, 0.9), h=st.sampled_from([5e-6, 5e-5, 3e-4]))
def test_contact_creates_no_energy(axial: float, torsional: float, gap: float, damping: float,
                                   speeds: tuple[float, float], offset: float, h: float) -> None:
    p = _bare({"drive_line.axial_compliance": axial, "drive_line.torsional_compliance": torsional,
               "drive_line.backlash": gap, "drive_line.contact_damping": damping, "drive_line.axial_damping": 0.0,
               "drive_line.torsional_damping": 0.0, "fin.stop_angle": radians(70.0)})
    half = 0.5 * gap / p.screw.lead
    s = Pair(offset * half, speeds[0], 0.0, 0.0, 0.0, speeds[1])
    most = start = _energy(p, s)
    for _ in range(300):
        s, _ = advance(FLOATS, p, s, _OFF, h)
        most = max(most, _energy(p, s))
    # A flank is met within a share of 1e-6 of a tick, and at least MET = 1e-12 rad: far below 1e-6 of the energy.
    assert most <= start * (1.0 + 1e-6) + 1e-15


def test_free_play_by_a_small_torque_is_the_gap() -> None:
    """A torque that the motor's friction holds takes the fin from flank to flank; the rest is the line's give."""
    for gap in (2e-5, 5e-5, 2e-4):
        run = _run({"drive_line.backlash": gap, "friction.fin_viscous": 5.0}, 1.0, enable=False,
                   aero_torque=lambda t: 2.0 if t < 0.5 else -2.0)
        values = _values({"drive_line.backlash": gap})
        p = tree(values)
        play = np.ptp((run["motor_angle"] - kinematics_of_fin(values, run["fin_angle"]))[[499, 999]])
        ratio = p.kinematics.moment_arm / p.screw.lead / cos(p.kinematics.initial_angle)**2
        give = 4.0 / ratio / drive_line.line(FLOATS, p).stiffness
        # The ratio is not constant over the gap: a part in 300 of the give, itself 1 % to 10 % of the gap.
        assert play * p.screw.lead == pytest.approx(gap + give * p.screw.lead, rel=1e-3)
        assert run["motor_angle"][999] - run["motor_angle"][499] < 0.01 * play  # friction held it but for the impact


def test_limit_cycle_with_gap_and_gain_only() -> None:
    """With the loop closed over the gap; amplitude follows the gap, as that of a describing function must."""
    gain = _values()["controller.position.kp"]

    def width(gap: float, share: float, on_fin: bool = True) -> float:
        run = _run({"drive_line.backlash": gap, "controller.position.kp": share * gain, "encoder.on_fin": on_fin,
                    "encoder.enabled": False, "friction.fin_viscous": 5.0}, 4.0,
                   fin_command=lambda t: 0.02 if t > 0.05 else 0.0)
        return float(np.degrees(np.ptp(run["fin_angle"][3000:])))

    assert width(0.0, 2.0) < 1e-3
    assert width(1e-4, 2.0, on_fin=False) < 1e-3
    assert width(2.5e-5, 0.5) < 1e-3
    small, large = width(1e-4, 2.0), width(2e-4, 2.0)
    assert small > np.degrees(1e-4 / 0.05)  # wider than the gap
    assert large == pytest.approx(2.0 * small, rel=0.25)  # friction does not grow with the gap


def test_encoder_on_the_fin_sees_the_fin() -> None:
    direct, indirect = (_run({"encoder.on_fin": on, "drive_line.backlash": 2e-4}, 0.5, fin_command=0.05,
                             aero_torque=-40.0) for on in (True, False))
    count = 2.0 * pi / 8192
    for run, seen, through in ((direct, direct["fin_angle"], False), (indirect, indirect["motor_angle"], True)):
        # What is told at a sample is that of the step that begins there.
        counted = np.floor(seen[:-1] / count) * count
        shown = _through_motor(counted) if through else counted
        at_edge = np.abs(seen[:-1] / count - np.round(seen[:-1] / count)) < 1e-6
        assert run["measured_fin_angle"][1:][~at_edge] == pytest.approx(shown[~at_edge], abs=1e-12)
    lost = _through_motor(indirect["motor_angle"][-1]) - indirect["fin_angle"][-1]
    assert lost > 1e-4 / 0.05 * 0.98  # half the gap, at an angle of the lever of 8 deg


def _through_motor(angle: Any) -> Any:
    values = _values()
    start = values["kinematics.initial_angle"]
    return np.arctan(values["screw.lead"] / values["kinematics.moment_arm"] * angle + tan(start)) - start


# -- numbers ----------------------------------------------------------------------


@pytest.mark.parametrize("on_fin", [False, True])
def test_rigid_it_is_the_nonlinear_actuator(on_fin: bool) -> None:
    """The same step is taken: bit for bit."""
    values = _values({**RIGID, "encoder.on_fin": on_fin})
    plain = {name: value for name, value in values.items() if not name.startswith("drive_line.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.3 < t < 0.35}
    elastic, nonlinear = simulate(values, 0.5, model=MODEL, **inputs), simulate(plain, 0.5, **inputs)
    for name, expected in nonlinear.items():
        assert np.array_equal(elastic[name], expected), name


def test_stiff_it_tends_to_the_nonlinear_actuator() -> None:
    def apart(share: float) -> float:
        values = _values({"drive_line.axial_compliance": 1.2e-8 * share, "drive_line.torsional_compliance": 0.0,
                          "drive_line.backlash": 0.0})
        plain = {name: value for name, value in values.items() if not name.startswith("drive_line.")}
        runs = [simulate(v, 0.3, model=m, fin_command=0.1, aero_torque=-50.0)
                for v, m in ((values, MODEL), (plain, "nonlinear"))]
        return float(np.degrees(np.abs(runs[0]["fin_angle"] - runs[1]["fin_angle"]).max()))

    # 50 N.m on 2.1e5 N.m/rad give 0.014 deg, in proportion to the compliance; counts of 7e-4 deg remain.
    assert 0.01 < apart(1.0) < 0.05
    assert apart(1e-3) < 1e-3


def _independent(v: Mapping[str, Any], stop: float, command: float, torque: float) -> Any:
    """Fin angle by SciPy, from forces along the screw and the fin's own angle; stick is creep at 1e-3 rad/s."""
    arm, lead, start = v["kinematics.moment_arm"], v["screw.lead"], v["kinematics.initial_angle"]
    rotor = v["inertia.motor"] + v["inertia.screw"] + v["mass.nut"] * lead**2
    fin_inertia = v["inertia.fin"] + v["inertia.shaft"] + v["inertia.fork"]
    gap, supply = v["drive_line.backlash"], v["drive.supply_voltage"]
    parts = [(v["drive_line.axial_compliance"], v["drive_line.axial_damping"]),
             (v["drive_line.torsional_compliance"] * lead**2, v["drive_line.torsional_damping"] / lead**2)]
    if gap:
        parts.append((1.0 / v["drive_line.contact_stiffness"], v["drive_line.contact_damping"]))
    compliance = sum(c for c, _ in parts)
    damping = sum(d * (c / compliance)**2 for c, d in parts)
    polynomial = {way: [v[f"friction.coulomb.{way}[{n}]"] for n in range(7)] for way in ("positive", "negative")}

    def force(stretch: float, rate: float) -> float:
        if not gap:
            return float(stretch / compliance + damping * rate)
        side = 1.0 if stretch > 0.0 else -1.0
        beyond = side * stretch - 0.5 * gap
        return float(side * max(beyond / compliance + damping * side * rate, 0.0)) if beyond > 0.0 else 0.0

    def slope(_: float, y: Any, i_ref: float) -> list[float]:
        theta, w, i, xi, fin, rate = y
        lever = arm / cos(fin + start)**2
        f = force(lead * theta - arm * (tan(fin + start) - tan(start)), lead * w - lever * rate)
        way = "positive" if w > 0.0 else "negative"
        dry = sum(c * (fin / radians(20.0))**n for n, c in enumerate(polynomial[way])) * tanh(w / 1e-3)
        demand = v["drive.kp"] * (i_ref - i) + xi
        volts = max(-supply, min(supply, demand))
        return [w, (v["motor.torque_constant"] * i - v[f"friction.viscous.{way}"] * w - dry - lead * f) / rotor,
                (volts - v["motor.resistance"] * i - v["motor.back_emf_constant"] * w) / v["motor.inductance"],
                v["drive.ki"] * (i_ref - i) if abs(demand) < supply else 0.0, rate, (lever * f + torque) / fin_inertia]

    y, integral, period, found = np.zeros(6), 0.0, v["controller.sample_time"], [0.0]
    line = [0.0] * round(v["drive.transport_delay"] / period)
    for _ in range(round(stop / period)):
        error = arm / lead * (tan(command + start) - tan(start)) - y[0]
        raw = v["controller.position.kp"] * error + integral
        speed = float(np.clip(raw, -v["controller.speed_limit"], v["controller.speed_limit"]))
        integral += period * (v["controller.position.ki"] * error + v["controller.antiwindup"] * (speed - raw))
        line.append(float(np.clip(v["controller.velocity.kp"] * (speed - y[1]), -10.0, 10.0)))
        i_ref = float(np.clip(v["drive.current_gain"] * line.pop(0) + v["drive.current_offset"], -60.0, 60.0))
        y = solve_ivp(slope, (0.0, period), y, "Radau", args=(i_ref,), rtol=1e-9, atol=1e-10).y[:, -1]
        found.append(y[4])
    return np.array(found)


_IDEAL = {"encoder.enabled": False, "compensation.gain": 0.0, "drive.transport_delay": 3e-3}


@pytest.mark.parametrize(("gap", "command", "torque"), [(5e-5, 0.05, -30.0), (0.0, 0.05, -30.0), (3e-4, 0.3, 10.0)])
def test_default_tick_is_within_two_thousandths_of_a_degree(gap: float, command: float, torque: float) -> None:
    values = _values({**_IDEAL, "drive_line.backlash": gap})
    found = simulate(values, 0.15, model=MODEL, fin_command=command, aero_torque=torque)["fin_angle"]
    assert np.degrees(np.abs(found - _independent(values, 0.15, command, torque)).max()) < 0.002


def test_convergence_is_of_second_order() -> None:
    """Through flanks met and left and limits of voltage; no dry friction, which the reference softens."""
    values = _values({**_IDEAL, **DRY})
    exact = _independent(values, 0.15, 0.3, 10.0)
    errors = []
    for tick in (2e-4, 1e-4, 5e-5, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, 0.15, model=MODEL, fin_command=0.3, aero_torque=10.0)
        errors.append(np.abs(run["fin_angle"] - exact).max())
    slope = np.polyfit(np.log([8.0, 4.0, 2.0, 1.0]), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.15), errors


_levels = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()), min_size=2, max_size=8)


@pytest.mark.skipif(not compiled.available(MODEL), reason="no C compiler")
@settings(deadline=None, derandomize=True, max_examples=150)
@given(levels=_levels, axial=st.sampled_from([0.0, 1e-12, 1e-8, 1e-5]),
       torsional=st.sampled_from([0.0, 1e-8, 1e-3, 1.0]), gap=st.sampled_from([0.0, 1e-6, 5e-5, 1e-3]),
       damping=st.sampled_from([0.0, 1e4, 1e7]),
       dry=st.sampled_from([0.0, 5.0]), on_fin=st.booleans(), tick=st.sampled_from([2e-5, 5e-5, 1e-3]))
def test_anything_goes(levels: list[Any], axial: float, torsional: float, gap: float, damping: float, dry: float,
                       on_fin: bool, tick: float) -> None:
    """Finite and within the stops, whatever is asked of it."""
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    run = _run({"drive_line.axial_compliance": axial, "drive_line.torsional_compliance": torsional,
                "drive_line.backlash": gap, "drive_line.contact_damping": damping, "friction.fin_coulomb": dry,
                "encoder.on_fin": on_fin, "solver.max_tick": tick}, (len(commands) - 1) * 1e-3, fin_command=commands,
               aero_torque=torques, enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)


def test_friction_at_the_fin_holds_it_exactly() -> None:
    run = _run({"friction.fin_coulomb": 5.0}, 0.2, enable=False, aero_torque=lambda t: 4.9 if t < 0.1 else 5.1)
    assert np.ptp(run["fin_angle"][:101]) == 0.0
    assert run["fin_angle"][-1] > 1e-4
    assert hypot(*run["motor_angle"]) == 0.0  # its own friction holds the rotor


@pytest.mark.parametrize(("name", "value"), [
    ("drive_line.axial_compliance", -1e-9), ("drive_line.torsional_compliance", -1.0), ("drive_line.backlash", -1e-6),
    ("drive_line.backlash", 0.02), ("drive_line.contact_stiffness", 0.0), ("drive_line.contact_damping", -1.0),
    ("drive_line.axial_damping", float("nan")), ("drive_line.backlash", "0.1 deg")])
def test_bad_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        _values({name: value})


# -- after Habibi and Ozkan -------------------------------------------------------


def test_habibi_has_the_same_gap_everywhere() -> None:
    """At a constant ratio; the fin is moved by hand, as far as friction at the motor holds, at 0 and at 15 deg."""
    plays = []
    for start in (0.0, 15.0):
        values = load_parameters(model="habibi").replace({"fin.start_angle": radians(start),
                                                          "friction.fin_viscous": 50.0}).values
        run = simulate(values, 1.0, model="habibi", enable=False, aero_torque=lambda t: 2.0 if t < 0.5 else -2.0)
        plays.append(run["fin_angle"][499] - run["fin_angle"][999])
    give = 4.0 / (0.05**2 * values["drive_line.contact_stiffness"])
    assert plays[0] == pytest.approx(plays[1], rel=1e-9)
    # The rotor is moved by the impact of the flank, by less than 1 % of the gap.
    assert plays[0] == pytest.approx(5e-5 / 0.05 + give, rel=0.01)


def test_ozkan_has_its_current_at_once_whatever_the_supply() -> None:
    values = load_parameters(model="ozkan").values
    run, weak = (simulate(values, 0.3, model="ozkan", fin_command=0.1, supply_voltage=v) for v in (39.0, 1.0))
    for name in ("fin_angle", "motor_current"):
        assert np.array_equal(run[name], weak[name])
    delayed = np.interp(run["time"] - values["drive.transport_delay"], run["time"], run["time"])
    held = run["drive_reference"][np.clip(np.ceil(delayed * 1e3 - 1e-9).astype(int), 0, None)]
    expected = values["drive.current_gain"] * held + values["drive.current_offset"]
    late = slice(10, None)
    assert run["motor_current"][late] == pytest.approx(np.clip(expected, -60.0, 60.0)[late], abs=1e-9)


@pytest.mark.parametrize("compliance", [0.0, 1.71e-3])
def test_ozkan_shaft_twists_under_load(compliance: float) -> None:
    """By its compliance times the load at the motor, at a constant ratio."""
    parameters = load_parameters(model="ozkan").replace({"drive_line.torsional_compliance": compliance})
    run = simulate(parameters.values, 1.0, model="ozkan", aero_torque=-60.0)
    ratio = parameters.values["kinematics.moment_arm"] / parameters.values["screw.lead"]
    twist = run["motor_angle"][-1] - ratio * run["fin_angle"][-1]
    assert twist == pytest.approx(max(compliance, 1e-6) * 60.0 / ratio, rel=1e-3)  # at rest to 1e-3 of it
