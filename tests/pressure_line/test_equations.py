"""The equations of the pressure line: closed forms, integrations of the gas law by SciPy, and bounds."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emcas_fmu.actuators.supply_line import PRESSURE_LINE
from emcas_fmu.namespace import namespace
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import pressure_line

VOLUME, PRECHARGE, EXPONENT, GAIN, MOST, SET = 2e-4, 12e6, 1.4, 1.5e-10, 1.5e-4, 21e6
PARAMETERS = {"line.accumulator_volume": VOLUME, "line.precharge_pressure": PRECHARGE,
              "line.polytropic_exponent": EXPONENT, "line.pump_gain": GAIN, "line.pump_flow": MOST}


def stepped(begin: float, stop: float, update: float, drawn: Callable[[float], float], **changes: float) -> Any:
    """Return the pressures [Pa] at every update up to `stop` [s]; `drawn` is the flow [m3/s] at a pressure."""
    line = namespace({**PARAMETERS, "line.update_time": update, **{f"line.{k}": v for k, v in changes.items()}}).line
    pressures = [begin]
    for _ in range(round(stop / update)):
        pressures.append(pressure_line.next_pressure(FLOATS, line, SET, pressures[-1], drawn(pressures[-1])))
    return np.array(pressures)


def gas(pressure: float) -> float:
    """Return the volume of the gas [m3] at a pressure [Pa]."""
    return float(VOLUME * (PRECHARGE / pressure) ** (1.0 / EXPONENT))


def integrated(flow: Callable[[float], float], begin: float, stop: float) -> Any:
    """Return the pressure [Pa] as a function of time, for a flow into an accumulator above its precharge."""
    def slope(_: float, state: Any) -> list[float]:
        return [EXPONENT * state[0] * flow(state[0]) / gas(state[0])]

    return solve_ivp(slope, (0.0, stop), [begin], rtol=1e-10, atol=1.0, dense_output=True).sol


def pump(pressure: float) -> float:
    return min(max(GAIN * (SET - pressure), 0.0), MOST)


@pytest.mark.parametrize(("begin", "stop", "drawn", "pumping"), [
    (20e6, 0.2, lambda p: 2e-4, 0.0),  # no pump
    (PRECHARGE, 0.6, lambda p: 0.0, MOST),  # recharge, first by the pump's largest flow, then by its regulator
    (21e6, 0.3, lambda p: 4e-8 * p**0.5, MOST),  # throttles that draw more than the pump's flow
    (13e6, 0.6, lambda p: 1.2e-4, MOST),
])
def test_the_pressure_follows_the_gas_law_to_first_order_in_the_update_time(
        begin: float, stop: float, drawn: Callable[[float], float], pumping: float) -> None:
    exact = integrated(lambda p: (pump(p) if pumping else 0.0) - drawn(p), begin, stop)
    errors = []
    for update in (1e-3, 5e-4, 2.5e-4):
        pressures = stepped(begin, stop, update, drawn, pump_flow=pumping)
        errors.append(np.abs(pressures - exact(np.arange(len(pressures)) * update)[0]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 1.0).max() < 0.1, errors  # time constants of 20 ms and more bound the second-order term
    assert errors[0] < 0.005 * begin  # 1 ms of a change that lasts more than 0.2 s


def test_under_a_constant_draw_the_pressure_settles_at_the_regulator_s() -> None:
    # With a time constant C/G below 0.1 s, e^-20 of the transient remains.
    assert stepped(21e6, 2.0, 1e-3, lambda p: 0.9e-4)[-1] == pytest.approx(SET - 0.9e-4 / GAIN, rel=1e-8)


def test_under_throttles_the_pressure_settles_where_they_draw_the_pump_s_flow() -> None:
    """Far below the precharge, with an empty accumulator: Q_max = k sqrt(p)."""
    conductance = 6e-4 / SET**0.5
    settled = stepped(21e6, 1.0, 1e-3, lambda p: conductance * p**0.5)[-1]
    assert settled == pytest.approx((MOST / conductance) ** 2, rel=1e-8)  # time constants are milliseconds


@pytest.mark.parametrize("update", [1e-2, 1e-4])
def test_the_accumulator_supplies_no_more_than_its_oil(update: float) -> None:
    """A constant draw empties it; then the pressure falls in milliseconds."""
    oil, draw = VOLUME - gas(20e6), 2e-4
    pressures = stepped(20e6, 0.5, update, lambda p: draw, pump_flow=0.0)
    emptied = np.argmax(pressures < PRECHARGE) * update
    assert emptied == pytest.approx(oil / draw, abs=1.5 * update + 0.01 * oil / draw)  # an update, and first order
    assert pressures[ceil((emptied + 0.05) / update) + 5] < 0.2 * PRECHARGE


def test_an_empty_accumulator_has_a_hundredth_of_its_compliance() -> None:
    draw, update = 2e-5, 1e-5
    pressures = stepped(11e6, 0.03, update, lambda p: draw, pump_flow=0.0)
    fall = 100.0 * EXPONENT * PRECHARGE / VOLUME * draw  # Pa/s, the same at every pressure
    expected = 11e6 - fall * update * np.arange(len(pressures))
    assert expected[-1] < 6e6
    assert pressures == pytest.approx(expected, abs=fall * update)  # first order: the fall in an update


def test_an_empty_line_fills_pipes_and_accumulator() -> None:
    """Also with an update longer than the filling of the pipes, after which the accumulator must still fill."""
    for update in (1e-2, 1e-3, 1e-4):
        pressures = stepped(1e5, 1.0, update, lambda p: 0.0)
        assert np.all(np.diff(pressures) >= 0.0)
        full = (gas(PRECHARGE) - gas(20e6)) / MOST  # s, at least, from the precharge to the regulator's range
        assert np.argmax(pressures >= 20e6) * update > full - 3.0 * update - 0.02 * full
        assert pressures[-1] <= SET


def test_a_step_of_the_pump_s_setting_does_not_step_the_pressure() -> None:
    line = namespace({**PARAMETERS, "line.update_time": 1e-3}).line
    for setting in (0.0, 10e6, 60e6):
        after = pressure_line.next_pressure(FLOATS, line, setting, 20e6, 0.0)
        assert 0.0 <= after - 20e6 <= 1.01 * EXPONENT * 20e6 * MOST * 1e-3 / gas(20e6)  # no more than the pump's flow


def test_before_its_first_update_a_line_has_the_source_s_pressure() -> None:
    for source in (0.0, 1e5, 21e6):
        assert pressure_line.pressure(FLOATS, source, *PRESSURE_LINE.start(FLOATS, None)) == source
    assert pressure_line.pressure(FLOATS, 21e6, 5e6) == 5e6


_limits = {v.name: st.one_of(st.floats(v.minimum, v.maximum), st.sampled_from([v.minimum, v.maximum]))
           for v in PRESSURE_LINE.parameters}


@settings(derandomize=True, max_examples=100)
@given(parameters=st.fixed_dictionaries(_limits), source=st.floats(-1e9, 1e9), begin=st.floats(0.0, 1e9),
       draws=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20))
def test_the_pressure_is_bounded_for_any_parameters(parameters: dict[str, float], source: float, begin: float,
                                                    draws: list[float]) -> None:
    """It does not exceed the pump's setting or fall below the vapour pressure; returning oil doubles it at most."""
    line, before = namespace(parameters).line, begin
    for drawn in draws:
        after = pressure_line.next_pressure(FLOATS, line, source, before, drawn)
        most = max(source, before if drawn >= 0.0 else 2.0 * before, 2.0 * pressure_line.LEAST_PRESSURE)
        assert pressure_line.LEAST_PRESSURE <= after <= most * (1.0 + 1e-9)  # rounding
        before = after
