"""LuGre friction at the motor: closed forms, an independent integration, energy."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, factorial, log, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.namespace import with_values
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import mechanics
from emcas_fmu.simulation import simulate
from emcas_fmu.steppers.electrical import Plant
from emcas_fmu.steppers.lugre import advance, shares
from emcas_fmu.steppers.rigid import stops
from tests.marks import slow
from tests.simulation import acting, nested

from .friction_reference import IDEAL, Bristle, excess

MODEL = "nonlinear+lugre"
BASE = load_parameters(model=MODEL)
WAYS = ("positive", "negative")
DRY = {f"friction.coulomb.{way}[{n}]": 0.0 for way in WAYS for n in range(7)}
LEVEL = 0.2  # N.m
# One Coulomb friction everywhere, no viscous friction, no excess at low speed.
PLAIN = {**DRY, **{f"friction.coulomb.{way}[0]": LEVEL for way in WAYS},
         **{f"friction.viscous.{way}": 0.0 for way in WAYS}, "lugre.static_ratio": 1.0}


def _values(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    return BASE.with_values(overrides or {}).values


def _pushed(overrides: Mapping[str, Any], stop: float, torque: Any) -> dict[str, Any]:
    """Under a hinge moment alone; the drive is off."""
    return simulate(_values(overrides), stop, model=MODEL, enable=False, aero_torque=torque)


def _ratio(values: Mapping[str, Any], fin: Any = 0.0) -> Any:
    lever = np.cos(fin + values["kinematics.initial_angle"])
    return values["kinematics.moment_arm"] / values["screw.lead"] / lever**2


# -- presliding -------------------------------------------------------------------


def test_a_small_torque_deflects_the_bristles_by_its_share() -> None:
    """z = T/sigma_0 at rest, and on the way from z = 0 the motor turns by -(C/sigma_0) ln(1 - T/C)."""
    values = _values(PLAIN)
    small = 0.05 * LEVEL * _ratio(values)
    run = _pushed(PLAIN, 3.0, lambda t: small * min(t, 1.0))
    stiffness = values["lugre.stiffness"]
    applied = small / _ratio(values, run["fin_angle"][-1])
    assert run["bristle_deflection"][-1] == pytest.approx(applied / stiffness, rel=1e-9)
    assert run["friction_torque"][-1] == pytest.approx(applied, rel=1e-9)
    # Monotonous but for the swing that each step of the ramp makes, as large as itself: a thousandth of the way.
    assert run["motor_angle"][-1] == pytest.approx(-LEVEL / stiffness * log(1.0 - applied / LEVEL), rel=1e-3)


def test_small_oscillations_have_the_frequency_of_bristles_and_inertia() -> None:
    overrides = {**PLAIN, "lugre.damping": 0.0, "solver.max_tick": 1e-4}
    run = _pushed(overrides, 0.5, lambda t: 0.05 if t < 1e-3 else 0.0)
    p = nested(_values(overrides), MODEL)
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    angle = run["motor_angle"][20:] - run["motor_angle"][20:].mean()
    up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    times = (up - angle[up] / (angle[up + 1] - angle[up])) * 1e-3
    found = (len(times) - 1) / (times[-1] - times[0])
    # Midpoint lengthens a period by (w h)^2/12 = 6e-5, lines between samples by less; slip is of the second order in
    # the amplitude, 2e-3 of breakaway.
    assert 2.0 * pi * found == pytest.approx(sqrt(p.lugre.stiffness / inertia), rel=2e-4)


def test_presliding_has_its_hysteresis_loop() -> None:
    """Along a way x without excess: dT/dx = sigma_0 (1 -+ T/C), closed forms from each reversal."""
    values = _values(PLAIN)
    largest, period = 0.8 * LEVEL * _ratio(values), 20.0
    run = _pushed(PLAIN, 15.0, lambda t: largest * sin(2.0 * pi * t / period))
    x, torque = run["motor_angle"], run["friction_torque"]
    over = values["lugre.stiffness"] / LEVEL
    turn = int(np.argmax(x))
    virgin = LEVEL * (1.0 - np.exp(-over * x[:turn]))
    back = -LEVEL + (torque[turn] + LEVEL) * np.exp(over * (x[turn:] - x[turn]))
    # sigma_1 at the speed of 5e-3 rad/s and the load's steps add 2e-4 N.m.
    assert torque[:turn] == pytest.approx(virgin, abs=5e-4)
    assert torque[turn:] == pytest.approx(back, abs=5e-4)
    remanent = x[turn + int(np.argmin(np.abs(torque[turn:])))]
    assert remanent == pytest.approx(x[turn] - log(1.0 + torque[turn] / LEVEL) / over, abs=5e-5)
    assert remanent > 0.5 * x[turn] > 0.5 / over  # the loop is a wide one


def test_breakaway_is_the_static_ratio_in_a_slow_ramp() -> None:
    """s C in the limit; in a ramp of 0.03 N.m/s at the motor the bristles lag by the way they slip."""
    overrides = {**PLAIN, "lugre.static_ratio": 1.5}
    largest = []
    for rate in (2.0, 200.0):
        run = _pushed(overrides, 0.4 * _ratio(_values()) / rate, lambda t, rate=rate: rate * t)
        largest.append(run["friction_torque"].max() / LEVEL)
        away = np.flatnonzero(run["motor_speed"] > 1.0)[0]
        assert run["motor_angle"][away - 1] < 0.2  # held so far, but for some bristle lengths
    assert largest[0] == pytest.approx(1.5, rel=0.02)
    assert largest[1] < largest[0]  # a faster ramp breaks away earlier: the model's known trait


@pytest.mark.parametrize("damping", [0.0, 0.046, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 1.5])
def test_torque_is_bounded_by_breakaway(damping: float, ratio: float) -> None:
    """s C at most, at reversals at speed too: a damping of more than g/|w| would add to it there."""
    overrides = {**PLAIN, "lugre.damping": damping, "lugre.static_ratio": ratio}
    run = simulate(_values(overrides), 0.1, 2e-4, model=MODEL, fin_command=lambda t: 0.1 if t < 0.03 else -0.1)
    assert run["motor_speed"].min() < -50.0 < 50.0 < run["motor_speed"].max()
    # The deflection lags by what a step's speed is mispredicted, 1e-4 of it.
    assert 0.99 * LEVEL < np.abs(run["friction_torque"]).max() < ratio * LEVEL * (1.0 + 1e-3)


def test_steady_sliding_has_the_friction_of_its_speed() -> None:
    """g(w) with the polynomial of the direction and the hinge's share, the rest is viscous."""
    overrides = {"friction.viscous.positive": 0.1, "friction.viscous.negative": 0.1, "friction.fin_coulomb": 5.0,
                 "lugre.static_ratio": 1.5, "lugre.stribeck_speed": 2.0}
    values = _values(overrides)
    plant = Bristle(values)
    for torque in (60.0, 30.0, -60.0):
        run = _pushed(overrides, 0.6, torque)
        for k in (300, 500, 590):
            speed, fin, ratio = run["motor_speed"][k], run["fin_angle"][k], plant.ratio(run["fin_angle"][k])
            level = plant.coulomb(fin, speed) * excess(1.5, 2.0, speed) + 5.0 / ratio
            assert abs(speed) > 1.0
            # Bristles follow in C/(sigma_0 w), 10 ms and less; the angle changes g by 1e-2 a second.
            assert run["friction_torque"][k] == pytest.approx(np.sign(speed) * level, rel=2e-3)
            assert torque / ratio - 0.1 * speed == pytest.approx(run["friction_torque"][k], rel=5e-3)


