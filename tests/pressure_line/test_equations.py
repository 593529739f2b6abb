"""The pressure line alone: closed forms, SciPy's integrations of the gas law, and bounds for any parameters."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emcas_fmu.actuators.line import PRESSURE_LINE
from emcas_fmu.namespace import namespace
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import pressure_line

VOLUME, PRECHARGE, EXPONENT, GAIN, MOST, SET = 2e-4, 12e6, 1.4, 1.5e-10, 1.5e-4, 21e6
PARAMETERS = {"line.accumulator_volume": VOLUME, "line.precharge_pressure": PRECHARGE,
              "line.polytropic_exponent": EXPONENT, "line.pump_gain": GAIN, "line.pump_flow": MOST}


def stepped(begin: float, stop: float, update: float, drawn: Callable[[float], float], **changes: float) -> Any:
    """Pressures at 0, update, 2 update, ... up to stop [s], of a line whose actuators draw so much at a pressure."""
    line = namespace({**PARAMETERS, "line.update_time": update, **{f"line.{k}": v for k, v in changes.items()}}).line
    pressures = [begin]
    for _ in range(round(stop / update)):
        pressures.append(pressure_line.next_pressure(FLOATS, line, SET, pressures[-1], drawn(pressures[-1])))
    return np.array(pressures)


def gas(at: float) -> float:
    """Volume of the gas [m3] at a pressure."""
    return float(VOLUME * (PRECHARGE / at) ** (1.0 / EXPONENT))


def integrated(flow: Callable[[float], float], begin: float, stop: float) -> Any:
    """The pressure as a function of time, of a flow into the accumulator that stays above its precharge."""
    def slope(_: float, state: Any) -> list[float]:
        return [EXPONENT * state[0] * flow(state[0]) / gas(state[0])]

    return solve_ivp(slope, (0.0, stop), [begin], rtol=1e-10, atol=1.0, dense_output=True).sol


def pump(at: float) -> float:
    return min(max(GAIN * (SET - at), 0.0), MOST)


@pytest.mark.parametrize(("begin", "stop", "drawn", "pumping"), [
    (20e6, 0.2, lambda p: 2e-4, 0.0),  # decay of the gas alone
    (PRECHARGE, 0.6, lambda p: 0.0, MOST),  # recharge, first by all the pump gives, then by its regulator
    (21e6, 0.3, lambda p: 4e-8 * p**0.5, MOST),  # throttles that draw more than the pump gives
    (13e6, 0.6, lambda p: 1.2e-4, MOST),
])
def test_the_gas_law_with_the_first_order_of_the_update_time(
        begin: float, stop: float, drawn: Callable[[float], float], pumping: float) -> None:
    exact = integrated(lambda p: (pump(p) if pumping else 0.0) - drawn(p), begin, stop)
    errors = []
    for update in (1e-3, 5e-4, 2.5e-4):
        pressures = stepped(begin, stop, update, drawn, pump_flow=pumping)
        errors.append(np.abs(pressures - exact(np.arange(len(pressures)) * update)[0]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 1.0).max() < 0.1, errors  # one; the second-order term is h over 20 ms and more of the line
    assert errors[0] < 0.005 * begin  # 1 ms of a line that takes more than 0.2 s


def test_a_draw_settles_where_the_regulator_gives_it() -> None:
    # Time constant C/G below 0.1 s: e^-20 is left of it.
    assert stepped(21e6, 2.0, 1e-3, lambda p: 0.9e-4)[-1] == pytest.approx(SET - 0.9e-4 / GAIN, rel=1e-8)


def test_throttles_settle_where_they_take_what_the_pump_gives() -> None:
    """Far below the precharge, on an empty accumulator: Q_max = k sqrt(p)."""
    conductance = 6e-4 / SET**0.5
    settled = stepped(21e6, 1.0, 1e-3, lambda p: conductance * p**0.5)[-1]
    assert settled == pytest.approx((MOST / conductance) ** 2, rel=1e-8)  # milliseconds of the oil are long over


@pytest.mark.parametrize("update", [1e-2, 1e-4])
def test_there_is_no_more_oil_than_the_accumulator_has(update: float) -> None:
    """A constant draw has emptied it when the oil has flowed; then the pressure is gone in milliseconds."""
    oil, draw = VOLUME - gas(20e6), 2e-4
    pressures = stepped(20e6, 0.5, update, lambda p: draw, pump_flow=0.0)
    emptied = np.argmax(pressures < PRECHARGE) * update
    assert emptied == pytest.approx(oil / draw, abs=1.5 * update + 0.01 * oil / draw)  # an update, and first order
    left = pressures[ceil((emptied + 0.05) / update) + 5]
    assert left < 0.2 * PRECHARGE


def test_an_empty_accumulator_leaves_a_hundredth_of_its_compliance() -> None:
    draw, update = 2e-5, 1e-5
    pressures = stepped(11e6, 0.03, update, lambda p: draw, pump_flow=0.0)
    fall = 100.0 * EXPONENT * PRECHARGE / VOLUME * draw  # Pa/s, the same at every pressure
    expected = 11e6 - fall * update * np.arange(len(pressures))
    assert expected[-1] < 6e6
    assert pressures == pytest.approx(expected, abs=fall * update)  # first order: what falls in an update


def test_a_line_fills_through_its_precharge() -> None:
    """From empty, in a step that is longer than the oil in the pipes takes: the accumulator is not passed by."""
    for update in (1e-2, 1e-3, 1e-4):
        pressures = stepped(1e5, 1.0, update, lambda p: 0.0)
        assert np.all(np.diff(pressures) >= 0.0)
        full = (gas(PRECHARGE) - gas(20e6)) / MOST  # s, at least, from the precharge to where the regulator begins
        assert np.argmax(pressures >= 20e6) * update > full - 3.0 * update - 0.02 * full
        assert pressures[-1] <= SET


def test_the_pressure_does_not_step_with_the_pump_s_setting() -> None:
    line = namespace({**PARAMETERS, "line.update_time": 1e-3}).line
    for setting in (0.0, 10e6, 60e6):
        after = pressure_line.next_pressure(FLOATS, line, setting, 20e6, 0.0)
        assert 0.0 <= after - 20e6 <= 1.01 * EXPONENT * 20e6 * MOST * 1e-3 / gas(20e6)  # no more than the pump's flow


def test_until_it_is_stepped_a_line_has_the_source_s_pressure() -> None:
    for source in (0.0, 1e5, 21e6):
        assert pressure_line.pressure(FLOATS, source, *PRESSURE_LINE.start(FLOATS, None)) == source
    assert pressure_line.pressure(FLOATS, 21e6, 5e6) == 5e6


_limits = {v.name: st.one_of(st.floats(v.minimum, v.maximum), st.sampled_from([v.minimum, v.maximum]))
           for v in PRESSURE_LINE.parameters}


@settings(derandomize=True, max_examples=100)
@given(parameters=st.fixed_dictionaries(_limits), source=st.floats(-1e9, 1e9), begin=st.floats(0.0, 1e9),
       draws=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20))
def test_it_is_bounded_whatever_the_parameters(parameters: dict[str, float], source: float, begin: float,
                                               draws: list[float]) -> None:
    """No overshoot of the pump's setting, no pressure below the vapour's; oil that returns doubles it at most."""
    line, at = namespace(parameters).line, begin
    for drawn in draws:
        after = pressure_line.next_pressure(FLOATS, line, source, at, drawn)
        most = max(source, at if drawn >= 0.0 else 2.0 * at, 2.0 * pressure_line.LEAST)
        assert pressure_line.LEAST <= after <= most * (1.0 + 1e-9)  # rounding
        at = after
