"""Limits of the runtime: stored states, times, parameters of batches, and progress."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.runtime import batch as batches
from emcas_fmu.runtime import codegen
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.runtime.core import LATEST

MODELS = ("nonlinear", "second-order", "electrohydraulic")


def at_rest(model: str, **changes: Any) -> tuple[Any, tuple[Any, ...], Mapping[str, Any]]:
    """Return a core, the core's inputs at rest, and the values of the parameters."""
    p = load_parameters(model=model).with_values(changes)
    core = codegen.core(p.values, model)
    row = [v.initial(p.values) for v in p.actuator.inputs]
    return core, codegen.core_inputs(core, row, p.actuator), p.values


@pytest.mark.parametrize("model", MODELS)
def test_stored_state_with_an_impossible_time_is_refused(model: str) -> None:
    """The state's time is in the sample period in which it was stored, within the slack of communication points."""
    core, inputs, _ = at_rest(model)
    start, slack, period = core.state, core.slack, core.schedule[0]
    fresh = codegen.core(load_parameters(model=model).values, model)

    def error(now: float, periods: Any = 0, tick: Any = 0, **other: Any) -> str:
        return str(fresh.unsound((periods, tick, *start[2:7], other.get("part"), start[8]), now, inputs))

    now: float
    periods: Any
    for now, periods in ((0.0, 0), (-0.99 * slack, 0), (period + 0.99 * slack, 0), (period, 1), (7.0 * period, 7)):
        assert error(now, periods) == ""
    for now, periods in ((-1.01 * slack, 0), (period + 1.01 * slack, 0), (0.0, -1), (0.0, 1), (0.0, 0.0), (0.0, True)):
        assert error(now, periods) == "impossible position in time"
    ticks = core.schedule[2]
    assert [error(0.0, tick=k) for k in (-1, 0, ticks - 1, ticks, 0.0)] == [
        "impossible position in time", "", "", "impossible position in time", "impossible position in time"]
    before, (h_before, h_after) = core.schedule[1], core.schedule[4:6]
    no_loads = (0.0,) * (core._supply - 1)
    for tick, h in ((0, h_before if before else h_after), (ticks - 1, h_after)):
        for origin, covered, valid in ((0.0, 0.0, True), (0.0, h, True), (h, h, True), (0.5 * h, 0.4 * h, False),
                                       (-1e-9 * h, h, False), (0.0, 1.000001 * h, False)):
            assert (error(0.0, tick=tick, part=(origin, covered, inputs, no_loads)) == "") == valid
    assert error(0.0, part=(0.0, 0.0, inputs, no_loads[1:])) == "impossible part of a tick"
    assert fresh.unsound(start[:-1], 0.0, inputs) == fresh.unsound(list(start), 0.0, inputs) == "wrong number of values"
    for bad in (np.nan, np.inf, "0", None):
        for index in (2, 3, 4, 5, 8):
            if start[index]:
                state = (*start[:index], (*start[index][:-1], bad), *start[index + 1:])
                assert fresh.unsound(state, 0.0, inputs) == "a number is not finite"


@pytest.mark.parametrize("model", MODELS)
def test_restored_state_continues_identically(model: str) -> None:
    """From any time and after other calls, to the bit."""
    core, inputs, values = at_rest(model)
    inputs, other = (0.1, *inputs[1:]), (-0.2, 30.0, *inputs[2:])
    for now in (0.3e-3, 1.0e-3, 1.9e-3, 5.0e-3, 5.01e-3, 7.77e-3):
        core.run(now, inputs)
        stored = core.state
        assert codegen.core(values, model).unsound(stored, now, inputs) == ""
        ahead = core.run(now + 2.3e-3, inputs)
        core.state = stored
        assert core.run(now + 1.1e-3, other) != ahead
        core.state = stored
        assert core.run(now + 2.3e-3, inputs) == ahead
        core.state = stored


def _line(model: str, resistance: float, update_time: float) -> tuple[float, ...]:
    """Return the parameters of the line that supplies several fins; the first one is the resistance."""
    supply = get(model).supply
    assert supply is not None
    values = dict(supply.line.values)
    values[next(iter(values))] = resistance
    return tuple(update_time if name.endswith("update_time") else value for name, value in values.items())