# -- numbers ----------------------------------------------------------------------


@pytest.mark.parametrize("x", [0.0, 1e-300, 1e-9, 1e-3, 0.0199999, 0.02, 0.3, 1.0, 40.0, 1e6, 1e25])
def test_shares_of_the_exponential(x: float) -> None:
    kept, first, second = shares(FLOATS, x)
    if x < 1.0:
        exact = [sum((-x)**k / factorial(k + n) for k in range(20)) for n in (0, 1, 2)]
    else:
        exact = [exp(-x), (1.0 - exp(-x)) / x, (x - 1.0 + exp(-x)) / x**2]
    # Truncation x^5/2520 and cancellation 1e-16/x^2 meet at 0.02.
    assert [kept, first, second] == pytest.approx(exact, rel=2e-12, abs=1e-300)


@pytest.mark.parametrize(("overrides", "stop", "torque", "step"), [
    ({"friction.fin_coulomb": 5.0, "lugre.static_ratio": 1.5}, 0.1, 0.0, False),
    *slow(({"lugre.stiffness": 200.0, "lugre.damping": 0.0}, 0.06, -20.0, True), ({}, 0.1, -20.0, True),
          ({"lugre.static_ratio": 2.0, "lugre.stribeck_speed": 1e-3}, 0.1, -20.0, True))])
