"""The native back end: C sources of the FMU, and its libraries for every platform."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from typing import Any
from xml.etree.ElementTree import Element

from pythonfmu import Fmi2Slave

from .. import rules
from ..actuators import fin_port
from ..errors import BuildError
from ..runtime.c_sources import c_text, core_sources, enumerator, handwritten, header
from ..runtime.compiler import PLATFORMS, Compiler, CompilerError, Platform, find, local_platform, universal
from ..support.progress import LOG, Progress
from ..trace.c_source import c_number
from .description import element
from .fmi3.absent import absent_header
from .fmi3.arrays import CLOCK, Array
from .format import FORMATS, Format
from .interface import MIXING, FmuInterface

# Names of the types of FMI 3.0 in interface.h.
_TYPES = {"Float64": "FLOAT64", "Int32": "INT32", "UInt32": "UINT32", "Enumeration": "INT64", "Boolean": "BOOL",
          "Clock": "TICKS"}


def interface_header(interface: FmuInterface, starts: Sequence[Any], guid: str, code: str, fmi: Format) -> str:
    """Return interface.h: variables, start values, the FMU's name and GUID; `code` is a hash of the other sources."""
    rows = ",\n".join(
        f"    {{{c_text(interface.spelt(v.name))}, {'INTEGER' if v.items else v.kind.upper()}, "
        f"{int(v.variability == 'tunable')}, {int(v.name in interface.actuator.hidden)}, {c_number(v.minimum)}, "
        f"{c_number(v.maximum)}}}"
        for v in interface.variables)
    values = ",\n".join(f"    {c_number(start)}" for start in starts)
    categories = ", ".join(c_text(name) for name in Fmi2Slave.log_categories)
    formats = "".join(f"static const char {name}[] = {c_text(getattr(rules, name))};\n"
                      for name in ("NOT_FINITE", "BELOW", "ABOVE", "TOO_LATE", "UNCONNECTED", "NO_VARIABLE"))
    supply = interface.actuator.supply
    arrays = _arrays(interface, fmi) if fmi.is_3 else ""
    begin = interface.reference.get(fin_port.STEP_BEGIN.name)
    step_begin = "" if begin is None else f"#define STEP_BEGIN {begin} /* an input that the FMU sets */\n"
    return header(
        "interface", "The interface: variables, their indices, identity", "#include <math.h>\n\n"
        f"/* Prefix of the functions' names, unless the compiler defines another. */\n#ifndef {fmi.prefix}\n"
        f"#define {fmi.prefix} {interface.identifier}_\n#endif\n\n"
        f"#define MODEL_NAME {c_text(interface.model)}\n#define MODEL_GUID {c_text(guid)}\n"
        f"#define MODEL_STATE {c_text(guid + code)}\n#define LOG_CATEGORIES {{{categories}}}\n\n"
        f"#define FINS {interface.fins}\n/* Prefix of a fin's messages. */\n"
        f"#define OF_FIN {c_text(interface.of_fin('%u') + ': ')}\n\n{_sizes(interface)}{step_begin}\n"
        "enum { REAL, INTEGER, BOOLEAN };\n"
        'static const char *const KIND[] = {"Real", "Integer", "Boolean"};\n'
        f"{formats}static const char NO_SUPPLY[] = {c_text(f'{supply.input.name} = 0' if supply else '')};\n\n"
        "typedef struct {\n    const char *name;\n    int kind, tunable, hidden;\n    double minimum, maximum;\n"
        "} variable;\n\n"
        f"static const variable VARIABLE[FMU_VARIABLES] = {{\n{rows}\n}};\n\n"
        f"static const double START[FMU_VARIABLES] = {{\n{values}\n}};\n{arrays}")


def _sizes(interface: FmuInterface) -> str:
    """Return C code with the numbers of variables, and the indices of each fin's inputs."""
    at = interface.reference
    numbers = {"FMU_INPUTS": len(interface.inputs), "FMU_OUTPUTS": len(interface.outputs),
               "FMU_VARIABLES": len(interface.variables),
               "FMU_TUNABLES": sum(v.variability == "tunable" for v in interface.parameters),
               "FIN_PARAMETER_BEGIN": len(interface.variables) - interface.fins * len(interface.actuator.parameters),
               "MOTION_BEGIN": at["acceleration.x"],
               "MIXING_BEGIN": at.get(MIXING[0].name, 0)}
    enum = ",\n".join(f"    {name} = {number}" for name, number in numbers.items())
    rows = ",\n".join(f"    {{{', '.join(map(str, row))}}}" for row in interface.fin_inputs)
    return (f"enum {{\n{enum}\n}};\n\n/* The indices of each fin's inputs, in the order of model.h. */\n"
            f"static const unsigned char INPUT_INDEX[FINS][{len(interface.actuator.inputs)}] = {{\n{rows}\n}};\n")


