"""The Python back end: the slave and the modules that it needs, with pythonfmu's wrapper."""

from __future__ import annotations

import hashlib
from pathlib import Path
from pprint import pformat
from typing import Any

import pythonfmu

from ..actuators import fin_port
from ..errors import BuildError
from ..runtime import codegen
from ..trace.python_source import python_source
from .interface import MIXING, VEHICLE, FmuInterface

# Modules of this package that the slave needs.
_EMBEDDED = ("fmi/__init__.py", *(f"fmi/fmi2/{name}.py" for name in (
    "__init__", "declared", "reporting", "slave", "stored", "wrapper")), "runtime/__init__.py", "runtime/core.py",
    "runtime/multi_fin.py", "rules.py")
# Modules of pythonfmu that the slave needs: its base class, without the builder of FMUs.
_BASE = ("_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables")
_PYTHONFMU = Path(pythonfmu.__file__).resolve().parent
_PACKAGE = Path(__file__).resolve().parent.parent
OPTIONS = {
    "needsExecutionTool": "false", "canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false", "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
    "canNotUseMemoryManagementFunctions": "true"}
TOOL = f"PythonFMU {pythonfmu.__version__}"


def slave_attributes(interface: FmuInterface, starts: tuple[Any, ...], guid: str) -> dict[str, Any]:
    """Return the class attributes of a generated slave (:class:`.fmi2.slave.Slave`), without its equations."""
    actuator = interface.actuator
    # Hosts get enumerations as integers.
    rows = tuple((interface.spelt(v.name), "Integer" if v.items else v.kind, v.variability == "fixed", v.minimum,
                  v.maximum) for v in interface.variables)
    first, end, motion = len(interface.inputs), len(rows) - len(interface.parameters), interface.reference[VEHICLE[0]]
    several = interface.fins > 1
    return {"rows": rows, "start_values": starts, "fmu_guid": guid,
            "inputs": range(first), "outputs": range(first, end), "parameters": range(end, len(rows)),
            "motion": slice(motion, motion + len(VEHICLE)),
            "held": tuple(i for i, v in enumerate(interface.inputs) if v.causality == "parameter"),
            "hidden": tuple(interface.reference[name] for name in sorted(actuator.hidden)),
            "rules": tuple((interface.respelt(rule.message), rule.scanned, rule.warning)
                           for rule in actuator.all_rules),
            "line_rules": tuple((interface.respelt(rule.message), rule.scanned, rule.warning)
                                for rule in (interface.line.rules if interface.line else ())),
            "sizes": codegen.sizes(actuator), "power": codegen.power_index(actuator),
            "names": tuple(interface.spelt(v.name) for v in actuator.parameters), "fin_inputs": interface.fin_inputs,
            "no_supply": f"{actuator.supply.input.name} = 0" if actuator.supply else "",
            "mixing": tuple(interface.reference[v.name] for v in MIXING if several),
            "of_fin": f"{interface.of_fin('%d')}: " if several else "",
            "step_begin": interface.reference.get(fin_port.STEP_BEGIN.name)}


def _sources(interface: FmuInterface, starts: tuple[Any, ...], guid: str) -> dict[str, str]:
    """Return the texts of the embedded package by file name."""
    files = {name: (_PACKAGE / name).read_text(encoding="utf-8") for name in _EMBEDDED}
    files["__init__.py"] = f'"""The EM-CAS actuator, as embedded in {interface.model}.fmu; generated, do not edit."""\n'
    # pythonfmu is embedded inside this package, since a host may have another version of it.
    files["fmi/fmi2/reporting.py"] = files["fmi/fmi2/reporting.py"].replace("from pythonfmu", "from ...pythonfmu")
    files |= {f"pythonfmu/{name}.py": (_PYTHONFMU / f"{name}.py").read_text(encoding="utf-8") for name in _BASE}
    files["pythonfmu/__init__.py"] = (
        '"""The base class of a slave, from PythonFMU; generated, do not edit."""\n\n'
        "from .fmi2slave import Fmi2Slave as Fmi2Slave\n")
    files["kernel.py"] = codegen.source(interface.fins > 1, interface.kind, interface.spelt)
    checks = {"checks": codegen.traced_rules(interface.kind)}
    if interface.line and interface.line.rules:
        checks["line_checks"] = codegen.traced_line_rules(interface.kind)
    files |= {f"{name}.py": python_source(
        tracer, "Rules for the parameters as straight-line code; generated, do not edit.", interface.spelt)
        for name, tracer in checks.items()}
    attributes = "".join(f"    {name} = {pformat(value, width=110)}\n"
                         for name, value in slave_attributes(interface, starts, guid).items())
    files["model.py"] = (
        f'"""The slave class of {interface.model}.fmu: interface table and kernel; generated, do not edit."""\n\n'
        f"from math import inf\n\nfrom . import {', '.join(sorted((*checks, 'kernel')))}\n"
        "from .fmi.fmi2.slave import Slave\n"
        "from .runtime.core import Sizes\n\n\n"
        f"class {interface.model}(Slave):\n    make = staticmethod(kernel.make)\n"
        + "".join(f"    make_{name} = staticmethod({name}.make)\n" for name in checks) + attributes)
    return files


def _libraries(identifier: str) -> dict[str, bytes]:
    """Return pythonfmu's wrappers, which load the slave, by archive name."""
    return {f"binaries/{path.parent.name}/{identifier}{path.suffix}": path.read_bytes()
            for path in sorted((_PYTHONFMU / "resources" / "binaries").glob("*/*"))
            if path.suffix in (".dll", ".so", ".dylib")}


def exported(interface: FmuInterface, starts: tuple[Any, ...], guid: str) -> dict[str, bytes]:
    """Return the files for the archive by name. Raises BuildError if pythonfmu has no libraries."""
    files, model = _sources(interface, starts, guid), interface.model
    digest = hashlib.sha256("\0".join(f"{n}\0{t}" for n, t in sorted(files.items())).encode()).hexdigest()[:12]
    package, script = f"emcas_{digest}", f"emcas_slave_{digest}"
    entry = (f'"""Entry module of {model}.fmu; generated, do not edit."""\n\n'
             f"from {package}.fmi.fmi2.wrapper import keep\nfrom {package}.model import {model}  # noqa: F401\n\n"
             "keep(globals())\n")
    resources = {**{f"{package}/{name}": text for name, text in files.items()}, f"{script}.py": entry,
                 "slavemodule.txt": script}
    libraries = _libraries(interface.identifier)
    if not libraries:
        raise BuildError(f"{_PYTHONFMU}: this version of pythonfmu has no libraries there; reinstall emcas-fmu to get "
                         "a supported one")
    return {**libraries, **{f"resources/{name}": text.encode() for name, text in resources.items()}}
