"""The screw's efficiency: against closed forms, an independent integration, and the model without."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, radians, sin
from typing import Any

import casadi as ca
import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.ops.symbols import SYMBOLS
from emcas_fmu.parameters import ParameterError
from emcas_fmu.physics import screw
from emcas_fmu.simulation import simulate
from tests.default_actuator import THESIS_LOOPS
from tests.simulation import nested

from .screw_reference import motion
from .screw_values import DRY, ELASTIC, MODEL, OPTION, coulomb, efficiencies, ratio, values

_IDEAL = {**THESIS_LOOPS, "encoder.enabled": False, "compensation.gain": 0.0, "drive.transport_delay": 3e-3}


# -- closed forms -----------------------------------------------------------------


@pytest.mark.parametrize("way", ["positive", "negative"])
@pytest.mark.parametrize("opposing", [True, False])
@pytest.mark.parametrize(("forward", "backward"), [(0.9, 0.889), (0.6, 0.3), (0.5, -0.4)])
def test_torque_in_steady_sliding(way: str, opposing: bool, forward: float, backward: float) -> None:
    """C_m + b_m w + L/forward against the load, C_m + b_m w - backward |L| with it: the means over a ramp."""
    sign = 1.0 if way == "positive" else -1.0
    v = values({**efficiencies(forward, backward), "encoder.enabled": False, "drive.transport_delay": 0.0,
                "fin.start_angle": radians(-15.0 * sign), "friction.fin_coulomb": 5.0})
    torque = -60.0 * sign if opposing else 60.0 * sign
    run = simulate(v, 1.2, model=MODEL, aero_torque=torque,
                   fin_command=lambda t: sign * radians(25.0 * t - 15.0))
    steady = slice(200, None)
    fin, speed = run["fin_angle"][steady], run["motor_speed"][steady]
    load = sign * (5.0 - sign * torque) / ratio(v, fin)
    felt = load / forward if opposing else load * backward
    expected = sign * coulomb(v, way, fin) + v[f"friction.viscous.{way}"] * speed + felt
    # The mean of J dw/dt is 3e-4 kg.m2 times a few rad/s over a second.
    assert np.mean(run["motor_torque"][steady]) == pytest.approx(np.mean(expected), abs=2e-3)
    lost = np.abs((felt - load) * speed)
    assert np.mean(run["screw_loss"][steady]) == pytest.approx(np.mean(lost), rel=3e-3)


@pytest.mark.parametrize("model", [MODEL, ELASTIC])
@pytest.mark.parametrize("way", ["positive", "negative"])
@pytest.mark.parametrize("backward", [0.889, 0.3])
def test_threshold_of_back_driving(model: str, way: str, backward: float) -> None:
    """backward (T_f - C_f)/R = C_m at rest, at an angle other than zero."""
    sign, start = (1.0 if way == "positive" else -1.0), 0.1
    # A gap would be crossed at a speed.
    v = values({**efficiencies(0.9, backward), "fin.start_angle": start, "friction.fin_coulomb": 3.0,
                **({"drive_line.backlash": 0.0} if model == ELASTIC else {})}, model)
    least = 3.0 + ratio(v, start) * coulomb(v, way, start) / backward
    # Raised slowly: the end of the ramp sets the elastic line swinging by a thousandth of the load.
    near = 1e-2 if model == ELASTIC else 1e-6
    for share, moves in ((1.0 - near, False), (1.0 + near, True)):
        run = simulate(v, 0.6, model=model, enable=False,
                       aero_torque=sign * share * least * np.minimum(np.arange(601) / 400.0, 1.0))
        moved = run["motor_angle"][-1] - run["motor_angle"][0]
        assert (moved * sign > 0.0) if moves else moved == 0.0


@pytest.mark.parametrize("model", [MODEL, ELASTIC])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_threshold_of_a_body_force(model: str, sign: float) -> None:
    """backward (l m a + T_f/R) = C_m: a nut's own load passes the screw too. Half is the nut's."""
    heavy, backward = 100.0, 0.3
    v = values({**efficiencies(0.9, backward), "mass.nut": heavy, "mass.fin": 0.0, "mass.shaft": 0.0, "mass.fork": 0.0,
                "loads.gravity": False, "friction.fin_coulomb": 0.0,
                **({"drive_line.backlash": 0.0} if model == ELASTIC else {})}, model)
    half = 0.5 * sign * coulomb(v, "positive" if sign > 0.0 else "negative", 0.0) / backward
    # Raised slowly: the line turns the fin, and with it the ratio, by a thousandth.
    for share, moves in ((0.99, False), (1.01, True)):
        ramp = share * half * np.minimum(np.arange(601) / 400.0, 1.0)
        inputs = {"aero_torque": ramp * ratio(v, 0.0), "acceleration.x": -ramp / (v["screw.lead"] * heavy)}
        run = simulate(v, 0.6, model=model, enable=False, **inputs)
        assert (run["motor_angle"][-1] * sign > 0.0) if moves else np.all(run["motor_angle"] == 0.0)


@pytest.mark.parametrize("model", [MODEL, ELASTIC, "ristanovic+efficiency"])
@pytest.mark.parametrize("dry", [True, False])
@pytest.mark.parametrize("torque", [1.0, -1.0, 300.0, -300.0, 1e6, -1e6])
def test_self_locking_holds_exactly(model: str, dry: bool, torque: float) -> None:
    """No creep, not by a last bit, with and without friction; a moving fin comes to rest and stays."""
    v = values({**efficiencies(0.45, 0.0), **({} if dry else DRY)}, model)
    run = simulate(v, 0.2, model=model, enable=False, aero_torque=torque)
    assert np.all(run["motor_angle"] == 0.0)
    assert np.all(run["screw_loss"] == 0.0)
    if abs(torque) <= 300.0:
        run = simulate(v, 0.4, model=model, enable=lambda t: t < 0.03, aero_torque=torque,
                       fin_command=0.2 if torque > 0.0 else -0.2)
        assert run["motor_angle"][-1] != 0.0
        assert np.ptp(run["motor_angle"][200:]) == 0.0


def test_a_screw_that_jams_holds_too() -> None:
    for torque in (300.0, -300.0):
        run = simulate(values(efficiencies(0.3, -1.5)), 0.1, model=MODEL, enable=False, aero_torque=torque)
        assert np.all(run["motor_angle"] == 0.0)


@pytest.mark.parametrize("aiding", [True, False])
def test_torque_that_moves_a_self_locking_screw(aiding: bool) -> None:
    """With the load it takes C_m + |backward| L, against it C_m + L/forward, by the current that flows at breakaway."""
    v = values({**efficiencies(0.5, -0.5), "encoder.enabled": False, "controller.position.ki": 20.0,
                "controller.position.kp": 0.5, "compensation.gain": 0.0})
    torque = 50.0 if aiding else -50.0
    run = simulate(v, 3.0, model=MODEL, fin_command=0.02, aero_torque=torque)
    first = int(np.argmax(run["motor_angle"] != 0.0))
    load = 50.0 / ratio(v, 0.0)
    expected = coulomb(v, "positive", 0.0) + load * (0.5 if aiding else 2.0)
    # The current rises by less than 0.5 % between two samples.
    assert run["motor_torque"][first] == pytest.approx(expected, rel=0.01)


# -- numbers ----------------------------------------------------------------------


@pytest.mark.parametrize("model", ["nonlinear", "elastic", "ristanovic"])
def test_without_losses_it_is_the_model(model: str) -> None:
    """The same step, bit for bit."""
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.3 < t < 0.35}
    lossless = simulate(values(efficiencies(1.0, 1.0), model + OPTION), 0.5, model=model + OPTION, **inputs)
    for name, expected in simulate(values({}, model), 0.5, model=model, **inputs).items():
        assert np.array_equal(lossless[name], expected), name
    assert np.all(lossless["screw_loss"] == 0.0)


@pytest.mark.parametrize(("model", "command", "torque", "backward"), [
    (MODEL, 0.05, -60.0, 0.3), (MODEL, 0.2, 60.0, 0.3), (MODEL, 0.2, 60.0, -1.0),
    (ELASTIC, 0.05, -60.0, 0.3), (ELASTIC, 0.05, 60.0, 0.0)])
def test_default_tick_is_within_a_thousandth_of_a_degree(model: str, command: float, torque: float, backward: float
                                                         ) -> None:
    """Against SciPy on independently written equations, with events.

    A quarter of the tick gives a sixteenth of the error, of second order, or a sixth where a sign changes within one.
    """
    line = {"drive_line.backlash": 0.0, "drive_line.torsional_compliance": 0.0} if model == ELASTIC else {}
    v = values({**efficiencies(0.7, backward), **_IDEAL, **line}, model)
    exact, _ = motion(v, 0.1, lambda _: command, torque, model == ELASTIC)

    def off(overrides: Mapping[str, float]) -> float:
        found = simulate({**v, **overrides}, 0.1, model=model, fin_command=command, aero_torque=torque)
        return float(np.degrees(np.abs(found["fin_angle"] - exact).max()))

    assert off({}) < 0.001
    assert off({"solver.max_tick": v["solver.max_tick"] / 4.0}) < off({}) / 6.0
    assert off(efficiencies(1.0, 1.0)) > 0.05  # what the losses do to it


@pytest.mark.parametrize(("model", "ticks"), [(MODEL, (5e-4, 2.5e-4, 1.25e-4, 6.25e-5)),
                                              (ELASTIC, (1e-4, 5e-5, 2.5e-5, 1.25e-5))])
def test_convergence_is_of_second_order(model: str, ticks: tuple[float, ...]) -> None:
    """Through reversals of the load and, by the controllers, of the speed."""
    v = values({**efficiencies(0.7, 0.3), **_IDEAL, **DRY}, model)

    def angle(tick: float) -> Any:
        return simulate({**v, "solver.max_tick": tick}, 0.15, model=model, fin_command=0.1,
                        aero_torque=lambda t: 50.0 * cos(60.0 * t))["fin_angle"]

    exact = angle(1e-6)
    errors = [np.abs(angle(tick) - exact).max() for tick in ticks]
    assert np.polyfit(np.log(ticks), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15), errors


def test_stiff_it_tends_to_the_rigid_one() -> None:
    def apart(share: float) -> float:
        v = values({**efficiencies(0.6, 0.2), "drive_line.axial_compliance": 1.2e-8 * share,
                    "drive_line.torsional_compliance": 0.0, "drive_line.backlash": 0.0}, ELASTIC)
        plain = {name: value for name, value in v.items() if not name.startswith("drive_line.")}
        runs = [simulate(w, 0.3, model=m, fin_command=0.1, aero_torque=-50.0)
                for w, m in ((v, ELASTIC), (plain, MODEL))]
        return float(np.degrees(np.abs(runs[0]["fin_angle"] - runs[1]["fin_angle"]).max()))

    # 50 N.m on 2.1e5 N.m/rad give 0.014 deg, in proportion to the compliance; counts of 7e-4 deg remain.
    assert 0.01 < apart(1.0) < 0.05
    assert apart(1e-3) < 1e-3


def test_every_namespace_gives_the_same() -> None:
    """Arrays and symbols for the closed forms of the screw, at every combination of signs."""
    p = nested(values(efficiencies(0.7, 0.3)), MODEL)
    cases = np.array([(net, load, way) for net in (-2.0, 0.0, 2.0) for load in (-1.0, 0.0, 1.0) for way in (-1.0, 1.0)])
    forms: tuple[Any, ...] = (lambda ops, net, load, way: screw.transmitted(ops, p, net, 1.5e-5, load, way),
                              lambda ops, net, load, way: (screw.hold(ops, p, load, way),))
    for form in forms:
        expected = np.array([form(FLOATS, *case) for case in cases.tolist()])
        assert np.array_equal(np.stack(form(ARRAYS, *cases.T), axis=1), expected)
        x = [ca.SX.sym(name) for name in ("net", "load", "way")]
        evaluate = ca.Function("f", x, [ca.vertcat(*form(SYMBOLS, *x))])
        found = np.array([np.array(evaluate(*case)).ravel() for case in cases.tolist()])
        assert found == pytest.approx(expected, rel=1e-14, abs=1e-300)


# -- refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(("overrides", "model", "told"), [
    ({"efficiency.forward": 0.0}, MODEL, r"efficiency.forward = 0.0: is 0; it must be within 0.01 .. 1"),
    ({"efficiency.forward": 1.01}, MODEL, "efficiency.forward"),
    ({"efficiency.backward": 1.01}, MODEL, r"efficiency.backward = 1.01: .* within -10 .. 1"),
    ({"efficiency.backward": float("nan")}, MODEL, "efficiency.backward"),
    ({"efficiency.backward": -0.5, "inertia.motor": 1e-6, "inertia.screw": 1e-6}, MODEL,
     "efficiency.backward = -0.5 must not be below minus 0.9 times the inertia of motor and screw"),
    # Half a tick of it beside 1.2 kg.m2: without, the load's inertia is a fourteenth of the rotor's.
    ({"efficiency.backward": -1.0, "friction.fin_viscous": 1e4}, MODEL, "efficiency.backward = -1 must not be below"),
    ({"efficiency.backward": -0.01}, ELASTIC, "efficiency.backward = -0.01 must not be below 0 with an elastic")])
def test_bad_values_are_refused(overrides: Mapping[str, float], model: str, told: str) -> None:
    with pytest.raises(ParameterError, match=told):
        values(overrides, model)


@pytest.mark.parametrize("model", ["linear", "second-order", "habibi", "ozkan"])
def test_models_without_such_a_screw(model: str) -> None:
    with pytest.raises(EmcasError, match=rf"model {model}\+efficiency: efficiency needs a screw without losses; "
                                          rf"{model} has none; choose nonlinear, ristanovic or elastic"):
        get(model + OPTION)
