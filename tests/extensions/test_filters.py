"""The speed observer and the notch: closed forms, neutral values, equal kernels, and independent integrations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import degrees, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NAMES, NONLINEAR, capabilities, get
from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.frequency import margins
from emcas_fmu.control import filters
from emcas_fmu.control.sensors import Measurement
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import mechanics
from emcas_fmu.simulation import simulate
from tests.analysis.conftest import growth, without_friction
from tests.marks import others_slow
from tests.runs import assert_equal, run_both_kernels

from .runs import case_error

MODEL = "nonlinear+filters"
FILTERED = [name for name in NAMES if get(name).provides.issuperset(
    (capabilities.CASCADE, capabilities.SCREW_EQUATIONS, capabilities.ENCODER))]
NOTCH: Mapping[str, float] = {"filters.notch_frequency": 2.0 * pi * 60.0, "filters.notch_zero_damping": 0.05,
                              "filters.notch_pole_damping": 0.2}
BOTH: Mapping[str, float] = {"filters.speed_bandwidth": 150.0, **NOTCH}
# A hinge without damping: its mode, at 65 Hz, grows with the shipped gains.
HINGE: Mapping[str, float] = {"drive_line.shaft_stiffness": 1e4, "drive_line.fork_stiffness": 0.0,
                              "drive_line.structure_stiffness": 0.0, "drive_line.hinge_damping": 0.0}
_PERIOD = 1e-3


def values_of(changes: Mapping[str, Any], model: str = MODEL, *sets: str) -> Mapping[str, Any]:
    return load_parameters(sets, model=model).with_values(changes).values


def _observe(values: Mapping[str, Any], speed: Any, torque: Any, count: int) -> np.ndarray[Any, Any]:
    """Return the observer's speeds [rad/s] for exact mean speeds and torques, functions of the sample's number."""
    p, state, speeds = get(MODEL).namespace(values), filters.Observed(0.0, 0.0), []
    for k in range(count):
        measured = Measurement(0.0, speed(k), 0.0, 0.0, 0.0)
        estimate, state = filters.observed(FLOATS, p, Record(**state._asdict()), measured,
                                           torque(k) / values["motor.torque_constant"])
        speeds.append(estimate)
    return np.array(speeds)


@settings(max_examples=20)
@given(rate=st.floats(-2e4, 2e4), torque=st.floats(-5.0, 5.0), bandwidth=st.floats(200.0, 3000.0))
def test_the_observer_follows_a_ramp_of_speed_under_any_load(rate: float, torque: float, bandwidth: float) -> None:
    """Without a lag, though the mean speeds that it reads lag by half a sample."""
    values = values_of({"filters.speed_bandwidth": bandwidth})
    found = _observe(values, lambda k: rate * (k - 0.5) * _PERIOD, lambda k: torque, 250)
    # The transient decays to 50 e^-50; 1e-9 is far above the rounding of 5000 rad/s.
    assert found[-1] == pytest.approx(rate * 249 * _PERIOD, abs=1e-9 * (1.0 + abs(rate) + 1e4 * abs(torque)))


@pytest.mark.parametrize("bandwidth", [100.0, 150.0, 1000.0])
def test_the_observer_has_two_poles_at_its_bandwidth(bandwidth: float) -> None:
    """An error decays as e(k) = (c + d k) q^k, which solves e(k) - 2 q e(k - 1) + q^2 e(k - 2) = 0."""
    values, q = values_of({"filters.speed_bandwidth": bandwidth}), np.exp(-bandwidth * _PERIOD)
    found = _observe(values, lambda k: 10.0 if k == 0 else 0.0, lambda k: 0.0, 30)[1:]
    assert abs(found[0]) > 0.1
    np.testing.assert_allclose(found[2:] - 2.0 * q * found[1:-1] + q * q * found[:-2], 0.0, atol=1e-12)


def test_a_step_of_torque_changes_the_estimated_speed_at_once() -> None:
    """By K_t i T/J in the first sample."""
    values = values_of({"filters.speed_bandwidth": 150.0})
    inertia = mechanics.coefficients(FLOATS, get(MODEL).namespace(values), 0.0).inertia
    found = _observe(values, lambda k: 0.5 * _PERIOD * 1.0 / inertia, lambda k: 1.0, 1)
    assert found[0] == pytest.approx(_PERIOD / inertia, rel=1e-12)


@settings(max_examples=20)
@given(share=st.floats(0.1, 0.9), zero=st.floats(0.0, 0.5), pole=st.floats(0.2, 1.0), at=st.floats(0.01, 0.95))
def test_the_notch_has_the_frequency_response_of_its_closed_form(share: float, zero: float, pole: float, at: float
                                                                 ) -> None:
    """Numerator and denominator are W^2 - v^2 + 2j z W v with v = W tan(wT/2)/tan(WT/2).

    The sum over the impulse response is the frequency response at w.
    """
    frequency, zero = share * pi / _PERIOD, min(zero, pole)
    values = values_of({"filters.notch_frequency": frequency, "filters.notch_zero_damping": zero,
                      "filters.notch_pole_damping": pole})
    p, x, out = get(MODEL).namespace(values), filters.Notched(0.0, 0.0), []
    for k in range(500):
        value, x = filters.notched(FLOATS, p, Record(**x._asdict()), float(k == 0))
        out.append(value)
    omega = at * pi / _PERIOD
    warped = frequency * np.tan(0.5 * omega * _PERIOD) / np.tan(0.5 * frequency * _PERIOD)
    numerator, denominator = (frequency**2 - warped**2 + 2j * z * frequency * warped for z in (zero, pole))
    response = np.sum(out * np.exp(-1j * omega * _PERIOD * np.arange(500)))
    # The slowest impulse response decays by about e^(-0.2 0.1 pi 500) = 2e-14, and that of poles on the real axis, at
    # tan(0.05 pi) = 0.16 for z = 1, faster; rounding adds less.
    assert response == pytest.approx(numerator / denominator, abs=1e-6)
    assert np.sum(out) == pytest.approx(1.0, abs=1e-6)


def _inputs() -> dict[str, Any]:
    return {"fin_command": lambda t: 0.15 * sin(20.0 * t) + 0.1 * (t > 0.1), "enable": lambda t: not 0.2 < t < 0.25,
            "aero_torque": lambda t: 30.0 * sin(9.0 * t)}


@pytest.mark.parametrize("base", others_slow(FILTERED, lambda name: name == NONLINEAR))
def test_without_bandwidth_and_notch_no_bit_changes(base: str) -> None:
    assert_equal(*(simulate(load_parameters(model=model).values, 0.4, model=model, **_inputs())
                   for model in (f"{base}+filters", base)))


def test_without_an_encoder_the_observer_has_no_effect() -> None:
    assert_equal(*(simulate(values_of({"encoder.enabled": False, "filters.speed_bandwidth": bandwidth}), 0.4,
                            model=MODEL, **_inputs()) for bandwidth in (0.0, 150.0)))


@pytest.mark.parametrize("base", others_slow(FILTERED, lambda name: name in (NONLINEAR, "clutch")))
def test_kernels_agree(base: str) -> None:
    model = f"{base}+filters"
    run_both_kernels(values_of(BOTH, model), 0.3, model, **_inputs())


@pytest.mark.parametrize(("changes", "name"), [
    pytest.param(changes, name, id=f"{label}-{name}", marks=() if name == quick else pytest.mark.slow)
    for label, changes, quick in (
        ("both", BOTH, "step_plus20"),
        ("on the fin", {"encoder.on_fin": True, "filters.speed_bandwidth": 150.0}, "load_opposing"),
        ("true angles", {"encoder.enabled": False, **NOTCH}, "step_plus20"))
    for name in ("step_plus20", "load_opposing")])
def test_independent_integration_agrees(changes: Mapping[str, Any], name: str) -> None:
    """With a load observer, at the limits of drive and supply, within the 0.002 deg of every reference."""
    rows = 200 if name == "step_plus20" else 400  # a load comes at 0.35 s
    assert case_error(MODEL, values_of({**changes, "controller.load_observer": 150.0}), name, rows) < 0.002


def test_the_motion_waits_for_the_notch() -> None:
    """The independent integration delays the motion by the notch's lag, too."""
    model = "nonlinear+filters+trajectory"
    values = values_of(BOTH, model, "two-degrees-of-freedom")
    assert case_error(model, values, "step_plus20", 220, encoder__enabled=True) < 0.002


