"""Check of an archive: schema, wiring, units, parameters and the FMU that it was written for."""

from __future__ import annotations

from pathlib import Path

from .archive import Archive, file_content
from .findings import Report
from .interface import Interface, read_interface
from .schema import DEFAULT, SspError
from .settings import check_settings
from .structure import Element, read_structure
from .wiring import check_wiring


def check(path: Path, guid: str | None = None, fmu: Path | None = None, model: str | None = None) -> Report:
    """Check every structure of an archive against the FMUs in it.

    With `guid`, or the `fmu` that has it, the actuators in the archive must have that GUID. `model` is the actuator of
    FMUs whose name does not say it. Whatever is wrong with the archive is in the report. Raises EmcasError if a file
    cannot be opened, SspError if `fmu` is not an FMU.
    """
    if fmu is not None:
        guid = read_interface(file_content(fmu), str(fmu)).guid
    report = Report(path)
    try:
        archive = Archive(path)
    except SspError as error:
        report.error(path.name, "", str(error), "choose a file that emcas ssp, or another tool, has written")
        return report
    if DEFAULT not in archive.structures:
        report.error(path.name, "", f"has no {DEFAULT} at its root", "add one: it is what a host opens")
    interfaces: dict[str, Interface | None] = {}
    for file in archive.structures:
        try:
            structure = read_structure(archive, file)
        except SspError as error:
            report.error(file, "", str(error).removeprefix(f"{file}: "), "correct the file, or write the archive anew")
            continue
        report.variants += (structure.name,)
        if structure.problems:
            report.add(structure.problems)
            continue
        for name, component in structure.system.elements.items():
            place = f"component {name}"
            component.interface = _interface(archive, file, place, component.source, interfaces, report)
            if component.interface is not None:
                _check_guid(file, place, component, component.interface, guid, report)
        check_wiring(structure, report)
        check_settings(structure, report, model)
    return report


def _interface(archive: Archive, file: str, place: str, source: str, interfaces: dict[str, Interface | None],
               report: Report) -> Interface | None:
    """Return the FMU `source`, from `interfaces` if read before; None, reported, if it cannot be read."""
    if source not in archive.names:
        report.error(file, place, f"its FMU {source} is not in the archive",
                     f"the archive has {', '.join(n for n in archive.names if n.endswith('.fmu')) or 'no FMU'}")
        return None
    if source not in interfaces:
        try:
            interfaces[source] = read_interface(archive.read(source), source)
        except SspError as error:
            interfaces[source] = None
            report.error(source, "", str(error), "replace it by a sound FMU")
    return interfaces[source]


def _check_guid(file: str, place: str, component: Element, interface: Interface, required: str | None,
                report: Report) -> None:
    def bare(guid: str) -> str:
        return guid.strip().strip("{}").lower()

    if component.guid and bare(component.guid) != bare(interface.guid):
        report.error(file, place, f"was written for {component.source} with GUID {component.guid}, but the one in the "
                     f"archive has {interface.guid}", "put that FMU back, or write the archive anew for this one")
    # FMUs of other makers need not have the required GUID.
    actuator = component.guid or interface.model.startswith("EMCAS")
    if required is not None and actuator and bare(required) != bare(interface.guid):
        report.error(file, place, f"{component.source} has GUID {interface.guid}, wanted is {required}",
                     "write the archive anew with the FMU you mean: emcas ssp --fmu FILE")
