"""Names of SSP 1.0, and validation against the schemas that come with fmpy."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from ..errors import EmcasError

_BASE = "http://ssp-standard.org/SSP1/SystemStructure"
SSD, SSC, SSV = f"{_BASE}Description", f"{_BASE}Common", f"{_BASE}ParameterValues"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
EMCAS = "urn:emcas-fmu:ssp"  # of the annotation that records an FMU's GUID
ANNOTATION = "emcas-fmu"  # its type
DEFAULT = "SystemStructure.ssd"  # the structure a host opens if not told otherwise
NOMINAL = "nominal"
_FILES = {SSD: "SystemStructureDescription.xsd", SSV: "SystemStructureParameterValues.xsd"}


class SspError(EmcasError):
    """An SSP that cannot be read or written; the message names file and remedy."""


def parse(content: bytes, name: str) -> Any:
    """The root element of an XML document. Raises SspError naming the file and the place."""
    # Nothing outside the archive is read, whatever the document asks for.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True,
                             remove_pis=True)
    try:
        return etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise SspError(f"{name}: is not XML: {error}") from error


@cache
def _schema(namespace: str) -> Any:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / _FILES[namespace]))


def violations(root: Any, namespace: str) -> list[str]:
    """What the schema of a namespace (SSD or SSV) has against a document; empty if it is valid."""
    schema = _schema(namespace)
    if schema.validate(root):
        return []
    return [f"line {entry.line}: {entry.message}" for entry in schema.error_log]
