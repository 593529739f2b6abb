"""The plots of an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import degrees, pi
from typing import Any

import control as ct
import numpy as np
from matplotlib.axes import Axes

from ...actuators import capabilities
from ...actuators.declaration import Actuator
from ...bench.frequency_response import FrequencyResponse
from ...bench.linear import frequency
from ...pages.numbers import with_unit
from ...plotting import plots
from ...plotting.plots import LIMIT, Drawing
from ...units import RPM
from .analyse import Analysis, ClosedLoop
from .steps import STOP
from .sweep import LIMITS, shared

Look = dict[str, Any]
"""Line properties by matplotlib's names."""
_DASHED: Look = {"linestyle": (0, (5, 1.5))}
_THESIS: Look = {"color": plots.VERMILLION, "linewidth": 1.1, **_DASHED}
_SHOWN = (0.1, 300.0)  # Hz, range of the frequencies in Bode diagrams
_DOTS = 400  # approximate number of points plotted per reference case
_LIMIT_NAMES = {"rate": "speed reference", "current": "drive current", "voltage": "supply voltage",
                "dac": "analogue reference"}


_NOT_DRY = ("viscous", "friction.table.", "friction.temperature", "friction.identified", "deviation.", "stribeck")


def neglected(actuator: Actuator, values: Mapping[str, Any]) -> dict[str, str]:
    """Return an actuator's small effects that linear models leave out, in words by key; none whose `values` are 0."""
    present = [v.name for v in actuator.parameters if values[v.name]]
    dry = any("coulomb" in name or name.startswith("friction.") or name.endswith("friction") for name in present
              if not any(word in name for word in _NOT_DRY))
    encoder, motor = "encoder.enabled" in present, capabilities.ENCODER in actuator.provides
    effects = {
        "friction": ("friction", dry),
        "compensation": ("its compensation", dry and "compensation.gain" in present),
        "counts": ("the encoder's counts", encoder and motor),
        "resolution": ("the sensor's resolution", "transducer.resolution" in present or (encoder and not motor)),
        "backlash": ("backlash", any(name in present for name in ("drive_line.backlash", "gear.backlash"))),
        "dead time": ("the inverter's dead time", actuator.structure.inverter)}
    return {key: words for key, (words, exists) in effects.items() if exists}


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def drawings(analysis: Analysis) -> Iterator[Drawing]:
    """Yield all plots except those of sections that are left out."""
    for draw, section in DRAWINGS.items():
        if section not in analysis.left_out:
            yield draw(analysis)


def bode(analysis: Analysis) -> Drawing:
    """Plot the frequency responses to command and load."""
    figure, ((gain, load_gain), (phase, load_phase)) = plots.figure(
        2, 2, height=2.4, sharex=True, x="frequency [Hz]", y=("gain [dB]", "phase [deg]"))

    def draw(response: FrequencyResponse, axes: tuple[Axes, Axes] = (gain, phase), scale: float = 1.0,
             rows: Any = True, **look: Any) -> None:
        shown = (response.frequency >= _SHOWN[0]) & (response.frequency <= _SHOWN[1]) & rows
        axes[0].semilogx(response.frequency[shown], 20.0 * np.log10(scale) + response.gain_db[shown], **look)
        axes[1].semilogx(response.frequency[shown], np.degrees(response.phase[shown]), **look)

    here: Look = {"color": plots.BLUE, "label": "linearised here"}
    draw(analysis.linear.command, **here)
    if analysis.linear.load:
        draw(analysis.linear.load, (load_gain, load_phase), degrees(1.0), **here)
    if analysis.thesis:
        draw(analysis.thesis.command, **_THESIS, label="thesis's linear model")
    chosen = [(s, rows) for s, rows in zip(analysis.sweeps, shared(analysis.sweeps), strict=True)
              if degrees(s.amplitude) > 0.9]
    for (sweep, rows), color in zip(chosen[:5:2], (plots.GREEN, plots.ORANGE, plots.PURPLE), strict=False):
        draw(sweep.response, rows=rows, color=color, linestyle="none", marker="o", markersize=2.6,
             markerfacecolor="none", label=f"simulated, {degrees(sweep.amplitude):.3g} deg")
    plots.limits(gain, -3.0)
    plots.limits(phase, -90.0)
    gain.set(title="fin angle over command", ylim=(-40, 6))
    phase.set(ylim=(-360, 20), yticks=range(-360, 1, 90))
    load_gain.set(title="fin angle over hinge moment", ylabel="dB of 1 deg/(N.m)")
    load_phase.set(ylabel="phase [deg]", yticks=range(-270, 91, 90))
    plots.legend_above(figure, 5)
    return Drawing("Bode diagrams", figure, "Left, fin angle over command: -3 dB: {} Hz, -90 deg: {} Hz (linear). "
                   "Right, fin angle over hinge moment. The linear responses are exact for the sampled system with its "
                   "transport delay. Circles are the fundamental of the simulated response to steady sines."
                   .format(*analysis.linear.command.stated))


