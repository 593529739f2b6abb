"""The events of the independent integration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import pytest

from emcas_fmu.reference.events import Accuracy, Event, Scalar, advance


class _Mode(NamedTuple):
    first: int = 0
    second: int = 0


class _Falling:
    """A state that falls by 1 per second, and two fields of the mode that become 1 near 0.5, `apart` from each other.
    """

    accuracy = Accuracy(1e-9, (1.0,), 1.0)

    def __init__(self, apart: float):
        self.apart = apart

    def slope(self, y: Any, mode: _Mode, around: Mapping[str, Scalar]) -> list[float]:
        return [-1.0]

    def settled(self, y: Any, mode: _Mode, around: Mapping[str, Scalar]) -> _Mode:
        return mode

    def events(self, mode: _Mode, around: Mapping[str, Scalar]) -> list[Event]:
        margins = {"first": lambda y: y[0] - 0.5, "second": lambda y: y[0] - 0.5 - self.apart}
        return [Event(margins[name], {name: 1}) for name, value in mode._asdict().items() if not value]


@pytest.mark.parametrize("apart", [sign * 10.0**power for power in (-18, -17, -16, -15, -14, -6) for sign in (1, -1)])
def test_events_at_the_same_time_all_happen(apart: float) -> None:
    """SciPy ends a step at one of them; by rounding, the margins of the others may then be below 0 already."""
    actuator: Any = _Falling(apart)
    state, mode = advance(actuator, [1.0], _Mode(), {}, 0.0, 1.0)
    assert state == [pytest.approx(0.0, abs=1e-12)]
    assert mode == (1, 1)
