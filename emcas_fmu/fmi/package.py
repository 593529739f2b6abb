"""From a parameter set to an FMU file; the same inputs give the same bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

from .. import __version__
from ..errors import BuildError
from ..parameters import ParameterSet
from ..support.arguments import checked
from ..support.progress import Progress
from ..support.writing import check_target, write_zip
from . import native, python
from .description import about, terminals_and_icons, to_bytes
from .documentation import documents
from .fmi3.native import CLOCKED
from .format import Format
from .interface import SPELLINGS, FmuInterface, fin_sets, start_values
from .references import reference_files

BACKENDS = ("python", "native")


@checked
@dataclass(frozen=True)
class Built:
    """What was built: the file, its size [bytes], the GUID, the platforms it has binaries for, and the warnings of its
    parameters."""

    path: Path
    size: int
    guid: str
    platforms: tuple[str, ...]
    warnings: tuple[str, ...]


def interface_guid(starts: tuple[Any, ...], unit: FmuInterface, fmi: Format = native.FORMATS["2"]) -> str:
    """Return a hash of the interface: of the model description with its GUID left empty."""
    description = to_bytes(fmi.model_description(starts, "", unit=unit))
    return f"{{{UUID(bytes=hashlib.sha256(description).digest()[:16], version=5)}}}"


def _native(unit: FmuInterface, starts: tuple[Any, ...], guid: str, platforms: Sequence[str] | None, cc: str | None,
            progress: Progress | None, fmi: Format) -> dict[str, bytes]:
    files = native.sources(unit, starts, guid, fmi)
    contents = native.binaries(unit.model, files, native.chosen(platforms, cc), cc, progress, fmi)
    contents |= {f"sources/{name}": text.encode() for name, text in files.items()}
    contents["sources/buildDescription.xml"] = to_bytes(native.build_description(unit.model, fmi))
    return contents


def _contents(unit: FmuInterface, sets: Sequence[ParameterSet], backend: str, platforms: Sequence[str] | None,
              cc: str | None, progress: Progress | None, fmi: Format,
              ) -> tuple[dict[str, bytes], str, tuple[str, ...]]:
    starts = start_values(unit, [p.values for p in sets])
    guid = interface_guid(starts, unit, fmi)
    # Neither Python's nor the compiler's version: any that is supported gives the same FMU but for the binaries.
    tool = f"emcas-fmu {__version__}"
    of_sources: Mapping[str, Any] = {}
    if backend == "native":
        contents = _native(unit, starts, guid, platforms, cc, progress, fmi)
        options, of_sources, notes = dict(fmi.options), fmi.of_sources, fmi.notes
    else:
        contents, options = python.exported(unit, starts, guid)
        notes = python.NOTES
        tool += f" with {python.TOOL}"
    contents["modelDescription.xml"] = to_bytes(
        fmi.model_description(starts, guid, options=options, about=about(unit, sets, tool), unit=unit, **of_sources))
    contents["terminalsAndIcons/terminalsAndIcons.xml"] = to_bytes(
        terminals_and_icons(unit, fmi.arrays))
    built_for = tuple(sorted({name.split("/")[1] for name in contents if name.startswith("binaries/")}))
    contents.update(documents(unit, sets, guid, backend, notes, fmi, built_for))
    return contents, guid, built_for


@checked
def build(parameters: ParameterSet, output: Path | str, backend: str | None = None,
          platforms: Sequence[str] | None = None, cc: str | None = None, progress: Progress | None = None,
          fins: int = 1, layout: str = "cross", files: Mapping[int, Path | str] | None = None, fmi: str | int = "2",
          references: bool = True, clock: bool = False, names: str = SPELLINGS[0]) -> Built:
    """Write the FMU of a parameter set to `output`, whole or not at all.

    `backend` is ``python``, of FMI 2.0 unless given, or ``native``, which alone knows FMI 3.0 (`fmi` of ``3``). For
    the native one are `platforms` to build for (all if not given), `cc` a system compiler instead of zig (this
    platform only). With `clock` an FMU of FMI 3.0 has a clock of the controllers' samples. `names` of variables are
    ``structured``, or ``flat``: without dots and brackets.
    More than one of `fins` share a bus and stand in the `layout` (``plus`` or ``cross``); `files` are parameter
    files of single fins (from 1), over the others'. Unless `references` is False it carries responses to compare with
    (:mod:`.references`). Raises EmcasError for what cannot be asked for, ParameterError for a file's problems,
    BuildError if the FMU cannot be written and CompilerError if there is no compiler.
    """
    fmi = str(fmi)
    if fmi not in native.FORMATS:
        raise BuildError(f"--fmi {fmi}: there is {' and '.join(native.FORMATS)}")
    backend = backend or ("python" if fmi == "2" else "native")
    if backend not in BACKENDS:
        raise BuildError(f"--backend {backend}: there is {' and '.join(BACKENDS)}")
    if backend == "python" and (platforms is not None or cc is not None):
        raise BuildError("--platform and --cc are for --backend native: the Python back end compiles nothing")
    if clock and fmi == "2":
        raise BuildError("--clock is for --fmi 3: FMI 2.0 has no clocks")
    if backend == "python" and fmi != "2":
        raise BuildError(f"--fmi {fmi} is for --backend native: the Python back end exports FMI 2.0")
    output = Path(output)
    check_target(output, ".fmu", BuildError)
    if fins == 1 and files:
        raise BuildError("--fin is for a unit of several: give --fins too")
    sets = [parameters] if fins == 1 else fin_sets(parameters, fins, layout, files or {})
    unit, chosen = FmuInterface(fins, parameters.model, names), CLOCKED if clock else native.FORMATS[fmi]
    contents, guid, built_for = _contents(unit, sets, backend, platforms, cc, progress, chosen)
    carried, doubts = reference_files(unit, sets, chosen, progress) if references else ({}, ())
    contents.update(carried)
    # modelDescription.xml first: readers that stream find it at once.
    write_zip(contents, output, lambda name: (name != "modelDescription.xml", name), "binaries/")
    warnings = dict.fromkeys((*(warning for p in sets for warning in p.warnings), *doubts))
    return Built(output, output.stat().st_size, guid, built_for, tuple(warnings))
