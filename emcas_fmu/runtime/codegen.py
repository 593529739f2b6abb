"""The program of an actuator: its functions (:mod:`emcas_fmu.actuators`) and its schedule, traced for Python or C."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from functools import cache, lru_cache, partial
from typing import Any, TypeVar

from ..actuators import NONLINEAR, external, fin_port, get, positional
from ..actuators.declaration import Actuator, PlantFault, Supply
from ..actuators.supply_line import drawn
from ..errors import EmcasError
from ..namespace import Record, namespace
from ..ops.base import Ops, Value
from ..physics.loads import LOADS, MotionLoads
from ..support.bounded import Endless, bounded
from ..trace.dependencies import ZERO, Dependence, dependencies, of_parameters
from ..trace.python_source import python_source
from ..trace.repeated import LocatedTracer, changed, same
from ..trace.tracer import Tracer
from ..variables import Variable
from . import schedule
from .core import FIRST, Core, Functions, Inputs, Sizes, inputs_of
from .multi_fin import MultiFin

Make = Callable[[Mapping[str, Any]], tuple[Callable[..., tuple[Any, ...]], ...]]
NamedFunction = tuple[str, tuple[str, ...], Callable[..., tuple[Value, ...]]]
_Kind = TypeVar("_Kind", bound=Tracer)

MOTION_SLICE = slice(FIRST, FIRST + len(fin_port.VEHICLE_MOTION))  # the vehicle's motion among an actuator's inputs


def functions(actuator: Actuator, several: bool = False) -> tuple[NamedFunction, ...]:
    """Return the functions of a program: for each its name, its arguments after ops and p, and the function.

    For several fins the program also mixes the commands and steps their supply line, if they have a supply
    (:mod:`emcas_fmu.actuators.supply_line`).
    """
    one: tuple[NamedFunction, ...] = (
        ("schedule", (), lambda ops, p: schedule.schedule(ops, p, actuator)),
        ("locate", ("time",), lambda ops, p, time: schedule.locate(ops, p, actuator, time)),
        *positional.functions(actuator))
    mixing: tuple[NamedFunction, ...] = (
        ("mixed_command", ("command", "roll", "pitch", "yaw"),
         lambda ops, p, *commands: (fin_port.mixed_command(ops, p, *commands),)),)
    if not several:
        return one
    return (*one, *mixing, *(_of_line(actuator, actuator.supply) if actuator.supply else ()))


def _of_line(actuator: Actuator, supply: Supply) -> tuple[NamedFunction, ...]:
    """Return the functions of the supply line that several fins share."""
    line, names = supply.line, [v.name for v in supply.line.parameters]
    plant, supply_course = tuple(s.name for s in actuator.states), supply.course
    states, count = [f"line_{name}" for name in line.states], len(names)
    parameters = tuple(map(positional.identifier, names))

    def of_line(values: Sequence[Value]) -> Any:
        return getattr(namespace(dict(zip(names, values, strict=True))), line.group)

    def following(ops: Ops, p: Any, *arguments: Value) -> tuple[Value, ...]:
        source, *state, current, mean, inverse_inductance = arguments[count:]
        return line.following(ops, of_line(arguments[:count]), source, state, current, mean, inverse_inductance,
                              supply.input.name in actuator.without_effect)

    def course(ops: Ops, p: Any, interval: Value, current: Value, before: Value, *states: Value) -> tuple[Value, ...]:
        assert supply_course is not None
        return supply_course(ops, p, Record(**dict(zip(plant, states, strict=True))), current, before, interval)

    return (
        ("line_level", ("source", *states), lambda ops, p, source, *state: (line.level(ops, source, *state),)),
        ("line_drawn", ("power", "level"), lambda ops, p, power, level: (drawn(ops, power, level),)),
        ("line_following", (*parameters, "source", *states, "drawn", "mean", "inverse_inductance"), following),
        ("line_start", parameters, lambda ops, p, *values: line.start(ops, of_line(values))),
        ("inverse_inductance", ("interval",),
         lambda ops, p, interval: (supply.within(ops, p, interval),)),
        *((("line_course", ("interval", "current", "before", *plant), course),) if supply_course else ()))


def traced_functions(model: str, functions: Collection[NamedFunction]) -> Tracer:
    """Return functions of an actuator, traced over its parameters in their order.

    Functions in a user's file are traced twice. Raises EmcasError naming file and line if a function cannot be traced,
    or if the two traces differ.
    """
    actuator = get(model)
    tracer = _filled(Tracer(), actuator, functions)
    if actuator.source is None or same(tracer, again := _filled(Tracer(), actuator, functions)):
        return tracer
    located = _filled(LocatedTracer(actuator.source), actuator, functions)  # slower, for the message only
    raise changed(again if same(tracer, located) else tracer, located, partial(external.of_function, actuator))


def _filled(tracer: _Kind, actuator: Actuator, functions: Iterable[NamedFunction]) -> _Kind:
    """Trace functions of an actuator with a tracer, and return the tracer."""
    p = actuator.namespace({v.name: tracer.parameter(v.name) for v in actuator.parameters})
    for name, arguments, function in functions:
        try:
            with nullcontext() if actuator.source is None else bounded(external.LONGEST_IMPORT):
                tracer.function(name, arguments, partial(function, tracer, p))
        except (Exception, Endless) as error:
            if actuator.source is None or isinstance(error, EmcasError):
                raise
            raise external.refusal(error, actuator.source) from error
    return tracer


@lru_cache(maxsize=4)  # several printers use one actuator in turn; the traces of all would be millions of objects
def traced(several: bool = False, model: str = NONLINEAR) -> Tracer:
    """Return the traced functions of an actuator, or of `several` fins."""
    return traced_functions(model, functions(get(model), several))


@cache
def traced_rules(model: str = NONLINEAR) -> Tracer:
    """Return the traced checks of an actuator's rules: ``check_0`` and so on, functions of a share of the travel."""
    return traced_functions(model, [
        (f"check_{i}", ("share",), rule.check) for i, rule in enumerate(get(model).all_rules)])