def test_against_an_independent_integration_and_of_second_order(overrides: Mapping[str, Any], stop: float,
                                                                torque: float, step: bool) -> None:
    """Radau at 1e-9 on equations in the fin's angle: a step of 0.5 deg through reversals, and a ramp of 0.3 deg/s."""
    values = _values({**IDEAL, **overrides})

    def command(t: float) -> float:
        return radians(0.5) * (t > 0.01) if step else radians(0.3) * t

    exact, _ = Bristle(values, torque).closed_loop(stop, command)
    errors = []
    for tick in (2e-4, 1e-4, 5e-5, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, stop, model=MODEL, fin_command=command, aero_torque=torque)
        errors.append(np.abs(run["fin_angle"] - exact).max())
    # A reversal, a kink of |w|, lies anywhere in a tick: orders between two ticks scatter, over three halvings they
    # are 1.9 to 2.5.
    assert 1.8 < log(errors[0] / errors[-1]) / log(8.0) < 2.6, errors
    assert np.degrees(errors[1]) < 1e-5  # at the default tick


def test_without_friction_it_is_none() -> None:
    """The nonlinear model without, but for where a tick is cut."""
    values = _values({**IDEAL, **DRY})
    plain = {name: value for name, value in values.items() if not name.startswith("lugre.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.05 * sin(40.0 * t), "aero_torque": -30.0}
    found, expected = simulate(values, 0.3, model=MODEL, **inputs), simulate(plain, 0.3, **inputs)
    # Ticks are cut at reversals there; their own error is 1e-5 deg.
    assert np.degrees(np.abs(found["fin_angle"] - expected["fin_angle"]).max()) < 2e-5
    assert np.abs(found["friction_torque"]).max() < 1e-11


def test_stiff_it_tends_to_exact_stick() -> None:
    def apart(stiffness: float) -> float:
        values = _values({**IDEAL, "lugre.static_ratio": 1.0, "lugre.stiffness": stiffness, "solver.max_tick": 2e-5})
        plain = {name: value for name, value in values.items() if not name.startswith("lugre.")}
        runs = [simulate(v, 1.0, model=m, fin_command=lambda t: 0.005 * sin(10.0 * t))
                for v, m in ((values, MODEL), (plain, "nonlinear"))]
        return float(np.degrees(np.abs(runs[0]["fin_angle"] - runs[1]["fin_angle"]).max()))

    # The deflection C/sigma_0 is 1e-3 rad at 200 N.m/rad, 1e-3 deg at the fin, and a loop carries it on.
    soft, stiff = apart(200.0), apart(20_000.0)
    assert soft < 0.01
    assert stiff < soft / 10.0


_OFF = acting(enabled=False)


@settings(derandomize=True, max_examples=30)
@given(stiffness=st.floats(1e-3, 1e6), damping=st.sampled_from([0.0, 1e-3, 0.05, 1.0]),
       ratio=st.floats(1.0, 10.0), width=st.sampled_from([1e-3, 1.0, 1e3]),
       level=st.sampled_from([0.0, 1e-6, 0.2, 5.0]),
       speed=st.floats(-300.0, 300.0), stretch=st.floats(-1.5, 1.5), h=st.sampled_from([1e-6, 1e-4, 1e-3]))
def test_bristles_make_no_energy(stiffness: float, damping: float, ratio: float, width: float, level: float,
                                 speed: float, stretch: float, h: float) -> None:
    """J w^2/2 + sigma_0 z^2/2 never grows, however coarse the tick, stretched beyond breakaway or not."""
    values = dict(_values({**PLAIN, "lugre.damping": damping, "lugre.static_ratio": ratio,
                           "lugre.stribeck_speed": width, **{f"friction.coulomb.{way}[0]": level for way in WAYS}}))
    p = with_values(nested(values, MODEL, constant_ratio=True), {"lugre.stiffness": stiffness})
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    s, z = Plant(0.0, speed, 0.0, 0.0), stretch * ratio * max(level, 1e-3) / stiffness
    before = 0.5 * inertia * speed**2 + 0.5 * stiffness * z**2
    for _ in range(100):
        s, z, _ = advance(FLOATS, p, s, z, _OFF, h)
        after = 0.5 * inertia * s.motor_speed**2 + 0.5 * stiffness * z**2
        # Passive by construction: rounding alone.
        assert after <= before * (1.0 + 1e-12) + 1e-300
        before = after


def test_steady_sliding_does_not_ring() -> None:
    """At 100 rad/s the bristles slip 100 times in a tick: speed falls monotonously, the torque is g."""
    p = with_values(nested(_values(PLAIN), MODEL, constant_ratio=True), {"lugre.stiffness": 20_000.0})
    s, z, speeds = Plant(-20.0, 100.0, 0.0, 0.0), 0.0, [100.0]
    for _ in range(200):
        s, z, _ = advance(FLOATS, p, s, z, _OFF, 1e-4)
        speeds.append(s.motor_speed)
    inertia = mechanics.coefficients(FLOATS, p, 0.0).inertia
    # The mean speed's share of the rate predicted: 1e-4 off where a tick takes 0.07 of 100 rad/s.
    assert -np.diff(speeds) == pytest.approx(LEVEL / inertia * 1e-4, rel=5e-3)


# -- stops and anything -----------------------------------------------------------


def test_pressed_against_a_stop_it_stays_there_exactly() -> None:
    """By a hinge moment and by the drive; and it leaves when the torque on it turns against what bristles hold."""
    run = _pushed({}, 0.5, lambda t: 100.0 if t < 0.3 else -100.0)
    hit = int(np.argmax(run["at_stop"]))
    assert 20 < hit < 250
    assert np.ptp(run["motor_angle"][hit:301]) == 0.0
    assert np.all(run["motor_speed"][hit:301] == 0.0)
    assert np.ptp(run["bristle_deflection"][hit:301]) == 0.0
    assert run["fin_angle"][hit] == pytest.approx(radians(25.0), rel=1e-12)
    assert not run["at_stop"][302]
    assert run["fin_angle"][-1] < 0.0
    # Stretched bristles push back when nothing else does: by no more than their own length.
    loose = _pushed({}, 0.5, lambda t: 100.0 if t < 0.3 else 0.0)
    sprung = loose["motor_angle"][300] - loose["motor_angle"][-1]
    assert 0.0 < sprung < 3.0 * 1.3 * 0.25 / 20.0


def test_a_driven_stop_is_met_and_left() -> None:
    values = _values({"fin.stop_angle": radians(20.0)})
    run = simulate(values, 0.6, model=MODEL, fin_command=lambda t: 0.4 if t < 0.3 else 0.0, aero_torque=60.0)
    pressed = run["at_stop"][150:300]
    assert np.all(pressed > 0.0)
    assert np.ptp(run["motor_angle"][150:300]) == 0.0
    assert run["fin_angle"][-1] == pytest.approx(0.0, abs=radians(0.2))


def _at_the_stop(press: float, reference: float, h: float) -> tuple[float, float]:
    """Time [s] that a step at the upper stop takes, of `h` under a press [N.m] at most, and the press at its end."""
    p = nested(_values(), MODEL)
    torque = 0.3
    load = mechanics.coefficients(FLOATS, p, stops(FLOATS, p)[1]).load
    deflection = (torque + load - press) / p.lugre.stiffness
    s = Plant(stops(FLOATS, p)[1], 0.0, torque / p.motor.torque_constant, 0.0)
    b = acting(reference, supply=900.0)
    end, kept, used = advance(FLOATS, p, s, deflection, b, h)
    assert (end.motor_angle, end.motor_speed, kept) == (s.motor_angle, 0.0, deflection)
    pressed = p.motor.torque_constant * end.motor_current + load - p.lugre.stiffness * kept
    return used, pressed


def test_a_step_ends_where_a_stop_is_left() -> None:
    """The current falls through the balance within the tick; and a start that leads against the stop is none."""
    used, press = _at_the_stop(0.1, -5.0, 1e-3)
    assert 1e-6 < used < 0.9e-3
    # The closed form is that of the whole tick's mean integral: 1.5e-7 N.m.
    assert press == pytest.approx(0.0, abs=1e-6)
    # Let go by 1 mN.m, and the current turns back at once: the whole tick at the stop.
    used, press = _at_the_stop(-1e-3, 5.0, 1e-3)
    assert used == 1e-3
    assert press > 0.1


_levels = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()), min_size=2, max_size=6)


