"""Figures of a flight, and the files of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu.studies.fitting import SecondOrderFit

from .autopilot import attitude_error
from .convergence import Convergence
from .flight import Manoeuvre
from .masters import Agreement, agreement
from .vehicle import FINS, Array

Flight = Mapping[str, Array]
AXES = ("roll", "pitch", "yaw")
IDEAL, SECOND_ORDER, UNDELAYED, FMU, STIFF = "ideal", "second-order", "second-order-undelayed", "fmu", "stiff"
ACTUATORS = (IDEAL, UNDELAYED, SECOND_ORDER, FMU, STIFF)
"""The values of --actuator.

`fmu` is every FMU, whose flights have the name of its model; an FMU of four on a bus has the bus's source resistance.
`stiff` is a single FMU without this resistance.
"""
WITHOUT_ENCODER = "{}, encoder off"
WITHOUT_SSP = "without SSP"
END = 0.5  # s, the end of a flight in which the attitude error is judged
KEPT = 5.0  # deg, the largest attitude error there


@dataclass(frozen=True)
class Unit:
    """An FMU that is flown: its file name and GUID, and its supply.

    `supply` is the supply's input, `level` its start value [V] or [Pa]; both are None without a supply.
    `bus_resistance` [Ohm] is that of the bus's source, 0 for a stiff bus.
    """

    file: str
    guid: str
    supply: str | None
    level: float | None
    bus_resistance: float

    @property
    def label(self) -> str:
        """Name of the file, and the bus resistance."""
        return self.file + (f", bus of {1e3 * self.bus_resistance:g} mΩ" if self.bus_resistance else "")


@dataclass(frozen=True)
class Results:
    """The results of a run with a communication `step` [s].

    `flights` are by manoeuvre, then actuator; `masters` are flights by manoeuvre, then master, of which the first is
    the reference. `convergence` is by actuator; `units` are the FMUs by model.
    """

    step: float
    flights: Mapping[str, Mapping[str, Flight]]
    manoeuvres: Mapping[str, Manoeuvre]
    second_order: SecondOrderFit | None = None
    convergence: Mapping[str, Convergence] = field(default_factory=dict)
    units: Mapping[str, Unit] = field(default_factory=dict)
    masters: Mapping[str, Mapping[str, Flight]] = field(default_factory=dict)

    @property
    def labels(self) -> dict[str, str]:
        """Names of the actuators in pictures and tables."""
        file = next((unit.file for unit in self.units.values()), "FMU")
        return {IDEAL: "fin = command", UNDELAYED: "second order, no delay", SECOND_ORDER: "second order",
                STIFF: f"{file}, stiff bus", WITHOUT_SSP: f"{file} under fmpy, no SSP",
                **{name: unit.label if len(self.units) == 1 else name for name, unit in self.units.items()}}


def power_kind(flight: Flight) -> str:
    """Return the kind of power of a flight: electric or hydraulic from the supply, otherwise mechanical."""
    return "electric" if "bus_voltage_v" in flight else "hydraulic" if "line_pressure_pa" in flight else "mechanical"


def kept(figures: Mapping[str, float]) -> bool:
    """Return whether the attitude error in the end is at most KEPT."""
    return figures["attitude_error_last_half_second_deg"] <= KEPT


def fins(flight: Flight, quantity: str) -> Array:
    """Return the columns of the four fins [4, rows]; `{}` in `quantity` is replaced by the fin's number."""
    return np.array([flight[quantity.format(k)] for k in FINS])


def angles(flight: Flight, prefix: str = "") -> Array:
    """Return roll, pitch and yaw [rad] [3, rows]; with the `prefix` "wanted_" the commanded ones."""
    return np.array([flight[f"{prefix}{axis}_rad"] for axis in AXES])


def turn_between(first: Array, second: Array) -> Array:
    """Return the angle [deg] of the rotation between two attitudes [rad] [3, rows]: an array [rows]."""
    return np.degrees([np.arcsin(min(1.0, float(np.linalg.norm(attitude_error(a, b)))))
                       for a, b in zip(first.T, second.T, strict=True)])


