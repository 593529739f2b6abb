"""System structures of an archive, with their parameter sets.

Only the form that this package writes is read: FMUs in one system, with their parameter sets in files. For a structure
that is not valid, or has another form that SSP allows, findings give the reason.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from io import BytesIO
from math import inf
from pathlib import Path
from posixpath import normpath
from typing import Any, Literal
from urllib.parse import unquote

from fmpy import read_model_description

from ..errors import hint
from ..support.archives import reading
from ..units import UnitError, convert
from . import archive
from .archive import ANNOTATION, FMU, NAMESPACES, SSC, SSD, SSV, SspError

SspValue = float | int | bool | str
End = tuple[str, str]  # component (empty: the system itself), and connector, variable or parameter

_COMPONENT, _BINDING = f"{{{SSD}}}Component", f"{{{SSD}}}ParameterBinding"
_CORRECT = "correct the file, or write a new archive"
# Level, XPath of the nodes, problem and remedy.
_RULES: tuple[tuple[Literal["error", "warning"], str, str, str], ...] = (
    ("error", f"//ssd:Elements/*[not(self::ssd:Component) or @type != '{FMU}']"
     " | //ssd:ParameterBinding[string(@prefix) or not(@source) or ssd:ParameterValues or ssd:ParameterMapping]"
     " | //ssd:Connection[ssc:*[contains(local-name(), 'Transformation')]]", "is of a form that emcas does not read",
     "have only FMUs in one system, connected without transformation or signal dictionary, each with its parameter "
     "set in a file, without prefix or mapping"),
    ("warning", "//ssd:Connections[ssd:Connection[not(@startElement and @endElement)]]",
     "has connections of the system's own connectors, with which libcosim and Ecos refuse the file",
     "run it in libcosim or Ecos by examples/ssp_hosts, or wire components only"),
    ("warning", "//ssd:Component//ssd:Connector[name() = 'ssd:Connector' and ssc:Enumeration]",
     "is an enumeration, at which libcosim ends the process",
     "run it in libcosim by examples/ssp_hosts, or write another prefix for the same namespace"),
    ("warning", "//ssv:Parameter[ssv:Boolean[@value = 'false' or @value = '0']]",
     "is false, which fmpy's read_ssv and simulate_ssp read as true",
     "make it the FMU's start value instead: emcas build --parameters FILE"))


@dataclass(frozen=True)
class Problem:
    """A problem of an archive: file, location (`place`, such as a connection or parameter), message and remedy.

    An error makes hosts fail or compute other results. A warning names a use that SSP allows and may be intended.
    """

    level: Literal["error", "warning"]
    file: str
    place: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"{': '.join(filter(None, (self.file, self.place, self.message)))}; {self.remedy}"


@dataclass(frozen=True)
class Signal:
    """A variable of an FMU, a connector, or a parameter of a set.

    `kind` is the causality or the kind of connector, empty for a parameter of a set. A connector with an empty type or
    unit has that of the FMU's variable. `value` is the start value of a variable, or the value of a parameter.
    """

    name: str
    kind: str
    type: str
    unit: str
    value: SspValue | None = None
    minimum: float = -inf
    maximum: float = inf
    settable: bool = True

    def mismatch(self, other: Signal, label: str) -> tuple[str, str] | None:
        """Return the difference in type or unit from another signal, called `label`, and the remedy; None if equal."""
        if self.type and other.type and self.type != other.type:
            return f"is {self.type}, but {label} is {other.type}", f"make it {other.type}"
        if self.unit == other.unit or not self.unit or not other.unit:
            return None
        message = f"is in {self.unit}, but {label} is in {other.unit}"
        try:
            zero, one = (convert(Decimal(number), self.unit, other.unit) for number in (0, 1))
        except UnitError:
            return message, f"use a quantity in {other.unit}"
        if (zero, one) == (0.0, 1.0):
            return None
        if not self.kind:
            return message, f"write {(one - zero) * float(self.value or 0) + zero:.12g} {other.unit}: no host converts"
        return message, f"multiply by {one - zero:.12g} and add {zero:.12g} where it is computed: no host converts"


@dataclass(frozen=True)
class Interface:
    """The interface of an FMU: model name, GUID and variables by name."""

    model: str
    guid: str
    variables: Mapping[str, Signal]


@dataclass(frozen=True)
class SystemStructure:
    """A system structure: its file in the archive, name, components with their FMUs, connections and parameters.

    `sources` are the paths of the FMUs by component, `guids` the recorded GUIDs by path, `sets` pairs of component and
    name of a parameter set. `parameters` are listed with their files; a later parameter overrides an earlier one.
    """

    file: str
    name: str
    sources: Mapping[str, str]
    fmus: Mapping[str, Interface]
    guids: Mapping[str, str]
    connectors: Mapping[End, Signal]
    connections: list[tuple[End, End]]
    sets: list[tuple[str, str]]
    parameters: list[tuple[str, End, Signal]]

    @property
    def values(self) -> dict[End, Any]:
        """The values of all parameter sets together."""
        return {end: parameter.value for _, end, parameter in self.parameters}

    @property
    def variables(self) -> dict[End, Signal]:
        """The variables of the components' FMUs, and the connectors of the system."""
        return {(name, v.name): v for name, fmu in self.fmus.items() for v in fmu.variables.values()} | {
            end: connector for end, connector in self.connectors.items() if not end[0]}


