"""Errors of current sensor and encoder: closed forms, an independent integration, and the noise generator."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest

from emcas_fmu import Batch
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.control import sensor_errors
from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.physics import kinematics
from emcas_fmu.simulation import simulate
from tests.marks import others_slow
from tests.runs import run_both_kernels

from .runs import BLOCKED, NO_COULOMB, values_of
from .sensors_reference import Noise, Sensed

MODEL = "nonlinear+sensors"
CURRENT = {"sensor.current.offset": 1.5, "sensor.current.gain_error": 0.03}
ECCENTRIC = {"sensor.encoder.once": radians(1.0), "sensor.encoder.once_phase": 0.7,
             "sensor.encoder.twice": radians(0.5), "sensor.encoder.twice_phase": -2.0}
NOISY = {"sensor.encoder.noise": radians(0.05), "sensor.encoder.seed": 7}
# Without dry friction and counts the loops have no steady error.
FREE = {**NO_COULOMB, "compensation.gain": 0.0, "encoder.enabled": False, "drive.current_offset": 0.0}


def parameters_of(*changes: Mapping[str, Any]) -> ParameterSet:
    parameters = load_parameters(model=MODEL)
    return parameters.with_values({key: value for each in changes for key, value in each.items()})


def run_of(stop: float, *changes: Mapping[str, Any], kernel: str = "auto", **inputs: Any) -> Mapping[str, Any]:
    return simulate(parameters_of(*changes).values, stop, model=MODEL, kernel=kernel, **inputs)


# -- current ---------------------------------------------------------------------

@pytest.mark.parametrize("offset", [1.5, 36.0, -32.0])
@pytest.mark.parametrize("requested", [8.0, -50.0, 300.0, -300.0])
def test_the_current_of_a_blocked_motor_is_controlled_as_measured(requested: float, offset: float) -> None:
    """R i = K_p (i_ref - (1 + g) i - i_0), within the limit of 60 A and at it, also with an offset above half of it."""
    found = run_of(0.05, BLOCKED, CURRENT, {"drive.current_offset": requested, "sensor.current.offset": offset})
    reference = max(min(requested, 60.0), -60.0)
    current = 5.0 * (reference - offset) / (0.25 + 5.0 * 1.03)
    assert found["motor_current"][-1] == pytest.approx(current, rel=1e-12)
    assert found["current_error"][-1] == pytest.approx(reference - 1.03 * current - offset, rel=1e-12)
    assert bool(found["saturated"][-1]) is (abs(requested) > 60.0)


@pytest.mark.parametrize("offset", [36.0, -36.0])
@pytest.mark.parametrize("requested", [50.0, -50.0])
def test_a_drive_derated_below_its_offset(requested: float, offset: float) -> None:
    """With half the limit of 60 A, i_ref is +-30 A in R i = K_p (i_ref - i - i_0)."""
    values = values_of(BLOCKED, {
        "drive.current_offset": requested, "sensor.current.offset": offset, "fault.current_derating.begin": 0.0,
        "fault.current_derating.end": 1.0, "fault.current_derating.share": 0.5}, model=f"{MODEL}+faults")
    found = simulate(values, 0.05, model=f"{MODEL}+faults")
    reference = 30.0 if requested > 0.0 else -30.0
    assert found["motor_current"][-1] == pytest.approx(5.0 * (reference - offset) / 5.25, rel=1e-12)
    assert found["saturated"][-1]


def test_without_integrals_an_offset_is_a_steady_error_of_the_angle() -> None:
    """The motor rests without current, so that i_0 = K_v u = K_v K_p,vel K_p,pos e."""
    loops = {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0, "drive.ki": 0.0}
    found = run_of(2.0, FREE, loops, {"sensor.current.offset": 0.6})
    error = -found["motor_angle"][-1]
    # The slowest mode decays by exp(-40/s 2 s).
    assert error == pytest.approx(0.6 / (8.19 * 0.0439 * 53.8), rel=1e-9)


def test_an_integral_removes_an_offset() -> None:
    found = run_of(4.0, FREE, {"drive.ki": 0.0, "sensor.current.offset": 0.6})
    assert np.max(np.abs(found["fin_angle"][:1000])) > radians(0.01)
    assert abs(found["fin_angle"][-1]) < radians(1e-5)  # a mode of 4.6/s decays to 1e-8


def test_a_gain_error_has_the_margins_of_another_current_loop() -> None:
    """Its K_p and K_i are 1 + g times larger, the reference's gain 1 + g times smaller; noise changes no margin."""
    pytest.importorskip("control")
    plain = load_parameters()
    values = plain.values
    equivalent = plain.with_values({"drive.kp": 1.03 * values["drive.kp"], "drive.ki": 1.03 * values["drive.ki"],
                              "drive.current_gain": values["drive.current_gain"] / 1.03})
    figures = ("gain_margin", "phase_margin", "delay_margin")
    erring, expected, ideal = (measure(Test("linear"), ParameterSubject(each), [{}], figures, ())[0] for each in (
        parameters_of(CURRENT, NOISY, {"compensation.gain": 0.0, "sensor.current.offset": 0.0}),
        equivalent.with_values({"compensation.gain": 0.0}), plain.with_values({"compensation.gain": 0.0})))
    assert erring == pytest.approx(expected, rel=1e-6)  # margins are found on a grid, and refined
    assert np.max(np.abs(erring / ideal - 1.0)) > 5e-3


