"""System structures as read from an archive, with the parameter sets they bind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from posixpath import normpath
from typing import Any
from urllib.parse import unquote

from .archive import Archive
from .interface import Interface, Value, typed
from .schema import ANNOTATION, FMU, NAMESPACES, SSD, SSV, SspError, parse, violations
from .units import Unit

OnProblem = Callable[[str, str], None]  # (file, what is wrong with it)
_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")


@dataclass(frozen=True)
class Connector:
    """An end for connections, as declared, under an XML prefix. Type and unit are empty where left to the FMU."""

    name: str
    kind: str
    type: str
    unit: str
    prefix: str


@dataclass(frozen=True)
class Connection:
    """Two ends, each element (empty: the system itself) and connector; a factor and offset if there is one."""

    start: tuple[str, str]
    end: tuple[str, str]
    transformation: tuple[float, float] | None
    suppressed: bool  # no unit conversion by the host

    def __str__(self) -> str:
        return " -> ".join(".".join(filter(None, end)) for end in (self.start, self.end))


@dataclass(frozen=True)
class Setting:
    """A parameter of a set: name without prefix, type, value and unit as in the file."""

    name: str
    type: str
    value: str
    unit: str

    @property
    def typed(self) -> Value:
        """The value as Python's. Raises ValueError if it is not of its type."""
        return typed(self.type, self.value)


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
    """A component, a system or a signal dictionary's reference (type ``dictionary``).

    `guid` is that of the FMU the archive was written for, as its system records it, `annotations` are their types;
    `interface` is that of a component's FMU, once a check has read it.
    """

    name: str
    type: str
    source: str = ""
    guid: str = ""
    connectors: dict[str, Connector] = field(default_factory=dict)
    bindings: list[Binding] = field(default_factory=list)
    elements: dict[str, Element] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    connections_prefix: str = ""
    annotations: list[str] = field(default_factory=list)
    interface: Interface | None = None


@dataclass
class Structure:
    """A system structure: its file in the archive, its name, its top-level system and its units.

    The units of the components' FMUs are among them, once a check has read these.
    """

    file: str
    name: str
    system: Element
    units: dict[str, Unit]


def systems(system: Element, path: str = "") -> Iterator[tuple[str, Element]]:
    """Yield a system and those in it, each with its path and a dot (nothing for the outermost)."""
    yield path, system
    for element in system.elements.values():
        if element.type == "system":
            yield from systems(element, f"{path}{element.name}.")


def elements(system: Element, path: str = "") -> Iterator[tuple[str, Element]]:
    """Yield all elements of a system, and of those in it, each with its path."""
    for element in system.elements.values():
        yield f"{path}{element.name}", element
        yield from elements(element, f"{path}{element.name}.")


def read_structure(archive: Archive, file: str, on_problem: OnProblem) -> Structure:
    """Read a structure; `on_problem` gets what is wrong with it or with its parameter sets, the rest is read.

    Raises SspError if nothing can be made of it.
    """
    root = parse(archive.read(file), file)
    for problem in violations(root, SSD):
        on_problem(file, problem)
    top = root.find("ssd:System", NAMESPACES)
    if top is None:
        raise SspError(f"{file}: has no System")
    system = _element(top, archive, file, on_problem)
    return Structure(file, root.get("name", ""), system, _units(root, "ssd", file, on_problem))


def read_variant(ssp: Path, name: str) -> Structure:
    """Return the structure of a variant. Raises SspError if there is none, or anything wrong with any of them."""
    def refuse(file: str, problem: str) -> None:
        raise SspError(f"{ssp}: {file}: {problem}; see emcas ssp check")

    archive = Archive(ssp)
    structures = {s.name: s for s in (read_structure(archive, file, refuse) for file in archive.structures)}
    if name not in structures:
        raise SspError(f"{ssp}: has no variant {name!r}; it has {', '.join(structures) or 'none'}")
    return structures[name]


