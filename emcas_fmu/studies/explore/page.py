"""The explorer's page of an actuator: its C code as WebAssembly, and the data for the page's scripts."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from math import isclose
from pathlib import Path
from typing import Any

from ... import __version__, motions, rules
from ...actuators import capabilities, extension_outputs, fin_port, full_name, get, parts
from ...actuators.declaration import Actuator
from ...bench import measure, metrics
from ...bench.excitation import COMMAND, LOAD, Excitation
from ...bench.frequency_response import PURE
from ...bench.linear import equations
from ...bench.requirements import Requirement, Specification, load_requirements
from ...bench.subject import ParameterSubject, Subject
from ...bench.verdict import SENSES
from ...bench.writers import plain
from ...errors import EmcasError
from ...pages.numbers import typeset
from ...pages.page import page
from ...parameters import Entry, ParameterSet, load_parameters
from ...physics import drive
from ...reference import cases
from ...response import CLIPPED, IN_DEGREES, LIKE_DEGREES, ROUNDING, panel_outputs
from ...runtime.c_sources import MOST_NUMBERS, batch_sources, handwritten, header
from ...runtime.codegen import NamedFunction, traced_functions
from ...runtime.compiled import REASONS
from ...runtime.compiler import WEB, zig
from ...support.files import described_sets
from ...trace.c_source import TEMPLATES, c_source
from ...units import factor
from ...variables import Variable

_HERE = "emcas_fmu.studies.explore"
_MAIN = "explore.c"
_PROGRAM = ("actuator.js", "excitations.js", "metrics.js", "measure.js", "settings.js", "eigenvalues.js", "linear.js",
            "judging.js")  # scripts that both the page and its worker run
_SCRIPTS = ("plots.js", "results.js", "poles.js", "loop.js", "drives.js", "mechanism.js", "controls.js", "drawing.js",
            "page.js")
_LONGEST = 60.0  # s, longest excitation
_MOST_FIRST = 12  # largest number of parameters with sliders, for an actuator without gains
_PLANE = ("motor_speed", "motor_torque")
_HEADLINES = ("rise_time", "settling_time", "overshoot", "held_error", "peak_rate", "peak_current", "energy_drawn")
_NO_LOOP = f"margins need {capabilities.POSITION_LOOP} and derivatives of the states; this actuator does not have both"
_CONSTANTS = {
    "MOST_ROWS": round(_LONGEST / motions.STEP),  # largest number of steps in a CSV file
    **{name: getattr(measure, name) for name in ("BANDWIDTHS", "GRID", "BISECTIONS", "CYCLES", "FITTED", "TRANSIENT",
                                                 "LOOP_LOWEST", "LOOP_POINTS")},
    "STEP": motions.STEP, "LEAD_IN": motions.LEAD_IN, "ACCURACY": metrics.ACCURACY, "HELD": metrics.HELD, "PURE": PURE}


def sources(model: str) -> dict[str, str]:
    """Return the C sources of an actuator's page by file name."""
    limits = ""
    if _limited(get(model)):
        torque: NamedFunction = ("torque", ("supply", "speed"), lambda ops, p, *at: (drive.limit_torque(ops, p, *at),))
        limits = f"#define LIMITS\n{c_source(traced_functions(model, [torque]), 'limits')}"
    return {_MAIN: handwritten(_MAIN, _HERE), **batch_sources(model),
            "limits.h": header("limits", "Limits of motor and drive", f"#include <math.h>\n\n{limits}"),
            "conditions.h": handwritten("conditions.h", _HERE),
            "linear.h": header("linear", "The actuator at rest without quantisation", _linear_functions(model))}