def nichols(analysis: Analysis) -> Drawing:
    """Plot the open loops in the Nichols plane, with lines of constant closed-loop gain and phase."""
    figure, (axes,) = plots.column("open-loop gain [dB]", x="open-loop phase [deg]", height=4.2, width=7.0)
    ct.nichols_grid(np.array([-3.0, 0.0, 3.0, 6.0]), ax=axes, label_cl_phases=False)
    at = analysis.actuator.reference_name
    looks = {"velocity": {"label": "velocity loop", "color": plots.GREEN},  # the current loop is in continuous time
             "position": {"label": "position loop", "color": plots.PURPLE},
             "reference": {"label": f"at {at}", "color": plots.BLUE}}
    for name, look in looks.items():
        if name in analysis.linear.loops:
            _nichols_line(axes, analysis.linear, name, look)
    if analysis.thesis:
        _nichols_line(axes, analysis.thesis, "reference", {**_THESIS, "label": f"thesis's model, at {at}"})
    axes.plot(-180, 0, "+", color=plots.INK, markersize=9)
    axes.set(xlim=(-360, 0), ylim=(-30, 40), xticks=range(-360, 1, 45))
    plots.legend_above(figure, 2)
    m = analysis.linear.margins["reference"]
    return Drawing("Nichols chart", figure, f"At {at} the gain may grow by "
                   f"{_limited(m.up_db, 'dB', m.phase_crossover, 'square, ')} and fall by "
                   f"{_limited(m.down_db, 'dB', m.reduction_crossover)}; the phase lag may grow by "
                   f"{_limited(degrees(m.phase), 'deg', m.gain_crossover, 'circle, ')}, and the delay by "
                   f"{f'{m.delay * 1e3:.2f} ms' if np.isfinite(m.delay) else 'any amount'}. Dotted: gain and phase of "
                   "the closed loop.")


def _limited(margin: float, unit: str, at: float, mark: str = "") -> str:
    """Return a margin [unit] in words, with its frequency `at` [Hz]."""
    return f"{margin:.1f} {unit} ({mark}at {at:.3g} Hz)" if np.isfinite(margin) else "any amount"


def _nichols_line(axes: Axes, model: ClosedLoop, name: str, look: Look) -> None:
    response, margins = frequency.response(model.loops[name]), model.margins[name]
    grid = response.frequency
    # The phase is plotted shifted by whole turns, as near as possible to -90 deg at the gain crossover.
    turns = np.round((np.interp(margins.gain_crossover, grid, response.phase) + 0.5 * pi) / (2.0 * pi))
    phase = np.degrees(response.phase - 2.0 * pi * turns)
    axes.plot(phase, response.gain_db, **look)
    for at, marker in ((margins.phase_crossover, "s"), (margins.gain_crossover, "o")):
        if np.isfinite(at):
            axes.plot(np.interp(at, grid, phase), np.interp(at, grid, response.gain_db), marker, markersize=4.5,
                      color=look["color"], label=look["label"])


