"""C sources of an actuator: the handwritten files in this folder, and the generated headers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files

from .. import rules
from ..actuators import NONLINEAR, fin_port, get
from ..actuators.declaration import Actuator
from ..actuators.fin_port import LONGEST_DELAY
from ..actuators.positional import identifier
from ..control import command_bus
from ..physics.loads import LOADS
from ..trace import elementary
from ..trace.c_source import c_elementary, c_number, c_source
from ..trace.tracer import Tracer
from ..trace.vector_source import vector_elementary, vector_source
from . import codegen, core
from .schedule import Schedule

MOST_NUMBERS = 12  # largest number of values in a rule's message: as many as instance.h passes to printf

# gcc does not know the pragma, but fuses no multiply-add with -std=c11. -ffp-contract=off forbids it to all compilers.
_NO_CONTRACTION = "#if !defined __GNUC__ || defined __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif\n"


def handwritten(name: str, package: str = "emcas_fmu.runtime") -> str:
    """Return the text of a handwritten source."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def header(name: str, content: str, body: str) -> str:
    """Return the text of NAME.h: an include guard around `body`, and a comment with its `content`."""
    guard = f"EMCAS_{name.upper()}_H"
    return f"/* {content}; generated, do not edit. */\n#ifndef {guard}\n#define {guard}\n\n{body}\n#endif\n"


def kernel_header(several: bool = False, model: str = NONLINEAR) -> str:
    """Return kernel.h: the equations."""
    equations = c_source(codegen.traced(several, model), "kernel")
    return header("kernel", "The actuator's equations as straight-line code",
                  f"#include <math.h>\n\n#include \"elementary.h\"\n\n{_NO_CONTRACTION}\n{equations}")


def elementary_header() -> str:
    """Return elementary.h: elementary functions, such as sine, with the same results on every platform."""
    return header("elementary", "Elementary functions as straight-line code",
                  "#include <math.h>\n#include <stdint.h>\n#include <string.h>\n\n"
                  f"{_NO_CONTRACTION}\n{c_elementary(elementary.traced())}")


def batch_sources(model: str = NONLINEAR) -> dict[str, str]:
    """Return the sources of an actuator's library for Python by file name; the first file is the one to compile."""
    return {**{name: handwritten(name) for name in ("batch.c", "many.h", "tables.h")}, **core_sources(model=model)}


def vector_sources(model: str = NONLINEAR) -> dict[str, str]:
    """Return the sources of an actuator's library of vectors by file name; the first file is the one to compile."""
    equations = f"{vector_elementary(elementary.traced())}\n{vector_source(codegen.traced(False, model), 'vector')}"
    return {**{name: handwritten(name) for name in ("vectors.c", "vector.h", "many.h", "tables.h")},
            "vector_kernel.h": header("vector_kernel", "The actuator's equations for many at once",
                                      f'#include "vector.h"\n\n{_NO_CONTRACTION}\n{equations}'),
            **core_sources(model=model)}


def enumerator(name: str) -> str:
    """Return a variable's name as part of a C identifier: ``acceleration.x`` becomes ACCELERATION_X."""
    return identifier(name).upper()