def test_an_offset_beyond_the_limit_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"sensor\.current\.offset = -70 A must be within drive\.current_limit = 60 A"):
        parameters_of({"sensor.current.offset": -70.0})


# -- encoder ---------------------------------------------------------------------

def _error(x: float, e: Mapping[str, float] = ECCENTRIC) -> float:
    return (e["sensor.encoder.once"] * (sin(x + 0.7) - sin(0.7))
            + e["sensor.encoder.twice"] * (sin(2.0 * x - 2.0) - sin(-2.0)))


@pytest.mark.parametrize("on_fin", [False, True])
def test_the_fin_rests_where_the_encoder_reads_the_command(on_fin: bool) -> None:
    """x + e(x) is the command, at the motor or at the fin; at the fin the motor's error is 63 times smaller."""
    command = radians(14.0)
    found = run_of(4.0, FREE, ECCENTRIC, {"encoder.on_fin": on_fin}, fin_command=command)
    p = parameters_of().actuator.namespace(parameters_of().values)
    motor, fin = found["motor_angle"][-1], found["fin_angle"][-1]
    target = kinematics.motor_angle(FLOATS, p, command)
    # The integral's mode of 4.6/s decays to 1e-8 of the step; rounding of the kinematics is less.
    if on_fin:
        assert fin + _error(fin) == pytest.approx(command, abs=1e-7)
        assert abs(fin - command) > radians(0.1)
    else:
        assert motor + _error(motor) == pytest.approx(target, abs=1e-5)
        ratio = kinematics.reduction_ratio(FLOATS, p, kinematics.lever_tangent(FLOATS, p, target))
        assert command - fin == pytest.approx(_error(motor) / ratio, rel=2e-3)  # the ratio changes along the error


@pytest.mark.parametrize("changes", [{}, {"encoder.on_fin": True}, {"encoder.enabled": False}])
@pytest.mark.parametrize("start", [0.0, 12.0])
def test_the_controllers_start_at_the_encoder_s_angle(start: float, changes: Mapping[str, Any]) -> None:
    """The fin does not move if the command is the measured start angle."""
    cases = (ECCENTRIC, changes, {"fin.start_angle": radians(start)})
    measured = float(run_of(0.05, *cases, fin_command=radians(start))["measured_fin_angle"][0])
    assert np.ptp(run_of(0.05, *cases, fin_command=measured)["fin_angle"]) == 0.0
    assert (abs(measured - radians(start)) > radians(0.01)) is (start > 0.0)


def test_slope_of_the_reading() -> None:
    p = parameters_of(ECCENTRIC)
    q = p.actuator.namespace(p.values)
    for x in np.linspace(-4.0, 4.0, 9).tolist():
        central = (sensor_errors.angle(FLOATS, q, x + 1e-5) - sensor_errors.angle(FLOATS, q, x - 1e-5)) / 2e-5
        assert sensor_errors.slope(FLOATS, q, x) == pytest.approx(central, abs=1e-9)  # rounding of the quotient


# -- noise -----------------------------------------------------------------------

def _noise(seed: int, count: int) -> np.ndarray:
    first, second, noise = float(seed), sensor_errors.SECOND, []
    for _ in range(count):
        z, first, second = sensor_errors.draw(FLOATS, first, second)
        noise.append(z)
    return np.array(noise)


@pytest.mark.parametrize("seed", [1, 2_147_483_562])
def test_noise_is_that_of_an_integer_generator(seed: int) -> None:
    generator = Noise(seed)
    # Quotients of order 1 round differently.
    np.testing.assert_allclose(_noise(seed, 2000), [generator.draw() for _ in range(2000)], rtol=0, atol=1e-14)


def test_noise_is_white_and_independent_of_other_seeds() -> None:
    count = 20_000
    noises = np.array([_noise(seed, count) for seed in (1, 2, 3)])
    room = 4.5 / sqrt(count)  # 4.5 standard deviations of mean and correlation, 1/sqrt(n): exceeded by 1 in 100,000
    assert np.max(np.abs(np.mean(noises, axis=1))) < room
    assert np.max(np.abs(np.var(noises, axis=1) - 1.0)) < room * sqrt(2.0)
    assert np.max(np.abs(np.corrcoef(noises) - np.eye(3))) < room
    for lag in (1, 2, 7):
        assert np.max(np.abs(np.mean(noises[:, lag:] * noises[:, :-lag], axis=1))) < room
    assert 3.0 < np.max(np.abs(noises)) <= 2.0 * sqrt(3.0)