def root_locus(analysis: Analysis) -> Drawing:
    """Plot the closed-loop poles over the parameter of the locus."""
    figure, (axes,) = plots.column("Im s / 2π [Hz]", x="Re s / 2π [Hz]", height=4.2, width=7.5)
    roots, hertz = analysis.locus, 1.0 / (2.0 * pi)
    crossover = analysis.linear.margins["reference"].phase_crossover
    shown = 1.6 * crossover if np.isfinite(crossover) else 100.0
    points = np.concatenate(roots.poles) * hertz
    scale = np.repeat(np.log10(roots.values / roots.nominal), [len(poles) for poles in roots.poles])
    dots = axes.scatter(points.real, points.imag, c=scale, cmap="viridis", s=6, linewidths=0, vmin=-1, vmax=1)
    bar = figure.colorbar(dots, ax=axes, ticks=[-1, np.log10(0.5), 0, np.log10(2), 1], pad=0.02)
    bar.ax.set_yticklabels(["0.1", "0.5", "1", "2", "10"])
    bar.set_label(f"{roots.name} / its value")
    nominal = roots.poles[int(np.argmin(np.abs(roots.values - roots.nominal)))]
    axes.plot(nominal.real * hertz, nominal.imag * hertz, "s", markersize=6, label="nominal", markerfacecolor="none",
              color=plots.INK)
    axes.plot(roots.rational.real * hertz, roots.rational.imag * hertz, "x", markersize=6,
              label="nominal, continuous with Padé delay", color=plots.VERMILLION)
    axes.axvline(0.0, color=plots.INK, linewidth=0.8)
    for damping in (0.2, 0.4, 0.6, 0.8):
        slope = np.sqrt(1.0 - damping**2) / damping
        for side in (1.0, -1.0):
            axes.plot([0.0, -2.0 * shown], [0.0, side * slope * 2.0 * shown], **LIMIT)
        x = min(0.95 * shown / slope, 0.9 * shown)
        axes.text(-x, x * slope, f"{damping:g}", fontsize=6.5, color=plots.GRAY, ha="center", va="center")
    axes.set(xlim=(-shown, 0.4 * shown), ylim=(-shown, shown))
    plots.legend_above(figure, 2)
    low, high = roots.stable_range
    bounds = [f"{word} {value:.4g}" for word, value, end in (("below", low, roots.values[0]),
                                                             ("above", high, roots.values[-1]))
              if value != end]
    unit = "" if roots.unit == "1" else f" {roots.unit}"
    verdict = f"unstable {' and '.join(bounds)}{unit}" if bounds else "stable throughout"
    return Drawing(f"Root locus against {roots.name}", figure, f"The parameter is 0.1 to 10 times {roots.nominal:g}"
                   f"{unit}, within its limits; the loop is {verdict}. Dots and squares are exact poles of the sampled "
                   "loop with its delay, plotted at s = ln(z)/T. Crosses are approximate: a continuous loop with a "
                   "third-order Padé approximation of transport delay and half a sample, speed measured without lag.")


def steps(analysis: Analysis) -> Drawing:
    """Plot the steps of the linear models and of the simulated actuator."""
    figure, (row,) = plots.figure(1, max(len(analysis.steps), 1), height=2.6, sharex=True, sharey=True, x="time [ms]",
                                  y=["fin angle / step"])
    looks: list[Look] = [{**_THESIS, "label": "thesis's linear model"},
                         {"color": plots.BLUE, "label": "linearised here"},
                         {"color": plots.GREEN, "label": "simulated"}]
    settling_times = [s.metrics_nonlinear["settling_time"] for s in analysis.steps]
    end = 1e3 * float(np.clip(1.15 * np.max(settling_times, initial=0.0), 0.15, STOP))
    for axes, s in zip(row, analysis.steps, strict=False):
        plots.shade(axes, s.time * 1e3, s.active, "a limit is active")
        for angle, look in zip((s.thesis, s.linear, s.nonlinear), looks, strict=True):
            if angle is not None:
                axes.plot(s.time * 1e3, angle / s.size, **look)
        axes.text(0.97, 0.05, f"{s.size:+g} deg", transform=axes.transAxes, ha="right", fontsize=9)
        axes.set(xlim=(0, end))
    plots.legend_above(figure, 4)
    differences = ", ".join(f"{s.difference:.0f} % at {abs(s.size):g} deg" for s in analysis.steps)
    causes = list(neglected(analysis.actuator.actuator, analysis.parameters.values).values())
    small = f"Small steps differ because of {_listed(causes)}, any step" if causes else "Steps differ"
    return Drawing("Steps, linear and simulated", figure, "The fin angle over the step. Largest difference between "
                   f"simulated and linear: {differences}. {small} if a limit acts.")


