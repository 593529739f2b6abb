"""The digital servo: independent integration, order of convergence, data-sheet values, friction and firmware."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, pi, radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference.servo import simulate as reference_of
from emcas_fmu.simulation import simulate

from .checks import convergence_order
from .hammers import Signal, jumps

Array = np.ndarray[Any, Any]
BASE = load_parameters(model="servo")
EXACT = {"encoder.enabled": False}
WITHOUT_FRICTION = {"friction.gear": 0.0, "friction.gear_load": 0.0, "friction.gear_load_rise": 0.0,
                    "friction.gear_viscous": 0.0, "friction.fin_coulomb": 0.0}


def run_of(overrides: Mapping[str, Any], stop: float, **inputs: Any) -> Mapping[str, Array]:
    return simulate(BASE.with_values(overrides).values, stop, model="servo", **inputs)


STEPS = jumps((0.02, 0.17), (0.2, -0.13))
CASES: dict[str, tuple[dict[str, Signal], dict[str, Any]]] = {
    "steps": ({"fin_command": STEPS}, {}),
    "no play": ({"fin_command": STEPS}, {"gear.backlash": 0.0}),
    "load": ({"fin_command": STEPS, "aero_torque": jumps((0.1, -6.0), (0.3, 6.0))}, {}),
    "hinge": ({"fin_command": STEPS}, {"friction.fin_coulomb": 0.5, "friction.fin_viscous": 0.1}),
    "stop": ({"aero_torque": jumps((0.02, 60.0))}, {}),
    "integral": ({"fin_command": STEPS, "aero_torque": jumps((0.1, -6.0))}, {
        "controller.ki": 40.0, "pwm.limit": 600.0, "controller.dead_band": 2.5, "motor.asymmetry": -0.2}),
    "disabled": ({"fin_command": STEPS, "aero_torque": lambda t: 10.0 * np.sin(20.0 * t),
                  "enable": lambda t: t < 0.1}, {}),
    "vehicle": ({"fin_command": jumps((0.02, 0.1)), "acceleration.x": lambda t: np.full_like(t, 50.0),
                 "angular_acceleration.y": jumps((0.1, 200.0)), "attitude.pitch": lambda t: np.full_like(t, 0.3)},
                {"loads.gravity": True, "mass.fin": 3.0}),
}


def inputs_of(name: str, stop: float) -> tuple[Array, dict[str, Array]]:
    time = np.arange(round(stop * 1e3) + 1) * 1e-3
    return time, {key: column(time) for key, column in CASES[name][0].items()}


@pytest.mark.parametrize("name", CASES)
def test_against_the_independent_integration(name: str) -> None:
    time, table = inputs_of(name, 0.4)
    overrides = {**EXACT, **CASES[name][1]}
    reference = reference_of(BASE.with_values(overrides).values,
                             {"time": time, **{key: column.astype(float) for key, column in table.items()}})
    found = run_of(overrides, 0.4, **{key.replace(".", "__"): column for key, column in table.items()})
    # The limit of the reference cases, 1 % of Table 2's accuracy; at most a half measured (disabled).
    assert degrees(np.abs(found["fin_angle"] - reference["fin_angle"]).max()) < 0.002
    # The controller's gain times this angle, as a share of the full duty cycle.
    assert np.abs(found["duty"] - reference["duty"]).max() < 5e-4


@pytest.mark.parametrize("name", ["steps", "load", "stop", "disabled"])
def test_second_order_convergence_through_events(name: str) -> None:
    _, table = inputs_of(name, 0.3)
    # Hinge friction would stop and start the fin within single ticks: an error of first order, 1e-5 deg.
    overrides = {**EXACT, **CASES[name][1], "friction.fin_coulomb": 0.0}

    def angles(tick: float) -> Array:
        return run_of({**overrides, "solver.max_tick": tick}, 0.3, **table)["fin_angle"]

    finest, ticks = angles(1e-4 / 2**6), [1e-4 / 2**n for n in range(3)]
    errors = [np.abs(angles(tick) - finest).max() for tick in ticks]
    # An event that is stepped over would give order 1; the error of the finest tick is 1/256 of that of the last tick.
    assert 1.7 < convergence_order(ticks, errors) < 2.3, errors


def test_data_sheet_values_without_friction() -> None:
    """A free motor reaches the no-load speed; while friction blocks the fin, it has the stall torque and current."""
    # After 12 time constants J w_0/T_s of 9 ms the rate has settled to 1e-5.
    free = run_of({**WITHOUT_FRICTION, "command.limit": pi, "fin.stop_angle": pi, "controller.kd": 0.0,
                   "controller.kp": 1e3}, 0.12, fin_command=pi)
    assert free["fin_rate"][-1] == pytest.approx(BASE.values["motor.no_load_speed"], rel=1e-4)
    assert free["motor_current"][-1] == pytest.approx(0.0, abs=1e-2)
    stall = BASE.values["motor.stall_torque"]
    blocked = run_of({**WITHOUT_FRICTION, "controller.kp": 1e4, "controller.kd": 0.0, "friction.fin_coulomb": 30.0},
                     0.5, fin_command=0.1)
    assert blocked["fin_angle"][-1] == 0.0
    assert blocked["gear_torque"][-1] == pytest.approx(stall, rel=1e-6)
    assert blocked["motor_current"][-1] * BASE.values["motor.nominal_voltage"] == pytest.approx(
        stall * BASE.values["motor.no_load_speed"], rel=1e-6)


def test_load_gets_no_more_energy_than_the_supply_provides() -> None:
    """This also holds for motors whose torque depends on the direction."""
    for asymmetry in (0.0, 0.3, -0.3):
        run = run_of({"motor.asymmetry": asymmetry}, 1.0, fin_command=lambda t: 0.3 * np.sin(12.0 * t),
                     aero_torque=lambda t: -5.0 * np.sin(12.0 * t))
        assert np.trapezoid(run["supply_power"] + run["hinge_torque"] * run["fin_rate"], run["time"]) > 0.0


@pytest.mark.parametrize("asymmetry", [0.0, 0.5, -0.5])
def test_an_overdriven_motor_returns_no_more_power_than_the_load_provides(asymmetry: float) -> None:
    """An aiding load drives the motor faster than without load; the motor brakes and generates."""
    run = run_of({**WITHOUT_FRICTION, "motor.asymmetry": asymmetry, "fin.stop_angle": 3.0, "command.limit": 3.0}, 0.3,
                 fin_command=2.5, aero_torque=lambda t: 2.0 if t > 0.1 else 0.0)
    steady = (run["time"] > 0.12) & (run["time"] < 0.2)
    load, supply = (run["hinge_torque"] * run["fin_rate"])[steady].mean(), run["supply_power"][steady].mean()
    assert supply < 0.0 < load + supply


def test_friction_does_not_lock_the_gear_under_loads_beyond_the_stall_torque() -> None:
    """The share of the friction rises up to the stall torque; extrapolated, it would exceed the torque."""
    values = load_parameters("xl330", model="servo").values
    moved = [simulate(values, 0.5, model="servo", fin_command=0.0, aero_torque=factor * values["motor.stall_torque"]
                      )["fin_angle"][-1] for factor in (2.0, 4.0, 8.0)]
    assert moved == sorted(moved)
    assert moved[0] > 0.1


def test_the_weaker_direction_has_less_torque() -> None:
    blocked = {**WITHOUT_FRICTION, "friction.fin_coulomb": 40.0, "controller.kp": 1e4, "controller.kd": 0.0,
               "motor.asymmetry": 0.2}
    strong, weak = (run_of(blocked, 0.5, fin_command=side * 0.1)["gear_torque"][-1] for side in (1.0, -1.0))
    assert strong == pytest.approx(BASE.values["motor.stall_torque"], rel=1e-6)
    assert weak == pytest.approx(-0.8 * strong, rel=1e-6)


@pytest.mark.parametrize("supply", [14.0, 28.0])
def test_breakaway_under_load_is_exact(supply: float) -> None:
    """A loaded gear starts when the motor's torque exceeds the load and the friction that both cause."""
    load, p = 6.0, BASE.values
    # The controller turns a slow ramp of the command into a ramp of the torque while the fin is at rest.
    rise, gain = 0.2, 5.0
    run = run_of({**EXACT, "controller.kd": 0.0, "gear.damping": 20.0}, 3.0, aero_torque=-load, supply_voltage=supply,
                 fin_command=lambda t: max(0.0, t - 0.5) * rise)
    moving = np.flatnonzero(run["motor_speed"] != 0.0)
    start = moving[moving > 500][0]  # the load has moved gear and motor before 0.5 s
    per_rad = gain * p["encoder.counts"] / (2.0 * pi) / p["pwm.full"] * supply / p["motor.nominal_voltage"]
    torque = p["motor.stall_torque"] * per_rad * (rise * (run["time"][start] - 0.5) - run["fin_angle"][start - 1])
    mean = 0.5 * (torque + load)
    friction = (p["friction.gear"] + mean * (p["friction.gear_load"] + p["friction.gear_load_rise"] * mean
                                             / p["motor.stall_torque"])) * (1.0 + p["friction.stribeck_share"])
    # The torque rises over a row, a control period and its delay, 1 ms each.
    step = p["motor.stall_torque"] * per_rad * rise * 3e-3
    assert torque - load == pytest.approx(friction, abs=step)
    assert np.all(run["fin_rate"][start - 50:start - 1] == pytest.approx(0.0, abs=1e-6))


