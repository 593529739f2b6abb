"""An SSP archive from an FMU and parameters; the same inputs give the same bytes.

By default the components, all with the same FMU, are not wired: libcosim and Ecos refuse a structure in which a
connector of the system itself is wired. They would ignore connections with another prefix than ``ssd:``, which
OMSimulator refuses. fmpy's simulate_ssp needs the system's connectors, which `border` adds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ..actuators import HALVES, NONLINEAR, full_name, get, with_extension
from ..actuators.fin_port import ENABLE
from ..bench.fmu import chosen_model
from ..fmi.description import describe
from ..fmi.interface import FmuInterface, fin_sets, flat
from ..fmi.model_description import STEP_SIZE, STOP_TIME
from ..fmi.package import build
from ..fmi.units import Unit, fmi_unit
from ..parameters import Entry, ParameterSet, Scalar, load_parameters
from ..rules import SLACK
from ..support.progress import Progress
from ..support.writing import check_target, write
from ..variables import Variable
from .archive import ANNOTATION, DEFAULT, FMU, NOMINAL, SspError, render, write_archive
from .check import Report, check
from .structure import Interface, read_interface
from .variants import Variant, derived

_DELAY = "drive.transport_delay"


@dataclass(frozen=True)
class Written:
    """A written archive: file, GUIDs of its FMUs, messages about variants left out, parameter warnings, its check."""

    path: Path
    guid: str
    left_out: tuple[str, ...]
    warnings: tuple[str, ...]
    report: Report


class Component(NamedTuple):
    """A component: its name, its fin's name, its FMU and its connectors by name."""

    name: str
    fin: str
    fmu: Interface
    variables: Mapping[str, Variable]

    def reads(self, name: str) -> bool:
        """Return whether the component has an input with this name."""
        return name in self.variables and self.variables[name].causality == "input"


def write_ssp(output: Path, fmu: Path | None = None, parameters: Sequence[Path] | None = None, *, fins: int = 4,
              layout: str = "cross", fin_files: Mapping[int, Path] | None = None,
              variant_files: Mapping[str, Path] | None = None, border: bool = False,
              model: str | None = None, progress: Progress | None = None, halves: bool = False) -> Written:
    """Write the archive of a system of `fins` actuators to `output`, whole or not at all, and return it with its check.

    Without an `fmu`, the native FMU of the `model` (:mod:`emcas_fmu.actuators`) is built with the parameters. The fins'
    parameters are those of the files `parameters`, otherwise the FMU's start values. `fin_files` are parameter files by
    number of the fin, from 1; `variant_files` are files by name of the variant. With a `border` the fins are wired to
    connectors of the system.

    With `halves` each fin is two components, its controllers and its plant, which are built and wired. The host delays
    each signal between components by a step, and the plant's drive delay is shortened by it: the trajectory is that of
    the whole actuator if this delay is a step or more.

    Raises EmcasError for invalid arguments and files, SspError if the archive does not pass its check.
    """
    check_target(output, ".ssp", SspError)
    if fmu is not None and halves:
        raise SspError(f"{fmu}: halves are built as two FMUs: leave out the FMU or halves")
    if fmu is not None:
        interface, content = read_interface(fmu, str(fmu)), fmu.read_bytes()
        model = chosen_model(str(fmu), interface.model, None if model is None else full_name(model), SspError)
    base = load_parameters(parameters, model=model or NONLINEAR)
    if fmu is not None:
        starts = _starts(interface, str(fmu), base.model)
        base = base if parameters else base.with_values({n: v for n, v in starts.items() if v != base.values[n]})
    nominal = Variant(NOMINAL, fin_sets(base, fins, layout, fin_files or {}))
    others, left_out = derived(variant_files or {}, nominal)
    variants = [nominal, *others]
    kinds = {part: FmuInterface(1, with_extension(base.model, part)) for part in HALVES} if halves else {
        "": FmuInterface(1, base.model)}
    if fmu is None:  # compiling takes longest, so mistakes in the arguments are reported before
        with TemporaryDirectory() as folder:
            files = {part: build(base, Path(folder) / "EMCAS.fmu", "native", progress=progress, part=part or None
                                 ).path.read_bytes() for part in kinds}
        fmus = {part: read_interface(content, "EMCAS.fmu") for part, content in files.items()}
    else:
        files, fmus = {"": content}, {"": interface}
    contents = {f"resources/{fmus[part].model}.fmu": content for part, content in files.items()}
    components = [
        Component("_".join(filter(None, (fin, part))), fin, fmus[part],
                  {v.name: v for v in (*kind.inputs, *kind.outputs) if v.name not in kind.actuator.hidden})
        for fin in nominal.names for part, kind in kinds.items()]
    inner = [(start, end, name) for start in components for end in components if start.fin == end.fin
             for name, v in start.variables.items() if v.causality == "output" and end.reads(name)]
    wired = {(end.name, name) for _, end, name in inner}
    single = FmuInterface(1, base.model)
    shared = (*single.shared, ENABLE.name)
    # OMSimulator accepts no dot in a connector of the system; fmpy distinguishes connectors only by their paths.
    wires = [(flat(name if name in shared else f"{component.name}.{name}"), component, v)
             for component in components if border or halves
             for name, v in component.variables.items() if (component.name, name) not in wired]
    variables = {v.name: v for component in components for v in component.variables.values()}
    late = [warning for v in variants for fin in v.fins if halves and (warning := _too_late(fin))]
    for variant in variants:
        for component, entries in _parameter_sets(variant, components, wires).items():
            contents[f"resources/{variant.name}_{component}.ssv"] = render(
                "parameters.xml.j2", name=variant.name, entries=entries,
                units=_units(e.variable for e in entries.values()))
        contents[DEFAULT if variant.name == NOMINAL else f"{variant.name}.ssd"] = render(
            "structure.xml.j2", name=variant.name, description=describe(single), type=FMU, fmus=fmus.values(),
            annotation=ANNOTATION, fins=variant.names, components=components, inner=inner, wires=wires,
            outer={connector: v for connector, _, v in wires}, units=_units(variables.values()), stop=STOP_TIME,
            step=STEP_SIZE, enumerations=[v for v in variables.values() if v.items])
    with TemporaryDirectory() as folder:
        draft = Path(folder) / output.name
        write_archive(contents, draft)
        report = check(draft, None if halves else fmus[""].guid, model=base.model)
        if report.errors:
            raise SspError("\n".join(["the archive does not pass its check:", *map(str, report.errors)]))
        write(output, draft.read_bytes())
    warnings = dict.fromkeys((*(warning for v in variants for fin in v.fins for warning in fin.warnings), *late))
    return Written(output, ", ".join(each.guid for each in fmus.values()), tuple(left_out), tuple(warnings), report)


