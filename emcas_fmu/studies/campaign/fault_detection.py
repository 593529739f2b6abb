"""Injected faults and what the built-in test detected, counted over the samples of a campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
import pyarrow as pa

from ...extensions.faults import BUILT_IN_TEST, FAULT_WORD
from ...extensions.monitors import possible
from ...variables import Variable
from .extension_outputs import in_words
from .plan import Plan
from .sample import observed

NONE, SEVERAL = "no fault", "several faults"


@dataclass(frozen=True)
class Finding:
    """The samples of an experiment with one fault, by its name, with none, or with several.

    `found` is the number of samples in which a monitor tripped after the fault began; without a fault, in which any
    tripped. In `before` samples one had tripped earlier. `monitors` counts the trips of each monitor at any time.
    `delay` [s] from the beginning of the fault is the median of the detected samples, `longest` the largest; nan if
    there are none.
    """

    experiment: str
    fault: str
    samples: int
    found: int
    before: int
    monitors: Mapping[str, int]
    delay: float
    longest: float


def tallies(plan: Plan, table: pa.Table) -> dict[str, dict[str, int]]:
    """Return, for every observed column, how many samples have each value or each bit of a word; most frequent first.
    """
    return {name: dict(Counter(_values(output, table[name].to_pylist())).most_common())
            for name, output in observed(plan).items()}


def _values(output: Variable, column: list[Any]) -> Iterator[str]:
    for value in column:
        yield from (output.flags(value) or ("none",)) if output.bits else (in_words(output, value),)


def findings(plan: Plan, table: pa.Table) -> tuple[Finding, ...]:
    """Return the findings of each experiment, for each fault that was injected alone; none if the model has no faults.
    """
    words = {v.name: v for v in plan.actuator.outputs if v.name in (FAULT_WORD, BUILT_IN_TEST.name)}
    if len(words) < 2:
        return ()
    faults = words[FAULT_WORD]
    monitors = [monitor.name for monitor in possible(plan.actuator)]
    return tuple(finding for e in plan.experiments for finding in _findings(e.name, faults, monitors, table))


def _findings(experiment: str, faults: Variable, monitors: list[str], table: pa.Table) -> Iterator[Finding]:
    injected, tripped = ([word.flags(value) for value in table[f"{experiment}.{word.name}_ever"].to_pylist()]
                         for word in (faults, BUILT_IN_TEST))
    begin, first = (table[f"{experiment}.{word.name}_first"].to_numpy() for word in (faults, BUILT_IN_TEST))
    delays = (first - begin).tolist()
    groups = [NONE if not those else those[0] if len(those) == 1 else SEVERAL for those in injected]
    for fault in (NONE, *faults.bits, SEVERAL):
        rows = [i for i, group in enumerate(groups) if group == fault]
        if not rows:
            continue
        late = [delays[i] for i in rows if delays[i] >= 0.0]
        counts = Counter(name for i in rows for name in tripped[i])
        yield Finding(
            experiment, fault, len(rows), sum(bool(tripped[i]) for i in rows) if fault == NONE else len(late),
            sum(delays[i] < 0.0 for i in rows), {name: counts[name] for name in monitors},
            float(np.median(late)) if late else nan, max(late, default=nan))
