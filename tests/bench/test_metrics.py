"""Figures of the bench agree with closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from emcas_fmu.bench import metrics
from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.frequency_response import FrequencyResponse, frequency_response
from emcas_fmu.bench.metrics import Array
from emcas_fmu.bench.runs import Run
from emcas_fmu.reference.cases import CASES

SWEEP = next(case for case in CASES if case.name == "chirp_1deg").inputs()
STEP = 1e-3  # s


def second_order(time: Array, natural: float, damping: float) -> Array:
    """Return the unit step response of w^2/(s^2 + 2 z w s + w^2) at times [s] after the step (Ogata, 5-3)."""
    damped = natural * math.sqrt(1.0 - damping**2)
    angle = damped * np.maximum(time, 0.0)
    decay = np.exp(-damping * natural * np.maximum(time, 0.0))
    return np.asarray(1.0 - decay * (np.cos(angle) + damping / math.sqrt(1.0 - damping**2) * np.sin(angle)))


def test_maximum_and_rms_error() -> None:
    found = metrics.errors(np.array([1.0, 2.0, 3.0, 0.0]), np.array([1.0, -1.0, 3.0, 4.0]))
    assert (found.maximum, found.rms) == (4.0, 2.5)
    assert math.isnan(metrics.errors(np.array([0.0, np.nan]), np.zeros(2)).maximum)


@pytest.mark.parametrize("scale", [20.0, -3.0])
@pytest.mark.parametrize("damping", [0.4, 0.7])
def test_step_metrics_of_a_second_order_system(scale: float, damping: float) -> None:
    natural, start, before = 60.0, 0.1, 5.0
    time = np.arange(1001) * STEP
    response = before + scale * second_order(time - start, natural, damping)
    found = metrics.step_metrics(time, response, start, before + scale)

    fine = np.arange(900_001) * 1e-6
    unit = second_order(fine, natural, damping)
    rise = fine[np.argmax(unit >= 0.9)] - fine[np.argmax(unit >= 0.1)]
    settling = fine[np.flatnonzero(np.abs(unit - 1.0) > 0.02)[-1]]
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    # Linear interpolation over 1 ms is off by at most h^2 y''/8 = 4.5e-4 of the step: 20 us at the slope of the rise,
    # and more where the response is flat at the edge of the 2 % band.
    assert found["rise_time"] == pytest.approx(rise, abs=4e-5)
    assert found["settling_time"] == pytest.approx(settling, abs=5e-4)
    assert found["overshoot"] == pytest.approx(overshoot, abs=5e-4)  # highest sample, up to h/2 from the peak
    # At the beginning of the last third, 0.6 s after the step, exp(-0.4*60*0.6) = 5.6e-7 of the step remains.
    assert found["steady_error"] == pytest.approx(0.0, abs=1e-6 * abs(scale))
    assert found["held_error"] == pytest.approx(0.0, abs=1e-6 * abs(scale))


def test_step_that_never_reaches_90_percent_has_no_rise_time() -> None:
    time = np.arange(501) * STEP
    response = 0.85 * np.clip((time - 0.1) / 0.1, 0.0, 1.0)
    found = metrics.step_metrics(time, response, 0.1, 1.0)
    assert math.isnan(found["rise_time"])
    assert found["settling_time"] == math.inf
    assert found["overshoot"] == 0.0
    assert found["steady_error"] == pytest.approx(-0.15, abs=1e-12)


def test_settling_time_counts_from_the_command() -> None:
    time = np.arange(501) * STEP
    response = np.clip((time - 0.15) / 0.1, 0.0, 1.0)  # 50 ms late, then a ramp of 100 ms
    found = metrics.step_metrics(time, response, 0.1, 1.0)
    assert found["rise_time"] == pytest.approx(0.08, abs=1e-9)  # a ramp is interpolated exactly
    assert found["settling_time"] == pytest.approx(0.148, abs=1e-9)


@pytest.mark.parametrize(("values", "expected"), [
    ([9.0, 0.0, 0.5, 1.1, 1.5, 1.2, 0.9], 0.3 + 0.1 * 0.25 / 0.3),  # outside again at 0.3 s
    ([9.0, 0.9, 1.1, 1.0, 1.0, 1.0, 1.0], 0.0),  # outside only before the command
    ([9.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0], 0.075),
    ([9.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.5], math.inf),
    ([9.0, 0.0, 1.0, 1.0, 1.0, 1.0, math.nan], math.inf),  # nan is outside
    ([9.0, 0.75, 1.25, 0.75, 1.25, 0.75, 1.25], 0.0),  # the edge of the band is inside
])
def test_settling_into_a_band(values: list[float], expected: float) -> None:
    """The rows are at -0.1, 0, ... 0.5 s after a command of 1; the band is 1 +- 0.25; interpolation is linear."""
    time = 0.2 + 0.1 * np.arange(7)  # 0.3 s is 0.30000000000000004 here
    since, response = metrics.since(0.3, time, np.array(values))
    assert metrics.settling(since, np.abs(response - 1.0), 0.25) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("hold", "row"), [(3.0, 1e-3), (5.9, 1e-3), (15.0, 1e-3), (120.0, 0.1), (120.0, 2.0)])
def test_current_ripple_is_that_of_the_worst_second_and_not_a_drift(hold: float, row: float) -> None:
    """A ramp of 1 A/s has 1/sqrt(12) A in a second, or half of it in two rows; a sine of 2 A has sqrt(2) A."""
    time = np.arange(round(hold / row) + 1) * row
    burst = np.where(np.abs(time - hold + 0.5) <= 0.5, 2.0 * np.sin(20.0 * np.pi * time), 0.0)
    runs = {"time": time, "fin_angle": np.zeros((2, len(time))), "fin_rate": np.zeros((2, len(time))),
            "motor_current": np.array([time, burst])}
    excited = Excitation("hold", {"fin_command": np.zeros(len(time)), "aero_torque": np.zeros(len(time))}, 0.0)
    drift, worst = metrics.rest_figures(Run(excited, runs, None, (), 0.0))["current_ripple"]
    per_second = max(round(1.0 / row), 1)
    assert drift == pytest.approx(row * math.sqrt(((per_second + 1) ** 2 - 1) / 12.0), rel=1e-9)  # of equidistant rows
    if row < 0.01:
        assert worst == pytest.approx(math.sqrt(2.0), rel=1e-3)  # of 1001 rows, the last of which is a zero


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_time_to_accuracy_of_a_ramp(sign: float) -> None:
    time, start = np.arange(1001) * STEP, 0.1
    ramp = sign * np.clip((time - start) / 0.5, 0.0, 1.0)  # 1 rad in 0.5 s, interpolated exactly
    found = metrics.step_metrics(time, ramp, start, sign)
    assert found["time_to_accuracy"] == pytest.approx(0.5 * (1.0 - metrics.ACCURACY), abs=1e-9)
    for end, expected in ((0.65, 0.55), (0.8, np.inf)):  # outside until `end`; the last third begins at 0.7 s
        late = np.where(time > end, sign, ramp - 2.0 * sign * metrics.ACCURACY)
        assert metrics.step_metrics(time, late, start, sign)["time_to_accuracy"] == pytest.approx(expected, abs=STEP)


def test_time_to_accuracy_is_zero_if_always_inside_and_infinite_if_outside_at_the_end() -> None:
    time = np.arange(501) * STEP
    small = 0.5 * metrics.ACCURACY * np.clip((time - 0.1) / 0.1, 0.0, 1.0)
    assert metrics.step_metrics(time, small, 0.1, 0.5 * metrics.ACCURACY)["time_to_accuracy"] == 0.0
    assert metrics.step_metrics(time, small, 0.1, 3.0 * metrics.ACCURACY)["time_to_accuracy"] == math.inf


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rates_of_a_trapezoidal_slew(sign: float) -> None:
    # 0.1 s at 2000 deg/s2 up to 200 deg/s, 0.2 s at 200 deg/s, 0.1 s down: 60 deg in total. In the middle 60 %, from
    # 12 to 48 deg, the rate is constant.
    time = np.arange(601) * STEP
    since = time - STEP  # the command is in the second row
    rate = 200.0 * np.clip(np.minimum(since / 0.1, (0.4 - since) / 0.1), 0.0, 1.0)
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * STEP))
    command = np.where(time > 0.0, sign * 60.0 - 3.0, -3.0)
    spike = rate.copy()
    spike[200] = 900.0
    for rates, peak in ((rate, 200.0), (spike, 900.0)):  # a spike changes only the peak rate
        run = Run(Excitation("slew", {"fin_command": command}),
                  {"time": time, "fin_angle": sign * angle - 3.0, "fin_rate": sign * rates}, None, (), 0.0)
        found = metrics.motion_figures(run)
        assert found["peak_rate"] == pytest.approx(peak, rel=1e-12)
        assert found["sustained_rate"] == pytest.approx(200.0, rel=1e-9)


def delayed_second_order(command: Array, hertz: float, damping: float, delay: int) -> tuple[Array, Array, Array]:
    """Return the response of a delayed second-order system to held samples, and its discrete coefficients."""
    natural = 2.0 * math.pi * hertz
    b, a, _ = signal.cont2discrete(([natural**2], [1.0, 2.0 * damping * natural, natural**2]), STEP)
    numerator = np.concatenate((np.zeros(delay), b.ravel()))
    return signal.lfilter(numerator, a, command), numerator, a


@pytest.mark.parametrize(("hertz", "damping"), [(15.0, 0.6), (18.0, 0.3), (12.0, 1.0)])
def test_frequency_response_of_a_second_order_system_with_delay(hertz: float, damping: float) -> None:
    response, b, a = delayed_second_order(SWEEP["fin_command"], hertz, damping, delay=4)
    found = frequency_response(SWEEP["time"], SWEEP["fin_command"], response, 0.5, 24.0)

    def exact(frequency: Array) -> Array:
        return np.asarray(signal.freqz(b, a, 2.0 * math.pi * frequency * STEP)[1])

    ratio = found.gain * np.exp(1j * found.phase) / exact(found.frequency)
    error = np.abs(ratio - 1.0)
    assert found.frequency[0] <= 0.6
    assert found.frequency[-1] >= 23.8
    # The accuracy of the estimate is documented.
    assert np.max(error[found.frequency <= 22.0]) < 0.015
    assert np.max(error) < 0.05
    assert np.min(found.coherence) > 0.98

    fine = np.linspace(0.5, 24.0, 100_000)
    lag = -np.unwrap(np.angle(exact(fine)))
    low = np.abs(exact(fine)) < 10 ** (-3 / 20)
    # Errors of 1 % are 0.09 dB and 0.6 deg: at the slopes of the crossings at most 0.2 Hz.
    if low.any():
        assert found.bandwidth == pytest.approx(fine[np.argmax(low)], abs=0.2)
    else:
        assert math.isnan(found.bandwidth)
    assert found.phase_bandwidth == pytest.approx(fine[np.argmax(lag > math.pi / 2)], abs=0.1)


def test_frequency_response_excludes_harmonics() -> None:
    # For a sine of amplitude A, u + k u^3 has the fundamental (1 + 3/4 k A^2) A and the third harmonic k A^3/4. The
    # third harmonic of the sweep reaches every frequency above 1.5 Hz before the sweep does.
    command = SWEEP["fin_command"]
    amplitude = np.max(np.abs(command))
    response = command + 0.4 * command**3 / amplitude**2
    found = frequency_response(SWEEP["time"], command, response, 0.7, 22.0)
    np.testing.assert_allclose(found.gain, 1.3, rtol=0.01)
    np.testing.assert_allclose(found.phase, 0.0, atol=0.01)


def test_response_equal_to_the_command_has_no_bandwidth() -> None:
    found = frequency_response(SWEEP["time"], SWEEP["fin_command"], SWEEP["fin_command"], 0.5, 24.0)
    assert math.isnan(found.bandwidth)
    assert math.isnan(found.phase_bandwidth)
    np.testing.assert_allclose(found.gain, 1.0, rtol=1e-12)


def test_zero_response_has_a_gain_of_minus_infinity_without_a_warning() -> None:
    found = FrequencyResponse(np.array([1.0, 2.0]), np.array([1.0, 0.0]), np.zeros(2), np.ones(2))
    assert found.gain_db[1] == -math.inf
    assert 1.0 <= found.bandwidth <= 2.0
