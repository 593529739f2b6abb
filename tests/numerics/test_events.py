"""Steps with events: a spring with dry friction against its closed form, to the bit where it lands, in both back ends.

A half swing from a reversal at a goes to -(a - 2 s), s = C/k, as half a cosine about +-s; it ends where |a| <= s.
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
HALF = pi / OMEGA  # s, 31 ticks: no reversal falls on one


def closed_form(time: float) -> float:
    """The angle [rad] after release at fin.start_angle."""
    begin, angle = 0.0, VALUES["fin.start_angle"]
    while time > begin + HALF and abs(angle) > SHIFT:
        begin, angle = begin + HALF, -angle + 2.0 * SHIFT * np.sign(angle)
    if abs(angle) <= SHIFT:
        return float(angle)
    about = SHIFT * np.sign(angle)
    return float(about + (angle - about) * cos(OMEGA * (time - begin)))


def swing(kernel: str = "auto", tick: float = 1e-3) -> dict[str, Any]:
    return simulate({**VALUES, "solver.max_tick": tick}, 0.2, kernel=kernel, model=MODEL)


def test_second_order_through_events() -> None:
    """Four reversals and the rest at last."""
    ticks, errors = [1e-3 / 2**n for n in range(5)], []
    for tick in ticks:
        run = swing(tick=tick)
        errors.append(max(abs(a - closed_form(t)) for t, a in zip(run["time"], run["fin_angle"], strict=True)))
    slope = np.polyfit(np.log(ticks), np.log(errors), 1)[0]
    # An event that is stepped over costs an order, slope 1; a third-order term and where events fall in ticks move a
    # fit of five points by less than 0.2.
    assert 1.8 < slope < 2.2, (slope, errors)
    # (omega h)^2 of ROS2's error constant over four half swings, 6e-4 of 0.3 rad; 5 times that is far below an event
    # stepped over, which leaves omega h.
    assert errors[0] < 1e-3


def test_it_rests_to_the_bit_where_it_came_to_rest() -> None:
    run = swing()
    resting = run["time"] > 5.0 * HALF
    assert np.all(run["fin_rate"][resting] == 0.0)
    assert len(set(run["fin_angle"][resting].tolist())) == 1
    assert 0.0 < abs(run["fin_angle"][-1]) <= SHIFT


def test_both_back_ends_take_the_same_steps() -> None:
    python, compiled = swing("python"), swing("compiled")
    for name, column in python.items():
        np.testing.assert_array_equal(column, compiled[name], err_msg=name)


def advanced(x: dict[str, float], h: float, torque: float = 0.0) -> tuple[Record, float]:
    actuator = get(MODEL)
    u = PlantInputs(**{**vars(NONE), "aero_torque": torque})
    moved, used = actuator.step(FLOATS, actuator.namespace(VALUES), Record(**x), u, h)
    return Record(**moved), float(used)


def test_a_step_ends_at_the_event() -> None:
    rate = 1.0
    x = {"fin_angle": 0.0, "fin_rate": rate}
    moved, used = advanced(x, 3e-3)
    # omega t = atan(rate/(omega s)); a step of ROS2 is off by (omega h)^3/6, 0.5 % of it at most, two secants by less.
    expected = np.arctan2(rate, OMEGA * SHIFT) / OMEGA
    assert used == pytest.approx(expected, abs=0.005 * 3e-3)
    assert moved.fin_rate == 0.0
    again, rest = advanced(vars(moved), 3e-3)
    assert (vars(again), rest) == (vars(moved), 3e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_stop_takes_the_speed_and_is_met_to_the_bit(side: float) -> None:
    x = {"fin_angle": side * 0.39, "fin_rate": side * 40.0}
    moved, used = advanced(x, 1e-3)
    assert (moved.fin_angle, moved.fin_rate) == (side * VALUES["fin.stop_angle"], 0.0)
    assert 0.0 < used < 1e-3
    # There the spring turns it back: 240 N.m against 24 N.m of friction; pushed on by more than that it stays.
    back, _ = advanced(vars(moved), 1e-4)
    assert side * back.fin_rate < 0.0
    held, _ = advanced(vars(moved), 1e-4, side * 250.0)
    assert vars(held) == vars(moved)


def test_breakaway_is_an_event_of_what_rests() -> None:
    """A fin at rest whose load grows in steps: it moves from the first that is above friction on."""
    below, above = (simulate(VALUES | {"fin.start_angle": 0.0}, 0.05, model=MODEL, aero_torque=torque)
                    for torque in (23.999, 24.001))
    assert np.all(below["fin_angle"] == 0.0)
    assert above["fin_angle"][-1] > 0.0


STIFF = ({"drive.kp": 165.0}, {"motor.inductance": 1e-5}, {"drive.kp": 165.0, "motor.pole_pairs": 5})


@pytest.mark.parametrize("values", STIFF)
def test_a_current_loop_much_faster_than_the_tick_gets_through_supply_jumps(values: dict[str, float]) -> None:
    """The current settles in a hundredth of a tick, and from there follows the speed to the voltage limit."""
    def supply(time: float) -> float:
        return 20.0 if 0.1657 <= time < 0.1757 else 0.0 if 0.1757 <= time < 0.1857 else 39.0

    default, fine = (simulate({**load_parameters().values, "encoder.enabled": False, **values,
                               "solver.max_tick": tick}, 0.2, fin_command=lambda t: 0.35 * np.sin(40.0 * t),
                              supply_voltage=supply) for tick in (7e-4, 2e-5))
    # Second order leaves up to 0.0008 deg at the default tick; a motion of 40 deg.
    np.testing.assert_allclose(np.degrees(default["fin_angle"]), np.degrees(fine["fin_angle"]), rtol=0.0, atol=0.002)


@pytest.mark.parametrize("supply", [1e-9, 3e-7, 2.5e-5, 3e-4])
@pytest.mark.parametrize("load", [71.0, -200.0])
def test_a_supply_of_almost_nothing_is_got_through(supply: float, load: float) -> None:
    """The back-EMF of a fin that a load begins to turn meets so low a limit within nanoseconds; then as without one."""
    values = {**load_parameters().values, "encoder.enabled": False, "drive.current_offset": 0.0}
    some, none = (simulate(values, 0.02, aero_torque=load,
                           supply_voltage=voltage)["fin_angle"] for voltage in (supply, 0.0))
    assert np.abs(some).max() > 1e-3
    # 0.3 mV move the motor, of 0.12 V s/rad and a ratio of 60, at some 1e-5 rad/s.
    np.testing.assert_allclose(some, none, rtol=0.0, atol=1e-5)
