"""Reduce the outputs that extensions add to entries of a row, from the command on.

Numbers become figures, like those of :mod:`emcas_fmu.bench.metrics`. States, flags and words of bits have no meaningful
mean; they are observed: the last value, and for a word all bits that were ever set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...actuators import extension_outputs
from ...bench.metrics import Figure, since
from ...bench.runs import Run
from ...simulation import Array
from ...variables import Variable
from .experiments import Experiment


class Reduction(NamedTuple):
    """How the column of an output becomes an entry of a row; `figure` is None for one that is only observed."""

    output: Variable
    figure: Figure | None
    value: Callable[[Array, Array], Any]
    """Function of the columns of runs [runs, rows] and their times [s]; returns a value for each run."""


@cache
def reductions(model: str) -> Mapping[str, Reduction]:
    """Return the reductions of the outputs that a model's extensions add, by the names of their entries."""
    return {f"{v.name}_{suffix}": Reduction(v, *reduction) for v in extension_outputs(model)
            for suffix, reduction in _reductions(v).items()}


def _reductions(v: Variable) -> dict[str, tuple[Figure | None, Callable[[Array, Array], Any]]]:
    def figure(unit: str, title: str, bad: float = 1.0) -> Figure:
        return Figure(unit, title, (v.name,), bad)

    if v.kind == "Real":
        return {"last": (figure(v.unit, f"{v.description}, at the end"), lambda column, time: column[..., -1]),
                "largest": (figure(v.unit, f"{v.description}, largest"), lambda column, time: column.max(axis=-1)),
                "smallest": (figure(v.unit, f"{v.description}, smallest", -1.0),
                             lambda column, time: column.min(axis=-1))}
    if v.kind == "Boolean":
        return {"last": (None, lambda column, time: column[..., -1].astype(bool)),
                "share": (figure("1", f"share of the time in which {v.name} is true", -1.0),
                          lambda column, time: np.mean(column, axis=-1))}
    if v.items:
        return {"last": (None, lambda column, time: np.array([v.in_words(x) for x in column[..., -1]], dtype=object))}
    if not v.bits:
        return {"last": (None, lambda column, time: column[..., -1].astype(np.int64))}
    return {"last": (None, lambda column, time: column[..., -1].astype(np.int64)),
            "ever": (None, lambda column, time: np.bitwise_or.reduce(column.astype(np.int64), axis=-1)),
            "first": (figure("s", f"when {v.name} first has a bit set"), _first)}


def _first(column: Array, time: Array) -> Array:
    first = np.argmax(column != 0.0, axis=-1)
    return np.where(column.any(axis=-1), time[first], np.nan)


def reduced(experiment: Experiment, model: str, run: Run) -> dict[str, Array]:
    """Return figures and observations of finished runs by column name."""
    time, *columns = since(run.excitation.begin, *run.columns.values())
    at = dict(zip([*run.columns][1:], columns, strict=True))
    return {f"{experiment.name}.{name}": reduction.value(at[reduction.output.name], time - run.excitation.begin)
            for name, reduction in reductions(model).items()}


def in_words(output: Variable, value: Any) -> str:
    """Return an observed value as text, for a word with the names of the bits that are set."""
    if output.bits and value:
        return f"{value} ({', '.join(output.flags(value))})"
    return str(value).lower() if isinstance(value, bool) else str(value)
