"""Outputs that extensions add: their entries in a row, measured from the command, and counts over samples.

An entry is a figure, as in :mod:`emcas_fmu.bench.metrics`, or an observation: the last value of a state, flag or word
of bits, or all bits of a word that were ever set.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from math import nan
from typing import Any, NamedTuple

import numpy as np

from ...actuators import extension_outputs
from ...bench.metrics import Figure, since
from ...bench.runs import Run
from ...extensions.faults import BUILT_IN_TEST, FAULT_WORD
from ...extensions.monitors import possible
from ...simulation import Array
from ...variables import Variable
from .study import Campaign

NONE, SEVERAL = "no fault", "several faults"


class Reduction(NamedTuple):
    """How the column of an output becomes an entry of a row; `figure` is None for an observation."""

    output: Variable
    figure: Figure | None
    value: Callable[[Array, Array], Any]
    """Function of columns [runs, rows] and times [s] from the command; returns a value for each run."""


@cache
def reductions(model: str) -> Mapping[str, Reduction]:
    """Return the reductions of the outputs that a model's extensions add, by the names of their entries."""
    return {f"{v.name}_{suffix}": Reduction(v, *reduction) for v in extension_outputs(model)
            for suffix, reduction in _reductions(v).items()}


def _reductions(v: Variable) -> dict[str, tuple[Figure | None, Callable[[Array, Array], Any]]]:
    def figure(unit: str, title: str, bad: float = 1.0) -> Figure:
        return Figure(unit, title, needs=(v.name,), bad=bad)

    def last(kind: type) -> Callable[[Array, Array], Any]:
        return lambda column, time: column[..., -1].astype(kind)

    if v.kind == "Real":
        return {"final": (figure(v.unit, f"{v.description}, at the end"), last(float)),
                "largest": (figure(v.unit, f"{v.description}, largest"), lambda column, time: column.max(axis=-1)),
                "smallest": (figure(v.unit, f"{v.description}, smallest", -1.0),
                             lambda column, time: column.min(axis=-1))}
    if v.kind == "Boolean":
        return {"final": (None, last(bool)), "share": (
            figure("1", f"share of the time in which {v.name} is true", -1.0),
            lambda column, time: column.mean(axis=-1))}
    if v.items:
        return {"final": (None, lambda column, time: np.array([v.in_words(x) for x in column[..., -1]], dtype=object))}
    return {"final": (None, last(np.int64)), **({
        "ever": (None, lambda column, time: np.bitwise_or.reduce(column.astype(np.int64), axis=-1)),
        "first": (figure("s", f"when {v.name} first has a bit set"), _first)} if v.bits else {})}


def _first(column: Array, time: Array) -> Array:
    first = np.argmax(column != 0.0, axis=-1)
    return np.where(column.any(axis=-1), time[first], np.nan)


def reduced(model: str, run: Run) -> dict[str, Array]:
    """Return figures and observations [runs] of finished runs by name."""
    begin = run.excitation.begin
    judged = dict(zip(run.columns, since(begin, *run.columns.values()), strict=True))
    return {name: reduction.value(judged[reduction.output.name], judged["time"] - begin)
            for name, reduction in reductions(model).items()}


def in_words(output: Variable, value: Any) -> str:
    """Return an observed value as text; the text of a word includes the names of the bits that are set."""
    if output.bits and value:
        return f"{value} ({', '.join(output.flags(value))})"
    return str(value).lower() if isinstance(value, bool) else str(value)


def observed(study: Campaign) -> dict[str, Variable]:
    """Return the outputs of the observations in a row, by column name."""
    return {f"{experiment.name}.{name}": r.output for experiment in study.experiments
            for name, r in reductions(study.model).items() if r.figure is None}


@dataclass(frozen=True)
class Finding:
    """The samples of an experiment with one `fault`, with NONE or with SEVERAL.

    `found` is the number of samples in which a monitor first tripped after the fault began; with NONE, the number in
    which a monitor tripped. `before` is the number in which a monitor tripped before the fault began. `monitors` has
    the number in which each monitor tripped. `delay` [s] is the median time from the beginning of the fault to the
    first trip over the `found` samples, `longest` [s] the largest; both are nan with NONE or if `found` is 0.
    """

    experiment: str
    fault: str
    samples: int
    found: int
    before: int
    monitors: Mapping[str, int]
    delay: float
    longest: float


def tallies(study: Campaign, table: Any) -> dict[str, dict[str, int]]:
    """Return for every observation the number of samples with each value, or each bit of a word, the largest first."""
    return {name: dict(Counter(
        word for value in table[name].to_pylist()
        for word in ((output.flags(value) or ("none",)) if output.bits else (in_words(output, value),))).most_common())
        for name, output in observed(study).items()}


def findings(study: Campaign, table: Any) -> Iterator[Finding]:
    """Yield the findings of each experiment: NONE, each single fault, SEVERAL; nothing without faults in the model."""
    words = {v.name: v for v in study.actuator.outputs if v.name in (FAULT_WORD, BUILT_IN_TEST.name)}
    for experiment in (e.name for e in study.experiments if len(words) == 2):
        injected, tripped = ([word.flags(value) for value in table[f"{experiment}.{word.name}_ever"].to_pylist()]
                             for word in (words[FAULT_WORD], BUILT_IN_TEST))
        begin, first = (table[f"{experiment}.{name}_first"].to_numpy() for name in (FAULT_WORD, BUILT_IN_TEST.name))
        groups = [NONE if not faults else faults[0] if len(faults) == 1 else SEVERAL for faults in injected]
        for fault in (each for each in (NONE, *words[FAULT_WORD].bits, SEVERAL) if each in groups):
            rows = [i for i, group in enumerate(groups) if group == fault]
            delays = first[rows] - begin[rows]
            detected = delays[delays >= 0.0].tolist()
            counts = Counter(name for i in rows for name in tripped[i])
            yield Finding(
                experiment, fault, len(rows), sum(bool(tripped[i]) for i in rows) if fault == NONE else len(detected),
                int(np.sum(delays < 0.0)), {monitor.name: counts[monitor.name] for monitor in possible(study.actuator)},
                float(np.median(detected)) if detected else nan, max(detected, default=nan))
