"""The thesis's linear model, (2.18)-(2.26), of `reference.linear` as python-control systems."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...actuators.shared import WITHOUT_EFFECT
from ...bench.linear.systems import System, delay_line, moving, wire
from ...reference.linear import LinearModel


def linear_model(values: Mapping[str, Any]) -> LinearModel:
    """Return the model of an actuator with motor, screw and lever. Missing parameters have values without effect."""
    scalars = {name: each for name, each in WITHOUT_EFFECT.items() if not isinstance(each, tuple)}
    elements = {f"{name}[{i}]": element for name, each in WITHOUT_EFFECT.items() if isinstance(each, tuple)
                for i, element in enumerate(each)}
    return LinearModel({**scalars, **elements, **values})


def closed(values: Mapping[str, Any]) -> System:
    """Return the sampled closed loop from the command [rad] before the bus to ``fin_angle`` [rad]."""
    model = linear_model(values)
    loop = _system(model, model.update, model.drive, model.output, "command", "fin_angle")
    if not model.latency:
        return loop
    bus = delay_line(model.latency, model.sample_time)
    return wire([bus, loop], [("arrived", "command")], ["sent"], ["fin_angle"])


def reference_loop(values: Mapping[str, Any]) -> System:
    """Return the loop L, opened at the drive's reference; the closed loop has the characteristic equation 1 + L = 0."""
    model = linear_model(values)
    law = model.update[-1]  # the last state after a sample is the new DAC value
    dac_input = model.dac_input  # effect on the states of a voltage that is added to this value
    return -_system(model, model.update - np.outer(dac_input, law), dac_input, law, "dac", "reference")


def _system(model: LinearModel, a: Any, b: Any, c: Any, into: str, out: str) -> System:
    return moving(a, b[:, None], c[None], np.zeros((1, 1)), model.sample_time, [into], [out])
