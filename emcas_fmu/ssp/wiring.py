"""Every connection of a structure: ends that exist, one output to one input, of one type and one unit."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import partial

from .findings import Report, nearest
from .interface import Interface
from .structure import Connector, Structure
from .units import Unit, conversion

OMSIMULATOR = "org.openmodelica"  # the type of its annotation
_SOURCES = ("output", "calculatedParameter", "local", "independent")


@dataclass(frozen=True)
class End:
    """One end of a connection as seen inside the system."""

    label: str
    source: bool
    type: str
    unit: Unit


def check_wiring(structure: Structure, report: Report) -> None:
    """Check the connections of a structure whose components' FMUs have been read."""
    _Wiring(structure, report).check()


class _Wiring:
    def __init__(self, structure: Structure, report: Report) -> None:
        self.system, self.report = structure.system, report
        self.error, self.warning = partial(report.error, structure.file), partial(report.warning, structure.file)

    def check(self) -> None:
        self.limits_of_hosts()
        fed: dict[tuple[str, str], list[str]] = defaultdict(list)
        for connection in self.system.connections:
            self.report.connections += 1
            place = f"connection {connection}"
            start, end = (self.end(place, *pair) for pair in (connection.start, connection.end))
            if start is None or end is None:
                continue
            if start.source == end.source:
                what = "feeds" if start.source else "is fed"
                self.error(place, f"both {start.label} and {end.label} are ends that {what}",
                           "connect an output to an input, or a connector of the system to one of its own kind")
            else:
                fed[connection.end if start.source else connection.start].append(place)
                if end.source:
                    self.warning(place, "runs from its end to its start, which libcosim and Ecos do not read",
                                 "exchange start and end")
            if start.type and end.type and start.type != end.type:
                self.error(place, f"{start.label} is {start.type} and {end.label} is {end.type}",
                           "connect variables of one type")
            self.units(place, start, end)
        for sink, places in fed.items():
            if len(places) > 1:
                self.error(places[1], f"{'.'.join(filter(None, sink))} is fed twice, first by "
                           f"{places[0].removeprefix('connection ')}", "remove one of the two")
        self.unused()

    def limits_of_hosts(self) -> None:
        """Warn of what libcosim, Ecos and OMSimulator, which compare prefixes letter by letter, do not do."""
        system = self.system
        if system.connections_prefix != "ssd" and system.connections:
            self.warning(f"{system.connections_prefix}:Connections", "libcosim and Ecos pass over all in it, and "
                         "OMSimulator refuses the file", "write ssd:Connections")
        elif not all(c.start[0] and c.end[0] for c in system.connections):
            self.warning("ssd:Connections", "has connections of the system's own connectors, with which libcosim and "
                         "Ecos refuse the file", "run it with examples/ssp_hosts for these, or wire components only")
        if system.annotations[:1] != [OMSIMULATOR]:
            self.warning(f"system {system.name}", "does not begin its Annotations with the one that OMSimulator needs "
                         "to open the file", f"add an {OMSIMULATOR} annotation, as emcas ssp writes it")
        for name in system.connectors:
            if "." in name:
                self.warning(f"connector {name}", "of the system has a dot, with which OMSimulator does not run",
                             f"name it {name.replace('.', '_')}")
        for element in system.elements.values():
            if element.annotations:
                self.warning(f"component {element.name}", "has Annotations, with which OMSimulator refuses it",
                             "put them at its system")
            for c in element.connectors.values():
                if c.type == "Enumeration" and c.prefix == "ssd":
                    self.warning(f"connector {element.name}.{c.name}", "is of an enumeration, over which libcosim ends "
                                 "the process", "run the archive with examples/ssp_hosts for it, or give the element "
                                 "another prefix for the same namespace")

    def end(self, place: str, name: str, connector: str) -> End | None:
        """Return an end by element (empty: the system itself) and connector; None, reported, if it does not exist."""
        system = self.system
        if name and name not in system.elements:
            self.error(place, f"there is no element {name}",
                       nearest(name, system.elements, f"there is {', '.join(system.elements) or 'none'}"))
            return None
        element = system.elements[name] if name else system
        label, interface = ".".join(filter(None, (name, connector))), element.interface
        names = interface.variables if interface else element.connectors
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
            variable = interface.variables[connector]
            if declared is not None:
                self.declaration(f"connector {label}", declared, interface)
            return End(label, variable.causality in _SOURCES, variable.type, variable.unit)
        assert declared is not None
        # Seen from within, values come from a system's input.
        source = (declared.kind in _SOURCES) is bool(name)
        return End(label, source, declared.type, declared.unit)

    def declaration(self, place: str, declared: Connector, interface: Interface) -> None:
        """Check a component's connector against the variable of its FMU."""
        variable = interface.variables[declared.name]
        if declared.kind not in (variable.causality, "inout"):
            self.error(place, f"is declared {declared.kind}, but is {variable.causality} of the FMU",
                       f'write kind="{variable.causality}"')
        if declared.type and declared.type != variable.type:
            self.error(place, f"is declared {declared.type}, but is {variable.type} in the FMU",
                       f"write ssc:{variable.type}")
        if not declared.type:
            self.warning(place, "has no type", f"write ssc:{variable.type}; libcosim refuses the file without")
        convert = conversion(declared.unit, variable.unit)
        if not (convert and convert.identity):
            self.error(place, f"is declared in {declared.unit}, but the FMU's variable is in {variable.unit}",
                       f'write unit="{variable.unit.name}": no host converts here')

    def units(self, place: str, start: End, end: End) -> None:
        """Check for the same unit at both ends: no host converts by itself."""
        convert = conversion(start.unit, end.unit)
        if not end.unit.name or (convert and convert.identity):
            return
        if start.unit.exponents is None or end.unit.exponents is None:
            self.error(place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, of which at least "
                       "one is not defined, and hosts pass values on as they are",
                       "use one unit, or define both in the Units of the structure")
        elif convert is None:
            self.error(place, f"{start.label} in {start.unit} does not measure what {end.label} in {end.unit} does",
                       "connect quantities of one kind")
        else:
            self.error(place, f"{start.label} is in {start.unit} and {end.label} in {end.unit}, which hosts pass on as "
                       f"they are", f"use one unit: multiply by {convert.factor:.12g} and add {convert.offset:.12g} "
                       "where the value is computed")

    def unused(self) -> None:
        """Warn of inputs without a connection, and of connectors of the system that lead nowhere.

        A host feeds the inputs of a system of components alone.
        """
        system = self.system
        if not system.connections and not system.connectors:
            return
        used = {end for connection in system.connections for end in (connection.start, connection.end)}
        for element in system.elements.values():
            for v in element.interface.variables.values() if element.interface else ():
                if v.causality != "input" or (element.name, v.name) in used:
                    continue
                declared = v.name in element.connectors
                stays = "" if v.start is None else f": it stays at {v.start} {v.unit.name}"
                self.warning(f"input {element.name}.{v.name}", f"is not wired{stays}"
                             + (", and fmpy feeds a declared one from some other signal" if declared else ""),
                             "wire it" + (", or drop the connector" if declared else ""))
        for name, connector in system.connectors.items():
            if ("", name) not in used and connector.kind in ("input", "output"):
                self.warning(f"connector {name}", "of the system leads nowhere",
                             "wire it, or drop it: fmpy fails over outputs like it")
