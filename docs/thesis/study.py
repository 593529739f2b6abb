"""The outcomes of the selected entries, which are made one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from emcas_fmu.bench.subject import Identity
from emcas_fmu.errors import EmcasError
from emcas_fmu.plotting.plots import Picture, picture, style
from emcas_fmu.support.progress import Progress, silent

from .entry import REASONS, Entry, Shown
from .runs import Runs

REPRODUCED, NOT_FINISHED = "reproduced", "not finished"
OWN = "with this set's values"
"""Status of an entry with the thesis's subject, for which the thesis's values are not available."""
SIMULATED = "shown by simulation"
"""Status of an entry for which the thesis has only a structure, without numbers or curves to reproduce."""


@dataclass(frozen=True)
class Outcome:
    """An entry with its content and picture; `stopped` is the reason why it failed, empty if it did not."""

    entry: Entry
    shown: Shown | None = None
    picture: Picture | None = None
    stopped: str = ""

    @property
    def status(self) -> str:
        """REPRODUCED, SIMULATED, OWN or NOT_FINISHED; or the reason why the entry is not shown."""
        shown = REPRODUCED if self.entry.met else SIMULATED if self.entry.structure else OWN
        return self.entry.reason or (NOT_FINISHED if self.stopped else shown)


@dataclass(frozen=True)
class Result:
    """The outcomes of the selected entries, in the order of the lists, and their parameter set."""

    about: Identity
    outcomes: tuple[Outcome, ...]

    @property
    def stopped(self) -> list[Outcome]:
        """The outcomes of entries that failed."""
        return [outcome for outcome in self.outcomes if outcome.stopped]

    @property
    def counts(self) -> dict[str, int]:
        """The number of outcomes with each status: reproduced ones first, then the others shown, the reasons last."""
        each = [outcome.status for outcome in self.outcomes]
        order = (REPRODUCED, OWN, SIMULATED, NOT_FINISHED, *each)
        return {status: each.count(status) for status in dict.fromkeys(order) if status in each}

    @property
    def headline(self) -> str:
        """The counts in words."""
        done = [f"{count} {status}" for status, count in self.counts.items() if status not in REASONS]
        reasons = {status: count for status, count in self.counts.items() if status in REASONS}
        if reasons:
            each = [f"{count} {status if count == 1 else REASONS[status]}" for status, count in reasons.items()]
            done.append(f"{sum(reasons.values())} not shown: {', '.join(each)}")
        return ", ".join(done)


def carry_out(runs: Runs, entries: Sequence[Entry], progress: Progress = silent) -> Result:
    """Return the outcomes of entries. `progress` gets an entry's name, the number done and the number of all entries.

    If an entry fails with these parameters, its outcome has the reason, and the other entries are still made.
    """
    outcomes = []
    with style(), np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain: nan
        for done, entry in enumerate(entries):
            progress(entry.name, done, len(entries))
            outcomes.append(_outcome(runs, entry))
    progress("done", len(entries), len(entries))
    return Result(runs.subject.identification, tuple(outcomes))


def _outcome(runs: Runs, entry: Entry) -> Outcome:
    if entry.show is None:
        return Outcome(entry)
    try:
        shown = entry.show(runs)
    except (EmcasError, ArithmeticError, ValueError) as error:
        return Outcome(entry, stopped=(str(error) or type(error).__name__).splitlines()[0])
    if shown.figure is None:
        return Outcome(entry, shown)
    words = f"{entry.name}, {entry.title}. {shown.conditions}. {shown.caption}"
    return Outcome(entry, shown, picture(shown.figure, words, shown.caption))
