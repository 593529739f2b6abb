"""Conditions of a simulation, and figures that depend on engineering estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..actuators import get
from ..actuators.fin_port import SAMPLE_TIME

_TEMPERATURE = "friction.temperature"


def conditions(model: str, values: Mapping[str, Any]) -> list[tuple[str, str, Any, str]]:
    """Return the conditions of a simulation that parameters define, each as label, name, value and unit."""
    actuator = get(model)
    rows: list[tuple[str, str, Any, str]] = []
    if actuator.supply:
        v = actuator.supply.input
        rows.append(("supply", v.name, v.initial(values), v.unit))
    if _TEMPERATURE in values:
        rows.append(("temperature", _TEMPERATURE, values[_TEMPERATURE], "degC"))
    return [*rows, ("sample time of the controllers", SAMPLE_TIME.name, values[SAMPLE_TIME.name], "s")]


ESTIMATE = " (estimate)"
"""Suffix of a figure's name if the figure depends on engineering estimates of parameters."""


def resting_on(estimates: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a sentence for each group of figures that depend on the same estimated parameters.

    `estimates` maps a figure to the names of these parameters.
    """
    alike: dict[tuple[str, ...], list[str]] = {}
    for figure, names in estimates.items():
        alike.setdefault(tuple(names), []).append(figure)
    return [f"Estimate: {', '.join(figures)}, from engineering estimates of {', '.join(names)}."
            for names, figures in alike.items() if names]
