"""Limits of the bench's inputs: a value on the limit is accepted, a value beyond it is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench import excitation
from emcas_fmu.bench.excitation import (
    Excitation,
    check_span,
    csv_file,
    sine,
    sine_from_rest,
    slew_to,
    staircase,
    step_to,
    sweep,
    times,
)
from emcas_fmu.bench.measure import REST, TESTS, Test, histories
from emcas_fmu.bench.metrics import FIGURES
from emcas_fmu.bench.requirements import Requirement, load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import LEAD_IN, SETTLE, STEP
from emcas_fmu.parameters import load_parameters

FASTEST = 0.5 / STEP  # Hz, two rows per cycle
MOST = 1000  # rows

# Name: function of one value, an accepted value, a refused value.
LIMITS: dict[str, tuple[Callable[[Any], Any], Any, Any]] = {
    "half a step": (lambda x: times(x, 1.0), 0.51, 0.5), "most rows": (lambda x: times(x, 0.5), 0.5 * MOST, 501.0),
    "no step": (lambda x: times(1.0, x), 1e-2, 0.0), "no hold": (lambda x: step_to(0.1, x), 0.0, -1e-9),
    "no settling": (lambda x: slew_to(0.1, 0.3, settle=x), 0.0, -1e-9),
    "duration of a sweep": (lambda x: sweep(0.1, x, 1.0, 2.0), 1e-9, 0.0),
    "lowest of a sweep": (lambda x: sweep(0.1, 0.5, x, 9.0), 1e-9, 0.0),
    "order of a sweep": (lambda x: sweep(0.1, 0.5, x, 9.0), 8.999, 9.0),
    "highest of a sweep": (lambda x: sweep(0.1, 0.5, 1.0, x), FASTEST, FASTEST * 1.001),
    "slowest sine": (lambda x: sine(0.1, x), 20.0, 0.0), "fastest sine": (lambda x: sine(0.1, x), FASTEST, 501.0),
    "one of several sines": (lambda x: sine(0.1, np.array([20.0, x])), FASTEST, 501.0),
    "infinite sine": (lambda x: sine(0.1, 50.0, x), 0.5, np.inf), "no cycles": (lambda x: sine(0.1, 50.0, x), 0.1, 0.0),
    "no sines": (lambda x: sine(0.1, x), np.array([20.0]), np.array([])),
    "sines in a table": (lambda x: sine(0.1, x), np.array([20.0]), np.array([[20.0]])),
    "cycles of each sine": (lambda x: sine(0.1, np.array([20.0, 30.0]), x), np.array([3.0, 4.0]), np.array([3.0])),
    "transient in cycles": (lambda x: sine(0.1, 20.0, settle=(x, 0.1)), 0.0, -1e-9),
    "transient in seconds": (lambda x: sine(0.1, 20.0, settle=(1.0, x)), 0.0, -1e-9),
    "sine from rest": (lambda x: sine_from_rest(0.1, x, 0.2), FASTEST, 501.0),
    "hold of a stair": (lambda x: staircase([0.1, 0.2], [x, 0.1]), 0.0, -1e-9),
    "stairs and holds": (lambda x: staircase([0.1, 0.2], x), [0.1, 0.1], [0.1]),
    "rows of a column": (lambda x: Excitation("x", {"fin_command": np.zeros(x)}), 2, 1),
    "rows of another": (lambda x: Excitation("x", {"fin_command": np.zeros(3), "aero_torque": np.zeros(x)}), 3, 4),
    "step of rows": (lambda x: Excitation("x", {"fin_command": np.zeros(3)}, step=x), 1e-9, 0.0),
    "least span": (lambda x: check_span("x", 0.5, x), 0.5, 0.0),
    "span of most rows": (lambda x: check_span("x", 0.5, x), 0.5 * MOST, 0.5 * MOST + 0.5),
    "whole steps up": (lambda x: check_span("x", 0.5, x), 1.0 + 4e-7, 1.0 + 6e-7),
    "whole steps down": (lambda x: check_span("x", 0.5, x), 1.0 - 4e-7, 1.0 - 6e-7)}


@pytest.mark.parametrize("name", LIMITS)
def test_value_on_the_limit_is_accepted_and_beyond_it_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(excitation, "MOST_POINTS", MOST)
    call, accepted, refused = LIMITS[name]
    call(accepted)
    with pytest.raises(EmcasError):
        call(refused)


@pytest.mark.parametrize(("rows", "accepted"), [
    ("0,1\n0.01,2", True), ("0,1\n0,2\n0.01,2", True), ("-1e-9,1\n0.01,2", False), ("0.01,1\n0.009,2\n0.02,2", False),
    ("0,1\n0.01,nan", False), ("0,1\n0.01,inf", False), ("0,1\ninf,1", False), ("0,1\n0.01", False)])
def test_times_of_a_file_must_begin_at_zero_and_not_decrease(rows: str, accepted: bool, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(f"time,fin_command\n{rows}\n", encoding="utf-8")
    if accepted:
        assert csv_file(path).stop == pytest.approx(0.01)
    else:
        with pytest.raises(EmcasError):
            csv_file(path)


@pytest.mark.parametrize("holds", [[1, 1], [3, 1], [2, 0, 5], [1, 4, 1]])
def test_each_row_of_a_staircase_has_the_level_of_its_time(holds: list[int]) -> None:
    """The last row, at the end of the last hold, still has the last level."""
    levels = [0.1 * (k + 1) for k in range(len(holds))]
    made = staircase(levels, [STEP * count for count in holds])
    by_hand = [level for level, count in zip(levels, holds) for _ in range(count)]
    assert made.command.tolist() == [*by_hand, levels[-1]]
    assert made.begin == pytest.approx(STEP * sum(holds[:-1]))
    assert made.judged(made.time).sum() == holds[-1] + 1


@pytest.mark.parametrize("frequency", [2.0, 7.0, 8.0, 9.0, 40.0])
def test_duration_of_a_sine_is_its_transient_and_its_judged_cycles(frequency: float) -> None:
    """The default transient is four cycles, at least half a second; six cycles are judged."""
    made = sine(0.1, frequency)
    assert made.stop == pytest.approx(max(4.0 / frequency, 0.5) + 6.0 / frequency, abs=0.51 * STEP)
    assert made.stop - made.begin == pytest.approx(6.0 / frequency, rel=1e-9)


def test_default_excitation_has_no_load_spring_or_changed_parameter() -> None:
    for made, begin in ((step_to(0.1, 0.2), LEAD_IN), (slew_to(0.1, 0.2), SETTLE), (sweep(0.1, 0.2), LEAD_IN)):
        assert list(made.columns) == ["fin_command"]
        assert (made.begin, made.step, made.spring, dict(made.start_values)) == (begin, STEP, 0.0, {})


def test_bad_of_a_figure_is_plus_or_minus_one() -> None:
    assert {abs(figure.bad) for figure in FIGURES.values()} == {1.0}


@pytest.mark.parametrize("kind", TESTS)
def test_default_test_is_unloaded_at_full_supply(kind: str) -> None:
    """The simulated time counts both directions."""
    test = Test(kind)
    assert (test.amplitude, test.torque, test.settle, test.supply) == (0.0, 0.0, SETTLE, 1.0)
    assert "against" not in str(test)
    assert "supply" not in str(test)
    longer = Test(kind, duration=test.duration + 1.0, settle=test.settle + 1.0)
    more = {"linear": 0.0, "sine": 0.0, "repeat": 6.0}.get(kind, 4.0)
    assert longer.simulated - test.simulated == pytest.approx(more)
    assert (test.simulated == 0.0) == (kind == "linear")


def test_duration_of_the_history_of_use() -> None:
    """The slews that are judged begin after the history of use and the rest; both runs count as simulated time."""
    subject, test = ParameterSubject(load_parameters()), Test("repeat", 0.1, torque=1.0)
    used, _ = histories(test, subject, dict.fromkeys(subject.inputs, 0.0))
    assert used.begin == pytest.approx(7.0 + REST, abs=2.0 * STEP)
    assert test.simulated == pytest.approx(2.0 * (used.begin + 3.0 * test.duration), abs=4.0 * STEP)


# Setting of a test in a file of requirements: least and greatest value, how far beyond a value is refused, unit.
SETTINGS: dict[str, tuple[float, float, float, str]] = {
    "duration": (0.01, 300.0, STEP, "s"), "settle": (STEP, 300.0, STEP, "s"), "supply": (0.1, 2.0, 1e-4, "")}
REQUIRED = {"amplitude": "amplitude = '5 deg'", "torque": "torque = '50 N.m'"}
HAS = {"step": ("amplitude", "duration", "supply"), "slew": ("amplitude", "duration", "supply", "settle"),
       "load": ("torque", "duration", "supply"), "release": ("torque", "duration", "supply", "settle"),
       "sine": ("amplitude",), "linear": (), "repeat": ("amplitude", "torque", "duration")}


def requirement(folder: Path, test: str, figure: str, limit: str) -> Requirement:
    """Write a file with one requirement and return the requirement as read from it."""
    path = folder / "mine.toml"
    path.write_text(f"[[requirements]]\nname = 'x'\ntest = {{ {test} }}\nfigure = '{figure}'\n{limit}\n",
                    encoding="utf-8")
    (only,) = load_requirements(path, load_parameters()).requirements
    return only


@pytest.mark.parametrize("kind", TESTS)
def test_range_of_each_setting_of_a_test(kind: str, tmp_path: Path) -> None:
    """Missing settings have the defaults of Test. The least and greatest value are accepted, values beyond refused."""
    figure = TESTS[kind].figures[0]
    unit = FIGURES[figure].unit
    required = {name: value for name, value in (("amplitude", radians(5.0)), ("torque", 50.0)) if name in HAS[kind]}
    texts = [f"kind = '{kind}'", *(REQUIRED[name] for name in required)]

    def read(*settings: str) -> Test | None:
        return requirement(tmp_path, ", ".join((*texts, *settings)), figure, f"maximum = '20 {unit}'").test

    assert read() == Test(kind, **required)
    for name in set(SETTINGS) & set(HAS[kind]):
        least, greatest, beyond, suffix = SETTINGS[name]
        for accepted in (least, greatest):
            assert read(f"{name} = '{accepted!r} {suffix}'") == Test(kind, **required, **{name: accepted})
        for refused in (least - beyond, greatest + beyond):
            with pytest.raises(EmcasError, match=name):
                read(f"{name} = '{refused!r} {suffix}'")


def test_range_of_amplitude_torque_and_limit(tmp_path: Path) -> None:
    """An amplitude must be above zero and within the command limit, a torque not zero, and a limit above zero."""
    most = ParameterSubject(load_parameters()).command_limit
    for test, figure, limit in ((f"kind = 'step', amplitude = '{most!r} rad'", "rise_time", "1 s"),
                                ("kind = 'step', amplitude = '1e-6 rad'", "rise_time", "1e-9 s"),
                                ("kind = 'load', torque = '-1e-6 N.m'", "ripple", "1 deg"),
                                ("kind = 'slew', amplitude = '1 deg', torque = '1e6 N.m'", "rise_time", "1 s")):
        requirement(tmp_path, test, figure, f"maximum = '{limit}'")
    for test, figure, limit in ((f"kind = 'step', amplitude = '{most * 1.00001!r} rad'", "rise_time", "1 s"),
                                ("kind = 'step', amplitude = '0 rad'", "rise_time", "1 s"),
                                ("kind = 'step', amplitude = '1 deg'", "rise_time", "0 s"),
                                ("kind = 'load', torque = '0 N.m'", "ripple", "1 deg"),
                                ("kind = 'repeat', amplitude = '1 deg', torque = '0 N.m'", "repeat_error", "1 deg"),
                                ("kind = 'slew', amplitude = '1 deg', torque = '1.001e6 N.m'", "rise_time", "1 s"),
                                ("kind = 'load', torque = '-1.001e6 N.m'", "ripple", "1 deg")):
        with pytest.raises(EmcasError):
            requirement(tmp_path, test, figure, f"maximum = '{limit}'")


@pytest.mark.parametrize(("sense", "side"), [("maximum", 1.0), ("minimum", -1.0)])
def test_value_equal_to_the_limit_meets_it(sense: str, side: float, tmp_path: Path) -> None:
    """Value and limit are compared in the displayed unit with nine decimals: conversions may round."""
    r = requirement(tmp_path, "kind = 'step', amplitude = '5 deg'", "steady_error", f"{sense} = '0.3 deg'")
    beyond = np.radians(side * np.array([0.0, 4e-10, 6e-10, 0.1]))
    assert r.kept(radians(0.3) + beyond).tolist() == [True, True, False, False]
    assert r.kept(radians(0.3) - beyond).all()
    assert not r.kept(np.array([np.nan, np.inf, -np.inf])).any()
