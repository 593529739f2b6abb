"""Runs side by side: a single one of them, one that stopped within its rows, one that was refused."""

from __future__ import annotations

import numpy as np
import pytest

from emcas_fmu.bench.excitation import step_to
from emcas_fmu.bench.runs import Runs, spread
from emcas_fmu.errors import EmcasError

ROWS, SUBSTEPS = 6, 3
STEP = step_to(0.1, (ROWS - 1) * 1e-3)
STEPS = (len(STEP.time) - 1) * SUBSTEPS + 1


def runs() -> Runs:
    """Three runs of a coarse and a fine column: one ends, one stops after four rows, one is refused."""
    time = np.arange(len(STEP.time)) * STEP.step
    fine = np.arange(3)[:, np.newaxis] * 1e3 + np.arange(STEPS)
    coarse = np.arange(3)[:, np.newaxis] * 1e3 + np.arange(len(STEP.time))
    return Runs(STEP, {"time": time, "fine": fine, "coarse": coarse}, 3, SUBSTEPS,
                {2: EmcasError("refused")}, {1: (4, ("stopped here",))}, 6.0)


def test_a_run_that_ended_has_all_its_points() -> None:
    run = runs()[0]
    assert run.stopped is None
    assert len(run.columns["time"]) == len(run.columns["coarse"]) == len(STEP.time)
    assert len(run.columns["fine"]) == STEPS
    assert run.wall_time == 2.0  # s, of 6.0 for three


def test_a_run_that_stopped_ends_at_its_last_row() -> None:
    """Four rows lie at 0, 3, 6 and 9 substeps: ten points."""
    run = runs()[1]
    assert run.messages == ("stopped here",)
    assert run.stopped == pytest.approx(3 * STEP.step, rel=1e-12)
    np.testing.assert_array_equal(run.columns["fine"], 1000.0 + np.arange(10))
    np.testing.assert_array_equal(run.columns["coarse"], 1000.0 + np.arange(4))


def test_a_run_that_never_began_has_no_points() -> None:
    began = runs()
    began.stopped[1] = (0, ())  # type: ignore[index]
    assert [len(column) for column in began[1].columns.values()] == [0, 0, 0]
    assert began[1].stopped == 0.0


def test_a_refused_run_raises_its_own_error() -> None:
    with pytest.raises(EmcasError, match="refused"):
        runs()[2]
    with pytest.raises(IndexError):
        runs()[3]


def test_those_that_ended_are_one_run() -> None:
    indices, finished = runs().finished()
    assert indices.tolist() == [0]
    assert finished.columns["fine"].shape == (1, STEPS)
    assert finished.columns["time"].shape == STEP.time.shape


def test_changes_are_spread_over_the_runs() -> None:
    count, values = spread(STEP, {"a": 1.0, "b": np.array([2.0, 3.0])})
    assert count == 2
    assert values["a"].tolist() == [1.0, 1.0]
    assert values["b"].tolist() == [2.0, 3.0]
