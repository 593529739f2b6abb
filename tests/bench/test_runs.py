"""Several runs in one object: a complete run, a run that ended early, and a refused run."""

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
    """Return three runs of a coarse and a fine column: complete, ended after four rows, and refused."""
    time = np.arange(len(STEP.time)) * STEP.step
    fine = np.arange(3)[:, np.newaxis] * 1e3 + np.arange(STEPS)
    coarse = np.arange(3)[:, np.newaxis] * 1e3 + np.arange(len(STEP.time))
    return Runs(STEP, {"time": time, "fine": fine, "coarse": coarse}, 3, SUBSTEPS,
                {2: EmcasError("refused")}, {1: (4, ("stopped here",))}, 6.0)


def test_complete_run_has_all_points() -> None:
    run = runs()[0]
    assert run.stopped is None
    assert len(run.columns["time"]) == len(run.columns["coarse"]) == len(STEP.time)
    assert len(run.columns["fine"]) == STEPS
    assert run.wall_time == 2.0  # s, of 6.0 for three


def test_run_that_ended_early_has_the_points_up_to_its_last_row() -> None:
    """Four rows are at substeps 0, 3, 6 and 9: the fine column has ten points."""
    run = runs()[1]
    assert run.messages == ("stopped here",)
    assert run.stopped == pytest.approx(3 * STEP.step, rel=1e-12)
    np.testing.assert_array_equal(run.columns["fine"], 1000.0 + np.arange(10))
    np.testing.assert_array_equal(run.columns["coarse"], 1000.0 + np.arange(4))


def test_run_that_ended_before_its_first_row_has_no_points() -> None:
    three = runs()
    three.stopped[1] = (0, ())  # type: ignore[index]
    assert [len(column) for column in three[1].columns.values()] == [0, 0, 0]
    assert three[1].stopped == 0.0


def test_refused_run_raises_its_error() -> None:
    with pytest.raises(EmcasError, match="refused"):
        runs()[2]
    with pytest.raises(IndexError):
        runs()[3]


def test_finished_returns_the_complete_runs() -> None:
    indices, finished = runs().finished()
    assert indices.tolist() == [0]
    assert finished.columns["fine"].shape == (1, STEPS)
    assert finished.columns["time"].shape == STEP.time.shape


def test_scalar_changes_apply_to_every_run() -> None:
    count, values = spread(STEP, {"a": 1.0, "b": np.array([2.0, 3.0])})
    assert count == 2
    assert values["a"].tolist() == [1.0, 1.0]
    assert values["b"].tolist() == [2.0, 3.0]
