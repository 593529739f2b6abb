"""Efficiency of the screw in forward and backward drive (:mod:`emcas_fmu.actuators.electromechanical.lossy_screw`)."""

from __future__ import annotations

from ..actuators import capabilities
from ..actuators.electromechanical import lossy_screw
from .declaration import Extension

EXTENSION = Extension(
    "efficiency", "efficiency of the screw in forward and backward drive", lossy_screw.with_losses,
    needs=(capabilities.SCREW_LOAD,), parameters=lambda actuator: lossy_screw.PARAMETERS, outputs=(lossy_screw.LOSS,),
    rules=lossy_screw.rules, module=lossy_screw)
