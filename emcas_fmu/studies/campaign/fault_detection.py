"""What was injected and what the built-in test found: counts over the samples of a campaign of a model with faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from ...extensions.faults import BUILT_IN_TEST, FAULT_WORD
from .extension_outputs import Observation
from .plan import Plan
from .sample import observed

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
    return tuple(_tally(name, observation, table[name].to_pylist()) for name, observation in observed(plan).items())


def _tally(name: str, observation: Observation, values: list[Any]) -> Tally:
    seen: list[str] = []
    for value in values:
        seen += observation.names(value) or ("none",) if observation.bits else (observation.text(value),)
    return Tally(name, tuple(Counter(seen).most_common()))


def findings(plan: Plan, table: pa.Table) -> tuple[Finding, ...]:
    """For each experiment what became of each fault that was injected alone; nothing of a model without faults."""
    if not {FAULT_WORD, BUILT_IN_TEST} <= set(plan.actuator.outputs):
        return ()
    return tuple(finding for e in plan.experiments for finding in _of(e.name, plan, table))


def _of(experiment: str, plan: Plan, table: pa.Table) -> list[Finding]:
    words = [f"{experiment}.{v.name}" for v in (FAULT_WORD, BUILT_IN_TEST)]
    injected, tripped = ([observed(plan)[f"{word}_ever"].names(value) for value in table[f"{word}_ever"].to_pylist()]
                         for word in words)
    begin, first = (np.asarray(table[f"{word}_first"].to_numpy(), dtype=float) for word in words)
    groups: dict[str, list[int]] = {NONE: [], **{name: [] for name in FAULT_WORD.bits}, SEVERAL: []}
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
            sum(1 for i in rows if first[i] < begin[i]), {name: counts[name] for name in BUILT_IN_TEST.bits},
            float(np.median(late)) if late else float("nan"), max(late, default=float("nan"))))
    return found
