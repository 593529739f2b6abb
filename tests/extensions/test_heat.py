"""Temperatures of winding and case: closed forms, matrix exponentials, energy balances, and models without heat."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Mapping
from math import exp, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from emcas_fmu.actuators import get
from emcas_fmu.actuators.capabilities import CURRENT_LIMIT
from emcas_fmu.fmi.package import build
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import heat, step_means
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate
from tests.marks import others_slow
from tests.runs import assert_equal, run_both_kernels
from tests.simulation import acting

from .held import MODEL, NO_COEFFICIENTS, blocked_run, values_of

BASE = load_parameters(model=MODEL)
MODELS = ("nonlinear", "elastic", "habibi", "ozkan", "ristanovic", "linear")


def _linear_system(v: Mapping[str, Any], current: float) -> tuple[Any, Any]:
    """Return A and b of dT/dt = A T + b for winding and case under a constant current."""
    w, c = v["heat.winding_capacity"], v["heat.case_capacity"]
    inner, outer = 1.0 / v["heat.winding_to_case"], 1.0 / v["heat.case_to_ambient"]
    cold = v["motor.resistance"] * current**2
    slope = cold * v["heat.resistance_coefficient"]
    a = np.array([[(slope - inner) / w, inner / w], [inner / c, -(inner + outer) / c]])
    b = np.array([(cold - slope * v["heat.reference_temperature"]) / w, outer * v["friction.temperature"] / c])
    return a, b


def _exact(v: Mapping[str, Any], current: float, start: Any, times: Any) -> Any:
    """Return the temperatures [degC] of winding and case at times [s]."""
    a, b = _linear_system(v, current)
    steady = np.linalg.solve(a, -b)
    return np.array([steady + expm(a * t) @ (np.array(start) - steady) for t in times])


# -- temperatures -----------------------------------------------------------------

def test_constant_loss_is_two_exponentials() -> None:
    """Over ten minutes, longer than both time constants."""
    v, run = blocked_run(18.0, 600.0, 10.0, {**NO_COEFFICIENTS, "drive.kp": 1e4})
    a, b = _linear_system(v, 18.0 * 1e4 / (1e4 + 0.25))
    rates, modes = (each.real for each in np.linalg.eig(a))
    steady = np.linalg.solve(a, -b)
    weights = np.linalg.solve(modes, np.full(2, 24.0) - steady)
    exact = steady + np.array([modes @ (weights * np.exp(rates * t)) for t in run["time"]])
    assert np.ptp(exact[:, 0]) > 30.0
    # A current that is 1e-7 s late is worth 1e-8 K; 1e6 steps round by less than 1e-15 of 80 degC each.
    assert run["winding_temperature"] == pytest.approx(exact[:, 0], abs=1e-7)
    assert run["case_temperature"] == pytest.approx(exact[:, 1], abs=1e-7)


def test_start_at_ambient_temperature_and_cooling_of_a_warm_motor() -> None:
    cold = simulate(values_of({"friction.temperature": -6.0}), 0.1, model=MODEL, enable=False)
    for name in ("winding_temperature", "case_temperature"):
        assert cold[name] == pytest.approx(-6.0, abs=1e-12)
    v = values_of({"heat.winding_start_rise": 60.0, "heat.case_start_rise": 25.0})
    warm = simulate(v, 100.0, 5.0, model=MODEL, enable=False)
    exact = _exact(v, 0.0, (84.0, 49.0), warm["time"])
    assert warm["winding_temperature"] == pytest.approx(exact[:, 0], abs=1e-8)  # rounding of 1.4e5 steps
    assert warm["case_temperature"] == pytest.approx(exact[:, 1], abs=1e-8)


@pytest.mark.parametrize("coefficient", [0.0, 0.01])
def test_order_in_the_tick(coefficient: float) -> None:
    """The error is of second order, also if the resistance rises; time constants of milliseconds make it visible."""
    errors = []
    for tick in (1e-3, 5e-4, 2.5e-4):
        v, run = blocked_run(20.0, 0.02, 1e-3, {
            "heat.winding_capacity": 0.5, "heat.case_capacity": 2.0, "heat.winding_to_case": 0.02,
            "heat.case_to_ambient": 0.02, "heat.torque_coefficient": 0.0, "drive.kp": 1e4, "solver.max_tick": tick,
            "drive.transport_delay": 0.0, "heat.resistance_coefficient": coefficient})
        exact = _exact(v, 20.0 * 1e4 / (1e4 + 0.25), (24.0, 24.0), run["time"])
        errors.append(np.abs(run["winding_temperature"] - exact[:, 0]).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.2), errors


def test_resistance_and_motor_constants_follow_the_temperatures() -> None:
    """Voltage, current, torque and back-EMF show it, at temperatures far from the reference."""
    _, run = blocked_run(15.0, 60.0, 1.0, {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 50.0})
    winding, case = run["winding_temperature"], run["case_temperature"]
    flux = 1.0 - 0.0011 * (case - 24.0)
    # In the first row no current flows. Outputs are those at ends of ticks, the motor has the resistance of their
    # middles, 3e-4 s before: less than 0.5 K/s times that.
    assert run["motor_voltage"][1:] / run["motor_current"][1:] == pytest.approx(
        (0.25 * (1.0 + 0.00387 * (winding - 24.0)))[1:], rel=1e-6)
    assert run["motor_torque"] == pytest.approx(0.11 * flux * run["motor_current"], rel=1e-12)
    assert flux[0] == pytest.approx(0.945)
    turning = simulate(values_of({"heat.case_start_rise": 50.0}), 0.05, model=MODEL, enable=False, aero_torque=100.0)
    assert turning["motor_speed"][-1] > 10.0
    assert turning["motor_voltage"] == pytest.approx(0.11 * 0.945 * turning["motor_speed"], rel=1e-4)  # it cools


@pytest.mark.parametrize("model", MODELS)
def test_a_disabled_drive_does_not_heat_the_winding(model: str) -> None:
    """The bridge is open, whatever the current in the state; in an enabled drive this current heats."""
    actuator, p = get(f"{model}+heat"), load_parameters(model=f"{model}+heat").nested()
    x = Record(**{**actuator.start(FLOATS, p), "motor_current": 50.0})
    for enabled in (False, True):
        u = acting(enabled=enabled, reference=5.0)  # the current of an ideal loop follows it at once
        moved, _ = actuator.step(FLOATS, p, x, u, 1e-4)
        assert (moved["winding_temperature"] > 24.0) == enabled
        if CURRENT_LIMIT in actuator.provides:
            assert (moved["i2t_load"] > 0.0) == enabled


def test_resistance_and_flux_fall_to_a_tenth_at_most() -> None:
    p = BASE.with_values({"heat.torque_coefficient": -0.01, "heat.resistance_coefficient": 0.01}).nested()
    assert heat.magnets(FLOATS, p, 500.0) == 0.1
    assert heat.resistance(FLOATS, p, -90.0) == pytest.approx(0.25 * 0.1)
    assert heat.resistance(FLOATS, p, 74.0) == pytest.approx(0.25 * 1.5)


@pytest.mark.parametrize("ratio", [1e-9, 1e-3, 9.9e-3, 1.01e-2, 0.3, 6.0, 50.0])
def test_mean_square_of_an_exponential(ratio: float) -> None:
    """Quadrature agrees, also on both sides of the change from series to closed form at 0.01."""
    start, end = 7.0, -12.0
    final = (end - start * exp(-ratio)) / -np.expm1(-ratio)
    exact = quad(lambda s: (start + (final - start) * -np.expm1(-ratio * s)) ** 2, 0.0, 1.0, epsabs=1e-12)[0]
    assert step_means.mean_square(FLOATS, start, end, ratio) == pytest.approx(exact, rel=1e-5)
    assert step_means.mean_square(FLOATS, 5.0, 5.0, ratio) == 25.0


# -- energy -----------------------------------------------------------------------

@pytest.mark.parametrize("changes", [
    {"winding_capacity": 0.01, "winding_to_case": 1e-4, "winding_start_rise": 250.0, "case_start_rise": 0.0},
    {"case_capacity": 0.01, "case_to_ambient": 1e-4, "case_start_rise": 250.0, "winding_start_rise": 0.0},
    {"winding_capacity": 0.01, "case_capacity": 0.01, "winding_to_case": 1e-4, "winding_start_rise": 250.0}])
def test_heat_only_flows_to_the_colder_node(changes: dict[str, float]) -> None:
    """The node's time constant is below a tick; the winding cooled from 274 to -216 degC beside a case of 24 degC."""
    values = {**BASE.values, **{f"heat.{name}": value for name, value in changes.items()}}
    run = simulate(values, 0.021, 7e-4, model=MODEL)  # rows at every tick
    winding, case = run["winding_temperature"], run["case_temperature"]
    ambient = values["friction.temperature"]
    least = min(ambient, winding[0], case[0])
    assert min(winding.min(), case.min()) >= least - 1e-9
    stored = values["heat.winding_capacity"] * winding + values["heat.case_capacity"] * case
    assert np.diff(stored).max() <= 1e-3 * (stored[0] - stored[-1])


