"""What was injected and what the built-in test found: counts over the samples of a campaign of a model with faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from . import own
from .plan import Plan
from .sample import observed

INJECTED, FOUND = "fault_word", "built_in_test"
NONE, SEVERAL = "no fault", "several faults"


@dataclass(frozen=True)
class Tally:
    """How many samples have each value of a column, or each bit of a word; most often first."""

    name: str
    counts: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Finding:
    """Samples of an experiment with one fault, by its name, with none or with several.

    `found` is in how many of them a monitor tripped after the fault began, without one, in how many any tripped;
    `before` in how many one had tripped before it. `monitors` counts each one, whenever it tripped. `delay` [s] is the
    median of those found, from the beginning of the fault, and `longest` the largest; nan where there is none.
    """

    experiment: str
    fault: str
    samples: int
    found: int
    before: int
    monitors: Mapping[str, int]
    delay: float
    longest: float


def tallies(plan: Plan, table: pa.Table) -> tuple[Tally, ...]:
    """Of every column that is no figure, over the rows of samples that were run."""
    return tuple(_tally(name, table[name].to_pylist()) for name in observed(plan))


def _tally(name: str, values: list[Any]) -> Tally:
    word = name.partition(".")[2].rpartition("_")[0]
    told: list[str] = []
    for value in values:
        if word in own.WORDS:
            told += own.bits(word, value) or ("none",)
        else:
            told.append(str(value).lower() if isinstance(value, bool) else str(value))
    return Tally(name, tuple(Counter(told).most_common()))


def findings(plan: Plan, table: pa.Table) -> tuple[Finding, ...]:
    """For each experiment what became of each fault that was injected alone; nothing of a model without faults."""
    seen = set(observed(plan))
    there = [e.name for e in plan.experiments if {f"{e.name}.{word}_ever" for word in (INJECTED, FOUND)} <= seen]
    return tuple(finding for name in there for finding in _of(name, table))


def _of(experiment: str, table: pa.Table) -> list[Finding]:
    injected, tripped = ([own.bits(word, value) for value in table[f"{experiment}.{word}_ever"].to_pylist()]
                         for word in (INJECTED, FOUND))
    begin, first = (np.asarray(table[f"{experiment}.{word}_first"].to_numpy(), dtype=float)
                    for word in (INJECTED, FOUND))
    groups: dict[str, list[int]] = {NONE: [], **{name: [] for name in own.WORDS[INJECTED]}, SEVERAL: []}
    for i, faults in enumerate(injected):
        groups[NONE if not faults else faults[0] if len(faults) == 1 else SEVERAL].append(i)
    found = []
    for fault, rows in groups.items():
        if not rows:
            continue
        late = [first[i] - begin[i] for i in rows if first[i] >= begin[i]]
        counts = Counter(name for i in rows for name in tripped[i])
        found.append(Finding(
            experiment, fault, len(rows), sum(1 for i in rows if tripped[i]) if fault == NONE else len(late),
            sum(1 for i in rows if first[i] < begin[i]), {name: counts[name] for name in own.WORDS[FOUND]},
            float(np.median(late)) if late else float("nan"), max(late, default=float("nan"))))
    return found
