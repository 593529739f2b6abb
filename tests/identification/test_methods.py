"""Parts of the identification: estimation with known noise, model of the current loop, simulated rig, shipped files."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.signal import lfilter

from emcas_fmu.parameters import load_parameters
from emcas_fmu.parameters.toml import tomllib
from emcas_fmu.studies.identification import drive, motion
from emcas_fmu.studies.identification.estimation import (
    SETTLED,
    Fit,
    correlation_time,
    descend,
    each,
    weighted_fit,
)
from emcas_fmu.studies.identification.records import Array, RecordFile
from examples.identification_bench import bench, rig
from tests.marks import slow

from .conftest import BENCH
from .truths import draw_truth, largest_difference

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_correlation_time_of_a_first_order_process(rho: float) -> None:
    rng = np.random.default_rng(4)
    x = lfilter([1.0], [1.0, -rho], rng.normal(size=40_000))
    # (1 + rho)/(1 - rho) with a relative error of about sqrt(2 (2 window + 1)/n) = 7 % for tau = 9; three times that.
    assert correlation_time([x]) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.2)


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_sigmas_of_a_line_equal_the_scatter_of_repeated_experiments(rho: float) -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(-1.0, 1.0, 400)
    groups = [slice(0, 200), slice(200, 400)]
    values, sigmas = [], []
    for _ in range(60):
        noise = lfilter([1.0], [1.0, -rho], rng.normal(size=800))[400:] * np.where(np.arange(400) < 200, 0.1, 0.4)
        y = 3.0 + 2.0 * x + noise

        def residuals(b: Array, y: Array = y) -> list[Array]:
            return [(y - b[0] - b[1] * x)[g] for g in groups]

        found = weighted_fit(("offset", "slope"), each(residuals), np.zeros(2), np.ones(2), [0, 1])
        values.append(found.values)
        sigmas.append(found.sigmas)
    # The scatter of 60 experiments has an error of 9 %; three times that. Tau from 200 samples is slightly too small.
    ratio = np.std(values, axis=0) / np.mean(sigmas, axis=0)
    assert np.all((ratio > 0.7) & (ratio < 1.35)), ratio
    assert np.abs(np.mean(values, axis=0) - [3.0, 2.0]).max() < 4.0 * np.max(sigmas) / 60**0.5


X = np.linspace(-1.0, 1.0, 600)
TRUE = np.array([3.0, 2.0])


def fit_line(ys: list[Array], **options: Any) -> Fit:
    """Fit a line to simultaneous series with `descend`."""
    bounds = np.full(2, -1e3), np.full(2, 1e3)
    return weighted_fit(("offset", "slope"), each(lambda b: [y - b[0] - b[1] * X for y in ys]), np.zeros(2), np.ones(2),
                        range(len(ys)), prior=(np.zeros(2), np.full(2, 1e6)), together=[0] * len(ys),
                        minimise=lambda r, x, **k: descend(r, x, bounds=bounds, steps=60, **k)[:2], **options)


def test_copies_of_a_signal_count_once() -> None:
    rng = np.random.default_rng(8)
    y = TRUE @ [np.ones(600), X] + 0.1 * rng.normal(size=600)
    one, copies = fit_line([y]), fit_line([y, y, y, y, y])
    # 2 degrees of freedom of 600.
    np.testing.assert_allclose(copies.covariance, one.covariance, rtol=4e-3, atol=1e-15)
    # Five sensors count five times: the correlation of their sums is 0 +- 1/sqrt(120).
    five = fit_line([TRUE @ [np.ones(600), X] + 0.1 * rng.normal(size=600) for _ in range(5)])
    np.testing.assert_allclose(five.sigmas, one.sigmas / 5**0.5, rtol=0.25)


@pytest.mark.parametrize("lag", [1, *slow(0)])  # rows between neighbouring series
def test_errors_with_common_noise_are_as_large_as_stated(lag: int) -> None:
    rng = np.random.default_rng(9)
    z = []
    for _ in range(100):
        common = lfilter([1.0], [1.0, -0.5], rng.normal(size=700))
        ys = [TRUE @ [np.ones(600), X] + common[50 - lag * k:650 - lag * k] + 0.3 * rng.normal(size=600)
              for k in range(4)]
        fit = fit_line(ys)
        z.append((fit.values - TRUE) / fit.sigmas)
    # The rms of 200 standard normal numbers is 1 +- 0.05; three times that. With independent series it would be 1.9.
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("rho", "share"), [(0.6, 0.05), *slow((0.0, 0.0), (0.0, 0.05), (0.6, 0.0))])
def test_robust_fit_minimises_the_soft_l1_loss(rho: float, share: float) -> None:
    """With outliers and correlated noise the errors are still as large as the stated sigmas."""
    rng = np.random.default_rng(10)
    z = []
    for _ in range(100):
        noise = (1.0 - rho**2) ** 0.5 * lfilter([1.0], [1.0, -rho], rng.normal(size=700))[100:]
        outliers = (rng.random(600) < share) * rng.choice([-1.0, 1.0], 600) * 20.0
        y = TRUE @ [np.ones(600), X] + noise + outliers
        fit = fit_line([y], robust=True)
        z.append((fit.values - TRUE) / fit.sigmas)
    reference = least_squares(lambda b, y=y: y - b[0] - b[1] * X, np.zeros(2), loss="soft_l1",
                              f_scale=fit.deviations[0], xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    # The noise is estimated one pass earlier; the last step is smaller than a fifth of a sigma.
    assert np.all(np.abs(fit.values - reference) < 0.2 * fit.sigmas)
    # 1 +- 0.05 as above; a tau of 4 from 600 samples is a few percent too small.
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.15)


def test_descent_ends_when_settled_and_reports_unsettled_points() -> None:
    """A linear problem settles at once, Rosenbrock's valley not within two steps."""
    calls = []

    def line(points: Array) -> Array:
        calls.append(len(points))
        residuals: Array = points - np.array([3.0, 2.0])
        return residuals

    def valley(points: Array) -> Array:
        x, y = points.T
        return np.stack([10.0 * (y - x**2), 1.0 - x, np.full_like(x, 0.1)], axis=1)

    bounds = np.full(2, -10.0), np.full(2, 10.0)
    x, _, left = descend(line, np.ones(2), bounds, 100)
    np.testing.assert_allclose(x, [3.0, 2.0], rtol=1e-9)  # rounding
    assert np.all(left < SETTLED)
    assert len(calls) < 30
    assert np.any(descend(valley, np.array([-1.2, 1.0]), bounds, 2)[2] > SETTLED)
    x, _, left = descend(valley, np.array([-1.2, 1.0]), bounds, 100)
    assert np.all(left < SETTLED)
    np.testing.assert_allclose(x, 1.0, atol=0.02)  # a fifth of sigma, which is 0.1