def test_losses_are_stored_or_leave_to_ambient() -> None:
    """Trapezia over 20 us integrate the outputs of a motion that reverses."""
    v = values_of({"solver.max_tick": 2e-5, "heat.winding_capacity": 5.0, "heat.case_capacity": 20.0,
                   "heat.case_to_ambient": 0.05, "heat.winding_to_case": 0.05})
    run = simulate(v, 2.0, 2e-5, model=MODEL, fin_command=lambda t: 0.3 if sin(20.0 * t) > 0.0 else -0.3)
    winding, case, time = run["winding_temperature"], run["case_temperature"], run["time"]
    lost = np.trapezoid(0.25 * (1.0 + 0.00387 * (winding - 24.0)) * run["motor_current"]**2, time)
    stored = 5.0 * (winding[-1] - winding[0]) + 20.0 * (case[-1] - case[0])
    left = np.trapezoid((case - 24.0) / 0.05, time)
    assert left > 0.3 * stored > 10.0
    # A jump of the current takes five of these intervals, in which trapezia are off by 1e-4 of the loss.
    assert stored + left == pytest.approx(lost, rel=3e-4)
    # The supply's energy becomes heat and work; the inductance stores 0.5 J at most.
    magnetic = 0.5 * v["motor.inductance"] * run["motor_current"][-1]**2
    supplied = np.trapezoid(run["supply_power"], time)
    work = np.trapezoid(run["motor_torque"] * run["motor_speed"], time)
    assert stored + left + work + magnetic == pytest.approx(supplied, rel=2e-2)


