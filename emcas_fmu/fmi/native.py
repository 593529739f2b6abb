"""The native back end: C sources of the FMU, and its libraries for every platform."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import fmpy
from pythonfmu import Fmi2Slave

from .. import rules
from ..compiler import PLATFORMS, Compiler, CompilerError, Platform, find, local_platform
from ..errors import BuildError
from ..progress import LOG, Progress
from ..runtime.c_sources import c_number, c_text, core_sources, enumerator, handwritten, header
from .interface import MIXING, FmuInterface
from .model_description import element

MAIN = "fmi2.c"
_WRITTEN = (MAIN, "instance.h", "states.h")
_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")
# fmpy's copy of the standard's header leaves out the prefix that sources linked into one program need.
_NO_PREFIX = "This definition has been changed to add no prefix.\n*/\n#define fmi2FullName(name) name\n"
_PREFIX = """FMI2_FUNCTION_PREFIX, if defined, goes before each name.
*/
#if defined(FMI2_FUNCTION_PREFIX)
#define fmi2Paste(a, b) a ## b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
#else
#define fmi2FullName(name) name
#endif
"""
OPTIONS = {"needsExecutionTool": "false", "canHandleVariableCommunicationStepSize": "true",
           "canInterpolateInputs": "true", "maxOutputDerivativeOrder": "0", "canRunAsynchronuously": "false",
           "canBeInstantiatedOnlyOncePerProcess": "false", "canNotUseMemoryManagementFunctions": "false",
           "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "false"}

# For the page in the FMU: how this back end answers its host.
NOTES = (
    "This unit is compiled from C and needs nothing in its host; <code>sources</code> has the code, and for a host in "
    "C a header with the GUID and the value references.",
    "Inputs are held over a step, or ramp through it with the first derivatives that "
    "<code>fmi2SetRealInputDerivatives</code> gives; derivatives hold for one step.",
    "A call out of place or with an unknown reference is answered with <code>fmi2Error</code> at once, nothing "
    "changed; an input that is not finite with <code>fmi2Error</code> from the step. The instance may be used on.",
    "A step that cannot be followed is answered with <code>fmi2Discard</code>, the state unchanged.",
    "Parameters out of range give <code>fmi2Error</code> at the end of initialization; correct them and repeat the "
    "call. A wrong GUID is refused by <code>fmi2Instantiate</code>.",
)


def interface_header(unit: FmuInterface, starts: Sequence[Any], guid: str, code: str) -> str:
    """Return interface.h: the variables, start values and the unit's identity."""
    rows = ",\n".join(
        f"    {{{c_text(v.name)}, {'INTEGER' if v.items else v.kind.upper()}, {int(v.variability == 'tunable')}, "
        f"{c_number(v.minimum)}, {c_number(v.maximum)}}}" for v in unit.variables)
    values = ",\n".join(f"    {c_number(start)}" for start in starts)
    categories = ", ".join(c_text(name) for name in Fmi2Slave.log_categories)
    formats = "".join(f"static const char {name}[] = {c_text(getattr(rules, name))};\n"
                      for name in ("NOT_FINITE", "BELOW", "ABOVE"))
    return header(
        "interface", "The interface: variables, their places, identity", "#include <math.h>\n\n"
        f"#define MODEL_NAME {c_text(unit.model)}\n#define MODEL_GUID {c_text(guid)}\n"
        f"#define MODEL_STATE {c_text(guid + code)}\n#define LOG_CATEGORIES {{{categories}}}\n\n"
        f"#define FINS {unit.fins}\n\n{_sizes(unit)}\nenum {{ REAL, INTEGER, BOOLEAN }};\n"
        'static const char *const KIND[] = {"Real", "Integer", "Boolean"};\n'
        f"{formats}\n"
        "typedef struct {\n    const char *name;\n    int kind, tunable;\n    double minimum, maximum;\n} variable;\n\n"
        f"static const variable VARIABLE[UNIT_VARIABLES] = {{\n{rows}\n}};\n\n"
        f"static const double START[UNIT_VARIABLES] = {{\n{values}\n}};\n")


def _sizes(unit: FmuInterface) -> str:
    """Return numbers of variables of the whole unit, and where each fin's are."""
    at = unit.reference
    numbers = {"UNIT_INPUTS": len(unit.inputs), "UNIT_OUTPUTS": len(unit.outputs),
               "UNIT_VARIABLES": len(unit.variables),
               "FIN_PARAMETER_BEGIN": len(unit.variables) - unit.fins * len(unit.actuator.parameters),
               "MOTION_BEGIN": at["acceleration.x"],
               "MIXING_BEGIN": at.get(MIXING[0].name, 0)}
    enum = ",\n".join(f"    {name} = {number}" for name, number in numbers.items())
    rows = ",\n".join(f"    {{{', '.join(map(str, row))}}}" for row in unit.places)
    return (f"enum {{\n{enum}\n}};\n\n/* Where each fin's inputs are, in the order of model.h. */\n"
            f"static const unsigned char PLACE[FINS][{len(unit.actuator.inputs)}] = {{\n{rows}\n}};\n")


