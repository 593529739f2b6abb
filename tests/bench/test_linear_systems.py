"""Linear systems of the bench against closed forms: delays, wiring, sampling, hidden modes, margins.

Unless a line says otherwise, the tolerances are for rounding: systems of a few states with entries near 1.
"""

from __future__ import annotations

from math import atan, exp, inf, isnan, pi, sqrt

import control as ct
import numpy as np
import pytest

from emcas_fmu.bench.frequency_response import of_ratio
from emcas_fmu.bench.linear import frequency, systems

T = 1e-3  # s
HERTZ = np.geomspace(1.0, 400.0, 7)
Z = np.exp(2j * pi * HERTZ * T)


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_delay_of_whole_samples_is_a_power_of_z(samples: int) -> None:
    delay = systems.delay_line(samples, T)
    np.testing.assert_allclose(frequency.evaluate(delay, HERTZ), Z**-samples, rtol=1e-12)
    assert delay.dt == T
    assert (delay.input_labels, delay.output_labels) == (["sent"], ["arrived"])


def test_blocks_are_wired_output_to_input() -> None:
    """Unit feedback around an integrator of gain 3 behind a delay, seen from the reference and from the disturbance."""
    delay = systems.delay_line(1, T)
    plant = ct.ss([[1.0]], [[3.0, 1.0, -3.0]], [[1.0]], [[0.0, 0.0, 0.0]], T, inputs=["in", "disturbance", "back"],
                  outputs=["out"])
    closed = systems.wire([delay, plant], [("arrived", "in"), ("out", "back")], ["sent", "disturbance"], ["out"])
    np.testing.assert_allclose(frequency.evaluate(closed["out", "sent"], HERTZ), 3.0 / Z / (Z + 2.0), rtol=1e-12)
    np.testing.assert_allclose(frequency.evaluate(closed["out", "disturbance"], HERTZ), 1.0 / (Z + 2.0), rtol=1e-12)


def test_states_that_never_move_are_left_out() -> None:
    """The second state is constant and is left out; the third integrates its input and remains."""
    a, b = np.diag([0.5, 1.0, 1.0]), np.array([[1.0], [0.0], [2.0]])
    system = systems.moving(a, b, np.array([[1.0, 7.0, 1.0]]), np.zeros((1, 1)), T, ["u"], ["y"])
    np.testing.assert_array_equal(system.A, np.diag([0.5, 1.0]))
    np.testing.assert_array_equal(system.B, [[1.0], [2.0]])
    np.testing.assert_array_equal(system.C, [[1.0, 1.0]])


@pytest.mark.parametrize(("whole", "rest"), [(0, 0.0), (0, 0.4e-3), (1, 0.0), (2, 0.7e-3)])
def test_sampled_lag_behind_a_delay(whole: int, rest: float) -> None:
    """x' = -a x + u(t - delay) + v: a sample of u arrives `rest` after the period begins, and acts until it ends."""
    a, period = 200.0, T
    lag = ct.ss([[-a]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]], inputs=["u", "v"], outputs=["x"])
    system = systems.sampled(lag, period, whole, rest)
    decay, full = exp(-a * period), (1.0 - exp(-a * period)) / a
    new = (1.0 - exp(-a * (period - rest))) / a
    old = full - new
    np.testing.assert_allclose(frequency.evaluate(system["x", "u"], HERTZ),
                               (new + old / Z) * Z**-whole / (Z - decay), rtol=1e-10)
    np.testing.assert_allclose(frequency.evaluate(system["x", "v"], HERTZ), full / (Z - decay), rtol=1e-10)


def test_system_decays_if_its_poles_are_clearly_inside_the_unit_circle() -> None:
    def with_pole(pole: float) -> systems.System:
        return ct.ss([[pole]], [[1.0]], [[1.0]], [[0.0]], T)

    assert systems.largest_pole(with_pole(-0.9)) == pytest.approx(0.9, rel=1e-15)
    assert systems.decays(with_pole(1.0 - 2.0 * systems.ROUNDING))
    assert not systems.decays(with_pole(1.0 - 0.5 * systems.ROUNDING))
    assert not systems.decays(with_pole(-1.0))


def test_values_below_the_threshold_are_cleared() -> None:
    assert systems.cleared(1e-3, 1e-3) == systems.cleared(-1e-3, 1e-3) == 0.0
    assert systems.cleared(-2e-3, 1e-3) == -2e-3


