"""Stribeck friction at the motor: against an independent integration by events, and Coulomb friction."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.control.controllers import friction_compensation
from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import friction
from emcas_fmu.simulation import simulate
from tests.marks import slow
from tests.simulation import nested

from .friction_reference import IDEAL, Dry

MODEL = "nonlinear+stribeck"
BASES = ("nonlinear", *slow("elastic", "habibi", "ozkan", "ristanovic"))
BASE = load_parameters(model=MODEL)


def _values(overrides: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    return BASE.with_values(overrides or {}).values


def _ramp(rate: float) -> Any:
    """A command of `rate` [deg/s]."""
    return lambda t: radians(rate) * t


@pytest.mark.parametrize("base", BASES)
def test_a_static_ratio_of_one_is_coulomb_friction(base: str) -> None:
    """C_m times exactly 1: bit for bit."""
    model = f"{base}+stribeck"
    values = load_parameters(model=model).with_values({"stribeck.static_ratio": 1.0}).values
    plain = {name: value for name, value in values.items() if not name.startswith("stribeck.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.1 if sin(25.0 * t) > 0.0 else -0.1,
                              "aero_torque": lambda t: 30.0 * sin(60.0 * t), "enable": lambda t: not 0.1 < t < 0.13}
    found, expected = simulate(values, 0.3, model=model, **inputs), simulate(plain, 0.3, model=base, **inputs)
    for name, column in expected.items():
        assert np.array_equal(found[name], column), name
    rough = simulate({**values, "stribeck.static_ratio": 2.0}, 0.3, model=model, **inputs)
    assert np.abs(rough["fin_angle"] - expected["fin_angle"]).max() > 1e-6


@pytest.mark.parametrize("static", [1.5, 0.6])
def test_breakaway_is_the_static_ratio_and_sliding_is_coulomb(static: float) -> None:
    """Both by hand at angle 0: the drive is off, the hinge moment is on the edge of holding."""
    values = _values({"stribeck.static_ratio": static})
    p = nested(values, MODEL)
    ratio = values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(values["kinematics.initial_angle"])**2
    for way, constant in ((1.0, "positive"), (-1.0, "negative")):
        level = static * values[f"friction.coulomb.{constant}[0]"] * ratio
        for share in (0.999, 1.001):
            run = simulate(values, 0.05, model=MODEL, enable=False, aero_torque=share * way * level)
            assert (np.ptp(run["fin_angle"]) == 0.0) == (share < 1.0)
        speeds = (0.0, 0.5, 1.0, 1e3)
        shares = [friction.coulomb(FLOATS, p, way, 0.1, way * w) / friction.coulomb(FLOATS, p, way, 0.1, way * 1e3)
                  for w in speeds]
        left = np.exp([0.0, -0.25, -1.0, -np.inf])  # of the difference
        assert shares == pytest.approx(1.0 + (static - 1.0) * left, rel=1e-12)
        frozen = nested(_values({"stribeck.static_ratio": static, "friction.temperature": -6.0,
                                 "friction.table.coulomb[1]": 1.25}), MODEL)
        assert friction.coulomb(FLOATS, frozen, way, 0.1, 0.0) == pytest.approx(
            1.25 * friction.coulomb(FLOATS, p, way, 0.1, 0.0), rel=1e-12)
        # Against the direction, as a prediction beyond a reversal may be.
        assert friction.coulomb(FLOATS, p, way, 0.1, -way) == friction.coulomb(FLOATS, p, way, 0.1, 0.0)


@pytest.fixture(scope="module")
def stick_slip() -> tuple[Mapping[str, Any], Any, Any]:
    values = _values({**IDEAL, "stribeck.static_ratio": 1.5})
    return values, *Dry(values).closed_loop(0.6, _ramp(0.3))


def test_stick_slip_is_that_of_events_and_of_second_order(stick_slip: tuple[Mapping[str, Any], Any, Any]) -> None:
    """A slow ramp breaks away, slides and sticks a few times; the reference has events at 1e-11."""
    values, exact, speed = stick_slip
    assert 2 < int(np.sum((speed[:-1] == 0.0) & (speed[1:] != 0.0))) < 20
    errors = []
    for tick in (2e-4, 1e-4, 5e-5, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, 0.6, model=MODEL, fin_command=_ramp(0.3))
        errors.append(np.abs(run["fin_angle"] - exact).max())
        assert np.array_equal(run["motor_speed"] == 0.0, speed == 0.0)  # the same samples stuck
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.1), slopes  # an event or friction a step late would make it 1
    assert np.degrees(errors[1]) < 2e-5  # at the default tick; 1.1e-5, 1.4e-2 of a motor count


@pytest.mark.parametrize(("ratio", "largest"), [(1.5, 1e-6), *slow((0.5, 2e-6))])  # deg; 1.3e-6 where it builds up
def test_reversal_under_load_is_of_second_order(ratio: float, largest: float) -> None:
    values = _values({**IDEAL, "stribeck.static_ratio": ratio, "stribeck.speed": 3.0})

    def command(t: float) -> float:
        return radians(0.5) if t > 0.01 else 0.0

    exact, speed = Dry(values, -20.0).closed_loop(0.15, command)
    assert speed.min() < -0.5 < 0.5 < speed.max()
    errors = [np.abs(simulate({**values, "solver.max_tick": tick}, 0.15, model=MODEL, fin_command=command,
                              aero_torque=-20.0)["fin_angle"] - exact).max() for tick in (1e-4, 5e-5, 2.5e-5)]
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.15)
    assert np.degrees(errors[0]) < largest


def test_a_narrow_excess_is_of_second_order_at_fine_ticks() -> None:
    """The least speed there may be, 0.1 rad/s at s = 2: an excess that is passed in 0.15 ms, J w_s/((s - 1) C_m)."""
    values = _values({**IDEAL, "stribeck.static_ratio": 2.0, "stribeck.speed": 0.1})

    def command(t: float) -> float:
        return 0.02 * sin(20.0 * t)

    exact, _ = Dry(values).closed_loop(0.3, command)
    errors = [np.abs(simulate({**values, "solver.max_tick": tick}, 0.3, model=MODEL, fin_command=command)["fin_angle"]
                     - exact).max() for tick in (5e-5, 2.5e-5, 1.25e-5)]
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.3)  # 0.15 ms is not far above the first tick
    assert np.degrees(errors[0]) < 2e-5


@pytest.mark.slow
def test_elastic_is_of_second_order() -> None:
    """Against its own finest: through flanks, rest and start of both sides."""
    model = "elastic+stribeck"
    values = load_parameters(model=model).with_values({"encoder.enabled": False, "stribeck.static_ratio": 2.0}).values

    def run(tick: float) -> Any:
        return simulate({**values, "solver.max_tick": tick}, 0.15, model=model, aero_torque=-30.0,
                        fin_command=lambda t: 0.05 * sin(40.0 * t))["fin_angle"]

    finest = run(1e-4 / 64)
    errors = [np.abs(run(1e-4 / 2**n) - finest).max() for n in range(4)]
    slope = np.polyfit(np.log([8.0, 4.0, 2.0, 1.0]), np.log(errors), 1)[0]
    # Events move between ticks; the finest's own error is 1/64 of the last.
    assert slope == pytest.approx(2.0, abs=0.2), errors


def test_slow_drive_sticks_and_slips_above_a_static_ratio_of_one_only() -> None:
    """The textbook's: constant speed through a compliance, here the position loop's. At high speed there is none."""
    def starts(ratio: float, rate: float) -> int:
        run = simulate(_values({**IDEAL, "stribeck.static_ratio": ratio}), 3.0, model=MODEL, fin_command=_ramp(rate))
        rests = run["motor_speed"][1000:] == 0.0
        return int(np.sum(rests[:-1] & ~rests[1:]))

    assert starts(1.5, 0.3) > 8
    assert starts(1.0, 0.3) == starts(0.5, 0.3) == 0
    assert starts(1.5, 3.0) == 0


def test_stuck_it_does_not_creep() -> None:
    values = _values({"stribeck.static_ratio": 1.5})
    run = simulate(values, 2.0, model=MODEL, enable=lambda t: t < 1.0, fin_command=0.05,
                   aero_torque=lambda t: -10.0 if t < 1.5 else 10.0)  # 0.16 N.m of 0.3 at the motor
    assert np.ptp(run["fin_angle"][1100:]) == 0.0
    assert np.all(run["motor_speed"][1100:] == 0.0)


def test_compensation_keeps_to_the_friction_identified() -> None:
    plain, values = load_parameters().nested(), nested(_values(), MODEL)
    for speed in (-3.0, -0.2, 0.0, 0.2, 3.0):
        assert (friction_compensation(FLOATS, values, 0.1, speed)
                == friction_compensation(FLOATS, plain, 0.1, speed))


_levels = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()), min_size=2, max_size=6)


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("base", ["nonlinear", "elastic"])
@settings(derandomize=True, max_examples=30)
@given(levels=_levels, ratio=st.floats(0.1, 10.0), speed=st.sampled_from([0.1, 3.0, 1e3]),
       dry=st.sampled_from([0.0, 5.0]), tick=st.sampled_from([2e-5, 1e-4, 1e-3]))
def test_anything_goes(base: str, levels: list[Any], ratio: float, speed: float, dry: float, tick: float) -> None:
    """Finite and within the stops, for any inputs."""
    model = f"{base}+stribeck"
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    values = load_parameters(model=model).with_values({
        "stribeck.static_ratio": ratio, "stribeck.speed": speed, "friction.fin_coulomb": dry,
        "solver.max_tick": tick}).values
    run = simulate(values, (len(commands) - 1) * 1e-3, model=model, fin_command=commands, aero_torque=torques,
                   enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)


@pytest.mark.parametrize("base", BASES)
def test_back_ends_are_one(base: str) -> None:
    """Bit for bit, through stick, slip, flanks and a disabled drive."""
    model = f"{base}+stribeck"
    values = load_parameters(model=model).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.02 * sin(40.0 * t),
                              "aero_torque": lambda t: 40.0 * sin(70.0 * t),
                              "enable": lambda t: not 0.06 < t < 0.08}
    runs = [simulate(values, 0.12, model=model, kernel=kernel, **inputs) for kernel in ("python", "compiled")]
    for name, column in runs[0].items():
        assert np.array_equal(column, runs[1][name]), name


@pytest.mark.parametrize(("name", "value"), [
    ("stribeck.static_ratio", 0.09), ("stribeck.static_ratio", 11.0), ("stribeck.static_ratio", float("nan")),
    ("stribeck.speed", 0.0), ("stribeck.speed", 0.09), ("stribeck.speed", -1.0), ("stribeck.speed", "1 m/s")])
def test_bad_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        _values({name: value})


@pytest.mark.parametrize(("model", "reason"), [
    ("linear+stribeck", "stribeck needs Coulomb friction at the motor; linear has none"),
    ("second-order+stribeck", "stribeck needs Coulomb friction at the motor; second-order has none"),
    ("nonlinear+lugre+stribeck", "lugre needs Coulomb friction at the motor, which stribeck replaces")])
def test_where_it_does_not_belong_it_is_refused(model: str, reason: str) -> None:
    with pytest.raises(EmcasError, match=reason):
        get(model)
