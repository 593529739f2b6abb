"""The parameter sets of the archive: SSV files, out of the fins' parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from ..actuators import get
from ..actuators.fin_port import ENABLE
from ..fmi.interface import AZIMUTH, FmuInterface
from ..fmi.units import Unit, fmi_unit
from ..parameters import Entry, ParameterSet, Value
from ..variables import Variable
from .schema import NOMINAL, render
from .variants import Variant

Entries = dict[str, Entry]  # by name in the set
Add = Callable[[str, Entries], str]


def started(model: str) -> dict[str, Variable]:
    """Return the inputs of an actuator whose start value is in the parameter file, by its entry there."""
    return {v.key: v for v in get(model).inputs if v.key is not None}


def shared_inputs(model: str) -> tuple[str, ...]:
    """Return the names of the inputs that all fins have in common: vehicle motion, supply and enable."""
    return (*FmuInterface(1, model).shared, ENABLE.name)


def fmi_units(variables: Iterable[Variable]) -> dict[str, Unit]:
    """Return the units of variables by name."""
    return {name: fmi_unit(name) for name in sorted({v.unit for v in variables if v.kind == "Real"})}


def _entries(parameters: ParameterSet, chosen: Callable[[Entry], bool]) -> Entries:
    """Return the chosen entries of a fin; the start value of an input stands under the input's name."""
    inputs = started(parameters.model)
    variables = {e.variable.name: inputs.get(e.variable.name, e.variable) for e in parameters.entries}
    return {variables[e.variable.name].name: replace(e, variable=variables[e.variable.name])
            for e in parameters.entries if chosen(e)}


def _complete(parameters: ParameterSet, fmu_starts: Mapping[str, Value]) -> Entries:
    """Return all of a fin but for Booleans as they are in the FMU: fmpy takes every Boolean of a set for true."""
    return _entries(parameters, lambda e: e.variable.kind != "Boolean" or e.value != fmu_starts[e.variable.name])


def _starts(fins: Sequence[ParameterSet]) -> Entries:
    """Return the start values that the system's connectors have: of inputs all fins share, and of each fin's own."""
    model, values = fins[0].model, Entries()
    shared = shared_inputs(model)
    for number, fin in enumerate(fins, 1):
        keyed = _entries(fin, lambda e: e.variable.name in started(model))
        plain = {v.name: Entry(v, v.start, "", "", "", "") for v in get(model).inputs if v.key is None and v.start}
        values |= {n if n in shared else f"fin[{number}].{n}": e for n, e in {**keyed, **plain}.items()}
    return values


def parameter_sets(variants: Sequence[Variant], fmu_starts: Mapping[str, Value],
                   base: ParameterSet) -> tuple[dict[str, bytes], dict[str, list[tuple[str, str]]]]:
    """Return the sets of all variants, the first of which is the system as built, and what each binds at the system.

    The sets are files by name below resources/, the bindings of a variant are prefixes and files. `fmu_starts` are the
    start values in the FMU, `base` what the fins have in common; both by entry of the parameter file. One file says
    what all fins share, one what is each fin's own, and for each variant what it changes; those are bound by prefix.
    For hosts that do not compose sets, files below ``flat/`` say it all at once: for one fin (bound to its component)
    and for all fins with hierarchical names.
    """
    built, inputs = variants[0], started(base.model)
    names, of_inputs = built.names, {v.name for v in inputs.values()}
    files: dict[str, bytes] = {}

    def add(name: str, entries: Entries, title: str = "") -> str:
        files[f"{name}.ssv"] = render("parameters.xml.j2", name=title or name, entries=entries,
                                      units=fmi_units(e.variable for e in entries.values()))
        return f"{name}.ssv"

    # Each fin has an azimuth of its own; start values of inputs are those of the system's connectors.
    add("shared", {n: e for n, e in _complete(base, fmu_starts).items() if n != AZIMUTH and n not in of_inputs})
    add("inputs", _starts(built.fins))
    for name, fin in zip(names, built.fins):
        add(name, _entries(fin, lambda e: e.variable.name not in inputs and (
            e.variable.name == AZIMUTH or e.value != base.values[e.variable.name])))
    bindings = {}
    for variant in variants:
        changes = [] if variant.name == NOMINAL else _changes(variant, built, add)
        bindings[variant.name] = [("", "inputs.ssv"), *((f"{n}.", "shared.ssv") for n in names),
                                  *((f"{n}.", f"{n}.ssv") for n in names), *changes]
        complete = {name: _complete(fin, fmu_starts) for name, fin in zip(names, variant.fins)}
        for name, entries in complete.items():
            add(f"flat/{variant.name}_{name}", entries, variant.name)
        everything = {n: e for n, e in _starts(variant.fins).items() if e.variable.key is not None}
        for name, entries in complete.items():
            everything |= {f"{name}.{n}": e for n, e in entries.items() if n not in of_inputs}
        add(f"flat/{variant.name}", everything, variant.name)
    return files, bindings


def _changes(variant: Variant, built: Variant, add: Add) -> list[tuple[str, str]]:
    """Add the files of a variant: for the system's inputs, for every fin alike, and for single fins."""
    bindings, names = [], built.names
    before = _starts(built.fins)
    if changed := {n: e for n, e in _starts(variant.fins).items() if e.value != before[n].value}:
        bindings.append(("", add(f"{variant.name}_inputs", changed)))
    every = {n: v for n, v in variant.fins[0].values.items() if n not in started(built.fins[0].model)}
    alike = {n for n, value in every.items() if all(fin.values[n] == value for fin in variant.fins)
             and any(fin.values[n] != value for fin in built.fins)}
    if common := _entries(variant.fins[0], lambda e: e.variable.name in alike):
        file = add(variant.name, common)
        bindings += [(f"{n}.", file) for n in names]
    for name, fin, origin in zip(names, variant.fins, built.fins):
        own = {n for n in every if n not in alike and fin.values[n] != origin.values[n]}
        if further := _entries(fin, lambda e: e.variable.name in own):  # noqa: B023  called at once
            bindings.append((f"{name}.", add(f"{variant.name}_{name}", further)))
    return bindings