def model_header(actuator: Actuator) -> str:
    """Return model.h: sizes, limits, the indices of the inputs, and macros for the arguments of the equations."""
    def listed(array: str, count: int, first: int = 0) -> str:
        """Return `count` elements of an array, each after a comma."""
        return "".join(f", {array}[{i}]" for i in range(first, first + count))

    plant, controller, motion, loads, acting = codegen.sizes(actuator)
    sampled, further = len(actuator.sampled_states), actuator.further_inputs
    inputs = "".join(f"    INPUT_{enumerator(v.name)} = {i},\n" for i, v in enumerate(actuator.inputs))
    names = [v.name for v in actuator.inputs]
    supply = names.index(actuator.supply.input.name) if actuator.supply else -1
    stores_charge = actuator.supply is not None and actuator.supply.course is not None
    charged = "#define MODEL_CHARGED /* the fins store charge */\n" if stores_charge else ""
    power, line = codegen.power_index(actuator), actuator.supply.line if actuator.supply else None
    line_parameters, line_states = (len(line.parameters), len(line.states)) if line else (0, 0)
    states, controller_states, sampled_states = (", ".join(s.name for s in group) or "none" for group in (
        actuator.states, actuator.controller_states, actuator.sampled_states))
    return header(
        "model", "Sizes, limits and the order of the inputs", "enum {\n"
        f"    CORE_LINE = {LONGEST_DELAY + 2 + command_bus.LONGEST_LATENCY},\n"
        f"    CORE_MOST_EVENTS = {core.MOST_EVENTS},\n    CORE_MOST_TICKS = {core.MOST_TICKS},\n"
        f"    MODEL_INPUTS = {len(names)},\n    MODEL_OUTPUTS = {len(actuator.outputs)},\n"
        f"    MODEL_PARAMETERS = {len(actuator.parameters)},\n    CORE_PLANT = {plant},\n"
        f"    CORE_CONTROLLER = {controller},\n    CORE_SAMPLED = {controller + 2 + sampled},\n"
        f"    CORE_LOADS = {loads},\n    CORE_MOTION_LOADS = {loads - 1},\n"
        f"    MODEL_MOTION = {motion}\n}};\n\n"
        f"/* Messages of core_result. */\n#define CORE_REASONS {{{', '.join(map(c_text, core.REASONS))}}}\n"
        "/* Numbers of inputs beyond the fin port's, and of those that act on the plant, which come first. */\n"
        f"#define CORE_FURTHER {len(further)}\n#define CORE_ACTING {acting}\n"
        "/* Index of the supply among the inputs, and of its power among the outputs; -1 if there is none. */\n"
        f"#define MODEL_SUPPLY ({supply})\n#define MODEL_SUPPLY_POWER ({-1 if power is None else power})\n"
        "/* The line that feeds several fins: its parameters and states, and whether the first state is a sag. */\n"
        f"#define MODEL_LINE_PARAMETERS {line_parameters}\n"
        f"#define MODEL_LINE_OF(line) {listed('(line)', line_parameters)}\n"
        f"#define MODEL_LINE_STATES {max(line_states, 1)}\n"
        f"#define MODEL_LINE_STATES_OF(states) {listed('(states)', line_states)}\n"
        f"#define MODEL_LINE_SAGS {int(line is not None and line.sags)}\n"
        f"{charged}/* {states} */\n#define CORE_PLANT_OF(state) {listed('(state)->x', plant)[2:]}\n"
        f"/* {controller_states} */\n#define CORE_CONTROLLER_OF(state) {listed('(state)->sampled', controller)}\n"
        "/* measured fin angle, whether a limit was met */\n"
        f"#define CORE_SHOWN_OF(state) {listed('(state)->sampled', 2, controller)[2:]}\n"
        f"/* {sampled_states} */\n#define CORE_HELD_OF(state) {listed('(state)->sampled', sampled, controller + 2)}\n"
        f"/* {', '.join(v.name for v in fin_port.VEHICLE_MOTION)} */\n"
        f"#define MODEL_MOTION_OF(motion) {listed('(motion)', motion)[2:]}\n"
        f"/* {', '.join(LOADS)} */\n#define CORE_LOADS_OF(inputs) {listed('(inputs)->loads', loads)}\n"
        f"#define CORE_FURTHER_OF(inputs) {listed('(inputs)->further', len(further))}\n"
        f"#define CORE_ACTING_OF(inputs) {listed('(inputs)->further', acting)}\n\n"
        f"#define CORE_SCHEDULE {', '.join(Schedule._fields)}\n"
        "/* Number of ticks from zero to the latest start. */\n"
        f"#define CORE_LATEST {c_number(core.LATEST)}\n\n"
        f"enum {{\n{inputs.rstrip().rstrip(',')}\n}};\n")


def c_text(value: str) -> str:
    """Return a string as a C literal."""
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _rule_rows(some: Sequence[rules.Rule], tracer: Tracer, prefix: str, worded: Callable[[str], str]) -> str:
    rows = []
    for i, (rule, function) in enumerate(zip(some, tracer.functions, strict=True)):
        if len(function.results) - 1 > MOST_NUMBERS:
            raise ValueError(f"the message of a rule has more than {MOST_NUMBERS} numbers: {rule.message!r}")
        message = c_text(worded(rule.message))
        rows.append(f"    {{{prefix}_check_{i}, {int(rule.scanned)}, {int(rule.warning)}, {message}}}")
    return ",\n".join(rows)


def rules_header(model: str, worded: Callable[[str], str] = str, several: bool = False) -> str:
    """Return rules.h: limits of parameters, and rules for their combinations, with messages changed by `worded`.

    For `several` fins it also has the rules of their line.
    """
    actuator, tracer = get(model), codegen.traced_rules(model)
    of_line = actuator.supply.line.rules if several and actuator.supply else ()
    line = codegen.traced_line_rules(model)
    line_text = (f"\n{c_source(line, 'line_rules')}\nstatic const rule LINE_RULE[LINE_RULES] = {{\n"
                 f"{_rule_rows(of_line, line, 'line_rules', worded)}\n}};\n") if of_line else ""
    limits = ",\n".join(f"    {{{c_number(v.minimum)}, {c_number(v.maximum)}}}" for v in actuator.parameters)
    return header(
        "rules", "Limits and rules of the parameters",
        "#include <math.h>\n\n#include \"elementary.h\"\n\nstatic const struct {\n    double minimum, maximum;\n"
        f"}} LIMIT[] = {{\n{limits}\n}};\n\n{c_source(tracer, 'rules')}\n"
        f"enum {{ RULE_NUMBERS = {MOST_NUMBERS}, RULE_SCAN = {rules.SCAN}, RULES = {len(actuator.all_rules)} }};\n\n"
        "typedef struct {\n    void (*check)(const double *restrict, const double *restrict, double, "
        "double *restrict);\n    int scanned, warning;\n    const char *message;\n} rule;\n\n"
        f"static const rule RULE[RULES] = {{\n{_rule_rows(actuator.all_rules, tracer, 'rules', worded)}\n}};\n\n"
        f"#define LINE_RULES {len(of_line)}\n{line_text}")


def core_sources(several: bool = False, model: str = NONLINEAR, worded: Callable[[str], str] = str) -> dict[str, str]:
    """Return the headers of an actuator, or of each of `several` fins, by file name.

    `worded` changes the parameters' names in messages to the names that a user sees.
    """
    return {"elementary.h": elementary_header(), "kernel.h": kernel_header(several, model),
            "model.h": model_header(get(model)), "rules.h": rules_header(model, worded, several),
            **{name: handwritten(name) for name in ("core.h", "core_state.h", "scalar.h", "parameter_checks.h")}}
