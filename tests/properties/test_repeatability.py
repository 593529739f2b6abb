"""After any use and a rest, an actuator responds like a new one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, get
from emcas_fmu.bench.metrics import sustained_rate
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.parameters import ParameterError, ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.support.files import named_sets
from tests.default_actuator import EVERY
from tests.marks import slow

Columns = dict[str, NDArray[Any]]

STEP = 1e-3  # s
PHASE = np.arange(1000) * STEP  # s: one second of use
HOMING = 7000  # rows after which homing has ended
REST = np.zeros(4000)  # rad: 4 s, 16 times the time constant kp/ki of the position integral
PROBE = np.radians(np.repeat([0.0, -20.0, 20.0, 1.0, 0.0], [50, 650, 700, 600, 600]))
# deg. Because of dry friction the integral at rest has any value within the breakaway; encoder and backlash have any
# phase. Measured in fast motion: 0.04 deg without backlash, 0.07 deg with. An integral that drifts gives degrees.
REPEATABILITY = 0.1
# The velocity integral at rest, too, has any value within the breakaway of 0.23 V: (0.23 V)/(Kp_vel Kp_pos) is 0.1 deg
# of the fin to either side, in addition to the position integral's.
WITH_VELOCITY_INTEGRAL = 0.3
_ONE_SIDED = np.radians(np.interp(PHASE % 0.5, [0.0, 0.15, 0.15, 0.35, 0.5], [20.0, 20.0, 20.0, 0.0, 0.0]))
# Inputs over one second of use each. Inputs that an actuator does not have are left out; `supply` is a share of its
# start value.
HISTORIES: Mapping[str, Columns] = {
    "one-sided cycles": {"fin_command": _ONE_SIDED}, "cycles to the other side": {"fin_command": -_ONE_SIDED},
    "stall": {"aero_torque": np.where(PHASE < 0.9, 450.0, 0.0)},
    "stall the other way": {"aero_torque": np.where(PHASE < 0.9, -450.0, 0.0)},
    "disabled in between": {"fin_command": np.radians(np.where(PHASE < 0.5, 15.0, -10.0)),
                            "enable": PHASE % 0.37 < 0.25, "aero_torque": 60.0 * np.sin(7.0 * PHASE)},
    "brown-out": {"fin_command": np.radians(20.0 * np.sign(np.sin(6.0 * PHASE))),
                  "supply": np.where(PHASE % 0.4 < 0.2, 1.0, 0.3)},
    "saturation": {"fin_command": np.radians(60.0 * np.sin(2.0 * np.pi * 4.0 * PHASE)),
                   "aero_torque": -200.0 * np.sign(np.sin(2.0 * np.pi * 1.3 * PHASE))},
}
histories = st.lists(st.sampled_from(sorted(HISTORIES)), min_size=1, max_size=6)
# Changes of the shipped controllers, one option at a time.
OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "load observer": {"controller.load_observer": 100.0},
    "P position": {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0},
    "PI velocity": {"controller.velocity.ki": 0.4}, "slow PI velocity": {"controller.velocity.ki": 1e-3},
    "P position, PI velocity": {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0,
                                "controller.velocity.ki": 0.4},
    "setpoint weight 1": {"controller.position.setpoint_weight": 1.0},
    "feedforward of a slow bus": {"controller.position.velocity_feedforward": 0.5, "command.update_time": 5e-3,
                                  "command.latency": 5e-3},
    "encoder on the fin": {"encoder.on_fin": True}, "no encoder": {"encoder.enabled": False},
    "hard anti-windup": {"controller.drive_antiwindup": 100.0}, "no compensation": {"compensation.gain": 0.0},
    "no anti-windup": {"controller.drive_antiwindup": 0.0, "controller.antiwindup": 0.0},
}
EXTENDED = slow(*(f"nonlinear+{name}" for name in EXTENSIONS), "elastic+heat+homing+faults", "worm-gear+heat",
                "clutch+faults", "electrohydrostatic+heat")


def response(model: str, values: Mapping[str, Any], use: Sequence[str]) -> Columns:
    """Simulate seconds of use one after the other, a rest and the probe; return the outputs during the probe."""
    names = {v.name: v for v in get(model).inputs}
    supply = next((name for name in ("supply_voltage", "supply_pressure") if name in names), "")
    start = HOMING if "home" in names else 0
    inputs: dict[str, Any] = {"fin_command": np.concatenate([np.zeros(start + len(PHASE) * len(use)), REST, PROBE])}
    if start:
        inputs["home"] = np.ones(len(inputs["fin_command"]))
    for k, phase in enumerate(use):
        rows = slice(start + k * len(PHASE), start + (k + 1) * len(PHASE))
        for name, column in HISTORIES[phase].items():
            name_here = supply if name == "supply" else name
            if name_here in names:
                initial = float(names[name_here].initial(values))
                whole = inputs.setdefault(name_here, np.full(len(inputs["fin_command"]), initial))
                whole[rows] = column * initial if name == "supply" else column
    run = simulate(values, (len(inputs["fin_command"]) - 1) * STEP, STEP, model=model, **inputs)
    return {name: column[-len(PROBE):] for name, column in run.items()}


def check_repeatability(model: str, values: Mapping[str, Any], use: Sequence[str], tolerance: float = REPEATABILITY
                        ) -> None:
    fresh, used = (response(model, values, history) for history in ((), use))
    difference = np.degrees(np.max(np.abs(used["fin_angle"] - fresh["fin_angle"])))
    assert difference < tolerance, f"{model} after {', '.join(use)}: {difference:.3f} deg"


@settings(derandomize=True, max_examples=6)
@given(use=histories)
def test_default_actuator_is_repeatable_after_any_use(values: Mapping[str, Any], use: list[str]) -> None:
    check_repeatability(NONLINEAR, values, use)


@pytest.mark.parametrize("option", OPTIONS)
def test_every_controller_option_is_repeatable(option: str) -> None:
    values = load_parameters().with_values(OPTIONS[option]).values
    tolerance = WITH_VELOCITY_INTEGRAL if values["controller.velocity.ki"] > 0.0 else REPEATABILITY
    check_repeatability(NONLINEAR, values, list(HISTORIES), tolerance)


@pytest.mark.parametrize("chosen", [load_parameters("two-degrees-of-freedom"), *(
    load_parameters(model="nonlinear+filters").with_values({
        "filters.speed_bandwidth": bandwidth, "filters.notch_frequency": 380.0, "filters.notch_zero_damping": 0.05,
        "filters.notch_pole_damping": 0.2}) for bandwidth in (150.0, 800.0))],
    ids=["trajectory generator", "filters of 150 rad/s", "filters of 800 rad/s"])
def test_trajectory_generator_and_filters_are_repeatable(chosen: ParameterSet) -> None:
    check_repeatability(chosen.model, chosen.values, list(HISTORIES))


@pytest.mark.parametrize("model", EVERY + EXTENDED)
def test_every_actuator_is_repeatable(model: str) -> None:
    check_repeatability(model, load_parameters(model=model).values, list(HISTORIES))


@pytest.mark.slow
@pytest.mark.parametrize("model", NAMES)
def test_fin_returns_after_a_long_overload_with_every_set(model: str) -> None:
    """In half a minute, whatever grows while a load holds the fin becomes large."""
    angle, rows = np.radians(15.0), round(33.0 / STEP) + 1
    held = np.arange(rows) * STEP < 30.0
    for chosen in (None, *named_sets()):
        try:
            parameters = load_parameters(chosen, model=model)
        except ParameterError:  # the set is made for other actuators
            continue
        for load in (5.0, -5.0):
            torque = np.where(held, load * load_requirements(None, parameters).rated_load, 0.0)
            run = simulate(parameters.values, (rows - 1) * STEP, STEP, model=parameters.model, fin_command=-angle,
                           aero_torque=torque)
            # A servo without integral keeps an error of up to 0.44 deg.
            assert np.max(np.abs(run["fin_angle"][-1000:] + angle)) < np.radians(0.5), (chosen, load)


def test_cycles_to_one_side_do_not_reduce_the_slew_rate(values: Mapping[str, Any]) -> None:
    """Slew from -20 to 20 deg against 100 N.m after 80 cycles to one side; an integral that drifts reduces its rate."""
    def rate(cycles: int) -> float:
        used = np.tile(_ONE_SIDED, cycles // 2)
        command = np.concatenate([used, np.radians(np.repeat([-20.0, 20.0], [1000, 801]))])
        load = np.where(np.arange(len(command)) >= len(command) - 801, -100.0, 0.0)
        run = simulate(values, (len(command) - 1) * STEP, STEP, fin_command=command, aero_torque=load)
        return degrees(sustained_rate(run["time"], run["fin_angle"], (len(command) - 801) * STEP, np.radians(20.0)))

    # Breakaway changes the speed reference of 300 rad/s by up to 1.4 rad/s.
    assert abs(rate(80) / rate(0) - 1.0) < 1.4 / 300.0
