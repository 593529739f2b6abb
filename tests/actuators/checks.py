"""Measurements that tests of several actuators share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def convergence_order(ticks: Sequence[float], errors: Sequence[float]) -> float:
    """Return the order of convergence: the slope of the errors over the ticks, both logarithmic."""
    return float(np.polyfit(np.log(ticks), np.log(errors), 1)[0])


def oscillation_frequency(signal: Any, step: float) -> float:
    """Return the frequency [Hz] of a signal with rows `step` [s] apart, from its rising zero crossings."""
    rising = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    times = (rising - signal[rising] / (signal[rising + 1] - signal[rising])) * step
    return float((len(times) - 1) / (times[-1] - times[0]))