def _arrays(interface: FmuInterface, fmi: Format) -> str:
    """Return the C code of FMI 3.0: indices of the elements of each variable, and constants for clock and events."""
    listed = fmi.listed(interface)
    rows = ",\n".join(f"    {{{c_text(interface.spelt(v.variable.name))}, {_TYPES[v.kind]}, {v.first}, {v.table or 1}, "
                      f"{v.fins or 1}, {v.stride}}}" for v in listed)
    actuator = interface.actuator
    sample_time = [v.name for v in actuator.parameters].index("controller.sample_time")
    outputs = [v.name for v in actuator.outputs]
    fin_rate = f"#define OUTPUT_FIN_RATE {outputs.index('fin_rate')}\n" if "fin_rate" in outputs else ""
    names = ", ".join(c_text(_host_type(kind)) for kind in _TYPES)
    return ("\n/* Types of FMI 3.0, and the indices of the elements of a variable: the first fin has `size` of them "
            f"from `first` on,\n * those of the next fin begin at `first` + `stride`. */\n"
            f"enum {{ {', '.join(_TYPES.values())} }};\n"
            f"static const char *const TYPE[] = {{{names}}};\n\n"
            "typedef struct {\n    const char *name;\n    int type;\n"
            "    unsigned first, size, fins, stride;\n} array;\n\n"
            f"enum {{ TIME = {len(fmi.variables(interface)) + 1}, ARRAYS = {len(listed) + 1} }};\n"
            f"#define CLOCK_NAME {c_text(CLOCK.name)}\n"
            f"static const array ARRAY[ARRAYS] = {{\n    {{\"\", -1, 0, 1, 1, 0}}, /* no variable */\n{rows}\n}};\n\n"
            "/* The index of the sample time among a fin's parameters, and of fin_rate, if any, among its outputs. */\n"
            f"enum {{ SAMPLE_TIME = {sample_time} }};\n{fin_rate}")


def _host_type(kind: str) -> str:
    """Return a type of FMI 3.0 as hosts in C see it."""
    return "Enumeration (Int64)" if kind == "Enumeration" else kind


def _about(array: Array, fmi: Format) -> str:
    """Return causality, type, unit and number of elements of a variable as a comment."""
    v, shape = array.variable, " x ".join(map(str, array.dimensions))
    kind = _host_type(array.kind) if fmi.is_3 else "Integer" if v.items else v.kind
    unit = v.unit if v.kind == "Real" else ""
    return ", ".join(filter(None, (v.causality, kind, unit, shape and f"{shape} values")))


def names_header(interface: FmuInterface, guid: str, fmi: Format) -> str:
    """Return IDENTIFIER.h for a host in C, with macros for model identifier, GUID and every variable's value reference.

    ``fin_command`` of EMCAS is ``EMCAS_VR_FIN_COMMAND``, ``fin[2].fin_angle`` of EMCAS4 ``EMCAS4_VR_FIN_2_FIN_ANGLE``.
    """
    prefix, token = enumerator(interface.identifier), "TOKEN" if fmi.is_3 else "GUID"
    lines = [f"#define {prefix}_MODEL {c_text(interface.identifier)}", f"#define {prefix}_{token} {c_text(guid)}"]
    used: set[str] = set()
    for reference, array in fmi.references(interface):
        spelt, name = interface.spelt(array.variable.name), enumerator(array.variable.name)
        name = f"{name}_{reference}" if name in used else name  # a.b_c and a_b.c would have the same name
        used.add(name)
        lines.append(f"#define {prefix}_VR_{name} {reference}u /* {spelt}: {_about(array, fmi)} */")
    title = f"{interface.identifier}: model identifier, {token} and value references for a host"
    return header(f"{interface.identifier}_names", title, "\n".join(lines) + "\n")


