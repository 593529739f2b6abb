"""A simulated response for people and machines: figures of merit, a table, a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .bench.excitation import Excitation
from .bench.metrics import rms
from .plots import BLUE, GRAY, VERMILLION, figure, shade, style, write
from .simulation import Array
from .variables import Variable

_PANELS = (("fin_rate", "fin rate [deg/s]", degrees(1.0)), ("motor_current", "current [A]", 1.0),
           ("motor_voltage", "voltage [V]", 1.0), ("supply_power", "power [W]", 1.0))


def figures_of_merit(result: Mapping[str, Array], own: Sequence[Variable] = ()) -> dict[str, float]:
    """What one asks of a response first, as far as it has the outputs, units in the names; of a model's `own` outputs
    the last value, SI."""
    figures: Mapping[str, tuple[str, Callable[[Array], Any]]] = {
        "fin_angle_final_deg": ("fin_angle", lambda x: degrees(x[-1])),
        "fin_rate_peak_deg_per_s": ("fin_rate", lambda x: degrees(np.abs(x).max())),
        "tracking_error_peak_deg": ("tracking_error", lambda x: degrees(np.abs(x).max())),
        "tracking_error_final_deg": ("tracking_error", lambda x: degrees(x[-1])),
        "motor_current_peak_a": ("motor_current", lambda x: np.abs(x).max()),
        "motor_current_rms_a": ("motor_current", rms),
        "supply_energy_j": ("supply_power", lambda x: np.trapezoid(x, result["time"])),
        "saturated_share": ("saturated", np.mean),
    }
    found = {name: float(figure(result[output])) for name, (output, figure) in figures.items() if output in result}
    return found | {f"{v.name}_final": float(result[v.name][-1]) for v in own}


def write_csv(path: Path, excitation: Excitation, result: Mapping[str, Array]) -> None:
    """Time, the inputs given and every output, SI, with 17 digits: what was computed, to the bit."""
    table = np.column_stack([result["time"], *excitation.columns.values(),
                             *(column for name, column in result.items() if name != "time")])
    names = ["time", *excitation.columns, *(name for name in result if name != "time")]
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(names), comments="")


def draw(excitation: Excitation, result: Mapping[str, Array], own: Sequence[Variable] = ()) -> Figure:
    """Command and angle, tracking error, rate, current, voltage, power, a model's `own` outputs; limits shaded."""
    time = result["time"]
    panels = [panel for panel in _PANELS if panel[0] in result]
    panels += [(v.name, f"{v.name.replace('_', ' ')}{f' [{v.unit}]' if v.kind == 'Real' else ''}", 1.0) for v in own]
    made, grid = figure(1 + (len(panels) + 1) // 2, 2, width=10.0, sharex=True)
    first, second, *rest = grid.ravel()
    if "fin_command" in excitation.columns:
        first.step(time, np.degrees(excitation.columns["fin_command"]), where="post", color=GRAY, label="command")
    first.plot(time, np.degrees(result["fin_angle"]), color=BLUE, label="fin angle")
    first.set_title(excitation.title)
    first.set_ylabel("angle [deg]")
    first.legend(loc="best")
    second.plot(time, np.degrees(result["tracking_error"]), color=VERMILLION)
    second.set_ylabel("tracking error [deg]")
    discrete = {v.name for v in own if v.kind != "Real"}
    for axes, (name, label, scale) in zip(rest, panels, strict=False):
        axes.plot(time, result[name] * scale, color=BLUE, drawstyle="steps-pre" if name in discrete else "default")
        axes.set_ylabel(label)
    for v, axes in zip(own, rest[len(panels) - len(own):], strict=False):
        if v.items:
            axes.set_yticks(range(1, len(v.items) + 1), [item for item, _ in v.items])
            axes.set_ylim(0.5, len(v.items) + 0.5)
        elif v.kind != "Real":
            axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    for axes in rest[len(panels):]:
        axes.set_visible(False)
    for axes in grid.ravel():
        shade(axes, time, result["saturated"] > 0.0)
        axes.margins(x=0.0)
    for axes in grid[-1]:
        axes.set_xlabel("time [s] (shaded: a limit is active)")
    return made


def write_picture(path: Path, excitation: Excitation, result: Mapping[str, Array],
                  own: Sequence[Variable] = ()) -> None:
    """The response as ``.html``, ``.svg``, ``.png`` or ``.pdf``. Raises EmcasError for another ending."""
    with style():
        write(draw(excitation, result, own), path, excitation.title)
