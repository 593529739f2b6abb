"""The thesis's linear model, (2.18)-(2.26), as python-control systems; computed by `validation.linear`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import control as ct
import numpy as np

from ..reference.linear import LinearModel
from .linear import System

_INTEGRAL = 4  # of the model's state: I


def closed(values: Mapping[str, Any]) -> System:
    """From ``command`` [rad] to ``fin_angle`` [rad] at the sample times."""
    model = LinearModel(values)
    return _moving(model.update, model.drive, model.output, model.sample_time, "command", "fin_angle")


def reference_loop(values: Mapping[str, Any]) -> System:
    """The loop broken at the drive's reference u.

    The model is closed. The last row of its update writes u, and what the command adds to u
    acts on the other states as u itself does; only the integral takes the command by another way.
    """
    model = LinearModel(values)
    law = model.update[-1]
    acts = model.drive / model.drive[-1]
    acts[_INTEGRAL] = 0.0
    return -_moving(model.update - np.outer(acts, law), acts, law, model.sample_time, "dac", "reference")


def _moving(a: Any, b: Any, c: Any, period: float, into: str, out: str) -> System:
    keep = np.any(a != np.eye(len(a)), axis=1) | (b != 0.0)
    return ct.ss(a[np.ix_(keep, keep)], b[keep, None], c[None, keep], [[0.0]], period, inputs=[into], outputs=[out])
