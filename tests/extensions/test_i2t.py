"""The drive's I2t limit against closed forms; no inputs exceed it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import heat
from emcas_fmu.simulation import simulate
from tests.runs import assert_equal

from .held import BLOCKED_FAST, MODEL, NO_COEFFICIENTS, blocked_run, values_of

BASE = load_parameters(model=MODEL)
_FAULTY = f"{MODEL}+faults"
_EARLY_LIMIT = {**NO_COEFFICIENTS, "heat.peak_time": 0.5, "heat.continuous_current": 20.0}


def test_time_at_peak_and_folding_back_are_closed_forms() -> None:
    """Under a large demand the peak current flows for its time; then i^2 falls exponentially to the continuous one."""
    _, run = blocked_run(500.0, 1.2, 1e-4, _EARLY_LIMIT)
    share = (1e3 / (1e3 + 0.25))**2  # i^2 over the square of its reference
    reserve, continuous, budget = 3200.0, 400.0, 3200.0 * 0.5 / 0.9
    full = 0.9 * budget / (share * 3600.0 - continuous)
    assert full == pytest.approx(0.5, rel=1e-3)
    limit, time = run["current_limit"], run["time"]
    folds = time[np.flatnonzero(limit < 60.0)[0]]
    assert folds == pytest.approx(full, abs=1.5e-4)  # rows are 1e-4 s apart
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
    """A longer tick computes less heat, and so less load; the error is of first order."""
    _, fine = blocked_run(500.0, 0.6, 1e-3, {**_EARLY_LIMIT, "solver.max_tick": 1e-6})
    errors = []
    for tick in (5e-4, 2.5e-4, 1.25e-4):
        _, run = blocked_run(500.0, 0.6, 1e-3, {**_EARLY_LIMIT, "solver.max_tick": tick, "drive.transport_delay": 0.0})
        missing = (fine["i2t_load"] - run["i2t_load"])[510:]
        assert np.all(missing > 0.0)
        errors.append(missing.max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(1.0, abs=0.2), errors


def test_the_peak_current_recovers_without_current() -> None:
    """The load falls at the rate I_c^2 from 1, and below 0.9 the limit is the peak current again."""
    values = values_of({**BLOCKED_FAST, **_EARLY_LIMIT, "drive.current_offset": 500.0})
    run = simulate(values, 3.0, 1e-3, model=MODEL, enable=lambda t: t < 1.5)
    load, limit = run["i2t_load"], run["current_limit"]
    budget = 3200.0 * 0.5 / 0.9
    start = load[1500]
    assert start == pytest.approx(1.0, abs=1e-3)
    assert load[1500:] == pytest.approx(np.maximum(start - 400.0 / budget * (run["time"][1500:] - 1.5), 0.0), abs=1e-9)
    recovery = run["time"][1500 + np.flatnonzero(limit[1500:] >= 60.0)[0]] - 1.5
    assert recovery == pytest.approx((start - 0.9) * budget / 400.0, abs=1.1e-3)
    assert limit[-1] == 60.0


def test_a_pulse_within_the_budget_is_not_limited() -> None:
    _, run = blocked_run(500.0, 0.49, 1e-3, _EARLY_LIMIT)
    assert np.all(run["current_limit"] == 60.0)
    assert run["i2t_load"][-1] == pytest.approx(0.9 * 0.49 / 0.5, rel=1e-3)


@pytest.mark.parametrize("continuous", [60.0, 200.0])
def test_a_continuous_current_of_at_least_the_peak_is_not_limited(continuous: float) -> None:
    _, run = blocked_run(500.0, 0.3, 1e-3,
                         {**_EARLY_LIMIT, "heat.peak_time": 0.05, "heat.continuous_current": continuous})
    assert np.all(run["current_limit"] == 60.0)
    assert np.all(run["i2t_load"] == 0.0)


def _derated(share: float, begin: float, end: float, stop: float, **more: Any) -> Any:
    """Return a run of a blocked motor with a reference of 500 A, its drive derated from `begin` to `end` [s]."""
    values = values_of(BLOCKED_FAST, _EARLY_LIMIT, {
        "drive.current_offset": 500.0, "fault.current_derating.share": share, "fault.current_derating.begin": begin,
        "fault.current_derating.end": end}, model=_FAULTY)
    return simulate(values, stop, 1e-3, model=_FAULTY, **more)


@pytest.mark.parametrize("share", [0.3, 0.0])
def test_the_load_of_a_derated_drive_falls_slowly(share: float) -> None:
    """At 18 A or 0 A, below the continuous 20 A, the load falls by its equation; no peak current flows afterwards."""
    run = _derated(share, 0.6, 0.7, 0.9)
    load, limit = run["i2t_load"], run["current_limit"]
    derated = (run["time"] > 0.6) & (run["time"] < 0.7)
    assert np.all(limit[derated] == share * 60.0)
    assert np.all(np.abs(run["motor_current"][derated][1:]) <= share * 60.0)
    budget = 3200.0 * 0.5 / 0.9
    falls = -np.diff(load)
    assert np.all(falls <= 400.0 / budget * 1e-3 + 1e-12)
    # The current is less than its reference by R/(R + kp); the fault begins and ends with a sample of 1 ms.
    expected = (400.0 - (share * 60.0 * 1e3 / (1e3 + 0.25))**2) / budget
    assert falls[derated[1:]][2:].sum() == pytest.approx(expected * 1e-3 * (derated.sum() - 2), rel=1e-6)
    # 0.1 s without current recover 0.0225 of the budget; 45 A would need 0.051.
    assert load[run["time"] > 0.6].min() > 1.0 - 0.051
    assert limit[run["time"] > 0.7].max() < 45.0


def test_a_derated_drive_is_limited_when_a_sound_one_is() -> None:
    """A drive derated to 30 A and a sound one with a reference of 30 A have the same load and are limited together."""
    _, sound = blocked_run(30.0, 4.0, 1e-3, _EARLY_LIMIT)
    derated_run = _derated(0.5, 0.0, 1e9, 4.0)
    # The limit is 30 A where 500/3200 of the last tenth of the budget are left.
    budget, flowing = 3200.0 * 0.5 / 0.9, 30.0 * 1e3 / (1e3 + 0.25)
    expected = (1.0 - 0.1 * 500.0 / 3200.0) * budget / (flowing**2 - 400.0)
    limited, derated_limited = (run["time"][np.flatnonzero(run["current_limit"] < 30.0)[0]]
                                for run in (sound, derated_run))
    assert limited == pytest.approx(expected, abs=1.5e-3)  # a row of 1 ms and ticks of 0.7 ms
    assert derated_limited == pytest.approx(limited, abs=1.5e-3)  # a row and a tick
    before = (derated_run["time"] > 0.0) & (derated_run["time"] < limited - 2e-3)
    assert np.all(derated_run["current_limit"][before] == 30.0)
    # The fault begins with the first sample: until then 60 A may flow, 1 ms at most.
    assert derated_run["i2t_load"][before] == pytest.approx(sound["i2t_load"][before], abs=2e-3)


@pytest.mark.kernel(_FAULTY)
def test_kernels_agree_on_a_derated_drive() -> None:
    python, compiled = (_derated(0.5, 0.6, 0.7, 0.8, kernel=kernel) for kernel in ("python", "compiled"))
    assert_equal(compiled, python)


@settings(derandomize=True, max_examples=50)
@given(demands=st.lists(st.floats(0.0, 500.0), min_size=1, max_size=40), continuous=st.floats(0.01, 60.0),
       h=st.floats(1e-5, 1e-3), each=st.integers(1, 50))
def test_the_load_never_passes_one(demands: list[float], continuous: float, h: float, each: int) -> None:
    """For any demands, if the current follows its reference at once; at the shortest peak time."""
    p = BASE.with_values({"heat.continuous_current": continuous, "heat.peak_time": 0.05}).nested()
    load = 0.0
    for demand in (demand for demand in demands for _ in range(each)):
        limit = heat.current_limit(FLOATS, p, load)
        assert continuous * (1.0 - 1e-12) <= limit <= 60.0
        load = heat.loaded(FLOATS, p, load, min(demand, limit)**2, h)
        assert 0.0 <= load <= 1.0 + 1e-12


@pytest.mark.kernel(MODEL)
@settings(derandomize=True, max_examples=20)
@given(demands=st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-80.0, 80.0), st.integers(5, 60)), min_size=3,
                        max_size=8), peak_time=st.sampled_from([0.05, 0.2]),
       continuous=st.sampled_from([15.0, 30.0, 50.0]), model=st.sampled_from(["nonlinear", "elastic"]))
def test_the_current_is_within_its_limit(demands: list[Any], peak_time: float, continuous: float, model: str) -> None:
    commands, torques = (np.repeat([d[i] for d in demands], [d[2] for d in demands]) for i in (0, 1))
    v = values_of({"heat.peak_time": peak_time, "heat.continuous_current": continuous}, model=f"{model}+heat")
    run = simulate(v, (len(commands) - 1) * 1e-3, model=f"{model}+heat", fin_command=commands, aero_torque=torques)
    limit, current, speed = run["current_limit"], np.abs(run["motor_current"]), np.abs(run["motor_speed"])
    assert np.all((limit >= continuous * (1.0 - 1e-12)) & (limit <= 60.0))
    # References of the last millisecond are at most the larger limit at its ends. While braking the back-EMF drives the
    # current beyond its reference, by K w/K_p without R. The loop's integral adds 1e-3 A in these times. The speed
    # within a millisecond is at most 10 rad/s, 0.2 A, beyond those at its ends.
    braking = 0.11 * (np.maximum(speed[1:], speed[:-1]) + 10.0) / v["drive.kp"]
    assert np.all(current[1:] <= np.maximum(limit[1:], limit[:-1]) + braking)
