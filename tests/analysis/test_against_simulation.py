"""Figures of the analysis agree with simulations of the nonlinear model."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.frequency_response import of_ratio
from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics.loads import NONE
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis import sweep
from emcas_fmu.studies.analysis.capability import steady_rate
from emcas_fmu.studies.analysis.steps import compare
from tests.default_actuator import namespace
from tests.marks import others_slow, slow

from .conftest import LOOP, boundary, subject, without_friction

Values = Mapping[str, Any]
ANGLES = [radians(-9.0), *slow(0.0, radians(15.0))]


GRID = np.geomspace(0.5, 80.0, 36)  # Hz


def swept(values: Values, amplitude: float, at: float, frequency: Any = GRID) -> sweep.Sweep:
    size = np.full(len(frequency), amplitude)
    ratio, *active = sweep.sines(subject(values), size, frequency, at).T
    return sweep.Sweep(amplitude, of_ratio(frequency, ratio), np.real(active))


@pytest.mark.parametrize("at", ANGLES)
def test_bandwidth_agrees_with_simulated_small_sines(smooth: Values, at: float) -> None:
    measured = swept(smooth, radians(0.02), at).response
    linear = frequency.response(LinearActuator(smooth, at).command_to_angle)
    assert np.max(swept(smooth, radians(0.02), at).active) == 0.0
    # The differences are the mean of two viscous coefficients, and the lever's curvature.
    assert linear.bandwidth == pytest.approx(measured.bandwidth, rel=5e-3)
    assert linear.phase_bandwidth == pytest.approx(measured.phase_bandwidth, rel=5e-3)


def test_bandwidth_with_the_encoder_agrees_with_simulated_sines(values: Values) -> None:
    p = without_friction(values)
    measured = swept(p, radians(0.3), 0.0).response  # 430 counts
    with_lag = frequency.response(LinearActuator(p).command_to_angle)
    without = frequency.response(LinearActuator({**p, "encoder.enabled": False}).command_to_angle)
    assert with_lag.bandwidth == pytest.approx(measured.bandwidth, rel=0.03)
    # The linear model has the encoder's lag of half a sample: without it the difference is larger.
    assert abs(with_lag.bandwidth / measured.bandwidth - 1.0) < abs(without.bandwidth / measured.bandwidth - 1.0)


def test_frequency_response_agrees_with_simulated_small_sines(smooth: Values) -> None:
    measured = swept(smooth, radians(0.02), radians(10.0)).response
    linear = frequency.evaluate(LinearActuator(smooth, radians(10.0)).command_to_angle, measured.frequency)
    complex_gain = measured.gain * np.exp(1j * measured.phase)
    # After one second less than 2 % of the slow integral mode's transient is left.
    np.testing.assert_allclose(complex_gain, linear, rtol=0, atol=0.02)


@pytest.mark.parametrize("encoder", [False, True])
@pytest.mark.parametrize("at", [0.0, radians(15.0)])
def test_oscillations_begin_at_the_gain_margin(values: Values, at: float, encoder: bool) -> None:
    # The finest counts that the parameter allows avoid quantisation of the small signal.
    p = without_friction(values, encoder__enabled=encoder, encoder__pulses=1_000_000)
    margins = frequency.margins(LinearActuator(p, at).loop("reference"))
    gain = p["drive.current_gain"]
    found = boundary(p, "drive.current_gain", at, margins.phase_crossover, gain * margins.gain * 0.93,
                     gain * margins.gain * 1.07)
    assert found / gain == pytest.approx(margins.gain, rel=0.01)


@pytest.mark.parametrize("at", [0.0, radians(15.0)])
def test_oscillations_begin_at_the_delay_margin(smooth: Values, at: float) -> None:
    margins = frequency.margins(LinearActuator(smooth, at).loop("reference"))
    assert margins.delay == pytest.approx(margins.phase / (2.0 * np.pi * margins.gain_crossover), rel=1e-6)
    delay = smooth["drive.transport_delay"]
    found = boundary(smooth, "drive.transport_delay", at, margins.gain_crossover, delay + 0.93 * margins.delay,
                     delay + 1.07 * margins.delay)
    assert found - delay == pytest.approx(margins.delay, rel=0.03)


@pytest.mark.parametrize("torque", [0.0, -60.0])
def test_small_step_agrees_with_the_linear_model(smooth: Values, torque: float) -> None:
    linear = LinearActuator(smooth, radians(12.0), torque)
    step = compare({**smooth, "drive.current_offset": 0.0}, linear, 0.05)
    assert step.difference < 1.0  # % of the step


def test_limits_slow_down_large_steps(values: Values) -> None:
    p = {**values, **LOOP}
    linear = LinearActuator(p)
    small, large = compare(p, linear, 1.0), compare(p, linear, 20.0)
    assert large.metrics_nonlinear["rise_time"] > 2.0 * large.metrics_linear["rise_time"]
    assert large.difference > 3.0 * small.difference
    assert np.mean(large.active) > np.mean(small.active)
    assert large.metrics_linear["rise_time"] == pytest.approx(small.metrics_linear["rise_time"], rel=1e-9)


@pytest.mark.parametrize(("changes", "model"), [
    ({}, "nonlinear"), ({"encoder.on_fin": True}, "nonlinear"), ({"command.latency": 10e-3}, "nonlinear"),
    ({"command.update_time": 10e-3}, "nonlinear"), ({"command.resolution": radians(1.0)}, "nonlinear"),
    ({"command.latency": 2.5e-3, "command.update_time": 4e-3, "command.resolution": radians(0.2),
      "fin.start_angle": radians(3.0)}, "nonlinear"),
    ({"filters.speed_bandwidth": 500.0, "filters.notch_frequency": 300.0}, "nonlinear+filters"),
    ({"sensor.encoder.noise": 1e-4, "sensor.current.offset": 1.0}, "nonlinear+sensors"),
    ({}, "nonlinear+supply"), ({"trajectory.natural_frequency": 100.0}, "worm-gear+trajectory")])
def test_replayed_controllers_compute_the_recorded_reference(changes: Values, model: str) -> None:
    base = load_parameters(model=model)
    p = {**base.values, **base.having(LOOP), **changes}
    time = np.arange(400) * p["controller.sample_time"]
    command = np.array([radians(size) * np.sin(2.0 * np.pi * 12.0 * time) for size in (0.5, 15.0)])
    runs = [simulate(p, float(time[-1]), p["controller.sample_time"], model=model, fin_command=one) for one in command]
    motion: dict[str, Any] = {name: np.array([run[name] for run in runs])
                              for name in ("motor_angle", "motor_speed", "motor_current", "link_voltage")
                              if name in runs[0]}
    start = np.full(2, p["fin.start_angle"])
    reference, limited = sweep.replay(subject(p, model), start, command, motion)
    # A recorded reference was computed one sample earlier. A rounding, amplified by the loop, remains.
    recorded = np.array([run["drive_reference"] for run in runs])
    np.testing.assert_allclose(reference[:, :-1], recorded[:, 1:], rtol=0, atol=1e-9)
    assert not limited[0].any()
    if "trajectory" in model:  # its rate is below the limit
        assert not limited.any()
        return
    assert 0.05 < np.mean(limited[1]) < 0.95
    # Without a limit of the speed reference, the limit of the DAC alone is not counted.
    assert np.max(np.abs(reference[1])) == p["drive.reference_limit"]
    assert not sweep.replay(subject({**p, "controller.speed_limit": 1e5}, model), start, command, motion)[1].any()


def test_a_drive_that_is_off_until_it_is_homed_limits_nothing_in_a_replay() -> None:
    p = {**load_parameters(model="nonlinear+homing").values, "homing.required": True}
    still = {name: np.zeros((2, 5)) for name in ("motor_angle", "motor_speed", "motor_current")}
    reference, limited = sweep.replay(subject(p, "nonlinear+homing"), np.zeros(2), np.full((2, 5), 0.1), still)
    assert not reference.any()
    assert not limited.any()


def test_bandwidth_falls_with_amplitude_where_limits_act(values: Values) -> None:
    made = sweep.sweeps(subject({**values, **LOOP}), 60.0, amplitudes=(1.0, 6.0, 20.0))
    widths = [s.response.bandwidth for s in made]
    assert widths == sorted(widths, reverse=True)
    assert made[-1].onset("rate") <= widths[-1]
    # A sine of amplitude A and frequency f has a rate of 2 pi f A: no limit acts at low rates.
    slow = made[-1].response.frequency * 2.0 * np.pi * made[-1].amplitude < radians(100.0)
    assert np.any(slow)
    assert np.max(made[-1].active[:, slow]) == 0.0


@pytest.mark.parametrize("model", others_slow(
    ["nonlinear", "elastic", "worm-gear", "electrohydraulic"], lambda model: model not in ("elastic", "worm-gear")))
def test_bandwidth_agrees_with_single_sines_close_together(model: str) -> None:
    """Sines of whole periods in 4 s, a quarter of a hertz apart, each run by itself."""
    amplitude, period = radians(3.5), 1e-3
    p = load_parameters(model=model).values
    (made,) = sweep.sweeps(subject(p, model), 45.0, amplitudes=(3.5,))
    time = np.arange(5001) * period
    steady = slice(1000, 5000)

    def ratio(frequency: float) -> complex:
        command = amplitude * np.sin(2.0 * np.pi * frequency * time)
        angle = simulate(p, 5.0, period, model=model, fin_command=command)["fin_angle"]
        turn = np.exp(-2j * np.pi * frequency * time[steady])
        return complex(np.sum(angle[steady] * turn) / np.sum(command[steady] * turn))

    for found, of_phase in ((made.response.bandwidth, False), (made.response.phase_bandwidth, True)):
        near = 0.25 * (np.round(4.0 * found) + np.arange(-4.0, 5.0))
        ratios = np.array([ratio(f) for f in near])
        levels = 90.0 + np.degrees(np.unwrap(np.angle(ratios))) if of_phase else 3.0 + 20.0 * np.log10(np.abs(ratios))
        k = int(np.argmax(levels <= 0.0))
        # Interpolation between sines 0.25 Hz and 0.3 % apart, and the rest of the transient: 3e-4 at most.
        assert found == pytest.approx(near[k - 1] + 0.25 * levels[k - 1] / (levels[k - 1] - levels[k]), rel=1e-3)


def test_onset_of_the_current_limit_agrees_with_a_dense_grid(values: Values) -> None:
    (made,) = sweep.sweeps(subject(values), 45.0, amplitudes=(6.0,))
    near = np.linspace(0.97, 1.03, 31) * made.onset("current")  # rad/s
    dense = swept(values, radians(6.0), 0.0, near)
    # The onset is the first frequency of a grid at which the limit acts; the grids have steps of 0.3 % and 0.2 %.
    assert made.onset("current") == pytest.approx(dense.onset("current"), rel=5e-3)


def test_amplitudes_about_the_command_limit_are_reduced_to_the_range(values: Values) -> None:
    made = sweep.sweeps(subject(values), 10.0, at=values["command.limit"], amplitudes=(1.0, 30.0))
    assert [degrees(s.amplitude) for s in made] == pytest.approx([1.0])
    assert made[0].response.gain[0] == pytest.approx(1.0, abs=0.05)  # half of it would be clipped


@pytest.mark.parametrize("pairs", [0, 12])
def test_rate_capability_agrees_with_a_long_slew(values: Values, pairs: int) -> None:
    # At this low supply voltage the controllers do not limit the rate, which is read where the fin passes 5 deg.
    p = {**values, **LOOP, "drive.supply_voltage": 20.0, "encoder.enabled": False, "fin.start_angle": radians(-20.0),
         "motor.pole_pairs": pairs}
    run = simulate(p, 0.4, fin_command=radians(20.0), aero_torque=-50.0)
    k = int(np.argmax(run["fin_angle"] > radians(5.0)))
    expected = steady_rate(namespace(p), float(run["fin_angle"][k]), 1.0,
                           NONE.replace(aero_torque=-50.0), p["controller.speed_limit"])
    # The transmission ratio changes with the angle: the motor still accelerates, which is 2 % of the rate.
    assert run["fin_rate"][k] == pytest.approx(expected, rel=0.02)
