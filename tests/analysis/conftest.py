"""Parameter sets for which the linear model holds, and the growth of small oscillations in simulations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

Values = Mapping[str, Any]
KICK = radians(5e-3)  # small enough that no limit acts until an oscillation has grown a hundredfold
# A well damped loop for tests of the limits; it does not change with the shipped gains.
LOOP: Values = {"controller.position.kp": 60.0, "controller.position.ki": 60.0, "controller.velocity.kp": 0.05,
                "controller.antiwindup": 1.0}


def without_friction(values: Values, **changes: Any) -> dict[str, Any]:
    """Return changed values without Coulomb friction and its compensation; `a__b` in a keyword means `a.b`."""
    coulomb = {name: 0.0 for name in values if name.startswith("friction.coulomb.")}
    return {**values, **coulomb, "friction.fin_coulomb": 0.0, "compensation.gain": 0.0,
            **{name.replace("__", "."): value for name, value in changes.items()}}


@pytest.fixture(scope="session")
def smooth(values: Values) -> dict[str, Any]:
    """The shipped set without Coulomb friction; angle and speed are fed back without the encoder."""
    return without_friction(values, encoder__enabled=False)


def subject(values: Values, model: str = NONLINEAR) -> ParameterSubject:
    """Return the subject with these values of its parameters."""
    return ParameterSubject(load_parameters(model=model).with_values(values))


def growth(values: Values, at: float, expected_hz: float, respond: Callable[..., Any] = simulate) -> float:
    """Return the factor by which an oscillation near a frequency [Hz] grows in 0.25 s after a small step."""
    period = values["controller.sample_time"]
    run = respond({**values, "fin.start_angle": at}, 0.7, period, fin_command=at + KICK)
    time, rate = run["time"], run["fin_rate"]

    def amplitude(begin: float) -> float:
        inside = (time >= begin) & (time < begin + 0.25)
        window = np.hanning(int(np.sum(inside)))  # keeps slow modes out of the band
        spectrum = np.fft.rfft(window * rate[inside])
        hertz = np.fft.rfftfreq(len(window), period)
        near = (hertz > 0.6 * expected_hz) & (hertz < 1.6 * expected_hz)
        return float(np.sqrt(np.sum(np.abs(spectrum[near]) ** 2)))

    return amplitude(0.4) / amplitude(0.15)


def boundary(values: Values, name: str, at: float, expected_hz: float, low: float, high: float) -> float:
    """Return the value of a parameter at which small oscillations of the simulation neither grow nor decay."""
    assert growth({**values, name: low}, at, expected_hz) < 1.0 < growth({**values, name: high}, at, expected_hz)
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if growth({**values, name: middle}, at, expected_hz) > 1.0 else (middle, high)
    return 0.5 * (low + high)
