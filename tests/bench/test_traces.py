"""Plots of outputs over time (points, windows, units, shading), and of frequency responses."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from emcas_fmu.bench.frequency_response import FrequencyResponse
from emcas_fmu.plotting import plots, traces

TIME = np.arange(11) * 0.1
COLUMNS = {"time": TIME, "fin_angle": np.radians(TIME), "fin_command": np.radians(TIME), "motor_current": 2.0 * TIME,
           "saturated": (TIME > 0.45).astype(float), "error": np.full(11, radians(1e-3))}


def points(line: Line2D) -> tuple[Any, Any]:
    x, y = (np.asarray(values, dtype=float) for values in line.get_data())
    return x, y


def panel(name: str) -> Axes:
    with plots.style():
        return traces.panels([name])[1][0][name]


@pytest.mark.parametrize(("name", "label", "last"), [
    ("fin_angle", "fin angle [deg]", 1.0), ("motor_current", "current [A]", 2.0), ("error", "error [mdeg]", 1.0)])
def test_variable_is_plotted_in_the_unit_of_its_panel(name: str, label: str, last: float) -> None:
    axes = panel(name)
    traces.trace(axes, COLUMNS, name, label="fin")
    assert axes.get_ylabel() == label
    (line,) = axes.lines
    x, y = points(line)
    assert (x[-1], y[-1], line.get_label()) == (pytest.approx(1.0), pytest.approx(last), "fin")


def test_window_includes_both_ends_and_every_nth_point() -> None:
    axes = panel("fin_angle")
    # The row at 3 * 0.1 = 0.30000000000000004 s is inside.
    traces.trace(axes, COLUMNS, "fin_angle", (0.1, 0.3))
    traces.trace(axes, COLUMNS, "fin_angle", (0.2, 1.0), zero=0.2, unit=1e3, every=4)
    assert [points(line)[0] for line in axes.lines] == [
        pytest.approx([0.1, 0.2, 0.3]), pytest.approx([0.0, 400.0, 800.0])]


def test_command_is_plotted_in_steps() -> None:
    axes = panel("fin_angle")
    traces.trace(axes, COLUMNS, "fin_command", linewidth=0.5)
    (line,) = axes.lines
    assert (line.get_drawstyle(), line.get_label(), line.get_linewidth()) == ("steps-post", "command", 0.5)


def test_long_trace_is_thinned() -> None:
    axes, time = panel("fin_angle"), np.arange(20_001) * 1e-3
    traces.trace(axes, {"time": time, "fin_angle": time}, "fin_angle")
    assert 6000 <= len(points(axes.lines[0])[0]) <= 7000


def test_times_with_a_flag_are_shaded() -> None:
    axes = panel("fin_angle")
    traces.shade(axes, COLUMNS, "saturated", (0.0, 0.8), "a limit is active")
    (area,) = axes.collections
    across = np.concatenate([np.asarray(path.vertices)[:, 0] for path in area.get_paths()])
    assert (across.min(), across.max()) == (pytest.approx(0.5), pytest.approx(0.8))


def test_frequency_response_marks_bandwidth_and_required_frequency() -> None:
    frequency = np.geomspace(0.5, 24.0, 50)
    response = FrequencyResponse(frequency, 1.0 / np.hypot(1.0, frequency / 10.0), -np.arctan(frequency / 10.0),
                                 np.ones(50))
    with plots.style():
        made = plots.frequency_responses([(response, (10.0, np.inf), {"color": plots.BLUE, "label": "1 deg"})],
                                         [10.0, 10.0])
    gain, phase, coherence = made.axes
    dots = [line for line in gain.lines if line.get_marker() == "o"]
    assert [tuple(map(float, np.ravel(points(line)))) for line in dots] == [(10.0, -3.0)]
    for axes in (gain, phase):
        assert [points(line)[0][0] for line in axes.lines if line.get_label() == "required 10 Hz"] == [10.0]
    assert points(coherence.lines[0])[1] == pytest.approx(1.0)
