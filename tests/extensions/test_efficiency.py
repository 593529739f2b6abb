"""The screw's efficiency against closed forms, an independent integration, and the model without losses."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, radians, sin
from typing import Any

import casadi as ca
import numpy as np
import pytest

from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.ops.symbols import SYMBOLS
from emcas_fmu.parameters import ParameterError
from emcas_fmu.physics import screw
from emcas_fmu.simulation import simulate
from tests.runs import assert_equal
from tests.simulation import nested

from .runs import WAYS
from .screw_reference import IDEAL, motion
from .screw_values import ELASTIC, EXTENSION, MODEL, NO_DRY, SCREW_STRETCHES, coulomb, efficiencies, ratio, values_of

NO_BACKLASH = {MODEL: {}, ELASTIC: {"drive_line.backlash": 0.0}}  # a gap would be crossed at a speed
# Slow, so that the fin does not swing: a load that rises for 0.4 s and stays for 0.2 s.
RAMP = np.minimum(np.arange(601) / 400.0, 1.0)


# -- closed forms -----------------------------------------------------------------

@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("opposing", [True, False])
@pytest.mark.parametrize(("forward", "backward"), [(0.9, 0.889), (0.6, 0.3), (0.5, -0.4)])
def test_torque_in_steady_sliding(way: str, opposing: bool, forward: float, backward: float) -> None:
    """The motor torque is C_m + b_m w + L/forward against the load and C_m + b_m w - backward |L| with it.

    Means over a ramp of the command are compared.
    """
    sign = 1.0 if way == "positive" else -1.0
    v = values_of({**efficiencies(forward, backward), "encoder.enabled": False, "drive.transport_delay": 0.0,
                "fin.start_angle": radians(-15.0 * sign), "friction.fin_coulomb": 5.0})
    torque = -60.0 * sign if opposing else 60.0 * sign
    run = simulate(v, 1.2, model=MODEL, aero_torque=torque,
                   fin_command=lambda t: sign * radians(25.0 * t - 15.0))
    steady = slice(200, None)
    fin, speed = run["fin_angle"][steady], run["motor_speed"][steady]
    load = sign * (5.0 - sign * torque) / ratio(v, fin)
    load_at_motor = load / forward if opposing else load * backward
    torque_at_motor = sign * coulomb(v, way, fin) + v[f"friction.viscous.{way}"] * speed + load_at_motor
    # The mean of J dw/dt is 3e-4 kg.m2 times a few rad/s over a second.
    assert np.mean(run["motor_torque"][steady]) == pytest.approx(np.mean(torque_at_motor), abs=2e-3)
    loss = np.abs((load_at_motor - load) * speed)
    assert np.mean(run["screw_loss"][steady]) == pytest.approx(np.mean(loss), rel=3e-3)


@pytest.mark.parametrize("model", [MODEL, ELASTIC])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("backward", [0.889, 0.3])
def test_threshold_of_back_driving(model: str, way: str, backward: float) -> None:
    """A load T_f drives the motor back from rest if backward (T_f - C_f)/R exceeds C_m."""
    sign, start = (1.0 if way == "positive" else -1.0), 0.1
    v = values_of(efficiencies(0.9, backward), NO_BACKLASH[model], {"friction.fin_coulomb": 3.0}, model=model,
                  fin__start_angle=start)
    threshold = 3.0 + ratio(v, start) * coulomb(v, way, start) / backward
    # The end of the ramp sets the elastic line swinging by a thousandth of the load.
    margin = 1e-2 if model == ELASTIC else 1e-6
    for share, moves in ((1.0 - margin, False), (1.0 + margin, True)):
        run = simulate(v, 0.6, model=model, enable=False, aero_torque=sign * share * threshold * RAMP)
        moved = run["motor_angle"][-1] - run["motor_angle"][0]
        assert (moved * sign > 0.0) if moves else moved == 0.0


@pytest.mark.parametrize("model", [MODEL, ELASTIC])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_threshold_of_a_body_force(model: str, sign: float) -> None:
    """The nut's inertial force passes the screw, too: the motor moves if backward (l m a + T_f/R) exceeds C_m.

    Half of the load is the nut's.
    """
    nut, backward = 100.0, 0.3
    v = values_of(efficiencies(0.9, backward), NO_BACKLASH[model],
                  {"mass.nut": nut, "mass.fin": 0.0, "mass.shaft": 0.0, "mass.fork": 0.0, "loads.gravity": False,
                   "friction.fin_coulomb": 0.0}, model=model)
    half = 0.5 * sign * coulomb(v, "positive" if sign > 0.0 else "negative", 0.0) / backward
    # The elastic line turns the fin, which changes the ratio by a thousandth.
    for share, moves in ((0.99, False), (1.01, True)):
        ramp = share * half * RAMP
        inputs = {"aero_torque": ramp * ratio(v, 0.0), "acceleration.x": -ramp / (v["screw.lead"] * nut)}
        run = simulate(v, 0.6, model=model, enable=False, **inputs)
        assert (run["motor_angle"][-1] * sign > 0.0) if moves else np.all(run["motor_angle"] == 0.0)


@pytest.mark.parametrize("model", [MODEL, ELASTIC, "ristanovic+efficiency"])
@pytest.mark.parametrize("dry", [True, False])
@pytest.mark.parametrize("torque", [1.0, -1.0, 300.0, -300.0, 1e6, -1e6])
def test_self_locking_holds_exactly(model: str, dry: bool, torque: float) -> None:
    """The motor does not creep by one bit, with and without friction; a moving fin comes to rest and stays."""
    v = values_of(efficiencies(0.45, 0.0), {} if dry else NO_DRY, model=model)
    run = simulate(v, 0.2, model=model, enable=False, aero_torque=torque)
    assert np.all(run["motor_angle"] == 0.0)
    assert np.all(run["screw_loss"] == 0.0)
    if abs(torque) <= 300.0:
        run = simulate(v, 0.4, model=model, enable=lambda t: t < 0.03, aero_torque=torque,
                       fin_command=0.2 if torque > 0.0 else -0.2)
        assert run["motor_angle"][-1] != 0.0
        assert np.ptp(run["motor_angle"][200:]) == 0.0


def test_a_screw_of_negative_efficiency_holds() -> None:
    for torque in (300.0, -300.0):
        run = simulate(values_of(efficiencies(0.3, -1.5)), 0.1, model=MODEL, enable=False, aero_torque=torque)
        assert np.all(run["motor_angle"] == 0.0)


@pytest.mark.parametrize("aiding", [True, False])
def test_torque_that_moves_a_self_locking_screw(aiding: bool) -> None:
    """The torque at breakaway is C_m + |backward| L with the load, and C_m + L/forward against it."""
    v = values_of({**efficiencies(0.5, -0.5), "encoder.enabled": False, "controller.position.ki": 20.0,
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
def test_without_losses_no_bit_changes(model: str) -> None:
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
                              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.3 < t < 0.35}
    name = model + EXTENSION
    lossless = simulate(values_of(efficiencies(1.0, 1.0), model=name), 0.5, model=name, **inputs)
    assert_equal(lossless, simulate(values_of(model=model), 0.5, model=model, **inputs))
    assert np.all(lossless["screw_loss"] == 0.0)


@pytest.mark.parametrize(("model", "command", "torque", "backward"), [
    (MODEL, 0.05, -60.0, 0.3), (MODEL, 0.2, 60.0, 0.3), (MODEL, 0.2, 60.0, -1.0),
    (ELASTIC, 0.05, -60.0, 0.3), (ELASTIC, 0.05, 60.0, 0.0)])
def test_default_tick_is_within_a_thousandth_of_a_degree(model: str, command: float, torque: float, backward: float
                                                         ) -> None:
    """SciPy integrates independently written equations with events.

    A quarter of the tick leaves a sixteenth of the error, by second order, or a sixth if a sign changes within a tick.
    """
    v = values_of(efficiencies(0.7, backward), IDEAL, SCREW_STRETCHES if model == ELASTIC else {}, model=model)
    exact, _ = motion(v, 0.1, lambda _: command, torque, model == ELASTIC)

    def error(overrides: Mapping[str, float]) -> float:
        run = simulate({**v, **overrides}, 0.1, model=model, fin_command=command, aero_torque=torque)
        return float(np.degrees(np.abs(run["fin_angle"] - exact).max()))

    assert error({}) < 0.001
    assert error({"solver.max_tick": v["solver.max_tick"] / 4.0}) < error({}) / 6.0
    assert error(efficiencies(1.0, 1.0)) > 0.05  # the effect of the losses


@pytest.mark.parametrize(("model", "ticks"), [(MODEL, (5e-4, 2.5e-4, 1.25e-4, 6.25e-5)),
                                              (ELASTIC, (1e-4, 5e-5, 2.5e-5, 1.25e-5))])
def test_convergence_is_of_second_order(model: str, ticks: tuple[float, ...]) -> None:
    """Load and speed reverse within the run."""
    v = values_of(efficiencies(0.7, 0.3), IDEAL, NO_DRY, model=model)

    def angle(tick: float) -> Any:
        return simulate({**v, "solver.max_tick": tick}, 0.15, model=model, fin_command=0.1,
                        aero_torque=lambda t: 50.0 * cos(60.0 * t))["fin_angle"]

    exact = angle(1e-6)
    errors = [np.abs(angle(tick) - exact).max() for tick in ticks]
    assert np.polyfit(np.log(ticks), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.15), errors


def test_a_stiff_line_tends_to_the_rigid_model() -> None:
    def difference(share: float) -> float:
        v = values_of(efficiencies(0.6, 0.2), SCREW_STRETCHES, {"drive_line.axial_compliance": 1.2e-8 * share},
                      model=ELASTIC)
        rigid = {name: value for name, value in v.items() if not name.startswith("drive_line.")}
        angles = [simulate(each, 0.3, model=model, fin_command=0.1, aero_torque=-50.0)["fin_angle"]
                  for each, model in ((v, ELASTIC), (rigid, MODEL))]
        return float(np.degrees(np.abs(angles[0] - angles[1]).max()))

    # 50 N.m on 2.1e5 N.m/rad turn the fin by 0.014 deg, in proportion to the compliance; counts of 7e-4 deg remain.
    assert 0.01 < difference(1.0) < 0.05
    assert difference(1e-3) < 1e-3


def test_the_screw_s_equations_agree_over_floats_arrays_and_symbols() -> None:
    """At every combination of signs."""
    p = nested(values_of(efficiencies(0.7, 0.3)), MODEL)
    cases = np.array([(net, load, way) for net in (-2.0, 0.0, 2.0) for load in (-1.0, 0.0, 1.0) for way in (-1.0, 1.0)])
    forms: tuple[Any, ...] = (lambda ops, net, load, way: screw.transmitted(ops, p, net, 1.5e-5, load, way),
                              lambda ops, net, load, way: (screw.hold(ops, p, load, way),))
    for form in forms:
        expected = np.array([form(FLOATS, *case) for case in cases.tolist()])
        assert np.array_equal(np.stack(form(ARRAYS, *cases.T), axis=1), expected)
        x = [ca.SX.sym(name) for name in ("net", "load", "way")]
        evaluate = ca.Function("f", x, [ca.vertcat(*form(SYMBOLS, *x))])
        symbolic = np.array([np.array(evaluate(*case)).ravel() for case in cases.tolist()])
        assert symbolic == pytest.approx(expected, rel=1e-14, abs=1e-300)


# -- refusals ---------------------------------------------------------------------

@pytest.mark.parametrize(("overrides", "model", "message"), [
    ({"efficiency.forward": 0.0}, MODEL, r"efficiency.forward = 0.0: is 0; it must be within 0.01 .. 1"),
    ({"efficiency.forward": 1.01}, MODEL, "efficiency.forward"),
    ({"efficiency.backward": 1.01}, MODEL, r"efficiency.backward = 1.01: .* within -10 .. 1"),
    ({"efficiency.backward": float("nan")}, MODEL, "efficiency.backward"),
    ({"efficiency.backward": -0.5, "inertia.motor": 1e-6, "inertia.screw": 1e-6}, MODEL,
     "efficiency.backward = -0.5 must not be below minus 0.9 times the inertia of motor and screw"),
    # Damping counts by half a tick, 3.5 kg.m2, beside the rotor's 1.1 kg.m2 at the fin; the fin's inertia is 0.06.
    ({"efficiency.backward": -1.0, "friction.fin_viscous": 1e4}, MODEL, "efficiency.backward = -1 must not be below"),
    ({"efficiency.backward": -0.01}, ELASTIC, "efficiency.backward = -0.01 must not be below 0 with an elastic")])
def test_bad_values_are_refused(overrides: Mapping[str, float], model: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        values_of(overrides, model=model)
