"""Check of an archive: schemas, wiring, units, parameters, and the FMU for which it was written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..actuators import NONLINEAR, get
from ..bench.fmu import model_of
from ..parameters import check_parameters
from .archive import DEFAULT, SspError, read_archive, structure_files
from .structure import End, Problem, SystemStructure, label, nearest, read_interface, read_structures

_SOURCES = ("output", "calculatedParameter", "local", "independent")


@dataclass(frozen=True)
class Report:
    """The findings about an archive, its checked `variants`, and the numbers of checked connections and parameters.

    `unchecked` are structures that could not be read, so that their wiring and parameters were not checked.
    """

    path: Path
    findings: tuple[Problem, ...]
    variants: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    connections: int = 0
    parameters: int = 0

    @property
    def errors(self) -> list[Problem]:
        """The findings that make the check fail."""
        return [f for f in self.findings if f.level == "error"]

    @property
    def warnings(self) -> list[Problem]:
        """The findings that do not make the check fail."""
        return [f for f in self.findings if f.level == "warning"]

    def document(self) -> dict[str, Any]:
        """Return the report for JSON."""
        return {"file": str(self.path), "passed": not self.errors, "variants": self.variants,
                "not_checked": self.unchecked, "connections": self.connections, "parameters": self.parameters,
                "findings": [asdict(f) for f in self.findings]}


def check(path: Path, guid: str | None = None, fmu: Path | None = None, model: str | None = None) -> Report:
    """Check every structure of an archive against the FMUs in it, and return the report with all problems.

    The actuators in the archive must have the `guid`, or the GUID of `fmu`, if either is passed. `model` is the kind of
    actuator in FMUs whose model name does not contain it. Raises EmcasError if a file cannot be opened, SspError if
    `fmu` is not an FMU.
    """
    if fmu is not None:
        guid = read_interface(fmu, str(fmu)).guid
    try:
        contents = read_archive(path)
    except SspError as error:
        finding = Problem("error", path.name, "", str(error), "choose an archive that emcas ssp has written")
        return Report(path, (finding,), unchecked=(path.name,))
    structures, findings = read_structures(contents)
    if DEFAULT not in contents:
        findings.append(Problem("error", path.name, "", f"has no {DEFAULT} at its root", "add one: hosts open it"))
    for structure in structures:
        new = [*_guids(structure, guid), *_wiring(structure), *_declarations(structure)]
        # Combinations are checked only if there is no other error.
        findings += new if any(f.level == "error" for f in new) else [*new, *_combinations(structure, model)]
    checked = {structure.file: structure.name for structure in structures}
    return Report(path, tuple(dict.fromkeys(findings)), tuple(checked.values()),
                  tuple(file for file in structure_files({*contents, DEFAULT}) if file not in checked),
                  sum(len(s.connections) for s in structures), sum(len(s.parameters) for s in structures))


def _guids(structure: SystemStructure, required: str | None) -> Iterator[Problem]:
    """Yield an error for each FMU whose GUID differs from that recorded in the structure, or from the required one."""
    for name, fmu in structure.fmus.items():
        source, written = structure.sources[name], structure.guids.get(structure.sources[name], "")
        # FMUs of other makers need not have the required GUID.
        of_this_package = written or fmu.model.startswith("EMCAS")
        for wanted, why in ((written, "the archive was written for"), (of_this_package and required, "required is")):
            if wanted and wanted.strip().strip("{}").lower() != fmu.guid.strip().strip("{}").lower():
                yield Problem("error", structure.file, f"component {name}", f"{source} has GUID {fmu.guid}, {why} "
                              f"{wanted}", "replace it with that FMU, or write a new archive: emcas ssp --fmu FILE")


def _wiring(structure: SystemStructure) -> Iterator[Problem]:
    """Yield findings about connections, and about inputs and outputs without one.

    A correct connection runs from an output to an input that has no other, and both have the same type and unit.
    """
    variables = structure.variables
    signals = {**structure.connectors, **variables}
    fed_by: dict[End, str] = {}
    for connection in structure.connections:
        place, (start, end) = f"connection {label(*connection)}", connection
        if unknown := [each for each in connection if each not in structure.connectors]:
            for each in unknown:
                yield Problem("error", structure.file, place, f"there is no connector {label(each)}",
                              "declare it in the Connectors of its component" if each in variables else nearest(
                                  label(each), map(label, structure.connectors), "remove the connection"))
            continue
        # For its components the system's inputs are sources.
        sources = [(signals[each].kind in _SOURCES) is bool(each[0]) for each in connection]
        sink = connection[sources[0]]
        if sources[0] == sources[1]:
            yield Problem("error", structure.file, place, f"both ends are {'sources' if sources[0] else 'inputs'}",
                          "connect an output to an input, or a connector of the system to one of the same kind")
        elif sink in fed_by:
            yield Problem("error", structure.file, place, f"{label(sink)} is fed twice, first by {fed_by[sink]}",
                          "remove one of the two")
        else:
            fed_by[sink] = label(*connection)
            if sources[1]:
                yield Problem("warning", structure.file, place, "runs from its end to its start, which libcosim and "
                              "Ecos do not read", "exchange start and end")
        if differs := signals[start].mismatch(signals[end], label(end)):
            yield Problem("error", structure.file, place, f"{label(start)} {differs[0]}", differs[1])
    used = {end for connection in structure.connections for end in connection}
    for end, signal in variables.items() if used else ():  # without connections, the host feeds the components' inputs
        if end not in used and (signal.kind == "input" or (signal.kind == "output" and not end[0])):
            yield Problem("warning", structure.file, f"{signal.kind} {label(end)}", "is not wired, while others are",
                          "wire it, or remove its connector: fmpy feeds it from another signal, or fails")


def _declarations(structure: SystemStructure) -> Iterator[Problem]:
    """Yield an error for each connector or parameter that does not match its variable: name, kind, unit or limits."""
    variables = structure.variables
    ends = [(near, far) for start, end in reversed(structure.connections) for near, far in ((start, end), (end, start))]
    # A connector of the system has the limits of the first variable to which it is wired.
    variables |= {near: variables[far] for near, far in ends if not near[0] and far in variables}
    claims = [(structure.file, f"connector {label(end)}", end, connector)
              for end, connector in structure.connectors.items() if end[0]]
    claims += [(file, f"parameter {parameter.name}", end, parameter) for file, end, parameter in structure.parameters]
    for file, place, end, signal in claims:
        variable = variables.get(end)
        if variable is None:
            names = [name for component, name in variables if component == end[0]]
            problem = ("the FMU has no such variable" if end[0] else "is not a connector of the system",
                       nearest(end[1], names, "remove it"))
        elif signal.kind not in ("", "inout", variable.kind):
            problem = f"is declared {signal.kind}, but is {variable.kind} in the FMU", f'write kind="{variable.kind}"'
        elif not signal.kind and not variable.settable:
            problem = f"is {variable.kind} in the FMU and cannot be set", "remove it"
        elif differs := signal.mismatch(variable, "the FMU's variable"):
            problem = differs
        elif isinstance(signal.value, (int, float)) and not variable.minimum <= signal.value <= variable.maximum:
            problem = (f"is {signal.value:.12g} {signal.unit}, outside {variable.minimum:g} .. {variable.maximum:g}",
                       "write a value within the limits")
        else:
            continue
        yield Problem("error", file, place, *problem)


def _combinations(structure: SystemStructure, default: str | None) -> Iterator[Problem]:
    """Yield an error for each combination of parameters that an actuator of this package refuses at initialization.

    `default` is the kind of actuator in FMUs whose model name does not contain it.
    """
    parameters = structure.values
    for name, fmu in structure.fmus.items():
        model = model_of(fmu.model) or default or NONLINEAR
        names = [v.name for v in get(model).parameters]
        if fmu.variables.keys() >= set(names):
            values = {each: parameters.get((name, each), fmu.variables[each].value or 0) for each in names}
            for problem in check_parameters(values, model):
                yield Problem("error", structure.file, f"component {name}", problem, "change one of them")
