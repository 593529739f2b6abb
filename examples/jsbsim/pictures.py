"""Pictures of the flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from emcas_fmu.plotting.plots import BLUE, GRAY, GREEN, ORANGE, PURPLE, SKY, VERMILLION, Drawing, figure, shade

from .results import (
    AXES,
    IDEAL,
    SECOND_ORDER,
    STIFF,
    UNDELAYED,
    Flight,
    Results,
    angles,
    fins,
    power_kind,
    turn_between,
)
from .vehicle import Array

_COLORS = {IDEAL: GRAY, UNDELAYED: GREEN, SECOND_ORDER: ORANGE, STIFF: VERMILLION}
_OF_FMUS = (BLUE, VERMILLION, PURPLE, SKY, GREEN)
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)))


def _look(results: Results, actuator: str) -> dict[str, Any]:
    """Return colour and dashes of an actuator's lines; those of FMUs differ in the order of their flights."""
    if actuator not in results.units:
        return {"color": _COLORS[actuator]}
    dashes, color = divmod(list(results.units).index(actuator), len(_OF_FMUS))
    return {"color": _OF_FMUS[color], "linestyle": _DASHES[dashes % len(_DASHES)]}


def of_manoeuvre(results: Results, name: str) -> Iterator[Drawing]:
    """Yield the pictures of a manoeuvre."""
    flown = results.flights[name]
    # The flight on the stiff bus is in the picture of the bus only: elsewhere its lines would hide others.
    few = {actuator: f for actuator, f in flown.items() if actuator != STIFF or len(flown) == 1}
    if IDEAL in flown and any(unit in flown for unit in results.units):
        yield kinds(results, name)
    yield attitude(results, name, few)
    yield actuation(results, few)
    if any("bus_voltage_v" in flight for flight in flown.values()):
        yield bus(results, flown)


