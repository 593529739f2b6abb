"""Stribeck friction at the motor, against an independent integration with events and Coulomb friction."""

from __future__ import annotations

from functools import partial
from math import radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.control.controllers import friction_compensation
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import friction
from emcas_fmu.simulation import simulate
from tests.marks import slow
from tests.runs import assert_equal, input_levels, run_both_kernels, run_within_stops
from tests.simulation import nested

from . import runs
from .friction_reference import IDEAL, Dry

MODEL = "nonlinear+stribeck"
BASES = ("nonlinear", *slow("elastic", "habibi", "ozkan", "ristanovic"))
values_of = partial(runs.values_of, model=MODEL)


def _ramp(rate: float) -> Any:
    """Return a command that rises with a rate [deg/s]."""
    return lambda t: radians(rate) * t


@pytest.mark.parametrize("base", BASES)
def test_with_a_static_ratio_of_one_no_bit_changes(base: str) -> None:
    model = f"{base}+stribeck"
    values = load_parameters(model=model).with_values({"stribeck.static_ratio": 1.0}).values
    plain = {name: value for name, value in values.items() if not name.startswith("stribeck.")}
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.1 if sin(25.0 * t) > 0.0 else -0.1,
                              "aero_torque": lambda t: 30.0 * sin(60.0 * t), "enable": lambda t: not 0.1 < t < 0.13}
    expected = simulate(plain, 0.3, model=base, **inputs)
    assert_equal(simulate(values, 0.3, model=model, **inputs), expected)
    rough = simulate({**values, "stribeck.static_ratio": 2.0}, 0.3, model=model, **inputs)
    assert np.abs(rough["fin_angle"] - expected["fin_angle"]).max() > 1e-6


@pytest.mark.parametrize("static", [1.5, 0.6])
def test_dry_friction_falls_from_the_static_ratio_to_coulomb_friction(static: float) -> None:
    """With a disabled drive a hinge moment just below and above breakaway acts on the fin at angle 0."""
    values = values_of({"stribeck.static_ratio": static})
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
        assert shares == pytest.approx(1.0 + (static - 1.0) * np.exp([0.0, -0.25, -1.0, -np.inf]), rel=1e-12)
        frozen = nested(values_of({"stribeck.static_ratio": static, "friction.temperature": -6.0,
                                 "friction.table.coulomb[1]": 1.25}), MODEL)
        assert friction.coulomb(FLOATS, frozen, way, 0.1, 0.0) == pytest.approx(
            1.25 * friction.coulomb(FLOATS, p, way, 0.1, 0.0), rel=1e-12)
        # A speed against the direction, as predicted beyond a reversal, counts as rest.
        assert friction.coulomb(FLOATS, p, way, 0.1, -way) == friction.coulomb(FLOATS, p, way, 0.1, 0.0)


def test_independent_integration_agrees_on_stick_slip() -> None:
    """To second order, in a slow ramp in which the motor breaks away and sticks a few times."""
    values = values_of({**IDEAL, "stribeck.static_ratio": 1.5})
    exact, speed = Dry(values).closed_loop(0.6, _ramp(0.3))
    assert 2 < int(np.sum((speed[:-1] == 0.0) & (speed[1:] != 0.0))) < 20
    errors = []
    for tick in (2e-4, 1e-4, 5e-5, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, 0.6, model=MODEL, fin_command=_ramp(0.3))
        errors.append(np.abs(run["fin_angle"] - exact).max())
        assert np.array_equal(run["motor_speed"] == 0.0, speed == 0.0)  # the motor sticks at the same samples
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.1), slopes  # an event or friction one step late would have slope 1
    assert np.degrees(errors[1]) < 2e-5  # default tick; measured 1.1e-5, 1.4e-2 of a motor count


@pytest.mark.parametrize(("ratio", "largest"), [(1.5, 1e-6), *slow((0.5, 2e-6))])  # deg; measured 1.3e-6 at 0.5
def test_a_reversal_under_load_is_of_second_order(ratio: float, largest: float) -> None:
    values = values_of({**IDEAL, "stribeck.static_ratio": ratio, "stribeck.speed": 3.0})

    def command(t: float) -> float:
        return radians(0.5) if t > 0.01 else 0.0

    exact, speed = Dry(values, -20.0).closed_loop(0.15, command)
    assert speed.min() < -0.5 < 0.5 < speed.max()
    errors = [np.abs(simulate({**values, "solver.max_tick": tick}, 0.15, model=MODEL, fin_command=command,
                              aero_torque=-20.0)["fin_angle"] - exact).max() for tick in (1e-4, 5e-5, 2.5e-5)]
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.15)
    assert np.degrees(errors[0]) < largest


