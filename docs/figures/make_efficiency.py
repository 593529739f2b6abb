"""Table and picture of docs/model/efficiency.md.

    python docs/figures/make_efficiency.py           # writes the picture, and the table between its markers
    python docs/figures/make_efficiency.py --check   # exit code 1 if the table is stale
"""

from __future__ import annotations

import sys
from math import cos, pi, radians
from typing import Any

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.bench.excitation import reference_case
from emcas_fmu.bench.metrics import sustained_rate
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+efficiency"
LOAD = 100.0  # N.m
RATE, REACH = 100.0, 10.0  # deg/s; deg, half of the stroke over which means are taken
BASE = load_parameters(model=MODEL)
# Efficiencies (forward, backward); backward = 2 - 1/forward.
SCREWS = ((1.0, 1.0), (0.9, 0.889), (0.7, 0.571), (0.5, 0.0))


def _run(screw: tuple[float, float], command: Any, torque: float, stop: float, **more: Any) -> dict[str, Any]:
    forward, backward = screw
    values = BASE.with_values({"efficiency.forward": forward, "efficiency.backward": backward, **more}).values
    return simulate(values, stop, 1e-4, model=MODEL, fin_command=command, aero_torque=torque)


def _stroke(screw: tuple[float, float], torque: float) -> list[str]:
    """Return cells for the stroke from -REACH to REACH at RATE: mean current, bus power and screw loss; bus energy."""
    # The ramp is 9 deg longer at both ends. No integral: it would make the fin faster than RATE to remove the lag.
    start = -REACH - 9.0
    run = _run(screw, lambda t: radians(start + RATE * t), torque, -2.0 * start / RATE,
               **{"fin.start_angle": radians(start), "controller.position.ki": 0.0})
    fin = np.degrees(run["fin_angle"])
    inside = (fin >= -REACH) & (fin <= REACH)
    seconds = np.count_nonzero(inside) * 1e-4
    power = np.mean(run["supply_power"][inside])
    return [f"{np.mean(run['motor_current'][inside]):.1f} A", f"{power:.0f} W",
            f"{np.mean(run['screw_loss'][inside]):.0f} W", f"{power * seconds:.1f} J"]


def _holding(screw: tuple[float, float]) -> str:
    """Return the smallest current that holds LOAD at angle zero: (backward LOAD/ratio - C_m)/K_t, at least 0."""
    v, (_, backward) = BASE.values, screw
    ratio = v["kinematics.moment_arm"] / v["screw.lead"] / cos(v["kinematics.initial_angle"])**2
    smallest = (backward * LOAD / ratio - v["friction.coulomb.positive[0]"]) / v["motor.torque_constant"]
    return f"{max(smallest, 0.0):.1f} A"


def _rate(screw: tuple[float, float]) -> str:
    """Return the rate of the slew against 100 N.m in the reference case `load_opposing`."""
    chosen = reference_case("load_opposing")
    forward, backward = screw
    values = BASE.with_values({"efficiency.forward": forward, "efficiency.backward": backward}).values
    inputs: dict[str, Any] = {name: chosen.columns[name] for name in ("fin_command", "aero_torque")}
    run = simulate(values, chosen.stop, chosen.step, model=MODEL, **inputs)
    slew = chosen.moves[-1]
    return f"{np.degrees(sustained_rate(run['time'], run['fin_angle'], slew.start, slew.level)):.0f}°/s"


def strokes() -> str:
    """Return the table of docs/model/efficiency.md."""
    head = ["forward / backward", *(f"{way}: {figure}" for way in ("against", "with") for figure in (
        "current", "bus power", "screw loss", "energy from the bus")), "holding current", "rate of a slew against"]
    rows = [[f"{screw[0]:g} / {screw[1]:g}", *_stroke(screw, -LOAD), *_stroke(screw, LOAD), _holding(screw),
             _rate(screw)] for screw in SCREWS]
    return markdown(head, rows)


def _move(time: float) -> float:
    """Return the command [rad]: -15 deg until 0.1 s, then to 15 deg in 0.3 s with rate 0 at both ends."""
    return -radians(15.0) * cos(pi * min(max(time - 0.1, 0.0), 0.3) / 0.3)


def _draw() -> None:
    with plots.style():
        figure, axes = plots.figure(2, 2, height=2.5, sharex=True, sharey="row")
        screws = ((SCREWS[0], plots.GREEN, "no loss"), (SCREWS[1], plots.BLUE, "0.9 / 0.889"),
                  (SCREWS[3], plots.VERMILLION, "0.5 / 0, self-locking"))
        for column, (way, torque) in enumerate((("against", -LOAD), ("with", LOAD))):
            for screw, color, label in screws:
                run = _run(screw, _move, torque, 0.6, **{"fin.start_angle": radians(-15.0), "encoder.enabled": False})
                axes[0][column].plot(run["time"], run["motor_current"], color=color, label=label, lw=1.0)
                axes[1][column].plot(run["time"], run["supply_power"] * 1e-3, color=color, label=label, lw=1.0)
            axes[0][column].set_title(f"30 deg {way} {LOAD:.0f} N.m")
            axes[1][column].set_xlabel("time [s]")
        axes[0][0].set_ylabel("motor current [A]")
        axes[1][0].set_ylabel("bus power [kW]")
        axes[0][1].legend(loc="upper right")
        save(figure, "efficiency")


TABLES = {"model/efficiency.md": {"strokes": strokes}}

if __name__ == "__main__":
    check = "--check" in sys.argv[1:]
    if not check:
        _draw()
    sys.exit(main(check, TABLES, "make_efficiency.py"))