def _too_late(fin: ParameterSet) -> str:
    """Return a warning if the step between components is longer than the drive's delay; otherwise ""."""
    delay = float(fin.values.get(_DELAY, 0.0))
    return "" if delay >= STEP_SIZE * (1.0 - SLACK) else (
        f"{_DELAY} = {delay:g} s is below the step of {STEP_SIZE:g} s that the reference takes between components: the "
        "halves respond later than the whole actuator; couple the halves in turn (docs/use/hardware_in_the_loop.md)")


def _plant(fin: ParameterSet) -> ParameterSet:
    """Return the parameters of the plant alone: the drive's delay, if it is a step or more, is a step shorter."""
    return fin if _too_late(fin) else fin.with_values({_DELAY: max(float(fin.values[_DELAY]) - STEP_SIZE, 0.0)})


def _starts(interface: Interface, file: str, model: str) -> dict[str, Scalar]:
    """Return the FMU's start values by name in a parameter file. Raises SspError for an FMU of another model."""
    actuator = get(model)
    table = (*actuator.inputs, *actuator.outputs, *actuator.parameters)
    names = {e.name: e.name for e in actuator.file_entries} | {v.key: v.name for v in actuator.inputs if v.key}
    missing = [v.name for v in table if v.name not in interface.variables] or [
        f"the start value of {name}" for name in names.values() if interface.variables[name].value is None]
    if missing:
        raise SspError(f"{file}: is not an FMU of one actuator of the model {actuator.name}: it lacks {missing[0]}; "
                       "build one with emcas build")
    return {entry: interface.variables[name].value for entry, name in names.items()}  # type: ignore[misc]


def _units(variables: Iterable[Variable]) -> dict[str, Unit]:
    """Return the units of real variables, by the units' names."""
    return {name: fmi_unit(name) for name in sorted({v.unit for v in variables if v.kind == "Real"})}


def _parameter_sets(variant: Variant, components: Sequence[Component],
                    wires: Sequence[tuple[str, Component, Variable]]) -> dict[str, dict[str, Entry]]:
    """Return the parameter sets of a variant: for each component one with all parameters and start values of inputs.

    Each component has one set: libcosim and Ecos do not combine sets, and OMSimulator ignores prefixes. A Boolean with
    the FMU's start value is left out, since fmpy reads every Boolean of a set as true. With `wires` (connector of the
    system, component and variable) the set ``system`` has the start values of the system's inputs; a host sets inputs
    without a start value to 0.
    """
    inputs = {v.key: v for v in get(variant.fins[0].model).inputs if v.key is not None}
    fins = dict(zip(variant.names, variant.fins))
    every: dict[str, dict[str, Entry]] = {}
    for component in components:
        fin = fins[component.fin]
        listed = (_plant(fin) if component.name.endswith("_plant") else fin).entries
        entries = [replace(e, variable=inputs.get(e.variable.name, e.variable)) for e in listed]
        every[component.name] = {e.variable.name: e for e in entries if e.variable.name in component.fmu.variables}
    sets = {component.name: {name: e for name, e in every[component.name].items()
                             if e.variable.kind != "Boolean" or e.value != component.fmu.variables[name].value}
            for component in components}
    if wires:
        sets["system"] = {outer: every[component.name].get(v.name) or Entry(v, v.start or 0, "", "", "", "")
                          for outer, component, v in wires if v.key is not None or v.start}
    return sets
