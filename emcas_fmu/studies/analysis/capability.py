"""Capability of motor and drive: torque against speed, and hinge moment and rate against fin angle.

In steady motion (di/dt = 0) the largest torque at a motor speed w is

    T_m = K_t clip(i, +-I_max)        with (R i + K_e w)^2 + (n w L i)^2 = V^2

V is the supply, I_max the drive's current limit, n = motor.pole_pairs. Fin rate and hinge moment follow from (2.17) of
the thesis without acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import Any

import numpy as np

from ...actuators import NONLINEAR, capabilities, get
from ...bench.excitation import reference_case
from ...bench.runs import Columns
from ...bench.subject import ParameterSubject
from ...motions import RATED
from ...ops.arrays import ARRAYS
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import drive, kinematics, loads, mechanics
from ...reference.cases import CASES
from ...reference.files import supply_start
from ...simulation import Array

NEEDS = (capabilities.SCREW_AND_LEVER, capabilities.CURRENT_LOOP, capabilities.CURRENT_LIMIT,
         capabilities.VOLTAGE_LIMIT, capabilities.SCREW_LOAD, capabilities.COULOMB_FRICTION,
         capabilities.PROPORTIONAL_TORQUE, capabilities.DRIVE_STEP)
_POINTS = 101  # number of fin angles
_HALVINGS = 60  # number of bisections of an interval of speeds, after which only rounding is left


def limit_torque(p: Any, speed: Any) -> Any:
    """Return the largest steady motor torque [N.m] at motor speeds [rad/s]."""
    return drive.limit_torque(ARRAYS, p, p.drive.supply_voltage, speed)


def envelope(values: Mapping[str, Any], model: str = NONLINEAR) -> dict[str, Any]:
    """Return the torque-speed envelope between the no-load speeds in both directions, with the keys of the JSON file.

    ``torque_nm`` is the largest motor torque at each ``speed_rad_per_s``; the smallest is -T(-w). ``prompt_torque_nm``
    is the largest torque with the drive's proportional action alone; the integral action adds the rest with the time
    constant ``integral_time_s`` (nan without an integral).
    """
    p = get(model).plant(values)
    free = p.drive.supply_voltage / p.motor.back_emf_constant
    speed = np.linspace(-free, free, 4 * _POINTS)
    highest = limit_torque(p, speed)
    loop = p.motor.resistance + p.drive.kp
    current = (drive.voltage_demand(p, p.drive.current_limit, 0.0, 0.0) - drive.back_emf(p, speed)) / loop
    return {"stall_torque_nm": float(limit_torque(p, 0.0)), "no_load_speed_rad_per_s": free,
            "integral_time_s": loop / p.drive.ki if p.drive.ki > 0.0 else nan, "speed_rad_per_s": speed,
            "torque_nm": highest, "prompt_torque_nm": np.minimum(highest, drive.torque(p, current))}


def case_points(parameters: ParameterSet) -> dict[str, Columns]:
    """Return motor speed [rad/s] and torque [N.m] at the communication points of each reference case by name."""
    subject, supply = ParameterSubject(parameters), supply_start(parameters.model, parameters.values)
    cases = {case.name: reference_case(case.name, supply=supply) for case in CASES}
    return {name: subject.run(replace(case, start_values=parameters.having(case.start_values)),
                              outputs=("motor_speed", "motor_torque")).finished() for name, case in cases.items()}


@dataclass(frozen=True)
class Capability:
    """Capability against ``fin_angle`` [rad]; arrays [angles], or [2, angles] for motion along + and -.

    ``stall`` [N.m] is the largest hinge moment against which the fin moves, ``held`` [N.m] the largest that it holds at
    rest with the help of dry friction. ``rate`` [rad/s] is the largest steady rate without load, ``rate_loaded`` that
    against RATED, by supply, drive current and the controllers' speed limit; ``free_rate`` and ``free_rate_loaded`` are
    those without the speed limit. ``ratio`` is R [1].
    """

    fin_angle: Array
    ratio: Array
    stall: Array
    held: Array
    rate: Array
    rate_loaded: Array
    free_rate: Array
    free_rate_loaded: Array


def capability(values: Mapping[str, Any], model: str = NONLINEAR) -> Capability:
    """Return the capability over the range of commands. The actuator must provide NEEDS."""
    p = get(model).plant(values)
    fin = np.linspace(-p.command.limit, p.command.limit, _POINTS)
    level = loads.level(FLOATS, p)
    m = mechanics.coefficients(ARRAYS, p, kinematics.motor_angle(ARRAYS, p, fin), level)
    stall, held = np.empty((2, len(fin))), np.empty((2, len(fin)))
    for row, side in enumerate((1.0, -1.0)):
        driving = limit_torque(p, 0.0) + side * m.load
        stall[row] = np.maximum(m.ratio * (driving - mechanics.breakaway(ARRAYS, p, m, side)), 0.0)
        # At rest, friction helps the motor: the load must overcome both.
        held[row] = m.ratio * (driving + mechanics.breakaway(ARRAYS, p, m, -side))
    free = p.drive.supply_voltage / p.motor.back_emf_constant
    rates = [np.stack([steady_rate(p, fin, side, level.replace(aero_torque=-side * load), limit)
                       for side in (1.0, -1.0)])
             for limit in (min(p.controller.speed_limit, free), free) for load in (0.0, RATED)]
    return Capability(fin, m.ratio, stall, held, *rates)


def steady_rate(p: Any, fin: Any, side: float, acting: Any, limit: float) -> Any:
    """Return the largest steady fin rate [rad/s] in the direction `side` (1, -1) at fin angles [rad]; 0 at stall.

    `acting` are the loads (loads.LOADS), `limit` [rad/s] is the largest motor speed.
    """
    m = mechanics.coefficients(ARRAYS, p, kinematics.motor_angle(ARRAYS, p, fin), acting)
    surplus = side * m.load - mechanics.breakaway(ARRAYS, p, m, side)
    damping = mechanics.damping(ARRAYS, p, m, side)
    slowest, fastest = np.zeros_like(surplus), np.full_like(surplus, limit)
    for _ in range(_HALVINGS):  # the accelerating torque falls with speed
        speed = 0.5 * (slowest + fastest)
        accelerates = limit_torque(p, speed) + surplus - damping * speed > 0.0
        slowest, fastest = np.where(accelerates, speed, slowest), np.where(accelerates, fastest, speed)
    return fastest / m.ratio