def read_variant(ssp: Path, name: str) -> SystemStructure:
    """Return the structure of a variant. Raises SspError if the archive has no such variant, or any error."""
    structures, findings = read_structures(archive.read_archive(ssp))
    for error in (f for f in findings if f.level == "error"):
        raise SspError(f"{ssp}: {error}; see emcas ssp check")
    by_name = {structure.name: structure for structure in structures}
    if name not in by_name:
        raise SspError(f"{ssp}: has no variant {name!r}; it has {', '.join(by_name) or 'none'}")
    return by_name[name]


def nearest(name: str, names: Iterable[str], otherwise: str) -> str:
    """Return the remedy for a name that does not exist: the nearest among `names`, or `otherwise` if none is near."""
    return hint(name, names).removeprefix("; ") or otherwise


def label(*ends: End) -> str:
    """Return the name of an end or a connection in messages: ``fin1.fin_angle -> fin1_fin_angle``."""
    return " -> ".join(".".join(filter(None, end)) for end in ends)


def read_structures(contents: Mapping[str, bytes]) -> tuple[list[SystemStructure], list[Problem]]:
    """Return the structures of an archive that can be read, and findings about all its documents and FMUs."""
    documents: dict[str, Any] = {}  # root elements and interfaces, by file
    findings: list[Problem] = []
    structures = archive.structure_files(contents)
    for file in (*structures, *(name for name in contents if name.endswith((".ssv", ".fmu")))):
        new: list[Problem] = []
        try:
            if file.endswith(".fmu"):
                document = read_interface(contents[file], file)
            else:
                document = archive.parse(contents[file], file)
                new = list(_findings(file, document, contents))
        except SspError as error:
            message, _, remedy = str(error).removeprefix(f"{file}: ").partition("; ")
            new = [Problem("error", file, "", message, remedy or _CORRECT)]
        if all(f.level == "warning" for f in new):
            documents[file] = document
        findings += new
    return [_structure(documents, file) for file in structures if file in documents and documents.keys() >= {
        _path(node) for node in documents[file].iter(_COMPONENT, _BINDING)}], findings


def _findings(file: str, root: Any, contents: Mapping[str, bytes]) -> Iterator[Problem]:
    """Yield the findings about a document: schema, form, names, and the files to which it refers."""
    for violation in archive.violations(root, SSD if file.endswith(".ssd") else SSV):
        yield Problem("error", file, "", violation, _CORRECT)
    for level, path, message, remedy in _RULES:
        for node in root.xpath(path, namespaces=NAMESPACES):
            yield Problem(level, file, _name(node), message, remedy)
    for parent in root.xpath("//ssd:Elements | //ssd:Connectors | //ssv:Parameters", namespaces=NAMESPACES):
        for place, count in Counter(map(_name, parent)).items():
            if count > 1:
                yield Problem("error", file, place, "is declared twice", "rename one of them")
    for node in root.iter(_COMPONENT, _BINDING):
        ending = ".fmu" if node.tag == _COMPONENT else ".ssv"
        files = [name for name in contents if name.endswith(ending)]
        if node.get("source") and _path(node) not in files:
            yield Problem("error", file, _name(node), f"the archive has no {ending} file {_path(node)}",
                          nearest(_path(node), files, "add it, or write a new archive"))