@pytest.mark.kernel(MODEL)
@settings(derandomize=True, max_examples=50)
@given(levels=_levels, stiffness=st.sampled_from([1e-3, 0.5, 20.0, 250.0]), damping=st.sampled_from([0.0, 0.05, 1.0]),
       ratio=st.floats(1.0, 10.0), dry=st.sampled_from([0.0, 50.0]), cold=st.sampled_from([0.0, 1.25]),
       tick=st.sampled_from([2e-5, 1e-4, 1e-3]))
def test_anything_goes(levels: list[Any], stiffness: float, damping: float, ratio: float, dry: float, cold: float,
                       tick: float) -> None:
    """Finite and within the stops, for any inputs."""
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    run = simulate(_values({"lugre.stiffness": stiffness, "lugre.damping": damping, "lugre.static_ratio": ratio,
                            "friction.fin_coulomb": dry, "friction.table.coulomb[1]": cold,
                            "friction.temperature": -6.0, "solver.max_tick": tick}),
                   (len(commands) - 1) * 1e-3, model=MODEL, fin_command=commands, aero_torque=torques, enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)


def test_back_ends_are_one() -> None:
    """Bit for bit, through voltage limits, stops and a disabled drive."""
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.34 if sin(20.0 * t) > 0.0 else -0.34,
                              "aero_torque": lambda t: 200.0 * sin(20.0 * t), "enable": lambda t: not 0.1 < t < 0.2}
    values = _values({"fin.stop_angle": radians(20.0)})
    runs = [simulate(values, 0.5, model=MODEL, kernel=kernel, **inputs) for kernel in ("python", "compiled")]
    assert 0.05 < runs[0]["at_stop"].mean() < 0.9
    for name, column in runs[0].items():
        assert np.array_equal(column, runs[1][name]), name


