"""The data of a page's charts agree with the plots of Matplotlib."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.mathtext import MathTextParser

from emcas_fmu.plotting import plots
from emcas_fmu.plotting.curves import curves
from emcas_fmu.plotting.thinning import packed, thinned

# The resolution is 1/20000 of an axis: thinning changes a line by at most one, rounding by half a resolution.
FINEST = 1.5 / 20_000.0


def unpacked(values: list[Any]) -> np.ndarray[Any, Any]:
    """Return values as the script reads them: the number of decimals, then differences in the last decimal."""
    steps = [0 if step is None else step for step in values[1:]]
    read = np.cumsum(steps) * 10.0 ** -values[0]
    return np.where([step is None for step in values[1:]], np.nan, read)


@given(st.lists(st.one_of(st.floats(-2.0, 3.0), st.just(float("nan"))), min_size=2, max_size=60))
def test_thinned_and_packed_line_agrees_with_the_original(levels: list[float]) -> None:
    y = np.array(levels)
    x = np.linspace(0.0, 1.0, len(y))
    finite = np.isfinite(y)
    kept = thinned(x, y, finite)
    assert sorted(set(kept)) == kept
    along, up = x[kept], unpacked(packed(y[kept], False, (0.0, 1.0)))
    for i in np.flatnonzero(finite):
        right = int(np.searchsorted(kept, i))
        assert right < len(kept)
        level = up[right] if kept[right] == i else np.interp(
            x[i], along[right - 1:right + 1], up[right - 1:right + 1])
        assert abs(level - y[i]) <= FINEST
    gaps = np.flatnonzero(~finite)
    inner = [i for i in gaps if np.any(finite[:i]) and np.any(finite[i + 1:])]
    for i in inner:  # a gap remains a gap
        before, after = np.flatnonzero(finite[:i])[-1], i + 1 + np.flatnonzero(finite[i + 1:])[0]
        assert any(not finite[k] for k in kept if before < k < after)


def panel(figure: Any) -> dict[str, Any]:
    (made,) = json.loads(curves(figure))["panels"]
    return dict(made)


def test_data_of_lines_levels_bands_and_texts() -> None:
    with plots.style():
        made, ((axes,),) = plots.figure(1)
        time = np.linspace(0.0, 400.0, 2001)
        angle = 10.0 * (1.0 - np.exp(-time / 40.0))
        axes.plot(time, angle, label="fin angle")
        axes.axhline(10.0, label="required", **plots.LIMIT)
        axes.axvspan(20.0, 50.0, color=plots.GRAY, alpha=0.2)
        axes.text(0.5, 0.5, "<half>", transform=axes.transAxes)
        axes.set(xlabel="time [ms]", ylabel="fin angle [deg]", xlim=(0.0, 400.0))
        axes.legend()
        made.draw_without_rendering()
        drawn = panel(made)
        assert "<" not in curves(made)  # it would end the script element
    (line,), (level,), (band,), (word,) = drawn["lines"], drawn["levels"], drawn["bands"], drawn["texts"]
    assert (drawn["x"]["label"], drawn["y"]["label"]) == ("time [ms]", "fin angle [deg]")
    assert (line["name"], level["name"], word["text"]) == ("fin angle", "required", "<half>")
    assert (level["axis"], level["at"], band["axis"], band["ranges"]) == ("y", 10.0, "x", [[20.0, 50.0]])
    x, y = unpacked(line["x"]), unpacked(line["y"])
    assert len(x) < len(time) / 4
    assert np.max(np.abs(np.interp(time, x, y) - angle)) <= FINEST * np.ptp(axes.get_ylim())


@pytest.mark.drawn
@pytest.mark.parametrize("kind", ["bars", "image", "equal"])
def test_bars_images_and_equal_axes_remain_pictures(kind: str) -> None:
    with plots.style():
        made, ((axes,),) = plots.figure(1)
        if kind == "bars":
            axes.bar([1, 2], [3, 4])
        elif kind == "image":
            axes.imshow(np.eye(2))
        else:
            axes.plot([0, 1], [0, 1])
            axes.set_aspect("equal")
        assert curves(made) == ""
        assert plots.picture(made, "", "").svg


@pytest.mark.drawn
def test_logarithmic_axis_needs_no_formula_fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Matplotlib warns if these fonts are not installed."""
    monkeypatch.setattr(MathTextParser, "parse", lambda *_: pytest.fail("a text is a formula"))
    with plots.style():
        drawn, (axes,) = plots.column("y")
        axes.loglog([0.1, 1e5], [1.0, 5.0])
        text = plots.svg(drawn)
    assert all(f">{label}</text>" in text for label in ("0.1", "1000", "100000", "2"))
