"""The direct drive against its own independent integration, and the stepper that smooth equations get."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, exp, log
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.namespace import Record
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.cases import Case
from emcas_fmu.reference.files import cases, simulator
from emcas_fmu.simulation import simulate
from emcas_fmu.steppers.discontinuities import System
from emcas_fmu.steppers.smooth import solve
from tests.marks import slow

from .example import FILE, MODEL, changed

PARAMETERS = load_parameters(model=MODEL)
CASES = {case.name: case for case in cases(PARAMETERS.model, PARAMETERS.values)}


def largest_error(case: Case, tick: float) -> float:
    """Of the fin angle [deg], with ticks of that length [s]."""
    inputs, values = case.inputs(), PARAMETERS.with_values({"solver.max_tick": tick, **case.overrides}).values
    signals: dict[str, Any] = {v.name: inputs[v.name] for v in get(MODEL).inputs if v.name in inputs}
    response = simulate(values, float(inputs["time"][-1]), case.step, model=MODEL, **signals)
    reference = simulator(MODEL)(values, inputs)
    return degrees(float(np.max(np.abs(response["fin_angle"] - reference["fin_angle"]))))


@pytest.mark.parametrize("name", ["load_opposing", *slow("step", "sag")])
def test_against_its_independent_integration(name: str) -> None:
    """At its default tick of 0.1 ms, a tenth of L/R; measured up to 9e-5 deg."""
    assert largest_error(CASES[name], 1e-4) < 2e-4


def test_second_order() -> None:
    """The slope of the error over the tick, whole parts of the sample time; measured 2.00."""
    coarse, fine = (largest_error(CASES["step_plus5"], tick) for tick in (2e-4, 5e-5))
    assert 1.95 < log(coarse / fine) / log(4.0) < 2.05


def test_a_case_of_another_actuator_is_left_out() -> None:
    """It has no friction that depends on temperature."""
    assert "cold" not in CASES
    assert all(not case.overrides for case in CASES.values())  # it has no encoder either


def test_a_file_under_120_lines() -> None:
    assert len(FILE.read_text(encoding="utf-8").splitlines()) < 120


def _fast(rate: float, discontinuities: tuple[Any, ...] = ()) -> Any:
    def derivatives(ops: Any, p: Any, x: Record, u: Record) -> Mapping[str, Any]:
        return {"fin_angle": x.fin_rate, "fin_rate": -rate * x.fin_rate}

    return System(derivatives, discontinuities, ("fin_angle", "fin_rate")).step


@given(st.floats(0.0, 12.0))
def test_a_mode_however_fast_is_damped(decades: float) -> None:
    """L-stable: a step of 1 ms never amplifies, and forgets what decays far within it."""
    rate = 10.0**decades
    moved, used = _fast(rate)(FLOATS, None, Record(fin_angle=0.0, fin_rate=1.0), Record(), 1e-3)
    assert used == 1e-3
    assert abs(moved["fin_rate"]) <= 1.0
    # Of the stability function, (1 - 2 g) z/(1 - g z)^2 and smaller terms, 4.83/(h rate) is left of a fast mode.
    assert abs(moved["fin_rate"] - exp(-rate * 1e-3)) < max(4.9 / max(rate * 1e-3, 1.0), 1e-6)


@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12))
def test_elimination(entries: list[float]) -> None:
    """Of rows whose diagonal outweighs the rest, which needs no pivots; NumPy's solution to rounding."""
    matrix = np.reshape(entries[:9], (3, 3)) + 4.0 * np.eye(3)
    found = solve(matrix.tolist(), entries[9:])
    assert np.allclose(found, np.linalg.solve(matrix, entries[9:]), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", ["t7", "int", "sin", "p", *slow("p1", "c3", "r0", "t7_", "out", "self", "float")])
def test_a_state_may_have_any_name(tmp_path: Path, name: str) -> None:
    """Names of temporaries and of words of Python and C: the same bits in both back ends as with another name."""
    renamed = changed(tmp_path, ('State("current"', f'State("{name}"'), ("x.current", f"x.{name}"),
                      ('"current": rise', f'"{name}": rise'))
    model, values = str(renamed), load_parameters(model=MODEL).values
    expected = simulate(values, 0.05, model=MODEL, fin_command=0.1, kernel="python")["fin_angle"]
    for kernel in ("python", "compiled"):
        angle = simulate(values, 0.05, model=model, fin_command=0.1, kernel=kernel)["fin_angle"]
        assert np.array_equal(angle, expected)
