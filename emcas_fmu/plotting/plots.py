"""The style of all pictures, and figures as inline SVG: the same figure gives the same bytes.

Figures are made without pyplot, which has global state. In a figure made in `style()`, frame and text have the text
colour of the page: one picture serves light pages, dark pages and print.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.style
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogFormatterMathtext

from ..support.writing import whole
from . import check_image
from .curves import INK as INK
from .curves import curves

# Okabe & Ito (2008), "Color universal design": distinguishable with every common colour blindness. Black and
# yellow are left out because they vanish on a dark or a light page.
BLUE, VERMILLION, GREEN, SKY, ORANGE, PURPLE = "#0072b2", "#d55e00", "#009e73", "#56b4e9", "#e69f00", "#cc79a7"
COLORS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
GRAY = "#8a8f98"
# Matplotlib lays out text in DejaVu Sans. The other fonts are not wider, so no text is cut.
FONTS = "'DejaVu Sans', Verdana, 'Liberation Sans', Arial, Helvetica, sans-serif"
COMMAND_STYLE: Mapping[str, Any] = {"color": GRAY, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 1.5}
LIMIT: Mapping[str, Any] = {"color": GRAY, "linewidth": 0.9, "linestyle": (0, (1, 1.2)), "zorder": 1.5}
REQUIRED: Mapping[str, Any] = {**LIMIT, "color": PURPLE, "linewidth": 1.1}

_STYLE: Mapping[str, Any] = {
    "font.size": 9.0, "axes.titlesize": 9.5, "axes.labelsize": 9.0, "legend.fontsize": 8.0,
    "axes.titlelocation": "left",
    "axes.edgecolor": INK, "axes.labelcolor": INK, "axes.titlecolor": INK, "text.color": INK,
    "xtick.color": INK, "ytick.color": INK, "axes.linewidth": 0.7, "lines.linewidth": 1.3,
    "axes.facecolor": "none", "figure.facecolor": "none", "savefig.facecolor": "none",
    "axes.grid": True, "grid.color": GRAY, "grid.alpha": 0.3, "grid.linewidth": 0.5,
    "legend.frameon": False, "legend.labelcolor": INK, "axes.spines.top": False, "axes.spines.right": False,
    "axes.formatter.useoffset": False,
}


@contextmanager
def style() -> Iterator[None]:
    """Apply the common style to figures made within the context."""
    with mpl.rc_context(), mpl.style.context(["default", {**_STYLE, "axes.prop_cycle": cycler(color=COLORS)}]):
        yield


def figure(rows: int, columns: int = 1, *, width: float = 9.0, height: float = 2.2, x: str = "",
           y: Iterable[str] = (), **more: Any) -> tuple[Figure, Any]:
    """Return a figure and its axes, an array [row, column]; call it inside `style()`.

    `width` is that of the figure, `height` that of a row, in inches. `x` is the label below each column, `y` are the
    labels at the left of the rows. `more` are arguments of Matplotlib's subplots.
    """
    empty = Figure(figsize=(width, height * rows), layout="constrained")
    grid = empty.subplots(rows, columns, squeeze=False, **more)
    for axes in grid[-1]:
        axes.set_xlabel(x)
    for axes, label in zip(grid[:, 0], y, strict=False):
        axes.set_ylabel(label)
    return empty, grid


def column(*y: str, x: str = "", **more: Any) -> tuple[Figure, Any]:
    """Return a figure and its axes: one column of panels with the labels `y` over a common axis `x`; see `figure`."""
    empty, grid = figure(len(y), x=x, y=y, **{"sharex": True, **more})
    return empty, grid[:, 0]


def panel_grid(count: int, columns: int, x: str = "", **more: Any) -> tuple[Figure, list[Any]]:
    """Return a figure and its `count` axes in rows of `columns`, with the label `x` below each column; see `figure`."""
    empty, grid = figure(-(-count // columns), columns, **more)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    for axes in grid.flat[max(count - columns, 0):count]:
        axes.tick_params(labelbottom=True)  # where axes share x, only the last row has them
        axes.set_xlabel(x)
    return empty, list(grid.flat[:count])


def time_axis(duration: float) -> tuple[str, float]:
    """Return the label of a time axis and its units per second: ms up to a `duration` of 1 s, otherwise s."""
    return ("time [ms]", 1e3) if duration <= 1.0 else ("time [s]", 1.0)


def limits(axes: Axes, *levels: float, sides: bool = False, across: bool = True, **look: Any) -> None:
    """Plot a limit at each of the `levels`, with `sides` also at -level: a horizontal line if `across`, else vertical.

    `look` are line properties that override `LIMIT`.
    """
    for at in (sign * level for level in levels for sign in ((1.0, -1.0) if sides else (1.0,))):
        (axes.axhline if across else axes.axvline)(at, **{**LIMIT, **look})


def svg(plot: Figure, label: str = "", description: str = "") -> str:
    """Return a figure as <svg> element; `label` and `description` are for screen readers. The call fixes the layout."""
    text = StringIO()
    for axis in (axis for axes in plot.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), LogFormatterMathtext):  # formulas need fonts that may be missing
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(LogFormatter())
    if layout := plot.get_layout_engine():  # while saving, it would render the whole figure a second time
        FigureCanvasSVG(plot)  # the layout uses the text sizes of SVG
        layout.execute(plot)
        plot.set_layout_engine(None)
    with mpl.rc_context({"svg.hashsalt": "emcas", "svg.fonttype": "none"}):
        plot.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    body = text.getvalue()
    body = body[body.index("<svg"):]
    body = re.sub(r"\s*<metadata>.*?</metadata>|<!--.*?-->", "", body, flags=re.DOTALL)
    # A hundredth of a point is finer than a printer's resolution.
    body = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path.group()), body)
    # The <svg> element declares the fonts once; each text keeps only its size.
    body = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font-size: \1", body)
    body = re.sub(r"font-family: [^;\"]*;? ?", "", body)
    body = _unique_ids(body).replace(INK, "currentColor").replace(BLUE, "var(--blue)")  # lighter on a dark page
    words = f"<desc>{escape(description)}</desc>" if description else ""
    start = f'<svg role="img" aria-label="{escape(label)}" font-family="{FONTS}"'
    return re.sub(r"<svg([^>]*)>", lambda rest: f"{start}{rest[1]}>{words}", body, count=1).rstrip()


class Drawing(NamedTuple):
    """A figure of Matplotlib with title and caption, for a page."""

    title: str
    figure: Figure
    caption: str


class Picture(NamedTuple):
    """A figure as SVG; `curves` are its data as JSON for the script curves.js, empty for a static picture."""

    title: str
    svg: str
    caption: str
    curves: str = ""


def picture(plot: Figure, title: str, caption: str) -> Picture:
    """Return a figure of `style()` as SVG with its data."""
    return Picture(title, svg(plot, title, caption), caption, curves(plot))


def pictures(drawings: Iterable[Drawing | None]) -> list[Picture]:
    """Return the pictures of the drawings that are not None. Drawings from a generator are made in `style()`."""
    with style():
        return [picture(d.figure, d.title, d.caption) for d in drawings if d is not None]


def bode(gain: Axes, phase: Axes, frequency: Any, gain_db: Any, phase_deg: Any, marks: Sequence[float],
         **look: Any) -> None:
    """Plot gain [dB] and phase [deg] over frequency [Hz]; dots are at `marks`, the frequencies of -3 dB and -90 deg.

    `look` are line properties with a `color`.
    """
    gain.semilogx(frequency, gain_db, **look)
    phase.semilogx(frequency, phase_deg, **look)
    for axes, at, level in zip((gain, phase), marks, (-3.0, -90.0), strict=True):
        axes.plot(at, level, "o", color=look["color"], label=look.get("label"), markersize=5, zorder=4)


def bode_axes(gain: Axes, phase: Axes) -> None:
    """Set labels and ranges of a Bode plot's two panels, and plot lines at -3 dB and -90 deg."""
    limits(gain, -3.0)
    limits(phase, -90.0)
    gain.set(ylabel="gain [dB]", ylim=(-12, 3))
    phase.set(ylabel="phase [deg]", ylim=(-200, 10), yticks=(-180, -135, -90, -45, 0))


