"""Checks and measurements that tests of several actuators share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians
from typing import Any

import numpy as np
from hypothesis import strategies as st

from emcas_fmu.simulation import simulate

INPUT_LEVELS = st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-300.0, 300.0), st.booleans()),
                        min_size=2, max_size=8)
"""Levels of command [rad], load [N.m] and enable."""


def assert_kernels_agree(values: Mapping[str, Any], model: str, stop: float, step: float = 1e-3, **inputs: Any
                         ) -> dict[str, Any]:
    """Check that the Python and the compiled kernel compute the same bits, and return their outputs."""
    python, compiled = (simulate(values, stop, step, kernel, model, **inputs) for kernel in ("python", "compiled"))
    for name, column in python.items():
        assert np.array_equal(compiled[name], column), name
    return python


def run_within_stops(values: Mapping[str, Any], model: str, levels: Sequence[tuple[float, float, bool]]
                     ) -> dict[str, Any]:
    """Simulate input levels of 20 ms each; check that outputs are finite and the fin is within its stops at 25 deg."""
    commands, torques, enables = (np.repeat(column, 20) for column in zip(*levels, strict=True))
    run = simulate(values, (len(commands) - 1) * 1e-3, model=model, fin_command=commands, aero_torque=torques,
                   enable=enables)
    assert all(np.isfinite(column).all() for column in run.values())
    assert np.abs(run["fin_angle"]).max() <= radians(25.0) * (1.0 + 1e-12)
    return run


def convergence_order(ticks: Sequence[float], errors: Sequence[float]) -> float:
    """Return the order of convergence: the slope of the errors over the ticks, both logarithmic."""
    return float(np.polyfit(np.log(ticks), np.log(errors), 1)[0])


def oscillation_frequency(signal: Any, step: float) -> float:
    """Return the frequency [Hz] of a signal with rows `step` [s] apart, from its rising zero crossings."""
    rising = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    times = (rising - signal[rising] / (signal[rising + 1] - signal[rising])) * step
    return float((len(times) - 1) / (times[-1] - times[0]))