@given(every=st.sampled_from([1, 2, 10]), slope=st.floats(-5.0, 5.0), offset=st.floats(-5.0, 5.0))
def test_logged_means_are_centred_on_their_rows(every: int, slope: float, offset: float) -> None:
    """The mean of a linear signal about a row is the value in that row, except in the first and last row."""
    log = rig.centred(offset + slope * np.arange(101.0), every)
    expected = (offset + slope * np.arange(101.0))[::every]
    assert log.shape == expected.shape
    assert log[1:-1] == pytest.approx(expected[1:-1], abs=1e-11)  # rounding of sums up to 5,000


@pytest.mark.parametrize("delay", [3.7e-3, 3.7133e-3, 2.0101e-3, 4.0e-3])
def test_model_of_the_current_loop_agrees_with_the_kernel(delay: float) -> None:
    parameters = load_parameters().with_values({"drive.transport_delay": delay, "drive.ki": 30.0})
    levels = (0.0, 0.3, -0.2, 0.25, 0.1, -0.3)
    log = rig.run(parameters.values, lambda t: levels[int(t / 4e-3) % 6], 0.06, 5e-5, open_loop=True, clamped=True)
    v = parameters.values
    current = drive.response([v[n] for n in drive.NAMES], 0.0, log.reference, None, 5e-5, v)
    expected = log.columns["motor_current"]
    # The kernel starts without current, the model at rest; after some ms both agree. 3 mA is a twentieth of the
    # sensor's noise; the kernel integrates with the midpoint rule.
    later = log.time > 6e-3
    assert np.abs(current - expected)[later].max() < 3e-3
    assert np.ptp(expected) > 3.0


