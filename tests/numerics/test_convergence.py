"""The order of convergence, and the same trajectory for any step size of the host."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees, radians, sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.reference.cases import CASES
from emcas_fmu.reference.plant import simulate as reference_of
from tests.marks import others_slow, slow

from ..simulation import NAMES, inputs_at_rest, new_core, simulate

FINEST = 1e-4 / 2**7  # s
CRITERION = 0.002  # deg, of the reference cases: 1 % of Table 2's accuracy


@pytest.fixture
def values(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Replace the shipped parameters in this file: no encoder, whose counts would hide the order of convergence."""
    return {**values, "encoder.enabled": False}


def order(angles: Callable[[float], np.ndarray], halvings: Sequence[int], finest: int) -> tuple[float, list[float]]:
    """Return the slope of the error over the tick (logarithms), and the errors; ticks are 0.1 ms halved n times."""
    reference, ticks = angles(1e-4 / 2**finest), [1e-4 / 2**n for n in halvings]
    errors = [np.abs(angles(tick) - reference).max() for tick in ticks]
    return np.polyfit(np.log(ticks), np.log(errors), 1)[0], errors


def test_smooth_motion_has_second_order(values: Mapping[str, Any]) -> None:
    """A ramp against a growing load has no reversal and reaches no limit."""
    def angles(tick: float) -> np.ndarray:
        result = simulate({**values, "solver.max_tick": tick}, 0.1, fin_command=lambda t: radians(8.0) * t / 0.1,
                          aero_torque=lambda t: -100.0 * t)
        return result["fin_angle"][20:]  # after breakaway

    slope, errors = order(angles, range(4), 7)
    # A second-order method shows 2. The reference's own error, 1/256 of that at the fit's shortest tick, and the
    # third-order term move the fit by less than 0.15.
    assert 1.85 < slope < 2.3, (slope, errors)


def test_events_keep_second_order(values: Mapping[str, Any]) -> None:
    """Steps end at breakaway, reversals, voltage and current limits."""
    def angles(tick: float) -> np.ndarray:
        return simulate({**values, "solver.max_tick": tick}, 0.3,
                        fin_command=lambda t: radians(20.0) if t < 0.12 else radians(-15.0),
                        aero_torque=lambda t: 60.0 * sin(40.0 * t))["fin_angle"]

    slope, errors = order(angles, range(2, 6), 8)
    # An event inside a step costs an order (slope 1). The reference's own error, 1/64 of that at the fit's shortest
    # tick, and events that move between ticks shift the fit of four points by less than 0.25.
    assert 1.75 < slope < 2.25, (slope, errors)


def test_shipped_tick_is_accurate_enough(values: Mapping[str, Any]) -> None:
    def angles(tick: float) -> np.ndarray:
        return simulate({**values, "solver.max_tick": tick}, 0.25, fin_command=radians(20.0))["fin_angle"]

    error = degrees(np.abs(angles(values["solver.max_tick"]) - angles(FINEST)).max())
    assert error < CRITERION / 4, error  # encoder chatter may use the rest


@pytest.mark.parametrize("grid", ["coarse", "fine", "ragged"])
def test_trajectory_does_not_depend_on_the_host_steps(values: Mapping[str, Any], grid: str) -> None:
    inputs = inputs_at_rest(radians(12.0), -30.0, 39.0)
    step = {"coarse": 10e-3, "fine": 1e-3, "ragged": 0.37e-3}[grid]
    values = {**values, "encoder.enabled": True}
    reference, other = new_core(values), new_core(values)
    for k in range(1, 11):
        reference.run(k * 37e-3, inputs)
    for k in range(1, round(0.37 / step) + 1):
        other.run(min(k * step, 10 * 37e-3), inputs)
    assert other.outputs(inputs) == reference.outputs(inputs)


