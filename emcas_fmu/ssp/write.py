"""An SSP archive from an FMU and parameters; the same inputs give the same bytes.

By default the system has only components, each with the same FMU: libcosim and Ecos refuse a structure in which a
connector of the system itself is wired. They look for the name ``ssd:Connections``, but so does OMSimulator, which
refuses any other prefix, so that connections cannot be hidden from them. fmpy's simulate_ssp needs the connections.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ..actuators import NONLINEAR, full_name, get
from ..bench.fmu import chosen_model
from ..fmi.description import STEP_SIZE, STOP_TIME, describe
from ..fmi.interface import FmuInterface, fin_sets
from ..fmi.package import build
from ..parameters import Value, load_parameters
from ..support.progress import Progress
from ..support.writing import check_target, write
from .archive import file_content, write_archive
from .check import check
from .findings import Report
from .interface import Interface, read_interface, typed
from .schema import ANNOTATION, DEFAULT, FMU, NOMINAL, SspError, render
from .sets import fmi_units, inputs_by_entry, parameter_sets, wires
from .variants import Variant, derived, without_shipped


@dataclass(frozen=True)
class Written:
    """A written archive: file, GUID of the FMU, variants, those left out and why, warnings about parameters, and the
    report of its check."""

    path: Path
    guid: str
    variants: tuple[str, ...]
    left_out: tuple[str, ...]
    warnings: tuple[str, ...]
    report: Report


def write_ssp(output: Path, fmu: Path | None = None, parameters: Sequence[Path] | None = None, *, fins: int = 4,
              layout: str = "cross", fin_files: Mapping[int, Path] | None = None,
              variant_files: Mapping[str, Path] | None = None, border: bool = False,
              model: str | None = None, progress: Progress | None = None) -> Written:
    """Write the archive of a system of `fins` actuators to `output`, whole or not at all, and check it.

    Without an `fmu`, the native FMU of the `model` (:mod:`emcas_fmu.actuators`) and the parameters is built. The fins'
    parameters are those of the files `parameters`, otherwise the FMU's start values. `fin_files` and `variant_files`
    are parameter files by number of the fin and by name of the variant. With a `border` the fins are wired to
    connectors of the system. Raises EmcasError; SspError if the archive does not pass its own check.
    """
    check_target(output, ".ssp", SspError)
    if fmu is not None:
        content = file_content(fmu)
        interface = read_interface(content, str(fmu))
        model = chosen_model(str(fmu), interface.model, None if model is None else full_name(model), SspError)
    base = load_parameters(parameters, model=model or NONLINEAR)
    if fmu is not None and not parameters:
        starts = _starts(interface, str(fmu), base.model)
        base = base.with_values({name: value for name, value in starts.items() if value != base.values[name]})
    built = Variant(NOMINAL, fin_sets(base, fins, layout, fin_files or {}))
    files, left_out = without_shipped(variant_files or {}, base)
    variants = [built, *(derived(name, file, built) for name, file in files.items())]
    if fmu is None:  # Compiling takes longest: all other mistakes are reported before.
        with TemporaryDirectory() as folder:
            content = build(base, Path(folder) / "EMCAS.fmu", "native", progress=progress).path.read_bytes()
        interface = read_interface(content, "EMCAS.fmu")
    name = f"{interface.model}.fmu"
    sets = parameter_sets(variants, _starts(interface, str(fmu), base.model), border=border)
    contents = {f"resources/{file}": data for file, data in {**sets, name: content}.items()}
    single = FmuInterface(1, base.model)
    variables = single.inputs + single.outputs
    outside = list(wires(base.model, built.names)) if border else []
    for variant in variants:
        contents[DEFAULT if variant.name == NOMINAL else f"{variant.name}.ssd"] = render(
            "structure.xml.j2", name=variant.name, description=describe(single), type=FMU, fmu=name,
            guid=interface.guid, annotation=ANNOTATION, fins=variant.names, variables=variables, wires=outside,
            connectors={wire.outer: wire.variable for wire in outside},
            enumerations={v.name: v for v in variables if v.items}.values(), units=fmi_units(variables),
            stop=STOP_TIME, step=STEP_SIZE)
    with TemporaryDirectory() as folder:
        checked = Path(folder) / output.name
        write_archive(contents, checked)
        report = check(checked, interface.guid, model=base.model)
        if report.errors:
            raise SspError("\n".join(["the archive does not pass its check:", *map(str, report.errors)]))
        write(output, checked.read_bytes())
    warnings = tuple(dict.fromkeys(warning for v in variants for fin in v.fins for warning in fin.warnings))
    return Written(output, interface.guid, tuple(v.name for v in variants), tuple(left_out), warnings, report)


def _starts(interface: Interface, file: str, model: str) -> dict[str, Value]:
    """Return the FMU's start values by entry of the parameter file.

    Raises SspError if the FMU is not an actuator of this model.
    """
    actuator = get(model)
    table = (*actuator.inputs, *actuator.outputs, *actuator.parameters)
    if missing := [v.name for v in table if v.name not in interface.variables]:
        of = "" if model == NONLINEAR else f" of the model {actuator.name}"
        raise SspError(f"{file}: is not an FMU of one actuator{of}: it lacks {', '.join(missing[:3])}"
                       f"{' and more' if len(missing) > 3 else ''}; build one with emcas build")
    inputs = inputs_by_entry(model)
    values: dict[str, Value] = {}
    for entry in actuator.file_entries:
        start = interface.variables[inputs.get(entry.name, entry).name].start
        if start is None:
            raise SspError(f"{file}: {entry.name} has no start value; build the FMU with emcas build")
        values[entry.name] = typed(entry.kind, start)  # type: ignore[assignment]
    return values
