"""A figure as data for the script that lets a reader zoom: the lines, levels, bands, areas and texts of its panels.

The data are read from Matplotlib's axes. A figure that contains anything else (an image, bars) stays a static picture.
"""

from __future__ import annotations

import json
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

from .thinning import Column, packed, rounded, share, thinned

INK = "#010203"
"""Placeholder for the page's text colour."""
_PIXELS = 4.0 / 3.0  # per typographic point


class _StaticError(Exception):
    """The figure contains something that the script cannot plot."""


def curves(plot: Figure) -> str:
    """Return the panels of a figure as JSON, or an empty string if the figure can only be a static picture."""
    shown = [axes for axes in plot.axes if axes.get_visible()]
    try:
        panels = [_panel(axes, plot) for axes in shown]
    except _StaticError:
        return ""
    if len({tuple(panel["place"]) for panel in panels}) < len(panels):  # overlapping axes
        return ""
    for axes, panel in zip(shown, panels, strict=True):
        for name, view in (("x", axes.get_shared_x_axes()), ("y", axes.get_shared_y_axes())):
            panel[name]["group"] = min(shown.index(each) for each in view.get_siblings(axes) if each in shown)
    document = {"panels": panels, "names": _legend(plot)}
    return json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def _panel(axes: Axes, plot: Figure) -> dict[str, Any]:
    cell = axes.get_subplotspec()
    if cell is None or len(cell.rowspan) > 1 or axes.get_aspect() != "auto" or axes.images or axes.tables:
        raise _StaticError
    grid, row, columns = cell.get_gridspec(), cell.rowspan.start, cell.colspan
    widths, heights = (np.ravel(ratios) for ratios in (grid.get_width_ratios(), grid.get_height_ratios()))
    height = float(plot.get_figheight() * heights[row] / heights.sum())
    panel: dict[str, Any] = {
        "place": [row, columns.start], "share": rounded(widths[columns.start:columns.stop].sum() / widths.sum(), 3),
        "height": round(height, 2), "title": axes.get_title("left") or axes.get_title(), "x": _axis(axes.xaxis),
        "y": _axis(axes.yaxis), "lines": [], "levels": [], "bands": [], "areas": [], "texts": []}
    contents = _Contents(axes, panel)
    for artist in sorted((*axes.lines, *axes.patches, *axes.collections), key=lambda each: each.get_zorder()):
        if artist.get_visible():
            contents.add(artist)
    panel["texts"] += [_text(text, axes) for text in axes.texts]
    return panel


def _axis(axis: Axis) -> dict[str, Any]:
    low, high = axis.get_view_interval()
    described: dict[str, Any] = {"label": axis.get_label_text(), "range": [rounded(low), rounded(high)]}
    if axis.get_scale() == "log":
        described["log"] = True
    elif axis.get_scale() != "linear":
        raise _StaticError
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    if isinstance(locator, FixedLocator):
        ticks = [float(at) for at in locator()]
        described["ticks"] = [ticks, formatter.format_ticks(ticks)]
        if isinstance(formatter, (FixedFormatter, FuncFormatter)) and not all(map(_numeric, described["ticks"][1])):
            described["words"] = True
    elif isinstance(formatter, NullFormatter):
        raise _StaticError
    return described


def _numeric(text: str) -> bool:
    try:
        float(text.replace("−", "-"))
    except ValueError:
        return False
    return True