def test_outputs_inside_a_tick_lie_on_the_trajectory(values: Mapping[str, Any]) -> None:
    inputs = inputs_at_rest(radians(10.0), 0.0, 39.0)
    fine, coarse, worst = new_core({**values, "solver.max_tick": 1e-5}), new_core(values), 0.0
    for k in range(1, 1000):
        fine.run(k * 0.13e-3, inputs)
        coarse.run(k * 0.13e-3, inputs)
        worst = max(worst, abs(fine.outputs(inputs)[0] - coarse.outputs(inputs)[0]))
    assert degrees(worst) < CRITERION / 4  # as at ticks


def test_inputs_that_change_inside_a_tick_act_by_their_mean(values: Mapping[str, Any]) -> None:
    """A load that changes between ticks converges to a finely sampled load."""
    def angle(step: float) -> float:
        return float(simulate(values, 0.2, step=step, fin_command=radians(5.0),
                              aero_torque=lambda t: -80.0 * sin(60.0 * (t + step / 2)))["fin_angle"][-1])

    # Sampling the load at the middle of a step is itself of second order. Measured: 2.4e-6 deg.
    assert abs(angle(0.25e-3) - angle(0.05e-3)) < radians(2e-4)


def test_delay_is_exact_for_any_fraction_of_a_tick(values: Mapping[str, Any]) -> None:
    current, inputs = NAMES.index("motor_current"), inputs_at_rest(radians(10.0), 0.0, 39.0)
    for delay in (0.0, 0.41e-3, 1e-3, 3.7e-3, 7.25e-3):
        core = new_core({**values, "drive.current_offset": 0.0, "drive.transport_delay": delay})
        core.run(delay + 1e-9, inputs)
        assert core.outputs(inputs)[current] == 0.0
        core.run(delay + 0.05e-3, inputs)
        assert core.outputs(inputs)[current] > 1.0  # 39 V/0.6 mH raise 3.2 A in 50 us


@pytest.mark.parametrize("integral_gain", others_slow([0.0, 5.0, 20.0, 100.0, 2083.0, 1e5], lambda gain: gain == 0.0))
def test_any_integral_gain_of_the_drive_agrees_with_the_reference(values: Mapping[str, Any], integral_gain: float
                                                                  ) -> None:
    """From 0 to a gain that keeps the drive's demand at the voltage limit, against the independent integration."""
    case = {**values, "drive.ki": integral_gain}
    time = np.arange(201) * 1e-3
    load = np.where(time > 19.5e-3, -60.0, 0.0)
    reference = reference_of(case, {"time": time, "fin_command": np.full(201, radians(12.0)), "aero_torque": load})
    angle = simulate(case, 0.2, fin_command=radians(12.0), aero_torque=lambda t: -60.0 if t > 19.5e-3 else 0.0)
    assert degrees(np.abs(angle["fin_angle"] - reference["fin_angle"]).max()) < CRITERION


def _slews(time: Any) -> dict[str, Any]:
    """Return a command of steps to 20, -20 and 20 deg, and a supply that sags to 30 V 10 ms after the second."""
    command = np.radians(np.select([time < 0.0095, time < 0.2495, time < 0.4695], [0.0, 20.0, -20.0], 20.0))
    return {"fin_command": command, "supply_voltage": np.where((time > 0.2595) & (time < 0.5995), 30.0, 39.0)}


@pytest.mark.slow
@pytest.mark.parametrize("integral_gain", [0.1, 100.0])
@pytest.mark.parametrize("load", [-100.0, 100.0])
def test_moving_voltage_limit_agrees_with_the_reference(values: Mapping[str, Any], load: float, integral_gain: float
                                                        ) -> None:
    """With pole pairs the limit depends on speed and current; the supply sags, too."""
    case = {**values, "motor.pole_pairs": 4, "drive.ki": integral_gain}
    time = np.arange(701) * 1e-3
    inputs = {**_slews(time), "aero_torque": np.where(time > 0.0195, load, 0.0)}
    reference = reference_of(case, {"time": time, **inputs})
    run = simulate(case, 0.7, **inputs)
    assert degrees(np.abs(run["fin_angle"] - reference["fin_angle"]).max()) < CRITERION
    # The current is up to 58 A. The instants at which it reaches or leaves a limit within a tick are not more accurate.
    assert np.abs(run["motor_current"] - reference["motor_current"]).max() < 0.2
    speed, current = run["motor_speed"], run["motor_current"]
    limit = np.sqrt(np.append(inputs["supply_voltage"][:1], inputs["supply_voltage"][:-1])**2
                    - (4.0 * speed * case["motor.inductance"] * current)**2)
    assert limit.min() < 25.0
    assert np.all(np.abs(run["motor_voltage"]) <= limit * (1.0 + 1e-12))
    limited = np.abs(run["motor_voltage"]) > limit * (1.0 - 1e-12)
    assert np.all(run["saturated"][limited] == 1.0)


