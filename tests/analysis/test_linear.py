"""Linearised systems agree with finite differences, closed forms, the thesis's model and each other."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from math import degrees, pi, radians, sqrt
from typing import Any

import control as ct
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emcas_fmu.actuators.declaration import PlantInputs
from emcas_fmu.actuators.electromechanical import nonlinear
from emcas_fmu.bench.linear import frequency
from emcas_fmu.bench.linear.actuator import LinearActuator
from emcas_fmu.bench.linear.systems import decays, sampled, shown
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import RATED
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics.loads import NONE
from emcas_fmu.reference.linear import LinearModel
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis import thesis
from emcas_fmu.studies.analysis.final_values import final_values
from emcas_fmu.studies.analysis.locus import locus
from tests.default_actuator import namespace
from tests.marks import slow

Values = Mapping[str, Any]


def test_jacobian_agrees_with_finite_differences(values: Values) -> None:
    p = {**values, "loads.gravity": True, "friction.fin_viscous": 3.0}
    linear = LinearActuator(p, radians(14.0), -70.0)
    point = np.array([*linear.rest, linear.point.reference, linear.point.aero_torque])
    names = ("motor_angle", "motor_speed", "motor_current", "drive_integral")

    def derivatives(x: Any) -> Any:
        *states, reference, torque = map(float, x)
        u = PlantInputs(reference=reference, **vars(NONE.replace(aero_torque=torque, f_z=9.80665)))
        rates = nonlinear.derivatives(FLOATS, namespace(p), Record(**dict(zip(names, states, strict=True))), u)
        return np.array([rates[name] for name in names])

    assert np.max(np.abs(derivatives(point))) < 1e-6  # an equilibrium; single terms are 1e5 A/s
    exact = np.hstack([linear.continuous.A, linear.continuous.B])
    for column, scale in enumerate((1.0, 1.0, 1.0, 1.0, 1.0, 10.0)):
        h = scale * 1e-4
        offset = np.eye(6)[column] * h
        slope = (derivatives(point + offset) - derivatives(point - offset)) / (2.0 * h)
        # Errors of central differences: h^2/6 times the third derivative, and eps/h. Both are about 1e-8 of a row.
        rows = np.max(np.abs(exact), axis=1)
        np.testing.assert_allclose(exact[:, column] / rows, slope / rows, rtol=0, atol=1e-6)


def test_motor_matrices_agree_with_closed_forms(values: Values) -> None:
    at = radians(10.0)
    linear = LinearActuator(values, at)
    lead, arm, initial = values["screw.lead"], values["kinematics.moment_arm"], values["kinematics.initial_angle"]
    ratio = arm / lead / np.cos(at + initial) ** 2
    inertia = (values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2
               + (values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]) / ratio**2)
    viscous = 0.5 * (values["friction.viscous.positive"] + values["friction.viscous.negative"])
    loop, inductance = values["motor.resistance"] + values["drive.kp"], values["motor.inductance"]
    expected = [[0.0, 1.0, 0.0, 0.0], [0.0, -viscous / inertia, values["motor.torque_constant"] / inertia, 0.0],
                [0.0, -values["motor.back_emf_constant"] / inductance, -loop / inductance, 1.0 / inductance],
                [0.0, 0.0, -values["drive.ki"], 0.0]]
    gain = values["drive.current_gain"]
    plant = linear.continuous
    np.testing.assert_allclose(plant.A, expected, rtol=1e-12, atol=1e-12)
    acting = [[0.0, 0.0], [0.0, 1.0 / ratio / inertia], [values["drive.kp"] * gain / inductance, 0.0],
              [values["drive.ki"] * gain, 0.0]]
    np.testing.assert_allclose(plant.B, acting, rtol=1e-12)
    assert plant.C[-1, 0] == pytest.approx(1.0 / ratio, rel=1e-12)  # fin over motor angle
    assert linear.point.ratio == pytest.approx(ratio, rel=1e-12)


def test_current_and_voltage_at_rest_balance_the_load(values: Values) -> None:
    linear = LinearActuator(values, radians(5.0), -80.0)
    assert linear.point.current == pytest.approx(80.0 / linear.point.ratio / values["motor.torque_constant"], rel=1e-9)
    assert linear.point.voltage == pytest.approx(linear.point.current * values["motor.resistance"], rel=1e-9)
    u = linear.point.reference
    assert values["drive.current_gain"] * u + values["drive.current_offset"] == pytest.approx(linear.point.current)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 3.7e-3, 5e-3])
def test_loops_agree_with_the_thesis_model(values: Values, delay: float) -> None:
    p = {**values, "kinematics.initial_angle": 0.0, "encoder.enabled": False, "drive.transport_delay": delay}
    linear = LinearActuator(p)
    grid = frequency.frequencies(450.0, 0.01)
    for system, expected in ((linear.command_to_angle, thesis.closed(p)),
                             (linear.loop("reference"), thesis.reference_loop(p))):
        # Two ways to the same matrices: rounding, amplified by integrators at low frequencies.
        np.testing.assert_allclose(frequency.evaluate(system, grid), frequency.evaluate(expected, grid), rtol=1e-7)


def test_thesis_system_is_the_linear_reference_model(values: Values) -> None:
    grid = np.array([0.1, 3.0, 20.0, 100.0])
    np.testing.assert_allclose(frequency.evaluate(thesis.closed(values), grid),
                               LinearModel(values).frequency_response(grid), rtol=1e-9)


@pytest.mark.parametrize(("whole", "rest"), [(0, 4e-4), (1, 0.0), (3, 7e-4), *slow((0, 0.0))])
def test_sampled_plant_agrees_with_integration(values: Values, whole: int, rest: float) -> None:
    plant, period = LinearActuator(values).continuous, 1e-3
    system = sampled(plant, period, whole, rest)
    steps = np.random.default_rng(3).standard_normal((6, 2))
    found = ct.forced_response(system, np.arange(6) * period, steps.T).outputs

    def slope(time: float, x: Any) -> Any:
        late = int(np.floor((time - rest) / period + 1e-9)) - whole
        now = steps[min(int(time / period + 1e-9), 5)]
        return plant.A @ x + plant.B @ np.array([steps[late, 0] if late >= 0 else 0.0, now[1]])

    x, outputs = np.zeros(len(plant.A)), []
    for k in range(6):
        outputs.append(plant.C @ x)
        cuts = sorted({k * period, k * period + rest, (k + 1) * period})
        for begin, end in pairwise(cuts):
            middle = 0.5 * (begin + end)  # inputs are constant between cuts
            x = solve_ivp(lambda _, y, t=middle: slope(t, y), (begin, end), x, "Radau", rtol=1e-10, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(found.T, outputs, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("coupling", [0.0, 1e-5])
def test_weakly_observable_mode_is_not_hidden(coupling: float) -> None:
    """Poles 0.5 and 0.8 are visible, 1.02 is uncontrollable, 1 is unobservable without `coupling`; units differ."""
    a = np.diag([0.5, 0.8, 1.0, 1.02])
    b = np.array([[1.0, 0.3], [0.7, -1.0], [1.0, 2.0], [0.0, 0.0]])
    c = np.array([[1.0, -0.4, coupling, 0.5], [0.2, 1.0, 0.0, -2.0]])
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(4, 4)))[0] * np.array([[1.0], [1e7], [1e-3], [50.0]])
    full = ct.ss(turn @ a @ np.linalg.inv(turn), turn @ b, c @ np.linalg.inv(turn), np.zeros((2, 2)), 1e-3)
    reduced, hidden = shown(full)
    # Rounding of 1e-16 times the ratio of units, 1e10, which balancing reduces: measured 1e-12.
    assert np.sort(hidden) == pytest.approx([1.02] if coupling else [1.0, 1.02], abs=1e-10)
    assert decays(reduced) is (coupling == 0.0)
    z = np.exp(1j * np.geomspace(1e-3, 3.0, 20))
    np.testing.assert_allclose(reduced(z), full(z), rtol=1e-8)


def test_current_loop_is_of_first_order_at_high_frequencies(values: Values) -> None:
    loop = LinearActuator(values).loop("current")
    hertz = np.array([300.0, 1000.0, 5000.0])
    s = 2j * pi * hertz
    impedance = values["motor.inductance"] * s + values["motor.resistance"]
    # The turning motor adds K_t K_e/(J s) to the impedance: 0.1 % of it at 300 Hz.
    expected = (values["drive.kp"] + values["drive.ki"] / s) / impedance
    np.testing.assert_allclose(frequency.evaluate(loop, hertz), expected, rtol=0.03)
    margins = frequency.margins(loop)
    exact = sqrt(values["drive.kp"]**2 - values["motor.resistance"]**2) / values["motor.inductance"] / (2.0 * pi)
    assert margins.gain_crossover == pytest.approx(exact, rel=1e-3)
    assert margins.gain == np.inf


def test_gain_margins_are_limits_of_stability(values: Values) -> None:
    linear = LinearActuator(values, radians(8.0))
    for name in ("velocity", "position", "reference"):
        loop, margins = linear.loop(name), frequency.margins(linear.loop(name))
        for factor, stable in ((0.995, True), (1.005, False)):
            poles = ct.feedback(loop * (margins.gain * factor), 1).poles()
            # With the position loop open its two integrators have poles at 1, and rounding splits a double pole by
            # the square root of eps, some 1e-8. A gain change of 0.5 % moves the critical pole by 1e-3.
            assert (float(np.max(np.abs(poles))) < 1.0 + 1e-7) is stable


def test_final_values_agree_with_closed_forms(values: Values) -> None:
    p = {**values, "drive.ki": 5.0}
    rows = final_values(p)
    ratio = LinearActuator(p).point.ratio
    # At rest T/R = K_t K_v K_vel K_pos R e: with the drive's integral the current equals its reference.
    gains = (values["motor.torque_constant"] * values["drive.current_gain"] * values["controller.velocity.kp"]
             * values["controller.position.kp"])
    assert rows["p"]["load_error_deg"] == pytest.approx(-degrees(RATED / ratio**2 / gains), rel=1e-6)
    # Errors vanish with an integrator in the plant (command) or in the controller (load); rounding remains.
    errors = [rows["p"]["command_error_deg"], rows["pi"]["command_error_deg"], rows["pi"]["load_error_deg"]]
    assert errors == pytest.approx([0.0] * 3, abs=1e-7)


def test_final_value_is_the_end_of_a_simulated_load_step(smooth: Values) -> None:
    p = {**smooth, "drive.ki": 50.0, "controller.position.ki": 0.0, "drive.current_offset": 0.0,
         "kinematics.initial_angle": 0.0}
    row = final_values(p)["p"]
    assert row["stable"]
    stop = 10.0 * row["slowest_time_constant_s"]
    run = simulate(p, stop, aero_torque=0.1 * RATED)  # a tenth of the load, so that the lever's curvature is negligible
    # e^-10 of the slowest mode remains.
    assert -degrees(run["fin_angle"][-1]) == pytest.approx(0.1 * row["load_error_deg"], rel=1e-3)


def test_rational_model_has_the_slow_poles_of_the_sampled_model(values: Values) -> None:
    p = {**values, "encoder.enabled": False, "controller.sample_time": 1e-4}
    linear = LinearActuator(p)
    exact, approximate = frequency.continuous_poles(linear.closed), linear.rational().poles()
    # With a sample time of 0.1 ms the loop is nearly continuous; modes up to the bandwidth are compared.
    for pole in exact[np.abs(exact) < 2.0 * pi * 30.0]:
        assert np.min(np.abs(approximate - pole)) < 0.02 * abs(pole) + 1e-3


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer points of the locus, which linearises at every point: 9."""
    monkeypatch.setattr("emcas_fmu.studies.analysis.locus._POINTS", 9)


