"""System structures of an archive, with the parameter sets bound in them.

Read are systems of FMUs with their parameter sets in files, as this package writes them. Anything else that SSP allows,
such as a system within a system, is refused as a problem of the structure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from posixpath import normpath
from typing import Any
from urllib.parse import unquote

from .archive import Archive
from .findings import Finding
from .interface import Interface, Value, typed
from .schema import ANNOTATION, FMU, NAMESPACES, SSD, SSV, SspError, parse, violations
from .units import Unit

_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")
_TRANSFORMATIONS = ("LinearTransformation", "BooleanMappingTransformation", "IntegerMappingTransformation",
                    "EnumerationMappingTransformation")
_CORRECT = "correct the file, or write the archive anew"


@dataclass(frozen=True)
class Connector:
    """A declared connector and its XML prefix. The type is empty, the unit nameless, where left to the FMU."""

    name: str
    kind: str
    type: str
    unit: Unit
    prefix: str


@dataclass(frozen=True)
class Connection:
    """Two ends, each element (empty: the system itself) and connector."""

    start: tuple[str, str]
    end: tuple[str, str]

    def __str__(self) -> str:
        return " -> ".join(".".join(filter(None, end)) for end in (self.start, self.end))


@dataclass(frozen=True)
class Setting:
    """A parameter of a set: name, type, value as in the file, and unit."""

    name: str
    type: str
    value: str
    unit: Unit

    @property
    def typed(self) -> Value:
        """The value as Python's. Raises ValueError if it is not of its type."""
        return typed(self.type, self.value)


@dataclass(frozen=True)
class Binding:
    """A bound parameter set: its file, name and settings."""

    file: str
    name: str
    settings: list[Setting]


@dataclass
class Element:
    """The system, or a component of it.

    `guid` is the GUID, as the system records it, of the FMU that the archive was written for. `annotations` are types.
    A check sets `interface`, that of a component's FMU.
    """

    name: str
    source: str
    connectors: dict[str, Connector] = field(default_factory=dict)
    bindings: list[Binding] = field(default_factory=list)
    annotations: list[str] = field(default_factory=list)
    guid: str = ""
    elements: dict[str, Element] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    connections_prefix: str = ""
    interface: Interface | None = None


@dataclass
class Structure:
    """A system structure: file in the archive, name, system, and what is wrong with the documents read."""

    file: str
    name: str
    system: Element
    problems: list[Finding]


def read_structure(archive: Archive, file: str) -> Structure:
    """Read a structure and its parameter sets. Raises SspError if the file is not XML or has no system."""
    return _Reader(archive, file).structure()


def read_variant(ssp: Path, name: str) -> Structure:
    """Return the structure of a variant. Raises SspError if the archive has none, or anything wrong in any of them."""
    archive = Archive(ssp)
    structures = {s.name: s for s in (read_structure(archive, file) for file in archive.structures)}
    for problem in (problem for structure in structures.values() for problem in structure.problems):
        raise SspError(f"{ssp}: {problem}; see emcas ssp check")
    if name not in structures:
        raise SspError(f"{ssp}: has no variant {name!r}; it has {', '.join(structures) or 'none'}")
    return structures[name]


def _path(source: str) -> str:
    """Return the path in the archive that a source names; a source that names none is returned as it is."""
    path = unquote(source)
    return normpath(path) if path and "://" not in path else path



