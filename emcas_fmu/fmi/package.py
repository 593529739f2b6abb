"""Building an FMU file from a parameter set; the same inputs give the same bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from uuid import UUID

from .. import __version__
from ..actuators import TORQUE, of_fmu
from ..errors import BuildError
from ..parameters import ParameterSet
from ..runtime import codegen
from ..support.arguments import checked
from ..support.progress import Progress, silent
from ..support.writing import check_target, write_zip
from . import native, python
from .description import about, terminals_and_icons, to_bytes
from .documentation import documents
from .format import FORMATS, Format
from .interface import CONNECTIONS, INPUT_SETS, SPELLINGS, FmuInterface, fin_sets, start_values
from .model_description import model_description
from .references import reference_files

BACKENDS = ("python", "native")


@checked
@dataclass(frozen=True)
class Built:
    """A built FMU: its file, size [bytes], GUID, the platforms of its binaries, and warnings about its parameters."""

    path: Path
    size: int
    guid: str
    platforms: tuple[str, ...]
    warnings: tuple[str, ...]


def interface_guid(starts: tuple[Any, ...], interface: FmuInterface, fmi: Format = FORMATS["2"]) -> str:
    """Return the GUID: a hash of the model description with an empty GUID and of the equations."""
    described = to_bytes(model_description(fmi, interface, starts, ""))
    equations = codegen.source(interface.fins > 1, interface.kind).encode()
    return f"{{{UUID(bytes=hashlib.sha256(described + equations).digest()[:16], version=5)}}}"


def _contents(interface: FmuInterface, sets: Sequence[ParameterSet], backend: str, platforms: Sequence[str] | None,
              cc: str | None, progress: Progress, fmi: Format, references: bool,
              ) -> tuple[dict[str, bytes], str, tuple[str, ...], tuple[str, ...]]:
    """Return the files of the archive, GUID, platforms, and warnings about the references."""
    starts = start_values(interface, [p.values for p in sets])
    guid = interface_guid(starts, interface, fmi)
    # The tool's name has no version of Python or compiler: all supported ones give the same FMU apart from binaries.
    tool = f"emcas-fmu {__version__}"
    if backend == "native":
        files, options = native.sources(interface, starts, guid, fmi), fmi.options
        contents = native.binaries(interface.identifier, files, native.chosen(platforms, cc), cc, progress, fmi)
        contents |= {f"sources/{name}": text.encode() for name, text in files.items()}
        contents["sources/buildDescription.xml"] = to_bytes(native.build_description(interface.identifier, fmi))
    else:
        contents, options = python.exported(interface, starts, guid), python.OPTIONS
        tool += f" with {python.TOOL}"
    contents["modelDescription.xml"] = to_bytes(model_description(
        fmi, interface, starts, guid, options=options, about=about(interface, sets, tool),
        sources=backend == "native"))
    contents["terminalsAndIcons/terminalsAndIcons.xml"] = to_bytes(terminals_and_icons(interface, fmi.arrays))
    built_for = tuple(sorted({name.split("/")[1] for name in contents if name.startswith("binaries/")}))
    embedded, warnings, experiments = reference_files(interface, sets, fmi, progress) if references else ({}, (), ())
    contents |= embedded | documents(interface, sets, guid, backend, fmi, built_for, experiments)
    return contents, guid, built_for, warnings


@checked
def build(parameters: ParameterSet, output: Path | str, backend: str | None = None,
          platforms: Sequence[str] | None = None, cc: str | None = None, progress: Progress | None = None,
          fins: int = 1, layout: str = "cross", files: Mapping[int, Path | str] | None = None, fmi: str | int = "2",
          references: bool = True, clock: bool = False, names: str = SPELLINGS[0], part: str | None = None,
          scalars: bool = False, inputs: str = INPUT_SETS[0], identifier: str | None = None,
          interface: str = CONNECTIONS[0]) -> Built:
    """Write the FMU of a parameter set to `output`, whole or not at all.

    `fmi` is ``2`` or ``3``; `backend` is ``python``, which builds `fmi` ``2`` only and is its default, or ``native``,
    which builds for `platforms` (default: all) with zig, or with the system compiler `cc` for this machine only. With
    `clock` an FMU of FMI 3.0 has a clock of the controllers' samples, with `scalars` it has no arrays. With `inputs`
    ``minimal`` only fin_command and aero_torque are inputs, the others are tunable parameters. `names` are
    ``structured``, or ``flat``: without dots and brackets. The `identifier`, by default the model's name, names library
    and C functions. Several `fins` share a supply and are in the `layout` ``plus`` or ``cross``; `files` maps fin
    numbers, from 1, to parameter files that override `parameters`. With `references` the FMU contains responses to
    compare with (:mod:`.references`), unless it is a `part`, ``controller`` or ``plant`` alone
    (:mod:`emcas_fmu.extensions.halves`), or has the `interface` ``torque``, with which the host models the fin
    (:mod:`emcas_fmu.extensions.torque`). Raises EmcasError for invalid arguments (most are a BuildError, an
    unknown platform is a CompilerError), ParameterError for a file's problems, BuildError if the FMU cannot be written,
    CompilerError if there is no compiler or it fails.
    """
    fmi = str(fmi)
    backend = backend or ("python" if fmi == "2" else "native")
    in_python, torque = backend == "python", interface == TORQUE
    for refused, reason in (
            (fmi not in FORMATS, f"fmi {fmi}: choose {' or '.join(FORMATS)}"),
            (backend not in BACKENDS, f"backend {backend}: choose {' or '.join(BACKENDS)}"),
            (in_python and (platforms is not None or cc is not None),
             "platforms and cc are for backend native: the Python back end compiles nothing"),
            (clock and fmi == "2", "clock is for fmi 3: FMI 2.0 has no clocks"),
            (scalars and fmi == "2", "scalars are for fmi 3: FMI 2.0 has only scalars"),
            (in_python and fmi != "2", f"fmi {fmi} is for backend native: the Python back end exports FMI 2.0"),
            (fins == 1 and files, "files of single fins are for an FMU of several fins: set fins"),
            (interface not in CONNECTIONS, f"interface {interface}: choose {' or '.join(CONNECTIONS)}"),
            (part and torque, f"part {part} has no interface torque: leave one of them out"),
            (inputs != INPUT_SETS[0] and torque, f"inputs {inputs}: with interface torque the fin's motion is an "
             "input; leave inputs out"),
            (inputs != INPUT_SETS[0] and part, f"inputs {inputs}: part {part} has the signals of the other half as "
             "inputs; leave inputs out"),
            ((part or torque) and fins > 1, f"{f'part {part}' if part else 'interface torque'} is for a single fin: "
             "leave fins out, and use an instance for each fin")):
        if refused:
            raise BuildError(reason)
    output = Path(output)
    check_target(output, ".fmu", BuildError)
    parameters = replace(parameters, model=of_fmu(parameters.model, part, interface))
    sets = [parameters] if fins == 1 else fin_sets(parameters, fins, layout, files or {})
    described = FmuInterface(fins, parameters.model, names, inputs, identifier)
    chosen = replace(FORMATS[fmi], clock=clock, scalars=scalars)
    contents, guid, built_for, of_references = _contents(described, sets, backend, platforms, cc, progress or silent,
                                                         chosen, references and not described.actuator.hidden)
    # modelDescription.xml is first, for readers of a stream.
    write_zip(contents, output, lambda name: (name != "modelDescription.xml", name), "binaries/")
    warnings = dict.fromkeys((*(warning for p in sets for warning in p.warnings), *of_references))
    return Built(output, output.stat().st_size, guid, built_for, tuple(warnings))