def test_a_narrow_excess_is_of_second_order_at_fine_ticks() -> None:
    """At the least Stribeck speed, 0.1 rad/s, and s = 2 the motor passes the excess in J w_s/((s - 1) C_m) = 0.15 ms.
    """
    values = values_of({**IDEAL, "stribeck.static_ratio": 2.0, "stribeck.speed": 0.1})

    def command(t: float) -> float:
        return 0.02 * sin(20.0 * t)

    exact, _ = Dry(values).closed_loop(0.3, command)
    errors = [np.abs(simulate({**values, "solver.max_tick": tick}, 0.3, model=MODEL, fin_command=command)["fin_angle"]
                     - exact).max() for tick in (5e-5, 2.5e-5, 1.25e-5)]
    assert errors[0] / errors[-1] == pytest.approx(16.0, rel=0.3)  # 0.15 ms is not far above the first tick
    assert np.degrees(errors[0]) < 2e-5


@pytest.mark.slow
def test_elastic_is_of_second_order() -> None:
    """Compared with the finest tick, with contacts, rest and breakaway of both sides."""
    model = "elastic+stribeck"
    values = load_parameters(model=model).with_values({"encoder.enabled": False, "stribeck.static_ratio": 2.0}).values

    def run(tick: float) -> Any:
        return simulate({**values, "solver.max_tick": tick}, 0.15, model=model, aero_torque=-30.0,
                        fin_command=lambda t: 0.05 * sin(40.0 * t))["fin_angle"]

    finest = run(1e-4 / 64)
    errors = [np.abs(run(1e-4 / 2**n) - finest).max() for n in range(4)]
    slope = np.polyfit(np.log([8.0, 4.0, 2.0, 1.0]), np.log(errors), 1)[0]
    # Events move between ticks; by second order the error of the finest tick is 1/64 of the last.
    assert slope == pytest.approx(2.0, abs=0.2), errors


def test_stick_slip_needs_a_static_ratio_above_one_and_a_slow_motion() -> None:
    """As in textbooks, with the position loop as the compliance."""
    def starts(ratio: float, rate: float) -> int:
        run = simulate(values_of({**IDEAL, "stribeck.static_ratio": ratio}), 3.0, model=MODEL, fin_command=_ramp(rate))
        rests = run["motor_speed"][1000:] == 0.0
        return int(np.sum(rests[:-1] & ~rests[1:]))

    assert starts(1.5, 0.3) > 8
    assert starts(1.0, 0.3) == starts(0.5, 0.3) == 0
    assert starts(1.5, 3.0) == 0


def test_a_fin_at_rest_does_not_creep() -> None:
    values = values_of({"stribeck.static_ratio": 1.5})
    run = simulate(values, 2.0, model=MODEL, enable=lambda t: t < 1.0, fin_command=0.05,
                   aero_torque=lambda t: -10.0 if t < 1.5 else 10.0)  # 0.16 N.m of 0.3 at the motor
    assert np.ptp(run["fin_angle"][1100:]) == 0.0
    assert np.all(run["motor_speed"][1100:] == 0.0)


def test_friction_compensation_does_not_use_stribeck_friction() -> None:
    plain, values = load_parameters().nested(), nested(values_of(), MODEL)
    for speed in (-3.0, -0.2, 0.0, 0.2, 3.0):
        assert (friction_compensation(FLOATS, values, 0.1, speed)
                == friction_compensation(FLOATS, plain, 0.1, speed))


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("base", ["nonlinear", "elastic"])
@settings(derandomize=True, max_examples=30)
@given(levels=input_levels(6), ratio=st.floats(0.1, 10.0), speed=st.sampled_from([0.1, 3.0, 1e3]),
       dry=st.sampled_from([0.0, 5.0]), tick=st.sampled_from([2e-5, 1e-4, 1e-3]))
def test_any_inputs_give_finite_outputs_within_the_stops(base: str, levels: list[Any], ratio: float, speed: float,
                                                         dry: float, tick: float) -> None:
    model = f"{base}+stribeck"
    run_within_stops(values_of({"stribeck.static_ratio": ratio, "stribeck.speed": speed, "friction.fin_coulomb": dry,
                          "solver.max_tick": tick}, model=model), model, levels)


@pytest.mark.parametrize("base", BASES)
def test_kernels_agree(base: str) -> None:
    """Through stick, slip, contacts and a disabled drive."""
    model = f"{base}+stribeck"
    run_both_kernels(values_of(model=model), 0.12, model, fin_command=lambda t: 0.02 * sin(40.0 * t),
                     aero_torque=lambda t: 40.0 * sin(70.0 * t), enable=lambda t: not 0.06 < t < 0.08)
