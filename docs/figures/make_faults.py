"""Picture and tables of docs/model/faults.md.

    python docs/figures/make_faults.py           # writes them
    python docs/figures/make_faults.py --check   # exit code 1 where a table is stale
"""

from __future__ import annotations

import sys
from math import degrees, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from make_tables import main, markdown

from emcas_fmu import plots
from emcas_fmu.actuators import NAMES, get
from emcas_fmu.extensions.fault_list import bits, possible
from emcas_fmu.extensions.monitors import MONITORS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

HERE = Path(__file__).parent
BEGIN, END, STOP = 0.2, 0.4, 0.6  # s
FOUND_STOP = 2.0  # s
# What is below is rounding, or a count more or less.
LEAST = 0.005  # deg


def _command(time: float) -> float:
    return radians(8.6) * sin(2.0 * pi * 3.0 * time)


def _load(time: float) -> float:
    return 40.0 * sin(2.0 * pi * 1.7 * time)


def _has(model: str, fault: str) -> bool:
    return fault in {each.name for each in possible(get(model))}


def _run(model: str, fault: str, begin: float = BEGIN, end: float = END) -> dict[str, Any]:
    window = {f"fault.{fault}.begin": begin, f"fault.{fault}.end": end}
    values = load_parameters(model=f"{model}+faults").with_values(window).values
    return simulate(values, STOP, model=f"{model}+faults", fin_command=_command, aero_torque=_load)


def acting() -> str:
    """What each fault does to the fin angle of each model that can have it."""
    rows = []
    sound = {model: simulate(load_parameters(model=model).values, STOP, model=model, fin_command=_command,
                             aero_torque=_load)["fin_angle"] for model in NAMES}
    for fault in dict.fromkeys(name for model in NAMES for name in bits(get(model))):
        row = [f"`{fault}`"]
        for model in NAMES:
            if not _has(model, fault):
                row.append("")
                continue
            moved = degrees(np.abs(_run(model, fault)["fin_angle"] - sound[model]).max())
            row.append(f"{moved:.2g}°" if moved > LEAST else "–")
        rows.append(row)
    return markdown(("fault", *NAMES), rows)


def found() -> str:
    """What the built-in test of the nonlinear model finds, and when."""
    rows = []
    for fault in possible(get("nonlinear")):
        values = load_parameters(model="nonlinear+faults").with_values({
            f"fault.{fault.name}.begin": BEGIN, f"fault.{fault.name}.end": 1e9}).values
        run = simulate(values, FOUND_STOP, model="nonlinear+faults",
                       fin_command=lambda t: radians(10.0 if t % 1.0 < 0.5 else -10.0))
        words = run["built_in_test"].astype(int)
        seen = [f"{monitor.name} after {np.flatnonzero(words & 2**i)[0] * 1e-3 - BEGIN:.2f} s"
                for i, monitor in enumerate(MONITORS) if (words & 2**i).any()]
        rows.append((f"`{fault.name}`", fault.description, ", ".join(seen) or "–"))
    return markdown(("fault", "what it is", "found by"), rows)


TABLES = {"model/faults.md": {"acting": acting, "found": found}}


def _draw() -> None:
    shown = ("jam", "free_fin", "drive_loss", "hard_over", "encoder_reversed", "encoder_dropped", "brown_out",
             "command_delay")
    with plots.style():
        figure, axes = plots.figure(4, 2, height=1.75, sharex=True, sharey=True)
        for name, axis in zip(shown, axes.flat, strict=True):
            run = _run("nonlinear", name)
            axis.axvspan(BEGIN, END, color=plots.GRAY, alpha=0.18, linewidth=0.0)
            axis.plot(run["time"], [degrees(_command(t)) for t in run["time"]], color=plots.GRAY, linewidth=1.0,
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
        figure.savefig(HERE / "faults.png", dpi=110, facecolor="white", metadata={"Software": None})


if __name__ == "__main__":
    check = "--check" in sys.argv[1:]
    if not check:
        _draw()
    sys.exit(main(check, TABLES, "make_faults.py"))