@pytest.mark.parametrize("changes", [{"filters.speed_bandwidth": 800.0}, BOTH], ids=["observer", "both"])
def test_the_gain_margin_is_where_oscillation_begins(changes: Mapping[str, Any]) -> None:
    """The linear model includes the filters: 2 % below its margin small oscillations decay, 2 % above it they grow."""
    values = without_friction(values_of(changes), encoder__pulses=1_000_000)
    found, gain = margins(LinearActuator(values, model=MODEL).loop("reference")), values["drive.current_gain"]
    for share, grows in ((0.98, False), (1.02, True)):
        scaled = {**values, "drive.current_gain": gain * found.gain * share}
        assert (growth(scaled, 0.0, found.phase_crossover, partial(simulate, model=MODEL)) > 1.0) is grows


def test_the_shipped_observer_has_the_margins_of_the_documentation() -> None:
    """The figures are in docs/model/control.md."""
    for sets, phase, gain in ((("speed-observer",), 3.6, 1.1), (("load-observer", "speed-observer"), 4.7, 3.3)):
        before, after = (margins(LinearActuator(each.values, model=each.model).loop("reference"))
                         for each in (load_parameters(sets[:-1]), load_parameters(sets)))
        assert degrees(after.phase - before.phase) == pytest.approx(phase, abs=0.1)
        assert after.gain_db - before.gain_db == pytest.approx(gain, abs=0.1)


