"""The Python back end: the slave and what it needs, exported through pythonfmu."""

from __future__ import annotations

import hashlib
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from pprint import pformat
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree.ElementTree import fromstring

import pythonfmu
from pythonfmu.builder import FmuBuilder

from ..errors import BuildError
from ..runtime import codegen
from ..trace.python_source import python_source
from .interface import MIXING, VEHICLE, FmuInterface

# What the slave needs of this package, under a name of its own in the FMU.
_EMBEDDED = ("fmi/__init__.py", "fmi/fmi2/__init__.py", "fmi/fmi2/slave.py", "runtime/__init__.py",
             "runtime/core.py", "rules.py")
_SEVERAL = ("fmi/fmi2/multi_fin_slave.py", "runtime/multi_fin.py")
_PACKAGE = Path(__file__).resolve().parent.parent
_OPTIONS = {"needsExecutionTool": False, "canHandleVariableCommunicationStepSize": True, "canInterpolateInputs": False,
            "canBeInstantiatedOnlyOncePerProcess": False, "canGetAndSetFMUstate": True, "canSerializeFMUstate": True}
# For the page in the FMU: how this back end answers its host.
NOTES = (
    "This unit computes in Python: its host's process must have Python 3.10 or later loaded, as "
    "<code>externalDependencies.txt</code> says.",
    "Inputs are held over a step: this unit does not interpolate them and takes no input derivatives.",
    "A call out of place, a write to what cannot be set, or an input that is not finite is logged, and the next step "
    "is answered with <code>fmi2Discard</code>, the state unchanged. So is a step that cannot be followed.",
    "A reference that is unknown or of another type is logged where it is used and harms no step: what is read is NaN, "
    "0 or false; a write goes nowhere, which standard error tells, too.",
    "Parameters out of range are logged at the end of initialization, which returns <code>fmi2OK</code>; every step is "
    "then discarded. A wrong GUID is not noticed.",
)
TOOL = f"PythonFMU {pythonfmu.__version__}"


def slave_attributes(unit: FmuInterface, starts: tuple[Any, ...], guid: str) -> dict[str, Any]:
    """Return what a slave class says of a unit besides its equations (:class:`.fmi2.slave.Slave`)."""
    actuator = unit.actuator
    # Enumerations are got as integers are.
    rows = tuple((unit.spelt(v.name), "Integer" if v.items else v.kind, v.causality, v.variability, v.minimum,
                  v.maximum) for v in unit.variables)
    one = {"rows": rows, "start_values": starts, "unit_guid": guid, "motion": unit.reference[VEHICLE[0]],
           "rules": tuple((unit.respelt(rule.message), rule.scanned, rule.warning) for rule in actuator.all_rules),
           "sizes": tuple(codegen.sizes(actuator)), "power": codegen.power_place(actuator)}
    return one if unit.fins == 1 else {
        **one, "names": tuple(unit.spelt(v.name) for v in actuator.parameters), "places": unit.places,
        "mixing": tuple(unit.reference[v.name] for v in MIXING), "of_fin": unit.of_fin("%d"),
        "line_start": codegen.line_start(actuator)}


def _sources(unit: FmuInterface, starts: tuple[Any, ...], guid: str) -> dict[str, str]:
    """Return the embedded package: file name to text."""
    several = unit.fins > 1
    embedded = _EMBEDDED + _SEVERAL if several else _EMBEDDED
    files = {name: (_PACKAGE / name).read_text(encoding="utf-8") for name in embedded}
    files["__init__.py"] = f'"""The EM-CAS actuator, as embedded in {unit.model}.fmu; generated, do not edit."""\n'
    files["kernel.py"] = codegen.source(several, unit.kind, unit.spelt)
    files["checks.py"] = python_source(codegen.traced_rules(unit.kind),
                                       "Rules for the parameters as straight-line code; generated, do not edit.",
                                       unit.spelt)
    base, module = ("MultiFinSlave", "multi_fin_slave") if several else ("Slave", "slave")
    attributes = "".join(f"    {name} = {pformat(value, width=110)}\n"
                         for name, value in slave_attributes(unit, starts, guid).items())
    files["model.py"] = (
        f'"""The slave class of {unit.model}.fmu: interface table and kernel; generated, do not edit."""\n\n'
        f"from math import inf\n\nfrom . import checks, kernel\nfrom .fmi.fmi2.{module} import {base}\n\n\n"
        f"class {unit.model}({base}):\n    make = staticmethod(kernel.make)\n"
        f"    make_checks = staticmethod(checks.make)\n{attributes}")
    return files


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


def exported(unit: FmuInterface, starts: tuple[Any, ...], guid: str) -> tuple[dict[str, bytes], dict[str, str]]:
    """Return what goes into the archive (name to content), and the attributes of its CoSimulation element."""
    files, model = _sources(unit, starts, guid), unit.model
    digest = hashlib.sha256("\0".join(f"{n}\0{t}" for n, t in sorted(files.items())).encode()).hexdigest()[:12]
    package, script = f"emcas_{digest}", f"emcas_slave_{digest}"
    entry = (f'"""Entry module of {model}.fmu; generated, do not edit."""\n\n'
             f"from {package}.fmi.fmi2.slave import keep\nfrom {package}.model import {model}  # noqa: F401\n\n"
             "keep(globals())\n")
    with TemporaryDirectory(prefix="emcas_build_") as temporary:
        folder = Path(temporary)
        for name, text in (*((f"{package}/{name}", text) for name, text in files.items()), (f"{script}.py", entry)):
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8", newline="\n")
        with _clean_imports(package, script):
            archive = FmuBuilder.build_FMU(folder / f"{script}.py", dest=folder / f"{model}.fmu",
                                           project_files={folder / package}, **_OPTIONS)
        with zipfile.ZipFile(archive) as built:
            contents = {name: built.read(name) for name in built.namelist() if not name.endswith("/")}
    simulation = fromstring(contents["modelDescription.xml"]).find("CoSimulation")
    if simulation is None:
        raise BuildError("pythonfmu wrote no CoSimulation element: this version of it is not supported")
    return contents, {k: v for k, v in simulation.attrib.items() if k != "modelIdentifier"}
