"""No supply gets more than what gives it: power at the line against the drive's own, and against the shaft's work."""

from __future__ import annotations

from collections.abc import Mapping
from math import sin
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.extensions.fault_list import possible
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import others_slow, slow

from .fault_runs import scheduled

FED = [name for name in NAMES if get(name).supply is not None]
# Motors with a back-EMF, which the shaft's work is the counterpart of.
RETURNING = ["nonlinear+faults", "electrohydrostatic+faults", *slow(
    "nonlinear+efficiency+heat+homing+faults", "nonlinear+inverter+faults", "linear+faults", "ozkan+faults",
    "nonlinear+supply+faults", "habibi+faults", "worm-gear+faults")]
SETTINGS = settings(derandomize=True, max_examples=8, suppress_health_check=[HealthCheck.too_slow])


def _inputs(command: float, load: float) -> dict[str, Any]:
    return {"fin_command": lambda t: command if sin(40.0 * t) > 0.0 else -command,
            "aero_torque": lambda t: load if sin(25.0 * t) > 0.0 else -load}


@pytest.mark.parametrize("model", others_slow(
    [*FED, "nonlinear+supply"], lambda model: model in ("nonlinear", "nonlinear+supply", "servo", "electrohydraulic")))
@SETTINGS
@given(share=st.floats(0.01, 0.999) | st.just(1.0), command=st.floats(-0.4, 0.4), load=st.floats(-300.0, 300.0))
def test_a_brown_out_gives_nothing_back_that_the_actuator_does_not(model: str, share: float, command: float,
                                                                   load: float) -> None:
    """Power is drawn at the line's level; returned power is at most that at the sagged supply."""
    line = get(model).supply
    assert line is not None
    name, inputs = f"{model}+faults", _inputs(command, load)
    two_way = {"supply.one_way": False} if "supply" in model else {}
    values = load_parameters(model=model).with_values(two_way).values
    found = simulate({**scheduled(name, "brown_out", fault__brown_out__share=share), **values}, 0.12, model=name,
                     **inputs)
    inputs[line.input.name] = share * float(line.input.initial(values))
    own = simulate(values, 0.12, model=model, **inputs)
    # The first row is before the first sample and the fault. A quotient differs by rounding. (A share within 1e-12 of 1
    # is no fault: its supply would differ by rounding, which contact amplifies.)
    power, at_drive = found["supply_power"][1:], own["supply_power"][1:]
    np.testing.assert_allclose(power, np.where(at_drive > 0.0, at_drive / share, at_drive), rtol=2e-12)


@pytest.mark.parametrize("model", RETURNING)
@SETTINGS
@given(share=st.floats(0.0, 1.0), command=st.floats(-0.4, 0.4), load=st.floats(-300.0, 300.0),
       others=st.sets(st.sampled_from(["current_derating", "drive_loss", "friction_rise", "encoder_bias",
                                       "command_delay", "free_fin", "jam", "winding_short",
                                       "phase_loss"]), max_size=2))
def test_returned_energy_is_no_more_than_the_shafts_work(model: str, share: float, command: float, load: float,
                                                         others: set[str]) -> None:
    """From outputs: energy drawn >= work at the shaft + heat of the winding + what winding and link hold."""
    has = {fault.name for fault in possible(get(model))}
    names = sorted(others & has)
    # A tick that resolves the current loop: at the default one its integral is off by 0.1 J in a run.
    extras: dict[str, Any] = {"solver__max_tick": 5e-5}
    if "homing" in model:
        extras["homing__required"] = False
    if "supply" in model:
        extras["supply__one_way"] = False
    if "inverter" in model:
        extras |= {"inverter__dead_time": 3e-6, "inverter__pole_pairs": 4}
    v = scheduled(model, *names, *(["brown_out"] if "brown_out" in has else []), begin=0.05,
                  fault__brown_out__share=share, **extras)
    step = 2e-5
    run = simulate(v, 0.15, step, model=model, **_inputs(command, load))
    assert _least_surplus(run, v, step) >= 0.0


def _least_surplus(run: Mapping[str, Any], v: Mapping[str, Any], step: float) -> float:
    """Return the least of what is drawn over work, heat and store [J] in any span of a run, its trapezia allowed for.

    A trapezoidal sum is off by at most half a step of the total variation, however the power jumps.
    """
    current = run["motor_current"]
    held = 0.5 * v.get("motor.inductance", 0.0) * current**2
    if "link_voltage" in run:
        held = held + 0.5 * v["supply.capacitance"] * run["link_voltage"]**2
    over = run["supply_power"] - run["motor_torque"] * run["motor_speed"] - v["motor.resistance"] * current**2
    surplus = np.concatenate([[0.0], np.cumsum(0.5 * step * (over[1:] + over[:-1]))]) - held
    allowed = 0.5 * step * np.abs(np.diff(over)).sum()
    return float((surplus - np.maximum.accumulate(surplus)).min() + allowed)
