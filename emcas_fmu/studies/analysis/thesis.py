"""The thesis's linear model, (2.18)-(2.26), as python-control systems; computed by `reference.linear`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...reference.linear import LinearModel
from .linear import System, moving

_INTEGRAL = 4  # of the model's state: I


def closed(values: Mapping[str, Any]) -> System:
    """Return the system from ``command`` [rad] to ``fin_angle`` [rad] at the sample times."""
    model = LinearModel(values)
    return _system(model, model.update, model.drive, model.output, "command", "fin_angle")


def reference_loop(values: Mapping[str, Any]) -> System:
    """Return the loop broken at the drive's reference u.

    The model is closed. The last row of its update writes u, and what the command adds to u
    acts on the other states as u itself does; only the integral takes the command by another way.
    """
    model = LinearModel(values)
    law = model.update[-1]
    acts = model.drive / model.drive[-1]
    acts[_INTEGRAL] = 0.0
    return -_system(model, model.update - np.outer(acts, law), acts, law, "dac", "reference")


def _system(model: LinearModel, a: Any, b: Any, c: Any, into: str, out: str) -> System:
    return moving(a, b[:, None], c[None], np.zeros((1, 1)), model.sample_time, [into], [out])
