"""What a file that declares an actuator needs: ``from emcas_fmu.declare import Actuator, State, parameter``."""

from .actuators import capabilities as capabilities
from .actuators import fin_port as fin_port
from .actuators.declaration import FIN as FIN
from .actuators.declaration import Actuator as Actuator
from .actuators.declaration import PlantFault as PlantFault
from .actuators.declaration import PlantInputs as PlantInputs
from .actuators.declaration import SampleInputs as SampleInputs
from .actuators.declaration import State as State
from .actuators.declaration import Supply as Supply
from .rules import rising as rising
from .rules import rule as rule
from .rules import when as when
from .steppers.discontinuities import Backlash as Backlash
from .steppers.discontinuities import Coulomb as Coulomb
from .steppers.discontinuities import Limit as Limit
from .steppers.discontinuities import Stop as Stop
from .variables import Terminal as Terminal
from .variables import array as array
from .variables import boolean_input as boolean_input
from .variables import boolean_output as boolean_output
from .variables import integer_parameter as integer_parameter
from .variables import parameter as parameter
from .variables import real_input as real_input
from .variables import real_output as real_output
from .variables import switch as switch
from .variables import tunable as tunable
