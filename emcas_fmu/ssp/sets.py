"""Parameter sets of an archive from the fins' parameters, and connectors of the system."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from ..actuators import get
from ..actuators.fin_port import ENABLE
from ..fmi.interface import FmuInterface, flat
from ..fmi.units import Unit, fmi_unit
from ..parameters import Entry, ParameterSet, Value
from ..variables import Variable
from .schema import render
from .variants import Variant

Entries = dict[str, Entry]  # by name in the set


@dataclass(frozen=True)
class Wire:
    """A connector of the system, and the component and variable it is wired to."""

    outer: str
    fin: str
    variable: Variable


def outer_name(number: int, name: str, model: str) -> str:
    """Return the system's connector of a fin's variable, such as ``fin1_fin_angle``; ``attitude_roll``, if shared.

    All fins share vehicle motion, supply and enable. OMSimulator accepts no dot in such a name, and fmpy distinguishes
    connectors of the system and of components by their paths alone.
    """
    shared = (*FmuInterface(1, model).shared, ENABLE.name)
    return flat(name if name in shared else f"fin[{number}].{name}")


def wires(model: str, fins: Sequence[str]) -> Iterator[Wire]:
    """Yield the wires of all inputs and outputs of an actuator in each of the components `fins`."""
    for number, fin in enumerate(fins, 1):
        for variable in get(model).inputs + get(model).outputs:
            yield Wire(outer_name(number, variable.name, model), fin, variable)


def inputs_by_entry(model: str) -> dict[str, Variable]:
    """Return the inputs of an actuator whose start value is an entry of the parameter file, by that entry."""
    return {v.key: v for v in get(model).inputs if v.key is not None}


def fmi_units(variables: Iterable[Variable]) -> dict[str, Unit]:
    """Return the units of variables by name."""
    return {name: fmi_unit(name) for name in sorted({v.unit for v in variables if v.kind == "Real"})}


def _entries(parameters: ParameterSet, chosen: Callable[[Entry], bool]) -> Entries:
    """Return the chosen entries of a fin; the start value of an input is under the input's name."""
    inputs = inputs_by_entry(parameters.model)
    variables = {e.variable.name: inputs.get(e.variable.name, e.variable) for e in parameters.entries}
    return {variables[e.variable.name].name: replace(e, variable=variables[e.variable.name])
            for e in parameters.entries if chosen(e)}


def _starts(fins: Sequence[ParameterSet]) -> Entries:
    """Return the start values of the system's connectors; a host feeds 0 to those without one."""
    model, values = fins[0].model, Entries()
    for number, fin in enumerate(fins, 1):
        keyed = _entries(fin, lambda e: e.variable.name in inputs_by_entry(model))
        plain = {v.name: Entry(v, v.start, "", "", "", "") for v in get(model).inputs if v.key is None and v.start}
        values |= {outer_name(number, n, model): e for n, e in {**keyed, **plain}.items()}
    return values


def parameter_sets(variants: Sequence[Variant], fmu_starts: Mapping[str, Value], *, border: bool) -> dict[str, bytes]:
    """Return the parameter sets of all variants as files by name: for each fin one with all its parameters.

    None is split: libcosim and Ecos do not combine sets, and OMSimulator ignores prefixes. `fmu_starts` are the start
    values of the FMU by entry of the parameter file: a Boolean with the same value is left out, as fmpy reads every
    Boolean of a set as true. With a `border` one more set has the start values of the system's inputs.
    """
    files: dict[str, bytes] = {}

    def add(variant: str, of: str, entries: Entries) -> None:
        files[f"{variant}_{of}.ssv"] = render("parameters.xml.j2", name=variant, entries=entries,
                                              units=fmi_units(e.variable for e in entries.values()))

    for variant in variants:
        for name, fin in zip(variant.names, variant.fins):
            add(variant.name, name, _entries(
                fin, lambda e: e.variable.kind != "Boolean" or e.value != fmu_starts[e.variable.name]))
        if border:
            add(variant.name, "system", _starts(variant.fins))
    return files
