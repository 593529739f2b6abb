"""The default actuator's interface."""

from __future__ import annotations

from emcas_fmu.actuators import NONLINEAR, get

ACTUATOR = get(NONLINEAR)
INPUTS, OUTPUTS, PARAMETERS = ACTUATOR.inputs, ACTUATOR.outputs, ACTUATOR.parameters
VARIABLES = INPUTS + OUTPUTS + PARAMETERS
FILE_ENTRIES = ACTUATOR.file_entries
START_ENTRIES = FILE_ENTRIES[len(PARAMETERS):]
namespace = ACTUATOR.namespace