def test_a_notch_damps_the_mode_of_a_soft_hinge() -> None:
    """After a push of 300 N.m for 0.1 s the fin without the notch keeps swinging."""
    model = "elastic+filters"

    def swing(changes: Mapping[str, Any]) -> float:
        run = simulate(values_of({**HINGE, **changes}, model), 1.5, model=model,
                       aero_torque=lambda t: 300.0 if 0.1 < t < 0.2 else 0.0)
        return degrees(np.ptp(run["fin_angle"][run["time"] > 1.2]))

    assert swing({}) > 10.0
    assert swing(NOTCH) < 0.1


@pytest.mark.parametrize("sets", [("speed-observer",), ("two-degrees-of-freedom", "speed-observer")])
def test_with_the_observer_the_fin_reaches_its_command_after_a_jam(sets: tuple[str, ...]) -> None:
    parameters = load_parameters(sets, model="nonlinear+faults").with_values(
        {"fault.jam.begin": 0.08, "fault.jam.end": 0.5})
    run = simulate(parameters.values, 3.0, model=parameters.model,
                   fin_command=lambda t: radians(20.0) if t >= 0.05 else 0.0)
    assert degrees(run["fin_angle"][-1]) == pytest.approx(20.0, abs=0.02)


def test_a_notch_is_at_rest_when_the_drive_is_enabled() -> None:
    """A fin at its command does not move, whatever the command was before the drive was disabled."""
    def angles(last: float) -> Any:
        return simulate(values_of(BOTH), 0.6, model=MODEL, enable=lambda t: t < 0.1 or t >= 0.4,
                        fin_command=lambda t: radians(5.0) if 0.05 <= t < 0.1 else last * (t >= 0.3))["fin_angle"]

    rest = float(angles(0.0)[399])
    assert degrees(np.max(np.abs(angles(rest)[401:] - rest))) < 0.02  # counts


@pytest.mark.parametrize(("changes", "message"), [
    ({"filters.notch_frequency": 4000.0}, r"notch_frequency = 4000 rad/s .*below half the sample rate.*3141\.59"),
    ({"filters.notch_zero_damping": 0.7}, r"notch_zero_damping = 0\.7 must be at most"),
])
def test_a_notch_beyond_its_limits_is_refused(changes: Mapping[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        values_of(changes)