def figures(flight: Flight, step: float, others: Mapping[str, Flight]) -> dict[str, float]:
    """Return the figures of a flight with communication steps of `step` [s]; their names end in units.

    `others` are the flights to compare with, by actuator.
    """
    power = flight["power_w"]
    errors = turn_between(angles(flight), angles(flight, "wanted_"))
    fin_errors = np.degrees(fins(flight, "command{}_rad") - fins(flight, "fin{}_rad"))
    result = {
        "attitude_error_rms_deg": float(np.sqrt(np.mean(errors**2))),
        "attitude_error_end_deg": float(errors[-1]),
        "attitude_error_last_half_second_deg": float(errors[flight["time"] > flight["time"][-1] - END].max()),
        "incidence_largest_deg": float(np.degrees(flight["incidence_rad"].max())),
        "lateral_acceleration_largest_m_s2": float(np.hypot(flight["acceleration_y_m_s2"],
                                                            flight["acceleration_z_m_s2"]).max()),
        "fin_angle_largest_deg": float(np.degrees(np.abs(fins(flight, "fin{}_rad")).max())),
        "fin_error_rms_deg": float(np.sqrt(np.mean(fin_errors**2))),
        "fin_error_largest_deg": float(np.abs(fin_errors).max()),
        "fin_rate_largest_deg_s": float(np.degrees(np.abs(fins(flight, "fin_rate{}_rad_s")).max())),
        "hinge_moment_largest_n_m": float(np.abs(fins(flight, "hinge{}_n_m")).max()),
        "saturated_percent": float(100.0 * fins(flight, "saturated{}").mean()),
        "power_largest_w": float(power.max()),
        "energy_drawn_j": float(np.maximum(power, 0.0).sum() * step),
        "energy_returned_j": float(np.maximum(-power, 0.0).sum() * step),
        "speed_end_m_s": float(flight["speed_m_s"][-1]),
    }
    if "bus_voltage_v" in flight:
        result["bus_voltage_lowest_v"] = float(flight["bus_voltage_v"].min())
        result["bus_current_largest_a"] = float(flight["bus_current_a"].max())
    if "line_flow_m3_s" in flight:
        result["line_pressure_lowest_mpa"] = 1e-6 * float(flight["line_pressure_pa"].min())
        result["line_flow_largest_l_min"] = 6e4 * float(flight["line_flow_m3_s"].max())
    for name, other in others.items():
        difference = turn_between(angles(flight), angles(other))
        result[f"attitude_difference_to_{name.replace('-', '_')}_deg"] = float(difference.max())
    return result


def all_figures(results: Results) -> dict[str, dict[str, dict[str, float]]]:
    """Return the figures by manoeuvre and actuator.

    Each flight is compared with ideal fins, that of an FMU also with the second-order actuator and the stiff bus.
    """
    def others(actuator: str) -> tuple[str, ...]:
        return (IDEAL, SECOND_ORDER, STIFF) if actuator in (*results.units, STIFF) else (IDEAL,)

    return {name: {actuator: figures(flight, results.step, {o: flown[o] for o in others(actuator)
                                                            if o in flown and (o != actuator or o == IDEAL)})
                   for actuator, flight in flown.items()} for name, flown in results.flights.items()}


def agreements(results: Results) -> dict[str, dict[str, Agreement]]:
    """Return the agreement of each flight with that of the first master, by manoeuvre and master."""
    return {name: {master: agreement(flight, next(iter(flown.values()))) for master, flight in flown.items()}
            for name, flown in results.masters.items()}


def write_json(results: Results, path: Path, command: str) -> None:
    """Write all figures, the fitted second-order actuator and the convergence."""
    fit = results.second_order
    content: dict[str, Any] = {
        "command": command, "communication_step_s": results.step,
        "fmus": {name: {"file": unit.file, "guid": unit.guid, "supply": unit.supply, "supply_start": unit.level,
                        "bus_resistance_ohm": unit.bus_resistance} for name, unit in results.units.items()},
        "flights": all_figures(results),
        "masters": {name: {master: {"fin_difference_rad": a.fins, "attitude_difference_rad": a.attitude,
                                    "identical": a.identical} for master, a in by_master.items()}
                    for name, by_master in agreements(results).items()},
        "second_order": None if fit is None else fit.figures(),
        "convergence": {name: {"step_s": c.steps.tolist(), "attitude_error_deg": c.attitude.tolist(),
                               "fin_error_deg": c.fins.tolist(), "attitude_order": c.order(c.attitude),
                               "fin_order": c.order(c.fins)} for name, c in results.convergence.items()}}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8", newline="\n")


def write_flights(results: Results, folder: Path, kind: str) -> Sequence[Path]:
    """Write each flight as MANOEUVRE_ACTUATOR.csv or .npz, and return the paths.

    `kind` is csv or npz; the names of columns end in units. A flight in a master is MANOEUVRE_ssp-MASTER.
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