def test_disabled_gear_holds_a_small_load_and_yields_to_a_large_one() -> None:
    run = run_of({"fin.start_angle": 0.2, "gear.backlash": 0.0}, 0.5, enable=False, aero_torque=-0.1)
    assert np.all(run["motor_speed"] == 0.0)  # less than half of friction.gear, even while the fin oscillates
    assert np.all(run["motor_current"] == 0.0)
    moved = run_of({"fin.start_angle": 0.2}, 0.5, enable=False, aero_torque=-2.0)
    assert moved["fin_angle"][-1] < 0.0
    assert np.abs(moved["supply_power"]).max() == 0.0


def test_dead_band_and_pwm_limit_of_the_firmware() -> None:
    count = 2.0 * pi / BASE.values["encoder.counts"]
    within = run_of({"controller.dead_band": 4.0}, 0.1, fin_command=3.4 * count)
    assert np.all(within["duty"] == 0.0)
    beyond = run_of({"controller.dead_band": 4.0}, 0.1, fin_command=3.6 * count)
    assert beyond["duty"][1] == pytest.approx(4.0 * BASE.values["controller.kp"] / BASE.values["pwm.full"])
    limited = run_of({"pwm.limit": 400.0}, 0.05, fin_command=0.3)
    assert np.abs(limited["duty"]).max() == pytest.approx(0.4)
    assert limited["saturated"][5] == 1.0
    with pytest.raises(ParameterError, match=r"pwm\.limit = 1001 counts must be at most pwm\.full = 1000 counts"):
        BASE.with_values({"pwm.limit": 1001.0})


def test_integral_action_removes_the_load_error() -> None:
    def error(gain: float) -> float:
        run = run_of({"controller.ki": gain, "friction.gear_load": 0.0, "friction.gear_load_rise": 0.0,
                      "friction.gear": 0.0}, 2.0, aero_torque=-5.0)
        return abs(degrees(run["fin_angle"][-1]))

    assert error(0.0) > 0.5
    assert error(20.0) < 0.05  # two counts


def test_fin_is_free_within_the_backlash() -> None:
    play = radians(1.0)
    run = run_of({"gear.backlash": play, "friction.fin_coulomb": 0.0}, 0.02, enable=False, aero_torque=0.05)
    travelled = 0.5 * 0.05 / BASE.values["inertia.fin"] * run["time"] ** 2
    free = travelled < 0.4 * play
    # Only the fin's inertia acts, without gravity; rounding of the ticks is left.
    np.testing.assert_allclose(run["fin_angle"][free], travelled[free], rtol=1e-9, atol=1e-15)
    assert run["gear_torque"][free] == pytest.approx(0.0)
