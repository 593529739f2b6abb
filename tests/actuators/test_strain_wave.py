"""A test actuator that is composed of groups, with another gear: its outputs and extensions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import capabilities, get, get_extension, require
from emcas_fmu.actuators.declaration import State
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = str(Path(__file__).with_name("strain_wave.py"))


def test_without_the_screw_group_there_is_no_nut() -> None:
    """A group brings its outputs, parameters and members of the terminal."""
    actuator = get(MODEL)
    assert "nut_position" not in {v.name for v in actuator.outputs} | set(actuator.terminals[0].members)
    assert not [v.name for v in actuator.parameters if v.name.startswith(("screw.", "kinematics.", "mass.nut"))]
    run = simulate(load_parameters(model=MODEL).values, 0.3, model=MODEL, fin_command=0.1)
    assert "nut_position" not in run
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=2e-3)  # friction is not compensated; a count is 4e-5 rad
    assert run["motor_angle"] == pytest.approx(100.0 * run["fin_angle"], rel=1e-9)


@pytest.mark.parametrize("kernel", ["compiled", "python"])
def test_homing_and_heat(kernel: str) -> None:
    """From an unknown angle of 5 deg, homing goes to both stops and to zero; the winding gets warm."""
    model = f"{MODEL}+heat+homing"
    values = load_parameters(model=model).with_values({"fin.start_angle": "5 deg", "homing.required": True}).values
    run = simulate(values, 7.0, 0.01, model=model, kernel=kernel, home=lambda t: t > 0.01)
    assert run["homed"][-1]
    assert not run["homed"][0]
    assert abs(run["fin_angle"][-1]) < values["homing.return_tolerance"]
    assert np.max(run["fin_angle"]) > 0.99 * values["fin.stop_angle"]
    assert np.min(run["fin_angle"]) < -0.99 * values["fin.stop_angle"]
    assert run["winding_temperature"][-1] > run["winding_temperature"][0]


@pytest.mark.parametrize(("capability", "lacking", "says"), [
    (capabilities.DRIVE_STEP, {"states": (State("motor_angle"), State("motor_speed"))}, "needs state motor_current"),
    (capabilities.SCREW_EQUATIONS, {"controller_states": ()}, "needs state integral"),
])
def test_a_capability_needs_its_states(capability: str, lacking: dict[str, Any], says: str) -> None:
    with pytest.raises(EmcasError, match=says):
        replace(get(MODEL), provides=frozenset({capability}), **lacking)


@pytest.mark.parametrize("need", [capabilities.ENCODER, capabilities.REFERENCE_LIMIT])
def test_homing_names_the_missing_capability(need: str) -> None:
    actuator = get(MODEL)
    less = replace(actuator, provides=actuator.provides - {need})
    with pytest.raises(EmcasError, match=f"homing needs {need}"):
        require(MODEL, "homing", *get_extension("homing").needs, actuator=less)