@pytest.mark.usefixtures("few_points")
def test_stable_range_of_the_locus_ends_at_the_gain_margin() -> None:
    parameters = load_parameters()
    linear = LinearActuator(parameters.values)
    margins = frequency.margins(linear.loop("reference"))
    found = locus(parameters, "drive.current_gain")
    # The limit is bisected to a thousandth of the distance between points.
    assert found.stable_range[1] / found.nominal == pytest.approx(margins.gain, rel=1e-3)
    assert len(found.poles) == len(found.values)


@pytest.mark.parametrize(("name", "message"), [("controller.position.kq", "controller.position.kp"),
                                               ("mass.fin", "moves no pole"), ("friction.fin_viscous", "is 0"),
                                               ("encoder.enabled", "no such parameter")])
@pytest.mark.usefixtures("few_points")
def test_locus_of_a_parameter_without_effect_is_refused(name: str, message: str) -> None:
    parameters = load_parameters().with_values({"friction.fin_viscous": 0.0})
    with pytest.raises(EmcasError, match=message):
        locus(parameters, name)


def test_controllers_without_integrals_have_three_states_less(values: Values) -> None:
    p = {**values, "controller.position.ki": 0.0, "drive.ki": 0.0, "encoder.enabled": False}
    linear = LinearActuator(p)
    assert linear.stable
    assert len(linear.closed.poles()) == len(LinearActuator(values).closed.poles()) - 3


