"""An actuator with a wrong controller line: the anti-windup changes a velocity integral whose gain is 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from emcas_fmu.actuators.declaration import SampleInputs, Values
from emcas_fmu.actuators.electromechanical import nonlinear
from emcas_fmu.namespace import Record
from emcas_fmu.ops.base import Ops
from emcas_fmu.physics import drive


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the result of a sample of the shipped controllers, with a wrong velocity integral."""
    values = dict(nonlinear.sample(ops, p, x, inputs))
    reference = values["reference"]
    # 0 within the current limit; beyond it the followed reference is smaller.
    beyond = drive.followed(ops, p, reference) - reference
    drift = p.controller.sample_time * p.controller.drive_antiwindup * beyond
    values["velocity_integral"] = values["velocity_integral"] + ops.where(inputs.enable, drift, 0.0)
    return values


ACTUATOR = replace(nonlinear.ACTUATOR, name="unwound", sample=sample)
