"""Fmi3Slave gives access to the elements of FMI 3.0 arrays by the calls of FMI 2.0."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from emcas_fmu.bench.fmi3 import Fmi3Slave, elements


def variable(name: str, kind: str, reference: int, *sizes: int, start: str | None = "0", causality: str = "input"
             ) -> SimpleNamespace:
    dimensions = [SimpleNamespace(start=size) for size in sizes]
    return SimpleNamespace(name=name, type=kind, causality=causality, start=start, valueReference=reference,
                           dimensions=dimensions)


DESCRIPTION = SimpleNamespace(modelVariables=[
    variable("time", "Float64", 0, causality="independent"),
    variable("fins.command", "Float64", 1, 2, start="0.1 0.2"),
    variable("fins.table", "Float64", 2, 2, 3, start="1 2 3 4 5 6", causality="parameter"),
    variable("enable", "Boolean", 3, start="true"),
    variable("status", "Enumeration", 4, causality="output", start=None),
    variable("clock", "Clock", 5)])
ELEMENTS = elements(DESCRIPTION, {})


class Slave:
    """An FMI 3.0 slave that stores values by reference and records its calls."""

    def __init__(self) -> None:
        self.values: dict[int, list[Any]] = {1: [0.1, 0.2], 2: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3: [True], 4: [7]}
        self.calls: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        def get(references: Sequence[int], count: int) -> list[Any]:
            self.calls.append(name)
            (reference,) = references
            assert len(self.values[reference]) == count
            return list(self.values[reference])

        def put(references: Sequence[int], values: Sequence[Any]) -> None:
            self.calls.append(name)
            (reference,) = references
            assert len(self.values[reference]) == len(values)
            self.values[reference] = list(values)

        def other(*arguments: Any, **named: Any) -> None:
            self.calls.append((name, *arguments, named))

        return get if name.startswith("get") else put if name.startswith("set") else other


def test_elements_have_names_and_start_values() -> None:
    assert [(e.name, e.kind, e.start, e.reference, e.index, e.count) for e in ELEMENTS] == [
        ("fin[1].command", "Real", "0.1", 1, 0, 2), ("fin[2].command", "Real", "0.2", 1, 1, 2),
        *((f"fin[{fin}].table[{k}]", "Real", str(3 * (fin - 1) + k + 1), 2, 3 * (fin - 1) + k, 6)
          for fin in (1, 2) for k in range(3)),
        ("enable", "Boolean", "true", 3, 0, 1), ("status", "Integer", None, 4, 0, 1)]
    assert [e.in_files for e in ELEMENTS[1:3]] == ["fins.command[1]", "fins.table[0]"]
    assert ELEMENTS[-2].in_files == "enable"


def test_flat_names_are_converted_to_structured_names() -> None:
    (first, _, *_) = elements(SimpleNamespace(modelVariables=[variable("fins_command", "Float64", 1, 2, start="1 2")]),
                              {"fins_command": "fins.command"})
    assert (first.name, first.array) == ("fin[1].command", "fins_command")


def test_each_array_is_read_once() -> None:
    inner = Slave()
    slave = Fmi3Slave(inner, ELEMENTS)
    assert slave.getReal([1, 0, 7, 2]) == [0.2, 0.1, 6.0, 1.0]
    assert inner.calls == ["getFloat64", "getFloat64"]  # two arrays, once each
    assert slave.getInteger([9]) == [7]
    assert inner.calls[-1] == "getInt64"


def test_writing_an_element_keeps_the_others_of_its_array() -> None:
    inner = Slave()
    slave = Fmi3Slave(inner, ELEMENTS)
    slave.setReal([1, 4], [0.5, 30.0])
    slave.setBoolean([8], [False])
    assert inner.values == {1: [0.1, 0.5], 2: [1.0, 2.0, 30.0, 4.0, 5.0, 6.0], 3: [False], 4: [7]}


def test_calls_are_passed_on_except_setup_experiment() -> None:
    inner = Slave()
    slave = Fmi3Slave(inner, ELEMENTS)
    slave.setupExperiment()  # FMI 3.0 does not have it
    slave.enterInitializationMode()
    slave.doStep(2.5, 1e-3)
    slave.terminate()
    assert inner.calls == [("enterInitializationMode", {}), ("doStep", 2.5, 1e-3, {}), ("terminate", {})]
