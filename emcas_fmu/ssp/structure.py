"""System structures as read from an archive, with the parameter sets they bind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from posixpath import normpath
from typing import Any
from urllib.parse import unquote

from .archive import Archive
from .schema import ANNOTATION, EMCAS, SSC, SSD, SSV, SspError, parse, violations
from .units import Unit

Report = Callable[[str, str], None]  # (file, what is wrong with it)
_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")


@dataclass(frozen=True)
class Connector:
    """An end for connections, as declared, under an XML prefix. Type and unit are empty where left to the FMU."""

    name: str
    kind: str
    type: str
    unit: str
    prefix: str = ""


@dataclass(frozen=True)
class Connection:
    """Two ends, each element (empty: the system itself) and connector; a factor or offset if there is one."""

    start: tuple[str, str]
    end: tuple[str, str]
    transformation: tuple[float, float] | None
    suppressed: bool  # no unit conversion wanted

    def __str__(self) -> str:
        return " -> ".join(".".join(filter(None, end)) for end in (self.start, self.end))


@dataclass(frozen=True)
class Setting:
    """A parameter of a set: name without prefix, type, value and unit as written."""

    name: str
    type: str
    value: str
    unit: str

    @property
    def typed(self) -> float | int | bool | str:
        """The value as Python's. Raises ValueError if it is not of its type."""
        if self.type == "Boolean":
            if self.value not in ("true", "false", "1", "0"):
                raise ValueError(f"{self.value!r} is neither true nor false")
            return self.value in ("true", "1")
        if self.type == "Integer":
            return int(self.value)
        return float(self.value) if self.type == "Real" else self.value


@dataclass(frozen=True)
class Binding:
    """A parameter set at an element: file (or the structure's own for an inline one), name, prefix, settings, units."""

    file: str
    name: str
    prefix: str
    settings: tuple[Setting, ...]
    units: dict[str, Unit]
    mapped: bool


@dataclass
class Element:
    """A component, a system or a signal dictionary's reference (type ``dictionary``)."""

    name: str
    type: str
    source: str = ""
    guid: str = ""
    connectors: dict[str, Connector] = field(default_factory=dict)
    bindings: list[Binding] = field(default_factory=list)
    elements: dict[str, Element] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    connections_prefix: str = ""


@dataclass
class Structure:
    """A system structure: its file in the archive, its name, its top-level system and its units."""

    file: str
    name: str
    system: Element
    units: dict[str, Unit]


def systems(system: Element, path: str = "") -> Iterator[tuple[str, Element]]:
    """A system and those in it, each with its path and a dot (nothing for the outermost)."""
    yield path, system
    for element in system.elements.values():
        if element.type == "system":
            yield from systems(element, f"{path}{element.name}.")


def read_structure(archive: Archive, file: str, report: Report) -> Structure:
    """Read a structure; what is wrong with it or with its parameter sets goes to `report`, the rest is read.

    Raises SspError if nothing can be made of it.
    """
    root = parse(archive.read(file), file)
    for problem in violations(root, SSD):
        report(file, problem)
    top = root.find(f"{{{SSD}}}System")
    if top is None:
        raise SspError(f"{file}: has no System")
    system = _element(top, archive, file, report)
    return Structure(file, root.get("name", ""), system, _units(root.find(f"{{{SSD}}}Units"), file, report))


def _units(parent: Any, file: str, report: Report) -> dict[str, Unit]:
    units = {}
    for element in parent if parent is not None else ():
        name, base = element.get("name", ""), element.find(f"{{{SSC}}}BaseUnit")
        try:
            units[name] = Unit.of(name, base.attrib if base is not None else {})
        except ValueError as error:
            report(file, f"unit {name}: {error}")
    return units


def _typed(element: Any) -> tuple[str, str]:
    for name in _TYPES:
        found = element.find(f"{{{SSC}}}{name}")
        if found is not None:
            return name, found.get("unit", "")
    return "", ""