@pytest.mark.parametrize("model", MODELS)
def test_corrupt_state_of_several_fins_is_refused(model: str) -> None:
    values = load_parameters(model=model).values
    supply = get(model).supply
    line = () if supply is None else _line(model, 0.02, 1e-3)
    fins = codegen.multi_fin([values] * 2, line, model)
    row = [v.initial(values) for v in get(model).inputs]
    inputs = [codegen.core_inputs(core, row, get(model)) for core in fins.cores]
    of_line, currents, instant, states = fins.state
    assert fins.unsound(fins.state, 0.0, inputs[0]) == ""
    impossible = "impossible state of the supply's line", "impossible time of the supply's line"
    for state, message in (((of_line, currents, instant), "wrong number of values"),
                           ([of_line, currents, instant, states], "wrong number of values"),
                           ((of_line, currents, instant, states[:1]), "wrong number of fins"),
                           ((of_line, currents, instant, (states[0], states[1][:-1])), "wrong number of values"),
                           ((np.nan, currents, instant, states), impossible[0]),
                           ((of_line, (*currents[:-1], np.nan), instant, states), impossible[0]),
                           ((of_line, currents, 0, states), impossible[1]),
                           ((of_line, currents, 1.0, states), impossible[1])):
        assert fins.unsound(state, 0.0, inputs[0]) == message
    if line:  # the next instant is at most one interval ahead, and never in the past
        period = fins.cores[0].schedule[0]
        for now, index, valid in ((0.0, 1, True), (0.0, 2, False), (-0.9e-9, 1, True), (-1.1e-9, 1, False),
                                  (0.5 * period, 1, period <= 2e-3)):
            state = (of_line, currents, index, tuple(core.state for core in fins.cores))
            assert (fins.unsound(state, now, inputs[0]) == "") == valid
    assert fins.slack == min(core.slack for core in fins.cores)


def test_shortest_tick_of_several_fins_limits_all() -> None:
    """Slack and latest time are those of the fin with the shortest tick, whether it is the first or the last."""
    coarse = load_parameters()
    fine = coarse.with_values({"solver.max_tick": 0.4 * coarse.values["solver.max_tick"]})
    # The shortest tick may be before the arrival of a reference, or after it.
    early = coarse.with_values({"drive.transport_delay": 0.1 * coarse.values["controller.sample_time"]})
    alone = [codegen.core(p.values) for p in (coarse, fine, early)]
    assert alone[1].latest < alone[0].latest
    assert alone[2].schedule[4] < alone[2].schedule[5]
    assert alone[0].schedule[4] > alone[0].schedule[5]
    for core in alone:
        assert core.latest == LATEST * min(core.schedule[4], core.schedule[5])
        assert core.slack <= 0.25 * min(core.schedule[4], core.schedule[5])
    for sets in ((coarse, fine), (fine, coarse)):
        fins = codegen.multi_fin([p.values for p in sets], _line("nonlinear", 0.0, 1e-4))
        assert (fins.slack, fins.latest) == (min(c.slack for c in alone[:2]), alone[1].latest)


@pytest.mark.kernel
@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.parametrize("index", [0, 3, 4, 10])
def test_refused_actuator_of_a_batch_is_named(index: int, lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With its value; the first and last actuator, and those beside the limit of a chunk."""
    monkeypatch.setattr(batches, "_CHUNK", 4)
    p = load_parameters(model="second-order")
    names = [v.name for v in p.actuator.parameters]
    sets = np.tile(parameter_row(p.values, "second-order"), (11, 1))
    sets[:, names.index("fin.stop_angle")] += np.arange(11) * 1e-3
    sets[index, names.index("controller.sample_time")] = -7.0 - index
    with pytest.raises(ParameterError, match=rf"actuator {index}: controller\.sample_time = -{7 + index}\b"):
        batches.Batch(sets, 11, "second-order", lanes=lanes)
    with pytest.raises(ParameterError, match=rf"actuator 0: controller\.sample_time = -{7 + index}\b"):
        batches.Batch(sets[index:index + 1], 5, "second-order", lanes=lanes)
    with pytest.raises(ValueError, match="3 actuators in a vector: only 1, 4 and 8"):
        batches.Batch(sets, 11, "second-order", lanes=3)


@pytest.mark.kernel
@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.parametrize("count", [1, 7, 64])
def test_progress_rises_to_its_total(count: int, lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "_CHUNK", 16)
    p = load_parameters(model="second-order")
    sets = np.tile(parameter_row(p.values, "second-order"), (count, 1))
    sets[:, [v.name for v in p.actuator.parameters].index("fin.stop_angle")] += np.arange(count) * 1e-3
    prepared, moved = list[tuple[str, int, int]](), list[tuple[str, int, int]]()
    batch = batches.Batch(sets, count, "second-order", progress=lambda *of: prepared.append(of), lanes=lanes)
    batch.run(2e-3, lambda *of: moved.append(of))
    for calls in (prepared, moved):
        steps, totals = [done for _, done, _ in calls], {total for *_, total in calls}
        assert len(totals) == 1
        assert min(steps) > 0
        assert steps == sorted(steps)
        assert steps[-1] == max(totals)
    assert batch.moved
