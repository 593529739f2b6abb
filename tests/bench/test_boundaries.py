"""Where the bench's inputs begin to be refused: the last value that is accepted, and the first that is not."""

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
from emcas_fmu.bench.measure import KINDS, REST, Test, histories
from emcas_fmu.bench.metrics import FIGURES
from emcas_fmu.bench.requirements import Requirement, load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import LEAD_IN, SETTLE, STEP
from emcas_fmu.parameters import load_parameters

FASTEST = 0.5 / STEP  # Hz, two rows a cycle
MOST = 1000

# A call with one free value, an accepted value, a refused one.
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
def test_the_last_that_is_accepted(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(excitation, "MOST_POINTS", MOST)
    call, accepted, refused = LIMITS[name]
    call(accepted)
    with pytest.raises(EmcasError):
        call(refused)


@pytest.mark.parametrize(("rows", "accepted"), [
    ("0,1\n0.01,2", True), ("0,1\n0,2\n0.01,2", True), ("-1e-9,1\n0.01,2", False), ("0.01,1\n0.009,2\n0.02,2", False),
    ("0,1\n0.01,nan", False), ("0,1\n0.01,inf", False), ("0,1\ninf,1", False), ("0,1\n0.01", False)])
def test_times_of_a_file(rows: str, accepted: bool, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text(f"time,fin_command\n{rows}\n", encoding="utf-8")
    if accepted:
        assert csv_file(path).stop == pytest.approx(0.01)
    else:
        with pytest.raises(EmcasError):
            csv_file(path)


@pytest.mark.parametrize("holds", [[1, 1], [3, 1], [2, 0, 5], [1, 4, 1]])
def test_each_row_of_a_staircase_has_the_level_of_its_time(holds: list[int]) -> None:
    """The last level lasts to the last row, which is at its end, however short it is."""
    levels = [0.1 * (k + 1) for k in range(len(holds))]
    made = staircase(levels, [STEP * count for count in holds])
    by_hand = [level for level, count in zip(levels, holds) for _ in range(count)]
    assert made.command.tolist() == [*by_hand, levels[-1]]
    assert made.begin == pytest.approx(STEP * sum(holds[:-1]))
    assert made.judged(made.time).sum() == holds[-1] + 1


@pytest.mark.parametrize("frequency", [2.0, 7.0, 8.0, 9.0, 40.0])
def test_a_sine_lasts_its_transient_and_its_cycles(frequency: float) -> None:
    """By default four cycles, and half a second at least; then six that are judged."""
    made = sine(0.1, frequency)
    assert made.stop == pytest.approx(max(4.0 / frequency, 0.5) + 6.0 / frequency, abs=0.51 * STEP)
    assert made.stop - made.begin == pytest.approx(6.0 / frequency, rel=1e-9)


def test_what_is_not_said_is_not_done() -> None:
    """No load, no spring, no change of parameters; the rest before the motion is that of the reference cases."""
    for made, begin in ((step_to(0.1, 0.2), LEAD_IN), (slew_to(0.1, 0.2), SETTLE), (sweep(0.1, 0.2), LEAD_IN)):
        assert list(made.columns) == ["fin_command"]
        assert (made.begin, made.step, made.spring, dict(made.start_values)) == (begin, STEP, 0.0, {})


def test_worse_is_a_sign() -> None:
    """Of a figure larger is worse, or smaller; by how much is not for `bad` to say."""
    assert {abs(figure.bad) for figure in FIGURES.values()} == {1.0}


@pytest.mark.parametrize("kind", KINDS)
def test_a_test_without_settings(kind: str) -> None:
    """It is at rest, unloaded, at the full supply; what it simulates is both directions of all that it commands."""
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


# A setting of a test in a file of requirements: least, most, and by how much beyond is refused.
SETTINGS: dict[str, tuple[float, float, float, str]] = {
    "duration": (0.3, 100.0, 1e-4, "s"), "settle": (STEP, 100.0, 1e-6, "s"), "supply": (0.1, 2.0, 1e-4, "")}
NEEDED = {"amplitude": "amplitude = '5 deg'", "torque": "torque = '50 N.m'"}
HAS = {"step": ("amplitude", "duration", "supply"), "slew": ("amplitude", "duration", "supply", "settle"),
       "load": ("torque", "duration", "supply"), "release": ("torque", "duration", "supply", "settle"),
       "sine": ("amplitude",), "linear": (), "repeat": ("amplitude", "torque", "duration")}


def required(folder: Path, test: str, figure: str, limit: str = "maximum = 1") -> Requirement:
    """Return a requirement as it is read from a file."""
    path = folder / "mine.toml"
    path.write_text(f"[[requirements]]\nname = 'x'\ntest = {{ {test} }}\nfigure = '{figure}'\n{limit}\n",
                    encoding="utf-8")
    (requirement,) = load_requirements(path, load_parameters()).requirements
    return requirement


@pytest.mark.parametrize("kind", KINDS)
def test_settings_of_a_file(kind: str, tmp_path: Path) -> None:
    """Those that are not there are as of a test without them; the least and the most of each are accepted."""
    needed = [NEEDED[name] for name in HAS[kind] if name in NEEDED]
    unit = FIGURES[KINDS[kind][0]].unit
    limit = f"maximum = '20 {unit}'"

    def made(*settings: str) -> Test | None:
        return required(tmp_path, ", ".join((f"kind = '{kind}'", *needed, *settings)), KINDS[kind][0], limit).test

    plain = made()
    given = {name: value for name, value in (("amplitude", radians(5.0)), ("torque", 50.0)) if NEEDED[name] in needed}
    assert plain == Test(kind, **given)
    for name in set(SETTINGS) & set(HAS[kind]):
        least, most, beyond, suffix = SETTINGS[name]
        for accepted in (least, most):
            assert made(f"{name} = '{accepted!r} {suffix}'") == Test(kind, **given, **{name: accepted})
        for refused in (least - beyond, most + beyond):
            with pytest.raises(EmcasError, match=name):
                made(f"{name} = '{refused!r} {suffix}'")


def test_amplitudes_and_limits_of_a_file(tmp_path: Path) -> None:
    """An amplitude is above zero and up to the command's limit, a torque not zero, a limit above zero."""
    most = ParameterSubject(load_parameters()).command_limit
    for setting, figure, limit in ((f"kind = 'step', amplitude = '{most!r} rad'", "rise_time", "1 s"),
                                   ("kind = 'step', amplitude = '1e-6 rad'", "rise_time", "1e-9 s"),
                                   ("kind = 'load', torque = '-1e-6 N.m'", "ripple", "1 deg")):
        required(tmp_path, setting, figure, f"maximum = '{limit}'")
    for setting, figure, limit in ((f"kind = 'step', amplitude = '{most * 1.00001!r} rad'", "rise_time", "1 s"),
                                   ("kind = 'step', amplitude = '0 rad'", "rise_time", "1 s"),
                                   ("kind = 'step', amplitude = '1 deg'", "rise_time", "0 s"),
                                   ("kind = 'load', torque = '0 N.m'", "ripple", "1 deg")):
        with pytest.raises(EmcasError):
            required(tmp_path, setting, figure, f"maximum = '{limit}'")


@pytest.mark.parametrize(("sense", "side"), [("maximum", 1.0), ("minimum", -1.0)])
def test_equal_to_a_limit_is_kept(sense: str, side: float, tmp_path: Path) -> None:
    """Compared in the unit that people read, with nine decimals: rounding of a conversion is not a miss, more is."""
    r = required(tmp_path, "kind = 'step', amplitude = '5 deg'", "steady_error", f"{sense} = '0.3 deg'")
    beyond = np.radians(side * np.array([0.0, 4e-10, 6e-10, 0.1]))
    assert r.kept(radians(0.3) + beyond).tolist() == [True, True, False, False]
    assert r.kept(radians(0.3) - beyond).all()
    assert not r.kept(np.array([np.nan, np.inf, -np.inf])).any()
