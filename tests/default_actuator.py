"""The default actuator's interface."""

from __future__ import annotations

from emcas_fmu.actuators import NAMES, NONLINEAR, get
from tests.marks import others_slow

ACTUATOR = get(NONLINEAR)
INPUTS, OUTPUTS, PARAMETERS = ACTUATOR.inputs, ACTUATOR.outputs, ACTUATOR.parameters
VARIABLES = INPUTS + OUTPUTS + PARAMETERS
FILE_ENTRIES = ACTUATOR.file_entries
namespace = ACTUATOR.namespace
# Every shipped actuator, for tests that compile its kernel. All but two are marked slow: together they take minutes.
EVERY = others_slow(NAMES, lambda name: name in (NONLINEAR, "second-order"))
# The thesis's controllers: independent integrations and closed forms in the tests have these gains, which do not change
# with the shipped ones.
THESIS_LOOPS = {"controller.position.setpoint_weight": 1.0, "controller.drive_antiwindup": 0.0,
                "controller.position.kp": 57.3, "controller.position.ki": 268.0, "controller.velocity.kp": 0.0464,
                "controller.antiwindup": 6.21}
