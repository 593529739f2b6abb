"""What was injected and what the built-in test found: counts over the samples of a campaign of a model with faults."""

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
    """Samples of an experiment with one fault, by its name, with none or with several.

    `found` is in how many of them a monitor tripped after the fault began, without one, in how many any tripped;
    `before` in how many one had tripped before it. `monitors` counts each one the actuator has, whenever it tripped.
    `delay` [s] is the median of those found, from the beginning of the fault, and `longest` the largest; nan where
    there is none.
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
    """Return how many samples that were run have each value, or each bit of a word, of every column that is no figure.

    Most often first.
    """
    return {name: dict(Counter(_values(output, table[name].to_pylist())).most_common())
            for name, output in observed(plan).items()}


def _values(output: Variable, column: list[Any]) -> Iterator[str]:
    for value in column:
        yield from (output.flags(value) or ("none",)) if output.bits else (in_words(output, value),)


def findings(plan: Plan, table: pa.Table) -> tuple[Finding, ...]:
    """Return for each experiment what became of each fault that was injected alone; nothing without faults."""
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
