"""The system structure: four times the FMU, wired to the system's own connectors. SSD files out of the variable table.

The system's connectors are named as the variables of a unit with several fins: those of a fin are ``fin[1].fin_angle``
and so on, shared inputs stand by their own names. (Names such as fin1.fin_angle would be those of the components'
connectors: fmpy tells the two apart by nothing else.)
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from ..actuators import NONLINEAR
from ..fmi.interface import FmuInterface
from ..fmi.model_description import STEP_SIZE, STOP_TIME, describe
from ..variables import Variable
from .schema import ANNOTATION, EMCAS, OSP, SSC, SSD, SSV
from .sets import TOOL, shared_inputs, text, unit_definitions
from .variants import fin_name

# libcosim and Ecos look for "ssd:Connections" letter by letter and refuse a file with connections of the system's own
# connectors in it, and libcosim ends the process over a connector of an enumeration. Under another prefix for the same
# namespace they pass both over, and readers of XML see no difference.
PREFIX = "wiring"


def outer_name(number: int, name: str, model: str = NONLINEAR) -> str:
    """The system's connector for a variable of a fin (counted from 1)."""
    return name if name in shared_inputs(model) else f"fin[{number}].{name}"


def _connector(parent: Element, name: str, v: Variable, prefix: str) -> None:
    tag = f"{prefix if v.items else 'ssd'}:Connector"
    connector = SubElement(parent, tag, {"name": name, "kind": v.causality, "description": v.description})
    named = {"Real": {"unit": v.unit}, "Enumeration": {"name": v.name}}
    SubElement(connector, f"ssc:{v.kind}", named.get(v.kind, {}))


def _component(parent: Element, unit: FmuInterface, name: str, fmu: str, guid: str, parameters: str,
               prefix: str) -> None:
    component = SubElement(parent, "ssd:Component", {"name": name, "type": "application/x-fmu-sharedlibrary",
                                                     "source": f"resources/{fmu}"})
    connectors = SubElement(component, "ssd:Connectors")
    for v in unit.inputs + unit.outputs:
        _connector(connectors, v.name, v, prefix)
    bindings = SubElement(component, "ssd:ParameterBindings")
    SubElement(bindings, "ssd:ParameterBinding", {"source": f"resources/{parameters}"})
    annotation = SubElement(SubElement(component, "ssd:Annotations"), "ssc:Annotation", {"type": ANNOTATION})
    SubElement(annotation, "emcas:Fmu", {"guid": guid})


def _connections(parent: Element, unit: FmuInterface, fins: int, prefix: str) -> None:
    connections = SubElement(parent, f"{prefix}:Connections")
    for number in range(1, fins + 1):
        fin = fin_name(number)
        for v in unit.inputs:
            SubElement(connections, "ssd:Connection", {"startConnector": outer_name(number, v.name, unit.kind),
                                                       "endElement": fin, "endConnector": v.name})
        for v in unit.outputs:
            SubElement(connections, "ssd:Connection", {"startElement": fin, "startConnector": v.name,
                                                       "endConnector": outer_name(number, v.name, unit.kind)})


def _enumerations(root: Element, variables: Sequence[Variable]) -> None:
    """The items of the enumerations among these."""
    listed = {v.name: v for v in variables if v.items}
    if not listed:
        return
    enumerations = SubElement(root, "ssd:Enumerations")
    for name, v in listed.items():
        enumeration = SubElement(enumerations, "ssc:Enumeration", {"name": name, "description": v.description})
        for value, (item, _) in enumerate(v.items, start=1):
            SubElement(enumeration, "ssc:Item", {"name": item, "value": str(value)})


def _experiment(root: Element) -> None:
    """With the step, without which libcosim does not start."""
    experiment = SubElement(root, "ssd:DefaultExperiment", {"startTime": "0", "stopTime": text(STOP_TIME)})
    annotation = SubElement(SubElement(experiment, "ssd:Annotations"), "ssc:Annotation",
                            {"type": "com.opensimulationplatform"})
    algorithm = SubElement(annotation, "osp:Algorithm")
    SubElement(algorithm, "osp:FixedStepAlgorithm", {"baseStepSize": text(STEP_SIZE)})


def system_structure(name: str, fmu: str, guid: str, system_sets: Sequence[tuple[str, str]], fin_sets: Sequence[str],
                     prefix: str = PREFIX, model: str = NONLINEAR) -> Element:
    """The SystemStructureDescription element of a variant.

    `fmu` is the FMU's file below resources/ and `guid` its GUID; `system_sets` are prefixes and files of parameter
    sets bound at the system, `fin_sets` the file bound to each fin's component; `prefix` is that of Connections,
    `model` the FMU's.
    """
    fins, unit = len(fin_sets), FmuInterface(1, model)
    root = Element("ssd:SystemStructureDescription", {
        "xmlns:ssd": SSD, "xmlns:ssc": SSC, "xmlns:ssv": SSV, "xmlns:osp": OSP, "xmlns:emcas": EMCAS,
        **({f"xmlns:{prefix}": SSD} if prefix != "ssd" else {}),
        "version": "1.0", "name": name, "description": describe(unit), "generationTool": TOOL})
    system = SubElement(root, "ssd:System", {"name": "EMCAS", "description": f"{fins} fins, {name}"})
    connectors = SubElement(system, "ssd:Connectors")
    for v in unit.inputs:
        if v.name in shared_inputs(model):
            _connector(connectors, v.name, v, prefix)
    for number in range(1, fins + 1):
        for v in unit.inputs + unit.outputs:
            if v.name not in shared_inputs(model):
                _connector(connectors, outer_name(number, v.name, model), v, prefix)
    # Those bound at the system count before those bound to a component, where both are read.
    bindings = SubElement(system, "ssd:ParameterBindings")
    for at, file in system_sets:
        SubElement(bindings, "ssd:ParameterBinding", {"source": f"resources/{file}", **({"prefix": at} if at else {})})
    elements = SubElement(system, "ssd:Elements")
    for number, file in enumerate(fin_sets, start=1):
        _component(elements, unit, fin_name(number), fmu, guid, file, prefix)
    _connections(system, unit, fins, prefix)
    _enumerations(root, unit.inputs + unit.outputs)
    unit_definitions(root, "ssd", {v.unit for v in unit.inputs + unit.outputs if v.kind == "Real"})
    _experiment(root)
    return root
