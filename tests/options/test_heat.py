"""Heat and I2t: against closed forms, matrix exponentials, energy, and the models without them."""

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
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.kernels import compiled, program
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.physics import heat
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+heat"
BASE = load_parameters(model=MODEL)
MODELS = ("nonlinear", "elastic", "habibi", "ozkan", "ristanovic", "linear")
# The rotor held by friction, no controller: the current is drive.current_offset within the limit, less R/(R + kp) of
# it, 0.025 % at the gain below. At 1000 V on 1 uH it is there within 1e-7 s.
HELD = {"friction.coulomb.positive[0]": 10.0, "friction.coulomb.negative[0]": 10.0, "controller.position.kp": 0.0,
        "controller.position.ki": 0.0, "controller.velocity.kp": 0.0, "compensation.gain": 0.0, "drive.ki": 0.0,
        "drive.kp": 1e3, "drive.supply_voltage": 1000.0, "motor.inductance": 1e-6}
NO_COEFFICIENTS = {"heat.resistance_coefficient": 0.0, "heat.torque_coefficient": 0.0}


def _values(overrides: Mapping[str, Any] | None = None, model: str = MODEL) -> Mapping[str, Any]:
    return load_parameters(model=model).replace(overrides or {}).values


def _held(current: float, stop: float, step: float, overrides: Mapping[str, Any]) -> tuple[Mapping[str, Any], Any]:
    values = _values({**HELD, "drive.current_offset": current, **overrides})
    return values, simulate(values, stop, step, model=MODEL)


def _without(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if not name.startswith("heat.")}


def _linear_system(v: Mapping[str, Any], current: float) -> tuple[Any, Any]:
    """A and b of the two nodes under a constant current, written from the equations; resistance in A."""
    w, c = v["heat.winding_capacity"], v["heat.case_capacity"]
    inner, outer = 1.0 / v["heat.winding_to_case"], 1.0 / v["heat.case_to_ambient"]
    cold = v["motor.resistance"] * current**2
    slope = cold * v["heat.resistance_coefficient"]
    a = np.array([[(slope - inner) / w, inner / w], [inner / c, -(inner + outer) / c]])
    b = np.array([(cold - slope * v["heat.reference_temperature"]) / w, outer * v["friction.temperature"] / c])
    return a, b


def _exact(v: Mapping[str, Any], current: float, start: Any, times: Any) -> Any:
    a, b = _linear_system(v, current)
    steady = np.linalg.solve(a, -b)
    return np.array([steady + expm(a * t) @ (np.array(start) - steady) for t in times])


# -- temperatures -----------------------------------------------------------------


def test_constant_loss_is_two_exponentials() -> None:
    """From eigenvalues; over ten minutes, beyond both time constants."""
    v, run = _held(18.0, 600.0, 10.0, {**NO_COEFFICIENTS, "drive.kp": 1e4})
    a, b = _linear_system(v, 18.0 * 1e4 / (1e4 + 0.25))
    rates, modes = np.linalg.eig(a)
    steady = np.linalg.solve(a, -b)
    weights = np.linalg.solve(modes, np.full(2, 24.0) - steady)
    exact = steady + np.array([modes @ (weights * np.exp(rates * t)) for t in run["time"]])
    assert np.ptp(exact[:, 0]) > 30.0
    # A current that is there 1e-7 s late, 1e-8 K; rounding of 1e6 steps, below 1e-15 of 80 each.
    assert run["winding_temperature"] == pytest.approx(exact[:, 0], abs=1e-7)
    assert run["case_temperature"] == pytest.approx(exact[:, 1], abs=1e-7)


def test_it_starts_at_ambient_or_warm_and_cools() -> None:
    cold = simulate(_values({"friction.temperature": -6.0}), 0.1, model=MODEL, enable=False)
    for name in ("winding_temperature", "case_temperature"):
        assert cold[name] == pytest.approx(-6.0, abs=1e-12)
    v = _values({"heat.winding_start_rise": 60.0, "heat.case_start_rise": 25.0})
    warm = simulate(v, 100.0, 5.0, model=MODEL, enable=False)
    exact = _exact(v, 0.0, (84.0, 49.0), warm["time"])
    assert warm["winding_temperature"] == pytest.approx(exact[:, 0], abs=1e-8)  # as above
    assert warm["case_temperature"] == pytest.approx(exact[:, 1], abs=1e-8)


