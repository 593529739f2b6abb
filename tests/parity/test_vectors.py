"""Many actuators in vectors, of every width of this processor: the same bits as one by one."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import NAMES, NONLINEAR, get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import library
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.compiled import Array, parameter_row, run_tables
from tests.marks import others_slow
from tests.own_actuator.example import MODEL as DIRECT_DRIVE
from tests.tools.test_every_actuator import TOGETHER

WIDTHS = (4, 8)
# Parameters for branches of an extension that its default values do not reach.
FURTHER = {"nonlinear+inverter": {"inverter.dead_time": 2e-6, "inverter.pole_pairs": 4}}
# Only the default actuator is not slow: each of the others takes up to a minute to compile.
MODELS = others_slow((*NAMES, DIRECT_DRIVE, *TOGETHER, *FURTHER), lambda model: model == NONLINEAR)
SEEDS = st.integers(0, 2**32 - 1)
LARGEST = {"fin_command": 0.6, "aero_torque": 150.0}
STEPS = (1e-3, 1e-3, 1e-3, 3.3e-4, 5e-5, 2.7e-3, 0.0)  # s: whole samples, and points inside ticks


def widths(model: str) -> list[int]:
    """Return this processor's widths of vectors: all for the default actuator, the largest for others."""
    available = [width for width in WIDTHS if width <= library.loaded(model).actuator_lanes()]
    return available if model == NONLINEAR else available[-1:]


def varied(model: str, count: int, rng: np.random.Generator) -> Array:
    """Return valid parameters [count, parameters] that differ by 1 %, delays by up to 30 %."""
    chosen = load_parameters(model=model).with_values(FURTHER.get(model, {}))
    row, parameters = parameter_row(chosen.values, model), get(model).parameters
    sets = np.tile(row, (count, 1))
    for k, variable in enumerate(parameters):
        spread = 0.3 if "delay" in variable.name else 0.01
        if variable.kind == "Real" and rng.random() < 0.3:
            sets[:, k] *= rng.uniform(1.0 - spread, 1.0, count)
    trial = run_tables(sets, [np.float64(v.initial(chosen.values)) for v in get(model).inputs], 1e-3, [], model)
    sets[list(trial.failures)] = row
    return sets


def inputs(model: str, count: int, rng: np.random.Generator) -> dict[int, Any]:
    """Return random values of some of an actuator's inputs, by index: one number for all, or a value for each."""
    chosen: dict[int, Any] = {}
    for index, variable in enumerate(get(model).inputs):
        if rng.random() > (0.8 if variable.name in LARGEST else 0.15):
            continue
        size = None if rng.random() < 0.3 else count
        if variable.kind == "Boolean":
            chosen[index] = rng.random(size) < 0.8
        elif variable.kind == "Integer":
            chosen[index] = rng.integers(0, 3, size)
        else:
            start = variable.initial(load_parameters(model=model).values)
            chosen[index] = start + rng.uniform(-1.0, 1.0, size) * LARGEST.get(variable.name, 0.5 * abs(start) + 1.0)
    if rng.random() < 0.05:
        chosen[1] = np.where(rng.random(count) < 0.2, 1e300, 0.0)  # more than a step can compute
    return chosen


def bits(numbers: Array) -> Array:
    """Return the bits of numbers, in which 0 and -0 differ."""
    return np.ascontiguousarray(numbers).view(np.int64)


def run(batch: Batch, end: float, chosen: dict[int, Any]) -> str:
    """Run a batch to a time [s]; return the error message, or an empty text."""
    for index, value in chosen.items():
        batch.hold(index, value)
    try:
        batch.run(end)
    except ArithmeticError as error:
        return str(error)
    return ""


def new_batches(sets: Array, count: int, model: str = NONLINEAR) -> list[Batch]:
    """Return batches at their start: one computed one by one, one for every width of vectors."""
    batches = [Batch(sets, count, model, lanes=width) for width in (1, *widths(model))]
    for batch in batches:
        for index, variable in enumerate(get(model).inputs):
            batch.hold(index, float(variable.initial(load_parameters(model=model).values)))
    return batches


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(seed=SEEDS, count=st.integers(1, 21))
@example(seed=0, count=16)
def test_batches_of_vectors_agree_to_the_bit(model: str, seed: int, count: int) -> None:
    """Any parameters, inputs and steps: the same outputs, and errors of the same actuators."""
    rng = np.random.default_rng(seed)
    sets = varied(model, count, rng) if rng.random() < 0.8 else varied(model, 1, rng)
    batches = new_batches(sets, count, model)
    end = 0.0
    for _ in range(60):
        end += rng.choice(STEPS)
        chosen = inputs(model, count, rng)
        errors = [run(batch, end, chosen) for batch in batches]
        assert len(set(errors)) == 1, errors
        for batch in batches[1:]:
            np.testing.assert_array_equal(bits(batch.outputs), bits(batches[0].outputs))


