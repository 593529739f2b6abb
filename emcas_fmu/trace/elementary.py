"""The elementary functions as a traced program, which printers print before all other functions."""

from __future__ import annotations

from functools import cache

from ..ops import elementary
from .tracer import Tracer


@cache
def traced() -> Tracer:
    """Return the traced functions :data:`emcas_fmu.ops.elementary.FUNCTIONS`, with one argument and one result each."""
    tracer = Tracer()
    for name in elementary.FUNCTIONS:
        tracer.function(name, ("x",), lambda x, name=name: (getattr(elementary, name)(tracer, x),))
    return tracer