@pytest.mark.parametrize("coefficient", [0.0, 0.01])
def test_order_in_the_tick(coefficient: float) -> None:
    """Of second order, with the resistance's rise too; time constants of milliseconds make it visible."""
    errors = []
    for tick in (1e-3, 5e-4, 2.5e-4):
        v, run = _held(20.0, 0.02, 1e-3, {
            "heat.winding_capacity": 0.5, "heat.case_capacity": 2.0, "heat.winding_to_case": 0.02,
            "heat.case_to_ambient": 0.02, "heat.torque_coefficient": 0.0, "drive.kp": 1e4, "solver.max_tick": tick,
            "drive.transport_delay": 0.0, "heat.resistance_coefficient": coefficient})
        exact = _exact(v, 20.0, (24.0, 24.0), run["time"])  # a current 3e-5 short is 1e-4 K
        short = _exact(v, 20.0 * 1e4 / (1e4 + 0.25), (24.0, 24.0), run["time"])
        assert np.abs(exact - short).max() < 2e-4
        errors.append(np.abs(run["winding_temperature"] - short[:, 0]).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(slopes - 2.0) < 0.2), errors


def test_resistance_and_constants_follow() -> None:
    """Told by voltage, current, torque and back-EMF, at temperatures far from the reference."""
    _, run = _held(15.0, 60.0, 1.0, {"heat.winding_start_rise": 80.0, "heat.case_start_rise": 50.0})
    winding, case = run["winding_temperature"], run["case_temperature"]
    late = slice(1, None)  # at the start no current flows yet
    flux = 1.0 - 0.0011 * (case - 24.0)
    # Ends of ticks, the motor that of their middles: 3e-4 s at below 0.5 K/s.
    assert run["motor_voltage"][late] / run["motor_current"][late] == pytest.approx(
        (0.25 * (1.0 + 0.00387 * (winding - 24.0)))[late], rel=1e-6)
    assert run["motor_torque"] == pytest.approx(0.11 * flux * run["motor_current"], rel=1e-12)
    assert flux[0] == pytest.approx(0.945)
    turning = simulate(_values({"heat.case_start_rise": 50.0}), 0.05, model=MODEL, enable=False, aero_torque=100.0)
    assert turning["motor_speed"][-1] > 10.0
    assert turning["motor_voltage"] == pytest.approx(0.11 * 0.945 * turning["motor_speed"], rel=1e-4)  # it cools


def test_below_a_tenth_the_lines_are_left() -> None:
    p = BASE.replace({"heat.torque_coefficient": -0.01, "heat.resistance_coefficient": 0.01}).nested()
    assert heat.magnets(FLOATS, p, 500.0) == 0.1
    assert heat.resistance(FLOATS, p, -90.0) == pytest.approx(0.25 * 0.1)
    assert heat.resistance(FLOATS, p, 74.0) == pytest.approx(0.25 * 1.5)


@pytest.mark.parametrize("ratio", [1e-9, 1e-3, 9.9e-3, 1.01e-2, 0.3, 6.0, 50.0])
def test_mean_square_of_an_exponential(ratio: float) -> None:
    """By quadrature; at the seam of series and closed form to what either gives there."""
    start, end = 7.0, -12.0
    final = (end - start * exp(-ratio)) / -np.expm1(-ratio)
    exact = quad(lambda s: (start + (final - start) * -np.expm1(-ratio * s)) ** 2, 0.0, 1.0, epsabs=1e-12)[0]
    assert heat.mean_square(FLOATS, start, end, ratio) == pytest.approx(exact, rel=1e-5)
    assert heat.mean_square(FLOATS, 5.0, 5.0, ratio) == 25.0


# -- energy -----------------------------------------------------------------------


