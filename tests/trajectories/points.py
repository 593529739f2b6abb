"""Results of a model's functions at single points: random parameters and inputs, states near those of a random walk.

Points include states that hardly occur in a simulated history: a speed of exactly zero under a large load, a fin at its
stop with a disabled drive, a controller's state beyond its limit.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import asinh, isfinite
from typing import Any

from emcas_fmu.actuators import get
from emcas_fmu.actuators.declaration import Actuator, PlantInputs
from emcas_fmu.actuators.positional import identifier
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.physics.loads import LOADS
from emcas_fmu.runtime import codegen

from .runs import OTHER, mark

SETS, PERIODS = 6, 24
NOT_FINITE = -99.0
# Parameters whose change would change the ticks of a walk.
_TIMING = {"controller.sample_time", "drive.transport_delay", "solver.max_tick"}
_SIZES = {"rad": 0.4, "N.m": 200.0, "m/s2": 60.0, "rad/s": 6.0, "rad/s2": 150.0}  # of inputs, by unit


def varied(draw: random.Random, minimum: float, maximum: float, value: float) -> float:
    """Return a random value within its limits, most often near the present value."""
    value = value * draw.choice((0.2, 0.7, 0.9, 1.1, 1.5, 5.0, -1.0)) + draw.choice((0.0, 0.0, 1e-3))
    return min(max(value, minimum), maximum)


def points(model: str) -> dict[str, list[float]]:
    """Return, for each function of a model, the mark of each of its results over all points."""
    actuator, draw, columns = get(model), random.Random(5), dict[str, list[list[float]]]()
    for values in _parameters(load_parameters(model=model), draw):
        p, functions = actuator.namespace(values), codegen.make(False, model)(values)
        for values_by_name in _arguments(actuator, values, draw):
            for (name, arguments, _), function in zip(codegen.functions(actuator), functions, strict=True):
                columns.setdefault(name, []).append(_results(function, *(values_by_name[a] for a in arguments)))
            if actuator.derivatives is not None:
                columns.setdefault("rates", []).append(_results(_rates, actuator, p, PlantInputs(**values_by_name)))
    return {name: [float(f"{mark(column):.12g}") for column in zip(*_of_one_length(rows), strict=True)]
            for name, rows in columns.items()}


def _of_one_length(rows: Sequence[list[float]]) -> Iterator[list[float]]:
    """Yield the results of each call; a call that raised has NOT_FINITE for each result."""
    length = max(map(len, rows))
    return (row or [NOT_FINITE] * length for row in rows)


def _rates(actuator: Actuator, p: Any, values_by_name: PlantInputs) -> Iterable[Any]:
    return actuator.rates(FLOATS, p, values_by_name, values_by_name).values()


def _parameters(p: ParameterSet, draw: random.Random) -> Iterator[Mapping[str, Any]]:
    """Yield values: shipped ones, ones with every term of the equations, both with random changes, and mostly zeros."""
    numbers = [v for v in p.actuator.parameters if v.kind == "Real" and v.name not in _TIMING]
    switches = [v.name for v in p.actuator.parameters if v.kind == "Boolean"]
    for count in range(SETS):
        values = dict(p.values if count % 2 == 0 else p.with_values(p.having(OTHER)).values)
        if count > 1:
            values |= {v.name: varied(draw, v.minimum, v.maximum, values[v.name])
                       for v in draw.sample(numbers, len(numbers) // 10)}
            values |= {name: not values[name] for name in switches if draw.random() < 0.3}
        yield values
    yield {**p.values, **{v.name: 0.0 for v in numbers if v.minimum == 0.0 and draw.random() < 0.8}}


def _arguments(actuator: Actuator, values: Mapping[str, Any], draw: random.Random) -> Iterator[dict[str, Any]]:
    """Yield the arguments of an actuator's functions, by name, after each sample of a random walk."""
    core = codegen.core(values, actuator.name)
    states, controller_states = [s.name for s in actuator.states], [s.name for s in actuator.controller_states]
    names = (*states, *controller_states, "measured", "limited", *(s.name for s in actuator.sampled_states))
    largest = dict.fromkeys(names, 0.0)
    period, _, _, _, *ticks = core.schedule[:6]
    for count in range(PERIODS):
        row = [_input(v, values, draw) for v in actuator.inputs]
        acting = codegen.core_inputs(core, row, actuator)
        try:
            core.run((count + 1) * period, acting)
        except (ArithmeticError, ValueError):
            core.start()
        plant, sampled = core.state[2:4]
        values_by_name: dict[str, Any] = {}
        for name, x in zip(names, map(float, (*plant, *sampled)), strict=True):
            largest[name] = max(largest[name], abs(x))
            values_by_name[name] = draw.choice(
                (x, x, x, x, x, -x, 0.0, 1.5 * x, draw.uniform(-1.0, 1.0) * largest[name]))
        values_by_name |= {identifier(v.name): x for v, x in zip(actuator.inputs, row, strict=True)}
        values_by_name |= dict(zip(LOADS, acting[1:], strict=False))
        volts = draw.choice((0.0, draw.uniform(-40.0, 40.0), sampled[0]))
        supply = 0.0 if actuator.supply is None else values_by_name[identifier(actuator.supply.input.name)]
        values_by_name |= {"command": acting[0], "supply": supply, "enabled": values_by_name["enable"], "active": volts,
                  "reference": volts, "h": draw.choice((*ticks, 0.2 * ticks[-1])), "rated_current_limit": None,
                  "time": (count + draw.choice((0.0, 0.3, 0.999, 1.0))) * period}
        yield values_by_name


def _input(v: Any, values: Mapping[str, Any], draw: random.Random) -> Any:
    if v.kind == "Boolean":
        return draw.random() < (0.8 if v.start else 0.3)
    if v.key is not None:  # the supply
        return v.initial(values) * draw.choice((1.0, 1.0, 0.9, 0.5, 0.0, 1.3))
    return draw.choice((0.0, 0.02, 0.3, 1.0, 5.0)) * draw.uniform(-1.0, 1.0) * _SIZES.get(v.unit, 1.0)


def _results(function: Any, *arguments: Any) -> list[float]:
    """Return a function's results on a scale that is logarithmic beyond 1e-6, so that small results count too."""
    try:
        return [asinh(1e6 * x) if isfinite(x) else NOT_FINITE for x in map(float, function(*arguments))]
    except (ArithmeticError, ValueError):
        return []
