"""An actuator as a program: its functions (:mod:`emcas_fmu.actuators`) and its schedule traced, as Python or C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from inspect import signature
from typing import Any

from .. import control, schedule
from ..actuators import NONLINEAR, get
from ..ops.base import Ops, Value
from ..ops.c_source import c_source
from ..ops.python_source import TEMPLATES, python_source
from ..ops.trace import Tracer
from ..ops.usage import Writer
from ..physics import bus
from ..tree import tree
from .core import Core

SCHEDULE = (schedule.schedule, schedule.locate)

Make = Callable[[Mapping[str, Any]], tuple[Callable[..., tuple[Any, ...]], ...]]


def mixed_command(ops: Ops, p: Any, command: Value, roll: Value, pitch: Value, yaw: Value) -> tuple[Value, ...]:
    """:func:`emcas_fmu.control.mixed_command`."""
    return (control.mixed_command(ops, p, command, roll, pitch, yaw),)


def bus_voltage(ops: Ops, p: Any, source: Value, sag: Value) -> tuple[Value, ...]:
    """:func:`emcas_fmu.physics.bus.voltage`."""
    return (bus.voltage(ops, source, sag),)


def bus_current(ops: Ops, p: Any, power: Value, at: Value) -> tuple[Value, ...]:
    """:func:`emcas_fmu.physics.bus.current`."""
    return (bus.current(ops, power, at),)


def bus_sag(ops: Ops, p: Any, resistance: Value, sag: Value, drawn: Value, interval: Value,
            inverse_inductance: Value) -> tuple[Value, ...]:
    """:func:`emcas_fmu.physics.bus.next_sag`; `inverse_inductance` is sum 1/L_i [1/H]."""
    return (bus.next_sag(ops, resistance, sag, drawn, interval * inverse_inductance),)


def inverse_inductance(ops: Ops, p: Any) -> tuple[Value, ...]:
    """1/L [1/H] of one motor."""
    return (1.0 / p.motor.inductance,)


# What several actuators in one unit need besides.
SEVERAL = (mixed_command, bus_voltage, bus_current, bus_sag, inverse_inductance)


def _bind(function: Callable[..., Any], tracer: Tracer, p: Any) -> Callable[..., Any]:
    return lambda *arguments: function(tracer, p, *arguments)


@cache
def traced(several: bool = False, model: str = NONLINEAR) -> Tracer:
    """The schedule and a model's functions, and `SEVERAL` if asked for, of the model's parameters in their order."""
    chosen = get(model)
    tracer = Tracer()
    p = tree({v.name: tracer.parameter(v.name) for v in chosen.parameters})
    for name, arguments, function in functions(several, model):
        tracer.function(name, arguments, _bind(function, tracer, p))
    return tracer


def functions(several: bool = False, model: str = NONLINEAR
              ) -> tuple[tuple[str, tuple[str, ...], Callable[..., tuple[Value, ...]]], ...]:
    """Name, names of the arguments behind ops and p, and the function of each of a program, in their order."""
    def described(*plain: Callable[..., tuple[Value, ...]]) -> Any:
        return tuple((f.__name__, tuple(signature(f).parameters)[2:], f) for f in plain)

    return (*described(*SCHEDULE), *get(model).functions, *described(*SEVERAL if several else ()))


@cache
def unread(model: str) -> frozenset[str]:
    """Parameters that nothing of a model depends on."""
    tracer = traced(False, model)
    uses = Writer(tracer, TEMPLATES).uses
    return frozenset(key for name, key in tracer.parameters if not uses.get(name))


_INPUTS = {"fin_command": "command", "aero_torque": "aero_torque", "supply_voltage": "supply", "enable": "enable"}


@cache
def idle(model: str) -> tuple[frozenset[str], frozenset[str]]:
    """Inputs that nothing of a model depends on, and outputs that are always 0."""
    tracer = traced(False, model)
    uses = Writer(tracer, TEMPLATES).uses
    (outputs,) = (function.results for function in tracer.functions if function.name == "outputs")
    return (frozenset(name for name, argument in _INPUTS.items() if not uses.get(argument)),
            frozenset(v.name for v, result in zip(get(model).outputs, outputs, strict=True)
                      if isinstance(result, float) and result == 0.0))


@cache
def source(several: bool = False, model: str = NONLINEAR) -> str:
    """Python source of a module with ``make(parameters)``.

    `make` takes the flat parameter mapping and gives the functions in their order, bound to it.
    """
    return python_source(traced(several, model),
                         "The actuator's equations as straight-line code; generated, do not edit.")


def c_kernel(several: bool = False, model: str = NONLINEAR) -> str:
    """The functions as C (:func:`emcas_fmu.ops.c_source.c_source`), named ``kernel_...``."""
    return c_source(traced(several, model), "kernel")


def core(values: Mapping[str, Any], model: str = NONLINEAR) -> Core:
    """A core of a model, in Python, with these parameters."""
    actuator = get(model)
    return Core(make(model=model)(values), len(actuator.kept), len(actuator.shown))


@cache
def make(several: bool = False, model: str = NONLINEAR) -> Make:
    """The compiled program's `make`."""
    namespace: dict[str, Any] = {}
    exec(compile(source(several, model), "<emcas kernel>", "exec"), namespace)
    result: Make = namespace["make"]
    return result
