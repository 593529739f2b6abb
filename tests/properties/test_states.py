"""Stored states of the Python unit with the right checksum and a value that was made up."""

from __future__ import annotations

import json
import signal
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import isfinite
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import load_parameters
from tests.marks import slow

from ..fmu.built import slave_class

STEP, STEPS = 0.7e-3, 20  # no multiple of a tick: the state is taken inside one
PATIENCE = 10  # s, of a restore and two steps, which take milliseconds
UNITS = (FmuInterface(1), FmuInterface(2))

_numbers = st.one_of(st.floats(), st.integers(), st.sampled_from(
    [1e300, -1e300, 1e19, 5e-324, 10**400, 2**53, 2**63, -1, 0, 1, 0.5, 50, True, float("nan"), float("inf")]))
_texts = st.one_of(st.text(st.characters(), max_size=5), st.sampled_from(
    ["\ud800", "\0", "%n%n", "instantiated", "initialization", "running", "terminated"]))
_values = st.recursive(st.one_of(st.none(), st.booleans(), _numbers, _texts), lambda inner: st.one_of(
    st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=2)), max_leaves=8)


def _started(unit: FmuInterface, values: Mapping[str, Any]) -> Any:
    made = slave_class(unit, [values] * unit.fins)(instance_name="fin")
    made.setup_experiment(0.0)
    made.enter_initialization_mode()
    made.exit_initialization_mode()
    command = next(i for i, row in enumerate(made.rows) if row[0].endswith("fin_command"))
    made.set_real([command], [0.2])
    for k in range(STEPS):
        assert made.do_step(k * STEP, STEP)
    return made


def _stored(unit: type[Slave], state: Any) -> Any:
    body = json.dumps(state).encode()
    return unit._fmu_state_from_bytes(f"{unit.fmu_guid} {zlib.crc32(body):08x} ".encode() + body)


@contextmanager
def _in_time() -> Iterator[None]:
    """Fail where it takes too long; the unit discards a step that is interrupted, so the alarm is looked at after."""
    late: list[int] = []

    def ring(number: int, _: object) -> None:
        late.append(number)
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        assert not late, f"over {PATIENCE} s"


def _put(state: Any, path: list[float], value: Any) -> Any:
    """Replace what a path of shares of the lists' lengths leads to; a long list's places are as likely as a short's."""
    share, *rest = path
    at = min(int(share * len(state)), len(state) - 1)
    state[at] = _put(state[at], rest, value) if rest and isinstance(state[at], list) and state[at] else value
    return state


def _at(*places: int) -> list[float]:
    """Return the path to places in the nine values of a state, and in the nine of its core."""
    return [(place + 0.5) / 9 for place in places]


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="a loop that does not end is stopped by an alarm")
@pytest.mark.parametrize("unit", [UNITS[0], *slow(*UNITS[1:])], ids=["one", "two fins"])
@settings(derandomize=True, max_examples=75, suppress_health_check=[HealthCheck.too_slow])
@given(changes=st.lists(st.tuples(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4), _values), min_size=1,
                        max_size=2))
@example(changes=[(_at(3), "\ud800")])
@example(changes=[(_at(4), "\ud800")])
@example(changes=[(_at(8, 0), 1e300)])
@example(changes=[(_at(8, 1), 1e300)])
@example(changes=[(_at(8, 1), -1e300)])
@example(changes=[(_at(8, 1), 0.5)])
@example(changes=[(_at(8, 0), -(10**9))])
@example(changes=[(_at(1), 1e12), (_at(8, 0), 10**15)])
def test_a_made_up_state_is_refused_or_does_no_harm(unit: FmuInterface, changes: Any) -> None:
    """Refused: nothing is changed. Else the next step ends, and its outputs are finite or it is discarded."""
    slave = _started(unit, load_parameters().values)
    state = json.loads(json.dumps(slave._get_fmu_state()))
    for path, value in changes:
        state = _put(state, path, value)
    before, said = slave._get_fmu_state(), len(slave.log_queue)
    with _in_time():
        slave._set_fmu_state(_stored(type(slave), state))
        after = slave._get_fmu_state()
        if len(slave.log_queue) > said:
            assert slave.log_queue[-1].msg.startswith("FMU state refused: ")
            assert after[:3] + after[4:] == before[:3] + before[4:]  # but for why the next step is discarded
            assert not slave.do_step(STEPS * STEP, STEP)
            assert slave.do_step(STEPS * STEP, STEP)
        elif slave.do_step(after[0] + after[1], STEP):
            outputs = [row for row in slave.outputs if slave.rows[row][1] == "Real"]
            assert all(map(isfinite, slave.get_real(outputs)))
    for message in slave.log_queue:
        message.msg.encode()


@pytest.mark.parametrize("unit", UNITS, ids=["one", "two fins"])
def test_what_was_stored_goes_on(unit: FmuInterface) -> None:
    values = load_parameters().values
    slave, fresh = _started(unit, values), _started(unit, values)
    for _ in range(2):  # inside a tick, and at a sample
        state = json.loads(json.dumps(slave._get_fmu_state()))
        fresh._set_fmu_state(_stored(type(fresh), state))
        assert fresh._get_fmu_state() == slave._get_fmu_state()
        now = slave._get_fmu_state()[1]
        assert fresh.do_step(now, 0.006)
        assert slave.do_step(now, 0.006)
        assert fresh._get_fmu_state() == slave._get_fmu_state()