def test_moving_voltage_limit_keeps_second_order(values: Mapping[str, Any]) -> None:
    def angles(tick: float) -> np.ndarray:
        case = {**values, "motor.pole_pairs": 4, "solver.max_tick": tick}
        return simulate(case, 0.08, fin_command=radians(20.0), supply_voltage=30.0)["fin_angle"]

    slope, errors = order(angles, range(1, 5), 8)
    # The limit at the step's start, used for the whole step, would show 1. Events move the fit by less than 0.25.
    assert 1.75 < slope < 2.3, (slope, errors)


@pytest.mark.parametrize("step", [0.37e-3, *slow(0.5e-3, 0.25e-3)])
def test_enable_inside_a_tick_acts_at_once(values: Mapping[str, Any], step: float) -> None:
    time = np.round(np.arange(round(0.15 / step) + 1) * step, 9)
    enable = (time < 0.0502) | (time > 0.0803)
    reference = reference_of(values, {"time": time, "fin_command": np.full(time.size, 0.3), "enable": enable * 1.0})
    angle = simulate(values, 0.15, step=step, fin_command=0.3, enable=lambda t: t < 0.0502 or t > 0.0803)
    rows = min(time.size, angle["time"].size)
    assert degrees(np.abs(angle["fin_angle"][:rows] - reference["fin_angle"][:rows]).max()) < CRITERION


def test_supply_jump_inside_a_tick_acts_at_once(values: Mapping[str, Any]) -> None:
    """Compared with ticks that end at the jump."""
    def angle(tick: float) -> np.ndarray:
        return simulate({**values, "solver.max_tick": tick}, 0.15, step=0.25e-3, fin_command=radians(20.0),
                        supply_voltage=lambda t: 39.0 if t < 0.0202 else 15.0)["fin_angle"]

    assert degrees(np.abs(angle(values["solver.max_tick"]) - angle(5e-6)).max()) < CRITERION


def test_without_supply_the_motor_brakes(values: Mapping[str, Any]) -> None:
    """At 0 V the bridge shorts the winding: L di/dt = -R i - K w. Compared with ticks of 5 us."""
    def angle(tick: float) -> np.ndarray:
        return simulate({**values, "solver.max_tick": tick}, 0.1, supply_voltage=0.0, fin_command=0.2,
                        aero_torque=60.0)["fin_angle"]

    coarse, fine = angle(values["solver.max_tick"]), angle(5e-6)
    assert abs(fine[-1]) > radians(0.5)
    assert degrees(np.abs(coarse - fine).max()) < CRITERION


def test_trajectory_with_the_encoder_converges_to_the_reference(values: Mapping[str, Any]) -> None:
    """At longer ticks single counts of the encoder come a sample earlier or later, and stiction amplifies that."""
    values = {**values, "encoder.enabled": True}
    case = next(c for c in CASES if c.name == "step")
    inputs = {name: column[:351] for name, column in case.inputs().items()}
    reference = reference_of(values, inputs)["fin_angle"]

    def error(tick: float) -> float:
        angle = simulate({**values, "solver.max_tick": tick}, 0.35, fin_command=inputs["fin_command"])["fin_angle"]
        return degrees(float(np.abs(angle - reference).max()))

    # Less than one count of the encoder, 0.7 thousandths of a degree.
    assert min(error(1e-5), error(5e-6), error(2e-6)) < 1e-4
    assert error(values["solver.max_tick"]) < 0.01  # a twentieth of Table 2's accuracy
