"""What the outputs that extensions add come to in a sample; all from the command's instant on.

Numbers are figures, like those of :mod:`emcas_fmu.bench.metrics`. What a mean says nothing of, states, flags and
words of bits, is observed: the last one, and of a word the bits that ever were set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ...actuators import extension_outputs
from ...bench.metrics import Figure
from ...bench.subject import Run
from ...simulation import Array
from ...variables import Variable
from .experiments import Experiment


@dataclass(frozen=True)
class Observation:
    """A column that is no figure; `kind` is Integer, Boolean or String, `bits` what those of a word stand for."""

    kind: str
    bits: tuple[str, ...] = ()

    def names(self, value: int) -> tuple[str, ...]:
        """Return the names of the bits of a word that are set."""
        return tuple(name for i, name in enumerate(self.bits) if value >> i & 1)

    def text(self, value: Any) -> str:
        """Return a value for people: of a word the bits that are set, by name."""
        if self.bits and value:
            return f"{value} ({', '.join(self.names(value))})"
        return str(value).lower() if isinstance(value, bool) else str(value)


variables = cache(extension_outputs)
"""The outputs that the extensions of a model, by its full name, add."""


def _figures(v: Variable) -> dict[str, Figure]:
    """Figures of an output; none of one that is a state or a number without an order."""
    if v.kind == "Real":
        return {f"{v.name}_last": Figure(v.unit, f"{v.description}, at the end", (v.name,)),
                f"{v.name}_largest": Figure(v.unit, f"{v.description}, largest", (v.name,)),
                f"{v.name}_smallest": Figure(v.unit, f"{v.description}, smallest", (v.name,), -1.0)}
    if v.kind == "Boolean":
        return {f"{v.name}_share": Figure("1", f"share of the time in which {v.name} is true", (v.name,), -1.0)}
    if v.bits:
        return {f"{v.name}_first": Figure("s", f"when {v.name} first has a bit set", (v.name,))}
    return {}


def _observations(v: Variable) -> dict[str, Observation]:
    if v.kind == "Real":
        return {}
    kind = "String" if v.items else "Boolean" if v.kind == "Boolean" else "Integer"
    last = {f"{v.name}_last": Observation(kind, v.bits)}
    return {**last, f"{v.name}_ever": Observation("Integer", v.bits)} if v.bits else last


@cache
def figures(model: str) -> Mapping[str, Figure]:
    """Return the figures of the outputs that a model's extensions add, by name."""
    return {name: figure for v in variables(model) for name, figure in _figures(v).items()}


@cache
def observations(model: str) -> Mapping[str, Observation]:
    """Return what is observed of them besides, by name."""
    return {name: observation for v in variables(model) for name, observation in _observations(v).items()}


def reduced(experiment: Experiment, model: str, run: Run) -> dict[str, Any]:
    """Return figures and observations of a finished run by column name."""
    time = run.columns["time"]
    acting, since = run.excitation.judged(time), time - run.excitation.begin
    found: dict[str, Any] = {}
    for v in variables(model):
        found |= _reduced(v, run.columns[v.name][acting], since[acting])
    return {f"{experiment.name}.{name}": value for name, value in found.items()}


def _reduced(v: Variable, column: Array, time: Array) -> dict[str, Any]:
    last = column[-1]
    if v.kind == "Real":
        return {f"{v.name}_last": float(last), f"{v.name}_largest": float(column.max()),
                f"{v.name}_smallest": float(column.min())}
    if v.kind == "Boolean":
        return {f"{v.name}_last": bool(last), f"{v.name}_share": float(np.mean(column))}
    if v.items:
        return {f"{v.name}_last": v.items[round(last) - 1][0]}
    whole = np.rint(column).astype(np.int64)
    found: dict[str, Any] = {f"{v.name}_last": int(whole[-1])}
    if v.bits:
        found[f"{v.name}_ever"] = int(np.bitwise_or.reduce(whole))
        found[f"{v.name}_first"] = float(time[np.argmax(whole != 0)]) if whole.any() else float("nan")
    return found