def test_losses_are_stored_or_leave() -> None:
    """From outputs alone: integrals by trapezia over 20 us, in a motion that reverses."""
    v = _values({"solver.max_tick": 2e-5, "heat.winding_capacity": 5.0, "heat.case_capacity": 20.0,
                 "heat.case_to_ambient": 0.05, "heat.winding_to_case": 0.05})
    run = simulate(v, 2.0, 2e-5, model=MODEL, fin_command=lambda t: 0.3 if sin(20.0 * t) > 0.0 else -0.3)
    winding, case, time = run["winding_temperature"], run["case_temperature"], run["time"]
    lost = np.trapezoid(0.25 * (1.0 + 0.00387 * (winding - 24.0)) * run["motor_current"]**2, time)
    stored = 5.0 * (winding[-1] - winding[0]) + 20.0 * (case[-1] - case[0])
    left = np.trapezoid((case - 24.0) / 0.05, time)
    assert left > 0.3 * stored > 10.0
    # A jump of the current takes five of these intervals; trapezia are off by 1e-4 of the loss there.
    assert stored + left == pytest.approx(lost, rel=3e-4)
    # What is taken from the supply turns to heat and work, but for what the inductance holds, 0.5 J at most.
    held = 0.5 * v["motor.inductance"] * run["motor_current"][-1]**2
    drawn = np.trapezoid(run["supply_power"], time)
    work = np.trapezoid(run["motor_torque"] * run["motor_speed"], time)
    assert stored + left + work + held == pytest.approx(drawn, rel=2e-2)


# -- I2t --------------------------------------------------------------------------

_FOLD = {**NO_COEFFICIENTS, "heat.peak_time": 0.5, "heat.continuous_current": 20.0}


def test_time_at_peak_and_folding_back_are_closed_forms() -> None:
    """Demand far above: the peak for its time, then i^2 falls on an exponential to the continuous one."""
    _, run = _held(500.0, 1.2, 1e-4, _FOLD)
    share = (1e3 / (1e3 + 0.25))**2  # of the square of the reference that flows
    reserve, continuous, budget = 3200.0, 400.0, 3200.0 * 0.5 / 0.9
    full = 0.9 * budget / (share * 3600.0 - continuous)
    assert full == pytest.approx(0.5, rel=1e-3)
    limit, time = run["current_limit"], run["time"]
    folds = time[np.flatnonzero(limit < 60.0)[0]]
    assert folds == pytest.approx(full, abs=1.5e-4)  # between two points; folding takes effect within a tick before
    # ds/dt = (share (I_c^2 + x reserve) - I_c^2)/budget where x = (1 - s)/0.1.
    rate = share * reserve / (0.1 * budget)
    rest = (1.0 - share) * continuous / (share * reserve)
    after = time >= full
    x = rest + (1.0 - rest) * np.exp(-rate * (time[after] - full))
    # Less than a tick of 0.7 ms late, at up to 480 A/s.
    assert limit[after] == pytest.approx(np.sqrt(continuous + np.minimum(x, 1.0) * reserve), abs=0.3)
    assert limit[-1] == pytest.approx(20.0, abs=0.02)
    assert np.all(np.diff(limit) <= 0.0)
    assert run["i2t_load"].max() < 1.0
    assert np.all(run["motor_current"] <= limit)


