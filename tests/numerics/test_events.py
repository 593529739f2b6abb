"""Steps with events: a fin on a spring with dry friction against its closed form, in both back ends.

A half swing that begins at the angle a ends at -(a - 2 s), s = C/k. It is half a cosine about +-s. The fin rests where
|a| <= s.
"""

from __future__ import annotations

from math import cos, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics.loads import NONE
from emcas_fmu.simulation import simulate

MODEL = str(Path(__file__).parent / "stick_slip.py")
VALUES = {**load_parameters(model=MODEL).values, "fin.stop_angle": 0.4, "fin.start_angle": 0.3,
          "controller.sample_time": 1e-3, "solver.max_tick": 1e-3}
OMEGA = sqrt(VALUES["spring.stiffness"] / VALUES["inertia.fin"])
SHIFT = VALUES["friction.fin_coulomb"] / VALUES["spring.stiffness"]
HALF = pi / OMEGA  # s, of a half swing: 31.4 ticks, so that no reversal is at the end of a tick


def closed_form(time: float) -> float:
    """Return the angle [rad] at a time [s] after release at fin.start_angle."""
    begin, angle = 0.0, VALUES["fin.start_angle"]
    while time > begin + HALF and abs(angle) > SHIFT:
        begin, angle = begin + HALF, -angle + 2.0 * SHIFT * np.sign(angle)
    if abs(angle) <= SHIFT:
        return float(angle)
    center = SHIFT * np.sign(angle)
    return float(center + (angle - center) * cos(OMEGA * (time - begin)))


def swing(kernel: str = "auto", tick: float = 1e-3) -> dict[str, Any]:
    return simulate({**VALUES, "solver.max_tick": tick}, 0.2, kernel=kernel, model=MODEL)


def test_events_keep_second_order() -> None:
    """Three reversals, then rest."""
    ticks, errors = [1e-3 / 2**n for n in range(5)], []
    for tick in ticks:
        run = swing(tick=tick)
        errors.append(max(abs(a - closed_form(t)) for t, a in zip(run["time"], run["fin_angle"], strict=True)))
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    # An event inside a step costs an order (slope 1). The third-order term and the events' instants within their ticks
    # move the fit of five points by less than 0.2; measured: 1.996.
    assert 1.8 < slope < 2.2, (slope, errors)
    # Measured: 3.5e-4 rad. An event inside a step would leave an error of the order of omega h, 0.1 of 0.3 rad.
    assert errors[0] < 1e-3


def test_fin_at_rest_does_not_move_by_a_bit() -> None:
    run = swing()
    resting = run["time"] > 5.0 * HALF
    assert np.all(run["fin_rate"][resting] == 0.0)
    assert len(set(run["fin_angle"][resting].tolist())) == 1
    assert 0.0 < abs(run["fin_angle"][-1]) <= SHIFT


def test_both_kernels_agree_to_the_bit() -> None:
    python, compiled = swing("python"), swing("compiled")
    for name, column in python.items():
        np.testing.assert_array_equal(column, compiled[name], err_msg=name)


def advance(x: dict[str, float], h: float, torque: float = 0.0) -> tuple[Record, float]:
    """Return the state after a step of at most h [s] under a torque [N.m], and the time that the step covers [s]."""
    actuator = get(MODEL)
    u = PlantInputs(**{**vars(NONE), "aero_torque": torque})
    moved, used = actuator.step(FLOATS, actuator.namespace(VALUES), Record(**x), u, h)
    return Record(**moved), float(used)


