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
    """A required run did not reach its end."""


@dataclass(frozen=True)
class Run:
    """The response to an excitation: `columns` by name in SI, with ``time`` [s].

    ``stopped`` is the last time [s] that the subject reached, None if it ran to the end; ``messages`` is its log;
    ``wall_time`` is in s. A Run may also contain many finished runs: its columns, except ``time``, are then arrays
    [runs, rows].
    """

    excitation: Excitation = field(repr=False)
    columns: Columns = field(repr=False)
    stopped: float | None
    messages: tuple[str, ...]
    wall_time: float

    @property
    def reason(self) -> str:
        """The reason why the run ended early; empty if it did not."""
        if self.stopped is None:
            return ""
        return f"went no further than {self.stopped:.6g} s: {self.messages[-1] if self.messages else 'no message'}"

    def of(self, run: int) -> Run:
        """Return one run of many."""
        return replace(self, excitation=self.excitation.of(run), columns=_of(self.columns, run))

    def finished(self) -> Columns:
        """Return the columns. Raises StoppedError with the reason if the run ended early."""
        if self.stopped is not None:
            raise StoppedError(f"the subject {self.reason}")
        return self.columns


@dataclass(frozen=True)
class Runs:
    """The responses of `number` runs to excitations with the same rows.

    `columns` by name are arrays [runs, rows], except ``time`` [rows]; a fine column has (rows - 1) substeps + 1 points.
    Rows that a run did not reach are nan. `refused` maps the index of a refused run to its error; `stopped` maps the
    index of a run that ended early to its number of rows and its log. The columns of `runs[index]` are views, equal to
    those of a simulation of that run alone.
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

    def __getitem__(self, index: int) -> Run:
        """Return a run. Raises its error if the run was refused."""
        index = range(self.number)[index]
        if index in self.refused:
            raise self.refused[index]
        excitation, columns = self.excitation.of(index), _of(self.columns, index)
        stopped, messages = None, tuple[str, ...]()
        if index in self.stopped:
            rows, messages = self.stopped[index]
            steps, full = max((rows - 1) * self.substeps + 1, 0), len(self.columns["time"])
            columns = {name: column[:rows if len(column) == full else steps] for name, column in columns.items()}
            stopped = float(np.max(columns["time"], initial=0.0))
        return Run(excitation, columns, stopped, messages, self.wall_time / self.number)

    def finished(self) -> tuple[Any, Run]:
        """Return the indices of the runs that reached their end, and these runs as one Run."""
        if not self.refused and not self.stopped:
            return np.arange(self.number), Run(self.excitation, self.columns, None, (), self.wall_time)
        indices = np.setdiff1d(np.arange(self.number), [*self.refused, *self.stopped])
        return indices, Run(self.excitation.of(indices), _of(self.columns, indices), None, (), self.wall_time)


def _of(columns: Columns, runs: Any) -> dict[str, Array]:
    """Return the columns of one run, or of several."""
    return {name: column if name == "time" else column[runs] for name, column in columns.items()}


def spread(excitation: Excitation, changes: Mapping[str, Any]) -> tuple[int, dict[str, Array]]:
    """Return the number of runs, and each changed parameter's values [runs], in the units of `changes`."""
    of_runs = [len(column) for column in excitation.columns.values() if column.ndim == 2]
    (count,) = np.broadcast_shapes((1,), *of_runs, *map(np.shape, changes.values()))
    return count, {name: np.broadcast_to(values, count) for name, values in changes.items()}
