"""Names of SSP 1.0, documents from templates, and validation against the schemas shipped with fmpy."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from ..errors import EmcasError
from ..pages.page import page

_BASE = "http://ssp-standard.org/SSP1/SystemStructure"
SSD, SSC, SSV = f"{_BASE}Description", f"{_BASE}Common", f"{_BASE}ParameterValues"
NAMESPACES = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
              "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
              "emcas": "urn:emcas-fmu:ssp"}  # the last is of the annotation that records an FMU's GUID
ANNOTATION = "emcas-fmu"  # its type
DEFAULT = "SystemStructure.ssd"  # the structure a host opens by default
NOMINAL = "nominal"
FMU = "application/x-fmu-sharedlibrary"  # the type of a component
_FILES = {SSD: "SystemStructureDescription.xsd", SSV: "SystemStructureParameterValues.xsd"}


class SspError(EmcasError):
    """An SSP that cannot be read or written; the message names file and remedy."""


def parse(content: bytes, name: str) -> Any:
    """Return the root element of an XML document. Raises SspError naming the file and the line."""
    # Nothing outside the archive is read, whatever the document refers to.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True,
                             remove_pis=True)
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise SspError(f"{name}: is not XML: {error}") from error
    if (entity := next(root.iter(etree.Entity), None)) is not None:
        raise SspError(f"{name}: has the entity reference {entity.text}, which SSP does not use; write its text "
                       "instead")
    return root


def render(template: str, **context: Any) -> bytes:
    """Return the document of a template in this folder, indented; the same context gives the same bytes."""
    root = parse(page(f"ssp/{template}", namespaces=NAMESPACES, **context).encode(), template)
    etree.indent(root)
    document: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    return document + b"\n"


@cache
def _schema(namespace: str) -> Any:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / _FILES[namespace]))


def violations(root: Any, namespace: str) -> list[str]:
    """Return violations of the schema of a namespace (SSD or SSV); empty if the document is valid."""
    schema = _schema(namespace)
    if schema.validate(root):
        return []
    return [f"line {entry.line}: {entry.message}" for entry in schema.error_log]
