"""Figures of the analysis agree with simulations of the FMU by fmpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator

from .conftest import growth

pytestmark = pytest.mark.fmu
Respond = Callable[..., Any]


@pytest.fixture
def respond(native: Path, values: Mapping[str, Any], capsys: pytest.CaptureFixture[str]) -> Respond:
    """Function that runs the native FMU with parameters and a command, constant or a function of time [s]."""
    def run(parameters: Mapping[str, Any], stop: float, step: float, fin_command: Any) -> Any:
        time = np.arange(round(stop / step) + 1) * step
        signals = np.zeros(len(time), dtype=[("time", float), ("fin_command", float)])
        signals["time"] = time
        signals["fin_command"] = fin_command(time) if callable(fin_command) else fin_command
        changed = {name: value for name, value in parameters.items() if values[name] != value}
        found = simulate_fmu(str(native), stop_time=stop, output_interval=step, input=signals, start_values=changed,
                             output=["fin_angle", "fin_rate"])
        capsys.readouterr()  # fmpy prints the inputs without a signal
        return found

    return run


def gain(respond: Respond, parameters: Mapping[str, Any], hertz: float) -> complex:
    """Return the complex gain from a small sine command to the fin angle, fitted over the last 0.5 s."""
    found = respond(parameters, 1.5, 1e-3, lambda t: radians(0.02) * np.sin(2.0 * np.pi * hertz * t))
    late = found["time"] >= 1.0
    phase = 2.0 * np.pi * hertz * found["time"][late]
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones(phase.size)])
    (sine, cosine, _), *_ = np.linalg.lstsq(basis, found["fin_angle"][late], rcond=None)
    return complex(sine, cosine) / radians(0.02)


def test_bandwidth_is_accurate_to_3_percent(respond: Respond, smooth: Mapping[str, Any]) -> None:
    linear = frequency.response(LinearActuator(smooth).command_to_angle)
    level = 10.0 ** (-3.0 / 20.0)
    inside, outside = (abs(gain(respond, smooth, share * linear.bandwidth)) for share in (0.97, 1.03))
    assert inside > level > outside
    before, after = (gain(respond, smooth, share * linear.phase_bandwidth) for share in (0.97, 1.03))
    assert before.real > 0.0 > after.real  # less and more than 90 deg of lag


def test_margins_are_accurate_to_5_percent(respond: Respond, smooth: Mapping[str, Any]) -> None:
    """Oscillations decay at 95 % of a margin and grow at 105 %."""
    margins = frequency.margins(LinearActuator(smooth).loop("reference"))
    gain_before, delay = smooth["drive.current_gain"], smooth["drive.transport_delay"]
    for share, grows in ((0.95, False), (1.05, True)):
        by_gain = {**smooth, "drive.current_gain": gain_before * (1.0 + (margins.gain - 1.0) * share)}
        by_delay = {**smooth, "drive.transport_delay": delay + margins.delay * share}
        assert (growth(by_gain, 0.0, margins.phase_crossover, respond) > 1.0) is grows
        assert (growth(by_delay, 0.0, margins.gain_crossover, respond) > 1.0) is grows