@cache
def traced_line_rules(model: str = NONLINEAR) -> Tracer:
    """Return the traced checks of the rules for the line that several fins share, over the line's parameters."""
    supply, tracer = get(model).supply, Tracer()
    if supply is not None:
        p = namespace({v.name: tracer.parameter(v.name) for v in supply.line.parameters})
        for i, rule in enumerate(supply.line.rules):
            tracer.function(f"check_{i}", ("share",), partial(rule.check, tracer, p))
    return tracer


def used(model: str) -> dict[str, frozenset[str]]:
    """Return the parameters and arguments on which the results of an actuator's functions depend, by function name.

    The functions include rules, faults of the actuator's kind, and the inverse inductance and charge of the supply.
    """
    actuator = get(model)

    def of_fault(fault: PlantFault) -> NamedFunction:
        names = tuple(v.name for v in fault.amounts)

        def changes(ops: Ops, p: Any, *amounts: Value) -> tuple[Value, ...]:
            changed = fault.changes(ops, p, Record(**dict(zip(names, amounts, strict=True))))
            return tuple(x for value in changed.values() for x in (value if isinstance(value, tuple) else (value,)))

        return f"fault_{fault.name}", names, changes

    of_line = _of_line(actuator, actuator.supply)[4:] if actuator.supply else ()
    further = (*of_line, *map(of_fault, actuator.faults))
    result: dict[str, frozenset[str]] = {}
    for tracer in (traced(False, model), traced_rules(model), traced_functions(model, further)):
        fixed = of_parameters(tracer, {key: Dependence(names=frozenset({key})) for _, key in tracer.parameters})
        for function in tracer.functions:
            arguments = [Dependence(names=frozenset({name})) for name in function.arguments]
            result[function.name] = frozenset().union(*(
                known.names for known in dependencies(tracer, function.name, arguments, fixed)))
    return result


@cache
def direct_inputs(model: str) -> Mapping[str, tuple[str, ...]]:
    """Return the inputs on which each output depends directly, not through states; outputs without any are left out."""
    actuator = get(model)
    states = [Dependence()] * (len(actuator.states) + 4 + len(actuator.sampled_states))
    direct = {name: tuple(v.name for v in actuator.inputs if v.name in known.names)
              for name, known in _outputs(model, states).items()}
    return {name: inputs for name, inputs in direct.items() if inputs}


@cache
def initial_values(model: str) -> Mapping[str, Dependence]:
    """Return the bounds and dependencies of the outputs' initial values, by the outputs' names."""
    actuator = get(model)
    tracer = traced(False, model)
    initial = dependencies(tracer, "initial", (), of_parameters(tracer, _known(actuator.parameters)))
    plant, controller = len(actuator.states), len(actuator.controller_states)
    # A core (core.py) starts with references of 0 and without an active limit.
    measured, *sampled = initial[plant + controller:]
    return _outputs(model, [*initial[:plant], ZERO, ZERO, measured, ZERO, *sampled])


