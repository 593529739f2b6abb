"""Runs of homing, their statuses, and an obstacle, for its tests."""

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

from .runs import values_of

MODEL = "nonlinear+homing"
BASE = load_parameters(model=MODEL)
STOP = BASE.values["fin.stop_angle"]
SPEED = BASE.values["homing.speed"]
COUNT = 2.0 * pi / 8192  # rad at the motor
RATIO = BASE.values["kinematics.moment_arm"] / BASE.values["screw.lead"]
INITIAL = BASE.values["kinematics.initial_angle"]
NAMES = [v.name for v in get(MODEL).outputs]


def motor(fin: Any) -> Any:
    """Return the motor angle [rad] at a fin angle [rad], by (2.5) of the thesis."""
    return RATIO * (np.tan(fin + INITIAL) - tan(INITIAL))


def run_of(overrides: Mapping[str, Any], stop: float, model: str = MODEL, **inputs: Any) -> dict[str, Any]:
    return simulate(values_of(overrides, model=model), stop, model=model, **inputs)


def phases(run: Mapping[str, Any]) -> list[float]:
    """Return the statuses in their order, without repetitions."""
    status = run["status"]
    return [status[0], *status[1:][np.diff(status) != 0.0]]


def first_time(run: Mapping[str, Any], status: float) -> float:
    """Return the time [s] at which a status is shown first."""
    return float(run["time"][np.argmax(run["status"] == status)])


def zero_error(run: Mapping[str, Any]) -> Any:
    """Return true less measured fin angle [rad] at the samples since homing; the measurement is a sample old."""
    homed = np.flatnonzero(run["homed"])[1:]
    return run["fin_angle"][homed - 1] - run["measured_fin_angle"][homed]


def assert_sound(run: Mapping[str, Any]) -> None:
    """Check that the fin passes no stop and does not jump, and that homing limits the current."""
    assert np.abs(run["fin_angle"]).max() <= STOP * (1.0 + 1e-12)
    # The back-EMF drives the current beyond its reference, against the gain of the current loop.
    homing = run["status"] == HOMING
    driven = BASE.values["motor.back_emf_constant"] * np.abs(run["motor_speed"][homing]) / BASE.values["drive.kp"]
    assert np.abs(run["motor_current"][homing]).max() <= 8.19 * 1.0 + 0.015 + driven.max()
    # A step of 1 ms at the larger rate of its two ends; half as much and 0.02 deg more allow for the rates between.
    rate = np.abs(run["fin_rate"])
    assert np.all(np.abs(np.diff(run["fin_angle"])) <= np.maximum(rate[1:], rate[:-1]) * 1e-3 * 1.5 + radians(0.02))


def blocked(torque: Callable[[float, float], float], stop: float, home: Callable[[float], bool],
            overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a run in steps of 1 ms under a torque [N.m], a function of time [s] and fin angle [rad]."""
    core = codegen.core(BASE.with_values(overrides or {}).values, MODEL)
    rows = []
    angle = 0.0
    for k in range(round(stop / 1e-3)):
        inputs = codegen.inputs_at_rest(0.2, torque(k * 1e-3, angle), 39.0, True, home(k * 1e-3))
        rows.append(core.run((k + 1) * 1e-3, inputs))
        angle = rows[-1][0]
    return {"time": np.arange(1, len(rows) + 1) * 1e-3, **dict(zip(NAMES, np.array(rows, dtype=float).T, strict=True))}


def wedge(edge: float) -> Callable[[float], float]:
    """Return the torque [N.m] of a stiff obstacle over the fin angle; its edge [rad] is on either side of zero."""
    return lambda angle: -3e3 * max(angle - edge, 0.0) if edge > 0.0 else -3e3 * min(angle - edge, 0.0)