def test_a_step_ends_at_the_event() -> None:
    rate = 1.0
    x = {"fin_angle": 0.0, "fin_rate": rate}
    moved, used = advance(x, 3e-3)
    # omega t = atan(rate/(omega s)). A step of ROS2 has an error of (omega h)^3/6, at most 0.5 %; the two secants that
    # find the event have less.
    expected = np.arctan2(rate, OMEGA * SHIFT) / OMEGA
    assert used == pytest.approx(expected, abs=0.005 * 3e-3)
    assert moved.fin_rate == 0.0
    again, rest = advance(vars(moved), 3e-3)
    assert (vars(again), rest) == (vars(moved), 3e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stop_is_reached_to_the_bit_and_takes_the_speed(side: float) -> None:
    x = {"fin_angle": side * 0.39, "fin_rate": side * 40.0}
    moved, used = advance(x, 1e-3)
    assert (moved.fin_angle, moved.fin_rate) == (side * VALUES["fin.stop_angle"], 0.0)
    assert 0.0 < used < 1e-3
    # The spring, 240 N.m, moves the fin back against 24 N.m of friction. Against a load of 250 N.m it does not.
    back, _ = advance(vars(moved), 1e-4)
    assert side * back.fin_rate < 0.0
    pressed, _ = advance(vars(moved), 1e-4, side * 250.0)
    assert vars(pressed) == vars(moved)


def test_fin_at_rest_moves_only_if_the_load_exceeds_friction() -> None:
    below, above = (simulate(VALUES | {"fin.start_angle": 0.0}, 0.05, model=MODEL, aero_torque=torque)
                    for torque in (23.999, 24.001))
    assert np.all(below["fin_angle"] == 0.0)
    assert above["fin_angle"][-1] > 0.0


STIFF = ({"drive.kp": 165.0}, {"motor.inductance": 1e-5}, {"drive.kp": 165.0, "motor.pole_pairs": 5})


@pytest.mark.parametrize("values", STIFF)
def test_current_loop_much_faster_than_the_tick_survives_supply_jumps(values: dict[str, float]) -> None:
    """The current settles in a hundredth of a tick, and then follows the speed, up to the voltage limit."""
    def supply(time: float) -> float:
        return 20.0 if 0.1657 <= time < 0.1757 else 0.0 if 0.1757 <= time < 0.1857 else 39.0

    default, fine = (simulate({**load_parameters().values, "encoder.enabled": False, **values,
                               "solver.max_tick": tick}, 0.2, fin_command=lambda t: 0.35 * np.sin(40.0 * t),
                              supply_voltage=supply) for tick in (7e-4, 2e-5))
    # Measured: up to 0.0008 deg at the default tick, of a motion of 40 deg.
    np.testing.assert_allclose(np.degrees(default["fin_angle"]), np.degrees(fine["fin_angle"]), rtol=0.0, atol=0.002)


@pytest.mark.parametrize("supply", [1e-9, 3e-7, 2.5e-5, 3e-4])
@pytest.mark.parametrize("load", [71.0, -200.0])
def test_fin_with_almost_no_supply_moves_as_without_supply(supply: float, load: float) -> None:
    """As soon as a load turns the fin, the back-EMF reaches so low a voltage limit, within nanoseconds."""
    values = {**load_parameters().values, "encoder.enabled": False, "drive.current_offset": 0.0}
    some, none = (simulate(values, 0.02, aero_torque=load,
                           supply_voltage=voltage)["fin_angle"] for voltage in (supply, 0.0))
    assert np.abs(some).max() > 1e-3
    # 0.3 mV turn a motor of 0.11 V.s/rad at 3e-3 rad/s, and the fin by 1e-6 rad in 20 ms. Measured: 4e-7 rad.
    np.testing.assert_allclose(some, none, rtol=0.0, atol=1e-5)


def test_a_motor_that_reverses_twice_in_a_tick_does_not_pass_the_stop_behind_it() -> None:
    """The back-EMF of this motor, a thousand times too large, turns it faster than a tick resolves."""
    values = {**load_parameters(model="ristanovic").values, "motor.back_emf_constant": 100.0, "inertia.motor": 1e-9}
    run = simulate(values, 0.1, model="ristanovic", fin_command=lambda t: 0.3 if t < 0.03 else -0.35)
    assert np.abs(run["fin_angle"]).max() <= values["fin.stop_angle"] * (1.0 + 1e-12)
