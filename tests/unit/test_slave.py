"""The slave class in this process: what a host in a fresh process cannot provoke."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from emcas_fmu.fmi.fmi2.slave import CorruptState
from emcas_fmu.fmi.interface import SINGLE
from tests.default_actuator import VARIABLES
from tests.fmu.built import slave_class

INDEX = {v.name: i for i, v in enumerate(VARIABLES)}


@pytest.fixture
def slave(values: Mapping[str, Any]) -> Any:
    made = slave_class(SINGLE, [values])(instance_name="fin")
    made.setup_experiment(0.0)
    made.enter_initialization_mode()
    made.exit_initialization_mode()
    return made


def _angle(slave: Any) -> float:
    angle, = slave.get_real([INDEX["fin_angle"]])
    return float(angle)


@pytest.mark.parametrize("method", ["run", "_tick", "outputs"])
def test_an_interrupt_discards_the_step_and_nothing_else(slave: Any, monkeypatch: pytest.MonkeyPatch,
                                                         method: str) -> None:
    slave.set_real([INDEX["fin_command"]], [0.1])
    assert all(slave.do_step(k * 1e-3, 1e-3) for k in range(20))
    before = slave._get_fmu_state()

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(type(slave._core), method, interrupted)
        assert not slave.do_step(0.02, 1e-3)
    assert slave._get_fmu_state() == before
    assert slave.do_step(0.02, 1e-3)


def test_log_texts_are_no_printf_formats(slave: Any) -> None:
    slave._misused("50 % of %s")
    assert slave.log_queue[-1].msg == "50 %% of %%s"


def test_state_survives_bytes_and_a_changed_parameter(slave: Any) -> None:
    slave.set_real([INDEX["fin_command"]], [0.1])
    assert slave.do_step(0.0, 0.01)
    slave.set_real([INDEX["friction.temperature"]], [-6.0])
    state = type(slave)._fmu_state_from_bytes(type(slave)._fmu_state_to_bytes(slave._get_fmu_state()))
    assert slave.do_step(0.01, 0.05)
    cold = _angle(slave)
    slave.set_real([INDEX["friction.temperature"]], [24.0])
    slave._set_fmu_state(state)
    assert slave.get_real([INDEX["friction.temperature"]]) == [-6.0]
    assert slave.do_step(0.01, 0.05)
    assert _angle(slave) == cold


def test_a_state_of_another_shape_changes_nothing(slave: Any) -> None:
    assert slave.do_step(0.0, 0.01)
    before = slave._get_fmu_state()
    for bad in ((1, 2, 3), None, CorruptState("it is nonsense")):
        slave._set_fmu_state(bad)
        assert not slave.do_step(0.01, 0.01)
        assert slave.log_queue[-1].msg
    assert slave.do_step(0.01, 0.01)
    slave._set_fmu_state(before)
    assert slave._get_fmu_state() == before


def test_an_interrupt_while_reading_discards_the_next_step(slave: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    slave.set_real([INDEX["fin_command"]], [0.1])
    with monkeypatch.context() as patch:
        patch.setattr(type(slave._core), "outputs", interrupted)
        slave.get_real([INDEX["fin_angle"]])
    assert not slave.do_step(0.0, 1e-3)
    assert "KeyboardInterrupt" in slave.log_queue[-1].msg
    assert slave.do_step(0.0, 1e-3)


def test_calls_out_of_order_are_misuse(slave: Any) -> None:
    for call in (lambda: slave.setup_experiment(5.0), slave.enter_initialization_mode, slave.exit_initialization_mode):
        call()
        assert "while running" in slave.log_queue[-1].msg
        assert not slave.do_step(0.0, 1e-3)
    assert slave.do_step(0.0, 1e-3)


def test_a_clock_that_runs_back_does_not_move_the_trajectory(slave: Any) -> None:
    """Within the tolerance of 1 us a step may begin and even end before where the slave stands."""
    slave.set_real([INDEX["fin_command"]], [0.2])
    for k in range(20):
        assert slave.do_step(k * 1e-3, 1e-3)
    for at in (0.02, 0.02025):
        before = _angle(slave)
        assert slave.do_step(at - 0.9e-6, 1e-8)
        assert _angle(slave) == before
        slave.set_boolean([INDEX["enable"]], [at == 0.02])
        assert slave.do_step(at, 0.25e-3)
