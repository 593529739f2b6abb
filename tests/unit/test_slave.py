"""The class of the Python FMU in this process: interrupts and calls that a host in another process cannot make."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan
from typing import Any
from unittest.mock import Mock

import pytest
from pythonfmu.enums import Fmi2Status

from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.rules import NO_VARIABLE
from tests.default_actuator import VARIABLES
from tests.fmu.built import slave_class

INDEX = {v.name: i for i, v in enumerate(VARIABLES)}


@pytest.fixture
def slave(values: Mapping[str, Any]) -> Any:
    slave = slave_class(FmuInterface(1), [values])(instance_name="fin")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    return slave


def _angle(slave: Any) -> float:
    angle, = slave.get_real([INDEX["fin_angle"]])
    return float(angle)


@pytest.mark.parametrize("method", ["run", "_tick", "outputs"])
def test_interrupt_discards_only_the_step(slave: Any, monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    slave.set_real([INDEX["fin_command"]], [0.1])
    assert all(slave.do_step(k * 1e-3, 1e-3) for k in range(20))
    before = slave._get_fmu_state()
    with monkeypatch.context() as patch:
        patch.setattr(type(slave._core), method, Mock(side_effect=KeyboardInterrupt))
        assert not slave.do_step(0.02, 1e-3)
    assert slave._get_fmu_state() == before
    assert slave.do_step(0.02, 1e-3)


def test_percent_signs_in_messages_are_doubled(slave: Any) -> None:
    slave._misused("50 % of %s")
    assert slave.log_queue[-1].msg == "50 %% of %%s"


def test_state_restored_from_bytes_includes_parameters(slave: Any) -> None:
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


def test_state_of_wrong_shape_changes_nothing(slave: Any) -> None:
    assert slave.do_step(0.0, 0.01)
    before = slave._get_fmu_state()
    for bad in ((1, 2, 3), None, "it is nonsense"):
        slave._set_fmu_state(bad)
        assert not slave.do_step(0.01, 0.01)
        assert slave.log_queue[-1].msg
    assert slave.do_step(0.01, 0.01)
    slave._set_fmu_state(before)
    assert slave._get_fmu_state() == before


def test_interrupt_while_reading_discards_the_next_step(slave: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    slave.set_real([INDEX["fin_command"]], [0.1])
    with monkeypatch.context() as patch:
        patch.setattr(type(slave._core), "outputs", Mock(side_effect=KeyboardInterrupt))
        slave.get_real([INDEX["fin_angle"]])
    assert not slave.do_step(0.0, 1e-3)
    assert "KeyboardInterrupt" in slave.log_queue[-1].msg
    assert slave.do_step(0.0, 1e-3)


def test_boolean_read_as_real_is_nan_with_a_message(slave: Any) -> None:
    """Some hosts read every output as a Real; the run continues."""
    slave.set_real([INDEX["fin_command"]], [0.1])
    for k in range(20):
        angle, saturated = slave.get_real([INDEX["fin_angle"], INDEX["saturated"]])
        assert isnan(saturated)
        assert not isnan(angle)
        assert slave.log_queue[-1].msg == NO_VARIABLE % ("Real", INDEX["saturated"])
        assert "modelDescription.xml lists references and types" in slave.log_queue[-1].msg
        assert slave.get_integer([INDEX["fin_angle"], 10_000, -1]) == [0, 0, 0]
        assert slave.get_boolean([INDEX["enable"], INDEX["fin_angle"]]) == [True, False]
        assert slave.do_step(k * 1e-3, 1e-3)
    assert abs(_angle(slave)) > 1e-3


def test_wrong_value_reference_is_reported_once(slave: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Steps continue."""
    for k in range(3):
        slave.set_integer([INDEX["fin_command"]], [1])
        slave.set_real([10_000, INDEX["fin_command"]], [1.0, 0.1])
        assert [m.status for m in slave.log_queue[-2:]] == [Fmi2Status.error] * 2
        assert slave.do_step(k * 1e-3, 1e-3)
    assert slave.get_real([INDEX["fin_command"]]) == [0.1]
    assert capsys.readouterr().err.splitlines() == [
        f"fin: {NO_VARIABLE % ('Integer', INDEX['fin_command'])}; it is not set",
        f"fin: {NO_VARIABLE % ('Real', 10_000)}; it is not set"]


@pytest.mark.parametrize(("name", "message"), [
    ("fin_angle", "fin_angle is an output and cannot be set"),
    ("motor.resistance", "motor.resistance is fixed and cannot be set after initialization")])
def test_forbidden_write_discards_the_next_step(slave: Any, name: str, message: str) -> None:
    """The wrapper cannot return an error for the write itself."""
    slave.set_real([INDEX[name]], [1.0])
    assert slave.log_queue[-1].msg == message
    assert not slave.do_step(0.0, 1e-3)
    assert slave.do_step(0.0, 1e-3)


def test_calls_out_of_order_discard_the_next_step(slave: Any) -> None:
    for call in (lambda: slave.setup_experiment(5.0), slave.enter_initialization_mode, slave.exit_initialization_mode):
        call()
        assert "while running" in slave.log_queue[-1].msg
        assert not slave.do_step(0.0, 1e-3)
    assert slave.do_step(0.0, 1e-3)


def test_clock_that_runs_back_moves_nothing(slave: Any) -> None:
    """Within the tolerance of 1 us, a step may begin and even end before the time reached."""
    slave.set_real([INDEX["fin_command"]], [0.2])
    for k in range(20):
        assert slave.do_step(k * 1e-3, 1e-3)
    for time in (0.02, 0.02025):
        before = _angle(slave)
        assert slave.do_step(time - 0.9e-6, 1e-8)
        assert _angle(slave) == before
        slave.set_boolean([INDEX["enable"]], [time == 0.02])
        assert slave.do_step(time, 0.25e-3)
