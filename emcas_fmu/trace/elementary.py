"""The elementary functions as a program, each traced once: what every printer prints in front of its own."""

from __future__ import annotations

from functools import cache, partial

from ..ops import elementary
from .tracer import Tracer


@cache
def traced() -> Tracer:
    """Return :data:`emcas_fmu.ops.elementary.NAMES`, functions of one value with one result, traced."""
    tracer = Tracer()
    for name in elementary.NAMES:
        tracer.function(name, ("x",), partial(_results, name, tracer))
    return tracer


def _results(name: str, tracer: Tracer, x: object) -> tuple[object]:
    return (getattr(elementary, name)(tracer, x),)
