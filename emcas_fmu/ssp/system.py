"""The system structure: four times the FMU, wired to the system's own connectors. SSD files out of the variable table.

The system's connectors are named as the variables of a unit with several fins: those of a fin are ``fin[1].fin_angle``
and so on, shared inputs stand by their own names. (Names such as fin1.fin_angle would be those of the components'
connectors: fmpy tells the two apart by nothing else.)
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from ..fmi.model_description import DESCRIPTION, STEP_SIZE, STOP_TIME
from ..variables import INPUTS, OUTPUTS, Variable
from .schema import ANNOTATION, EMCAS, OSP, SSC, SSD, SSV
from .sets import TOOL, text, unit_definitions
from .variants import fin_name

OWN_INPUTS = ("fin_command", "aero_torque")  # of each fin; the vehicle gives all fins the others
# libcosim and Ecos look for "ssd:Connections" letter by letter and refuse a file with connections of the system's own
# connectors in it. Under another prefix for the same namespace they pass it over, and readers of XML see no difference.
PREFIX = "wiring"


def outer_name(number: int, name: str) -> str:
    """The system's connector for a variable of a fin (counted from 1)."""
    return name if any(v.name == name for v in INPUTS) and name not in OWN_INPUTS else f"fin[{number}].{name}"


def _connector(parent: Element, name: str, v: Variable) -> None:
    connector = SubElement(parent, "ssd:Connector", {"name": name, "kind": v.causality, "description": v.description})
    SubElement(connector, f"ssc:{v.kind}", {"unit": v.unit} if v.kind == "Real" else {})


def _component(parent: Element, name: str, fmu: str, guid: str, parameters: str) -> None:
    component = SubElement(parent, "ssd:Component", {"name": name, "type": "application/x-fmu-sharedlibrary",
                                                     "source": f"resources/{fmu}"})
    connectors = SubElement(component, "ssd:Connectors")
    for v in INPUTS + OUTPUTS:
        _connector(connectors, v.name, v)
    bindings = SubElement(component, "ssd:ParameterBindings")
    SubElement(bindings, "ssd:ParameterBinding", {"source": f"resources/{parameters}"})
    annotation = SubElement(SubElement(component, "ssd:Annotations"), "ssc:Annotation", {"type": ANNOTATION})
    SubElement(annotation, "emcas:Fmu", {"guid": guid})


def _connections(parent: Element, fins: int, prefix: str) -> None:
    connections = SubElement(parent, f"{prefix}:Connections")
    for number in range(1, fins + 1):
        for v in INPUTS:
            SubElement(connections, "ssd:Connection", {
                "startConnector": outer_name(number, v.name), "endElement": fin_name(number), "endConnector": v.name})
        for v in OUTPUTS:
            SubElement(connections, "ssd:Connection", {
                "startElement": fin_name(number), "startConnector": v.name, "endConnector": outer_name(number, v.name)})


def _experiment(root: Element) -> None:
    """With the step, without which libcosim does not start."""
    experiment = SubElement(root, "ssd:DefaultExperiment", {"startTime": "0", "stopTime": text(STOP_TIME)})
    annotation = SubElement(SubElement(experiment, "ssd:Annotations"), "ssc:Annotation",
                            {"type": "com.opensimulationplatform"})
    algorithm = SubElement(annotation, "osp:Algorithm")
    SubElement(algorithm, "osp:FixedStepAlgorithm", {"baseStepSize": text(STEP_SIZE)})


def system_structure(name: str, fmu: str, guid: str, system_sets: Sequence[tuple[str, str]], fin_sets: Sequence[str],
                     prefix: str = PREFIX) -> Element:
    """The SystemStructureDescription element of a variant.

    `fmu` is the FMU's file below resources/ and `guid` its GUID; `system_sets` are prefixes and files of parameter
    sets bound at the system, `fin_sets` the file bound to each fin's component; `prefix` is that of Connections.
    """
    fins = len(fin_sets)
    root = Element("ssd:SystemStructureDescription", {
        "xmlns:ssd": SSD, "xmlns:ssc": SSC, "xmlns:ssv": SSV, "xmlns:osp": OSP, "xmlns:emcas": EMCAS,
        **({f"xmlns:{prefix}": SSD} if prefix != "ssd" else {}),
        "version": "1.0", "name": name, "description": DESCRIPTION, "generationTool": TOOL})
    system = SubElement(root, "ssd:System", {"name": "EMCAS", "description": f"{fins} fins, {name}"})
    connectors = SubElement(system, "ssd:Connectors")
    for v in INPUTS:
        if v.name not in OWN_INPUTS:
            _connector(connectors, v.name, v)
    for number in range(1, fins + 1):
        for v in INPUTS + OUTPUTS:
            if (outer := outer_name(number, v.name)) != v.name:
                _connector(connectors, outer, v)
    # Those bound at the system count before those bound to a component, where both are read.
    bindings = SubElement(system, "ssd:ParameterBindings")
    for at, file in system_sets:
        SubElement(bindings, "ssd:ParameterBinding", {"source": f"resources/{file}", **({"prefix": at} if at else {})})
    elements = SubElement(system, "ssd:Elements")
    for number, file in enumerate(fin_sets, start=1):
        _component(elements, fin_name(number), fmu, guid, file)
    _connections(system, fins, prefix)
    unit_definitions(root, "ssd", {v.unit for v in INPUTS + OUTPUTS if v.kind == "Real"})
    _experiment(root)
    return root
