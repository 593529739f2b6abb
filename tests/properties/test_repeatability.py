"""An actuator at rest responds like a fresh one, after any commands before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emcas_fmu.actuators import EXTENSIONS, NONLINEAR, get
from emcas_fmu.bench.metrics import sustained_rate
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import slow

from ..default_actuator import EVERY

Columns = dict[str, NDArray[Any]]

STEP = 1e-3  # s
PHASE = np.arange(1000) * STEP  # s, of a history
HOMING = 7000  # rows after which a unit that homes has done so
REST = np.zeros(4000)  # rad: four times the integral's time constant, kp/ki
PROBE = np.radians(np.repeat([0.0, -20.0, 20.0, 1.0, 0.0], [50, 650, 700, 600, 600]))
# deg. Dry friction lets a unit rest with an integral within the breakaway, and with any phase of the encoder and of the
# backlash: 0.04 deg measured in fast motion without backlash, 0.07 deg with. An integral that drifts gives degrees.
REPEATED = 0.1
# The velocity integral, too, rests anywhere within the breakaway of 0.23 V: (0.23 V)/(Kp_vel Kp_pos) is 0.1 deg of the
# fin, from one side of it to the other twice that, beside the position integral's.
REPEATED_BESIDE_VELOCITY_INTEGRAL = 0.3
_ONE_SIDED = np.radians(np.interp(PHASE % 0.5, [0.0, 0.15, 0.15, 0.35, 0.5], [20.0, 20.0, 20.0, 0.0, 0.0]))
# Inputs of a second of use each, of those that an actuator has; `supply` is a share of the start value.
HISTORIES: Mapping[str, Columns] = {
    "one-sided cycles": {"fin_command": _ONE_SIDED},
    "cycles to the other side": {"fin_command": -_ONE_SIDED},
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
# Every choice of the controllers, each next to the shipped ones.
OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "load observer": {"controller.load_observer": 100.0},
    "P position": {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0},
    "PI velocity": {"controller.velocity.ki": 0.4},
    "slow PI velocity": {"controller.velocity.ki": 1e-3},
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
    """Run a history, phases of a second one after the other, then a rest, then the probe; return what follows use."""
    names = {v.name: v for v in get(model).inputs}
    supply = next((name for name in ("supply_voltage", "supply_pressure") if name in names), "")
    start = HOMING if "home" in names else 0
    inputs: dict[str, Any] = {"fin_command": np.concatenate([np.zeros(start + len(PHASE) * len(use)), REST, PROBE])}
    if start:
        inputs["home"] = np.ones(len(inputs["fin_command"]))
    for k, phase in enumerate(use):
        rows = slice(start + k * len(PHASE), start + (k + 1) * len(PHASE))
        for name, column in HISTORIES[phase].items():
            known = supply if name == "supply" else name
            if known in names:
                initial = float(names[known].initial(values))
                whole = inputs.setdefault(known, np.full(len(inputs["fin_command"]), initial))
                whole[rows] = column * initial if name == "supply" else column
    run = simulate(values, (len(inputs["fin_command"]) - 1) * STEP, STEP, model=model, **inputs)
    return {name: column[-len(PROBE):] for name, column in run.items()}


def compare(model: str, values: Mapping[str, Any], use: Sequence[str], tolerance: float = REPEATED) -> None:
    fresh, used = (response(model, values, history) for history in ((), use))
    differing = np.degrees(np.max(np.abs(used["fin_angle"] - fresh["fin_angle"])))
    assert differing < tolerance, f"{model} after {', '.join(use)}: {differing:.3f} deg"


@settings(derandomize=True, max_examples=6)
@given(use=histories)
def test_use_leaves_nothing_behind(values: Mapping[str, Any], use: list[str]) -> None:
    compare(NONLINEAR, values, use)


@pytest.mark.parametrize("option", OPTIONS)
def test_no_choice_of_the_controllers_remembers_use(option: str) -> None:
    values = load_parameters().with_values(OPTIONS[option]).values
    beside = values["controller.velocity.ki"] > 0.0
    compare(NONLINEAR, values, list(HISTORIES), REPEATED_BESIDE_VELOCITY_INTEGRAL if beside else REPEATED)


def test_a_generated_motion_remembers_no_use() -> None:
    chosen = load_parameters("two-degrees-of-freedom")
    compare(chosen.model, chosen.values, list(HISTORIES))


@pytest.mark.parametrize("bandwidth", [150.0, 800.0])
def test_filters_remember_no_use(bandwidth: float) -> None:
    model = "nonlinear+filters"
    values = load_parameters(model=model).with_values({
        "filters.speed_bandwidth": bandwidth, "filters.notch_frequency": 380.0, "filters.notch_zero_damping": 0.05,
        "filters.notch_pole_damping": 0.2}).values
    compare(model, values, list(HISTORIES))


@pytest.mark.parametrize("model", EVERY + EXTENDED)
def test_no_actuator_remembers_use(model: str) -> None:
    compare(model, load_parameters(model=model).values, list(HISTORIES))


def test_cycles_to_one_side_cost_no_rate(values: Mapping[str, Any]) -> None:
    """The slew from -20 to 20 deg against 100 N.m, after eighty cycles to one side: each once took a part of its rate.

    Within the breakaway's share of the speed reference, 1.4 of 300 rad/s.
    """
    def rate(cycles: int) -> float:
        used = np.tile(_ONE_SIDED, cycles // 2)
        command = np.concatenate([used, np.radians(np.repeat([-20.0, 20.0], [1000, 801]))])
        load = np.where(np.arange(len(command)) >= len(command) - 801, -100.0, 0.0)
        run = simulate(values, (len(command) - 1) * STEP, STEP, fin_command=command, aero_torque=load)
        return degrees(sustained_rate(run["time"], run["fin_angle"], (len(command) - 801) * STEP, np.radians(20.0)))

    assert abs(rate(80) / rate(0) - 1.0) < 1.4 / 300.0
