"""An actuator composed of groups, with another gear: its outputs, and the extensions that apply."""

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


def test_it_has_no_nut() -> None:
    """An output comes with its group, and so do parameters and members of the terminal."""
    actuator = get(MODEL)
    assert "nut_position" not in {v.name for v in actuator.outputs} | set(actuator.terminals[0].members)
    assert not [v.name for v in actuator.parameters if v.name.startswith(("screw.", "kinematics.", "mass.nut"))]
    run = simulate(load_parameters(model=MODEL).values, 0.3, model=MODEL, fin_command=0.1)
    assert "nut_position" not in run
    assert run["fin_angle"][-1] == pytest.approx(0.1, abs=2e-3)  # a count is 4e-5 rad, friction is not fed forward
    assert run["motor_angle"] == pytest.approx(100.0 * run["fin_angle"], rel=1e-9)


@pytest.mark.parametrize("kernel", ["compiled", "python"])
def test_homing_and_heat(kernel: str) -> None:
    """From 5 deg, unknown, to both stops and back; the winding gets warm on the way."""
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
def test_a_capability_asks_for_its_states(capability: str, lacking: dict[str, Any], says: str) -> None:
    with pytest.raises(EmcasError, match=says):
        replace(get(MODEL), provides=frozenset({capability}), **lacking)


@pytest.mark.parametrize("need", [capabilities.ENCODER, capabilities.REFERENCE_LIMIT])
def test_homing_says_what_is_missing(need: str) -> None:
    actuator = get(MODEL)
    less = replace(actuator, provides=actuator.provides - {need})
    with pytest.raises(EmcasError, match=f"homing needs {need}"):
        require(MODEL, "homing", *get_extension("homing").needs, actuator=less)
