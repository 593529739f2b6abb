"""Plot the pictures of docs/model/heat.md, and print the numbers of its text: `python docs/figures/make_heat.py`."""

from __future__ import annotations

from math import degrees, sin, tau
from typing import Any

import numpy as np
from make_tables import save

from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.envelope import draw, envelope

MODEL = "nonlinear+heat"
BASE = load_parameters(model=MODEL)
PERIOD, BUSY, STOP = 12.0, 6.0, 120.0  # s


def _command(t: float) -> float:
    """Return the command [rad]: a square wave of 15 deg at 4 Hz for BUSY s of every PERIOD s, otherwise 0."""
    if t % PERIOD >= BUSY:
        return 0.0
    return 0.26 if sin(tau * 4.0 * t) > 0.0 else -0.26


def _duty_cycle() -> None:
    inputs: dict[str, Any] = {"fin_command": _command, "aero_torque": lambda t: -120.0 if t % PERIOD < BUSY else -20.0}
    run = simulate(BASE.values, STOP, 2e-3, model=MODEL, **inputs)
    time, current = run["time"], np.abs(run["motor_current"])
    with plots.style():
        figure, axes = plots.figure(3, 1, height=1.9, sharex=True)
        (first,), (second,), (third,) = axes
        # The largest current in each 0.25 s, since single cycles are too narrow for the page.
        samples = 125
        largest = current[:len(current) // samples * samples].reshape(-1, samples).max(axis=1)
        first.fill_between(time[:len(largest) * samples:samples], largest, step="post", color=plots.SKY, linewidth=0.0,
                           label="motor current, largest in 0.25 s")
        first.plot(time, run["current_limit"], color=plots.VERMILLION, label="limit")
        first.set(ylabel="current [A]", ylim=(0.0, 75.0))
        first.legend(loc="upper right", ncols=2)
        second.plot(time, run["i2t_load"], color=plots.PURPLE)
        second.axhline(0.9, color=plots.GRAY, linestyle="--", linewidth=0.8)
        second.text(1.0, 0.92, "the limit folds back from here", va="bottom", fontsize=8, color=plots.GRAY)
        second.set(ylabel="I2t load", ylim=(0.0, 1.08))
        third.plot(time, run["winding_temperature"], color=plots.VERMILLION, label="winding")
        third.plot(time, run["case_temperature"], color=plots.BLUE, label="case")
        third.set(ylabel="temperature [°C]", xlabel="time [s]", xlim=(0.0, STOP))
        third.legend(loc="upper left", ncols=2)
        save(figure, "heat_duty_cycle")
    start = np.flatnonzero(run["current_limit"] < BASE.values["drive.current_limit"])[0]
    print(f"current limit reduced from {time[start]:.1f} s, burst {1 + int(time[start] // PERIOD)}, winding "
          f"{run['winding_temperature'][start]:.1f} degC; smallest limit from each burst to the next [A]: "
          + ", ".join(f"{run['current_limit'][(time >= t) & (time < t + PERIOD)].min():.1f}"
                      for t in np.arange(0.0, STOP, PERIOD)))
    winding, case = (run[f"{name}_temperature"][-1] for name in ("winding", "case"))
    print(f"duty cycle: winding {winding:.1f} degC, case {case:.1f} degC, "
          f"smallest limit {run['current_limit'].min():.1f} A, rms current {np.sqrt(np.mean(current**2)):.1f} A")


def _warm() -> None:
    """Print rate and time of a step of 20 deg against 60 N.m, with cold and with warm winding and case."""
    runs = []
    for winding, case in ((0.0, 0.0), (100.0, 60.0)):
        values = BASE.with_values({"heat.winding_start_rise": winding, "heat.case_start_rise": case}).values
        runs.append(simulate(values, 0.4, model=MODEL, fin_command=0.349, aero_torque=-60.0))
    for name, run in zip(("cold", "warm"), runs, strict=True):
        print(f"step of 20 deg against 60 N.m, {name}: peak rate {degrees(run['fin_rate'].max()):.1f} deg/s, "
              f"18 deg after {1e3 * np.interp(18.0, np.degrees(run['fin_angle'][:150]), run['time'][:150]):.1f} ms")
    print(f"  largest difference {degrees(np.abs(runs[0]['fin_angle'] - runs[1]['fin_angle']).max()):.2f} deg")


def _envelope() -> None:
    with plots.style():
        save(draw(envelope(BASE, 10.0)), "heat_envelope")


def main() -> None:
    _duty_cycle()
    _warm()
    _envelope()


if __name__ == "__main__":
    main()
