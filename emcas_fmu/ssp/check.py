"""Whether an SSP says what its author means: schema, wiring, units, parameters and the FMU they were written for."""

from __future__ import annotations

from pathlib import Path
from posixpath import normpath
from urllib.parse import unquote

from .archive import Archive, file_content
from .findings import Log, Report
from .interface import Interface, read_interface
from .schema import DEFAULT, SspError
from .settings import check_settings
from .structure import Binding, Element, Structure, read_set, read_structure, systems
from .wiring import check_wiring

_FMU = "application/x-fmu-sharedlibrary"
_CORRECT = "correct the file, or write the archive anew"


def check(path: Path, guid: str | None = None, fmu: Path | None = None, model: str | None = None) -> Report:
    """Check every structure of an archive against the FMUs in it.

    With `guid`, or the `fmu` to take it from, the actuators in it must have that one. `model` names the actuator of
    FMUs that do not tell their own. Whatever is wrong with the archive is in the report; raises EmcasError only if a
    file cannot be opened at all, SspError if `fmu` is no FMU.
    """
    if fmu is not None:
        guid = read_interface(file_content(fmu), str(fmu)).guid
    log = Log()
    try:
        archive = Archive(path)
    except SspError as error:
        log.error(path.name, "", str(error), "give a file that emcas ssp, or another tool, has written")
        return Report(path, (), 0, 0, tuple(log.findings))
    if DEFAULT not in archive.structures:
        log.error(path.name, "", f"has no {DEFAULT} at its root", "add one: it is what a host opens")
    interfaces: dict[str, Interface | None] = {}
    structures = [s for s in (_structure(archive, file, log) for file in archive.structures) if s is not None]
    loose = _loose(archive, structures, log)
    for structure in structures:
        file = structure.file
        found: dict[int, Interface] = {}
        for prefix, system in systems(structure.system):
            for component in system.elements.values():
                interface = _interface(archive, file, prefix, component, interfaces, log)
                if interface is not None:
                    found[id(component)] = interface
                    _guid(file, prefix + component.name, component, interface, guid, log)
        check_wiring(structure, found, log)
        check_settings(structure, found, [b for b in loose if b.name == structure.name], log, model)
    return Report(path, tuple(s.name for s in structures), log.connections, log.parameters, tuple(log.findings))


def _structure(archive: Archive, file: str, log: Log) -> Structure | None:
    try:
        return read_structure(archive, file, lambda at, problem: log.error(at, "", problem, _CORRECT))
    except SspError as error:
        log.error(file, "", str(error).removeprefix(f"{file}: "), _CORRECT)
        return None


def _loose(archive: Archive, structures: list[Structure], log: Log) -> list[Binding]:
    """The parameter sets no structure binds, for hosts to which they are given by hand."""
    bound = {b.file for s in structures for _, system in systems(s.system)
             for element in (system, *system.elements.values()) for b in element.bindings}
    found = []
    for file in archive.names:
        if file.endswith(".ssv") and file not in bound:
            try:
                found.append(read_set(archive, file, lambda at, problem: log.error(at, "", problem, _CORRECT)))
            except SspError as error:
                log.error(file, "", str(error).removeprefix(f"{file}: "), _CORRECT)
    return found


def _interface(archive: Archive, file: str, prefix: str, component: Element, known: dict[str, Interface | None],
               log: Log) -> Interface | None:
    """The FMU of a component; None if it is none or cannot be had, which is told."""
    place = f"component {prefix}{component.name}"
    if component.type in ("system", "dictionary"):
        return None
    if component.type != _FMU:
        log.warning(file, place, f"is of type {component.type}, whose variables are not known",
                    "check its connections yourself")
        return None
    source = normpath(unquote(component.source))
    if source not in archive.names:
        log.error(file, place, f"its FMU {component.source or '(no source)'} is not in the archive",
                  f"the archive has {', '.join(n for n in archive.names if n.endswith('.fmu')) or 'no FMU'}")
        return None
    if source not in known:
        try:
            known[source] = read_interface(archive.read(source), source)
        except SspError as error:
            known[source] = None
            log.error(source, "", str(error), "replace it by a sound FMU")
    return known[source]


def _guid(file: str, name: str, component: Element, interface: Interface, wanted: str | None, log: Log) -> None:
    def bare(guid: str) -> str:
        return guid.strip().strip("{}").lower()

    place = f"component {name}"
    if component.guid and bare(component.guid) != bare(interface.guid):
        log.error(file, place, f"was written for {component.source} with GUID {component.guid}, but the one in the "
                  f"archive has {interface.guid}", "put that FMU back, or write the archive anew for this one")
    # The other FMUs of a system are not those asked about.
    ours = component.guid or interface.model.startswith("EMCAS")
    if wanted is not None and ours and bare(wanted) != bare(interface.guid):
        log.error(file, place, f"{component.source} has GUID {interface.guid}, wanted is {wanted}",
                  "write the archive anew with the FMU you mean: emcas ssp --fmu FILE")