def amplitudes(analysis: Analysis) -> Drawing:
    """Plot the bandwidths, and the lowest frequency at which each limit acts, against amplitude."""
    figure, (axes,) = plots.column("frequency [Hz]", x="amplitude of the command [deg]", height=3.6, width=7.5)
    sweeps, linear = analysis.sweeps, analysis.linear.command
    size = np.array([degrees(s.amplitude) for s in sweeps])
    axes.plot([], [], color=plots.GRAY, label="linear", **_DASHED)
    for label, color, name in (("-3 dB", plots.BLUE, "bandwidth"), ("-90 deg", plots.VERMILLION, "phase_bandwidth")):
        axes.loglog(size, [getattr(s.response, name) for s in sweeps], label=label, color=color, linewidth=1.8)
        if np.isfinite(at := getattr(linear, name)):
            axes.axhline(at, color=color, linewidth=0.9, label="linear", **_DASHED)
    limits = () if "limits" in analysis.left_out else LIMITS
    for name, color, marker in zip(limits, (plots.GREEN, plots.PURPLE, plots.ORANGE, plots.SKY), "os^x", strict=False):
        axes.loglog(size, [s.onset(name) for s in sweeps], label=f"{_LIMIT_NAMES[name]} limited above", color=color,
                    marker=marker, markersize=4.0, linewidth=0.9)
    axes.set_xticks(size, [f"{s:.3g}" for s in size], minor=False)
    axes.xaxis.set_minor_formatter("")
    low, high = axes.get_ylim()
    ticks = [tick for tick in (1, 2, 5, 10, 20, 50, 100) if low <= tick <= high]
    axes.set_yticks(ticks, list(map(str, ticks)))
    axes.yaxis.set_minor_formatter("")
    plots.legend_above(figure, 3)
    marks = ("Thin lines with marks: the lowest frequency at which a limit acts at some instant of the period. "
             if limits else "")
    causes = [key for key in neglected(analysis.actuator.actuator, analysis.parameters.values)
              if key not in ("compensation", "dead time")]
    small = f"Small amplitudes lose bandwidth to {_listed(causes)}, any amplitude" if causes else (
        "Amplitudes lose bandwidth")
    return Drawing("Bandwidth against amplitude", figure, "Describing function by steady sines of the simulated "
                   "actuator, about the operating point or as near to it as the range of commands allows. "
                   f"{marks}{small} if a limit acts.")


def limit_shares(analysis: Analysis) -> Drawing:
    """Plot the share of the time in which each limit acts, against amplitude and frequency."""
    figure, (row,) = plots.figure(1, len(LIMITS), height=2.7, sharex=True, sharey=True, x="amplitude [deg]",
                                  y=["frequency [Hz]"])
    sweeps = analysis.sweeps
    size, rows = np.array([degrees(s.amplitude) for s in sweeps]), shared(sweeps)
    for i, (axes, name) in enumerate(zip(row, LIMITS, strict=True)):
        share = 100.0 * np.array([s.active[i, at] for s, at in zip(sweeps, rows, strict=True)]).T
        mesh = axes.pcolormesh(size, sweeps[0].response.frequency[rows[0]], share, vmin=0, vmax=100, cmap="magma_r",
                               shading="nearest")
        axes.plot(size, [s.response.bandwidth for s in sweeps], color=plots.BLUE, linewidth=1.2)
        axes.set(xscale="log", yscale="log", title=_LIMIT_NAMES[name], xlim=(size[0], size[-1]),
                 xticks=[t for t in (0.1, 1.0, 10.0) if size[0] <= t <= size[-1] * 1.001])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_formatter("{x:g}")
    figure.colorbar(mesh, ax=list(row), pad=0.01).set_label("time at the limit [%]")
    return Drawing("Where the limits act", figure, "Share of the time in which a limit is active during a steady "
                   "sine; the line is the -3 dB bandwidth. The limit of the speed reference limits the fin rate.")


