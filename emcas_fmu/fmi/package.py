"""From a parameter set to an FMU file, through pythonfmu; the same inputs give the same bytes."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID
from xml.etree.ElementTree import fromstring

import pythonfmu
from pythonfmu.builder import FmuBuilder

from .. import __version__
from ..errors import EmcasError
from ..kernels import program
from ..parameters import ParameterSet
from ..variables import VARIABLES
from .documentation import documents
from .model_description import MODEL, model_description, start_values, terminals_and_icons, to_bytes

# What the slave needs of this package, under a name of its own in the FMU.
_EMBEDDED = ("consistency.py", "fmi/__init__.py", "fmi/slave.py", "kernels/__init__.py", "kernels/core.py",
             "ops/__init__.py", "ops/base.py", "ops/floats.py", "physics/__init__.py", "physics/friction.py")
_PACKAGE = Path(__file__).resolve().parent.parent
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest date a ZIP archive can hold
_OPTIONS = {"needsExecutionTool": True, "canHandleVariableCommunicationStepSize": True, "canInterpolateInputs": False,
            "canBeInstantiatedOnlyOncePerProcess": False, "canGetAndSetFMUstate": True, "canSerializeFMUstate": True}


class BuildError(EmcasError):
    """The FMU cannot be built; the message says why and what to do."""


@dataclass(frozen=True)
class Built:
    """What was built: the file, its size [bytes], the GUID and the platforms it has binaries for."""

    path: Path
    size: int
    guid: str
    platforms: tuple[str, ...]


def _tool() -> str:
    # Not platform.python_version(): any supported Python gives the same FMU.
    return f"emcas-fmu {__version__} with PythonFMU {pythonfmu.__version__}"


def _guid(starts: tuple[Any, ...]) -> str:
    """A hash of the interface: of the model description with its GUID left empty."""
    description = to_bytes(model_description(starts, "", options={}, tool=""))
    return f"{{{UUID(bytes=hashlib.sha256(description).digest()[:16], version=5)}}}"


def _sources(starts: tuple[Any, ...], guid: str) -> dict[str, str]:
    """The embedded package: file name to text."""
    rows = [(v.name, v.kind, v.causality, v.variability, v.minimum, v.maximum) for v in VARIABLES]
    listing = "".join(f"    {row!r},\n" for row in rows).replace("-inf", "-INF").replace(" inf", " INF")
    files = {name: (_PACKAGE / name).read_text(encoding="utf-8") for name in _EMBEDDED}
    files["__init__.py"] = f'"""The EM-CAS actuator, as embedded in {MODEL}.fmu; generated, do not edit."""\n'
    files["kernel.py"] = program.source()
    files["model.py"] = (
        f'"""The slave class of {MODEL}.fmu: interface table and kernel; generated, do not edit."""\n\n'
        "from math import inf as INF\n\nfrom . import kernel\nfrom .fmi.slave import Slave, Table\n\n"
        f"ROWS = (\n{listing})\n\nSTART = {starts!r}\n\n\n"
        f"class {MODEL}(Slave):\n    make = staticmethod(kernel.make)\n"
        f"    table = Table(ROWS, START, {guid!r})\n"
    )
    return files


def _entry(package: str) -> str:
    return (f'"""Entry module of {MODEL}.fmu; generated, do not edit."""\n\n'
            f"from {package}.fmi.slave import keep\nfrom {package}.model import {MODEL}  # noqa: F401\n\n"
            "keep(globals())\n")


@contextmanager
def _clean_imports(*packages: str) -> Iterator[None]:
    """Undo what the exporter leaves behind: its search path and the modules it imported."""
    path = list(sys.path)
    bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.path[:] = path
        sys.dont_write_bytecode = bytecode
        for name in [n for n in sys.modules if n.partition(".")[0] in packages]:
            del sys.modules[name]


def _exported(files: Mapping[str, str], folder: Path) -> dict[str, bytes]:
    """What pythonfmu makes of the embedded sources: archive name to content."""
    digest = hashlib.sha256("\0".join(f"{n}\0{t}" for n, t in sorted(files.items())).encode()).hexdigest()[:12]
    package = f"emcas_{digest}"
    for name, text in files.items():
        target = folder / package / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8", newline="\n")
    script = folder / f"emcas_slave_{digest}.py"
    script.write_text(_entry(package), encoding="utf-8", newline="\n")
    with _clean_imports(package, script.stem):
        archive = FmuBuilder.build_FMU(
            script, dest=folder / f"{MODEL}.fmu", project_files={folder / package}, **_OPTIONS)
    with zipfile.ZipFile(archive) as built:
        return {name: built.read(name) for name in built.namelist() if not name.endswith("/")}


def _contents(parameters: ParameterSet) -> tuple[dict[str, bytes], str]:
    starts = start_values(parameters.values)
    guid = _guid(starts)
    with tempfile.TemporaryDirectory(prefix="emcas_build_") as folder:
        contents = _exported(_sources(starts, guid), Path(folder))
    exporter = fromstring(contents["modelDescription.xml"])
    simulation = exporter.find("CoSimulation")
    if simulation is None:
        raise BuildError("pythonfmu wrote no CoSimulation element: this version of it is not supported")
    options = {k: v for k, v in simulation.attrib.items() if k != "modelIdentifier"}
    contents["modelDescription.xml"] = to_bytes(model_description(starts, guid, options=options, tool=_tool()))
    contents["terminalsAndIcons/terminalsAndIcons.xml"] = to_bytes(terminals_and_icons())
    contents.update(documents(parameters, guid))
    return contents, guid


def _archive(contents: Mapping[str, bytes], target: Path) -> None:
    # modelDescription.xml first: readers that stream find it at once.
    names = sorted(contents, key=lambda name: (name != "modelDescription.xml", name))
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in names:
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, contents[name])


def build(parameters: ParameterSet, output: Path) -> Built:
    """Write the FMU of a parameter set to `output`, whole or not at all.

    Raises BuildError if the file cannot be written.
    """
    if output.suffix != ".fmu":
        raise BuildError(f"{output}: the output must end in .fmu")
    if output.is_dir() or not output.parent.is_dir():
        raise BuildError(f"{output}: {'is a folder' if output.is_dir() else f'there is no folder {output.parent}'}")
    contents, guid = _contents(parameters)
    partial = output.with_name(f".{output.name}.{os.getpid()}.part")
    try:
        _archive(contents, partial)
        partial.replace(output)
    except OSError as error:
        raise BuildError(f"{output}: cannot be written ({error.strerror or error})") from error
    finally:
        partial.unlink(missing_ok=True)
    platforms = sorted({name.split("/")[1] for name in contents if name.startswith("binaries/")})
    return Built(output, output.stat().st_size, guid, tuple(platforms))
