"""Whether an SSP says what its author means: schema, wiring, units, parameters and the FMU they were written for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from posixpath import normpath
from typing import TypeVar
from urllib.parse import unquote

from .archive import Archive, file_content
from .findings import Report
from .interface import Interface, read_interface
from .schema import DEFAULT, FMU, SspError
from .settings import check_settings
from .structure import Element, OnProblem, elements, read_structure
from .wiring import check_wiring

T = TypeVar("T")
_CORRECT = "correct the file, or write the archive anew"


def check(path: Path, guid: str | None = None, fmu: Path | None = None, model: str | None = None) -> Report:
    """Check every structure of an archive against the FMUs in it.

    With `guid`, or the `fmu` to take it from, the actuators in it must have that one. `model` names the actuator of
    FMUs that do not tell their own. Whatever is wrong with the archive is in the report; raises EmcasError only if a
    file cannot be opened at all, SspError if `fmu` is no FMU.
    """
    if fmu is not None:
        guid = read_interface(file_content(fmu), str(fmu)).guid
    report = Report(path)
    try:
        archive = Archive(path)
    except SspError as error:
        report.error(path.name, "", str(error), "give a file that emcas ssp, or another tool, has written")
        return report
    if DEFAULT not in archive.structures:
        report.error(path.name, "", f"has no {DEFAULT} at its root", "add one: it is what a host opens")
    structures = list(filter(None, (_read(read_structure, archive, file, report) for file in archive.structures)))
    report.variants = tuple(s.name for s in structures)
    interfaces: dict[str, Interface | None] = {}
    for structure in structures:
        for name, component in elements(structure.system):
            place = f"component {name}"
            component.interface = _interface(archive, structure.file, place, component, interfaces, report)
            if component.interface is not None:
                _guid(structure.file, place, component, component.interface, guid, report)
                structure.units = {**component.interface.units, **structure.units}
        check_wiring(structure, report)
        check_settings(structure, report, model)
    return report


def _read(read: Callable[[Archive, str, OnProblem], T], archive: Archive, file: str, report: Report) -> T | None:
    """Read a file of the archive as far as it can be; what is wrong with it is reported."""
    try:
        return read(archive, file, lambda at, problem: report.error(at, "", problem, _CORRECT))
    except SspError as error:
        report.error(file, "", str(error).removeprefix(f"{file}: "), _CORRECT)
        return None


def _interface(archive: Archive, file: str, place: str, component: Element, interfaces: dict[str, Interface | None],
               report: Report) -> Interface | None:
    """Return the FMU of a component, from `interfaces` if read before; None, reported, if it is none or not there."""
    if component.type in ("system", "dictionary"):
        return None
    if component.type != FMU:
        report.warning(file, place, f"is of type {component.type}, whose variables are not known",
                       "check its connections yourself")
        return None
    source = normpath(unquote(component.source))
    if source not in archive.names:
        report.error(file, place, f"its FMU {component.source or '(no source)'} is not in the archive",
                     f"the archive has {', '.join(n for n in archive.names if n.endswith('.fmu')) or 'no FMU'}")
        return None
    if source not in interfaces:
        try:
            interfaces[source] = read_interface(archive.read(source), source)
        except SspError as error:
            interfaces[source] = None
            report.error(source, "", str(error), "replace it by a sound FMU")
    return interfaces[source]


def _guid(file: str, place: str, component: Element, interface: Interface, required: str | None,
          report: Report) -> None:
    def bare(guid: str) -> str:
        return guid.strip().strip("{}").lower()

    if component.guid and bare(component.guid) != bare(interface.guid):
        report.error(file, place, f"was written for {component.source} with GUID {component.guid}, but the one in the "
                     f"archive has {interface.guid}", "put that FMU back, or write the archive anew for this one")
    # The other FMUs of a system are not those asked about.
    ours = component.guid or interface.model.startswith("EMCAS")
    if required is not None and ours and bare(required) != bare(interface.guid):
        report.error(file, place, f"{component.source} has GUID {interface.guid}, wanted is {required}",
                     "write the archive anew with the FMU you mean: emcas ssp --fmu FILE")