@pytest.mark.parametrize("hidden_from", ["input", "output"])
def test_hidden_modes_are_left_out(hidden_from: str) -> None:
    """The mode at 0.95 is uncontrollable or unobservable; the pair at 0.9 +- 0.2j remains."""
    a = np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.0], [0.0, 0.0, 0.95]])
    b, c = np.array([[1.0], [0.0], [1.0]]), np.array([[0.0, 1.0, 1.0]])
    (b if hidden_from == "input" else c.T)[2] = 0.0
    whole = ct.ss(a, b, c, 0.0, T, inputs=["u"], outputs=["y"])
    seen, hidden = systems.shown(whole)
    assert hidden == pytest.approx([0.95], rel=1e-9)
    assert seen.nstates == 2
    np.testing.assert_allclose(frequency.evaluate(seen, HERTZ), frequency.evaluate(whole, HERTZ), rtol=1e-9)
    unchanged, none = systems.shown(ct.ss(a[:2, :2], b[:2], c[:, :2], 0.0, T))
    assert (unchanged.nstates, len(none)) == (2, 0)


def test_fast_hidden_mode_remains() -> None:
    """A mode at 0.3 decays within a few samples and remains; a mode at 0.6 is left out."""
    for pole, states in ((0.3, 2), (0.6, 1)):
        system = ct.ss(np.diag([0.9, pole]), [[1.0], [0.0]], [[1.0, 1.0]], 0.0, T)
        assert systems.shown(system)[0].nstates == states


def test_margins_of_three_lags() -> None:
    """L = K/(s + 1)^3 has -180 deg and a gain of K/8 at sqrt(3) rad/s, and |L| = 1 at w^2 = K^(2/3) - 1."""
    gain = 4.0
    made = frequency.margins(ct.ss(ct.tf([gain], [1.0, 3.0, 3.0, 1.0])))
    crossover = sqrt(gain ** (2.0 / 3.0) - 1.0)
    phase = pi - 3.0 * atan(crossover)
    # The grid has 500 frequencies per decade; the spline between them is accurate to 1e-6.
    assert made.gain == pytest.approx(8.0 / gain, rel=1e-6)
    assert made.gain_db == pytest.approx(20.0 * np.log10(2.0), rel=1e-6)
    assert made.phase_crossover == pytest.approx(sqrt(3.0) / (2.0 * pi), rel=1e-6)
    assert made.phase == pytest.approx(phase, rel=1e-6)
    assert made.gain_crossover == pytest.approx(crossover / (2.0 * pi), rel=1e-6)
    assert made.delay == pytest.approx(phase / crossover, rel=1e-6)
    assert made.reduction == 0.0
    angle = np.linspace(0.5, 3.0, 200001)
    assert made.modulus == pytest.approx(np.min(np.abs(1.0 + gain / (1.0 + 1j * angle) ** 3)), rel=1e-4)  # on a grid


def test_gain_reduction_margin() -> None:
    """L = K (s + 1)^2/s^3 encircles -1 below K = 1/2: at w = 1 the phase is -180 deg and |L| = 2 K."""
    loop = ct.ss(ct.tf([4.0, 8.0, 4.0], [1.0, 0.0, 0.0, 0.0]))
    made = frequency.margins(loop, frequency.frequencies(10.0, 0.01))
    assert made.reduction == pytest.approx(0.125, rel=1e-5)
    assert made.gain == inf
    assert isnan(made.phase_crossover)


def test_continuous_poles_of_a_sampled_system() -> None:
    made = ct.ss(np.diag([exp(-50.0 * T), 0.0]), [[1.0], [1.0]], [[1.0, 1.0]], 0.0, T)
    np.testing.assert_allclose(frequency.continuous_poles(made), [-50.0], rtol=1e-10)
    assert frequency.highest(made) == pytest.approx(499.0)
    assert frequency.highest(ct.ss(ct.tf([1.0], [1.0, 2.0 * pi]))) == pytest.approx(100.0)


def test_phase_is_unwrapped_and_nan_where_the_response_is_zero() -> None:
    response = of_ratio(HERTZ[:4], np.array([1.0, 0.0, -1j, 1.0 * np.exp(-1.2j * pi)]))
    assert np.degrees(response.phase[[0, 2, 3]]) == pytest.approx([0.0, -90.0, -216.0])
    assert isnan(response.phase[1])
    assert response.gain == pytest.approx([1.0, 0.0, 1.0, 1.0])