def test_windowed_averages_of_a_parabola_are_exact() -> None:
    time = np.arange(400) * 1e-3
    angle = 3.0 + 40.0 * time + 500.0 * time**2
    columns = {"time": time, "motor_angle": angle, "motor_current": 2.0 + 10.0 * time}
    a = motion.averages(RecordFile(Path("x.csv"), 1e-3, columns, {}, ""), 16, 8)
    # In symmetric windows the mean of a linear function is its value in the middle.
    np.testing.assert_allclose(a.acceleration, 1000.0, rtol=1e-6)
    np.testing.assert_allclose(a.speed, 40.0 + 1000.0 * a.time, rtol=1e-9)
    np.testing.assert_allclose(a.current, 2.0 + 10.0 * a.time, rtol=1e-9)


def test_converter_rounds_and_saturates() -> None:
    step = 20.0 / 2**14
    found = rig.quantised([0.4 * step, 0.6 * step, 50.0, -50.0], 14, 10.0)
    np.testing.assert_allclose(found, [0.0, step, 10.0 - step, -10.0])


def test_play_lags_by_half_the_gap_in_each_direction() -> None:
    angle = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])
    output = bench.play(angle, 0.2)
    assert output[100] == pytest.approx(0.9)
    assert output[-1] == pytest.approx(0.1)
    assert np.all(np.abs(output - angle) <= 0.1 + 1e-12)


@pytest.mark.slow
def test_command_of_the_provenance_reproduces_the_shipped_files(tmp_path: Path) -> None:
    provenance = tomllib.loads((BENCH / bench.PROVENANCE).read_text(encoding="utf-8"))
    files = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in BENCH.glob("*.csv")}
    assert files == provenance["sha256"]
    assert sum(p.stat().st_size for p in BENCH.iterdir()) < 1.5e6
    process = subprocess.run([sys.executable, *provenance["command"].split()[1:], "--directory", tmp_path], cwd=ROOT,
                             capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr
    again = tomllib.loads((tmp_path / bench.PROVENANCE).read_text(encoding="utf-8"))
    assert again["truth"] == provenance["truth"]
    assert set(again["sha256"]) == set(files)
    # Another C library may round the last digit differently; the noise is the same.
    for name in (name for name in files if name.startswith(("drive", "inertia"))):
        table, expected = (np.loadtxt(p / name, delimiter=",", skiprows=1) for p in (tmp_path, BENCH))
        assert table.shape == expected.shape
        # Single samples may differ by one step of the ADC (12.2 mA) or of the encoder (0.044 deg).
        assert np.mean(np.abs(table - expected) > 1e-9) < 1e-3
        assert np.abs(table - expected).max() < 0.05


def test_random_actuators_differ() -> None:
    base = load_parameters()
    one, two = (draw_truth(base, np.random.default_rng(seed)) for seed in (1, 2))
    assert largest_difference(one, two) > 0.01
    assert abs(one.values["kinematics.initial_angle"]) <= radians(8.0)


def test_bench_needs_a_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    program = ROOT / "examples/identification_bench/make.py"
    done = subprocess.run([sys.executable, program, "--directory", file], capture_output=True, text=True)
    assert done.returncode == 2
    assert "is a file; give a folder" in done.stderr
