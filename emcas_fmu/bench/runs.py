"""Responses to excitations: of one run, and of many side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import EmcasError
from ..simulation import Array
from .excitation import Excitation

Columns = Mapping[str, Array]


class StoppedError(EmcasError):
    """A run that is needed did not reach its end."""


@dataclass(frozen=True)
class Run:
    """The response to an excitation: `columns` by name, `time` [s] first, and those that were asked for between rows.

    Of many runs that ended well the columns are arrays [runs, rows], but for ``time``.
    ``stopped`` is the time [s] the subject went no further than, None where it ran to the end;
    ``messages`` what it logged; ``wall_time`` [s].
    """

    excitation: Excitation = field(repr=False)
    columns: Columns = field(repr=False)
    stopped: float | None
    messages: tuple[str, ...]
    wall_time: float

    @property
    def reason(self) -> str:
        """Why the run ended early; empty where it did not."""
        if self.stopped is None:
            return ""
        return f"went no further than {self.stopped:.6g} s: {self.messages[-1] if self.messages else 'no reason given'}"

    def of(self, run: int) -> Run:
        """Return one run of many."""
        return replace(self, excitation=self.excitation.of(run), columns=_of(self.columns, run))

    def finished(self) -> Columns:
        """Return the columns. Raises StoppedError, saying why, where the run ended early."""
        if self.stopped is not None:
            raise StoppedError(f"the subject {self.reason}")
        return self.columns


@dataclass(frozen=True)
class Runs:
    """The responses of many runs to excitations with the same rows.

    `columns` by name are arrays [runs, rows], but ``time`` [rows]; those that are fine have `substeps` to each row. In
    rows that a run did not get to they are NaN. By a run's place: `refused` is what a single run would raise, `stopped`
    the rows it has and what it logged. A run of it is what it is alone, its columns are views.
    """

    excitation: Excitation = field(repr=False)
    columns: Columns = field(repr=False)
    number: int
    substeps: int
    refused: Mapping[int, Exception]
    stopped: Mapping[int, tuple[int, tuple[str, ...]]]
    wall_time: float

    def __len__(self) -> int:
        return self.number

    def __getitem__(self, place: int) -> Run:
        """Return a run. Raises what it was refused with."""
        place = range(self.number)[place]
        if place in self.refused:
            raise self.refused[place]
        time, taken = self.columns["time"], self.wall_time / self.number
        columns = _of(self.columns, place)
        if place not in self.stopped:
            return Run(self.excitation.of(place), columns, None, (), taken)
        rows, messages = self.stopped[place]
        steps = max((rows - 1) * self.substeps + 1, 0)
        columns = {name: column[:rows if len(column) == len(time) else steps] for name, column in columns.items()}
        return Run(self.excitation.of(place), columns, float(np.max(columns["time"], initial=0.0)), messages, taken)

    def finished(self) -> tuple[Any, Run]:
        """Return the places of the runs that ended well, and these as one."""
        if not self.refused and not self.stopped:
            return np.arange(self.number), Run(self.excitation, self.columns, None, (), self.wall_time)
        places = np.setdiff1d(np.arange(self.number), [*self.refused, *self.stopped])
        return places, Run(self.excitation.of(places), _of(self.columns, places), None, (), self.wall_time)


def _of(columns: Columns, runs: Any) -> dict[str, Array]:
    """Return the columns of one run, or of some."""
    return {name: column if name == "time" else column[runs] for name, column in columns.items()}


def spread(excitation: Excitation, changes: Mapping[str, Any]) -> tuple[int, dict[str, Array]]:
    """Return how many runs there are, and for each parameter that differs an array with its value in each."""
    of_runs = [len(column) for column in excitation.columns.values() if column.ndim == 2]
    (count,) = np.broadcast_shapes((1,), *of_runs, *map(np.shape, changes.values()))
    return count, {name: np.broadcast_to(values, count) for name, values in changes.items()}
