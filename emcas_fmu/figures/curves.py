"""A figure as data: the lines, levels, bands and words in its panels, for the script that lets a reader zoom and read.

Taken from Matplotlib's axes as they were drawn, so that no picture says anything twice. A figure with something else in
it (an image, bars, contours) has no such form and stays a picture.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cbook import STEP_LOOKUP_MAP
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter, NullFormatter
from matplotlib.transforms import Transform

from .thinning import Values, packed, rounded, share, thinned

INK = "#010203"
"""Stands for the page's own text colour, which it is replaced by."""
_PIXELS = 4.0 / 3.0  # of a point


class _StaticError(Exception):
    """Something is drawn that has no form as data."""


def curves(drawn: Figure) -> str:
    """Return the panels of a figure as JSON; empty where something in it has none."""
    shown = [axes for axes in drawn.axes if axes.get_visible()]
    try:
        panels = [_panel(axes, drawn) for axes in shown]
    except _StaticError:
        return ""
    if len({tuple(panel["place"]) for panel in panels}) < len(panels):  # two axes in one place
        return ""
    for names in _groups(shown, "x"), _groups(shown, "y"):
        for panel, (which, group) in zip(panels, names, strict=True):
            panel[which]["group"] = group
    document = {"panels": panels, "names": _legend(drawn)}
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def _groups(shown: Sequence[Axes], which: str) -> list[tuple[str, int]]:
    """Return which axes share an axis: the number of the first of them."""
    views = [axes.get_shared_x_axes() if which == "x" else axes.get_shared_y_axes() for axes in shown]
    return [(which, min(shown.index(other) for other in view.get_siblings(axes) if other in shown))
            for axes, view in zip(shown, views, strict=True)]


def _panel(axes: Axes, drawn: Figure) -> dict[str, Any]:
    place = axes.get_subplotspec()
    if place is None or axes.get_aspect() != "auto" or axes.images or axes.tables:
        raise _StaticError
    grid = place.get_gridspec()
    row, column = place.rowspan.start, place.colspan.start
    if len(place.rowspan) > 1:
        raise _StaticError
    widths: list[float] = list(np.ravel(grid.get_width_ratios()))
    heights: list[float] = list(np.ravel(grid.get_height_ratios()))
    height = drawn.get_figheight() * heights[row] / sum(heights)
    panel: dict[str, Any] = {
        "place": [row, column], "share": rounded(sum(widths[column:place.colspan.stop]) / sum(widths), 3),
        "height": round(height, 2), "title": axes.get_title("left") or axes.get_title(), "x": _axis(axes.xaxis),
        "y": _axis(axes.yaxis), "lines": [], "levels": [], "bands": [], "areas": [], "texts": []}
    frame = _Frame(axes)
    for artist in sorted((*axes.lines, *axes.patches, *axes.collections), key=lambda each: each.get_zorder()):
        if artist.get_visible():
            frame.add(artist, panel)
    for text in axes.texts:
        panel["texts"].append(frame.text(text))
    return panel


def _axis(axis: Axis) -> dict[str, Any]:
    low, high = axis.get_view_interval()
    made: dict[str, Any] = {"label": axis.get_label_text(), "range": [rounded(low), rounded(high)]}
    if axis.get_scale() == "log":
        made["log"] = True
    elif axis.get_scale() != "linear":
        raise _StaticError
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if isinstance(locator, FixedLocator):
        ticks = [float(at) for at in locator()]
        made["ticks"] = [ticks, formatter.format_ticks(ticks)]
        if isinstance(formatter, (FixedFormatter, FuncFormatter)) and not all(map(_numeric, made["ticks"][1])):
            made["words"] = True
    elif isinstance(formatter, NullFormatter):
        raise _StaticError
    return made


def _numeric(text: str) -> bool:
    try:
        float(text.replace("−", "-"))
    except ValueError:
        return False
    return True