def test_noise_does_not_depend_on_the_steps_of_the_host() -> None:
    values = parameters_of(CURRENT, ECCENTRIC, NOISY).values
    first, *others = (simulate(values, 0.3, size, model=MODEL, fin_command=0.1,
                               aero_torque=-30.0)["fin_angle"][::round(10e-3 / size)] for size in (1e-3, 10e-3, 2.5e-3))
    assert all(np.array_equal(each, first) for each in others)


def test_a_batch_computes_the_bits_of_single_runs() -> None:
    parameters = parameters_of(CURRENT, ECCENTRIC, NOISY)
    seeds, noise = np.array([1, 2, 3, 4, 5]), radians(0.05) * np.array([1.0, 0.0, 2.0, 1.0, 0.0])
    batch = Batch(parameters, 5, varied={"sensor.encoder.seed": seeds, "sensor.encoder.noise": noise})
    batch.run(0.0, fin_command=0.1)
    angles = batch.run(0.25)["fin_angle"].copy()
    each = [run_of(0.25, CURRENT, ECCENTRIC, {"sensor.encoder.seed": int(seed), "sensor.encoder.noise": float(rms)},
                kernel=kernel, fin_command=0.1)["fin_angle"][-1]
            for seed, rms, kernel in zip(seeds, noise, ("python", *["auto"] * 4), strict=True)]
    assert np.array_equal(angles, each)
    assert len({*angles.tolist()}) == 4  # without noise the seed has no effect


# -- all errors ------------------------------------------------------------------

CASES: Mapping[str, Mapping[str, Any]] = {
    "current": CURRENT, "current, observer": {**CURRENT, "controller.load_observer": 80.0},
    "current at the limits": {**CURRENT, "drive.current_limit": 25.0, "drive.supply_voltage": 25.0},
    "encoder on the motor": ECCENTRIC, "encoder on the fin": {**ECCENTRIC, "encoder.on_fin": True},
    "noise": {**NOISY, "sensor.encoder.noise": radians(0.01), "controller.load_observer": 80.0},
    "all": {**CURRENT, **ECCENTRIC, **NOISY, "encoder.on_fin": True}}


@pytest.mark.parametrize("case", others_slow(CASES, lambda case: case == "all"))
def test_independent_integration_agrees(case: str) -> None:
    values = parameters_of({"encoder.enabled": False, "fin.start_angle": radians(8.0)}, CASES[case]).values
    time = np.arange(401) * 1e-3
    inputs = {"fin_command": np.radians(np.select([time < 0.03, time < 0.2], [8.0, 3.0], 8.0)),
              "aero_torque": np.where((time > 0.12) & (time < 0.28), 100.0, -60.0),
              "enable": np.where((time > 0.32) & (time < 0.36), 0.0, 1.0)}
    ours = simulate(values, 0.4, 1e-3, model=MODEL, **inputs)
    theirs = Sensed.simulate(values, {"time": time, **inputs})
    # The limit of every case at the default tick (tests/reference).
    assert np.max(np.abs(np.degrees(ours["fin_angle"] - theirs["fin_angle"]))) < 0.002


@pytest.mark.parametrize("model", others_slow(
    ("clutch", "nonlinear", "elastic", "ristanovic"), lambda model: model in ("clutch", "nonlinear")))
def test_kernels_agree(model: str) -> None:
    parameters = load_parameters(model=f"{model}+sensors")
    changes = parameters.having({**CURRENT, **ECCENTRIC, **NOISY})
    assert ("sensor.current.offset" in changes) is (model in ("nonlinear", "elastic"))
    run_both_kernels(parameters.with_values(changes).values, 0.1, f"{model}+sensors", aero_torque=-20.0,
                     fin_command=lambda t: 0.1 * sin(20.0 * pi * t))


def test_repeatability() -> None:
    """Gain error and eccentricity do not change it; an offset of the sensor acts as one of the drive's reference, which
    the integral has not yet removed in the first motion."""
    cases = {"none": {}, "gain": {**ECCENTRIC, "sensor.current.gain_error": 0.03},
             "offset": {"sensor.current.offset": 1.5}, "drive": {"drive.current_offset": -0.015 - 1.5}}
    error = {name: np.degrees(measure(Test("repeat", radians(15.0), torque=100.0), ParameterSubject(
        parameters_of(changes)), [{}], ("repeat_error",), ("maximum",))[0, 0]) for name, changes in cases.items()}
    # Three counts of 0.0007 deg each.
    assert error["gain"] == pytest.approx(error["none"], abs=0.002)
    assert error["offset"] == pytest.approx(error["drive"], abs=0.002)
    assert error["offset"] > error["none"] + 0.01
