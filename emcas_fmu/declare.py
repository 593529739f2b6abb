"""What a file that declares an actuator needs: ``import emcas_fmu.declare as em``."""

from .actuators import capabilities, fin_port
from .actuators.declaration import FIN, Actuator, PlantFault, PlantInputs, SampleInputs, State, Supply
from .control.trajectory import Ahead, Motion
from .namespace import Record
from .rules import rising, rule, when
from .steppers.discontinuities import Backlash, Coulomb, Limit, Stop
from .steppers.events import Switched
from .variables import (
    Terminal,
    array,
    boolean_input,
    boolean_output,
    integer_parameter,
    parameter,
    real_input,
    real_output,
    switch,
    tunable,
)

__all__ = [
    "FIN",
    "Actuator",
    "Ahead",
    "Backlash",
    "Coulomb",
    "Limit",
    "Motion",
    "PlantFault",
    "PlantInputs",
    "Record",
    "SampleInputs",
    "State",
    "Stop",
    "Supply",
    "Switched",
    "Terminal",
    "array",
    "boolean_input",
    "boolean_output",
    "capabilities",
    "fin_port",
    "integer_parameter",
    "parameter",
    "real_input",
    "real_output",
    "rising",
    "rule",
    "switch",
    "tunable",
    "when",
]
