"""The parameter sets of the archive: SSV files, out of the fins' parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from .. import __version__
from ..actuators import get
from ..actuators.fin_port import ENABLE
from ..fmi.interface import AZIMUTH, FmuInterface
from ..fmi.model_description import to_bytes
from ..fmi.units import fmi_unit
from ..parameters import Entry, ParameterSet, Value
from ..variables import Variable
from .schema import NOMINAL, SSC, SSV
from .variants import Variant, fin_name

TOOL = f"emcas-fmu {__version__}"


@dataclass(frozen=True)
class Item:
    """A parameter or start value as an SSV file has it."""

    name: str
    variable: Variable
    value: Value
    note: str


@dataclass(frozen=True)
class Sets:
    """Files by name below resources/; for each variant the bindings (prefix, file) of the system, and of each fin."""

    files: Mapping[str, bytes]
    system: Mapping[str, Sequence[tuple[str, str]]]
    fins: Mapping[str, Sequence[str]]


def started(model: str) -> dict[str, Variable]:
    """The inputs of an actuator whose start value is in the parameter file, by its entry there."""
    return {v.key: v for v in get(model).inputs if v.key is not None}


def shared_inputs(model: str) -> tuple[str, ...]:
    """Names of the inputs that all fins have in common: vehicle motion, supply and enable."""
    return (*FmuInterface(1, model).shared, ENABLE.name)


def _items(parameters: ParameterSet, wanted: Callable[[Entry], bool], prefix: str = "") -> dict[str, Item]:
    """The entries that are `wanted`, by name."""
    inputs = started(parameters.model)
    return {e.variable.name: _item(e, inputs.get(e.variable.name, e.variable), prefix)
            for e in parameters.entries if wanted(e)}


def _item(entry: Entry, variable: Variable, prefix: str) -> Item:
    note = ": ".join(filter(None, (entry.source, entry.note)))
    return Item(prefix + variable.name, variable, entry.value, note)


def _by_name(parameters: ParameterSet, fmu_starts: Mapping[str, Value], prefix: str = "") -> dict[str, Item]:
    """All values of a fin, but for Booleans as they are in the FMU: fmpy takes every Boolean of a set for true."""
    return _items(parameters, lambda e: e.variable.kind != "Boolean" or e.value != fmu_starts[e.variable.name], prefix)


def parameter_sets(variants: Sequence[Variant], fmu_starts: Mapping[str, Value], base: ParameterSet) -> Sets:
    """The sets of all variants, the first of which is the system as built.

    `fmu_starts` are the start values in the FMU, `base` what the fins have in common; both by entry of the
    parameter file. One file says what all fins share, one what is each fin's own, and for each variant what it
    changes; those are bound by prefix. For hosts that do not compose sets, files below ``flat/`` say it all at once:
    for one fin (bound to its component) and for all fins with hierarchical names.
    """
    built, inputs = variants[0], started(base.model)
    files: dict[str, bytes] = {}

    def add(name: str, items: Mapping[str, Item], title: str = "") -> str:
        files[f"{name}.ssv"] = to_bytes(_ssv(title or name.rpartition("/")[2], tuple(items.values())))
        return f"{name}.ssv"

    names = [fin_name(i + 1) for i in range(len(built.fins))]
    # Each fin has an azimuth of its own; the bus and the inputs' other start values are the system's.
    shared = {n: item for n, item in _by_name(base, fmu_starts).items() if n not in (AZIMUTH, *inputs)}
    add("shared", shared)
    add("inputs", {**_items(built.fins[0], lambda e: e.variable.name in inputs),
                   **{v.name: Item(v.name, v, v.start, "") for v in get(base.model).inputs
                      if v.name in shared_inputs(base.model) and v.start not in (None, 0.0)}})
    for name, fin in zip(names, built.fins):
        add(name, _items(fin, lambda e: e.variable.name not in inputs and (
            e.variable.name == AZIMUTH or e.value != base.values[e.variable.name])))
    composed = [("", "inputs.ssv"), *((f"{n}.", "shared.ssv") for n in names), *((f"{n}.", f"{n}.ssv") for n in names)]
    system = {}
    for variant in variants:
        bindings = list(composed)
        if variant.name != NOMINAL:
            bindings += _changes(variant, built, names, add)
        system[variant.name] = bindings
        complete = [_by_name(fin, fmu_starts) for fin in variant.fins]
        everything = {n: complete[0][n] for n in inputs}
        for name, fin, items in zip(names, variant.fins, complete):
            add(f"flat/{variant.name}_{name}", items, variant.name)
            everything |= {f"{name}.{n}": item for n, item in _by_name(fin, fmu_starts, f"{name}.").items()
                           if n not in inputs}
        add(f"flat/{variant.name}", everything)
    flat = {v.name: [f"flat/{v.name}_{name}.ssv" for name in names] for v in variants}
    return Sets(files, system, flat)


def _changes(variant: Variant, built: Variant, names: Sequence[str],
             add: Callable[[str, Mapping[str, Item]], str]) -> list[tuple[str, str]]:
    """The files of a variant: for the system's inputs, for every fin alike, and for single fins."""
    bindings, inputs = [], started(built.fins[0].model)
    alike = {n for n in (e.variable.name for e in variant.fins[0].entries)
             if any(n == c or n.startswith(f"{c}[") for c in variant.common)
             and len({fin.values[n] for fin in variant.fins}) == 1}
    entries = _items(variant.fins[0], lambda e: e.variable.name in alike)
    bus, common = ({n: i for n, i in entries.items() if (n in inputs) == wanted} for wanted in (True, False))
    if bus:
        bindings.append(("", add(f"{variant.name}_inputs", bus)))
    if common:
        file = add(variant.name, common)
        bindings += [(f"{n}.", file) for n in names]
    for name, fin, before in zip(names, variant.fins, built.fins):
        so_far = {**before.values, **{n: item.value for n, item in entries.items()}}
        if further := _items(fin, lambda e: e.value != so_far[e.variable.name]):  # noqa: B023  called at once
            bindings.append((f"{name}.", add(f"{variant.name}_{name}", further)))
    return bindings


def text(value: Value) -> str:
    """A value as XML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value) if isinstance(value, int) else repr(float(value))


def unit_definitions(parent: Element, namespace: str, names: set[str]) -> None:
    """A Units element with the definitions of these units."""
    if not names:
        return
    units = SubElement(parent, f"{namespace}:Units")
    for name in sorted(names):
        unit = fmi_unit(name)
        base = {base: str(exponent) for base, exponent in unit.exponents.items()}
        base |= {"factor": text(unit.factor)} if unit.factor != 1.0 else {}
        base |= {"offset": text(unit.offset)} if unit.offset else {}
        SubElement(SubElement(units, "ssc:Unit", {"name": name}), "ssc:BaseUnit", base)


def _ssv(name: str, items: Sequence[Item]) -> Element:
    root = Element("ssv:ParameterSet", {"xmlns:ssv": SSV, "xmlns:ssc": SSC, "version": "1.0", "name": name,
                                        "generationTool": TOOL})
    parameters = SubElement(root, "ssv:Parameters")
    for item in items:
        # What it is, and what the number rests on.
        description = "; ".join(filter(None, (item.variable.description, item.note)))
        parameter = SubElement(parameters, "ssv:Parameter", {"name": item.name, "description": description})
        unit = {"unit": item.variable.unit} if item.variable.kind == "Real" else {}
        SubElement(parameter, f"ssv:{item.variable.kind}", {"value": text(item.value), **unit})
    unit_definitions(root, "ssv", {i.variable.unit for i in items if i.variable.kind == "Real"})
    return root
