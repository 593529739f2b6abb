"""Write the generated equations of every model, to compare before and after a change with `diff -r`.

    python -m tests.kernels FOLDER
    python -m tests.kernels --digest    # instead print a digest of each model's equations and declaration
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import EXTENSIONS, NAMES, get, get_extension
from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.namespace import Names
from emcas_fmu.ops.base import Value
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.c_sources import kernel_header, model_header, rules_header
from emcas_fmu.trace.python_source import python_source
from emcas_fmu.trace.tracer import Tracer


def models() -> list[str]:
    """Return every actuator, alone and with each extension that it can have."""
    return [*NAMES, *(f"{name}+{extension}" for name in NAMES for extension in EXTENSIONS
                      if get(name).provides.issuperset(get_extension(extension).needs))]


def write(folder: Path) -> None:
    """Write NAME.h for one fin and NAME_fins.h for several, of every model."""
    folder.mkdir(parents=True, exist_ok=True)
    for model in models():
        for several, ending in ((False, ""), (True, "_fins")):
            (folder / f"{model}{ending}.h").write_text(kernel_header(several, model), encoding="utf-8", newline="\n")


def program(model: str) -> str:
    """Return everything that an actuator computes and declares as text, without printing it as C.

    These are the functions of one fin and several, rules, parameters of the plant as built, the derivatives that linear
    analysis uses, sizes, variables and states.
    """
    actuator, tracer = get(model), Tracer()
    p = actuator.namespace({v.name: tracer.parameter(v.name) for v in actuator.file_entries})
    for number, rule in enumerate(actuator.supply_rules):
        tracer.function(f"supply_rule_{number}", ("share",), partial(rule.check, tracer, p))
    tracer.function("plant", (), lambda: _numbers(actuator.plant_parameters(tracer, p)))
    if actuator.derivatives is not None:
        names = list(dict.fromkeys(name for _, arguments, _ in codegen.functions(actuator) for name in arguments))

        def rates(*values: Value) -> tuple[Value, ...]:
            named = dict(zip(names, values, strict=True))
            u = PlantInputs(**named, enabled=named["enable"], rated_current_limit=None)
            return tuple(actuator.rates(tracer, p, u, u).values())

        tracer.function("rates", names, rates)
    declared = (actuator.states, actuator.controller_states, actuator.sampled_states, actuator.inputs,
                actuator.limited_outputs, actuator.parameters, actuator.nominal, actuator.faults, actuator.structure,
                [rule.message for rule in actuator.supply_rules], sorted(actuator.provides), actuator.descriptions,
                actuator.terminals, actuator.equal_parameters, actuator.tick_remedy)
    return "\n".join((codegen.source(True, model), rules_header(model), model_header(actuator),
                      python_source(tracer, ""), re.sub(r" at 0x\w+", "", repr(declared))))


def _numbers(value: Any) -> Iterator[Value]:
    """Yield the numbers of nested parameters, in the order of their names."""
    if isinstance(value, Names):
        for name, part in sorted(vars(value).items()):
            yield from _numbers(part) if name != "structure" else ()
    elif isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif not isinstance(value, str) and value is not None:
        yield value


if __name__ == "__main__":
    if sys.argv[1:] == ["--digest"]:
        for each in models():
            print(each, sha256(program(each).encode()).hexdigest())
    else:
        write(Path(sys.argv[1]))