@pytest.mark.parametrize(("angle", "torque", "message"), [(21.0, 0.0, "command.limit"),
                                                          (0.0, 1000.0, "drive.current_limit")])
def test_unreachable_operating_point_is_refused(values: Values, angle: float, torque: float, message: str) -> None:
    with pytest.raises(EmcasError, match=message):
        LinearActuator(values, radians(angle), torque)


def test_bandwidth_at_the_command_limit_is_that_just_inside(values: Values) -> None:
    limit = values["command.limit"]
    inside, end = (frequency.response(LinearActuator(values, at).command_to_angle) for at in (0.999 * limit, limit))
    assert end.bandwidth == pytest.approx(inside.bandwidth, rel=1e-3)


# Resonances that are narrower than the steps of the frequency grid: oil column, hinge, and a notch without damping.
NARROW = {
    "oil column": ("electrohydraulic", {
        "controller.position.kp": 117.0, "controller.position.ki": 606.0, "valve.natural_frequency": 896.0}),
    "hinge": ("elastic", {
        name: value for name, value in load_parameters("hinge-stiffness", model="elastic").values.items()
        if name.startswith("drive_line.")}),
    "notch": ("elastic+filters", {
        "drive_line.shaft_stiffness": 1e4, "drive_line.fork_stiffness": 0.0, "drive_line.structure_stiffness": 0.0,
        "drive_line.hinge_damping": 0.0, "filters.notch_zero_damping": 0.0, "filters.notch_pole_damping": 0.2,
        "filters.notch_frequency": 120.0 * np.pi})}


@pytest.mark.parametrize("name", ["hinge", *slow("oil column", "notch")])
def test_margins_of_requirements_agree_with_a_dense_grid(name: str) -> None:
    """A grid of 200 frequencies alone would give 0.8 dB too much for the hinge, and too long a delay for the others."""
    model, changes = NARROW[name]
    parameters = load_parameters(model=model).with_values(changes)
    loop = LinearActuator(parameters.values, model=model).loop("reference")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frequency, "_refined", lambda loop, grid: grid)
        expected = frequency.margins(loop, np.geomspace(0.05, frequency.highest(loop), 20_000))
    found = measure(Test("linear"), ParameterSubject(parameters), [{}],
                    ("gain_margin", "phase_margin", "delay_margin"), ("minimum",) * 3)[0]
    assert found == pytest.approx([expected.gain_db, expected.phase, expected.delay], rel=1e-4)  # of the spline
