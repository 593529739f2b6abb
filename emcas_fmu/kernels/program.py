"""The actuator as a program: :mod:`emcas_fmu.actuator` and its schedule traced, printed as Python or C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from inspect import signature
from typing import Any

from .. import actuator, schedule
from ..ops.c_source import c_source
from ..ops.python_source import python_source
from ..ops.trace import Tracer
from ..tree import tree
from ..variables import PARAMETERS

FUNCTIONS = (schedule.schedule, schedule.locate,
             actuator.initial, actuator.sample, actuator.forces, actuator.step, actuator.outputs)

Make = Callable[[Mapping[str, Any]], tuple[Callable[..., tuple[Any, ...]], ...]]


def _bind(function: Callable[..., Any], tracer: Tracer, p: Any) -> Callable[..., Any]:
    return lambda *arguments: function(tracer, p, *arguments)


@cache
def traced() -> Tracer:
    """The program's `FUNCTIONS`, of the parameters in table order."""
    tracer = Tracer()
    p = tree({v.name: tracer.parameter(v.name) for v in PARAMETERS})
    for function in FUNCTIONS:
        arguments = list(signature(function).parameters)[2:]
        tracer.function(function.__name__, arguments, _bind(function, tracer, p))
    return tracer


@cache
def source() -> str:
    """Python source of a module with ``make(parameters)``.

    `make` takes the flat parameter mapping and gives the `FUNCTIONS` in their order, bound to it.
    """
    return python_source(traced(), "The actuator's equations as straight-line code; generated, do not edit.")


def c_kernel() -> str:
    """The `FUNCTIONS` as C (:func:`emcas_fmu.ops.c_source.c_source`), named ``kernel_...``."""
    return c_source(traced(), "kernel")


@cache
def make() -> Make:
    """The compiled program's `make`."""
    namespace: dict[str, Any] = {}
    exec(compile(source(), "<emcas kernel>", "exec"), namespace)
    result: Make = namespace["make"]
    return result
