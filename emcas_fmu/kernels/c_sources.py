"""The C of the actuator: what is written by hand beside this file, and the headers generated for it."""

from __future__ import annotations

import math
import re
from importlib.resources import files

from .. import consistency
from ..actuators import NONLINEAR, get
from ..actuators.model import SHOWN, Actuator
from ..consistency import LONGEST_DELAY
from ..ops.c_source import c_source
from ..ops.trace import Tracer
from ..tree import tree
from . import core, program

_MOST_NUMBERS = 12  # of a rule's message: as many as instance.h hands to printf

# gcc does not know the pragma and does not contract under -std=c11; the flag -ffp-contract=off says it to all.
_NO_CONTRACTION = "#if !defined __GNUC__ || defined __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif\n"
_NOTE = "/* {}; generated, do not edit. */\n"


def written(name: str, package: str = "emcas_fmu.kernels") -> str:
    """A source written by hand."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def kernel_header(several: bool = False, model: str = NONLINEAR) -> str:
    """kernel.h: the equations."""
    return (_NOTE.format("The actuator's equations as straight-line code")
            + f"#ifndef EMCAS_KERNEL_H\n#define EMCAS_KERNEL_H\n\n#include <math.h>\n\n{_NO_CONTRACTION}\n"
            f"{program.c_kernel(several, model)}\n#endif\n")


def enumerator(name: str) -> str:
    """A variable's name as part of a C identifier: ``acceleration.x`` gives ACCELERATION_X."""
    return re.sub(r"\W+", "_", name).upper()


def model_header(actuator: Actuator) -> str:
    """model.h: sizes, limits and the places of the inputs."""
    plant, kept, shown = (", ".join(f"(state)->{array}[{i}]" for i in range(len(names))) for array, names in (
        ("x", actuator.plant), ("kept", actuator.kept), ("shown", actuator.shown)))
    # Behind others in a list of arguments, and there may be none.
    held = "".join(f", (state)->shown[{i}]" for i in range(len(SHOWN), len(actuator.shown)))
    own = "".join(f", (inputs)->own[{i}]" for i in range(len(actuator.model.inputs)))
    inputs = "".join(f"    INPUT_{enumerator(v.name)} = {i},\n" for i, v in enumerate(actuator.inputs))
    return (_NOTE.format("Sizes, limits and the order of the inputs")
            + "#ifndef EMCAS_MODEL_H\n#define EMCAS_MODEL_H\n\nenum {\n"
            f"    CORE_LINE = {LONGEST_DELAY + 2},\n    CORE_MOST_EVENTS = {core.MOST_EVENTS},\n"
            f"    CORE_MOST_TICKS = {core.MOST_TICKS},\n    MODEL_INPUTS = {len(actuator.inputs)},\n"
            f"    MODEL_OUTPUTS = {len(actuator.outputs)},\n    MODEL_PARAMETERS = {len(actuator.parameters)},\n"
            f"    CORE_PLANT = {len(actuator.plant)},\n    CORE_KEPT = {len(actuator.kept)},\n"
            f"    CORE_SHOWN = {len(actuator.shown)}\n}};\n\n#define CORE_OWN {len(actuator.model.inputs)}\n"
            f"/* {', '.join(actuator.plant)} */\n#define CORE_PLANT_OF(state) {plant}\n"
            f"/* {', '.join(actuator.kept)} */\n#define CORE_KEPT_OF(state) {kept}\n"
            f"/* {', '.join(actuator.shown)} */\n#define CORE_SHOWN_OF(state) {shown}\n"
            f"#define CORE_HELD_OF(state) {held}\n#define CORE_OWN_OF(inputs) {own}\n\n"
            f"enum {{\n{inputs.rstrip().rstrip(',')}\n}};\n\n#endif\n")


def c_number(value: float) -> str:
    """A number as a C constant."""
    if math.isinf(value):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(float(value))


def c_text(value: str) -> str:
    """A string as a C literal."""
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def rules_header(actuator: Actuator) -> str:
    """rules.h: limits of the parameters, and the rules for sets of them traced from consistency.py."""
    tracer = Tracer()
    p = tree({v.name: tracer.parameter(v.name) for v in actuator.parameters})
    rows = []
    for i, rule in enumerate(consistency.RULES):
        tracer.function(f"check_{i}", ["share"], lambda share, rule=rule: rule.check(tracer, p, share))
        if len(tracer.functions[-1].results) - 1 > _MOST_NUMBERS:
            raise ValueError(f"instance.h prints {_MOST_NUMBERS} numbers of a rule, not those of {rule.message!r}")
        rows.append(f"    {{rules_check_{i}, {int(rule.scanned)}, {c_text(rule.message)}}}")
    limits = ",\n".join(f"    {{{c_number(v.minimum)}, {c_number(v.maximum)}}}" for v in actuator.parameters)
    return (_NOTE.format("What parameters must fulfil")
            + "#ifndef EMCAS_RULES_H\n#define EMCAS_RULES_H\n\n#include <math.h>\n\n"
            "static const struct {\n    double minimum, maximum;\n"
            f"}} LIMIT[] = {{\n{limits}\n}};\n\n{c_source(tracer, 'rules')}\n"
            f"enum {{ RULE_NUMBERS = {_MOST_NUMBERS}, RULE_SCAN = {consistency.SCAN}, RULES = {len(rows)} }};\n\n"
            "typedef struct {\n    void (*check)(const double *restrict, const double *restrict, double, "
            "double *restrict);\n    int scanned;\n    const char *message;\n} rule;\n\n"
            "static const rule RULE[RULES] = {\n" + ",\n".join(rows) + "\n};\n\n#endif\n")


def core_sources(several: bool = False, model: str = NONLINEAR) -> dict[str, str]:
    """Headers that hold the actuator, or what each of several needs: file name to text."""
    actuator = get(model)
    return {"kernel.h": kernel_header(several, model), "model.h": model_header(actuator),
            "rules.h": rules_header(actuator),
            "core.h": written("core.h"), "sound.h": written("sound.h")}
