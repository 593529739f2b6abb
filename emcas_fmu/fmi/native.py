"""The native back end: C sources of the FMU, and its libraries for every platform."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import fmpy
from pythonfmu import Fmi2Slave

from .. import consistency
from ..compiler import PLATFORMS, Compiler, CompilerError, Platform, find, local_platform
from ..kernels.c_sources import core_sources, written
from ..ops.c_source import c_source
from ..ops.trace import Tracer
from ..tree import tree
from ..variables import PARAMETERS, VARIABLES

MAIN = "fmi2.c"
_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")
_MOST_NUMBERS = 12  # of a rule's message: as many as fmi2.c hands to printf
OPTIONS = {"needsExecutionTool": "false", "canHandleVariableCommunicationStepSize": "true",
           "canInterpolateInputs": "true", "maxOutputDerivativeOrder": "0", "canRunAsynchronuously": "false",
           "canBeInstantiatedOnlyOncePerProcess": "false", "canNotUseMemoryManagementFunctions": "false",
           "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "false"}


def _number(value: float) -> str:
    if math.isinf(value):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(float(value))


def _text(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _rules() -> str:
    """Rules for parameter sets: functions traced from consistency.py, and a table of them."""
    tracer = Tracer()
    p = tree({v.name: tracer.parameter(v.name) for v in PARAMETERS})
    rows = []
    for i, rule in enumerate(consistency.RULES):
        tracer.function(f"check_{i}", ["share"], lambda share, rule=rule: rule.check(tracer, p, share))
        if len(tracer.functions[-1].results) - 1 > _MOST_NUMBERS:
            raise ValueError(f"fmi2.c prints {_MOST_NUMBERS} numbers of a rule, not those of {rule.message!r}")
        rows.append(f"    {{rules_check_{i}, {int(rule.scanned)}, {_text(rule.message)}}}")
    table = ",\n".join(rows)
    return (f"{c_source(tracer, 'rules')}\n"
            f"enum {{ RULE_NUMBERS = {_MOST_NUMBERS}, RULE_SCAN = {consistency.SCAN} }};\n\n"
            "static const struct {\n    void (*check)(const double *restrict, const double *restrict, double, "
            "double *restrict);\n    int scanned;\n    const char *message;\n"
            f"}} RULE[] = {{\n{table}\n}};\n")


def interface_header(model: str, starts: Sequence[Any], guid: str) -> str:
    """interface.h: the variable table, start values, rules and the unit's identity."""
    rows = ",\n".join(
        f"    {{{_text(v.name)}, {v.kind.upper()}, {int(v.variability == 'tunable')}, "
        f"{_number(v.minimum)}, {_number(v.maximum)}}}" for v in VARIABLES)
    values = ",\n".join(f"    {_number(start)}" for start in starts)
    categories = ", ".join(_text(name) for name in Fmi2Slave.log_categories)
    formats = "".join(f"static const char {name}[] = {_text(getattr(consistency, name))};\n"
                      for name in ("NOT_FINITE", "BELOW", "ABOVE"))
    return (
        "/* The interface: variables, rules, identity; generated, do not edit. */\n"
        "#ifndef EMCAS_INTERFACE_H\n#define EMCAS_INTERFACE_H\n\n#include <math.h>\n\n"
        f"#define MODEL_NAME {_text(model)}\n#define MODEL_GUID {_text(guid)}\n"
        f"#define LOG_CATEGORIES {{{categories}}}\n\n"
        f"enum {{ MODEL_VARIABLES = {len(VARIABLES)} }};\nenum {{ REAL, INTEGER, BOOLEAN }};\n"
        'static const char *const KIND[] = {"Real", "Integer", "Boolean"};\n'
        f"{formats}\n"
        "typedef struct {\n    const char *name;\n    int kind, tunable;\n    double minimum, maximum;\n} variable;\n\n"
        f"static const variable VARIABLE[MODEL_VARIABLES] = {{\n{rows}\n}};\n\n"
        f"static const double START[MODEL_VARIABLES] = {{\n{values}\n}};\n\n{_rules()}\n#endif\n")


def sources(model: str, starts: Sequence[Any], guid: str) -> dict[str, str]:
    """Everything needed to compile the unit: file name to text; only `MAIN` is handed to the compiler."""
    headers = Path(fmpy.__file__).parent / "c-code"
    return {MAIN: written(MAIN, "emcas_fmu.fmi"), "interface.h": interface_header(model, starts, guid),
            **core_sources(), **{name: (headers / name).read_text(encoding="utf-8") for name in _HEADERS}}


def chosen(platforms: Sequence[str] | None, cc: str | None) -> list[Platform]:
    """Platforms to build for: those named, else all (with a system compiler: this machine's).

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
             progress: Callable[[str, int, int], None] | None = None) -> dict[str, bytes]:
    """Libraries for the platforms: archive name to content.

    Raises CompilerError if there is no compiler or it refuses.
    """
    compiler: Compiler = find(cc)
    found = {}
    for i, target in enumerate(platforms):
        if progress:
            progress(target.name, i, len(platforms))
        found[f"binaries/{target.name}/{model}{target.suffix}"] = compiler.library(files, MAIN, target, model)
    if progress:
        progress("", len(platforms), len(platforms))
    return found


def build_description(model: str) -> Element:
    """buildDescription.xml (FMI 3.0's file) of the sources."""
    root = Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = SubElement(root, "BuildConfiguration", {"modelIdentifier": model})
    files = SubElement(configuration, "SourceFileSet", {"language": "C11"})
    SubElement(files, "SourceFile", {"name": MAIN})
    SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return root
