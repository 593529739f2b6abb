"""Runs that tests of actuators and of extensions share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians
from typing import Any

import numpy as np
from hypothesis import strategies as st

from emcas_fmu.simulation import simulate

Levels = Sequence[tuple[float, float, bool]]


def input_levels(count: int) -> st.SearchStrategy[list[tuple[float, float, bool]]]:
    """Return up to `count` random levels of command [rad], load [N.m] and enable, each for 20 ms."""
    return st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()), min_size=2,
                    max_size=count)


def assert_equal(run: Mapping[str, Any], expected: Mapping[str, Any], *, rows: slice = slice(None)) -> None:
    """Check that a run has every column of `expected`, bit for bit."""
    for name, column in expected.items():
        assert np.array_equal(run[name][rows], column[rows]), name


def run_both_kernels(values: Mapping[str, Any], stop: float, model: str, step: float = 1e-3, **inputs: Any
                     ) -> Mapping[str, Any]:
    """Return a run in Python after a check that the compiled kernel computes the same bits."""
    python, compiled = (simulate(values, stop, step, kernel, model, **inputs) for kernel in ("python", "compiled"))
    assert_equal(compiled, python)
    return python


def run_within_stops(values: Mapping[str, Any], model: str, levels: Levels) -> Mapping[str, Any]:
    """Simulate input levels of 20 ms each; check that outputs are finite and the fin is within its stops at 25 deg."""
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    run = simulate(values, (len(commands) - 1) * 1e-3, model=model, fin_command=commands, aero_torque=torques,
                   enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)
    return run
