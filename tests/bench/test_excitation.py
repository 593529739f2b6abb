"""The rows of every excitation agree with hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from emcas_fmu.bench.excitation import (
    LOAD,
    Excitation,
    Move,
    load_ramp,
    motion,
    reference_case,
    sine,
    sine_from_rest,
    slew_to,
    staircase,
    step_to,
    sweep,
)
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import EXCITATIONS, LEAD_IN, LOAD_RISE, MOTIONS, SETTLE, STEP
from emcas_fmu.reference.cases import CASES


def test_load_rises_after_the_step() -> None:
    step = step_to(0.1, 0.5, load=-40.0)
    assert len(step.time) == 551
    assert step.command[:50].tolist() == [0.0] * 50
    assert step.command[50:].tolist() == [0.1] * 501
    load = step.columns["aero_torque"]
    assert np.all(load[:51] == 0.0)
    # The load rises linearly; times and ratio are rounded.
    assert load[60] == pytest.approx(-40.0 * 0.01 / LOAD_RISE, rel=1e-12)
    assert np.all(load[71:] == -40.0)
    assert step.moves == (Move(LEAD_IN, 0.1, step.time[-1]),)
    assert list(step_to(0.1, 0.5).columns) == ["fin_command"]


def test_slew_settles_at_its_start() -> None:
    slew = slew_to(0.3, 0.6, load=100.0)
    assert slew.begin == SETTLE
    assert slew.command[0] == 0.0
    assert set(slew.command[1:1000]) == {-0.3}
    assert set(slew.command[1000:]) == {0.3}
    assert np.all(slew.columns["aero_torque"][:1001] == 0.0)
    assert [move.level for move in slew.moves] == [-0.3, 0.3]
    assert slew.moves[0].end == slew.moves[1].start == SETTLE


def test_sweep_has_the_cycles_of_its_frequencies() -> None:
    swept = sweep(1.0, 8.0, 0.5, 30.0)
    cycles = np.cumsum((swept.command[1:] >= 0.0) & (swept.command[:-1] < 0.0))
    # f = low exp(g t) gives (f - low)/g cycles. f is the geometric mean at half the time, and `high` at the end.
    growth = np.log(60.0) / 8.0
    assert cycles[round((LEAD_IN + 4.0) * 1e3)] == int((15.0**0.5 - 0.5) / growth)
    assert cycles[-1] == int((30.0 - 0.5) / growth)
    assert np.max(np.abs(swept.command)) == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(ValueError, match="not below"):
        sweep(1.0, 8.0, 5.0, 5.0)


def test_sine_from_rest_is_judged_from_its_beginning() -> None:
    made = sine_from_rest(0.1, 5.0, 0.3)
    quarter = round(LEAD_IN / made.step) + 50  # row of a quarter period: 50 of 200 ms
    assert not made.command[made.time < LEAD_IN].any()
    assert made.command[quarter] == pytest.approx(0.1, rel=1e-12)  # rounding
    assert made.begin == LEAD_IN
    assert made.stop == pytest.approx(LEAD_IN + 0.3, rel=1e-12)


def test_judged_part_of_a_sine_is_six_cycles() -> None:
    for frequency, made in ((10.0, sine(0.1, 10.0)), (10.0, sine(0.1, 10.0, variable=LOAD)), (0.5, sine(0.1, 0.5))):
        judged = made.time[made.judged(made.time)]
        assert judged[-1] - judged[0] == pytest.approx(6.0 / frequency, abs=1e-9)
        assert judged[0] == pytest.approx(max(4.0 / frequency, 0.5), abs=1e-9)
    assert sine(0.1, 10.0).command[0] == 0.0
    assert sine(50.0, 10.0, variable=LOAD).columns["aero_torque"][0] == 50.0
    assert not sine(50.0, 10.0, variable=LOAD).command.any()
    together = sine(0.1, np.array([10.0, 2.0]), np.array([6.0, 3.0]), (1.0, 0.2))
    for row, alone in enumerate((sine(0.1, 10.0, 6.0, (1.0, 0.2)), sine(0.1, 2.0, 3.0, (1.0, 0.2)))):
        np.testing.assert_array_equal(together.command[row][:len(alone.time)], alone.command)
    assert (together.stop, together.begin) == (alone.stop, alone.begin)  # of the longest sine


def test_rows_of_staircase_and_load_ramp() -> None:
    stairs = staircase((0.0, 0.1, -0.1), (0.02, 0.05, 0.03), step=0.01)
    assert stairs.command.tolist() == [0.0] * 2 + [0.1] * 5 + [-0.1] * 4
    assert stairs.begin == pytest.approx(0.07)
    ramp = load_ramp(-10.0, 2.0).columns["aero_torque"]
    assert (ramp[0], ramp[-1]) == (0.0, -10.0)


@pytest.mark.parametrize("made", [step_to(0.1, 0.5), slew_to(0.1, 0.5), sweep(0.1, 1.0), sine(0.1, 7.0),
                                  load_ramp(1.0, 0.7), staircase((0.1,), (0.3,), step=0.02)])
def test_inputs_held_constant_change_no_other_column(made: Excitation) -> None:
    held = made.holding({"enable": False, "aero_torque": 5.0})
    assert all(len(column) == len(made.time) for column in held.columns.values())
    assert held.time.tolist() == made.time.tolist()
    assert (held.begin, held.title) == (made.begin, made.title)
    np.testing.assert_array_equal(held.command, made.command)
    assert set(held.columns["aero_torque"]) == {5.0}
    assert made.with_start_values({"a": 1}).start_values == {"a": 1}


def test_reference_cases_equal_the_cases_of_the_references() -> None:
    for case in CASES:
        made, inputs = reference_case(case.name), case.inputs()
        assert {name: column.tolist() for name, column in made.columns.items()} == {
            name: column.tolist() for name, column in inputs.items() if name != "time"}
        assert made.time == pytest.approx(inputs["time"], abs=1e-9)  # a file stores nine digits
        assert made.start_values == case.overrides
    assert reference_case("cold", exact=False).start_values == {"friction.temperature": -6.0}
    with pytest.raises(EmcasError, match="there is no case nonsense"):
        reference_case("nonsense")


def test_kinds_of_reference_cases_are_kinds_of_motions() -> None:
    assert {case.kind for case in CASES} <= {*MOTIONS, "square"}


def test_load_is_a_step_of_torque_on_a_fin_at_zero() -> None:
    load = motion("load", 0.0, 0.3, -40.0)
    assert not load.command.any()
    assert load.columns[LOAD].tolist() == [0.0] * 50 + [-40.0] * 301
    assert not load.moves


@pytest.mark.parametrize(("kind", "frequencies"), [
    ("leap", {}), ("step", {"frequency": 5.0}), ("sweep", {"hgih": 5.0})])
def test_unknown_kind_or_frequency_is_refused(kind: str, frequencies: dict[str, float]) -> None:
    with pytest.raises(EmcasError, match="sine frequency; sweep low high"):
        motion(kind, 0.1, 0.5, **frequencies)


@pytest.mark.parametrize("settle", [STEP, 0.2])
def test_slew_begins_at_zero_or_at_its_starting_end(settle: float) -> None:
    """A slew has one change of the command if its first row is at the starting end."""
    from_zero, placed = (motion("slew", 0.1, 0.3, settle=settle, first=first).command for first in (0.0, None))
    assert (from_zero[0], placed[0]) == (0.0, -0.1)
    np.testing.assert_array_equal(from_zero[1:], placed[1:])


def test_default_frequencies_are_those_of_the_kind() -> None:
    for kind in ("sine", "sweep"):
        made = motion(kind, 0.1, 0.5)
        np.testing.assert_array_equal(made.command, motion(kind, 0.1, 0.5, **EXCITATIONS[kind].defaults).command)
        assert np.ptp(made.command) > 0.1
