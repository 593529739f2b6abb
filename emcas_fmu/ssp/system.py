"""The system structure: several times the FMU, wired to the system's own connectors. SSD files out of the declaration.

The system's connectors are named as the variables of a unit with several fins: those of a fin are ``fin[1].fin_angle``
and so on, shared inputs stand by their own names. (Names such as fin1.fin_angle would be those of the components'
connectors: fmpy tells the two apart by nothing else.)
"""

from __future__ import annotations

from collections.abc import Sequence

from ..fmi.interface import FmuInterface
from ..fmi.model_description import STEP_SIZE, STOP_TIME, describe
from .schema import ANNOTATION, FMU, render
from .sets import fmi_units, shared_inputs
from .variants import Variant

# libcosim and Ecos look for "ssd:Connections" letter by letter and refuse a file with connections of the system's own
# connectors in it, and libcosim ends the process over a connector of an enumeration. Under another prefix for the same
# namespace they pass both over, and readers of XML see no difference.
PREFIX = "wiring"


def system_structure(variant: Variant, fmu: str, guid: str, bindings: Sequence[tuple[str, str]], prefix: str) -> bytes:
    """Return the SystemStructureDescription of a variant.

    `fmu` is the FMU's file below resources/ and `guid` its GUID; `bindings` are prefixes and files of parameter sets
    bound at the system; `prefix` is that of Connections. To each fin's component its set below flat/ is bound.
    """
    unit = FmuInterface(1, variant.fins[0].model)
    variables = unit.inputs + unit.outputs
    return render("structure.xml.j2", name=variant.name, description=describe(unit), type=FMU, fmu=fmu, guid=guid,
                  annotation=ANNOTATION, prefix=prefix, fins=variant.names, bindings=bindings,
                  inputs=unit.inputs, outputs=unit.outputs, shared=shared_inputs(unit.kind),
                  enumerations={v.name: v for v in variables if v.items}.values(), units=fmi_units(variables),
                  stop=STOP_TIME, step=STEP_SIZE)
