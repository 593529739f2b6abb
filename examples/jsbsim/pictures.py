"""Pictures of the flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from emcas_fmu.plots import BLUE, GRAY, GREEN, ORANGE, VERMILLION, figure, shade

from .flight import Manoeuvre
from .results import AXES, BUS, UNDELAYED, Flight, Results, fins
from .vehicle import Array

Drawing = tuple[Figure, str, str]
_COLORS = {"ideal": GRAY, UNDELAYED: GREEN, "second-order": ORANGE, "nonlinear": BLUE, "stiff": VERMILLION}


def of_manoeuvre(results: Results, name: str) -> Iterator[Drawing]:
    """Figure, title and caption of each picture of a manoeuvre."""
    flown = results.flights[name]
    # The stiff bus is beside the other in its own picture, and would hide it in the rest.
    few = {actuator: f for actuator, f in flown.items() if actuator != "stiff" or "nonlinear" not in flown}
    yield attitude(results.manoeuvres[name], few, results.labels)
    yield actuation(few, results.labels)
    if any("bus_voltage_v" in flight for flight in flown.values()):
        yield bus(flown, results.labels)


def attitude(manoeuvre: Manoeuvre, flown: Mapping[str, Flight], labels: Mapping[str, str]) -> Drawing:
    """Roll, pitch and yaw from where they began."""
    drawn, grid = figure(len(AXES), 1, width=9.0, height=1.9, sharex=True)
    for axes, axis in zip(grid[:, 0], AXES, strict=True):
        for actuator, flight in flown.items():
            time, begin = _thin(flight["time"]), flight[f"wanted_{axis}_rad"][0]
            if actuator == next(iter(flown)):
                axes.plot(time, np.degrees(_thin(flight[f"wanted_{axis}_rad"]) - begin), color=VERMILLION,
                          linewidth=0.8, linestyle="--", label="wanted")
            axes.plot(time, np.degrees(_thin(flight[f"{axis}_rad"]) - begin), color=_COLORS[actuator],
                      label=labels[actuator])
        axes.set_ylabel(f"{axis} / deg")
    _legend(grid[0, 0])
    grid[-1, 0].set_xlabel("time / s")
    return drawn, "Attitude", f"{manoeuvre.title}. Angles from those at launch."


def actuation(flown: Mapping[str, Flight], labels: Mapping[str, str]) -> Drawing:
    """Fin 1, its rate and hinge moment, and the power of all four."""
    drawn, grid = figure(4, 1, width=9.0, height=1.9, sharex=True)
    first, rates, moments, power = grid[:, 0]
    for actuator, flight in flown.items():
        color, label, time = _COLORS[actuator], labels[actuator], _thin(flight["time"])
        first.plot(time, np.degrees(_thin(flight["fin1_rad"])), color=color, label=label)
        if actuator != "ideal":
            rates.plot(time, np.degrees(_thin(flight["fin_rate1_rad_s"])), color=color, label=label)
            kind = "electric" if actuator in BUS else "mechanical"
            power.plot(time, _thin(flight["power_w"]), color=color, label=f"{label}, {kind}")
        moments.plot(time, _thin(flight["hinge1_n_m"]), color=color, label=label)
    if "nonlinear" in flown:
        limited = fins(flown["nonlinear"], "saturated{}").any(axis=0)
        for axes in (first, rates, moments, power):
            shade(axes, flown["nonlinear"]["time"], limited)
    for axes, label in zip(grid[:, 0], ("fin 1 / deg", "rate / (deg/s)", "hinge moment / N.m", "power / W"),
                           strict=True):
        axes.set_ylabel(label)
    _legend(first)
    if power.lines:
        _legend(power)
    power.set_xlabel("time / s")
    return drawn, "Actuators", ("Fin 1 and the power of all four. Shaded: a limit is active in one of the FMU's fins. "
                                "An ideal actuator has no finite rate or power after a step, and is left out there.")


def bus(flown: Mapping[str, Flight], labels: Mapping[str, str]) -> Drawing:
    """Voltage at the drives, current and power of all four: the whole flight, and where the voltage is lowest."""
    drawn, grid = figure(3, 2, width=9.0, height=1.9, sharex="col", width_ratios=[2, 1])
    columns = {"bus_voltage_v": "voltage / V", "bus_current_a": "current / A", "power_w": "power / W"}
    sagging = next(flown[actuator] for actuator in BUS if actuator in flown)
    lowest = float(sagging["time"][np.argmin(sagging["bus_voltage_v"])])
    for pair, (column, label) in zip(grid, columns.items(), strict=True):
        for axes in pair:
            for actuator in BUS[::-1]:
                if actuator in flown:
                    # Every row: peaks last some milliseconds.
                    axes.plot(flown[actuator]["time"], flown[actuator][column], color=_COLORS[actuator],
                              label=labels[actuator], linewidth=0.9)
        pair[0].set_ylabel(label)
    grid[0, 1].set_xlim(lowest - 0.03, lowest + 0.12)
    for axes in grid[-1]:
        axes.set_xlabel("time / s")
    _legend(grid[0, 0])
    return drawn, "Bus", ("Voltage at the drives, current and power of all four; right, around the lowest voltage. "
                          "Negative: the motors brake and feed the bus.")


def convergence(results: Results) -> Drawing:
    """Errors against the communication step."""
    drawn, grid = figure(1, 2, width=9.0, height=3.4, sharey=True)
    colors = dict(zip(results.convergence, (GRAY, ORANGE, GREEN, BLUE), strict=False))
    for axes, quantity in zip(grid[0], ("attitude", "fins"), strict=True):
        for name, found in results.convergence.items():
            axes.loglog(found.steps * 1e3, getattr(found, quantity), ".-", color=colors[name], label=name)
        steps = next(iter(results.convergence.values())).steps * 1e3
        for order in (1, 2):
            axes.loglog(steps, 0.3 * (steps / steps[0])**order, color=VERMILLION, linewidth=0.7, linestyle="--")
            axes.annotate(f"H{'²' if order == 2 else ''}", (steps[-1], 0.3 * (steps[-1] / steps[0])**order),
                          color=VERMILLION, fontsize=8)
        axes.set(xlabel="communication step H / ms", title=f"largest error of {quantity}")
        axes.set_xticks(steps, [f"{step:g}" for step in steps])
        axes.set_xticks([], minor=True)
    grid[0, 0].set_ylabel("error / deg")
    grid[0, 0].legend(loc="best")
    return drawn, "Convergence", "Against a flight with 0.0625 ms; dashed: slopes of first and second order."


def _legend(axes: Axes) -> None:
    """Above the axes, where it covers nothing."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=4, borderpad=0.0)


def _thin(column: Array) -> Array:
    """A picture needs no more than 2000 points."""
    return column[::max(1, len(column) // 2000)]