class _Frame:
    """The ranges of a panel's axes, by which values are rounded and lines thinned."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.scales = [(axis.get_scale() == "log", sorted(axis.get_view_interval()))
                       for axis in (axes.xaxis, axes.yaxis)]

    def add(self, artist: Artist, panel: dict[str, Any]) -> None:
        """Put an artist into the panel. Raises _StaticError."""
        if isinstance(artist, Line2D):
            self._line(artist, panel)
        elif isinstance(artist, (Rectangle, PolyCollection)):
            self._fill(artist, panel)
        else:
            raise _StaticError

    def _line(self, line: Line2D, panel: dict[str, Any]) -> None:
        x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
        if not len(x):
            return  # an entry of the legend
        look = _look(line)
        name = _name(line)
        along_x, along_y = _of_data(line.get_transform(), self.axes)
        if not (along_x and along_y):
            if along_x == along_y:
                raise _StaticError
            panel["levels"].append({**look, "name": name, "axis": "x" if along_x else "y",
                                    "at": rounded(float((x if along_x else y)[0]))})
            return
        style = str(line.get_drawstyle())
        if style != "default":
            x, y = STEP_LOOKUP_MAP[style](x, y)
        if line.get_markevery() is not None and "marker" in look:
            raise _StaticError
        points = self._points(x, y, keep="marker" in look)
        panel["lines"].append({**look, "name": name, **points})

    def _points(self, x: Values, y: Values, keep: bool) -> dict[str, Any]:
        (log_x, limits_x), (log_y, limits_y) = self.scales
        finite = np.isfinite(x) & np.isfinite(y) & ~((x <= 0.0) & log_x) & ~((y <= 0.0) & log_y)
        along, up = share(x, log_x, limits_x), share(y, log_y, limits_y)
        rising = bool(np.all(np.diff(x[finite]) >= 0.0))
        chosen = np.arange(len(x))
        if rising and not keep:
            chosen = np.array(thinned(along, up, finite), dtype=int)
        elif keep:
            chosen = chosen[finite & (along >= -1e-9) & (along <= 1.0 + 1e-9)]
        points: dict[str, Any] = {"x": packed(np.where(finite, x, np.nan)[chosen], log_x, limits_x),
                                  "y": packed(np.where(finite, y, np.nan)[chosen], log_y, limits_y)}
        return points if rising else {**points, "loop": True}

    def _fill(self, artist: Rectangle | PolyCollection, panel: dict[str, Any]) -> None:
        """Add what fills a range of one axis, or an area between lines."""
        if isinstance(artist, Rectangle):
            paths = [artist.get_patch_transform().transform_path(artist.get_path())]
        else:
            paths = list(artist.get_paths())
        along_x, along_y = _of_data(artist.get_transform(), self.axes)
        color = to_hex(np.atleast_2d(artist.get_facecolor())[0], keep_alpha=True)
        corners = [np.asarray(path.vertices) for path in paths]
        if along_x and along_y:
            if isinstance(artist, Rectangle):  # a bar
                raise _StaticError
            for each in corners:
                (log_x, limits_x), (log_y, limits_y) = self.scales
                panel["areas"].append({"color": color, "x": packed(each[:, 0], log_x, limits_x),
                                       "y": packed(each[:, 1], log_y, limits_y)})
            return
        if along_x == along_y:
            raise _StaticError
        across = 0 if along_x else 1
        ranges = [[rounded(float(np.min(each[:, across]))), rounded(float(np.max(each[:, across])))]
                  for each in corners]
        if ranges:
            panel["bands"].append({"axis": "x" if along_x else "y", "color": color, "ranges": ranges,
                                   "name": _name(artist)})

    def text(self, text: Any) -> dict[str, Any]:
        """Return a word at its place, in the panel's data. Raises _StaticError."""
        along = _of_data(text.get_transform(), self.axes)
        if hasattr(text, "xyann") or text.get_rotation():
            raise _StaticError
        x, y = text.get_position()
        if along == (False, False) and text.get_transform() == self.axes.transAxes:
            return {"share": [x, y], **_words(text)}
        if along != (True, True):
            raise _StaticError
        return {"at": [rounded(float(x)), rounded(float(y))], **_words(text)}


def _words(text: Any) -> dict[str, Any]:
    return {"text": text.get_text(), "align": text.get_ha(), "base": text.get_va(), "color": _color(text)}


def _of_data(transform: Transform, axes: Axes) -> tuple[bool, bool]:
    """Return for x and y whether a transform takes data to the screen."""
    x, y = transform.contains_branch_seperately(axes.transData)
    return bool(x), bool(y)


def _color(artist: Any) -> str:
    color = to_hex(artist.get_color())
    if color == INK:
        color = ""
    alpha = artist.get_alpha()
    return color if alpha is None or alpha >= 1.0 or not color else f"{color}{round(255 * alpha):02x}"


def _look(line: Line2D) -> dict[str, Any]:
    """Return how a line is drawn, in pixels."""
    look: dict[str, Any] = {"color": _color(line), "width": round(line.get_linewidth() * _PIXELS, 2)}
    marker = line.get_marker()
    if line.get_linestyle() in ("None", "none", " ", ""):
        look["width"] = 0
    else:
        dash = getattr(line, "_dash_pattern", (0, None))[1]  # matplotlib gives it by no other way
        if dash:
            look["dash"] = [round(length * _PIXELS, 1) for length in dash]
    if marker not in ("None", "none", " ", "", None):
        look["marker"] = round(max(line.get_markersize() * (0.5 if marker == "." else 1.0), 2.0) * _PIXELS, 1)
        if line.get_fillstyle() == "none" or line.get_markerfacecolor() in ("none", "None"):
            look["hollow"] = True
    elif not look["width"]:
        raise _StaticError
    return look


def _name(artist: Artist) -> str:
    """Return the name of what is drawn; empty where it has no label."""
    label = str(artist.get_label() or "")
    return "" if label.startswith("_") else label


def _legend(drawn: Figure) -> list[str]:
    """Return the names in the order of the legends."""
    legends = [*drawn.legends, *filter(None, (axes.get_legend() for axes in drawn.axes))]
    return list(dict.fromkeys(text.get_text() for legend in legends for text in legend.get_texts()))
