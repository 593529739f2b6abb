"""Picture and tables of docs/model/faults.md.

    python docs/figures/make_faults.py           # writes them
    python docs/figures/make_faults.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import radians
from typing import Any

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.bench.excitation import Excitation, times
from emcas_fmu.bench.runs import Runs
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.extensions.fault_list import bits, possible
from emcas_fmu.extensions.monitors import MONITORS
from emcas_fmu.motions import STEP
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots

BEGIN, END = 0.2, 0.4  # s, window of the faults under sines
SINES_END, DETECTION_END = 0.6, 2.0  # s, ends of the runs under sines, and of those of detection() and failed_motor()
LOAD, LOAD_OF_WEAKER = 40.0, {"servo": 4.0}  # N.m, amplitude of the load
SMALLEST = 0.005  # deg; smaller changes are rounding, or a count more or less


def _command(time: Any) -> Any:
    return radians(8.6) * np.sin(2.0 * np.pi * 3.0 * time)


def _has(model: str, fault: str) -> bool:
    return fault in {each.name for each in possible(get(model))}


def _runs(model: str, faults: Sequence[str], window: tuple[float, float], **inputs: Any) -> Runs:
    """Return the runs of a model: one with each fault, active in a `window` of time [s], and the last without fault."""
    subject = ParameterSubject(load_parameters(model=f"{model}+faults"))
    changes = {}
    for run, fault in enumerate(faults):
        for edge, time in zip(("begin", "end"), window, strict=True):
            name = f"fault.{fault}.{edge}"
            changes[name] = np.full(len(faults) + 1, subject.values[name])
            changes[name][run] = time
    runs = subject.run_all(Excitation("faults", inputs), changes)
    for run in range(len(runs)):
        runs[run].finished()  # raises if a run stopped
    return runs


def _under_sines(model: str, faults: Sequence[str]) -> Runs:
    time = times(SINES_END)
    return _runs(model, faults, (BEGIN, END), fin_command=_command(time),
                 aero_torque=LOAD_OF_WEAKER.get(model, LOAD) * np.sin(2.0 * np.pi * 1.7 * time))


def effects() -> str:
    """Return the table of the largest change of the fin angle due to each fault (rows) in each model (columns)."""
    cells: dict[str, dict[str, str]] = {name: {} for model in NAMES for name in bits(get(model))}
    for model in NAMES:
        faults = [name for name in cells if _has(model, name)]
        angle = np.degrees(_under_sines(model, faults).columns["fin_angle"])
        for fault, moved in zip(faults, np.abs(angle[:-1] - angle[-1]).max(axis=1), strict=True):
            cells[fault][model] = f"{moved:.2g}°" if moved > SMALLEST else "–"
    return markdown(("fault", *NAMES), [(f"`{fault}`", *(changes.get(model, "") for model in NAMES))
                                        for fault, changes in cells.items()])


def detection() -> str:
    """Return the table of the monitors that detect each fault of the nonlinear model, with their times."""
    faults, time = possible(get("nonlinear")), times(DETECTION_END)
    runs = _runs("nonlinear", [fault.name for fault in faults], (BEGIN, 1e9),
                 fin_command=np.radians(np.where(time % 1.0 < 0.5, 10.0, -10.0)))
    rows = []
    for fault, word in zip(faults, runs.columns["built_in_test"][:-1].astype(int), strict=True):
        tripped = [f"{monitor.name} after {np.flatnonzero(word & 2**i)[0] * STEP - BEGIN:.2f} s"
                   for i, monitor in enumerate(MONITORS) if (word & 2**i).any()]
        rows.append((f"`{fault.name}`", fault.description, ", ".join(tripped) or "–"))
    return markdown(("fault", "description", "detected by"), rows)


def failed_motor() -> str:
    """Return the table of a fin's final angle or time to the stop, and largest rate, after drive or winding fail."""
    names, rows = ("drive_loss", "winding_short", "phase_loss"), []
    for load in (20.0, 40.0, 100.0, 150.0):
        runs = _runs("nonlinear", names, (BEGIN, 1e9), aero_torque=np.full_like(times(DETECTION_END), load))
        cells = []
        for run in range(len(names)):
            columns, begun = runs[run].columns, times(BEGIN).size
            angle, rate = (np.degrees(columns[name])[begun:] for name in ("fin_angle", "fin_rate"))
            stopped = np.flatnonzero(columns["at_stop"])
            end = f"stop after {stopped[0] * STEP - BEGIN:.2f} s" if stopped.size else f"{angle[-1]:.2g}°"
            cells.append(f"{end}, {np.abs(rate).max():.3g}°/s")
        rows.append((f"{load:.0f} N·m", *cells))
    return markdown(("load", *(f"`{name}`" for name in names)), rows)


TABLES = {"model/faults.md": {"effects": effects, "detection": detection, "failed_motor": failed_motor}}


def _draw() -> None:
    faults = ("jam", "free_fin", "drive_loss", "hard_over", "encoder_reversed", "encoder_dropped", "brown_out",
              "command_delay")
    with plots.style():
        figure, axes = plots.figure(4, 2, height=1.75, sharex=True, sharey=True)
        runs = _under_sines("nonlinear", faults)
        for index, (name, axis) in enumerate(zip(faults, axes.flat, strict=True)):
            run = runs[index].columns
            axis.axvspan(BEGIN, END, color=plots.GRAY, alpha=0.18, linewidth=0.0)
            axis.plot(run["time"], np.degrees(_command(run["time"])), color=plots.GRAY, linewidth=1.0,
                      label="command")
            axis.plot(run["time"], np.degrees(run["fin_angle"]), color=plots.BLUE, label="fin angle")
            axis.plot(run["time"], np.degrees(run["measured_fin_angle"]), color=plots.VERMILLION, linestyle="--",
                      linewidth=1.0, label="measured")
            axis.set(title=name.replace("_", " "), ylim=(-28.0, 28.0), yticks=(-20, 0, 20))
        for axis in axes[-1]:
            axis.set(xlabel="time [s]")
        for axis in axes[:, 0]:
            axis.set(ylabel="angle [deg]")
        figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
        save(figure, "faults")


if __name__ == "__main__":
    check = "--check" in sys.argv[1:]
    if not check:
        _draw()
    sys.exit(main(check, TABLES, "make_faults.py"))
