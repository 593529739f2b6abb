"""Order of accuracy and independence of the host's step sizes."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, radians, sin
from typing import Any

import numpy as np
import pytest

from emcas_fmu.reference.cases import CASES
from emcas_fmu.reference.simulate import simulate as reference_of
from tests.marks import slow

from ..marks import others_slow
from ..simulation import NAMES, inputs_at_rest, new_core, simulate

# The ticks divide both parts of the sample period (0.7 and 0.3 ms) evenly.
TICKS = [1e-4 / 2**n for n in range(4)]
FINEST = 1e-4 / 2**7


def _smooth(values: Mapping[str, Any]) -> dict[str, Any]:
    """Motion without reversal, quantisation or clipping: a slow start against a load that grows."""
    return {**values, "encoder.enabled": False}


def _ramp(t: float) -> float:
    return radians(8.0) * t / 0.1


def test_second_order_where_the_motion_is_smooth(values: Mapping[str, Any]) -> None:
    def angles(tick: float) -> np.ndarray:
        result = simulate({**_smooth(values), "solver.max_tick": tick}, 0.1, fin_command=_ramp,
                          aero_torque=lambda t: -100.0 * t)
        return result["fin_angle"][20:]  # after breakaway

    finest = angles(FINEST)
    errors = [np.abs(angles(tick) - finest).max() for tick in TICKS]
    slope = np.polyfit(np.log(TICKS), np.log(errors), 1)[0]
    # A second-order method shows 2; the reference's own error (1/256 of the finest tick's 1/16) and
    # the third-order term move the fit by less than 0.15.
    assert 1.85 < slope < 2.3, (slope, errors)


def test_no_order_is_lost_at_events(values: Mapping[str, Any]) -> None:
    """Breakaway, reversal, voltage and current limits, a stop: events are placed, not stepped over."""
    def angles(tick: float) -> np.ndarray:
        return simulate({**values, "encoder.enabled": False, "solver.max_tick": tick}, 0.3,
                        fin_command=lambda t: radians(20.0) if t < 0.12 else radians(-15.0),
                        aero_torque=lambda t: 60.0 * sin(40.0 * t))["fin_angle"]

    finest = angles(1e-4 / 2**8)
    ticks = [1e-4 / 2**n for n in range(2, 6)]
    errors = [np.abs(angles(tick) - finest).max() for tick in ticks]
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    # An event stepped over costs an order (slope 1). The reference's own error, 1/64 of the last
    # point's, and events moving between ticks shift the fit of four points by less than 0.25.
    assert 1.75 < slope < 2.25, (slope, errors)


def test_shipped_tick_is_accurate_enough(values: Mapping[str, Any]) -> None:
    def angles(tick: float) -> np.ndarray:
        return simulate({**values, "encoder.enabled": False, "solver.max_tick": tick}, 0.25,
                        fin_command=radians(20.0))["fin_angle"]

    error = degrees(np.abs(angles(values["solver.max_tick"]) - angles(FINEST)).max())
    assert error < 0.002 / 4, error  # a quarter of the budget; encoder chatter may use the rest


@pytest.mark.parametrize("grid", ["coarse", "fine", "ragged"])
def test_the_host_grid_leaves_the_trajectory_alone(values: Mapping[str, Any], grid: str) -> None:
    inputs = inputs_at_rest(radians(12.0), -30.0, 39.0)
    step = {"coarse": 10e-3, "fine": 1e-3, "ragged": 0.37e-3}[grid]
    reference = new_core(values)
    other = new_core(values)
    stop = 0.37
    for k in range(round(stop / 37e-3)):
        reference.run((k + 1) * 37e-3, inputs)
    k = 0
    time = 0.0
    while time < stop - 1e-12:
        k += 1
        time = min(k * step, stop)
        other.run(time, inputs)
    # The trajectory is the same bit for bit; only the last partial tick may differ.
    assert other.outputs(inputs) == reference.outputs(inputs)


def test_results_inside_a_tick_lie_on_the_trajectory(values: Mapping[str, Any]) -> None:
    inputs = inputs_at_rest(radians(10.0), 0.0, 39.0)
    fine = new_core({**values, "encoder.enabled": False, "solver.max_tick": 1e-5})
    coarse = new_core({**values, "encoder.enabled": False})
    worst = 0.0
    for k in range(1, 1000):
        fine.run(k * 0.13e-3, inputs)
        coarse.run(k * 0.13e-3, inputs)
        worst = max(worst, abs(fine.outputs(inputs)[0] - coarse.outputs(inputs)[0]))
    assert degrees(worst) < 0.002 / 4  # the same budget as at ticks


def test_inputs_that_change_inside_a_tick_act_by_their_mean(values: Mapping[str, Any]) -> None:
    """A load sampled on a grid the ticks do not know converges to the one sampled finely."""
    def angle(step: float) -> float:
        return float(simulate({**values, "encoder.enabled": False}, 0.2, step=step, fin_command=radians(5.0),
                              aero_torque=lambda t: -80.0 * sin(60.0 * (t + step / 2)))["fin_angle"][-1])

    # Midpoint sampling of the load is itself second order in the step: 0.25 ms against 0.05 ms.
    assert abs(angle(0.25e-3) - angle(0.05e-3)) < radians(2e-4)


def test_delay_is_exact_whatever_the_tick(values: Mapping[str, Any]) -> None:
    current = NAMES.index("motor_current")
    quiet = {**values, "drive.current_offset": 0.0, "encoder.enabled": False}
    for delay in (0.0, 0.41e-3, 1e-3, 3.7e-3, 7.25e-3):
        case = {**quiet, "drive.transport_delay": delay}
        core = new_core(case)
        inputs = inputs_at_rest(radians(10.0), 0.0, 39.0)
        core.run(delay + 1e-9, inputs)
        assert core.outputs(inputs)[current] == 0.0
        core.run(delay + 0.05e-3, inputs)
        assert core.outputs(inputs)[current] > 1.0  # 39 V/0.6 mH raise 3.2 A in 50 us


@pytest.mark.parametrize("integral_gain", others_slow(
    [0.0, 5.0, 20.0, 100.0, 2083.0, 1e5], lambda gain: gain == 0.0))
def test_any_integral_gain_of_the_drive(values: Mapping[str, Any], integral_gain: float) -> None:
    """From none to one that pins the demand at the voltage limit, against the independent integration."""
    case = {**values, "encoder.enabled": False, "drive.ki": integral_gain}
    time = np.arange(201) * 1e-3
    load = np.where(time > 19.5e-3, -60.0, 0.0)
    reference = reference_of(case, {"time": time, "fin_command": np.full(201, radians(12.0)), "aero_torque": load})
    angle = simulate(case, 0.2, fin_command=radians(12.0), aero_torque=lambda t: -60.0 if t > 19.5e-3 else 0.0)
    # The trajectory criterion of the reference cases: 1 % of Table 2's accuracy.
    assert degrees(np.abs(angle["fin_angle"] - reference["fin_angle"]).max()) < 0.002


def _slews(time: Any) -> dict[str, Any]:
    """Return the inputs of 20 deg steps whose second meets a supply that has sagged to 30 V."""
    command = np.radians(np.select([time < 0.0095, time < 0.2495, time < 0.4695], [0.0, 20.0, -20.0], 20.0))
    return {"fin_command": command, "supply_voltage": np.where((time > 0.2595) & (time < 0.5995), 30.0, 39.0)}


@pytest.mark.slow
@pytest.mark.parametrize("integral_gain", [0.1, 100.0])
@pytest.mark.parametrize("load", [-100.0, 100.0])
def test_a_voltage_limit_that_moves_with_speed_and_current(values: Mapping[str, Any], load: float,
                                                           integral_gain: float) -> None:
    """4 pole pairs on a sagging supply against the independent integration."""
    case = {**values, "encoder.enabled": False, "motor.pole_pairs": 4, "drive.ki": integral_gain}
    time = np.arange(701) * 1e-3
    inputs = {**_slews(time), "aero_torque": np.where(time > 0.0195, load, 0.0)}
    reference = reference_of(case, {"time": time, **inputs})
    found = simulate(case, 0.7, **inputs)
    # The trajectory criterion of the reference cases.
    assert degrees(np.abs(found["fin_angle"] - reference["fin_angle"]).max()) < 0.002
    # Of a current of up to 58 A; where a limit is met or left within a tick, that is not placed better.
    assert np.abs(found["motor_current"] - reference["motor_current"]).max() < 0.2
    speed, current = found["motor_speed"], found["motor_current"]
    left = np.sqrt(np.append(inputs["supply_voltage"][:1], inputs["supply_voltage"][:-1])**2
                   - (4.0 * speed * case["motor.inductance"] * current)**2)
    assert left.min() < 25.0
    assert np.all(np.abs(found["motor_voltage"]) <= left * (1.0 + 1e-12))
    limited = np.abs(found["motor_voltage"]) > left * (1.0 - 1e-12)
    assert np.all(found["saturated"][limited] == 1.0)


def test_second_order_while_the_voltage_limit_moves(values: Mapping[str, Any]) -> None:
    def angles(tick: float) -> np.ndarray:
        case = {**_smooth(values), "motor.pole_pairs": 4, "solver.max_tick": tick}
        return simulate(case, 0.08, fin_command=radians(20.0), supply_voltage=30.0)["fin_angle"]

    finest = angles(1e-4 / 2**8)
    ticks = [1e-4 / 2**n for n in range(1, 5)]
    errors = [np.abs(angles(tick) - finest).max() for tick in ticks]
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    # A limit of the step's start would show 1. The events it has move the fit of four points by less than 0.25.
    assert 1.75 < slope < 2.3, (slope, errors)


@pytest.mark.parametrize("step", [0.37e-3, *slow(0.5e-3, 0.25e-3)])
def test_enable_inside_a_tick_acts_at_once(values: Mapping[str, Any], step: float) -> None:
    case = {**values, "encoder.enabled": False}
    time = np.round(np.arange(round(0.15 / step) + 1) * step, 9)
    enable = (time < 0.0502) | (time > 0.0803)
    reference = reference_of(case, {"time": time, "fin_command": np.full(time.size, 0.3), "enable": enable * 1.0})
    angle = simulate(case, 0.15, step=step, fin_command=0.3, enable=lambda t: t < 0.0502 or t > 0.0803)
    rows = min(time.size, angle["time"].size)
    assert degrees(np.abs(angle["fin_angle"][:rows] - reference["fin_angle"][:rows]).max()) < 0.002


def test_supply_that_changes_inside_a_tick(values: Mapping[str, Any]) -> None:
    """A jump of the bus off the ticks: against ticks that fall on it."""
    def angle(tick: float) -> np.ndarray:
        return simulate({**values, "encoder.enabled": False, "solver.max_tick": tick}, 0.15, step=0.25e-3,
                        fin_command=radians(20.0), supply_voltage=lambda t: 39.0 if t < 0.0202 else 15.0)["fin_angle"]

    assert degrees(np.abs(angle(values["solver.max_tick"]) - angle(5e-6)).max()) < 0.002


def test_without_supply_the_motor_brakes(values: Mapping[str, Any]) -> None:
    """At 0 V the bridge shorts the winding: current follows L di/dt = -R i - K w, here against tiny ticks."""
    def angle(tick: float) -> np.ndarray:
        return simulate({**values, "encoder.enabled": False, "solver.max_tick": tick}, 0.1, supply_voltage=0.0,
                        fin_command=0.2, aero_torque=60.0)["fin_angle"]

    coarse, fine = angle(values["solver.max_tick"]), angle(5e-6)
    assert abs(fine[-1]) > radians(0.5)
    assert degrees(np.abs(coarse - fine).max()) < 0.002


def test_with_the_encoder_both_integrations_converge_to_one_trajectory(values: Mapping[str, Any]) -> None:
    """Counts, stiction and all. Coarse ticks part from it by a count here and there and what stiction makes of it."""
    case = next(c for c in CASES if c.name == "step")
    inputs = {name: column[:351] for name, column in case.inputs().items()}
    reference = reference_of(values, inputs)["fin_angle"]

    def error(tick: float) -> float:
        found = simulate({**values, "solver.max_tick": tick}, 0.35, fin_command=inputs["fin_command"])["fin_angle"]
        return degrees(float(np.abs(found - reference).max()))

    # Below what one count more or less would do to a slew: 0.7 thousandths of a degree.
    assert min(error(1e-5), error(5e-6), error(2e-6)) < 1e-4
    assert error(values["solver.max_tick"]) < 0.01  # a twentieth of Table 2's accuracy
