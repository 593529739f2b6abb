"""Compiles what `native.py` measures: the yardstick, the timing host, the FMU's own sources.

All with the same compiler (`cc`, or what CC in the environment says) and flags, parameters out of the shipped
parameter set.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import fmpy
from fmpy import extract

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.fmi.description import to_bytes
from emcas_fmu.fmi.format import FORMATS
from emcas_fmu.fmi.interface import FmuInterface, start_values
from emcas_fmu.fmi.model_description import model_description

FLAGS = ("-O2", "-std=c11", "-ffp-contract=off", "-Wall", "-Wextra")
SHARED = ("-fPIC", "-shared", "-fvisibility=default")
YARDSTICK = "yardstick"
_FOLDER = Path(__file__).parent / "native"
_HEADERS = Path(fmpy.__file__).parent / "c-code"  # of FMI


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name)


def _number(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else repr(float(value))


def header(values: Mapping[str, Any]) -> str:
    """C header of value references (VR_...) and parameters (P_..., SI; polynomials as initialisers)."""
    lines = [f"#define VR_{_identifier(v.name)} {i}" for i, v in enumerate(FmuInterface(1).variables)
             if v.causality != "parameter"]
    arrays: dict[str, list[str]] = {}
    for v in get(NONLINEAR).file_entries:
        if v.name.endswith("]"):
            arrays.setdefault(v.name.partition("[")[0], []).append(_number(values[v.name]))
        else:
            lines.append(f"#define P_{_identifier(v.name)} {_number(values[v.name])}")
    lines += [f"#define P_{_identifier(name)} {{{', '.join(items)}}}" for name, items in arrays.items()]
    return "\n".join([*lines, ""])


def compile_c(source: Path, target: Path, *options: str, includes: tuple[Path, ...] = ()) -> Path:
    """Compile one C file to `target` with the flags common to all."""
    command = [*shlex.split(os.environ.get("CC", "cc")), *FLAGS, *options, *(f"-I{i}" for i in includes),
               str(source), "-o", str(target), "-lm"]
    try:
        done = subprocess.run(command, check=False)
    except OSError as error:
        raise SystemExit(f"no C compiler: {command[0]} ({error.strerror}); set CC") from error
    if done.returncode:
        raise SystemExit(f"{source.name} was not compiled by {command[0]}")
    return target


def compile_host(values: Mapping[str, Any], folder: Path) -> Path:
    """The timing host."""
    (folder / "parameters.h").write_text(header(values), encoding="utf-8")
    return compile_c(_FOLDER / "host.c", folder / "host", includes=(folder, _FOLDER))


def compile_yardstick(values: Mapping[str, Any], folder: Path, *options: str) -> Path:
    """The yardstick's library for these parameters, in a folder of its own."""
    folder.mkdir(exist_ok=True)
    (folder / "parameters.h").write_text(header(values), encoding="utf-8")
    return compile_c(_FOLDER / "yardstick.c", folder / f"{YARDSTICK}.so", *SHARED, *options, includes=(folder, _FOLDER))


def packed(values: Mapping[str, Any], library: Path) -> Path:
    """An FMU of the yardstick's library beside it, for hosts that take only FMUs.

    Without the parameters, which are compiled in: hosts that keep account of every variable are faster for it.
    """
    root = model_description(FORMATS["2"], FmuInterface(1), start_values(FmuInterface(1), [values]), YARDSTICK)
    simulation = root.find("CoSimulation")
    assert simulation is not None
    simulation.set("modelIdentifier", YARDSTICK)
    simulation.set("canHandleVariableCommunicationStepSize", "true")
    variables = root.find("ModelVariables")
    assert variables is not None
    for variable in [v for v in variables if v.get("causality") == "parameter"]:
        variables.remove(variable)
    for unknown in root.iter("Unknown"):
        unknown.attrib = {"index": unknown.attrib["index"]}
    target = library.parent / f"{YARDSTICK}.fmu"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", to_bytes(root))
        archive.write(library, f"binaries/linux64/{library.name}")
    return target


class Unpacked:
    """An FMU in a folder: what a C host is told of it, and its C sources compiled with the common flags."""

    def __init__(self, fmu: Path, folder: Path) -> None:
        self.fmu, self.folder = fmu, Path(extract(str(fmu), unzipdir=str(folder)))
        root = fromstring((self.folder / "modelDescription.xml").read_bytes())
        simulation = root.find("CoSimulation")
        assert simulation is not None
        self.guid, self.identifier = root.attrib["guid"], simulation.attrib["modelIdentifier"]
        self.resources = (self.folder / "resources").as_uri()
        self.library = self.folder / "binaries" / "linux64" / f"{self.identifier}.so"

    def compiled(self) -> Path:
        """The library of its sources/fmi2.c."""
        return compile_c(self.folder / "sources/fmi2.c", self.folder / f"{self.identifier}.so", *SHARED,
                         "-DFMI2_OVERRIDE_FUNCTION_PREFIX", includes=(_HEADERS,))