def kinds(results: Results, name: str) -> Drawing:
    """Return the plots of pitch, of the attitude's difference from that of ideal fins, and of each actuator's energy.

    A flight with ideal fins and one with an FMU are necessary.
    """
    flown = {each: f for each, f in results.flights[name].items() if each not in (UNDELAYED, STIFF)}
    plot, grid = figure(2, 2, width=11.0, height=3.0, width_ratios=[3, 2])
    (pitch, energy), (apart, share) = grid
    ideal = flown[IDEAL]
    begin = ideal["wanted_pitch_rad"][0]
    largest = max(float(np.abs(f["power_w"]).sum() * results.step) for each, f in flown.items() if each != IDEAL)
    unit, scale, digits = ("kJ", 1e-3, ".2f") if largest >= 1000.0 else ("J", 1.0, ".3g")
    pitch.plot(_thin(ideal["time"]), np.degrees(_thin(ideal["wanted_pitch_rad"]) - begin), color=GRAY, linewidth=0.8,
               linestyle="--", label="wanted")
    for actuator, flight in flown.items():
        wide = actuator == next(iter(results.units))  # similar lines would hide it
        look = {**_look(results, actuator), "linewidth": 3.0 if wide else 1.1, "alpha": 0.55 if wide else 1.0,
                "label": _kind(actuator, flight)}
        time = _thin(flight["time"])
        pitch.plot(time, np.degrees(_thin(flight["pitch_rad"]) - begin), **look)
        if actuator != IDEAL:
            apart.plot(time, turn_between(_thin(angles(flight).T).T, _thin(angles(ideal).T).T), **look)
            energy.plot(time, scale * _thin(np.cumsum(flight["power_w"])) * results.step, **look)
    bars = [actuator for actuator in reversed(flown) if actuator != IDEAL]
    for row, actuator in enumerate(bars):
        power, look = flown[actuator]["power_w"], _look(results, actuator)
        used, back = (scale * float(np.maximum(sign * power, 0.0).sum() * results.step) for sign in (1.0, -1.0))
        share.barh(row, used, 0.62, color=look["color"])
        share.barh(row, -back, 0.62, color=look["color"], alpha=0.5, hatch="////")
        share.annotate(f"{used:{digits}}, returned {back:{digits}}", (used, row), (4, 0), textcoords="offset points",
                       va="center", fontsize=7.5)
    share.set_yticks(range(len(bars)), [_kind(each, flown[each]) for each in bars], fontsize=7.5)
    for label, actuator in zip(share.get_yticklabels(), bars, strict=True):
        label.set_color(_look(results, actuator)["color"])
    share.margins(x=0.5)
    share.set_xlim(left=min(share.get_xlim()[0], 0.0) / 4)
    share.axvline(0.0, color=GRAY, linewidth=0.8)
    share.grid(visible=False, axis="y")
    for axes, words in ((pitch, "pitch from launch [deg]"), (apart, "attitude from that\nof ideal fins [deg]"),
                        (energy, f"energy drawn less\nwhat is returned [{unit}]")):
        axes.set(ylabel=words, xlabel="time [s]", xlim=(0.0, float(ideal["time"][-1])))
    share.set(xlabel=f"energy drawn, hatched: returned [{unit}]")
    pitch.set_title(results.manoeuvres[name].title)
    energy.set_title("Four fins")
    plot.legend(*pitch.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return Drawing(
        "Kinds of actuators", plot, f"{results.manoeuvres[name].title}. Below: angle of the rotation from the "
        "attitude with ideal fins. Right: energy of all four fins, electric from the bus or hydraulic from the "
        "pressure line; that of a second-order actuator is mechanical work against the hinge moments.")


def _kind(actuator: str, flight: Flight) -> str:
    """Return the name of an actuator, with the kind of its power unless this is electric."""
    words = "" if actuator == IDEAL or power_kind(flight) == "electric" else f" ({power_kind(flight)})"
    return f"{actuator}{words}"


def attitude(results: Results, name: str, flown: Mapping[str, Flight]) -> Drawing:
    """Return the plots of roll, pitch and yaw, relative to the launch."""
    plot, grid = figure(len(AXES), 1, width=9.0, height=1.9, sharex=True)
    for axes, axis in zip(grid[:, 0], AXES, strict=True):
        for actuator, flight in flown.items():
            time, begin = _thin(flight["time"]), flight[f"wanted_{axis}_rad"][0]
            if actuator == next(iter(flown)):
                axes.plot(time, np.degrees(_thin(flight[f"wanted_{axis}_rad"]) - begin), color=VERMILLION,
                          linewidth=0.8, linestyle="--", label="wanted")
            axes.plot(time, np.degrees(_thin(flight[f"{axis}_rad"]) - begin), **_look(results, actuator),
                      label=results.labels[actuator])
        axes.set_ylabel(f"{axis} [deg]")
    _legend(grid[0, 0])
    grid[-1, 0].set_xlabel("time [s]")
    return Drawing("Attitude", plot, f"{results.manoeuvres[name].title}. Angles relative to the launch.")


def actuation(results: Results, flown: Mapping[str, Flight]) -> Drawing:
    """Return the plots of angle, rate and hinge moment of fin 1, and of the power of all four fins."""
    plot, grid = figure(4, 1, width=9.0, height=1.9, sharex=True)
    first, rates, moments, power = grid[:, 0]
    for actuator, flight in flown.items():
        look, label, time = _look(results, actuator), results.labels[actuator], _thin(flight["time"])
        first.plot(time, np.degrees(_thin(flight["fin1_rad"])), **look, label=label)
        if actuator != IDEAL:
            rates.plot(time, np.degrees(_thin(flight["fin_rate1_rad_s"])), **look, label=label)
            power.plot(time, _thin(flight["power_w"]), **look, label=f"{label}, {power_kind(flight)}")
        moments.plot(time, _thin(flight["hinge1_n_m"]), **look, label=label)
    limiting, shaded = next((unit for unit in results.units if unit in flown), None), ""
    if limiting:
        shaded = f" Shaded: a limit is active in one of the fins of {results.labels[limiting]}."
        limited = fins(flown[limiting], "saturated{}").any(axis=0)
        for axes in (first, rates, moments, power):
            shade(axes, flown[limiting]["time"], limited)
    for axes, label in zip(grid[:, 0], ("fin 1 [deg]", "rate [deg/s]", "hinge moment [N.m]", "power [W]"),
                           strict=True):
        axes.set_ylabel(label)
    _legend(first)
    if power.lines:
        _legend(power)
    power.set_xlabel("time [s]")
    return Drawing("Actuators", plot, f"Fin 1 and the power of all four fins.{shaded} Rate and power of an ideal "
                   "actuator are not finite after a step, and are left out.")


def bus(results: Results, flown: Mapping[str, Flight]) -> Drawing:
    """Return the plots of the bus's voltage, current and power in the whole flight and around the lowest voltage."""
    plot, grid = figure(3, 2, width=9.0, height=1.9, sharex="col", width_ratios=[2, 1])
    columns = {"bus_voltage_v": "voltage [V]", "bus_current_a": "current [A]", "power_w": "power [W]"}
    # The stiff bus is plotted first, under the other.
    on_bus = {a: f for a, f in sorted(flown.items(), key=lambda each: each[0] != STIFF) if "bus_voltage_v" in f}
    sagging = list(on_bus.values())[-1 if STIFF in on_bus else 0]
    lowest = float(sagging["time"][np.argmin(sagging["bus_voltage_v"])])
    for pair, (column, label) in zip(grid, columns.items(), strict=True):
        for axes in pair:
            for actuator, flight in on_bus.items():
                # All rows, since peaks last some milliseconds.
                axes.plot(flight["time"], flight[column], **_look(results, actuator), label=results.labels[actuator],
                          linewidth=0.9)
        pair[0].set_ylabel(label)
    grid[0, 1].set_xlim(lowest - 0.03, lowest + 0.12)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    _legend(grid[0, 0])
    return Drawing("Bus", plot, "Voltage at the drives, current and power of all four fins; right: around the lowest "
                   "voltage. Negative current and power: the motors brake and feed the bus.")


def convergence(results: Results) -> Drawing:
    """Return the plots of errors over the communication step."""
    plot, grid = figure(1, 2, width=9.0, height=3.4, sharey=True)
    for axes, quantity in zip(grid[0], ("attitude", "fins"), strict=True):
        for name, each in results.convergence.items():
            axes.loglog(each.steps * 1e3, getattr(each, quantity), marker=".", label=name,
                        **(_look(results, name) if name in (*results.units, *_COLORS) else {}))
        steps = next(iter(results.convergence.values())).steps * 1e3
        for order in (1, 2):
            axes.loglog(steps, 0.3 * (steps / steps[0])**order, color=VERMILLION, linewidth=0.7, linestyle="--")
            axes.annotate(f"H{'²' if order == 2 else ''}", (steps[-1], 0.3 * (steps[-1] / steps[0])**order),
                          color=VERMILLION, fontsize=8)
        axes.set(xlabel="communication step H [ms]", title=f"largest error of {quantity}")
        axes.set_xticks(steps, [f"{step:g}" for step in steps])
        axes.set_xticks([], minor=True)
    grid[0, 0].set_ylabel("error [deg]")
    grid[0, 0].legend(loc="best")
    return Drawing("Convergence", plot, "Errors against a flight with 0.0625 ms; dashed: slopes of first and second "
                   "order.")


def _legend(axes: Axes) -> None:
    """Put a legend above the axes."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=4, borderpad=0.0)


def _thin(column: Array) -> Array:
    """Return a column thinned to about 2000 points, which are enough for a picture."""
    return column[::max(1, len(column) // 2000)]