def torque_speed(analysis: Analysis) -> Drawing:
    """Plot the torque-speed envelope, and motor speed and torque in the reference cases."""
    figure, (axes,) = plots.column("motor torque [N.m]", x="motor speed [rpm]", height=4.0, width=7.5)
    e, cases = analysis.envelope, analysis.cases
    assert e is not None
    speed, highest, prompt = e["speed_rad_per_s"] * RPM, e["torque_nm"], e["prompt_torque_nm"]
    free, integral = e["no_load_speed_rad_per_s"] * RPM, e["integral_time_s"]
    axes.fill_between(speed, -highest[::-1], highest, color=plots.GRAY, alpha=0.13, linewidth=0)
    for side in (1.0, -1.0):
        axes.plot(side * speed, side * highest, label="motor and drive, steady", color=plots.INK, linewidth=1.2)
        axes.plot(side * speed, side * prompt, label="without the drive's integral", color=plots.GRAY, linewidth=1.0,
                  **_DASHED)
    named = {"step_plus20": plots.BLUE, "load_opposing": plots.VERMILLION, "load_aiding": plots.GREEN,
             "sag": plots.ORANGE}
    for name, columns in cases.items():
        dots = slice(None, None, max(len(columns["time"]) // _DOTS, 1))
        look = {"color": named[name], "alpha": 0.9, "zorder": 3.0, "label": name} if name in named else {
            "color": plots.SKY, "alpha": 0.35, "zorder": 2.0, "label": "other cases"}
        axes.plot(columns["motor_speed"][dots] * RPM, columns["motor_torque"][dots], ".", markersize=2.6, **look)
    if np.isfinite(limit := _speed_limit(analysis)):
        plots.limits(axes, limit * RPM, sides=True, across=False)
    fastest, most = (max(float(np.max(np.abs(columns[name]))) for columns in cases.values())
                     for name in ("motor_speed", "motor_torque"))
    end, top = 1.05 * max(free, fastest * RPM), max(1.05 * most, 1.1 * float(np.max(highest)))
    axes.set(xlim=(-end, end), ylim=(-top, top))
    plots.legend_above(figure, 4, markerscale=3)
    slow = f" within some {with_unit(float(f'{integral:.2g}'), 's')}" if np.isfinite(integral) else ""
    return Drawing("Torque and speed", figure, "Grey: steady torque within the limits of the drive's "
                   f"current ({e['stall_torque_nm']:.3g} N.m at stall) and the supply (no torque at {free:.0f} rpm). "
                   f"Dashed: torque at first, before the drive's integral adds the rest{slow}. Points: the reference "
                   "cases with these parameters; dotted verticals: the controllers' speed limit. Points outside the "
                   "grey area are transients, in which the current does not yet follow from the voltage.")


def _speed_limit(analysis: Analysis) -> float:
    """Return the controllers' limit of the motor speed [rad/s]; inf if they have none."""
    return float(analysis.parameters.actuator.plant(analysis.parameters.values).controller.speed_limit)


def fin_capability(analysis: Analysis) -> Drawing:
    """Plot hinge moment, fin rate and ratio against the fin angle."""
    figure, ((moment, rate, ratio),) = plots.figure(1, 3, height=2.6, sharex=True, x="fin angle [deg]")
    c = analysis.capability
    assert c is not None
    angle = np.degrees(c.fin_angle)
    looks: list[Look] = [{"color": plots.BLUE, "label": "moving +"},
                         {"color": plots.VERMILLION, "label": "moving -", **_DASHED}]
    for row, look in enumerate(looks):
        moment.plot(angle, c.stall[row], **look)
        rate.plot(angle, np.degrees(c.free_rate[row]), **look)
        rate.plot(angle, np.degrees(c.free_rate_loaded[row]), **{**look, "alpha": 0.45,
                                                                    "label": "paler: against 100 N.m"})
    rate.plot(angle, np.degrees(_speed_limit(analysis) / c.ratio), color=plots.PURPLE,
              linewidth=1.8, label="controllers' speed limit")
    plots.limits(rate, 220.0, 200.0, color=plots.GREEN, label="Table 2")
    ratio.plot(angle, c.ratio, color=plots.GRAY)
    for axes, label in ((moment, "stall moment [N.m]"), (rate, "fin rate [deg/s]"), (ratio, "ratio R")):
        axes.set_ylabel(label)
    plots.legend_above(figure, 5)
    return Drawing("Capability against fin angle", figure, "The ratio grows with the lever angle: the fin is then "
                   "stronger and slower. Left: the largest hinge moment against which the fin still "
                   "moves. Middle: the largest steady rate that supply and drive current allow, without load and "
                   "against 100 N.m, and the rate at the controllers' speed limit.")


# For each function its section of `analyse.SECTIONS`; empty if it applies to every actuator.
DRAWINGS: Mapping[Callable[[Analysis], Drawing], str] = {
    bode: "", nichols: "", root_locus: "", steps: "", amplitudes: "", limit_shares: "limits",
    torque_speed: "capability", fin_capability: "capability"}