def _element(node: Any, archive: Archive, file: str, report: Report) -> Element:
    kind = {"System": "system", "SignalDictionaryReference": "dictionary"}.get(
        node.tag.rpartition("}")[2], node.get("type", "application/x-fmu-sharedlibrary"))
    element = Element(node.get("name", ""), kind, node.get("source", ""))
    for found in node.iterfind(f"{{{SSD}}}Connectors/{{{SSD}}}Connector"):
        connector = Connector(found.get("name", ""), found.get("kind", ""), *_typed(found), found.prefix or "")
        if connector.name in element.connectors:
            report(file, f"{element.name}: connector {connector.name} is declared twice")
        element.connectors[connector.name] = connector
    for found in node.iterfind(f"{{{SSD}}}ParameterBindings/{{{SSD}}}ParameterBinding"):
        try:
            element.bindings.append(_binding(found, archive, file, report))
        except SspError as error:
            report(file, f"parameter binding of {element.name}: {error}")
    recorded = node.find(f"{{{SSD}}}Annotations/{{{SSC}}}Annotation[@type='{ANNOTATION}']/{{{EMCAS}}}Fmu")
    element.guid = "" if recorded is None else recorded.get("guid", "")
    for child in node.iterfind(f"{{{SSD}}}Elements/*"):
        inner = _element(child, archive, file, report)
        if inner.name in element.elements:
            report(file, f"{element.name}: there are two elements named {inner.name}")
        element.elements[inner.name] = inner
    connections = node.find(f"{{{SSD}}}Connections")
    if connections is not None:
        element.connections_prefix = connections.prefix or ""
        element.connections = [_connection(found, file, report) for found in connections]
    return element


def _connection(node: Any, file: str, report: Report) -> Connection:
    ends = [(node.get(f"{side}Element", ""), node.get(f"{side}Connector", "")) for side in ("start", "end")]
    linear = node.find(f"{{{SSC}}}LinearTransformation")
    transformation = None
    try:
        if linear is not None:
            transformation = float(linear.get("factor", 1.0)), float(linear.get("offset", 0.0))
    except ValueError as error:
        report(file, f"connection {ends}: {error}")
    return Connection(ends[0], ends[1], transformation, node.get("suppressUnitConversion") in ("true", "1"))


def _binding(node: Any, archive: Archive, file: str, report: Report) -> Binding:
    source = node.get("source")
    mapped = node.find(f"{{{SSD}}}ParameterMapping") is not None
    if source is not None:
        return read_set(archive, normpath(unquote(source)), report, node.get("prefix", ""), mapped)
    found = node.find(f"{{{SSD}}}ParameterValues/{{{SSV}}}ParameterSet")
    if found is None:
        raise SspError("has neither a source nor values")
    return _set(found, file, report, node.get("prefix", ""), mapped)


def read_set(archive: Archive, file: str, report: Report, prefix: str = "", mapped: bool = False) -> Binding:
    """A parameter set of its own file. Raises SspError if nothing can be made of it."""
    root = parse(archive.read(file), file)
    if root.tag != f"{{{SSV}}}ParameterSet":
        raise SspError(f"{file}: is not a parameter set")
    return _set(root, file, report, prefix, mapped)


def _set(root: Any, file: str, report: Report, prefix: str, mapped: bool) -> Binding:
    for problem in violations(root, SSV):
        report(file, problem)
    settings = []
    for parameter in root.iterfind(f"{{{SSV}}}Parameters/{{{SSV}}}Parameter"):
        for value in parameter:
            kind = value.tag.rpartition("}")[2]
            if kind in _TYPES:
                settings.append(Setting(parameter.get("name", ""), kind, value.get("value", ""),
                                        value.get("unit", "")))
    units = _units(root.find(f"{{{SSV}}}Units"), file, report)
    return Binding(file, root.get("name", ""), prefix, tuple(settings), units, mapped)