def _structure(documents: Mapping[str, Any], file: str) -> SystemStructure:
    """Return the structure of a valid document."""
    top = documents[file].find("ssd:System", NAMESPACES)
    components = {node.get("name"): node for node in top.iter(_COMPONENT)}
    sources = {name: _path(node) for name, node in components.items()}
    nodes = {**components, "": top}
    guids = top.iterfind(f"ssd:Annotations/ssc:Annotation[@type='{ANNOTATION}']/emcas:Fmu", NAMESPACES)
    # The system is last: its sets override those of its components.
    sets = [(name, _path(node)) for name, element in nodes.items()
            for node in element.iterfind("ssd:ParameterBindings/*", NAMESPACES)]
    return SystemStructure(
        file, documents[file].get("name"), sources, {name: documents[path] for name, path in sources.items()},
        {_path(node): node.get("guid", "") for node in guids},
        {(name, node.get("name")): _signal(node) for name, element in nodes.items()
         for node in element.iterfind("ssd:Connectors/*", NAMESPACES)},
        [_connection(node) for node in top.iterfind("ssd:Connections/*", NAMESPACES)],
        [(name, documents[path].get("name")) for name, path in sets],
        [(path, (name, node.get("name")), _signal(node)) for name, path in sets
         for node in documents[path].iterfind("ssv:Parameters/*", NAMESPACES)])


def _path(node: Any) -> str:
    """Return the path in the archive from the attribute `source` of a node."""
    return normpath(unquote(node.get("source", "")))


def _name(node: Any) -> str:
    """Return the name of a node in messages: tag, component (if any), and the node's name or a connection's ends."""
    names = node.xpath("(ancestor::ssd:Component | .)/@name", namespaces=NAMESPACES)
    name = label(*_connection(node)) if node.get("startConnector") else ".".join(names)
    return f"{re.sub('(?<=[a-z])(?=[A-Z])', ' ', node.tag.rpartition('}')[2]).lower()} {name}".strip()


def _connection(node: Any) -> tuple[End, End]:
    return ((node.get("startElement", ""), node.get("startConnector", "")),
            (node.get("endElement", ""), node.get("endConnector", "")))


def _signal(node: Any) -> Signal:
    """Return a connector or parameter; its child element is named after the type and has the unit and the value."""
    typed = next(node.iterchildren(f"{{{SSC}}}*", f"{{{SSV}}}*"), None)
    if typed is None:
        return Signal(node.get("name"), node.get("kind", ""), "", "")
    kind = typed.tag.rpartition("}")[2]
    return Signal(node.get("name"), node.get("kind", ""), kind, typed.get("unit", ""), _value(kind, typed.get("value")))


def read_interface(source: Path | bytes, name: str) -> Interface:
    """Return the interface of an FMU of FMI 2.0; `source` is its path or its bytes, `name` its name in messages.

    Raises SspError if it is not an FMU of FMI 2.0, EmcasError if it cannot be opened.
    """
    with reading(source, name, "an FMU", SspError):
        pass
    try:
        description = read_model_description(source if isinstance(source, Path) else BytesIO(source), validate=False)
        variables = {v.name: _variable(v) for v in description.modelVariables}
    except Exception as error:  # fmpy raises its own errors, and those of zipfile, lxml and float
        raise SspError(f"{name}: is not an FMU that can be read: {error}") from error
    if description.fmiVersion != "2.0":
        raise SspError(f"{name}: is of FMI {description.fmiVersion}; hosts of SSP 1.0 run FMUs of FMI 2.0: build it "
                       "without --fmi 3")
    return Interface(description.modelName, str(description.guid), variables)


def _variable(v: Any) -> Signal:
    def attribute(name: str) -> str:
        return getattr(v, name) or getattr(v.declaredType, name, None) or ""

    minimum, maximum = (attribute("min"), attribute("max")) if v.type in ("Real", "Integer") else ("", "")
    settable = v.causality in ("input", "parameter") or (
        v.initial in ("exact", "approx") and v.variability != "constant")
    return Signal(v.name, v.causality or "local", v.type, attribute("unit"), _value(v.type, v.start),
                  float(minimum or -inf), float(maximum or inf), settable)


def _value(kind: str, text: str | None) -> SspValue | None:
    """Return a value of a type of FMI 2.0 from its text. Raises ValueError if the text is not such a value."""
    if kind == "Boolean" and text is not None:
        return text.strip().lower() in ("true", "1")
    numeric = {"Real": float, "Integer": int}.get(kind)
    return text if text is None or numeric is None else numeric(text)