def test_outputs_stay_in_order_if_schedules_differ() -> None:
    """Vectors group actuators with equal delays: here the first with the third."""
    sets = np.tile(parameter_row(load_parameters().values), (4, 1))
    sets[:, [v.name for v in get(NONLINEAR).parameters].index("drive.transport_delay")] = (0.002, 0.0031, 0.002, 0.0031)
    batches = new_batches(sets, 4)
    for batch in batches:
        batch.hold(0, np.array([0.1, 0.2, 0.3, 0.4]))
        batch.run(0.05)
        np.testing.assert_array_equal(batch.outputs, batches[0].outputs)


def test_failing_actuators_do_not_disturb_their_neighbours() -> None:
    """The first, a middle and the last actuator fail for several steps, in full and partly filled vectors."""
    count, failing = 19, [0, 10, 18]
    torque = np.zeros(count)
    torque[failing] = 1e300
    batches = new_batches(parameter_row(load_parameters().values)[np.newaxis], count)
    for batch in batches:
        batch.hold(0, np.linspace(0.05, 0.3, count))
        batch.run(0.005)
        before = batch.outputs[:, failing].copy()
        batch.hold(1, torque)
        for k in range(3):
            with pytest.raises(ArithmeticError, match="actuators 0, 10, 18: "):
                batch.run(0.01 + k * 1e-3)
        np.testing.assert_array_equal(batch.outputs[:, failing], before)
        reached = batch.outputs[0].copy()
        batch.hold(1, 0.0)
        batch.run(0.02)
        assert (batch.outputs[0] != reached).all()
        np.testing.assert_array_equal(batch.outputs, batches[0].outputs)


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=4, suppress_health_check=list(HealthCheck))
@given(seed=SEEDS, count=st.integers(2, 21))
def test_runs_in_vectors_agree_to_the_bit(model: str, seed: int, count: int) -> None:
    """Runs that fail, or whose parameters are refused, do not change the others."""
    rng = np.random.default_rng(seed)
    sets, rows = varied(model, count, rng), 40
    starts = [float(v.initial(load_parameters(model=model).values)) for v in get(model).inputs]
    columns: list[Array] = [np.array(start) for start in starts]
    for index, value in inputs(model, count, rng).items():
        columns[index] = np.asarray(value, dtype=float) if np.ndim(value) == 0 else np.multiply.outer(
            value, np.ones(rows))
    columns[0] = np.cumsum(rng.uniform(-0.02, 0.02, (count, rows)), axis=1)
    if rng.random() < 0.5:
        sets[rng.integers(count), 0] = np.nan
        columns[1] = np.where(rng.random((count, rows)) < 0.002, rng.choice([np.nan, 1e300]), 10.0)
    outputs = [v.name for v in get(model).outputs]
    tables = []
    for width in (1, *widths(model)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("emcas_fmu.runtime.compiled.vectors",
                          lambda name, _, width=width: library.vectors(name, library.WORTH_VECTORS, width))
            tables.append(run_tables(sets, columns, 2e-4, outputs, model, held=5, fine=outputs[:2]))
    for table in tables[1:]:
        np.testing.assert_array_equal(table.reached, tables[0].reached)
        assert {k: str(e) for k, e in table.failures.items()} == {k: str(e) for k, e in tables[0].failures.items()}
        for name, column in table.columns.items():
            np.testing.assert_array_equal(column, tables[0].columns[name], err_msg=name)


def test_vectors_are_compiled_only_for_many_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vectors that are compiled already are also used for a few steps."""
    monkeypatch.setattr(library, "_steps", defaultdict(float))  # without the steps of other tests
    (model, width), = [(NONLINEAR, w) for w in widths(NONLINEAR)[:1]] or pytest.skip("no vectors on this processor")
    assert library.vectors(model, library.WORTH_VECTORS, width) is not None
    assert library.vectors(model, 1, width) is not None
    assert library.vectors("second-order", 1, width) is None
    assert library.vectors(model, library.WORTH_VECTORS, 1) is None
    with pytest.raises(ValueError, match="16 actuators in a vector"):
        library.vectors(model, library.WORTH_VECTORS, 16)
    row = parameter_row(load_parameters().values)[np.newaxis]
    lanes = library.loaded(NONLINEAR).actuator_lanes()
    assert Batch(row, 200)._groups == -(-200 // lanes)  # by default
