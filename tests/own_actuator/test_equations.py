"""The direct drive against its independent integration, and the stepper of smooth equations."""

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
from emcas_fmu.reference.cases import ReferenceCase
from emcas_fmu.reference.files import cases, simulator
from emcas_fmu.simulation import simulate
from emcas_fmu.steppers.discontinuities import System
from emcas_fmu.steppers.smooth import solve
from tests.marks import slow

from .example import FILE, MODEL, changed

PARAMETERS = load_parameters(model=MODEL)
CASES = {case.name: case for case in cases(PARAMETERS.model, PARAMETERS.values)}


def largest_error(case: ReferenceCase, tick: float) -> float:
    """Return the largest error of the fin angle [deg] with a tick [s]."""
    inputs, values = case.inputs(), PARAMETERS.with_values({"solver.max_tick": tick, **case.overrides}).values
    signals: dict[str, Any] = {v.name: inputs[v.name] for v in get(MODEL).inputs if v.name in inputs}
    response = simulate(values, float(inputs["time"][-1]), case.step, model=MODEL, **signals)
    reference = simulator(MODEL)(values, inputs)
    return degrees(float(np.max(np.abs(response["fin_angle"] - reference["fin_angle"]))))


@pytest.mark.parametrize("name", ["load_opposing", *slow("step", "sag")])
def test_against_its_independent_integration(name: str) -> None:
    """At the default tick of 0.1 ms, a tenth of L/R, up to 9e-5 deg are measured."""
    assert largest_error(CASES[name], 1e-4) < 2e-4


def test_second_order_convergence() -> None:
    """The order is that of ticks that divide the sample time; 2.00 measured."""
    coarse, fine = (largest_error(CASES["step_plus5"], tick) for tick in (2e-4, 5e-5))
    assert 1.95 < log(coarse / fine) / log(4.0) < 2.05


def test_cases_that_do_not_apply_are_left_out() -> None:
    """The direct drive has neither friction that depends on temperature nor an encoder."""
    assert "cold" not in CASES
    assert all(not case.overrides for case in CASES.values())


def test_example_has_less_than_120_lines() -> None:
    assert len(FILE.read_text(encoding="utf-8").splitlines()) < 120


def _damped(rate: float) -> Any:
    """Return the step of a system whose fin rate decays with a rate [1/s]."""
    def derivatives(ops: Any, p: Any, x: Record, u: Record) -> Mapping[str, Any]:
        return {"fin_angle": x.fin_rate, "fin_rate": -rate * x.fin_rate}

    return System(derivatives, (), ("fin_angle", "fin_rate")).step


@given(st.floats(0.0, 12.0))
def test_a_mode_of_any_rate_is_damped(decades: float) -> None:
    """The stepper is L-stable: a step of 1 ms never amplifies a mode, and a fast mode vanishes."""
    rate = 10.0**decades
    states, used = _damped(rate)(FLOATS, None, Record(fin_angle=0.0, fin_rate=1.0), Record(), 1e-3)
    assert used == 1e-3
    assert abs(states["fin_rate"]) <= 1.0
    # The stability function, with the leading term (1 - 2 g) z/(1 - g z)^2, tends to 4.83/(h rate) for fast modes.
    assert abs(states["fin_rate"] - exp(-rate * 1e-3)) < max(4.9 / max(rate * 1e-3, 1.0), 1e-6)


@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12))
def test_linear_equations_are_solved_to_rounding(entries: list[float]) -> None:
    """Matrices with a dominant diagonal need no pivots."""
    matrix = np.reshape(entries[:9], (3, 3)) + 4.0 * np.eye(3)
    found = solve(matrix.tolist(), entries[9:])
    assert np.allclose(found, np.linalg.solve(matrix, entries[9:]), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", ["t7", "int", "sin", "p", *slow("p1", "c3", "r0", "t7_", "out", "self", "float")])
def test_a_state_may_have_any_name(tmp_path: Path, name: str) -> None:
    """Names of temporaries and keywords of Python or C do not change a bit in either kernel."""
    renamed = changed(tmp_path, ('State("current"', f'State("{name}"'), ("x.current", f"x.{name}"),
                      ('"current": rise', f'"{name}": rise'))
    model, values = str(renamed), load_parameters(model=MODEL).values
    expected = simulate(values, 0.05, model=MODEL, fin_command=0.1, kernel="python")["fin_angle"]
    for kernel in ("python", "compiled"):
        angle = simulate(values, 0.05, model=model, fin_command=0.1, kernel=kernel)["fin_angle"]
        assert np.array_equal(angle, expected)
