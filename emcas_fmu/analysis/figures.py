"""The pictures of an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import degrees, pi
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .. import plots
from ..bench.metrics import FrequencyResponse
from . import frequency
from .analyse import Analysis
from .steps import STOP
from .sweep import LIMITS

Drawing = tuple[str, Figure, str]
"""Title, figure, caption."""
_THIN: dict[str, Any] = {"color": plots.GRAY, "linewidth": 0.9, "linestyle": (0, (1, 1.2)), "zorder": 1.5}
_THESIS: dict[str, Any] = {"color": plots.VERMILLION, "linestyle": (0, (5, 1.5)), "linewidth": 1.1}
_SHOWN = (0.1, 300.0)  # Hz
_DOTS = 400  # of a case, about
_LIMIT_NAMES = {"rate": "speed reference", "current": "drive current", "voltage": "supply voltage",
                "dac": "analogue reference"}
_MARKERS = {"rate": "o", "current": "s", "voltage": "^", "dac": "x"}


def all_figures(found: Analysis) -> Iterator[tuple[str, str, str]]:
    """Title, inline SVG and caption of every figure."""
    for draw, section in DRAWINGS.items():
        if section in found.left_out:
            continue
        with plots.style():
            title, figure, caption = draw(found)
            yield title, plots.svg(figure, title), caption


def _legend(axes: Axes, *entries: tuple[str, Mapping[str, Any]], columns: int = 5) -> None:
    handles = [Line2D([], [], label=label, **look) for label, look in entries]
    # On the figure, since a legend wider than its panel would widen the panel's column.
    parent = axes.get_figure()
    assert isinstance(parent, Figure)
    parent.legend(handles=handles, loc="outside upper left", ncols=columns, handlelength=1.8, columnspacing=1.4)


def _bode_pair(gain: Axes, phase: Axes, response: FrequencyResponse, *, scale: float = 1.0, **look: Any) -> None:
    shown = (response.frequency >= _SHOWN[0]) & (response.frequency <= _SHOWN[1])
    gain.semilogx(response.frequency[shown], 20.0 * np.log10(scale * response.gain[shown]), **look)
    phase.semilogx(response.frequency[shown], np.degrees(response.phase[shown]), **look)


def bode(found: Analysis) -> Drawing:
    """Command to angle and load to angle."""
    figure, grid = plots.figure(2, 2, height=2.4, sharex=True)
    own: dict[str, Any] = {"color": plots.BLUE}
    entries: list[tuple[str, Mapping[str, Any]]] = [("linearised here", own)]
    _bode_pair(grid[0, 0], grid[1, 0], found.linear.command, **own)
    if found.thesis:
        _bode_pair(grid[0, 0], grid[1, 0], found.thesis.command, **_THESIS)
        entries.append(("thesis's linear model", _THESIS))
    for sweep, color in zip([s for s in found.sweeps if degrees(s.amplitude) > 0.9][:5:2],
                            (plots.GREEN, plots.ORANGE, plots.PURPLE), strict=False):
        look: dict[str, Any] = {"color": color, "linestyle": "none", "marker": "o", "markersize": 2.6,
                                "markerfacecolor": "none"}
        _bode_pair(grid[0, 0], grid[1, 0], sweep.response, **look)
        entries.append((f"simulated, {degrees(sweep.amplitude):.3g} deg", look))
    grid[0, 0].axhline(-3.0, **_THIN)
    grid[1, 0].axhline(-90.0, **_THIN)
    grid[0, 0].set(ylabel="gain / dB", ylim=(-40, 6))
    grid[1, 0].set(ylabel="phase / deg", ylim=(-360, 20), yticks=range(-360, 1, 90), xlabel="frequency / Hz")
    if found.linear.load:
        _bode_pair(grid[0, 1], grid[1, 1], found.linear.load, scale=degrees(1.0), **own)
    grid[0, 1].set(ylabel="dB of 1 deg/(N.m)")
    grid[1, 1].set(ylabel="phase / deg", xlabel="frequency / Hz", yticks=range(-270, 91, 90))
    _legend(grid[0, 0], *entries)
    grid[0, 0].set_title("fin angle over command")
    grid[0, 1].set_title("fin angle over hinge moment")
    r = found.linear.command
    return ("Bode diagrams", figure, f"Left, fin angle over command: -3 dB at {r.bandwidth:.1f} Hz, -90 deg at "
            f"{r.phase_bandwidth:.1f} Hz (linear). Right, fin angle over hinge moment. The linear responses are those "
            "of the sampled system with its transport delay, exactly; circles are the fundamental of the simulated "
            "response to steady sines.")


def nichols(found: Analysis) -> Drawing:
    """Open loops in the Nichols plane, with circles of closed-loop gain."""
    figure, ((axes,),) = plots.figure(1, height=4.2, width=7.0)
    phase, gain = np.meshgrid(np.linspace(-360, 0, 361), np.linspace(-30, 40, 281))
    open_loop = 10.0 ** (gain / 20.0) * np.exp(1j * np.radians(phase))
    with np.errstate(divide="ignore"):
        peak = 20.0 * np.log10(np.abs(open_loop / (1.0 + open_loop)))
    levels = [-3.0, 0.0, 3.0, 6.0]
    axes.contour(phase, gain, peak, levels=levels, colors=plots.GRAY, linewidths=0.6, linestyles="dotted")
    for level in levels[2:]:  # at -180 deg, L = -M/(M - 1)
        top = 10.0 ** (level / 20.0)
        axes.text(-180.0, 20.0 * np.log10(top / (top - 1.0)), f"{level:g} dB", fontsize=6.5, color=plots.GRAY,
                  ha="center", va="bottom")
    axes.text(-88.0, 36.0, "0 dB", fontsize=6.5, color=plots.GRAY)
    axes.text(-40.0, 8.0, "-3 dB", fontsize=6.5, color=plots.GRAY)
    colors = {"velocity": plots.GREEN, "position": plots.PURPLE, "reference": plots.BLUE}
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for name in found.linear.loops:
        if name not in colors:  # the current loop is in continuous time
            continue
        look = {"color": colors[name]}
        _nichols_line(axes, found.linear.loops[name], found.linear.margins[name], **look)
        entries.append((f"{name} loop" if name != "reference" else "at the drive's reference", look))
    if found.thesis:
        _nichols_line(axes, found.thesis.loops["reference"], found.thesis.margins["reference"], **_THESIS)
        entries.append(("thesis's model, at the drive's reference", _THESIS))
    axes.plot(-180, 0, "+", color=plots.INK, markersize=9)
    axes.set(xlim=(-360, 0), ylim=(-30, 40), xticks=range(-360, 1, 45), xlabel="open-loop phase / deg",
             ylabel="open-loop gain / dB")
    _legend(axes, *entries, columns=2)
    m = found.linear.margins["reference"]
    return ("Nichols chart", figure, f"At the drive's reference the gain may grow by {m.gain_db:.1f} dB (square, at "
            f"{m.phase_crossover:.0f} Hz), the phase lag by {degrees(m.phase):.0f} deg (circle, at "
            f"{m.gain_crossover:.0f} Hz), which is {m.delay * 1e3:.2f} ms of delay. Dotted: gain of the closed loop.")


def _nichols_line(axes: Axes, loop: Any, margins: frequency.Margins, **look: Any) -> None:
    grid = frequency.frequencies(frequency.highest(loop), 0.02)
    values = frequency.evaluate(loop, grid)
    # A loop with integrators starts below -90 deg: the branch that ends nearest to the crossover.
    turn = np.unwrap(np.angle(values))
    turn -= 2.0 * pi * np.round((np.interp(margins.gain_crossover, grid, turn) + 0.5 * pi) / (2.0 * pi))
    gain = 20.0 * np.log10(np.abs(values))
    axes.plot(np.degrees(turn), gain, **look)
    for at, marker in ((margins.phase_crossover, "s"), (margins.gain_crossover, "o")):
        if np.isfinite(at):
            axes.plot(np.degrees(np.interp(at, grid, turn)), np.interp(at, grid, gain), marker, markersize=4.5,
                      color=look["color"])


def root_locus(found: Analysis) -> Drawing:
    """Closed-loop poles against the chosen parameter."""
    figure, ((axes,),) = plots.figure(1, height=4.2, width=7.5)
    roots, hertz = found.locus, 1.0 / (2.0 * pi)
    crossover = found.linear.margins["reference"].phase_crossover
    shown = 1.6 * crossover if np.isfinite(crossover) else 100.0
    points = np.concatenate(roots.poles) * hertz
    scale = np.repeat(np.log10(roots.values / roots.nominal), [len(poles) for poles in roots.poles])
    dots = axes.scatter(points.real, points.imag, c=scale, cmap="viridis", s=6, linewidths=0, vmin=-1, vmax=1)
    bar = figure.colorbar(dots, ax=axes, ticks=[-1, np.log10(0.5), 0, np.log10(2), 1], pad=0.02)
    bar.ax.set_yticklabels(["0.1", "0.5", "1", "2", "10"])
    bar.set_label(f"{roots.name} / its value")
    here = roots.poles[int(np.argmin(np.abs(roots.values - roots.nominal)))] * hertz
    square: dict[str, Any] = {"linestyle": "none", "marker": "s", "markersize": 6, "markerfacecolor": "none",
                              "color": plots.INK}
    cross: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 6, "color": plots.VERMILLION}
    axes.plot(here.real, here.imag, **square)
    axes.plot(roots.rational.real * hertz, roots.rational.imag * hertz, **cross)
    axes.axvline(0.0, color=plots.INK, linewidth=0.8)
    for damping in (0.2, 0.4, 0.6, 0.8):
        slope = np.sqrt(1.0 - damping**2) / damping
        for side in (1.0, -1.0):
            axes.plot([0.0, -2.0 * shown], [0.0, side * slope * 2.0 * shown], **_THIN)
        x = min(0.95 * shown / slope, 0.9 * shown)
        axes.text(-x, x * slope, f"{damping:g}", fontsize=6.5, color=plots.GRAY, ha="center", va="center")
    axes.set(xlim=(-shown, 0.4 * shown), ylim=(-shown, shown), xlabel="Re s / 2π / Hz",
             ylabel="Im s / 2π / Hz")
    _legend(axes, ("as set", square), ("as set, continuous with Padé delay", cross), columns=2)
    low, high = roots.stable_range
    bounds = [f"{word} {value:.4g}" for word, value, end in (("below", low, roots.values[0]),
                                                             ("above", high, roots.values[-1]))
              if value != end]
    unit = "" if roots.unit == "1" else f" {roots.unit}"
    verdict = f"unstable {' and '.join(bounds)}{unit}" if bounds else "stable throughout"
    return (f"Root locus against {roots.name}", figure, f"From a tenth to ten times {roots.nominal:g}{unit}, as far as "
            f"the parameter may go: {verdict}. Exact poles of the sampled loop with its delay, drawn at s = ln(z)/T. "
            "Only the crosses rest on an approximation: a continuous loop with a third-order Padé delay of transport "
            "delay and half a sample, its speed measured without lag.")


def steps(found: Analysis) -> Drawing:
    """Steps of the linear models and the simulated one."""
    columns = len(found.steps)
    figure, grid = plots.figure(1, max(columns, 1), height=2.6, sharex=True, sharey=True)
    blue, orange = {"color": plots.GREEN}, {"color": plots.BLUE}
    settled = [s.metrics_nonlinear.settling_time for s in found.steps]
    end = 1e3 * float(np.clip(1.15 * np.max(settled, initial=0.0), 0.15, STOP))
    for axes, s in zip(grid[0], found.steps, strict=False):
        plots.shade(axes, s.time * 1e3, s.active)
        if s.thesis is not None:
            axes.plot(s.time * 1e3, s.thesis / s.size, **_THESIS)
        axes.plot(s.time * 1e3, s.linear / s.size, **orange)
        axes.plot(s.time * 1e3, s.nonlinear / s.size, **blue)
        axes.set_xlabel("time / ms")
        axes.text(0.97, 0.05, f"{s.size:+g} deg", transform=axes.transAxes, ha="right", fontsize=9)
        axes.set_xlim(0, end)
    grid[0, 0].set_ylabel("fin angle / step")
    thesis = [] if "thesis_linear" in found.left_out else [("thesis's linear model", _THESIS)]
    _legend(grid[0, 0], ("simulated", blue), ("linearised here", orange), *thesis,
            ("a limit is active", {"color": plots.GRAY, "alpha": 0.3, "linewidth": 7}), columns=4)
    told = ", ".join(f"{s.difference:.0f} % at {abs(s.size):g} deg" for s in found.steps)
    return ("Steps, linear and simulated", figure, f"Divided by their size. Largest difference of simulated and "
            f"linear: {told}. Small steps differ by friction, its compensation and the encoder's counts, large ones by "
            "the limits.")


def amplitudes(found: Analysis) -> Drawing:
    """Bandwidth and the onset of limits in the plane of amplitude and frequency."""
    figure, ((axes,),) = plots.figure(1, height=3.6, width=7.5)
    size = np.array([degrees(s.amplitude) for s in found.sweeps])
    entries: list[tuple[str, Mapping[str, Any]]] = []
    for label, color, measured, linear in (
            ("-3 dB", plots.BLUE, [s.response.bandwidth for s in found.sweeps], found.linear.command.bandwidth),
            ("-90 deg", plots.VERMILLION, [s.response.phase_bandwidth for s in found.sweeps],
             found.linear.command.phase_bandwidth)):
        axes.loglog(size, measured, color=color, linewidth=1.8)
        axes.axhline(linear, color=color, linestyle=(0, (5, 1.5)), linewidth=0.9)
        entries.append((label, {"color": color, "linewidth": 1.8}))
    limits = () if "limits" in found.left_out else LIMITS
    for name, color in zip(limits, (plots.GREEN, plots.PURPLE, plots.ORANGE, plots.SKY)):
        look = {"color": color, "marker": _MARKERS[name], "markersize": 4.0, "linewidth": 0.9}
        axes.loglog(size, [s.onset(name) for s in found.sweeps], **look)
        entries.append((f"{_LIMIT_NAMES[name]} limited above", look))
    entries.append(("linear", {"color": plots.GRAY, "linestyle": (0, (5, 1.5))}))
    axes.set(xlabel="amplitude of the command / deg", ylabel="frequency / Hz")
    axes.set_xticks(size, [f"{s:.3g}" for s in size], minor=False)
    axes.xaxis.set_minor_formatter("")
    ticks = [1, 2, 5, 10, 20, 50, 100]
    low, high = axes.get_ylim()
    axes.set_yticks([t for t in ticks if low <= t <= high], [f"{t}" for t in ticks if low <= t <= high])
    axes.yaxis.set_minor_formatter("")
    _legend(axes, *entries, columns=3)
    marks = ("Thin lines with marks: from which frequency on a limit acts at some instant of the period. " if limits
             else "")
    return ("Bandwidth against amplitude", figure, "Describing function by steady sines of the simulated actuator, "
            f"about the operating point or as near to it as the range of commands allows. {marks}Small amplitudes "
            "lose bandwidth to friction and counts, large ones to the limits met first.")


def limit_shares(found: Analysis) -> Drawing:
    """Share of the time each limit acts, against amplitude and frequency."""
    figure, grid = plots.figure(1, len(LIMITS), height=2.7, sharex=True, sharey=True)
    size = np.array([degrees(s.amplitude) for s in found.sweeps])
    table = found.sweeps[0].response.frequency
    for row, (axes, name) in enumerate(zip(grid[0], LIMITS, strict=True)):
        share = 100.0 * np.array([s.active[row] for s in found.sweeps]).T
        mesh = axes.pcolormesh(size, table, share, vmin=0, vmax=100, cmap="magma_r", shading="nearest")
        axes.plot(size, [s.response.bandwidth for s in found.sweeps], color=plots.BLUE, linewidth=1.2)
        axes.set(xscale="log", yscale="log", title=_LIMIT_NAMES[name], xlabel="amplitude / deg",
                 xlim=(size[0], size[-1]))
        axes.set_xticks([t for t in (0.1, 1.0, 10.0) if size[0] <= t <= size[-1] * 1.001])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_formatter("{x:g}")
    grid[0, 0].set_ylabel("frequency / Hz")
    figure.colorbar(mesh, ax=list(grid[0]), pad=0.01).set_label("time at the limit / %")
    return ("Where the limits bite", figure, "Share of the time a limit is active while a steady sine is followed; the "
            "line is the -3 dB bandwidth. The speed reference's limit is the rate limit of the fin.")


def torque_speed(found: Analysis) -> Drawing:
    """Envelope, with the reference cases' operating points."""
    figure, ((axes,),) = plots.figure(1, height=4.0, width=7.5)
    assert found.capability is not None
    e, cases = found.capability.envelope, found.capability.cases
    axes.fill_between(e.speed, e.lowest, e.highest, color=plots.GRAY, alpha=0.13, linewidth=0)
    edge: dict[str, Any] = {"color": plots.INK, "linewidth": 1.2}
    prompt: dict[str, Any] = {"color": plots.GRAY, "linewidth": 1.0, "linestyle": (0, (5, 1.5))}
    axes.plot(e.speed, e.highest, **edge)
    axes.plot(e.speed, e.lowest, **edge)
    axes.plot(e.speed, e.prompt, **prompt)
    axes.plot(-e.speed, -e.prompt, **prompt)
    entries: list[tuple[str, Mapping[str, Any]]] = [("motor and drive, steady", edge),
                                                    ("without the drive's integral", prompt)]
    drawn = {"step_plus20": plots.BLUE, "load_opposing": plots.VERMILLION, "load_aiding": plots.GREEN,
             "sag": plots.ORANGE}
    for case in cases:
        color = drawn.get(case.name, plots.SKY)
        every = max(len(case.speed) // _DOTS, 1)
        axes.plot(case.speed[::every], case.torque[::every], ".", markersize=2.6, color=color,
                  alpha=0.9 if case.name in drawn else 0.35, zorder=3.0 if case.name in drawn else 2.0)
        if case.name in drawn:
            entries.append((case.name, {"color": color, "marker": "o", "markersize": 3, "linestyle": "none"}))
    entries.append(("other cases", {"color": plots.SKY, "marker": "o", "markersize": 3, "linestyle": "none"}))
    limit = found.parameters.values["controller.speed_limit"]
    for side in (1.0, -1.0):
        axes.axvline(side * limit, **_THIN)
    reach = 1.05 * max(float(np.max(np.abs(case.torque))) for case in cases)
    fast = 1.05 * max(e.no_load_speed, max(float(np.max(np.abs(case.speed))) for case in cases))
    top = max(reach, 1.1 * float(np.max(e.highest)))
    axes.set(xlabel="motor speed / rad/s", ylabel="motor torque / N.m", xlim=(-fast, fast), ylim=(-top, top))
    _legend(axes, *entries, columns=4)
    slow = f", in some {e.integral_time:.0f} s" if np.isfinite(e.integral_time) else ""
    return ("Torque and speed", figure, f"Grey: what the drive's current ({e.stall_torque:.3g} N.m at stall) and the "
            f"supply (no torque at {e.no_load_speed:.0f} rad/s) allow in steady motion. Dashed: at first, before the "
            f"drive's integral has closed the rest{slow}. Points: the reference cases with these parameters; dotted "
            "verticals: the controllers' speed limit. Points outside are transients, in which the current outlasts the "
            "voltage that made it.")


def fin_capability(found: Analysis) -> Drawing:
    """Hinge moment and rate against the fin angle."""
    figure, grid = plots.figure(1, 3, height=2.6, sharex=True)
    assert found.capability is not None
    c = found.capability.fin
    angle = np.degrees(c.fin_angle)
    plus, minus = {"color": plots.BLUE}, {"color": plots.VERMILLION, "linestyle": (0, (5, 1.5))}
    faint: dict[str, Any] = {"color": plots.GRAY}
    bound: dict[str, Any] = {"color": plots.PURPLE, "linewidth": 1.8}
    for row, look in ((0, plus), (1, minus)):
        grid[0, 0].plot(angle, c.stall[row], **look)
        grid[0, 1].plot(angle, np.degrees(c.free_rate[row]), **look)
        grid[0, 1].plot(angle, np.degrees(c.free_rate_loaded[row]), **{**look, "alpha": 0.45})
    speed_limit = found.parameters.values["controller.speed_limit"]
    grid[0, 1].plot(angle, np.degrees(speed_limit / c.ratio), **bound)
    grid[0, 2].plot(angle, c.ratio, **faint)
    for value in (220.0, 200.0):
        grid[0, 1].axhline(value, **{**_THIN, "color": plots.GREEN})
    grid[0, 0].set_ylabel("stall moment / N.m")
    grid[0, 1].set_ylabel("fin rate / deg/s")
    grid[0, 2].set_ylabel("ratio R")
    for axes in grid[0]:
        axes.set_xlabel("fin angle / deg")
    _legend(grid[0, 0], ("moving +", plus), ("moving -", minus), ("paler: against 100 N.m", {**plus, "alpha": 0.45}),
            ("controllers' speed limit", bound), ("Table 2", {**_THIN, "color": plots.GREEN}))
    return ("Capability against fin angle", figure, "The lever's ratio grows with the lever angle, so the fin is "
            "stronger and slower towards the ends. Largest opposing hinge moment that is still moved; largest steady "
            "rate that supply and drive current allow without load and against 100 N.m, and the rate at the "
            "controllers' speed limit.")


# Each with the section of `analyse.SECTIONS` it belongs to.
DRAWINGS: Mapping[Callable[[Analysis], Drawing], str] = {
    bode: "", nichols: "", root_locus: "", steps: "", amplitudes: "", limit_shares: "limits",
    torque_speed: "capability", fin_capability: "capability"}
