"""The actuator as generated Python: :mod:`emcas_fmu.actuator` traced, compiled, cached."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from inspect import signature
from typing import Any

from .. import actuator
from ..ops.trace import Tracer
from ..tree import tree
from ..variables import PARAMETERS

FUNCTIONS = (actuator.initial, actuator.sample, actuator.forces, actuator.step, actuator.outputs)

Make = Callable[[Mapping[str, Any]], tuple[Callable[..., tuple[Any, ...]], ...]]


def _bind(function: Callable[..., Any], tracer: Tracer, p: Any) -> Callable[..., Any]:
    return lambda *arguments: function(tracer, p, *arguments)


@cache
def source() -> str:
    """Python source of a module with ``make(parameters)``.

    `make` takes the flat parameter mapping and gives the functions of
    :mod:`emcas_fmu.actuator`, in the order of `FUNCTIONS`, bound to it.
    """
    tracer = Tracer()
    p = tree({v.name: tracer.parameter(v.name) for v in PARAMETERS})
    for function in FUNCTIONS:
        arguments = list(signature(function).parameters)[2:]
        tracer.function(function.__name__, arguments, _bind(function, tracer, p))
    return tracer.source("The actuator's equations as straight-line code; generated, do not edit.")


@cache
def make() -> Make:
    """The compiled program's `make`."""
    namespace: dict[str, Any] = {}
    exec(compile(source(), "<emcas kernel>", "exec"), namespace)
    result: Make = namespace["make"]
    return result
