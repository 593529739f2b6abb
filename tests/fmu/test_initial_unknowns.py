"""InitialUnknowns: declared dependencies of initial outputs, compared with the effect of every input and parameter."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from math import isnan
from pathlib import Path
from typing import Any

import pytest
from fmpy import extract, instantiate_fmu, read_model_description

from emcas_fmu.fmi.description import initial_dependencies
from emcas_fmu.fmi.interface import FmuInterface, fin_sets, start_values
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.codegen import initial_values
from emcas_fmu.variables import Variable
from tests.fmu.built import slave_class
from tests.marks import others_slow

UNITS = [FmuInterface(1, kind) for kind in (
    "nonlinear", "second-order", "ristanovic", "elastic+heat+homing+faults", "nonlinear+supply", "worm-gear",
    "series-clutch", "electrohydrostatic", "electrohydraulic")] + [
    FmuInterface(4), FmuInterface(2, "electrohydraulic")]
# Start values at which outputs react that do not react at the shipped values, and a fin that starts at its stop.
AWAY = {"loads.gravity": True, "fin.start_angle": 0.1, "attitude.roll": 0.5, "homing.required": False,
        "supply.one_way": False, "bus.source_resistance": 0.1, "bus.charge": 100.0, "bus.charge_used": 80.0}
AT_STOP = {"command.limit": 0.05, "fin.start_angle": 0.2, "fin.stop_angle": 0.2}


def sets_of(unit: FmuInterface) -> list[Mapping[str, Any]]:
    shipped = load_parameters(model=unit.kind)
    return [each.values for each in ([shipped] if unit.fins == 1 else fin_sets(shipped, unit.fins))]


class Starting:
    """A Python FMU in initialization mode; a call returns its outputs for start values, None if it refuses them."""

    def __init__(self, unit: FmuInterface) -> None:
        self.slave: Any = slave_class(unit, sets_of(unit))(instance_name="starting")
        self.slave.setup_experiment(0.0)
        self.slave.enter_initialization_mode()
        self.kinds = [("integer" if v.items else v.kind.lower(), i, v) for i, v in enumerate(unit.variables)]
        self.values: Mapping[str, Any] = {}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, Any] | None:
        for kind, i, v in self.kinds:
            if v.causality != "output" and (v.name not in self.values or self.values[v.name] != values[v.name]):
                getattr(self.slave, f"set_{kind}")([i], [values[v.name]])
        self.values = dict(values)
        outputs = {v.name: getattr(self.slave, f"get_{kind}")([i])[0] for kind, i, v in self.kinds
                   if v.causality == "output"}
        return None if any(map(isnan, outputs.values())) else outputs


def changed(v: Variable, value: Any, rng: random.Random) -> Any:
    """Return another value of a variable: near the present one, anywhere, or a limit."""
    if v.kind == "Boolean":
        return not value
    # Initialization refuses no value of an input.
    low, high = (-1e3, 1e3) if v.causality == "input" else (max(v.minimum, -1e3), min(v.maximum, 1e3))
    near = value * rng.choice([0.5, 0.9, 1.1, 2.0]) + (0.0 if value else rng.gauss(0.0, 0.1))
    other = rng.choice([min(max(near, low), high), rng.uniform(low, high), low, high])
    return int(other) if v.kind == "Integer" else other


def points(unit: FmuInterface, outputs_at: Starting, rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yield start values that the FMU accepts: the shipped ones, two chosen sets, and a random one."""
    shipped = dict(zip(unit.reference, start_values(unit, sets_of(unit)), strict=True))
    for point in ({}, AWAY, AT_STOP):
        yield {name: point.get(name.rpartition("].")[2], value) for name, value in shipped.items()}
    values = dict(shipped)
    for v in (*unit.inputs, *unit.parameters):
        before, values[v.name] = values[v.name], changed(v, values[v.name], rng)
        if rng.random() < 0.7 or outputs_at(values) is None:
            values[v.name] = before
    yield values


# Actuators whose cases are not marked slow: rigid drive line, no drive line, switched drive, supply, hydraulics.
QUICK = ("nonlinear", "second-order", "ristanovic", "nonlinear+supply", "electrohydraulic")


@pytest.mark.parametrize("unit", others_slow(UNITS, lambda unit: unit.fins == 1 and unit.kind in QUICK),
                         ids=lambda unit: unit.model)
def test_declared_dependencies_contain_all_observed_ones(unit: FmuInterface) -> None:
    """An output with declared dependencies reacts to at least one of them."""
    outputs_at, rng = Starting(unit), random.Random(16)
    reacts: dict[str, set[str]] = {v.name: set() for v in unit.outputs}
    ranges, lines = initial_values(unit.kind), {v.name for v in unit.line_outputs}
    for values in points(unit, outputs_at, rng):
        before = outputs_at(values)
        assert before is not None
        for v in (*unit.inputs, *unit.parameters):
            smaller = 0.9 * values[v.name] if v.kind == "Real" else values[v.name]
            for other in (smaller, *(changed(v, values[v.name], rng) for _ in range(3))):
                after = outputs_at({**values, v.name: other}) or before
                for name in before:
                    if name.rpartition("].")[2] in ranges and name not in lines:
                        low, high, _ = ranges[name.rpartition("].")[2]]
                        assert low <= after[name] <= high, name
                    if after[name] != before[name]:
                        reacts[name].add(v.name)
    declared = initial_dependencies(unit)
    for name, observed in reacts.items():
        assert observed <= set(declared[name]), name
    assert {name for name, names in declared.items() if names} == {name for name, names in reacts.items() if names}


@pytest.mark.fmu
@pytest.mark.parametrize("backend", ["python", "native"])
def test_end_of_initialization_does_not_change_the_outputs(
        units: Mapping[str, Path], backend: str) -> None:
    folder = extract(str(units[backend]))
    description = read_model_description(folder)
    references = {v.name: (v.type, v.valueReference) for v in description.modelVariables}
    instance = instantiate_fmu(folder, description, "CoSimulation")
    unit = FmuInterface(1)
    outputs_at = Starting(unit)

    def outputs() -> dict[str, Any]:
        return {v.name: getattr(instance, f"get{kind}")([reference])[0]
                for v in unit.outputs for kind, reference in [references[v.name]]}

    for values in points(unit, outputs_at, random.Random(17)):
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        for v in (*unit.inputs, *unit.parameters):
            kind, reference = references[v.name]
            getattr(instance, f"set{kind}")([reference], [values[v.name]])
        before = outputs()
        instance.exitInitializationMode()
        assert before == outputs() == outputs_at(values)
        instance.reset()
    instance.freeInstance()