class _Contents:
    """Adds the lines, levels, bands and areas of axes to a panel."""

    def __init__(self, axes: Axes, panel: dict[str, Any]) -> None:
        self.axes, self.panel = axes, panel
        # For x and y: whether the axis is logarithmic, and its limits, which set the rounding of values.
        self.scales = [(axis.get_scale() == "log", sorted(axis.get_view_interval()))
                       for axis in (axes.xaxis, axes.yaxis)]

    def add(self, artist: Artist) -> None:
        """Add a line, rectangle or filled area. Raises _StaticError for any other artist."""
        if isinstance(artist, Line2D):
            self._line(artist)
        elif isinstance(artist, (Rectangle, PolyCollection)):
            self._fill(artist)
        else:
            raise _StaticError

    def _line(self, line: Line2D) -> None:
        x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
        if not len(x):
            return  # the line is only an entry of the legend
        entry = {**_look(line), "name": _name(line)}
        in_x, in_y = _in_data(line.get_transform(), self.axes)
        if in_x and in_y:
            style = str(line.get_drawstyle())
            if style != "default":
                x, y = STEP_LOOKUP_MAP[style](x, y)
            if line.get_markevery() is not None and "marker" in entry:
                raise _StaticError
            self.panel["lines"].append({**entry, **self._points(x, y, "marker" in entry)})
        elif in_x != in_y:
            self.panel["levels"].append({**entry, "axis": "x" if in_x else "y",
                                         "at": rounded(float((x if in_x else y)[0]))})
        else:
            raise _StaticError

    def _points(self, x: Column, y: Column, markers: bool) -> dict[str, Any]:
        """Return a line's points: with `markers` those in the range of x; otherwise all, `thinned` if x never falls."""
        (log_x, limits_x), (log_y, limits_y) = self.scales
        finite = np.isfinite(x) & np.isfinite(y) & ~((x <= 0.0) & log_x) & ~((y <= 0.0) & log_y)
        along, up = share(x, log_x, limits_x), share(y, log_y, limits_y)
        rising = bool(np.all(np.diff(x[finite]) >= 0.0))
        rows = np.arange(len(x))
        if markers:
            rows = rows[finite & (along >= -1e-9) & (along <= 1.0 + 1e-9)]
        elif rising:
            rows = np.array(thinned(along, up, finite), dtype=int)
        points: dict[str, Any] = self._packed(np.where(finite, x, np.nan)[rows], np.where(finite, y, np.nan)[rows])
        return points if rising else {**points, "loop": True}

    def _packed(self, x: Column, y: Column) -> dict[str, Any]:
        return {name: packed(values, *scale) for name, values, scale in zip("xy", (x, y), self.scales, strict=True)}

    def _fill(self, artist: Rectangle | PolyCollection) -> None:
        """Add a filled range of one axis (a band), or an area between lines. Raises _StaticError for a bar."""
        if isinstance(artist, Rectangle):
            paths = [artist.get_patch_transform().transform_path(artist.get_path())]
        else:
            paths = list(artist.get_paths())
        in_x, in_y = _in_data(artist.get_transform(), self.axes)
        color = to_hex(np.atleast_2d(artist.get_facecolor())[0], keep_alpha=True)
        corners = [np.asarray(path.vertices) for path in paths]
        if in_x and in_y and not isinstance(artist, Rectangle):
            self.panel["areas"] += [{"color": color, **self._packed(each[:, 0], each[:, 1])} for each in corners]
        elif in_x != in_y:
            across = [each[:, 0 if in_x else 1] for each in corners]
            ranges = [[rounded(float(np.min(each))), rounded(float(np.max(each)))] for each in across]
            if ranges:
                self.panel["bands"].append({"axis": "x" if in_x else "y", "color": color, "ranges": ranges,
                                            "name": _name(artist)})
        else:  # a bar
            raise _StaticError


def _text(text: Any, axes: Axes) -> dict[str, Any]:
    """Return a text at a position in data or shares of the panel. Raises _StaticError for others and rotated texts."""
    x, y = text.get_position()
    words = {"text": text.get_text(), "align": text.get_ha(), "base": text.get_va(), "color": _color(text)}
    if hasattr(text, "xyann") or text.get_rotation():
        raise _StaticError
    if text.get_transform() == axes.transAxes:
        return {"share": [x, y], **words}
    if _in_data(text.get_transform(), axes) != (True, True):
        raise _StaticError
    return {"at": [rounded(float(x)), rounded(float(y))], **words}


def _in_data(transform: Transform, axes: Axes) -> tuple[bool, bool]:
    """Return whether x and whether y of a transform's input are in data units."""
    x, y = transform.contains_branch_seperately(axes.transData)
    return bool(x), bool(y)


def _color(artist: Any) -> str:
    color = to_hex(artist.get_color())
    if color == INK:
        color = ""
    alpha = artist.get_alpha()
    return color if alpha is None or alpha >= 1.0 or not color else f"{color}{round(255 * alpha):02x}"


def _look(line: Line2D) -> dict[str, Any]:
    """Return a line's colour, width, dashes and marker size [pixels]. Raises _StaticError for an invisible line."""
    look: dict[str, Any] = {"color": _color(line), "width": round(line.get_linewidth() * _PIXELS, 2)}
    marker = line.get_marker()
    if line.get_linestyle() in ("None", "none", " ", ""):
        look["width"] = 0
    else:
        dash = getattr(line, "_dash_pattern", (0, None))[1]  # matplotlib has no public access to it
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
    """Return an artist's label; empty if it has none."""
    label = str(artist.get_label() or "")
    return "" if label.startswith("_") else label


def _legend(plot: Figure) -> list[str]:
    """Return the labels of a figure's legends, in order."""
    legends = [*plot.legends, *filter(None, (axes.get_legend() for axes in plot.axes))]
    return list(dict.fromkeys(text.get_text() for legend in legends for text in legend.get_texts()))
