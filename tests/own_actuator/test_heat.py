"""The extension heat of a user's actuator: the direct drive with an ambient temperature."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

from .example import MODEL, changed

AMBIENT = '''    em.parameter("motor.resistance"'''
PROVIDES = "provides=frozenset({em.capabilities.POSITION_LOOP})"
WITH_HEAT = (
    (AMBIENT, f'''    em.tunable("friction.temperature", "degC", -100.0, 200.0, "ambient temperature"),\n{AMBIENT}'''),
    (PROVIDES, "provides=frozenset({em.capabilities.POSITION_LOOP, em.capabilities.MOTOR_CURRENT, "
               "em.capabilities.AMBIENT_TEMPERATURE})"))
# Only the winding gets run_with_heat, and no parameter depends on its temperature.
WINDING_ONLY = {"heat.winding_to_case": 1e4, "heat.winding_capacity": 1.0, "heat.resistance_coefficient": 0.0,
         "heat.torque_coefficient": 0.0}
# Without back-EMF and motion the voltage is constant.
AT_REST = {"motor.back_emf_constant": 0.0, "motor.torque_constant": 1e-6, "controller.ki": 0.0}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = changed(tmp_path_factory.mktemp("run_with_heat"), *WITH_HEAT)
    path.with_suffix(".toml").write_text('friction.temperature = "24 degC"\n', encoding="utf-8")
    return str(path)


def run_with_heat(model: str, stop: float, overrides: Mapping[str, Any], **inputs: Any
                  ) -> tuple[Mapping[str, Any], Any]:
    """Return the values and the run."""
    values = load_parameters(model=f"{model}+heat").with_values(overrides).values
    return values, simulate(values, stop, model=f"{model}+heat", **inputs)


def test_a_rising_current_warms_the_winding(model: str) -> None:
    """R i^2 with i = v/R (1 - exp(-t R/L)) heats the winding's capacity; convergence is of second order in the tick."""
    errors = []
    for tick in (2e-4, 1e-4, 5e-5):
        v, run = run_with_heat(model, 0.01, {**WINDING_ONLY, **AT_REST, "solver.max_tick": tick}, fin_command=0.05)
        tau = v["motor.inductance"] / v["motor.resistance"]
        voltage = v["controller.kp"] * v["controller.setpoint_weight"] * 0.05
        square = np.array([t - 2.0 * tau * (1.0 - exp(-t / tau)) + 0.5 * tau * (1.0 - exp(-2.0 * t / tau))
                           for t in run["time"]])
        expected = 24.0 + voltage**2 / v["motor.resistance"] * square / v["heat.winding_capacity"]
        assert expected[-1] > 25.0
        errors.append(np.abs(run["winding_temperature"] - expected).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.2), errors


def test_a_shorted_winding_gets_warm_too(model: str) -> None:
    """The disabled amplifier shorts the winding: a load that turns the fin causes a current, whose power is heat."""
    v, run = run_with_heat(model, 0.1, WINDING_ONLY, aero_torque=60.0, enable=False)
    power = v["motor.resistance"] * run["motor_current"] ** 2
    heat = np.trapezoid(power, run["time"])
    assert heat > 1.0
    # Trapezoids of 1 ms, a tenth of the time constant of the current: 0.1 %.
    assert run["winding_temperature"][-1] - 24.0 == pytest.approx(heat / v["heat.winding_capacity"], rel=0.01)


def test_resistance_and_motor_constants_depend_on_temperature(model: str) -> None:
    """The run equals that of the actuator with changed parameters.

    100 J warm the winding's capacity by 1e-4 K, which changes the resistance by 4e-7, and 0.1 rad by 4e-8 rad.
    """
    _, run = run_with_heat(model, 0.1, {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 50.0,
                               "heat.winding_capacity": 1e6, "heat.case_capacity": 1e7}, fin_command=0.1)
    plain = load_parameters(model=model)
    scale = {"motor.resistance": 1.0 + 0.00387 * 80.0, "motor.torque_constant": 1.0 - 0.0011 * 50.0,
             "motor.back_emf_constant": 1.0 - 0.0011 * 50.0}
    hot = plain.with_values({name: plain.values[name] * factor for name, factor in scale.items()})
    expected = simulate(hot.values, 0.1, model=model, fin_command=0.1)
    assert np.abs(run["fin_angle"] - expected["fin_angle"]).max() < 1e-7
    cold = simulate(plain.values, 0.1, model=model, fin_command=0.1)
    assert np.abs(run["fin_angle"] - cold["fin_angle"]).max() > 1e-3


def test_heat_and_demagnetisation_both_reduce_the_motor_constants(model: str) -> None:
    name = f"{model}+heat+faults"
    both = load_parameters(model=name).with_values({"heat.case_start_rise": 50.0, "fault.demagnetised.active": True,
                                                    "fault.demagnetised.share": 0.5})
    weak = load_parameters(model=f"{model}+heat").with_values({
        "heat.case_start_rise": 50.0, **{each: 0.5 * both.values[each] for each in (
            "motor.torque_constant", "motor.back_emf_constant")}})
    run, expected = (simulate(p.values, 0.1, model=p.model, fin_command=0.1) for p in (both, weak))
    assert all(np.array_equal(run[column], expected[column]) for column in expected)


def test_capabilities_that_heat_needs(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=r"winding parameters; let direct-drive provide em\.cap"):
        get(f"{MODEL}+heat")
    path = changed(tmp_path, (PROVIDES, "provides=frozenset({em.capabilities.MOTOR_CURRENT})"))
    assert load_parameters(model=f"{path}+heat").values["friction.temperature"] == 24.0
    other = changed(tmp_path, WITH_HEAT[1], name="other.py")
    with pytest.raises(EmcasError, match=re.escape("provides 'an ambient temperature', which needs "
                                                   "friction.temperature")):
        get(str(other))
