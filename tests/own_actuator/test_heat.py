"""Heat over an actuator that is not built as the electromechanical ones are: the direct drive with an ambient."""

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
# The winding alone gets warm, and nothing follows from it.
ALONE = {"heat.winding_to_case": 1e4, "heat.winding_capacity": 1.0, "heat.resistance_coefficient": 0.0,
         "heat.torque_coefficient": 0.0}
# No back-EMF, and a torque that moves nothing: the voltage is that of the command for good.
STANDING = {"motor.back_emf_constant": 0.0, "motor.torque_constant": 1e-6, "controller.ki": 0.0}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = changed(tmp_path_factory.mktemp("warm"), *WITH_HEAT)
    path.with_suffix(".toml").write_text('friction.temperature = "24 degC"\n', encoding="utf-8")
    return str(path)


def warm(model: str, stop: float, values: Mapping[str, Any], **inputs: Any) -> tuple[Mapping[str, Any], Any]:
    chosen = load_parameters(model=f"{model}+heat").with_values(values).values
    return chosen, simulate(chosen, stop, model=f"{model}+heat", **inputs)


def test_warmth_of_a_rising_current(model: str) -> None:
    """R i^2 of i = v/R (1 - exp(-t R/L)) in the winding's capacity, in closed form; of second order in the tick."""
    errors = []
    for tick in (2e-4, 1e-4, 5e-5):
        v, run = warm(model, 0.01, {**ALONE, **STANDING, "solver.max_tick": tick}, fin_command=0.05)
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
    """A disabled amplifier shorts it: a fin that the load turns makes a current, and all of its power is heat."""
    v, run = warm(model, 0.1, ALONE, aero_torque=60.0, enable=False)
    power = v["motor.resistance"] * run["motor_current"] ** 2
    lost = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(run["time"]))
    assert lost > 1.0
    # Rows of a millisecond, a tenth of the time constant of the rise: trapezoids are off by a thousandth.
    assert run["winding_temperature"][-1] - 24.0 == pytest.approx(lost / v["heat.winding_capacity"], rel=0.01)


def test_resistance_and_constants_follow(model: str) -> None:
    """It is the actuator with those of its temperatures: with such capacities 100 J change them by 1e-4 K, and the
    resistance by 4e-7 of it; so much of 0.1 rad is 4e-8 rad."""
    _, run = warm(model, 0.1, {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 50.0,
                               "heat.winding_capacity": 1e6, "heat.case_capacity": 1e7}, fin_command=0.1)
    plain = load_parameters(model=model)
    scale = {"motor.resistance": 1.0 + 0.00387 * 80.0, "motor.torque_constant": 1.0 - 0.0011 * 50.0,
             "motor.back_emf_constant": 1.0 - 0.0011 * 50.0}
    hot = plain.with_values({name: plain.values[name] * factor for name, factor in scale.items()})
    told = simulate(hot.values, 0.1, model=model, fin_command=0.1)
    assert np.abs(run["fin_angle"] - told["fin_angle"]).max() < 1e-7
    cold = simulate(plain.values, 0.1, model=model, fin_command=0.1)
    assert np.abs(run["fin_angle"] - cold["fin_angle"]).max() > 1e-3


def test_with_faults_over_it(model: str) -> None:
    """Both change the motor's constants: of half the flux what heat leaves of it."""
    name = f"{model}+heat+faults"
    both = load_parameters(model=name).with_values({"heat.case_start_rise": 50.0, "fault.demagnetised.active": True,
                                                "fault.demagnetised.share": 0.5})
    weak = load_parameters(model=f"{model}+heat").with_values({
        "heat.case_start_rise": 50.0, **{each: 0.5 * both.values[each] for each in (
            "motor.torque_constant", "motor.back_emf_constant")}})
    found, told = (simulate(p.values, 0.1, model=p.model, fin_command=0.1) for p in (both, weak))
    assert all(np.array_equal(found[column], told[column]) for column in told)


def test_what_it_needs(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match=r"heat needs a motor current; let direct-drive provide em\.cap"):
        get(f"{MODEL}+heat")
    path = changed(tmp_path, (PROVIDES, "provides=frozenset({em.capabilities.MOTOR_CURRENT})"))
    assert load_parameters(model=f"{path}+heat").values["friction.temperature"] == 24.0
    other = changed(tmp_path, WITH_HEAT[1], name="other.py")
    with pytest.raises(EmcasError, match=re.escape("provides 'an ambient temperature', which needs "
                                                   "friction.temperature")):
        get(str(other))
