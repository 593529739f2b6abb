"""Latency, resolution and update time of the command that reaches the controllers."""

from __future__ import annotations

from math import pi, radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.reference.plant import simulate as reference_of
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis import thesis

MODELS = ["nonlinear", "elastic+faults", "nonlinear+homing", "second-order", "tests/actuators/driven.py"]
TIMES = np.arange(301) * 1e-3


def _run(model: str, command: Any, kernel: str = "auto", **changes: float) -> dict[str, Any]:
    settings: dict[str, object] = {f"command.{name}": value for name, value in changes.items()}
    base = load_parameters(model=model)
    values = base.with_values(settings | base.having({"homing.required": False})).values
    return simulate(values, TIMES[-1], model=model, kernel=kernel, fin_command=command)


def _swept(t: Any) -> Any:
    return 0.3 * np.sin(2.0 * pi * (2.0 + 20.0 * t) * t)


@pytest.mark.parametrize("model", MODELS)
def test_latency_is_a_shift_of_the_command(model: str) -> None:
    """A latency of 5.2 ms equals to the bit a host that sends 5 ms later, and the start angle, 0, before."""
    late = _run(model, _swept(TIMES), latency=5.2e-3)
    shifted = _run(model, np.append(np.zeros(5), _swept(TIMES))[:len(TIMES)])
    assert np.array_equal(late["fin_angle"], shifted["fin_angle"])
    assert np.ptp(late["fin_angle"]) > 0.1
    # The tracking error refers to the command at the port, which is constant over the step to a row.
    sent = np.clip(_swept(TIMES)[:-1], -radians(20.0), radians(20.0))
    assert late["tracking_error"][1:] == pytest.approx(sent - late["fin_angle"][1:], abs=1e-15)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("late", [0, 3])
def test_update_time_and_resolution_make_steps_of_the_command(model: str, late: int) -> None:
    """The response equals to the bit that to every fourth command rounded to 0.5 deg; 3.6 ms are 4 samples."""
    step = radians(0.5)
    sent = _swept(TIMES)
    stepped = (step * np.floor(sent / step + 0.5))[np.arange(len(TIMES)) // 4 * 4]
    expected = _run(model, np.append(np.zeros(late), stepped)[:len(TIMES)])
    run = _run(model, sent, latency=late * 1e-3, update_time=3.6e-3, resolution=step)
    assert np.array_equal(run["fin_angle"], expected["fin_angle"])
    python = _run(model, sent, "python", latency=late * 1e-3, update_time=3.6e-3, resolution=step)
    assert all(np.array_equal(column, python[name]) for name, column in run.items())


def test_start_angle_is_commanded_until_the_first_command_arrives() -> None:
    values = load_parameters().with_values({"fin.start_angle": 0.1, "command.latency": 0.02}).values
    angle = simulate(values, 0.1)["fin_angle"]
    # The command of 0 arrives at 20 ms, and its reference acts at 23.7 ms; until then friction holds the fin.
    assert np.ptp(angle[:24]) == 0.0
    assert angle[-1] < 0.05


def test_latency_beyond_20_samples_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"command.latency = 0.021 s must be at most 20 times controller.sample"):
        load_parameters().with_values({"command.latency": 0.021})
    load_parameters().with_values({"command.latency": 0.02})


def test_latency_of_5_ms_lags_by_9_deg_at_5_hz() -> None:
    """The response to the command lags, of the actuator and of both linear models; loops and load response do not."""
    values = dict(load_parameters().values)
    slow_bus = {**values, "command.latency": 5e-3, "command.resolution": 0.01, "command.update_time": 4e-3}
    z = np.exp(2j * pi * 5.0 * 1e-3)
    prompt, late = LinearActuator(values), LinearActuator(slow_bus)
    # The lag is 2 pi f times the latency; tolerances are rounding of the systems' evaluation.
    assert np.degrees(np.angle(prompt.command_to_angle(z) / late.command_to_angle(z))) == pytest.approx(9.0, abs=1e-6)
    assert late.load_to_angle(z) == pytest.approx(prompt.load_to_angle(z), rel=1e-9)
    for name in ("velocity", "position", "reference"):
        assert late.loop(name)(z) == prompt.loop(name)(z)
    delayed = {**values, "command.latency": 5e-3}  # the linear model has neither resolution nor update time
    before, after = (LinearModel(v).frequency_response(np.array([5.0]))[0] for v in (values, delayed))
    assert np.degrees(np.angle(before / after)) == pytest.approx(9.0, abs=1e-9)
    command = np.full(100, 0.01)
    np.testing.assert_array_equal(LinearModel(delayed).simulate(command)[5:],
                                  LinearModel(values).simulate(command)[:-5])
    ratio = thesis.closed(values)(z) / thesis.closed(delayed)(z)
    assert np.degrees(np.angle(ratio)) == pytest.approx(9.0, abs=1e-6)


def test_against_the_independent_integration() -> None:
    """A late, coarse, slowly updated command at -30 degC is within the bound of the reference cases."""
    values = {**load_parameters().values, "encoder.enabled": False, "command.latency": 7.4e-3,
              "command.update_time": 6e-3, "command.resolution": radians(0.7), "friction.temperature": -30.0,
              "fin.start_angle": 0.05}
    command = 0.2 * np.sin(2.0 * pi * 3.0 * TIMES)
    exact = reference_of(values, {"time": TIMES, "fin_command": command, "aero_torque": np.full(len(TIMES), -40.0)})
    found = simulate(values, TIMES[-1], fin_command=command, aero_torque=-40.0)
    assert np.ptp(exact["fin_angle"]) > 0.2
    # 0.00017 deg measured.
    assert np.degrees(np.abs(found["fin_angle"] - exact["fin_angle"])).max() < 0.002