def _units(root: Any, kind: str, file: str, on_problem: OnProblem) -> dict[str, Unit]:
    units = {}
    for element in root.iterfind(f"{kind}:Units/ssc:Unit", NAMESPACES):
        name, base = element.get("name", ""), element.find("ssc:BaseUnit", NAMESPACES)
        try:
            units[name] = Unit.of(base.attrib if base is not None else {})
        except ValueError as error:
            on_problem(file, f"unit {name}: {error}")
    return units


def _connector(node: Any) -> Connector:
    nodes = {name: node.find(f"ssc:{name}", NAMESPACES) for name in _TYPES}
    kind = next((name for name in _TYPES if nodes[name] is not None), "")
    unit = nodes[kind].get("unit", "") if kind else ""
    return Connector(node.get("name", ""), node.get("kind", ""), kind, unit, node.prefix or "")


def _element(node: Any, archive: Archive, file: str, on_problem: OnProblem) -> Element:
    kind = {"System": "system", "SignalDictionaryReference": "dictionary"}.get(
        node.tag.rpartition("}")[2], node.get("type", FMU))
    element = Element(node.get("name", ""), kind, node.get("source", ""))
    for child in node.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES):
        connector = _connector(child)
        if connector.name in element.connectors:
            on_problem(file, f"{element.name}: connector {connector.name} is declared twice")
        element.connectors[connector.name] = connector
    for child in node.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
        try:
            element.bindings.append(_binding(child, archive, file, on_problem))
        except SspError as error:
            on_problem(file, f"parameter binding of {element.name}: {error}")
    element.annotations = [a.get("type", "") for a in node.iterfind("ssd:Annotations/ssc:Annotation", NAMESPACES)]
    recorded = {fmu.get("source"): fmu.get("guid", "") for fmu in node.iterfind(
        f"ssd:Annotations/ssc:Annotation[@type='{ANNOTATION}']/emcas:Fmu", NAMESPACES)}
    for child in node.iterfind("ssd:Elements/*", NAMESPACES):
        inner = _element(child, archive, file, on_problem)
        inner.guid = recorded.get(inner.source, "")
        if inner.name in element.elements:
            on_problem(file, f"{element.name}: there are two elements named {inner.name}")
        element.elements[inner.name] = inner
    connections = node.find("ssd:Connections", NAMESPACES)
    if connections is not None:
        element.connections_prefix = connections.prefix or ""
        element.connections = [_connection(child, file, on_problem) for child in connections]
    return element


def _connection(node: Any, file: str, on_problem: OnProblem) -> Connection:
    ends = [(node.get(f"{side}Element", ""), node.get(f"{side}Connector", "")) for side in ("start", "end")]
    linear = node.find("ssc:LinearTransformation", NAMESPACES)
    transformation = None
    try:
        if linear is not None:
            transformation = float(linear.get("factor", 1.0)), float(linear.get("offset", 0.0))
    except ValueError as error:
        on_problem(file, f"connection {ends}: {error}")
    return Connection(ends[0], ends[1], transformation, node.get("suppressUnitConversion") in ("true", "1"))


def _binding(node: Any, archive: Archive, file: str, on_problem: OnProblem) -> Binding:
    source = node.get("source")
    mapped = node.find("ssd:ParameterMapping", NAMESPACES) is not None
    if source is not None:
        name = normpath(unquote(source))
        root = parse(archive.read(name), name)
        if root.tag != f"{{{SSV}}}ParameterSet":
            raise SspError(f"{name}: is not a parameter set")
        return _set(root, name, on_problem, node.get("prefix", ""), mapped)
    inline = node.find("ssd:ParameterValues/ssv:ParameterSet", NAMESPACES)
    if inline is None:
        raise SspError("has neither a source nor values")
    return _set(inline, file, on_problem, node.get("prefix", ""), mapped)


def _set(root: Any, file: str, on_problem: OnProblem, prefix: str, mapped: bool) -> Binding:
    for problem in violations(root, SSV):
        on_problem(file, problem)
    settings = tuple(Setting(parameter.get("name", ""), kind, value.get("value", ""), value.get("unit", ""))
                     for parameter in root.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES)
                     for value in parameter if (kind := value.tag.rpartition("}")[2]) in _TYPES)
    return Binding(file, root.get("name", ""), prefix, settings, _units(root, "ssv", file, on_problem), mapped)
