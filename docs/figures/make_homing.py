"""Plot the picture of docs/model/homing.md, and print its tables: `python docs/figures/make_homing.py`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import degrees, radians
from typing import Any

import numpy as np
from make_tables import save

from emcas_fmu.actuators import get
from emcas_fmu.extensions.status import OPERATIONAL, STATUS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+homing"
START, COMMAND, HOME = radians(-8.0), radians(10.0), (0.5, 7.5)  # rad, rad, s
MODELS = ("nonlinear", "elastic", "habibi", "ozkan", "ristanovic")
STARTS = np.radians(np.linspace(-25.0, 25.0, 41))


def _run(obstacle: Callable[[float, float], float], stop: float) -> dict[str, Any]:
    """Return the outputs every 1 ms until `stop` [s]; `home` rises at the times HOME.

    `obstacle` returns a torque [N.m] for a time [s] and a fin angle [rad].
    """
    core = codegen.core(load_parameters(model=MODEL).with_values({"fin.start_angle": START}).values, MODEL)
    rows = []
    angle = START
    for k in range(round(stop / 1e-3)):
        t = k * 1e-3
        home = any(0.0 <= t - rise < 0.5 for rise in HOME)
        rows.append(core.run(t + 1e-3, codegen.inputs_at_rest(COMMAND, obstacle(t, angle), 39.0, True, home)))
        angle = rows[-1][0]
    names = [v.name for v in get(MODEL).outputs]
    return {"time": np.arange(1, len(rows) + 1) * 1e-3, **dict(zip(names, np.array(rows, float).T, strict=True))}


def _column(axes: Any, run: Mapping[str, Any], title: str) -> None:
    t = run["time"]
    axes[0].plot(t, np.degrees(run["fin_angle"]), color=plots.BLUE, label="true")
    axes[0].plot(t, np.degrees(run["measured_fin_angle"]), color=plots.VERMILLION, linestyle="--",
                 label="believed")
    axes[0].axhline(degrees(COMMAND), color=plots.GRAY, linestyle=":", linewidth=1.0, label="command")
    for stop in (-25.0, 25.0):
        axes[0].axhline(stop, color=plots.GRAY, linewidth=0.8)
    axes[0].set(title=title, ylabel="fin angle [deg]", ylim=(-48.0, 48.0))
    axes[1].plot(t, run["motor_current"], color=plots.GREEN)
    for limit in (-8.19, 8.19):
        axes[1].axhline(limit, color=plots.GRAY, linestyle=":", linewidth=1.0)
    axes[1].set(ylabel="motor current [A]", ylim=(-12.0, 12.0))
    axes[2].step(t, run["status"], where="pre", color=plots.PURPLE)
    axes[2].set(xlabel="time [s]", yticks=range(1, 7), ylim=(0.6, 6.4),
                yticklabels=[item for item, _ in STATUS.items])
    for rise in HOME:
        if rise < t[-1]:
            for each in axes:
                each.axvline(rise, color=plots.ORANGE, linewidth=1.0)
            axes[0].text(rise, 47.0, " home", color=plots.ORANGE, va="top")


def _draw() -> None:
    clear = _run(lambda *_: 0.0, 7.4)
    blocked = _run(lambda t, angle: -3e3 * max(angle - radians(12.0), 0.0) if t < 6.8 else 0.0, 15.5)
    with plots.style():
        figure, axes = plots.figure(3, 2, height=2.0, sharex="col")
        _column(axes[:, 0], clear, "From −8°")
        _column(axes[:, 1], blocked, "Obstacle at 12°, taken away at 6.8 s")
        axes[0][0].legend(loc="lower left", ncols=3)
        save(figure, "homing")


def _zeros() -> None:
    """Print the table of the largest error of the zero, and of the shortest and longest homing run, from STARTS."""
    print("| model | both stops | one stop only | shortest and longest run |\n|---|---|---|---|")
    for name in MODELS:
        row, times = [], []
        for verify in (True, False):
            errors = []
            for start in STARTS:
                values = load_parameters(model=f"{name}+homing").with_values({
                    "fin.start_angle": start, "homing.verify": verify}).values
                run = simulate(values, 7.2, model=f"{name}+homing", home=True)
                assert run["status"][-1] == OPERATIONAL, (name, start)
                motor = run["motor_angle"][-2] * values["screw.lead"] / values["kinematics.moment_arm"]
                errors.append(degrees(run["measured_fin_angle"][-1] - motor))  # small angles, near zero
                if verify:
                    times.append(run["time"][np.argmax(run["status"] == OPERATIONAL)])
            row.append(f"{np.abs(errors).max():.4f}°")
        print(f"| `{name}` | {row[0]} | {row[1]} | {min(times):.2f} s, {max(times):.2f} s |")


def _homes(name: str, temperature: float, load: float) -> bool:
    """Return whether a model homes from zero under a constant load [N.m] at a temperature [degC], in both orders."""
    for first in (True, False):
        values = load_parameters(model=f"{name}+homing").with_values({
            "friction.temperature": temperature, "homing.positive_first": first}).values
        if simulate(values, 15.1, model=f"{name}+homing", home=True, aero_torque=load)["status"][-1] != OPERATIONAL:
            return False
    return True


def _loads() -> None:
    """Print the table of the largest load [N.m] at which homing succeeds, in steps of 1 N.m from 0."""
    print("| model | 24 °C | -6 °C |\n|---|---|---|")
    for name in MODELS:
        row = []
        for temperature in (24.0, -6.0):
            most = [next(k for k in range(100) if not _homes(name, temperature, sign * (k + 1.0))) for sign in (1, -1)]
            row.append(f"+{most[0]}, -{most[1]} N·m")
        print(f"| `{name}` | {row[0]} | {row[1]} |")


def _cost() -> None:
    """Print the CPU time [ms] of a simulated second in closed loop, in Python."""
    for model, more in (("nonlinear", {}), (MODEL, {"homing.required": False})):
        values = load_parameters(model=model).with_values(more).values
        times = []
        for _ in range(5):
            begun = time.process_time()
            simulate(values, 2.0, kernel="python", model=model, fin_command=0.1)
            times.append(time.process_time() - begun)
        print(f"{model}: {min(times) * 500.0:.1f} ms")


def main() -> None:
    _draw()
    _zeros()
    _loads()
    _cost()


if __name__ == "__main__":
    main()