def sources(interface: FmuInterface, starts: Sequence[Any], guid: str, fmi: Format = FORMATS["2"]) -> dict[str, str]:
    """Return all source files by name, without the standard's headers, which an importer has.

    The format's `main` includes the others and is the file to compile. Raises BuildError if the model identifier is the
    name of an included header.
    """
    code = {**{file.name: file.read_text(encoding="utf-8") for folder in (f"fmi{fmi.version}", "common")
               for file in files("emcas_fmu.fmi").joinpath(folder).iterdir() if file.name.endswith((".c", ".h"))},
            "multi_fin.h": handwritten("multi_fin.h"),
            **core_sources(interface.fins > 1, interface.kind, interface.respelt)}
    if fmi.is_3:
        code["absent.h"] = absent_header(fmi.standard_headers()["fmi3FunctionTypes.h"])
    digest = hashlib.sha256("\0".join(f"{n}\0{t}" for n, t in sorted(code.items())).encode()).hexdigest()[:16]
    code["interface.h"] = interface_header(interface, starts, guid, digest, fmi)
    included = {name.lower() for text in code.values() for name in re.findall(r'#include ["<](.+)[">]', text)}
    names = f"{interface.identifier}.h"
    if names.lower() in included:
        raise BuildError(f"identifier {interface.identifier}: {names} is one of the sources' headers; choose another")
    return {**code, names: names_header(interface, guid, fmi)}


def chosen(platforms: Sequence[str] | None, cc: str | None) -> list[Platform]:
    """Return the platforms with these names of FMI 2.0 or 3.0; by default all, or with `cc` that of this machine.

    Raises CompilerError for an unknown platform, or one for which the system compiler `cc` cannot build.
    """
    local = local_platform()
    if platforms is None:
        names = list(PLATFORMS) if cc is None else [local.name if local else "of this machine"]
    else:
        by_machine = {machine: p.name for p in PLATFORMS.values() for machine in p.targets}  # FMI 3.0's names
        names = list(dict.fromkeys(by_machine.get(name, name) for name in platforms))
    for name in names:
        if name not in PLATFORMS:
            raise CompilerError(f"platform {name}: choose from {', '.join(PLATFORMS)}")
        if cc is not None and (local is None or name != local.name):
            raise CompilerError(f"platform {name}: a system compiler (cc {cc}) builds only for "
                                f"{local.name if local else 'this machine'}; leave cc out to use zig")
    return [PLATFORMS[name] for name in names]


def binaries(identifier: str, files: Mapping[str, str], platforms: Sequence[Platform], cc: str | None,
             progress: Progress, fmi: Format) -> dict[str, bytes]:
    """Return the libraries for the platforms by archive name, compiled in parallel on all processors.

    Raises CompilerError if there is no compiler or it fails.
    """
    compiler: Compiler = find(cc)
    LOG.info(f"compiling {identifier} for {', '.join(p.name for p in platforms)} "
             "(the first time up to a minute each) ...")
    libraries: dict[str, bytes] = {}
    files = {**files, **fmi.standard_headers()}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        compiled = pool.map(lambda target: compiler.libraries(
            files, fmi.main, target, identifier, (f"-D{fmi.no_prefix}",)), platforms)
        for i, target in enumerate(platforms):
            progress(target.name, i, len(platforms))
            by_folder = next(compiled)
            if not fmi.is_3:  # darwin64 serves both kinds of Mac, but some importers look for aarch64-darwin
                by_folder = {target.name: universal(list(by_folder.values()))} | {
                    folder: library for folder, library in by_folder.items() if folder == "aarch64-darwin"}
            libraries |= {f"binaries/{folder}/{identifier}{target.suffix}": library
                          for folder, library in by_folder.items()}
    progress("", len(platforms), len(platforms))
    return libraries


def build_description(identifier: str, fmi: Format) -> Element:
    """Return the root of buildDescription.xml (FMI 3.0): a configuration for all platforms, and two for Windows.

    The definition that removes the functions' prefix is optional: only tools that build a shared library need it.
    """
    no_prefix = element("PreprocessorDefinition", {
        "name": fmi.no_prefix, "optional": "true", "description": "for a shared library: functions without prefix"})
    return element("fmiBuildDescription", {"fmiVersion": "3.0"}, (
        element("BuildConfiguration", {"modelIdentifier": identifier, "platform": platform}, [
            element("SourceFileSet", {"language": "C99"}, [element("SourceFile", {"name": fmi.main}), no_prefix]),
            *([] if platform else [element("Library", {"name": "m", "external": "true"})])])
        for platform in (None, "x86_64-windows", "x86-windows")))
