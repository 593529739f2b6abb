"""The built-in test: faults that it detects, faults that it cannot detect, and no false alarms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import ceil, pi, radians, sin

import numpy as np
import pytest

from emcas_fmu.extensions.monitors import Watched, modelled, response
from emcas_fmu.extensions.status import DEGRADED, DISABLED, FAILED, OPERATIONAL
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.default_actuator import EVERY

from .fault_runs import BASE, MODEL, TRIPPED, scheduled


def _chirp(t: float) -> float:
    """Return a sine of amplitude 1 whose frequency rises from 0.1 to 20 Hz in 6 s."""
    return sin(2.0 * pi * (0.1 * t + (20.0 - 0.1) / 12.0 * t * t))


def _square(t: float) -> float:
    return radians(10.0 if t % 1.0 < 0.5 else -10.0)


COMMANDS: Mapping[str, Callable[[float], float]] = {
    "step": lambda t: radians(20.0), "step down": lambda t: -radians(20.0),
    **{f"{angle} deg at {rate} Hz": lambda t, a=angle, r=rate: radians(a) * sin(2.0 * pi * r * t)  # type: ignore[misc]
       for angle, rate in ((3.0, 10.0), (5.0, 5.0), (7.0, 5.0), (10.0, 3.0), (20.0, 1.5))},
    "triangle of 75 deg/s": lambda t: radians(20.0) * (1.0 - abs((t * 3.75) % 4.0 - 2.0)),
    "chirp": lambda t: radians(3.5) * _chirp(t),
    "square 4 Hz": lambda t: radians(10.0 if t % 0.25 < 0.125 else -10.0),
    "square 2 Hz": lambda t: radians(20.0 if t % 0.5 < 0.25 else -20.0),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("load", [-100.0, 0.0, 100.0])
def test_no_false_alarm(command: str, load: float) -> None:
    """No monitor trips without a fault, under commands and loads at the limits of Table 2's rating."""
    run = simulate(BASE.values, 6.0, model=MODEL, fin_command=COMMANDS[command], aero_torque=load)
    assert not run["built_in_test"].any()


@pytest.mark.parametrize("model", EVERY)
def test_no_false_alarm_in_any_model(model: str) -> None:
    values = load_parameters(model=f"{model}+faults").values
    for command in COMMANDS.values():
        assert not simulate(values, 3.0, model=f"{model}+faults", fin_command=command)["built_in_test"].any()


@pytest.mark.parametrize(("gain", "share"), [(250.0, 0.25), (1000.0, 1.0), (1500.0, 1.0)])
def test_the_modelled_response_never_passes_its_command(gain: float, share: float) -> None:
    """From -0.1 to 0.2 rad; with Kp_pos Ts beyond 1 Euler's rule alone would go past the command."""
    p = BASE.with_values({
        "controller.position.kp": gain, "controller.sample_time": 1e-3, "monitor.rate": 1e3}).nested()
    watched = Watched(command=0.2, measured=0.0, before=0.0, modelled=-0.1, reference=0.0, current=0.0, supply=39.0,
                      enabled=True)
    assert modelled(FLOATS, p, response(p, BASE.actuator), watched) == pytest.approx(-0.1 + share * 0.3, rel=1e-15)


def test_persistence_is_whole_samples() -> None:
    """After undervoltage from 0.1 to 0.3 s the monitor trips and clears one persistence later, to the sample."""
    for persistence in (0.0, 0.05, 0.0333):
        values = BASE.with_values({"monitor.persistence": persistence}).values
        run = simulate(values, 0.6, model=MODEL, supply_voltage=lambda t: 20.0 if 0.0999 < t < 0.2999 else 39.0)
        tripped = np.flatnonzero(run["built_in_test"] == TRIPPED["supply"])
        samples = max(ceil(persistence / 1e-3 - 1e-6), 1)
        np.testing.assert_array_equal(tripped, np.arange(100 + samples, 300 + samples))
        assert (run["status"][tripped] == DEGRADED).all()


@pytest.mark.parametrize(("fault", "monitor"), [
    ("jam", "tracking"), ("hard_over", "tracking"), ("drive_loss", "drive"), ("encoder_freeze", "tracking"),
    ("encoder_reversed", "stall"), ("current_derating", "drive"), ("brown_out", "supply"),
])
def test_a_fault_trips_its_monitor(fault: str, monitor: str) -> None:
    values = scheduled(MODEL, fault, begin=0.2, fault__current_derating__share=0.05)
    run = simulate(values, 2.0, model=MODEL, fin_command=_square)
    assert any(int(word) & TRIPPED[monitor] for word in run["built_in_test"])
    assert not run["built_in_test"][:200].any()


@pytest.mark.parametrize("fault", ["free_fin", "encoder_bias", "encoder_dropped", "command_freeze", "command_delay"])
def test_a_fault_that_no_sensor_shows_is_not_detected(fault: str) -> None:
    run = simulate(scheduled(MODEL, fault, begin=0.2), 2.0, model=MODEL, fin_command=_square)
    assert not run["built_in_test"].any()
    assert (run["status"] == OPERATIONAL).all()


def test_status() -> None:
    """A jammed fin fails; disabling the drive resets the monitors; a command beyond its limit only degrades."""
    jammed, healed = (simulate(scheduled(MODEL, "jam", begin=0.1, end=end), 1.0, model=MODEL, enable=enable,
                               fin_command=lambda t: radians(8.0) if t > 0.2 else 0.0)
                      for end, enable in ((1e9, lambda t: t < 0.7999), (0.85, lambda t: t < 0.7999 or t > 0.8999)))
    assert jammed["status"][100] == OPERATIONAL
    assert jammed["status"][799] == healed["status"][799] == FAILED
    assert (jammed["status"][801:] == DISABLED).all()
    assert (healed["status"][902:] == OPERATIONAL).all()
    beyond = simulate(BASE.values, 0.5, model=MODEL, fin_command=radians(21.0))
    assert beyond["status"][-1] == DEGRADED
    assert beyond["built_in_test"][-1] == TRIPPED["command"]
