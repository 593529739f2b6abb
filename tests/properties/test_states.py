"""Stored states of the Python FMU whose checksum is right and whose values are not."""

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

STEP, STEPS = 0.7e-3, 20  # s; not a multiple of a tick, so that the state is stored inside a tick
TIMEOUT = 10  # s, for a restore and two steps, which take milliseconds
INTERFACES = (FmuInterface(1), FmuInterface(2))

_numbers = st.one_of(st.floats(), st.integers(), st.sampled_from(
    [1e300, -1e300, 1e19, 5e-324, 10**400, 2**53, 2**63, -1, 0, 1, 0.5, 50, True, float("nan"), float("inf")]))
_texts = st.one_of(st.text(st.characters(), max_size=5), st.sampled_from(
    ["\ud800", "\0", "%n%n", "instantiated", "initialization", "running", "terminated"]))
_values = st.recursive(st.one_of(st.none(), st.booleans(), _numbers, _texts), lambda inner: st.one_of(
    st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=2)), max_leaves=8)


def _started(interface: FmuInterface, values: Mapping[str, Any]) -> Any:
    slave = slave_class(interface, [values] * interface.fins)(instance_name="fin")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    command = next(i for i, row in enumerate(slave.rows) if row[0].endswith("fin_command"))
    slave.set_real([command], [0.2])
    for k in range(STEPS):
        assert slave.do_step(k * STEP, STEP)
    return slave


def _with_checksum(cls: type[Slave], state: Any) -> Any:
    body = json.dumps(state).encode()
    return cls._fmu_state_from_bytes(f"{cls.fmu_guid} {zlib.crc32(body):08x} ".encode() + body)


@contextmanager
def _time_limit() -> Iterator[None]:
    """Fail after TIMEOUT; checked at the end, since the FMU catches the alarm's exception and discards the step."""
    late: list[int] = []

    def ring(number: int, _: object) -> None:
        late.append(number)
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(TIMEOUT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        assert not late, f"over {TIMEOUT} s"


def _put(state: Any, path: list[float], value: Any) -> Any:
    """Replace a value in nested lists; each number of the path is an index as a share of the list's length."""
    share, *rest = path
    index = min(int(share * len(state)), len(state) - 1)
    inner = state[index]
    state[index] = _put(inner, rest, value) if rest and isinstance(inner, list) and inner else value
    return state


def _path(*indices: int) -> list[float]:
    """Return the path to an index of the nine values of a state, or of the nine of its core."""
    return [(index + 0.5) / 9 for index in indices]


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="a loop that does not end is stopped by an alarm")
@pytest.mark.parametrize("interface", [INTERFACES[0], *slow(*INTERFACES[1:])], ids=["one", "two fins"])
@settings(derandomize=True, max_examples=75, suppress_health_check=[HealthCheck.too_slow])
@given(changes=st.lists(st.tuples(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4), _values), min_size=1,
                        max_size=2))
@example(changes=[(_path(3), "\ud800")])
@example(changes=[(_path(4), "\ud800")])
@example(changes=[(_path(8, 0), 1e300)])
@example(changes=[(_path(8, 1), 1e300)])
@example(changes=[(_path(8, 1), -1e300)])
@example(changes=[(_path(8, 1), 0.5)])
@example(changes=[(_path(8, 0), -(10**9))])
@example(changes=[(_path(1), 1e12), (_path(8, 0), 10**15)])
def test_corrupt_state_is_refused_or_harmless(interface: FmuInterface, changes: Any) -> None:
    """A refused state changes nothing. After another one the next step has finite outputs or is discarded."""
    slave = _started(interface, load_parameters().values)
    state = json.loads(json.dumps(slave._get_fmu_state()))
    for path, value in changes:
        state = _put(state, path, value)
    before, messages = slave._get_fmu_state(), len(slave.log_queue)
    with _time_limit():
        slave._set_fmu_state(_with_checksum(type(slave), state))
        after = slave._get_fmu_state()
        if len(slave.log_queue) > messages:
            assert slave.log_queue[-1].msg.startswith("FMU state refused: ")
            assert after[:3] + after[4:] == before[:3] + before[4:]  # [3]: why the next step is discarded
            assert not slave.do_step(STEPS * STEP, STEP)
            assert slave.do_step(STEPS * STEP, STEP)
        elif slave.do_step(after[0] + after[1], STEP):
            outputs = [row for row in slave.outputs if slave.rows[row][1] == "Real"]
            assert all(map(isfinite, slave.get_real(outputs)))
    for message in slave.log_queue:
        message.msg.encode()


@pytest.mark.parametrize("interface", INTERFACES, ids=["one", "two fins"])
def test_restored_state_continues_identically(interface: FmuInterface) -> None:
    values = load_parameters().values
    slave, fresh = _started(interface, values), _started(interface, values)
    for _ in range(2):  # inside a tick, and at a sample
        state = json.loads(json.dumps(slave._get_fmu_state()))
        fresh._set_fmu_state(_with_checksum(type(fresh), state))
        assert fresh._get_fmu_state() == slave._get_fmu_state()
        now = slave._get_fmu_state()[1]
        assert fresh.do_step(now, 0.006)
        assert slave.do_step(now, 0.006)
        assert fresh._get_fmu_state() == slave._get_fmu_state()