class _Reader:
    """Reads one structure; collects what is wrong with it and goes on."""

    def __init__(self, archive: Archive, file: str) -> None:
        self.archive, self.file = archive, file
        self.problems: list[Finding] = []

    def problem(self, message: str, remedy: str = _CORRECT, file: str = "", place: str = "") -> None:
        self.problems.append(Finding("error", file or self.file, place, message, remedy))

    def structure(self) -> Structure:
        root = parse(self.archive.read(self.file), self.file)
        units = self.checked(root, SSD, self.file)
        top = root.find("ssd:System", NAMESPACES)
        if top is None:
            raise SspError(f"{self.file}: has no System")
        system = self.element(top, units)
        recorded = {fmu.get("source"): fmu.get("guid", "") for fmu in top.iterfind(
            f"ssd:Annotations/ssc:Annotation[@type='{ANNOTATION}']/emcas:Fmu", NAMESPACES)}
        for node in top.iterfind("ssd:Elements/*", NAMESPACES):
            element = self.element(node, units)
            element.guid = recorded.get(element.source, "")
            if (kind := node.get("type", FMU) if _tag(node) == "Component" else _tag(node)) != FMU:
                self.problem(f"is of the type {kind}, and emcas reads FMUs in one system only",
                             "put FMUs into the outermost system, as libcosim and Ecos need it, too",
                             place=f"element {element.name}")
            if element.name in system.elements:
                self.problem(f"{system.name}: there are two elements named {element.name}")
            system.elements[element.name] = element
        connections = top.find("ssd:Connections", NAMESPACES)
        if connections is not None:
            system.connections_prefix = connections.prefix or ""
            system.connections = [self.connection(node) for node in connections]
        return Structure(self.file, root.get("name", ""), system, self.problems)

    def element(self, node: Any, units: Mapping[str, Unit]) -> Element:
        element = Element(node.get("name", ""), _path(node.get("source", "")))
        element.annotations = [a.get("type", "") for a in node.iterfind("ssd:Annotations/ssc:Annotation", NAMESPACES)]
        for child in node.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES):
            kind, unit, _ = _typed(child, units)
            connector = Connector(child.get("name", ""), child.get("kind", ""), kind, unit, child.prefix or "")
            if connector.name in element.connectors:
                self.problem(f"{element.name}: connector {connector.name} is declared twice")
            element.connectors[connector.name] = connector
        for child in node.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            try:
                element.bindings.append(self.binding(child))
            except SspError as error:
                self.problem(f"parameter binding of {element.name}: {error}")
        return element

    def connection(self, node: Any) -> Connection:
        start, end = ((node.get(f"{side}Element", ""), node.get(f"{side}Connector", "")) for side in ("start", "end"))
        connection = Connection(start, end)
        if any(node.find(f"ssc:{kind}", NAMESPACES) is not None for kind in _TRANSFORMATIONS):
            self.problem("has a transformation, which emcas does not read", "convert where the value is computed",
                         place=f"connection {connection}")
        return connection

    def binding(self, node: Any) -> Binding:
        """Read a parameter set from its file. Raises SspError if it cannot be read or is not in a file as it is."""
        if node.get("prefix") or not node.get("source") or any(
                node.find(f"ssd:{kind}", NAMESPACES) is not None for kind in ("ParameterValues", "ParameterMapping")):
            raise SspError("emcas reads sets from files, without prefix or mapping; bind one such file to each "
                           "component, which every host reads")
        file = normpath(unquote(node.get("source")))
        root = parse(self.archive.read(file), file)
        if root.tag != f"{{{SSV}}}ParameterSet":
            raise SspError(f"{file}: is not a parameter set")
        units, settings = self.checked(root, SSV, file), []
        for parameter in root.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES):
            kind, unit, value = _typed(parameter, units)
            settings.append(Setting(parameter.get("name", ""), kind, value, unit))
        return Binding(file, root.get("name", ""), settings)

    def checked(self, root: Any, namespace: str, file: str) -> dict[str, Unit]:
        """Check a document against its schema. Returns the units that it defines."""
        for violation in violations(root, namespace):
            self.problem(violation, file=file)
        units = {}
        for node in root.iterfind(f"{{{namespace}}}Units/ssc:Unit", NAMESPACES):
            name, base = node.get("name", ""), node.find("ssc:BaseUnit", NAMESPACES)
            try:
                units[name] = Unit.defined(name, {} if base is None else base.attrib)
            except ValueError as error:
                self.problem(f"unit {name}: {error}", file=file)
        return units


def _tag(node: Any) -> str:
    return str(node.tag).rpartition("}")[2]


def _typed(node: Any, units: Mapping[str, Unit]) -> tuple[str, Unit, str]:
    """Return type, unit and value of a connector or parameter from the element for its type; empty without one."""
    for child in node:
        if _tag(child) in _TYPES:
            unit = child.get("unit", "")
            return _tag(child), units.get(unit, Unit(unit)), child.get("value", "")
    return "", Unit(""), ""