def line_started_by(model: str) -> frozenset[str]:
    """Return the parameters on which the initial states of the line that several fins share depend."""
    actuator, tracer = get(model), traced(True, model)
    if actuator.supply is None:
        return frozenset()
    states = dependencies(tracer, "line_start", tuple(_known(actuator.supply.line.parameters).values()),
                          of_parameters(tracer, _known(actuator.parameters)))
    return frozenset().union(*(state.names for state in states))


def _outputs(model: str, states: Sequence[Dependence]) -> dict[str, Dependence]:
    """Return the bounds and dependencies of each output, computed from those of the states."""
    actuator, tracer = get(model), traced(False, model)
    inputs, fixed = _known(actuator.inputs), of_parameters(tracer, _known(actuator.parameters))
    motion_loads = dependencies(tracer, "motion_loads", [inputs[v.name] for v in fin_port.VEHICLE_MOTION], fixed)
    outputs = dependencies(tracer, "outputs", (
        *states, inputs["fin_command"], inputs["aero_torque"], *motion_loads,
        ZERO if actuator.supply is None else inputs[actuator.supply.input.name], inputs["enable"],
        *(inputs[v.name] for v in actuator.acting_inputs)), fixed)
    return {v.name: known for v, known in zip(actuator.outputs, outputs, strict=True)}


def _known(variables: Iterable[Variable]) -> dict[str, Dependence]:
    """Return the bounds of variables by name: parameters are within their limits, inputs may have any value."""
    known = {}
    for v in variables:
        limits = (0.0, 1.0) if v.kind == "Boolean" else (v.minimum, v.maximum) if v.causality == "parameter" else ()
        known[v.name] = Dependence(*limits)._replace(names=frozenset({v.name}))
    return known


@lru_cache(maxsize=4)  # an FMU's GUID and its files need the same source, as do campaigns over one actuator
def source(several: bool = False, model: str = NONLINEAR, spelt: Callable[[str], str] = str) -> str:
    """Return the Python source of a module with ``make(parameters)``.

    `make` has one argument, a mapping of parameters by their names as `spelt` returns them, and returns the functions
    bound to it, in the order of :func:`functions`.
    """
    return python_source(traced(several, model),
                         "The actuator's equations as straight-line code; generated, do not edit.", spelt)


def bound_functions(values: Mapping[str, Any], model: str = NONLINEAR, several: bool = False) -> Functions:
    """Return the functions of an actuator with the parameters `values`, by name and in SI, in Python."""
    return make(several, model)(values)


def core(values: Mapping[str, Any], model: str = NONLINEAR, bind: Callable[..., Functions] = bound_functions) -> Core:
    """Return a core with the parameters `values` [SI], in Python; `bind` makes its functions as `bound_functions`."""
    return Core(bind(values, model), sizes(get(model)))


def multi_fin(sets: Sequence[Mapping[str, Any]], line: Sequence[float], model: str = NONLINEAR,
              bind: Callable[..., Functions] = bound_functions) -> MultiFin:
    """Return the cores of several fins on one supply line, in Python.

    `sets` are the parameters of each fin by name, `line` those of the line in their order, all in SI. `bind` returns
    the functions of a fin as `bound_functions` does.
    """
    actuator, each = get(model), [bind(values, model, True) for values in sets]
    return MultiFin(each, line, power_index(actuator), sizes(actuator))


def core_inputs(core: Core, row: Sequence[Any], actuator: Actuator) -> Inputs:
    """Return the inputs of a core from a `row` of its actuator's inputs, in the interface's order and in SI."""
    motion = row[MOTION_SLICE]
    return inputs_of(row, core.motion_loads(*motion), len(motion), actuator.supply is not None)


def inputs_at_rest(command: float, aero_torque: float, supply: float, enable: bool = True, *further: float) -> Inputs:
    """Return a core's inputs without motion loads; `command` in rad, `aero_torque` in N.m, `supply` in V or Pa."""
    return (command, aero_torque, *(0.0 for _ in MotionLoads._fields), supply, enable, *further)


def power_index(actuator: Actuator) -> int | None:
    """Return the index of the supply power among the outputs; None for an actuator without a supply."""
    return None if actuator.supply is None else [v.name for v in actuator.outputs].index(actuator.supply.power.name)


def sizes(actuator: Actuator) -> Sizes:
    """Return the sizes of an actuator's core."""
    return Sizes(len(actuator.states), len(actuator.controller_states), len(fin_port.VEHICLE_MOTION), len(LOADS),
                 len(actuator.acting_inputs))


@cache
def make(several: bool = False, model: str = NONLINEAR) -> Make:
    """Return the function `make` of the program in Python."""
    program: dict[str, Any] = {}
    exec(compile(source(several, model), "<emcas kernel>", "exec"), program)
    result: Make = program["make"]
    return result