def frequency_axis(axes: Axes, ticks: Iterable[float]) -> None:
    """Label a logarithmic axis of frequencies [Hz] with plain numbers."""
    ticks = list(ticks)
    axes.set(xlabel="frequency [Hz]", xticks=ticks, xticklabels=[f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def frequency_responses(curves: Iterable[tuple[Any, Sequence[float], Mapping[str, Any]]],
                        required: Iterable[float] = ()) -> Figure:
    """Return a figure of gain, phase and coherence over frequency.

    Each of the `curves` has a response (`bench.frequency_response`), its frequencies [Hz] of -3 dB and -90 deg, and
    line properties; dots mark the frequencies. Vertical lines are at the `required` bandwidths [Hz].
    """
    plot, (gain, phase, coherence) = column("", "", "coherence", height=1.9, height_ratios=(1.3, 1.3, 0.8))
    for response, marks, look in curves:
        bode(gain, phase, response.frequency, response.gain_db, np.degrees(response.phase), marks, **look)
        coherence.semilogx(response.frequency, response.coherence, **look)
    bode_axes(gain, phase)
    for at in dict.fromkeys(required):
        for axes in (gain, phase):
            limits(axes, at, across=False, label=f"required {at:g} Hz", **REQUIRED)
    legend_above(gain)
    coherence.set(ylim=(0.0, 1.05))
    frequency_axis(coherence, (0.5, 1, 2, 5, 10, 20))
    for axes in (gain, phase, coherence):
        axes.minorticks_off()
        axes.margins(x=0.0)
    return plot


def legend(owner: Axes | Figure, **more: Any) -> None:
    """Add a legend to axes or a figure: each label once, upper layers first, then in the order of plotting."""
    entries: dict[str, Any] = {}
    for axes in owner.axes if isinstance(owner, Figure) else [owner]:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries[label] = entries.pop(label, handle)
    ordered = sorted(entries.items(), key=lambda entry: -entry[1].get_zorder())
    owner.legend([handle for _, handle in ordered], [label for label, _ in ordered], **more)


def legend_above(owner: Axes | Figure, columns: int = 6, **more: Any) -> None:
    """Add a legend above a panel, or above all panels of a figure, where it hides nothing."""
    # A legend that is wider than a panel must be the figure's: it would widen the panel's column.
    position: dict[str, Any] = {"loc": "outside upper left"} if isinstance(owner, Figure) else {
        "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
    legend(owner, ncols=columns, handlelength=1.8, columnspacing=1.4, **position, **more)


def write(plot: Figure, path: Path) -> None:
    """Write a figure of `style()` as ``.svg``, ``.png`` or ``.pdf``. Raises EmcasError for an unknown ending."""
    check_image(path)
    with whole(path) as file:
        plot.savefig(file, format=path.suffix[1:], dpi=150, facecolor="white")


def shade(axes: Axes, time: Any, active: Any, label: str = "") -> None:
    """Shade the times at which `active` is true; both arrays have the same length."""
    axes.fill_between(time, 0, 1, where=active, step="post", transform=axes.get_xaxis_transform(), color=GRAY,
                      alpha=0.22, linewidth=0.0, label=label or None)


def _unique_ids(body: str) -> str:
    """Remove unused ids and make the others unique to the figure, since a page has several figures."""
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))
    mark = hashlib.sha256(body.encode()).hexdigest()[:8]
    body = re.sub(r' id="([^"]+)"', lambda m: f' id="{mark}-{m[1]}"' if m[1] in used else "", body)
    return re.sub(r'(href="#|url\(#)', rf"\g<1>{mark}-", body)
