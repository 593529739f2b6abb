"""What the tests of homing share: a run, its statuses, a thing in the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi, radians, tan
from typing import Any

import numpy as np

from emcas_fmu.actuators import get
from emcas_fmu.extensions.status import HOMING
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+homing"
BASE = load_parameters(model=MODEL)
STOP = BASE.values["fin.stop_angle"]
SPEED = BASE.values["homing.speed"]
COUNT = 2.0 * pi / 8192  # rad at the motor
RATIO = BASE.values["kinematics.moment_arm"] / BASE.values["screw.lead"]
INITIAL = BASE.values["kinematics.initial_angle"]
NAMES = [v.name for v in get(MODEL).outputs]


def motor(fin: Any) -> Any:
    """(2.5), written out."""
    return RATIO * (np.tan(fin + INITIAL) - tan(INITIAL))


def run_of(overrides: Mapping[str, Any], stop: float, model: str = MODEL, **inputs: Any) -> dict[str, Any]:
    return simulate(load_parameters(model=model).with_values(overrides).values, stop, model=model, **inputs)


def phases(run: Mapping[str, Any]) -> list[float]:
    """The statuses in their order, each once."""
    status = run["status"]
    return [status[0], *status[1:][np.diff(status) != 0.0]]


def since(run: Mapping[str, Any], status: float) -> float:
    """When a status is shown for the first time [s]."""
    return float(run["time"][np.argmax(run["status"] == status)])


def assert_sound(run: Mapping[str, Any]) -> None:
    """No stop is passed, no current beyond what the push allows while homing, no jump."""
    assert np.abs(run["fin_angle"]).max() <= STOP * (1.0 + 1e-12)
    # Beyond the reference by no more than what the back-EMF drives against the current loop's gain.
    homing = run["status"] == HOMING
    driven = BASE.values["motor.back_emf_constant"] * np.abs(run["motor_speed"][homing]) / BASE.values["drive.kp"]
    assert np.abs(run["motor_current"][homing]).max() <= 8.19 * 1.0 + 0.015 + driven.max()
    # In 1 ms no more than the rate at its two ends allows.
    rate = np.abs(run["fin_rate"])
    assert np.all(np.abs(np.diff(run["fin_angle"])) <= np.maximum(rate[1:], rate[:-1]) * 1e-3 * 1.5 + radians(0.02))


def blocked(torque: Callable[[float, float], float], stop: float, home: Callable[[float], bool],
            overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A run under a torque [N.m] of time [s] and fin angle [rad], at steps of 1 ms."""
    core = codegen.core(BASE.with_values(overrides or {}).values, MODEL)
    rows = []
    angle = 0.0
    for k in range(round(stop / 1e-3)):
        inputs = codegen.inputs_at_rest(0.2, torque(k * 1e-3, angle), 39.0, True, home(k * 1e-3))
        rows.append(core.run((k + 1) * 1e-3, inputs))
        angle = rows[-1][0]
    return {"time": np.arange(1, len(rows) + 1) * 1e-3, **dict(zip(NAMES, np.array(rows, dtype=float).T, strict=True))}


def wedge(at: float) -> Callable[[float], float]:
    """A stiff thing in the way from `at` [rad] on, on either side."""
    return lambda angle: -3e3 * max(angle - at, 0.0) if at > 0.0 else -3e3 * min(angle - at, 0.0)