# -- with and without -------------------------------------------------------------

@pytest.mark.parametrize("model", others_slow(MODELS, lambda model: model in ("nonlinear", "ozkan", "linear")))
def test_without_coefficients_and_i2t_no_bit_changes(model: str) -> None:
    parameters = load_parameters(model=f"{model}+heat")
    # An actuator without a current limit has no I2t.
    values = parameters.with_values(parameters.having({**NO_COEFFICIENTS, "heat.peak_time": 1e4})).values
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
                              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.2 < t < 0.23}
    warm = simulate(values, 0.3, model=f"{model}+heat", **inputs)
    assert warm["winding_temperature"][-1] > 24.01
    plain = {name: value for name, value in values.items() if not name.startswith("heat.")}
    assert_equal(warm, simulate(plain, 0.3, model=model, **inputs))


@pytest.mark.kernel(MODEL)
@pytest.mark.parametrize("model", others_slow(MODELS, lambda model: model == "nonlinear"))
def test_kernels_agree(model: str) -> None:
    parameters = load_parameters(model=f"{model}+heat")
    changes = parameters.having({"heat.peak_time": 0.05, "heat.continuous_current": 5.0,
                                 "heat.winding_start_rise": 30.0})
    run_both_kernels(parameters.with_values(changes).values, 0.2, f"{model}+heat", 3.7e-4, aero_torque=-40.0,
                     fin_command=lambda t: 0.3 if sin(30.0 * t) > 0.0 else -0.3, enable=lambda t: not 0.1 < t < 0.11)


def test_the_plain_model_has_no_code_of_heat() -> None:
    assert "heat" not in codegen.source(model="nonlinear")


def test_units_of_files() -> None:
    values = BASE.with_values({"heat.resistance_coefficient": "0.39 %/K", "heat.winding_capacity": "0.2 kJ/K",
                               "heat.winding_to_case": "200 mK/W", "heat.winding_limit": "266 degF"}).values
    assert values["heat.resistance_coefficient"] == 0.0039
    assert values["heat.winding_capacity"] == 200.0
    assert values["heat.winding_to_case"] == 0.2
    assert values["heat.winding_limit"] == pytest.approx(130.0)


# -- FMUs -------------------------------------------------------------------------

_SIMULATE = textwrap.dedent("""
    import sys
    import numpy as np
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu
    path, several, output = sys.argv[1], sys.argv[2] == "2", sys.argv[3]
    assert validate_fmu(path) == []
    prefix = "fin[1]." if several else ""
    names = ("fin_angle", "motor_current", "winding_temperature", "case_temperature", "i2t_load", "current_limit")
    time = np.arange(301) * 1e-3
    inputs = np.array(list(zip(time, 0.3 * np.sign(np.sin(40.0 * time)), np.full(301, -40.0))),
                      dtype=[("time", float), (prefix + "fin_command", float), (prefix + "aero_torque", float)])
    found = simulate_fmu(path, validate=True, stop_time=0.3, step_size=1e-3, output_interval=1e-3, input=inputs,
                         output=[prefix + name for name in names],
                         start_values={prefix + "heat.peak_time": 0.05, prefix + "heat.continuous_current": 5.0})
    assert "emcas_fmu" not in sys.modules
    np.savetxt(output, [list(row) for row in found], fmt="%.17g")
""")


@pytest.mark.slow
@pytest.mark.fmu
@pytest.mark.parametrize(("model", "fins"), [("nonlinear", 1), ("elastic", 1), ("nonlinear", 2)])
def test_valid_fmus_of_both_back_ends_compute_the_same_bits(model: str, fins: int, tmp_path: Path) -> None:
    """In separate processes, with winding and I2t limit in effect."""
    parameters = load_parameters(model=f"{model}+heat")
    results = []
    for backend, cc in (("python", None), ("native", "gcc")):
        path, table = tmp_path / f"{backend}.fmu", tmp_path / f"{backend}.txt"
        build(parameters, path, backend, cc=cc, fins=fins)
        subprocess.run([sys.executable, "-c", _SIMULATE, path, str(fins), table], check=True, cwd=tmp_path)
        results.append(np.loadtxt(table))
    assert np.array_equal(results[0], results[1])
    *_, winding, _, load, limit = results[0][-1]
    assert winding > 24.1
    assert load > 0.9
    assert 5.0 * (1.0 - 1e-12) <= limit < 60.0