def test_the_limit_converges_from_the_safe_side() -> None:
    """Less heat, so less load, the longer the tick: of first order."""
    _, fine = _held(500.0, 0.6, 1e-3, {**_FOLD, "solver.max_tick": 1e-6})
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):
        _, run = _held(500.0, 0.6, 1e-3, {**_FOLD, "solver.max_tick": tick, "drive.transport_delay": 0.0})
        short = (fine["i2t_load"] - run["i2t_load"])[510:]
        assert np.all(short > 0.0)
        errors.append(short.max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(1.0, abs=0.2), errors


def test_the_peak_comes_back() -> None:
    """Down from a full load at I_c^2 while nothing flows: the time until all of the peak is there again."""
    values = _values({**HELD, **_FOLD, "drive.current_offset": 500.0})
    run = simulate(values, 3.0, 1e-3, model=MODEL, enable=lambda t: t < 1.5)
    load, limit = run["i2t_load"], run["current_limit"]
    budget = 3200.0 * 0.5 / 0.9
    begun = load[1500]
    assert begun == pytest.approx(1.0, abs=1e-3)
    assert load[1500:] == pytest.approx(np.maximum(begun - 400.0 / budget * (run["time"][1500:] - 1.5), 0.0), abs=1e-9)
    back = run["time"][1500 + np.flatnonzero(limit[1500:] >= 60.0)[0]]
    assert back - 1.5 == pytest.approx((begun - 0.9) * budget / 400.0, abs=1.1e-3)
    assert limit[-1] == 60.0


def test_a_pulse_within_the_budget_never_folds() -> None:
    _, run = _held(500.0, 0.49, 1e-3, _FOLD)
    assert np.all(run["current_limit"] == 60.0)
    assert run["i2t_load"][-1] == pytest.approx(0.9 * 0.49 / 0.5, rel=1e-3)


@pytest.mark.parametrize("continuous", [60.0, 200.0])
def test_without_reserve_there_is_no_i2t(continuous: float) -> None:
    _, run = _held(500.0, 0.3, 1e-3, {**_FOLD, "heat.peak_time": 0.05, "heat.continuous_current": continuous})
    assert np.all(run["current_limit"] == 60.0)
    assert np.all(run["i2t_load"] == 0.0)


@settings(derandomize=True, max_examples=100)
@given(demands=st.lists(st.floats(0.0, 500.0), min_size=1, max_size=40), continuous=st.floats(0.01, 60.0),
       h=st.floats(1e-5, 1e-3), each=st.integers(1, 50))
def test_the_load_never_passes_one(demands: list[float], continuous: float, h: float, each: int) -> None:
    """Where the current is what the drive asks for, however demands go; at the shortest peak time."""
    p = BASE.replace({"heat.continuous_current": continuous, "heat.peak_time": 0.05}).nested()
    load = 0.0
    for demand in (demand for demand in demands for _ in range(each)):
        limit = heat.current_limit(FLOATS, p, load)
        assert continuous * (1.0 - 1e-12) <= limit <= 60.0
        load = heat.loaded(FLOATS, p, load, min(demand, limit)**2, h)
        assert 0.0 <= load <= 1.0 + 1e-12


@pytest.mark.skipif(not compiled.available(MODEL), reason="no C compiler")
@settings(deadline=None, derandomize=True, max_examples=40)
@given(demands=st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-80.0, 80.0), st.integers(5, 60)), min_size=3,
                        max_size=8),
       peak_time=st.sampled_from([0.05, 0.2]), continuous=st.sampled_from([15.0, 30.0, 50.0]),
       model=st.sampled_from(["nonlinear", "elastic"]))
def test_never_above_the_limit(demands: list[Any], peak_time: float, continuous: float, model: str) -> None:
    commands, torques = (np.repeat([d[i] for d in demands], [d[2] for d in demands]) for i in (0, 1))
    v = _values({"heat.peak_time": peak_time, "heat.continuous_current": continuous}, f"{model}+heat")
    run = simulate(v, (len(commands) - 1) * 1e-3, model=f"{model}+heat", fin_command=commands, aero_torque=torques)
    limit, current, speed = run["current_limit"], np.abs(run["motor_current"]), np.abs(run["motor_speed"])
    assert np.all((limit >= continuous * (1.0 - 1e-12)) & (limit <= 60.0))
    # References of the last millisecond were no larger than the larger limit at its ends. The drive's loop has next
    # to no integral action: the back-EMF, R counted for nothing, drives it beyond while braking. Its integral is worth
    # 1e-3 A in these times, and the speed in the millisecond no more than 10 rad/s, 0.2 A, beyond those at its ends.
    braking = 0.11 * (np.maximum(speed[1:], speed[:-1]) + 10.0) / v["drive.kp"]
    assert np.all(current[1:] <= np.maximum(limit[1:], limit[:-1]) + braking)


