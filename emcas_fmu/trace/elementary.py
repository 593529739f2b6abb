"""The elementary functions as a traced program, which printers print before all other functions."""

from __future__ import annotations

from functools import cache, partial

from ..ops import elementary
from .tracer import Tracer


@cache
def traced() -> Tracer:
    """Return the traced functions :data:`emcas_fmu.ops.elementary.NAMES`, with one argument and one result each."""
    tracer = Tracer()
    for name in elementary.NAMES:
        tracer.function(name, ("x",), partial(_results, name, tracer))
    return tracer


def _results(name: str, tracer: Tracer, x: object) -> tuple[object]:
    return (getattr(elementary, name)(tracer, x),)