def names_header(unit: FmuInterface, guid: str) -> str:
    """Return MODEL.h, for a host in C: model identifier, GUID and every variable's value reference as macros.

    ``fin_command`` of EMCAS is ``EMCAS_VR_FIN_COMMAND``, ``fin[2].fin_angle`` of EMCAS4 ``EMCAS4_VR_FIN_2_FIN_ANGLE``.
    """
    prefix = enumerator(unit.model)
    lines = [f"#define {prefix}_MODEL {c_text(unit.model)}", f"#define {prefix}_GUID {c_text(guid)}"]
    taken: set[str] = set()
    for place, v in enumerate(unit.variables):
        name = enumerator(v.name)
        name = f"{name}_{place}" if name in taken else name  # a.b_c and a_b.c are two variables
        taken.add(name)
        kind = "Integer" if v.items else v.kind
        about = ", ".join(filter(None, (v.causality, kind, v.unit if v.kind == "Real" else "")))
        lines.append(f"#define {prefix}_VR_{name} {place}u /* {v.name}: {about} */")
    return header(f"{unit.model}_names", f"{unit.model}: model identifier, GUID and value references for a host",
                  "\n".join(lines) + "\n")


def sources(unit: FmuInterface, starts: Sequence[Any], guid: str) -> dict[str, str]:
    """Return everything needed to compile the unit: file name to text; only `MAIN` is handed to the compiler."""
    headers = Path(fmpy.__file__).parent / "c-code"
    standard = {name: (headers / name).read_text(encoding="utf-8") for name in _HEADERS}
    if _NO_PREFIX not in standard["fmi2Functions.h"]:
        raise BuildError("fmi2Functions.h of this version of fmpy is not as expected: fmpy 0.3.25 to 0.3.32 are known")
    standard["fmi2Functions.h"] = standard["fmi2Functions.h"].replace(_NO_PREFIX, _PREFIX)
    code = {**{name: handwritten(name, "emcas_fmu.fmi.fmi2") for name in _WRITTEN},
            "multi_fin.h": handwritten("multi_fin.h"), **core_sources(unit.fins > 1, unit.kind)}
    digest = hashlib.sha256("\0".join(f"{n}\0{t}" for n, t in sorted(code.items())).encode()).hexdigest()[:16]
    return {**code, **standard, "interface.h": interface_header(unit, starts, guid, digest),
            f"{unit.model}.h": names_header(unit, guid)}


def chosen(platforms: Sequence[str] | None, cc: str | None) -> list[Platform]:
    """Return platforms to build for: those named, else all (with a system compiler: this machine's).

    Raises CompilerError for an unknown one and for one a system compiler cannot build.
    """
    local = local_platform()
    if platforms is None:
        names = list(PLATFORMS) if cc is None else [local.name] if local else []
    else:
        names = list(dict.fromkeys(platforms))
    for name in names:
        if name not in PLATFORMS:
            raise CompilerError(f"--platform {name}: there is {', '.join(PLATFORMS)}")
        if cc is not None and (local is None or name != local.name):
            raise CompilerError(f"--platform {name}: a system compiler (--cc {cc}) builds for "
                                f"{local.name if local else 'no platform known here'} only; leave --cc out to use zig")
    return [PLATFORMS[name] for name in names]


def binaries(model: str, files: Mapping[str, str], platforms: Sequence[Platform], cc: str | None,
             progress: Progress | None = None) -> dict[str, bytes]:
    """Return libraries for the platforms: archive name to content.

    Raises CompilerError if there is no compiler or it refuses.
    """
    compiler: Compiler = find(cc)
    LOG.info(f"compiling {model} for {', '.join(p.name for p in platforms)} (the first time up to a minute each) ...")
    libraries = {}
    for i, target in enumerate(platforms):
        if progress:
            progress(target.name, i, len(platforms))
        libraries[f"binaries/{target.name}/{model}{target.suffix}"] = compiler.library(files, MAIN, target, model)
    if progress:
        progress("", len(platforms), len(platforms))
    return libraries


def build_description(model: str) -> Element:
    """Return buildDescription.xml (FMI 3.0's file) of the sources."""
    prefix = {"name": "FMI2_FUNCTION_PREFIX", "optional": "true", "value": f"{model}_",
              "description": "put before each function's name, to link several units into one program"}
    return element("fmiBuildDescription", {"fmiVersion": "3.0"}, (
        element("BuildConfiguration", {"modelIdentifier": model, "platform": platform}, [
            element("SourceFileSet", {"language": "C11"}, [
                element("SourceFile", {"name": MAIN}), element("PreprocessorDefinition", prefix)]),
            *([] if platform.endswith("windows") else [element("Library", {"name": "m", "external": "true"})])])
        for p in PLATFORMS.values() for platform in p.targets))