# -- refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(("name", "value"), [
    ("lugre.stiffness", 0.0), ("lugre.stiffness", -20.0), ("lugre.stiffness", "20 N/m"), ("lugre.damping", -1e-3),
    ("lugre.damping", 1.01), ("lugre.damping", float("inf")), ("lugre.static_ratio", 0.9),
    ("lugre.stribeck_speed", 0.0)])
def test_bad_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        _values({name: value})


def test_bristles_too_stiff_for_the_tick_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"lugre\.stiffness = 600 N\.m/rad must be at most 583\..* 0\.0007 s"):
        _values({"lugre.stiffness": 600.0, "solver.max_tick": 7e-4})
    assert _values({"lugre.stiffness": 600.0, "solver.max_tick": 6e-4})


@pytest.mark.parametrize(("model", "reason"), [
    ("linear+lugre", "Coulomb friction at the motor"), ("second-order+lugre", "a rigid drive line"),
    ("elastic+lugre", "a rigid drive line"), ("ristanovic+lugre", "a current loop"),
    ("habibi+lugre", "a rigid drive line"), ("ozkan+lugre", "a rigid drive line")])
def test_where_it_does_not_belong_it_is_refused(model: str, reason: str) -> None:
    has_none = f"{model.partition('+')[0]} has none"
    with pytest.raises(EmcasError, match=f"lugre needs {reason}; {has_none}; choose nonlinear$"):
        get(model)
