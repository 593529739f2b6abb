"""Figures of a flight, and the files of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.studies.fitting import Fit

from .autopilot import attitude_error
from .convergence import Convergence
from .flight import Manoeuvre
from .masters import Agreement, agreement
from .vehicle import FINS, Array

Flight = Mapping[str, Array]
AXES = ("roll", "pitch", "yaw")
UNDELAYED = "second-order-undelayed"
ACTUATORS = ("ideal", UNDELAYED, "second-order", "nonlinear", "stiff")
"""The last two are the FMU, on a bus with source resistance and on a stiff one."""
BUS = ("nonlinear", "stiff")
"""Actuators whose power is that of the electric bus; the others know mechanical power only."""
_COMPARED = {"ideal": ("ideal",), UNDELAYED: ("ideal",), "second-order": ("ideal",),
             "nonlinear": ("ideal", "second-order", "stiff"), "stiff": ("ideal", "second-order")}
WITHOUT_ENCODER = "nonlinear, encoder off"
WITHOUT_SSP = "without SSP"


@dataclass(frozen=True)
class Results:
    """Everything a run found; flights by manoeuvre, then actuator."""

    step: float
    """Communication step [s]."""
    flights: Mapping[str, Mapping[str, Flight]]
    manoeuvres: Mapping[str, Manoeuvre]
    second_order: Fit | None = None
    convergence: Mapping[str, Convergence] = field(default_factory=dict)
    guid: str = ""
    unit: str = "EMCAS4.fmu"
    """What the FMU is called."""
    bus_resistance: float = 0.0
    """Of the source [Ohm]; 0: stiff."""
    bus_voltage: float | None = None
    """Of the source of the FMU [V]."""
    masters: Mapping[str, Mapping[str, Flight]] = field(default_factory=dict)
    """Flights by manoeuvre, then master; the first is what the others are compared with."""

    @property
    def labels(self) -> dict[str, str]:
        """What the actuators are called in pictures and tables."""
        bus = f", bus of {1e3 * self.bus_resistance:g} mΩ" if self.bus_resistance else ""
        return {"ideal": "fin = command", UNDELAYED: "second order, no delay",
                "second-order": "second order", "nonlinear": f"{self.unit}{bus}",
                "stiff": f"{self.unit}, stiff bus", WITHOUT_SSP: f"{self.unit} under fmpy, no SSP"}


def fins(flight: Flight, quantity: str) -> Array:
    """Columns of the four fins, `{}` in `quantity` standing for the number; shape (4, rows)."""
    return np.array([flight[quantity.format(k)] for k in FINS])


def angles(flight: Flight, prefix: str = "") -> Array:
    """Roll, pitch, yaw [rad], shape (3, rows); `prefix` "wanted_" for the wanted ones."""
    return np.array([flight[f"{prefix}{axis}_rad"] for axis in AXES])


def turn_between(first: Array, second: Array) -> Array:
    """Angle of the turn from one attitude to another [deg] for roll, pitch, yaw (3, rows); shape (rows,)."""
    return np.degrees([np.arcsin(min(1.0, float(np.linalg.norm(attitude_error(a, b)))))
                       for a, b in zip(first.T, second.T, strict=True)])


def figures(flight: Flight, step: float, others: Mapping[str, Flight]) -> dict[str, float]:
    """Figures of one flight; names end in their unit. `others` are flights to compare with, by actuator."""
    power = flight["power_w"]
    missed = turn_between(angles(flight), angles(flight, "wanted_"))
    found = {
        "attitude_error_rms_deg": float(np.sqrt(np.mean(missed**2))),
        "attitude_error_end_deg": float(missed[-1]),
        "incidence_largest_deg": float(np.degrees(flight["incidence_rad"].max())),
        "lateral_acceleration_largest_m_s2": float(np.hypot(flight["acceleration_y_m_s2"],
                                                            flight["acceleration_z_m_s2"]).max()),
        "fin_angle_largest_deg": float(np.degrees(np.abs(fins(flight, "fin{}_rad")).max())),
        "fin_rate_largest_deg_s": float(np.degrees(np.abs(fins(flight, "fin_rate{}_rad_s")).max())),
        "hinge_moment_largest_n_m": float(np.abs(fins(flight, "hinge{}_n_m")).max()),
        "saturated_percent": float(100.0 * fins(flight, "saturated{}").mean()),
        "power_largest_w": float(power.max()),
        "energy_drawn_j": float(np.maximum(power, 0.0).sum() * step),
        "energy_returned_j": float(np.maximum(-power, 0.0).sum() * step),
        "speed_end_m_s": float(flight["speed_m_s"][-1]),
    }
    if "bus_voltage_v" in flight:
        found["bus_voltage_lowest_v"] = float(flight["bus_voltage_v"].min())
        found["bus_current_largest_a"] = float(flight["bus_current_a"].max())
    for name, other in others.items():
        apart = turn_between(angles(flight), angles(other))
        found[f"attitude_difference_to_{name.replace('-', '_')}_deg"] = float(apart.max())
    return found


def all_figures(results: Results) -> dict[str, dict[str, dict[str, float]]]:
    """By manoeuvre and actuator."""
    return {name: {actuator: figures(flight, results.step, {o: flown[o] for o in _COMPARED[actuator] if o in flown})
                   for actuator, flight in flown.items()} for name, flown in results.flights.items()}


def agreements(results: Results) -> dict[str, dict[str, Agreement]]:
    """By manoeuvre and master, how far its flight is from that of the first."""
    return {name: {master: agreement(flight, next(iter(flown.values()))) for master, flight in flown.items()}
            for name, flown in results.masters.items()}


def write_json(results: Results, path: Path, command: str) -> None:
    """All figures, the fitted second-order actuator and the convergence."""
    fit = results.second_order
    content: dict[str, Any] = {
        "command": command, "communication_step_s": results.step, "guid": results.guid,
        "bus_resistance_ohm": results.bus_resistance, "bus_voltage_v": results.bus_voltage,
        "flights": all_figures(results),
        "masters": {name: {master: {"fin_difference_rad": a.fins, "attitude_difference_rad": a.attitude,
                                    "identical": a.identical} for master, a in found.items()}
                    for name, found in agreements(results).items()},
        "second_order": None if fit is None else fit.figures(),
        "convergence": {name: {"step_s": c.steps.tolist(), "attitude_error_deg": c.attitude.tolist(),
                               "fin_error_deg": c.fins.tolist(), "attitude_order": c.order(c.attitude),
                               "fin_order": c.order(c.fins)} for name, c in results.convergence.items()}}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8", newline="\n")


def write_flights(results: Results, folder: Path, kind: str) -> Sequence[Path]:
    """Every flight as MANOEUVRE_ACTUATOR.csv or .npz, columns with their unit at the end of the name.

    Those in a master are MANOEUVRE_ssp-MASTER.
    """
    written = []
    for manoeuvre, actuated in results.flights.items():
        flown = {**actuated, **{f"ssp-{master}": flight for master, flight in results.masters.get(manoeuvre, {}).items()
                                if master != WITHOUT_SSP}}
        for actuator, flight in flown.items():
            path = folder / f"{manoeuvre}_{actuator}.{kind}"
            if kind == "npz":
                np.savez_compressed(path, **flight)  # type: ignore[arg-type]
            else:
                np.savetxt(path, np.column_stack(list(flight.values())), fmt="%.9g", delimiter=",", comments="",
                           header=",".join("time_s" if name == "time" else name for name in flight))
            written.append(path)
    return written