def _linear_functions(model: str) -> str:
    """Return the C functions of linear analysis; empty for an actuator without it.

    With `hold` a function reuses the results of comparisons from the previous call, so that finite differences do not
    cross a discontinuity.
    """
    if not _linear(get(model)):
        return ""
    tracer = equations.program(model)
    conditions = ("less", "less_equal", "greater", "greater_equal", "equal")
    functions = c_source(tracer, "linear", {**TEMPLATES, **{x: f"recorded({TEMPLATES[x]})" for x in conditions}})
    pieces = [f"#include <math.h>\n\n#include \"elementary.h\"\n\n#define LINEAR\n"
              f"enum {{ LINEAR_CONDITIONS = {functions.count('recorded(') + 1} }};\n"
              f"#include \"conditions.h\"\n\n{functions}"]
    for function in tracer.functions:
        arguments = ", ".join(f"x[{k}]" for k in range(len(function.arguments)))
        pieces.append(f"API void at_rest_{function.name}(const double *p, const double *c, const double *x, int hold, "
                      f"double *out)\n{{\n    at_rest_begin(hold);\n    "
                      f"linear_{function.name}(p, c, {arguments}, out);\n}}\n")
    return "\n".join(pieces)


def _linear(actuator: Actuator) -> bool:
    """Return whether the actuator has a position loop and derivatives for linear analysis."""
    return capabilities.POSITION_LOOP in actuator.provides and actuator.derivatives is not None


def _limited(actuator: Actuator) -> bool:
    """Return whether current and supply limit the steady motor torque, and motor torque and speed are outputs."""
    needs = {capabilities.CURRENT_LIMIT, capabilities.VOLTAGE_LIMIT, capabilities.DRIVE_STEP}
    return needs <= actuator.provides and {*_PLANE} <= {v.name for v in actuator.outputs}


def compiled(files: Mapping[str, str]) -> bytes:
    """Compile C sources, by file name, to WebAssembly. Raises EmcasError without zig, CompilerError if this fails."""
    compiler = zig()
    if compiler is None:
        raise EmcasError("emcas explore needs zig, which is not installed: pip install 'emcas-fmu[native]'")
    return compiler.library(files, _MAIN, WEB, "unit")


def packed(code: bytes) -> str:
    """Return WebAssembly as text for a page: compressed (raw deflate, RFC 1951) and encoded in base64."""
    deflate = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
    return base64.b64encode(deflate.compress(code) + deflate.flush()).decode()


def document(subject: ParameterSubject, inputs: Mapping[str, float], specification: Specification) -> dict[str, Any]:
    """Return the data for the page's scripts; `inputs` are constant values [SI] by name, in place of start values."""
    parameters, model, actuator = subject.parameters, full_name(subject.model), subject.actuator
    shipped = load_parameters(model=model).values
    entries = {e.variable.name: e for e in parameters.entries}
    starts = {v.name: inputs.get(v.name, v.initial(parameters.values)) for v in actuator.inputs}
    table = [x for name, x in parameters.values.items() if name.startswith("friction.table.temperature[")]
    return dict(plain({
        "tool": f"emcas {__version__}",
        "model": "+".join((Path(parts(model)[0]).name, *parts(model)[1])),  # without the folder of a user's file
        "parameters": [{**_parameter(entries[v.name]), "shipped": shipped[v.name],
                        "range": (min(table), max(table)) if table and v.name == "friction.temperature" else None}
                       for v in actuator.parameters],
        "inputs": [{**_quantity(v), "value": starts[v.name], "start": v.initial(parameters.values), "key": v.key,
                    "shipped": shipped[v.key] if v.key else None} for v in actuator.inputs],
        "outputs": [v.name for v in actuator.outputs],
        "presets": _presets(parameters, inputs), "plane": _plane(actuator), "linear": _sizes(model),
        "panels": _panels(model, specification), "equal": actuator.equal_parameters,
        "rules": [{"message": rule.message, "warning": rule.warning} for rule in actuator.all_rules],
        "limits": {"not_finite": rules.NOT_FINITE, "below": rules.BELOW, "above": rules.ABOVE},
        "clipping": {"message": CLIPPED, "rounding": ROUNDING, "in_degrees": IN_DEGREES, "like_degrees": LIKE_DEGREES},
        "most_numbers": MOST_NUMBERS + 1, "reasons": REASONS,
        "figures": {name: {"title": each.title, "shown": _shown(each.unit), "needs": each.needs,
                           "reduction": each.reduction} for name, each in metrics.figures_of("jump", "usage").items()},
        "headlines": _HEADLINES, "constants": _CONSTANTS,
        **_judging(specification, subject),
        **_excitations(parameters.values["command.limit"], starts[LOAD], specification.rated_load),
    }))


