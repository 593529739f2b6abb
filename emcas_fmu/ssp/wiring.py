"""Every connection of a structure: ends that exist, one output to one input, of one type and one unit."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from math import isclose

from .findings import Report, nearest
from .interface import Interface
from .structure import Connection, Connector, Element, Structure, systems
from .units import Unit, conversion

OMSIMULATOR = "org.openmodelica"  # the type of its annotation
_ROLES = {"input": "sink", "parameter": "sink", "output": "source", "calculatedParameter": "source"}


@dataclass(frozen=True)
class End:
    """One end of a connection inside a system: its role there (source, sink, either), its type and its unit."""

    label: str
    role: str
    type: str
    unit: str
    definition: Unit | None


class _Wiring:
    def __init__(self, structure: Structure, report: Report) -> None:
        self.defined, self.report = structure.units, report
        self.error, self.warning = partial(report.error, structure.file), partial(report.warning, structure.file)

    def system(self, prefix: str, system: Element) -> None:
        """Check all connections of a system, and what is left without one."""
        self.prefix = prefix
        self.hosts(system)
        fed: dict[tuple[str, str], list[str]] = defaultdict(list)
        used = set()
        for connection in system.connections:
            self.report.connections += 1
            place = self.place(connection)
            start, end = (self.end(system, place, *pair) for pair in (connection.start, connection.end))
            used |= {connection.start, connection.end}
            if start is None or end is None:
                continue
            if sink := self.sink(place, connection, start, end):
                fed[sink].append(place)
            if start.type and end.type and start.type != end.type:
                self.error(place, f"{start.label} is {start.type} and {end.label} is {end.type}",
                           "connect variables of one type")
            self.units(place, connection, start, end)
        for sink, places in fed.items():
            if len(places) > 1:
                self.error(places[1], f"{'.'.join(filter(None, sink))} is fed twice, first by "
                           f"{places[0].removeprefix('connection ')}", "remove one of the two")
        self.unused(system, used)

    def hosts(self, system: Element) -> None:
        """Warn of what libcosim, Ecos and OMSimulator, which compare prefixes letter by letter, do not do."""
        if self.prefix:
            self.warning(f"system {self.prefix[:-1]}", "is within a system, which libcosim refuses and Ecos passes "
                         "over", "put its components into the outermost one for these")
        inner = [c for c in system.connections if c.start[0] and c.end[0]]
        if system.connections_prefix != "ssd" and system.connections:
            self.warning(f"{system.connections_prefix}:Connections", "libcosim and Ecos pass over all in it, and "
                         "OMSimulator refuses the file", "write ssd:Connections")
        elif len(inner) < len(system.connections):
            self.warning("ssd:Connections", "has connections of the system's own connectors, with which libcosim and "
                         "Ecos refuse the file", "run it with examples/ssp_hosts for these, or wire components only")
        if not self.prefix and system.annotations[:1] != [OMSIMULATOR]:
            self.warning(f"system {system.name}", "does not begin its Annotations with the one that OMSimulator needs "
                         "to open the file", f"add an {OMSIMULATOR} annotation, as emcas ssp writes it")
        for name in system.connectors:
            if "." in name:
                self.warning(f"connector {self.prefix}{name}", "of the system has a dot, with which OMSimulator does "
                             "not run", f"name it {name.replace('.', '_')}")
        for element in system.elements.values():
            if element.type != "system" and element.annotations:
                self.warning(f"component {self.prefix}{element.name}", "has Annotations, with which OMSimulator "
                             "refuses it", "put them at its system")
            for c in element.connectors.values():
                if element.type != "system" and c.type == "Enumeration" and c.prefix == "ssd":
                    self.warning(f"connector {self.prefix}{element.name}.{c.name}", "is of an enumeration, over which "
                                 "libcosim ends the process", "run the archive with examples/ssp_hosts for it, or "
                                 "give the element another prefix for the same namespace")

    def place(self, connection: Connection) -> str:
        """Return how to call a connection."""
        return f"connection {connection}" + (f" in {self.prefix[:-1]}" if self.prefix else "")

    def end(self, system: Element, place: str, name: str, connector: str) -> End | None:
        """Return an end by element (empty: the system itself) and connector; None, reported, if it does not exist."""
        if name and name not in system.elements:
            self.error(place, f"there is no element {name}",
                       nearest(name, system.elements, f"there is {', '.join(system.elements) or 'none'}"))
            return None
        element = system.elements[name] if name else system
        label, interface = ".".join(filter(None, (name, connector))), element.interface
        names = interface.ports if interface else element.connectors
        if connector not in names:
            whose = f"the FMU of {name}" if interface else (name or "the system")
            what = "variable" if interface else "connector"
            self.error(place, f"{whose} has no {what} {connector!r}",
                       nearest(connector, names, f"no name is close to it: look at the {what}s of {whose}"))
            return None
        declared = element.connectors.get(connector)
        if declared is None:
            self.error(place, f"{name} declares no connector {connector}",
                       "add it to the Connectors of the component; libcosim refuses the file without")
        if interface:
            port = interface.ports[connector]
            if declared is not None:
                self.declaration(f"connector {self.prefix}{label}", declared, interface)
            role = "source" if port.causality in ("local", "independent") else _ROLES.get(port.causality, "sink")
            return End(label, role, port.kind, port.unit, interface.units.get(port.unit))
        assert declared is not None
        role = _ROLES.get(declared.kind, "either")
        if not name:  # seen from within, a system's input is where values come from
            role = {"source": "sink", "sink": "source"}.get(role, role)
        return End(label, role, declared.type, declared.unit, self.defined.get(declared.unit))

    def declaration(self, place: str, declared: Connector, interface: Interface) -> None:
        """Check a component's connector against the variable of its FMU."""
        port = interface.ports[declared.name]
        if declared.kind not in (port.causality, "inout"):
            self.error(place, f"is declared {declared.kind}, but is {port.causality} of the FMU",
                       f'write kind="{port.causality}"')
        if declared.type and declared.type != port.kind:
            self.error(place, f"is declared {declared.type}, but is {port.kind} in the FMU", f"write ssc:{port.kind}")
        if not declared.type:
            self.warning(place, "has no type", f"write ssc:{port.kind}; libcosim refuses the file without")
        if declared.unit and declared.unit != port.unit:
            convert = conversion(self.defined.get(declared.unit), interface.units.get(port.unit))
            if not (convert and convert.identity):
                self.error(place, f"is declared in {declared.unit}, but the FMU's variable is in "
                           f"{port.unit or 'no unit'}", f'write unit="{port.unit}": no host converts here')

    def sink(self, place: str, connection: Connection, start: End, end: End) -> tuple[str, str] | None:
        """Return which end is fed; None, reported, if neither or both could be."""
        if start.role == end.role and start.role != "either":
            what = "feeds" if start.role == "source" else "is fed"
            self.error(place, f"both {start.label} and {end.label} are ends that {what}",
                       "connect an output to an input, or a connector of the system to one of its own kind")
            return None
        if start.role == "sink" or end.role == "source":
            self.warning(place, "runs from its end to its start, which libcosim and Ecos take amiss",
                         "exchange start and end")
            return connection.start
        return connection.end

    def units(self, place: str, connection: Connection, start: End, end: End) -> None:
        """Check for the same unit at both ends, or a transformation that converts: no host does so by itself."""
        if not start.unit or not end.unit:
            return
        if start.definition is None or end.definition is None:
            if start.unit != end.unit:
                self.error(place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, of which at least "
                           "one is not defined, and hosts pass values on as they are",
                           "use one unit, or define both in the Units of the structure")
            return
        needed, transformation = conversion(start.definition, end.definition), connection.transformation
        if needed is None:
            self.error(place, f"{start.label} in {start.unit} does not measure what {end.label} in {end.unit} does",
                       "connect quantities of one kind")
        elif needed.identity:
            return
        elif transformation is None:
            self.error(place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, which hosts pass on as "
                       f"they are", f"use one unit, or add a LinearTransformation with factor {needed.factor:.12g} and "
                       f"offset {needed.offset:.12g}, and suppressUnitConversion")
        elif not (isclose(transformation[0], needed.factor, rel_tol=1e-6)
                  and isclose(transformation[1], needed.offset, rel_tol=1e-6, abs_tol=1e-12)):
            self.error(place, f"its transformation is not that from {start.unit} to {end.unit}",
                       f"write factor {needed.factor:.12g} and offset {needed.offset:.12g}")
        elif not connection.suppressed:
            self.warning(place, "a host that converts units does so besides the transformation",
                         'add suppressUnitConversion="true"')

    def unused(self, system: Element, used: set[tuple[str, str]]) -> None:
        """Warn of inputs nothing is wired to, and of connectors of the system that lead nowhere.

        In a system of components alone a host feeds the inputs.
        """
        if not self.prefix and not system.connections and not system.connectors:
            return
        for element in system.elements.values():
            ports = element.interface.ports if element.interface else {}
            inputs = [p.name for p in ports.values() if p.causality == "input"] if element.interface else [
                c.name for c in element.connectors.values() if c.kind == "input" and element.type == "system"]
            for name in inputs:
                if (element.name, name) in used:
                    continue
                declared = name in element.connectors
                stays = f": it stays at {ports[name].start} {ports[name].unit}" if (
                    name in ports and ports[name].start is not None) else ""
                self.warning(f"input {self.prefix}{element.name}.{name}", f"is not wired{stays}"
                             + (", and fmpy feeds a declared one from some other signal" if declared else ""),
                             "wire it" + (", or drop the connector" if declared else ""))
        for name, connector in system.connectors.items():
            if ("", name) not in used and connector.kind in ("input", "output"):
                self.warning(f"connector {self.prefix}{name}", "of the system leads nowhere",
                             "wire it, or drop it: fmpy fails over outputs like it")


def check_wiring(structure: Structure, report: Report) -> None:
    """Check the connections of a structure whose components' FMUs have been read."""
    wiring = _Wiring(structure, report)
    for prefix, system in systems(structure.system):
        wiring.system(prefix, system)