# -- with and without -------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_without_coefficients_and_i2t_it_is_the_model(model: str) -> None:
    """Bit for bit; second-order has no current to be warm by."""
    values = _values({**NO_COEFFICIENTS, "heat.peak_time": 1e4}, f"{model}+heat")
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.2 if sin(20.0 * t) > 0.0 else -0.2,
                              "aero_torque": lambda t: 60.0 * sin(50.0 * t), "enable": lambda t: not 0.2 < t < 0.23}
    warm = simulate(values, 0.3, model=f"{model}+heat", **inputs)
    plain = simulate(_without(values), 0.3, model=model, **inputs)
    assert warm["winding_temperature"][-1] > 24.01
    for name, expected in plain.items():
        assert np.array_equal(warm[name], expected), name


@pytest.mark.skipif(not compiled.available(MODEL), reason="no C compiler")
@pytest.mark.parametrize("model", MODELS)
def test_kernels_agree(model: str) -> None:
    values = _values({"heat.peak_time": 0.05, "heat.continuous_current": 5.0, "heat.winding_start_rise": 30.0},
                     f"{model}+heat")
    inputs: dict[str, Any] = {"fin_command": lambda t: 0.3 if sin(30.0 * t) > 0.0 else -0.3, "aero_torque": -40.0,
                              "enable": lambda t: not 0.1 < t < 0.11}
    runs = [simulate(values, 0.2, 3.7e-4, kernel, f"{model}+heat", **inputs) for kernel in ("python", "compiled")]
    for name, expected in runs[0].items():
        assert np.array_equal(runs[1][name], expected), name


def test_the_models_without_it_are_untouched() -> None:
    assert "heat" not in program.source(model="nonlinear")


def test_second_order_is_refused() -> None:
    with pytest.raises(EmcasError, match=r"second-order\+heat: heat needs a motor current"):
        get("second-order+heat")


@pytest.mark.parametrize(("name", "value"), [
    ("heat.winding_capacity", 0.0), ("heat.case_to_ambient", -0.1), ("heat.torque_coefficient", 0.001),
    ("heat.resistance_coefficient", -0.004), ("heat.peak_time", 0.0), ("heat.continuous_current", float("nan")),
    ("heat.winding_start_rise", "80 degC"), ("heat.winding_to_case", "0.2 W/K"), ("heat.winding_limit", 1000.0)])
def test_bad_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        BASE.replace({name: value})


def test_units_of_files() -> None:
    given = BASE.replace({"heat.resistance_coefficient": "0.39 %/K", "heat.winding_capacity": "0.2 kJ/K",
                          "heat.winding_to_case": "200 mK/W", "heat.winding_limit": "266 degF"}).values
    assert given["heat.resistance_coefficient"] == 0.0039
    assert given["heat.winding_capacity"] == 200.0
    assert given["heat.winding_to_case"] == 0.2
    assert given["heat.winding_limit"] == pytest.approx(130.0)


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


@pytest.mark.fmu
@pytest.mark.parametrize(("model", "fins"), [("nonlinear", 1), ("elastic", 1), ("nonlinear", 2)])
def test_fmus(model: str, fins: int, tmp_path: Path) -> None:
    """Valid, with both back ends the same numbers in processes of their own, and warm."""
    parameters = load_parameters(model=f"{model}+heat")
    built = {"python": build(parameters, tmp_path / "python.fmu", fins=fins).path,
             "native": build(parameters, tmp_path / "native.fmu", "native", cc="gcc", fins=fins).path}
    found = []
    for name, path in built.items():
        written = tmp_path / f"{name}.txt"
        subprocess.run([sys.executable, "-c", _SIMULATE, str(path), str(fins), str(written)], check=True,
                       cwd=tmp_path)
        found.append(np.loadtxt(written))
    assert np.array_equal(found[0], found[1])
    *_, winding, _, load, limit = found[0][-1]
    assert winding > 24.1
    assert load > 0.9
    assert 5.0 * (1.0 - 1e-12) <= limit < 60.0
