"""SSP 1.0: names, documents made from templates and validated by the schemas shipped with fmpy, and archives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from ..errors import EmcasError
from ..pages.page import page
from ..support.archives import reading
from ..support.writing import write_zip

_BASE = "http://ssp-standard.org/SSP1/SystemStructure"
SSD, SSC, SSV = f"{_BASE}Description", f"{_BASE}Common", f"{_BASE}ParameterValues"
NAMESPACES = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
              "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
              "emcas": "urn:emcas-fmu:ssp"}
ANNOTATION = "emcas-fmu"  # the type of the annotation, in the namespace emcas, that records an FMU's GUID
DEFAULT = "SystemStructure.ssd"  # the structure that a host opens by default
NOMINAL = "nominal"  # the name of the default structure
FMU = "application/x-fmu-sharedlibrary"  # the type of a component


class SspError(EmcasError):
    """An SSP that cannot be read or written; the message names file and remedy."""


def parse(content: bytes, name: str) -> Any:
    """Return the root element of an XML document. Raises SspError with the document's `name` and the line."""
    # The parser reads nothing outside the document, whatever it refers to.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True,
                             remove_pis=True)
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise SspError(f"{name}: is not XML: {error}") from error
    if root.getroottree().docinfo.doctype:
        raise SspError(f"{name}: has a DOCTYPE, which SSP does not use; remove it, and write entities as text")
    return root


def render(template: str, **context: Any) -> bytes:
    """Return an indented document from a template in this folder; the same context gives the same bytes."""
    root = parse(page(f"ssp/{template}", namespaces=NAMESPACES, **context).encode(), template)
    etree.indent(root)
    document: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    return document + b"\n"


@cache
def _schema(namespace: str) -> Any:
    file = f"{namespace.rpartition('/')[2]}.xsd"
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / file))


def violations(root: Any, namespace: str) -> list[str]:
    """Return a document's violations of the schema of a namespace, SSD or SSV; the list is empty if it is valid."""
    schema = _schema(namespace)
    return [] if schema.validate(root) else [f"line {entry.line}: {entry.message}" for entry in schema.error_log]


def read_archive(path: Path) -> dict[str, bytes]:
    """Return the files of an SSP by name. Raises SspError if it is no archive, or fails a check of `reading`."""
    with reading(path, str(path), "an SSP", SspError) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def write_archive(contents: Mapping[str, bytes], target: Path) -> None:
    """Write files to an SSP; the same contents give the same bytes. Raises EmcasError if it cannot be written."""
    write_zip(contents, target, lambda name: (name != DEFAULT, "/" in name, name))


def structure_files(names: Iterable[str]) -> list[str]:
    """Return the names of the system structures at the root of an SSP, the default one first, then the variants."""
    return sorted((n for n in names if "/" not in n and n.endswith(".ssd")), key=lambda name: (name != DEFAULT, name))
