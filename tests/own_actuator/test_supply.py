"""The extension supply of a user's actuator with its own equations, against an independent integration."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emcas_fmu.namespace import namespace
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

from .example import changed

COMMAND, SOURCE, STOP = radians(10.0), 39.0, 60  # rad, V, samples


def integrated(p: Any) -> Any:
    """Return fin angle [rad] and link voltage [V] at the samples of a step, with chopper and voltage limit."""
    c, x, integral, rows = p.controller, np.array([0.0, 0.0, 0.0, SOURCE]), 0.0, [(0.0, SOURCE)]
    inertia = p.motor.inertia + p.inertia.fin + p.inertia.shaft + p.inertia.fork

    def slope(_: float, y: Any) -> list[float]:
        angle, rate, current, link = y
        voltage = np.clip(reference, -link, link)
        power = voltage * current + p.supply.device_voltage * abs(current) + p.supply.device_resistance * current**2
        charge = (max((SOURCE - link) / p.supply.source_resistance, 0.0) - (power + p.supply.quiescent_power) / link
                  - max(link - p.supply.chopper_voltage, 0.0) / p.supply.chopper_resistance)
        torque = p.motor.torque_constant * current - p.spring.stiffness * angle - p.hinge.damping * rate
        rise = voltage - p.motor.resistance * current - p.motor.back_emf_constant * rate
        return [rate, torque / inertia, rise / p.motor.inductance, charge / p.supply.capacitance]

    for _ in range(STOP):
        demand = c.kp * (c.setpoint_weight * COMMAND - x[0]) + integral - c.kd * x[1]
        reference = np.clip(demand, -x[3], x[3])
        integral += 0.0 if abs(demand) > x[3] else c.sample_time * c.ki * (COMMAND - x[0])
        x = solve_ivp(slope, (0.0, c.sample_time), x, "LSODA", rtol=1e-9, atol=1e-11, max_step=2e-5).y[:, -1]
        rows.append((x[0], x[3]))
    return np.array(rows).T


def test_second_order_convergence_to_the_independent_integration(tmp_path: Path) -> None:
    """Halving the tick twice divides the errors by 16."""
    provided = "em.capabilities.POSITION_LOOP, em.capabilities.VOLTAGE_LIMIT, em.capabilities.RETURNS_POWER"
    model = f"{changed(tmp_path, ('em.capabilities.POSITION_LOOP', provided))}+supply"
    values = load_parameters(model=model).with_values({"supply.source_resistance": 0.3}).values
    angle, link = integrated(namespace(values))
    errors = []
    for tick in (1e-4, 2.5e-5):
        run = simulate({**values, "solver.max_tick": tick}, 1e-3 * STOP, model=model, fin_command=COMMAND)
        errors.append((np.max(np.abs(run["fin_angle"] - angle)), np.max(np.abs(run["link_voltage"] - link))))
    assert (np.min(link), np.max(link)) == pytest.approx((28.1, 48.05), abs=0.1)  # sag, chopper
    np.testing.assert_array_less(errors[0], (radians(5e-4), 0.015))  # 3.6e-4 deg and 0.011 V measured
    np.testing.assert_array_less(12.0 * np.array(errors[1]), errors[0])
