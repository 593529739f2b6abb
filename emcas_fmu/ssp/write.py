"""From an FMU and parameters to an SSP archive; the same inputs give the same bytes."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ..actuators import NONLINEAR, full_name, get
from ..bench.fmu import chosen_model
from ..fmi.model_description import to_bytes
from ..fmi.package import build
from ..parameters import Value, load_parameters
from ..progress import Progress
from .archive import file_content, write_archive
from .check import check
from .findings import Report
from .interface import Interface, read_interface
from .schema import DEFAULT, NOMINAL, SspError
from .sets import parameter_sets
from .system import PREFIX, system_structure
from .variants import derived, nominal, without_shipped


@dataclass(frozen=True)
class Written:
    """What was written: the file, its size [bytes], the FMU's GUID, the variants, those left out with the reason, and
    what the check says of it."""

    path: Path
    size: int
    guid: str
    variants: tuple[str, ...]
    left_out: tuple[str, ...]
    report: Report


def write_ssp(output: Path, fmu: Path | None = None, parameters: Sequence[Path] | None = None, *, fins: int = 4,
              layout: str = "cross", fin_files: Mapping[int, Path] | None = None,
              variant_files: Mapping[str, Path] | None = None, prefix: str = PREFIX,
              model: str | None = None, progress: Progress | None = None) -> Written:
    """Write the archive of a system of `fins` actuators to `output`, whole or not at all, and check it.

    `fmu` is built, native, of the `model` (:mod:`emcas_fmu.actuators`) and the parameters if not given; the fins'
    parameters are those of the files `parameters`, or those the FMU starts with. `fin_files` and `variant_files` are
    parameter files by number of the fin and by name of the variant. Raises EmcasError; SspError if what was written
    does not pass its own check.
    """
    if output.suffix != ".ssp":
        raise SspError(f"{output}: the output must end in .ssp")
    if output.is_dir() or not output.parent.is_dir():
        raise SspError(f"{output}: {'is a folder' if output.is_dir() else f'there is no folder {output.parent}'}")
    if not re.fullmatch(r"[A-Za-z]\w*", prefix) or prefix in ("ssc", "ssv", "osp", "emcas", "xml", "xmlns"):
        raise SspError(f"--connections-prefix {prefix}: expected a word other than ssc, ssv, osp, emcas and xml")
    content = b"" if fmu is None else file_content(fmu)
    if fmu is not None:
        asked = None if model is None else full_name(model)
        model = chosen_model(str(fmu), read_interface(content, str(fmu)).model, asked, SspError)
    base = load_parameters(parameters, model=model or NONLINEAR)
    if fmu is not None and not parameters:
        starts = _starts(read_interface(content, str(fmu)), str(fmu), base.model)
        base = base.replace({name: value for name, value in starts.items() if value != base.values[name]})
    built = nominal(base, fins, layout, fin_files or {})
    files, left_out = without_shipped(variant_files or {}, base)
    variants = [built, *(derived(name, file, built) for name, file in files.items())]
    # Compiling takes longest: all other mistakes are told before.
    if fmu is None:
        with TemporaryDirectory() as folder:
            content = build(base, Path(folder) / "EMCAS.fmu", "native", progress=progress).path.read_bytes()
    interface = read_interface(content, str(fmu or "EMCAS.fmu"))
    starts = _starts(interface, str(fmu), base.model)
    sets = parameter_sets(variants, starts, base)
    name = f"{interface.model}.fmu"
    contents = {f"resources/{file}": data for file, data in sets.files.items()}
    contents[f"resources/{name}"] = content
    for variant in variants:
        structure = system_structure(variant.name, name, interface.guid, sets.system[variant.name],
                                     sets.fins[variant.name], prefix, base.model)
        contents[DEFAULT if variant.name == NOMINAL else f"{variant.name}.ssd"] = to_bytes(structure)
    partial = output.with_name(f".{output.stem}.{os.getpid()}.ssp")
    try:
        write_archive(contents, partial)
        report = check(partial, interface.guid, model=base.model)
        if report.errors:
            raise SspError("\n".join(["what was to be written does not pass the check:", *map(str, report.errors)]))
        partial.replace(output)
    finally:
        partial.unlink(missing_ok=True)
    return Written(output, output.stat().st_size, interface.guid, tuple(v.name for v in variants), tuple(left_out),
                   report)


def _starts(interface: Interface, file: str, model: str) -> dict[str, Value]:
    """The FMU's start values by entry of the parameter file. Raises SspError if it is no actuator of this model."""
    actuator = get(model)
    table = (*actuator.inputs, *actuator.outputs, *actuator.parameters)
    if missing := [v.name for v in table if v.name not in interface.ports]:
        of = "" if model == NONLINEAR else f" of the model {actuator.name}"
        raise SspError(f"{file}: is not an FMU of one actuator{of}: it lacks {', '.join(missing[:3])}"
                       f"{' and more' if len(missing) > 3 else ''}; build one with emcas build")
    keys = {v.key: v.name for v in actuator.inputs if v.key is not None}
    values: dict[str, Value] = {}
    for entry in actuator.file_entries:
        written = interface.ports[keys.get(entry.name, entry.name)].start
        if written is None:
            raise SspError(f"{file}: {entry.name} has no start value; build the FMU with emcas build")
        if entry.kind == "Boolean":
            values[entry.name] = written in ("true", "True", "1")
        else:
            values[entry.name] = int(written) if entry.kind == "Integer" else float(written)
    return values