def _quantity(v: Variable) -> dict[str, Any]:
    title = v.name.removeprefix("controller.").replace(".", " ").replace("_", " ")
    return {"name": v.name, "kind": v.kind, "unit": v.unit, "minimum": v.minimum, "maximum": v.maximum,
            "title": title[0].upper() + title[1:], "description": v.description, "shown": _shown(v.unit)}


def _shown(unit: str, shown: tuple[str, float] | None = None) -> tuple[str, float]:
    """Return the typeset unit in which the page shows a value, and the size of this unit in SI."""
    name, per_si = shown or metrics.shown(unit)
    return typeset(name), 1.0 / per_si


def _presets(parameters: ParameterSet, inputs: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the presets: initial values, conditions of the reference cases cold and sag, sets for this actuator."""
    values, actuator = parameters.values, parameters.actuator
    keys = {v.key: v.name for v in actuator.inputs if v.key}
    (cold,) = cases.select(["cold"], {case.name: case for case in cases.CASES}).values()
    listed = [("initial values", "", {}), ("cold", "The temperature of the reference case cold.", {
        name: x for name, x in cold.overrides.items() if name not in cases.EXACT and values.get(name, x) != x})]
    for v in actuator.inputs:
        if v.name == "supply_voltage":
            lowest = cases.sag(inputs.get(v.name, v.initial(values))).inputs()[v.name].min()
            listed.append(("sag", "The lowest supply of the reference case sag, at all times.", {v.name: lowest}))
    for name, about in described_sets().items():
        try:
            changed = load_parameters(name, base=parameters)
        except EmcasError:  # it is made for another actuator
            continue
        if changed.model == parameters.model:
            listed.append((name, about, {
                keys.get(key, key): x for key, x in changed.values.items() if x != values[key]}))
    return [{"name": name, "about": about, "values": changes} for k, (name, about, changes) in enumerate(listed)
            if changes or not k]


def _plane(actuator: Actuator) -> dict[str, Any] | None:
    """Return supply input and units of the torque-speed plane; None for an actuator without torque limits."""
    if not _limited(actuator):
        return None
    speed, torque = (next(v for v in actuator.outputs if v.name == name) for name in _PLANE)
    assert actuator.supply is not None
    return {"supply": actuator.supply.input.name, "speed": _shown(speed.unit, metrics.shown_output(speed)),
            "torque": _shown(torque.unit, metrics.shown_output(torque))}


def _sizes(model: str) -> dict[str, Any] | None:
    """Return the numbers of states in the functions of linear analysis; None for an actuator without it.

    `kept` is the number of states that samples set: those of the controllers, and sampled states of the plant.
    """
    plain = get(equations.plain(model))
    if not _linear(plain):
        return None
    return {"states": len(plain.states), "sampled": len(plain.sampled_states),
            "kept": len(plain.controller_states) + len(plain.sampled_states),
            "supply": plain.supply.input.name if plain.supply else ""}


def _excitations(limit: float, torque: float, rated_load: float) -> dict[str, Any]:
    """Return the kinds of excitation on the page, and their fields with the sliders' ranges.

    `limit` [rad] is the largest command, `torque` [N.m] the initial hinge torque; the slider of the torque ends at
    twice the `rated_load` [N.m], which is also that of a load step.
    """
    usual_load = {"torque": -rated_load}
    kinds = {name: {"title": kind.title, "rise": kind.rise,
                    "usual": {**kind.usual, **(usual_load if "torque" in kind.usual else {})},
                    "fields": tuple(dict.fromkeys((*kind.fields, "torque")))}
             for name, kind in motions.EXCITATIONS.items() if kind.usual}
    ranges = {"amplitude": (-limit, limit), "frequency": motions.SWEEP, "torque": (-2.0 * rated_load, 2.0 * rated_load)}
    fields = {**motions.FIELDS, "torque": replace(motions.FIELDS["torque"], default=torque)}
    return {"kinds": {**kinds, "csv": {"title": "Your CSV", "usual": {}, "fields": ("torque",)}},
            "fields": [{"unit": field.unit, "title": field.title, "minimum": field.minimum,
                        "maximum": field.within(_LONGEST).maximum, "default": field.default,
                        "name": f"excitation.{name}", "kind": "Real", "shown": _shown(field.unit),
                        "range": ranges.get(name), "value": field.default}
                       for name, field in fields.items()]}


def _parameter(entry: Entry) -> dict[str, Any]:
    """Return a parameter for the page, shown in the unit of its parameter file."""
    v, unit = entry.variable, entry.text.partition(" ")[2]
    shown = typeset(v.unit), 1.0
    if v.kind == "Real" and unit and not entry.text.startswith("as ") and v.unit != "degC":
        size = factor(unit, v.unit)
        if not isclose(size, 1.0):
            shown = typeset(unit.replace("*", ".").replace("^", "")), size
    return {**_quantity(v), "value": entry.value, "source": entry.source, "shown": shown}


def _first(parameters: ParameterSet) -> dict[str, list[str]]:
    """Return the names of values with sliders by legend: supply and inputs, temperatures, gains or else parameters."""
    actuator = parameters.actuator
    tunable = [v for v in actuator.parameters if v.variability == "tunable"]
    gains = [v.name for v in tunable if v.name.startswith("controller.")]
    ports = {v.name for v in fin_port.PARAMETERS}
    others = [v.name for v in get(parts(parameters.model)[0]).parameters if v.name not in ports]
    inputs = [*([actuator.supply.input.name] if actuator.supply else []), *(v.name for v in actuator.further_inputs)]
    inputs += [v.name for v in tunable if v.name == "homing.required"]  # if true, the fin does not move before homing
    return {"Supply" if len(inputs) < 2 else "Supply and inputs": inputs,
            "Temperature": [v.name for v in tunable if v.unit == "degC"],
            "Gains" if gains else "Parameters": gains or others[:_MOST_FIRST]}


def _panels(model: str, specification: Specification) -> list[dict[str, Any]]:
    """Return the panels over time: those of a response plot, then one for each output of the extensions."""
    further = [[v] for v in extension_outputs(model)]
    return [{"title": ", ".join(v.name for v in panel).replace("_", " ").capitalize(), "names": [v.name for v in panel],
             "shown": _shown(panel[0].unit, metrics.shown_output(panel[0])), "discrete": panel[0].kind != "Real",
             "items": [item for item, _ in panel[0].items], "bits": panel[0].bits,
             "rules": _lines(panel[0], specification)} for panel in (*panel_outputs(model), *further)]


def _lines(v: Variable, specification: Specification) -> list[tuple[float, str]]:
    """Return values [deg/s] and texts of the required rates for the panel of the fin rate; empty for other panels."""
    return list(dict.fromkeys((r.shown_limit, f"required {r.shown_limit:.6g} °/s{', loaded' * bool(r.test.torque)}")
                              for r in specification.requirements if r.test and r.test.supply == 1.0
                              if r.figure in ("sustained_rate", "peak_rate") and v == fin_port.FIN_RATE))


def _judging(specification: Specification, subject: Subject) -> dict[str, Any]:
    """Return the requirements, each with the index of its test, the tests, and the parameters of each case."""
    tests: dict[measure.Test, list[Requirement]] = {}
    listed = []
    for r in specification.requirements:
        unit, size = r.shown
        # The page has a linear model of its own, which does not need the extra `analysis`.
        left_out = (("" if _linear(subject.actuator) else _NO_LOOP) if r.test and r.test.kind == "linear" else
                    r.obstacle(subject))
        index = None
        if r.test and not left_out:
            tests.setdefault(r.test, []).append(r)
            index = list(tests).index(r.test)
        listed.append({
            "name": r.name, "title": r.title or r.name, "figure": r.figure, "sense": SENSES[r.sense],
            "limit": r.shown_limit, "unit": typeset(unit), "factor": size, "how": r.how,
            "reason": r.reason or r.source, "cases": r.cases, "test": index, "left_out": left_out})
    return {"requirements": listed, "tests": [_test(test, judged, subject) for test, judged in tests.items()],
            "at_start": subject.at_start,
            "cases": {case.name: {**subject.at_start, **case.values} for case in specification.cases}}


def _test(test: measure.Test, judged: Sequence[Requirement], subject: Subject) -> dict[str, Any]:
    """Return the test that judges requirements; inputs other than command and load are shares of their values."""
    runs: Sequence[Excitation] = ()
    if test.kind == "repeat":
        runs = measure.histories(test, subject, {**dict.fromkeys(subject.inputs, 1.0), COMMAND: 0.0, LOAD: 0.0})
    elif test.kind not in ("sine", "linear"):
        runs = [measure.excitation(replace(test, supply=1.0), sign, subject) for sign in (1.0, -1.0)]
        if test.supply != 1.0:
            runs = [run.holding({subject.supply or "": test.supply}) for run in runs]
    figures = list(dict.fromkeys(r.figure for r in judged))
    return {"kind": test.kind, "amplitude": test.amplitude, "figures": figures, "outputs": measure.recorded(figures),
            "cases": list(dict.fromkeys(name for r in judged for name in r.cases)),
            "runs": [{"stop": run.stop, "begin": run.begin, "columns": {  # values with their counts
                name: [(float(value), len(list(rows))) for value, rows in groupby(column)]
                for name, column in run.columns.items()}} for run in runs]}


def _embedded(value: Any) -> str:
    """Return a value as JSON for a script element."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _dense(name: str) -> str:
    """Return a script without indentation and without comments on lines of their own; no literal may span lines."""
    code = re.sub(r"^ */\*.*?\*/\n", "", handwritten(name, _HERE), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"\n +", "\n", code)


def render(subject: ParameterSubject, inputs: Mapping[str, float], command: str, date: str = "",
           requirements: Path | None = None) -> str:
    """Return the page with initial parameters and constant `inputs` [SI]; the same arguments give the same text.

    `command` is the command line that the page names, `requirements` a file that replaces the shipped ones. Raises
    EmcasError without zig or for an invalid file.
    """
    specification = load_requirements(requirements, subject.parameters)
    content, files = document(subject, inputs, specification), sources(subject.model)
    code = compiled(files)
    digest = hashlib.sha256(_embedded(content).encode() + code).hexdigest()
    source_digest = hashlib.sha256("".join(files.values()).encode()).hexdigest()
    controls = {each["name"]: each for listed in ("fields", "inputs", "parameters") for each in content[listed]}
    texts = {name: {word: each.pop(word, "") for word in ("title", "description", "source")}
             for name, each in controls.items()}
    groups: dict[str, list[str]] = {}
    for each in content["parameters"]:
        groups.setdefault(each["name"].partition(".")[0], []).append(each["name"])
    groups["constant inputs"] = [each["name"] for each in content["inputs"] if each["name"] not in (COMMAND, LOAD)]
    return page(
        "studies/explore/page.html.j2", subject=subject, command=command, date=date, requirements=specification.file,
        digest=digest, source_digest=source_digest, content=content, controls=controls, texts=texts,
        first=_first(subject.parameters), groups=groups,
        data=_embedded({**content, "digest": digest[:12]}), code=packed(code),
        style=handwritten("page.css", _HERE), program="\n".join(map(_dense, _PROGRAM)),
        script="\n".join(map(_dense, _SCRIPTS)))
