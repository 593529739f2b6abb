"""Every connection of a structure: ends that exist, one output to one input, of one type and one unit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose
from typing import Literal

from .findings import Log, nearest
from .interface import Interface
from .structure import Connection, Connector, Element, Structure, systems
from .units import Unit, conversion


@dataclass(frozen=True)
class End:
    """One end of a connection inside a system: what it does there, of which type, in which unit."""

    label: str
    role: Literal["source", "sink", "either"]
    type: str
    unit: str
    definition: Unit | None


class _Wiring:
    def __init__(self, structure: Structure, interfaces: Mapping[int, Interface], log: Log) -> None:
        self.structure, self.interfaces, self.log, self.file = structure, interfaces, log, structure.file

    def system(self, prefix: str, system: Element) -> None:
        """All connections of a system, and what is left without one."""
        self.prefix = prefix
        self.hosts(system)
        fed: dict[tuple[str, str], list[str]] = defaultdict(list)
        used = set()
        for connection in system.connections:
            self.log.connections += 1
            place = self.place(connection)
            start, end = (self.end(system, place, *pair) for pair in (connection.start, connection.end))
            used |= {connection.start, connection.end}
            if start is None or end is None:
                continue
            sink = self.directed(place, connection, start, end)
            if sink:
                fed[sink].append(place)
            self.types(place, start, end)
            self.units(place, connection, start, end)
        for sink, places in fed.items():
            if len(places) > 1:
                self.log.error(self.file, places[1], f"{'.'.join(filter(None, sink))} is fed twice, first by "
                               f"{places[0].removeprefix('connection ')}", "remove one of the two")
        self.unused(system, used)

    def hosts(self, system: Element) -> None:
        """What libcosim and Ecos, which compare prefixes letter by letter, make of connections and connectors."""
        if self.prefix:
            self.log.warning(self.file, f"system {self.prefix[:-1]}", "is within a system, which libcosim refuses and "
                             "Ecos passes over", "put its components into the outermost one for these")
        inner = [c for c in system.connections if c.start[0] and c.end[0]]
        if system.connections_prefix != "ssd" and inner:
            self.log.warning(self.file, self.place(inner[0]), f"is below {system.connections_prefix}:Connections, "
                             "which libcosim and Ecos pass over, as are all between components there",
                             "run the archive with examples/ssp_hosts for these")
        if system.connections_prefix == "ssd" and len(inner) < len(system.connections):
            self.log.warning(self.file, "ssd:Connections", "has connections of the system's own connectors, with which "
                             "libcosim and Ecos refuse the file", "run it with examples/ssp_hosts for these, or give "
                             "the element another prefix for the same namespace")

        for element in system.elements.values():
            for c in element.connectors.values():
                if element.type != "system" and c.type == "Enumeration" and c.prefix == "ssd":
                    self.log.warning(self.file, f"connector {self.prefix}{element.name}.{c.name}", "is of an "
                                     "enumeration, over which libcosim ends the process", "run the archive with "
                                     "examples/ssp_hosts for it, or give the element another prefix for the same "
                                     "namespace")

    def place(self, connection: Connection) -> str:
        """How to call a connection."""
        return f"connection {connection}" + (f" in {self.prefix[:-1]}" if self.prefix else "")

    def end(self, system: Element, place: str, name: str, connector: str) -> End | None:
        """What an end is; None if it does not exist, which is told."""
        inside = name != ""
        if inside and name not in system.elements:
            self.log.error(self.file, place, f"there is no element {name}",
                           nearest(name, system.elements, f"there is {', '.join(system.elements) or 'none'}"))
            return None
        element = system.elements[name] if inside else system
        label = ".".join(filter(None, (name, connector)))
        interface = self.interfaces.get(id(element))
        known = interface.ports if interface else element.connectors
        if connector not in known:
            whose = f"the FMU of {name}" if interface else (name or "the system")
            what = "variable" if interface else "connector"
            self.log.error(self.file, place, f"{whose} has no {what} {connector!r}",
                           nearest(connector, known, f"no name is close to it: look at the {what}s of {whose}"))
            return None
        declared = element.connectors.get(connector)
        if declared is None:
            self.log.error(self.file, place, f"{name} declares no connector {connector}",
                           "add it to the Connectors of the component; libcosim refuses the file without")
        if interface:
            return self.of_fmu(label, declared, interface, connector)
        assert declared is not None
        role = {"input": "sink", "parameter": "sink", "output": "source", "calculatedParameter": "source"}.get(
            declared.kind, "either")
        if not inside:  # seen from within, a system's input is where values come from
            role = {"sink": "source", "source": "sink"}.get(role, role)
        return End(label, role, declared.type, declared.unit, self.defined(declared.unit))  # type: ignore[arg-type]

    def of_fmu(self, label: str, declared: Connector | None, interface: Interface, name: str) -> End:
        port = interface.ports[name]
        role: Literal["source", "sink", "either"] = "source" if port.causality in (
            "output", "calculatedParameter", "local", "independent") else "sink"
        place = f"connector {self.prefix}{label}"
        definition = interface.units.get(port.unit)
        if declared is None:
            return End(label, role, port.kind, port.unit, definition)
        if declared.kind not in (port.causality, "inout"):
            self.log.error(self.file, place, f"is declared {declared.kind}, but is {port.causality} of the FMU",
                           f'write kind="{port.causality}"')
        if declared.type and declared.type != port.kind:
            self.log.error(self.file, place, f"is declared {declared.type}, but is {port.kind} in the FMU",
                           f"write ssc:{port.kind}")
        if not declared.type:
            self.log.warning(self.file, place, "has no type",
                             f"write ssc:{port.kind}; libcosim refuses the file without")
        if declared.unit and declared.unit != port.unit:
            mine = self.defined(declared.unit)
            found = conversion(mine, definition) if mine and definition else None
            if not (found and found.identity):
                self.log.error(self.file, place, f"is declared in {declared.unit}, but the FMU's variable is in "
                               f"{port.unit or 'no unit'}", f"write unit=\"{port.unit}\": no host converts here")
        return End(label, role, port.kind, port.unit, definition)

    def defined(self, name: str) -> Unit | None:
        """A unit of the structure, or of any of its FMUs."""
        return self.structure.units.get(name) or next(
            (i.units[name] for i in self.interfaces.values() if name in i.units), None)

    def directed(self, place: str, connection: Connection, start: End, end: End) -> tuple[str, str] | None:
        """Which end is fed; None if neither or both could be."""
        if start.role == end.role and start.role != "either":
            what = "feeds" if start.role == "source" else "is fed"
            self.log.error(self.file, place, f"both {start.label} and {end.label} are ends that {what}",
                           "connect an output to an input, or a connector of the system to one of its own kind")
            return None
        if start.role == "sink" or end.role == "source":
            self.log.warning(self.file, place, "runs from its end to its start, which libcosim and Ecos take amiss",
                             "exchange start and end")
            return connection.start
        return connection.end

    def types(self, place: str, start: End, end: End) -> None:
        """The same type at both ends."""
        if start.type and end.type and start.type != end.type:
            self.log.error(self.file, place, f"{start.label} is {start.type} and {end.label} is {end.type}",
                           "connect variables of one type")

    def units(self, place: str, connection: Connection, start: End, end: End) -> None:
        """The same unit at both ends, or a transformation that converts: no host here does so by itself."""
        if not start.unit or not end.unit:
            return
        if start.definition is None or end.definition is None:
            if start.unit != end.unit:
                self.log.error(self.file, place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, "
                               "of which at least one is not defined, and hosts pass values on as they are",
                               "use one unit, or define both in the Units of the structure")
            return
        needed = conversion(start.definition, end.definition)
        if needed is None:
            self.log.error(self.file, place, f"{start.label} in {start.unit} does not measure what {end.label} in "
                           f"{end.unit} does", "connect quantities of one kind")
        elif needed.identity:
            return
        elif connection.transformation is None:
            self.log.error(self.file, place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, which "
                           "hosts pass on as they are", "use one unit, or add a LinearTransformation with factor "
                           f"{needed.factor:.12g} and offset {needed.offset:.12g}, and suppressUnitConversion")
        elif not (isclose(connection.transformation[0], needed.factor, rel_tol=1e-6)
                  and isclose(connection.transformation[1], needed.offset, rel_tol=1e-6, abs_tol=1e-12)):
            self.log.error(self.file, place, f"its transformation is not that from {start.unit} to {end.unit}",
                           f"write factor {needed.factor:.12g} and offset {needed.offset:.12g}")
        elif not connection.suppressed:
            self.log.warning(self.file, place, "a host that converts units does so besides the transformation",
                             'add suppressUnitConversion="true"')

    def unused(self, system: Element, used: set[tuple[str, str]]) -> None:
        """Inputs nothing is wired to, and connectors of the system that lead nowhere."""
        for element in system.elements.values():
            interface = self.interfaces.get(id(element))
            names = interface.inputs if interface else [c.name for c in element.connectors.values()
                                                        if c.kind == "input" and element.type == "system"]
            for name in names:
                if (element.name, name) in used:
                    continue
                start = interface.ports[name].start if interface else None
                unit = f" {interface.ports[name].unit}" if interface else ""
                declared = name in element.connectors
                self.log.warning(self.file, f"input {self.prefix}{element.name}.{name}",
                                 "is not wired" + (f": it stays at {start}{unit}" if start is not None else "")
                                 + (", and fmpy feeds a declared one from some other signal" if declared else ""),
                                 "wire it" + (", or drop the connector" if declared else ""))
        for name, connector in system.connectors.items():
            if ("", name) not in used and connector.kind in ("input", "output"):
                self.log.warning(self.file, f"connector {self.prefix}{name}", "of the system leads nowhere",
                                 "wire it, or drop it: fmpy fails over outputs like it")


def check_wiring(structure: Structure, interfaces: Mapping[int, Interface], log: Log) -> None:
    """Check the connections of a structure; `interfaces` are the FMUs by identity of the component."""
    wiring = _Wiring(structure, interfaces, log)
    for prefix, system in systems(structure.system):
        wiring.system(prefix, system)
