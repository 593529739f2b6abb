"""The whole of it: every chosen entry shown, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from emcas_fmu.bench.subject import Identification
from emcas_fmu.errors import EmcasError
from emcas_fmu.figures.plots import Picture, picture, style
from emcas_fmu.support.progress import Progress, silent

from .entry import REASONS, Entry, Shown
from .runs import Runs

REPRODUCED, NOT_FINISHED = "reproduced", "not finished"
OWN = "own values"
"""Of what has the thesis's subject and the set's own values: the thesis's are lost, or were never published."""
SIMULATED = "shown by simulation"
"""Of what the thesis draws as a structure only: nothing of it is there to be reproduced."""


@dataclass(frozen=True)
class Outcome:
    """An entry with what it shows and its picture; `stopped` says why one could not be carried out."""

    entry: Entry
    shown: Shown | None = None
    picture: Picture | None = None
    stopped: str = ""

    @property
    def status(self) -> str:
        """REPRODUCED where the thesis's own is met, SIMULATED, OWN, NOT_FINISHED, or the reason why it is not shown."""
        shown = REPRODUCED if self.entry.met else SIMULATED if self.entry.structure else OWN
        return self.entry.reason or (NOT_FINISHED if self.stopped else shown)


@dataclass(frozen=True)
class Result:
    """The outcomes of the entries chosen, in the order of the lists, and the parameter set they are of."""

    about: Identification
    outcomes: tuple[Outcome, ...]

    @property
    def stopped(self) -> list[Outcome]:
        """Those that could not be carried out."""
        return [outcome for outcome in self.outcomes if outcome.stopped]

    @property
    def counts(self) -> dict[str, int]:
        """How many have each status, those reproduced first, then those shown, the reasons last."""
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
    """Show entries. `progress` is called with the entry's name, how many are done and how many there are.

    An entry that these parameters do not allow is an outcome, with the reason; the others are shown all the same.
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
