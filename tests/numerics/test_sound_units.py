"""Actuators with other motors, screws and friction stay within the reference cases' tolerance at the default tick."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice, repeat
from math import degrees, pi
from typing import Any

import numpy as np
import pytest

from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.reference.cases import TOLERANCE, ReferenceCase
from emcas_fmu.simulation import Array, simulate

BASE = load_parameters()
DEFAULT: Mapping[str, Any] = BASE.values
CASES = {case.name: case for case in files.cases(BASE.model, DEFAULT) if case.name in ("cold", "step", "load_opposing")}
FRICTION = tuple(name for name in DEFAULT if name.startswith(("friction.coulomb.", "friction.viscous.")))
# A motor of small inductance, whose current reverses within a tick, and gains for it.
SMALL = {"kinematics.moment_arm": 0.042, "screw.lead": 2.5e-3 / (2.0 * pi), "inertia.motor": 3.1e-5,
         "motor.torque_constant": 0.062, "motor.back_emf_constant": 0.062, "motor.resistance": 0.21,
         "motor.inductance": 1.1e-4, "drive.supply_voltage": 48.0, "controller.speed_limit": 620.0}


def motor_inertia(values: Mapping[str, Any]) -> float:
    """Return the whole inertia at the motor [kg.m2], with the lever square to the screw."""
    lead, ratio = values["screw.lead"], values["kinematics.moment_arm"] / values["screw.lead"]
    hinge = sum(values[f"inertia.{part}"] for part in ("fin", "shaft", "fork"))
    return float(values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2 + hinge / ratio**2)


def with_gain(changes: Mapping[str, Any], share: float = 1.0) -> dict[str, Any]:
    """Add the velocity gain that gives a share of the default actuator's acceleration for the same error."""
    values, constant = {**DEFAULT, **changes}, "motor.torque_constant"
    scale = motor_inertia(values) / motor_inertia(DEFAULT) * DEFAULT[constant] / values[constant]
    return {**changes, "controller.velocity.kp": DEFAULT["controller.velocity.kp"] * scale * share}


def random_actuator(rng: np.random.Generator) -> dict[str, Any] | None:
    """Return parameters 0.25 to 4 times the default ones, with gains for them; None if they make no useful actuator."""
    arm, lead, inertia, flux, resistance, inductance, supply, friction = 4.0 ** rng.uniform(-1.0, 1.0, 8)
    scales = {"kinematics.moment_arm": arm, "screw.lead": lead, "inertia.motor": inertia, "motor.torque_constant": flux,
              "motor.back_emf_constant": flux, "motor.resistance": resistance, "motor.inductance": inductance,
              "drive.kp": inductance, "drive.ki": resistance, "drive.supply_voltage": supply,
              "controller.speed_limit": supply / flux, **dict.fromkeys(FRICTION, friction)}
    changes = with_gain({name: DEFAULT[name] * scale for name, scale in scales.items()})
    stall = changes["drive.supply_voltage"] / changes["motor.resistance"]
    changes["drive.current_limit"] = min(DEFAULT["drive.current_limit"], 0.4 * stall)  # the default: 60 of 156 A
    ratio = changes["kinematics.moment_arm"] / changes["screw.lead"]
    dry = 1.3 * 1.25 * changes["friction.coulomb.positive[0]"]  # N.m, at the ends of travel, in the cold
    torque = (changes["motor.torque_constant"] * changes["drive.current_limit"] - dry) * ratio
    rate = degrees(changes["controller.speed_limit"] / ratio)
    try:
        BASE.with_values(changes)
    except ParameterError:
        return None
    return changes if torque > 130.0 and 100.0 < rate < 700.0 else None


def angle(case: ReferenceCase, changes: Mapping[str, Any]) -> Array:
    """Return the fin angle [rad] at the rows of a case."""
    signals: dict[str, Any] = {name: column for name, column in case.inputs().items() if name != "time"}
    response: Array = simulate(BASE.with_values({**changes, **case.overrides}).values, case.stop_time, case.step,
                               **signals)["fin_angle"]
    return response


def reference_angle(case: ReferenceCase, changes: Mapping[str, Any]) -> Array:
    """Return the same of the independent integration."""
    simulator = files.simulator("nonlinear")
    response: Array = simulator(BASE.with_values({**changes, **case.overrides}).values, case.inputs())["fin_angle"]
    return response


def useful_actuators(count: int, seed: int) -> list[dict[str, Any]]:
    rng = np.random.default_rng(seed)
    return list(islice(filter(None, (random_actuator(rng) for _ in repeat(None))), count))


def test_useful_actuators_stay_within_the_tolerance() -> None:
    """The default tick against a tenth of it. Of 90 actuators, the largest difference was 0.0011 deg."""
    tick = DEFAULT["solver.max_tick"]
    for number, changes in enumerate(useful_actuators(30, 7)):
        for case in CASES.values():
            error = np.abs(angle(case, changes) - angle(case, {**changes, "solver.max_tick": 0.1 * tick})).max()
            assert error < TOLERANCE, (number, case.name, degrees(error), changes)


@pytest.mark.slow  # a minute: the independent integration makes steps of microseconds, in Python
@pytest.mark.parametrize("number", range(3))
def test_useful_actuators_agree_with_the_independent_integration(number: int) -> None:
    changes = useful_actuators(3, 0)[number]
    for case in CASES.values():
        error = np.abs(angle(case, changes) - reference_angle(case, changes)).max()
        assert error < TOLERANCE, (case.name, degrees(error), changes)


@pytest.mark.parametrize("position", [(40.0, 225.0), (54.0, 100.0), (70.0, 100.0)])
@pytest.mark.parametrize("share", [0.6, 0.8, 1.0])
def test_reversal_of_speed_and_current_in_one_tick_is_accurate(share: float, position: tuple[float, float]) -> None:
    """The speed is a parabola over the tick. With the zero of a straight line instead of the parabola's, the error was
    up to 0.0065 deg, and 0.0009 deg at a seventh of the tick."""
    gains = dict(zip(("controller.position.kp", "controller.position.ki"), position, strict=True))
    changes = with_gain({**SMALL, **gains}, share)
    for case in CASES.values():
        # The error of second order at the default tick is up to 0.0008 deg.
        error = np.abs(angle(case, changes) - angle(case, {**changes, "solver.max_tick": 1e-5})).max()
        assert error < 0.5 * TOLERANCE, (case.name, degrees(error))


@pytest.mark.slow
def test_small_motor_agrees_with_the_independent_integration() -> None:
    changes = with_gain({**SMALL, "controller.position.kp": 40.0}, 0.8)
    error = np.abs(angle(CASES["step"], changes) - reference_angle(CASES["step"], changes)).max()
    assert error < 0.5 * TOLERANCE, degrees(error)  # as above
