"""Tables of docs/model/supply.md.

    python docs/figures/make_supply.py           # writes the tables
    python docs/figures/make_supply.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from math import radians, sin
from typing import Any

import numpy as np
from make_tables import main, markdown

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

MODEL = "nonlinear+supply"
STOP, STEP = 0.4, 1e-4  # s


def _run(model: str, command: Any, load: float = 0.0, **overrides: Any) -> Mapping[str, Any]:
    changes = {f"supply.{name}": value for name, value in overrides.items()}
    values = load_parameters(model=model).with_values(changes).values
    return simulate(values, STOP, STEP, model=model, fin_command=command, aero_torque=load)


def _link(run: Mapping[str, Any]) -> str:
    return f"{run['link_voltage'].min():.1f} … {run['link_voltage'].max():.1f} V"


def steps() -> str:
    """Return the table of a step of 20 deg under loads: with the extension and, in brackets, without it."""
    rows = []
    for load in (0.0, -60.0, -100.0):
        with_it, without = (_run(model, radians(20.0), load) for model in (MODEL, "nonlinear"))
        energies = [np.trapezoid(run["supply_power"], run["time"]) for run in (with_it, without)]
        times = [run["time"][np.argmax(run["fin_angle"] > radians(18.0))] for run in (with_it, without)]
        peak, plain = (run["supply_power"].max() for run in (with_it, without))
        rows.append([f"{load:.0f} N·m", _link(with_it), f"{1e-3 * peak:.2f} kW ({1e-3 * plain:.2f})",
                     f"{with_it['brake_power'].max():.0f} W ({-without['supply_power'].min():.0f})",
                     f"{energies[0]:.1f} J ({energies[1]:.1f})", f"{1e3 * times[0]:.1f} ms ({1e3 * times[1]:.1f})"])
    return markdown(("load", "link voltage", "peak supply power", "peak brake power (returned to the bus)",
                     "supply energy", "time to 18°"), rows)


def sources() -> str:
    """Return the table of a square wave of +-20 deg at 3.2 Hz: the default set, without chopper and without diode."""
    rows = []
    for words, changes in (("default", {}), ("no chopper", {"chopper_voltage": 1e5}), ("no diode", {"one_way": False})):
        run = _run(MODEL, lambda t: radians(20.0) if sin(20.0 * t) > 0.0 else -radians(20.0), **changes)
        rows.append([words, _link(run), f"{max(0.0, -run['supply_power'].min()):.0f} W",
                     f"{np.trapezoid(run['brake_power'], run['time']):.1f} J"])
    return markdown(("", "link voltage", "peak power into the source", "energy of the brake"), rows)


TABLES = {"model/supply.md": {"steps": steps, "sources": sources}}

if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_supply.py"))
