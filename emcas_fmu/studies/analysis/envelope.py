"""Torque-speed envelopes of motor and drive, continuous and short-term (thesis, Figure 3.2).

The envelope is the largest steady torque at each speed with a current within these limits:

- heat, continuous: the current at which the winding's steady temperature is heat.winding_limit;
- heat, short-term: the current at which the winding reaches heat.winding_limit after the duration, from the steady
  state under a preload. The preload is below the smallest continuous limit: the drive's I2t load is 0 after it;
- I2t, continuous: heat.continuous_current;
- I2t, short-term: the largest current that the drive does not reduce within the duration;
- peak: drive.current_limit;
- voltage: V^2 = (R i + K_e w)^2 + (n w L i)^2 with the supply V, speed w, current i and n = motor.pole_pairs.

The torque is K_t i. R, K_t and K_e are those at the temperatures that the current causes, in steady state or at the end
of the duration.
If heat weakens the magnets much, the largest torque may belong to a smaller current. Losses outside the winding are
neglected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

from ...actuators import capabilities, parts, require
from ...bench.conditions import ESTIMATE, resting_on
from ...errors import EmcasError
from ...ops.arrays import ARRAYS
from ...ops.floats import FLOATS
from ...pages.page import write_page
from ...parameters import ParameterSet
from ...physics import drive, heat
from ...plotting.plots import BLUE, GREEN, INK, PURPLE, VERMILLION, column, picture, style, write
from ...simulation import Array
from ...units import RPM

NEEDS = (capabilities.MOTOR_CURRENT, capabilities.PROPORTIONAL_TORQUE, capabilities.CURRENT_LIMIT,
         capabilities.VOLTAGE_LIMIT, capabilities.SCREW_DRIVE)
_POINTS = 201  # number of speeds
_CURRENTS = 401  # number of currents that are tried, and between which the voltage limit is solved for
_SHORTEST, _LONGEST = 1e-6, 1e9  # s, limits of the duration
_OVERFLOWN = 1e9  # degC, replaces a temperature that overflows
CAUSES = {"heat": "heat", "i2t": "I2t", "peak": "peak current"}
"""The limits of the current, in words."""
_WINDING = ("heat.winding_", "heat.case_", "heat.reference_temperature", "heat.resistance_coefficient",
            "motor.resistance")
_I2T = ("heat.continuous_current", "heat.peak_time", "drive.current_limit")
_ALL = ("heat.", "drive.current_limit", "motor.resistance")
_MOTOR = ("motor.torque_constant", "heat.torque_coefficient")
TORQUE = "stall_torque_nm"
INPUTS = {"current_a": _ALL, "heat_current_a": _WINDING, "i2t_current_a": _I2T, "peak_current_a": _I2T[-1:],
          TORQUE: (*_ALL, *_MOTOR), "corner_speed_rad_per_s": (*_ALL, "motor.", "drive.supply_voltage"),
          "no_load_speed_rad_per_s": ("motor.back_emf_constant", "drive.supply_voltage", "heat.torque_coefficient"),
          "winding_degc": _ALL, "case_degc": _ALL}
"""For each figure of the JSON file, the parameters, and prefixes of parameters, on which the figure depends."""
Temperatures = tuple[float, float]  # of winding and case [degC]


@dataclass(frozen=True)
class Curve:
    """An envelope: the largest current [A] that each of CAUSES allows, and the `torque` [N.m] at the Envelope's speeds.

    The smallest of `currents` causes the temperatures `winding` and `case` [degC]; the voltage suffices for it up to
    `corner_speed` [rad/s] (0: at no speed). The torque is 0 from `no_load_speed` [rad/s]. `limits` are torques [N.m]:
    by each cause alone, and by the voltage at the initial temperatures.
    """

    currents: Mapping[str, float]
    winding: float
    case: float
    corner_speed: float
    no_load_speed: float
    torque: Array
    limits: Mapping[str, Array]

    @property
    def current(self) -> float:
        """The largest current [A] at speeds below `corner_speed`."""
        return min(self.currents.values())

    @property
    def bound_by(self) -> str:
        """The cause of the smallest current; of equal ones the last: an I2t limit equal to the peak has no effect."""
        return min(reversed(CAUSES), key=self.currents.__getitem__)


@dataclass(frozen=True)
class Envelope:
    """Torque against motor speed [rad/s] from 0 to the larger initial no-load speed, continuous and for `duration` [s].

    Before the duration, `preload` [1] times the continuous current (:attr:`Curve.current`) has flowed for a long time.
    """

    speed: Array
    duration: float
    preload: float
    continuous: Curve
    short_term: Curve
    estimates: Mapping[str, tuple[str, ...]]
    """For each figure, the estimates among its INPUTS."""

    @property
    def curves(self) -> dict[str, Curve]:
        """Both envelopes by name."""
        return {"continuous": self.continuous, "short_term": self.short_term}


def envelope(parameters: ParameterSet, duration: float, preload: float = 0.0) -> Envelope:
    """Return the envelopes at the parameters' ambient temperature and supply, for a `duration` [s].

    `preload` is a share [1] of the continuous current. Raises EmcasError for an actuator without extension heat or
    NEEDS, and for values outside their limits.
    """
    require(parameters.model, "an envelope", *NEEDS, extension="heat")
    if "heat" not in parts(parameters.model)[1]:
        raise EmcasError(f"model {parameters.model}: an envelope needs the extension heat: {parameters.model}+heat")
    p = parameters.actuator.equation_parameters(FLOATS, parameters.nested())
    if not _SHORTEST <= duration <= _LONGEST:
        raise EmcasError(f"--duration {duration:g} s: must be from {_SHORTEST:g} to {_LONGEST:g} s")
    if not 0.0 <= preload < 1.0:
        raise EmcasError(f"--preload {preload:g}: must be from 0 to below 1")
    for name, value in (("motor.back_emf_constant", p.motor.back_emf_constant),
                        ("drive.supply_voltage", p.drive.supply_voltage)):
        if value <= 0.0:
            raise EmcasError(f"{name} = {value:g}: must be above 0 for an envelope")
    ambient, limit = p.friction.temperature, p.heat.winding_limit
    if ambient >= limit:
        raise EmcasError(f"friction.temperature = {ambient:g} degC must be below heat.winding_limit = {limit:g} degC")
    peak = float(p.drive.current_limit)
    continuous = continuous_current(p), min(float(p.heat.continuous_current), peak), peak
    cold, start = settled(p, 0.0), settled(p, preload * min(continuous))
    short_term = short_term_current(p, duration, start), float(heat.sustained_current(FLOATS, p, duration)), peak
    highest = max(p.drive.supply_voltage / heat.at_temperatures(FLOATS, p, *t).motor.back_emf_constant
                  for t in (cold, start))
    speed = np.linspace(0.0, highest, _POINTS)
    estimates = {figure: parameters.estimates_in(names) for figure, names in INPUTS.items()}
    return Envelope(speed, duration, preload, _curve(p, speed, continuous, cold, lambda i: settled(p, i)),
                    _curve(p, speed, short_term, start, lambda i: warmed(p, i, duration, start)),
                    {figure: names for figure, names in estimates.items() if names})


def continuous_current(p: Any) -> float:
    """Return the current [A] at which the winding's steady temperature is heat.winding_limit."""
    loss = (p.heat.winding_limit - p.friction.temperature) / (p.heat.winding_to_case + p.heat.case_to_ambient)
    return float(np.sqrt(loss / heat.resistance(FLOATS, p, p.heat.winding_limit)))


def short_term_current(p: Any, duration: float, start: Temperatures) -> float:
    """Return the constant current [A] that heats the winding from `start` to heat.winding_limit in `duration` [s]."""
    def excess(current: float) -> float:
        return warmed(p, current, duration, start)[0] - float(p.heat.winding_limit)

    low = continuous_current(p)
    high = 2.0 * low
    while excess(high) < 0.0:
        low, high = high, 2.0 * high
    # In a very long duration the continuous current reaches the limit, within rounding.
    return low if excess(low) >= 0.0 else float(brentq(excess, low, high, xtol=1e-9))


def _rates(p: Any, current: float) -> tuple[Array, Array]:
    """Return A and b of d(winding, case)/dt = A (winding, case) + b [K/s] under a constant current [A]."""
    def at(winding: float, case: float) -> Array:
        inward, outward = heat.flows(p, winding, case)
        loss = heat.resistance(FLOATS, p, winding) * current * current
        return np.array([(loss - inward) / p.heat.winding_capacity, (inward - outward) / p.heat.case_capacity])

    low, high = p.friction.temperature, p.heat.winding_limit
    base = at(low, low)
    a = np.column_stack([at(high, low) - base, at(low, high) - base]) / (high - low)
    return a, base - a @ np.array([low, low])


def settled(p: Any, current: float) -> Temperatures:
    """Return the steady temperatures [degC] under a current [A] that is at most the continuous one."""
    a, b = _rates(p, current)
    winding, case = np.linalg.solve(a, -b)
    return float(winding), float(case)


def warmed(p: Any, current: float, time: float, start: Temperatures) -> Temperatures:
    """Return the exact temperatures [degC] after `time` [s] of a constant current [A]; _OVERFLOWN if they overflow."""
    a, b = _rates(p, current)
    # Two nodes that heat each other have different real rates; NumPy may return them as complex numbers.
    rates, modes = (part.real for part in np.linalg.eig(a))
    with np.errstate(all="ignore"):
        grown = np.where(rates == 0.0, time, np.expm1(rates * time) / rates)
        end = np.array(start) + modes @ (grown * np.linalg.solve(modes, a @ np.array(start) + b))
    winding, case = (float(x) if isfinite(x) else _OVERFLOWN for x in end)
    return winding, case


def _curve(p: Any, speed: Array, allowed: tuple[float, ...], start: Temperatures,
           heated: Callable[[float], Temperatures]) -> Curve:
    """Return the envelope of the currents [A] `allowed` by CAUSES; `heated` returns the temperatures due to one."""
    currents = dict(zip(CAUSES, allowed, strict=True))
    largest, supply = min(allowed), p.drive.supply_voltage

    @cache
    def motor(current: float) -> Any:
        return heat.at_temperatures(FLOATS, p, *heated(current))

    def torque_of(current: float) -> float:
        # For a current beyond the limit of heat, the temperatures are those at the limit.
        return float(drive.torque(motor(min(current, allowed[0])), current))

    def largest_speed(current: float) -> float:
        # The largest speed [rad/s] at a current; -1 if the voltage does not suffice even at rest.
        return float(drive.knee_speed(FLOATS, motor(current), supply, current)) or -1.0

    # The torque is largest at the voltage limit, at the largest current, or at a local maximum near a tried current.
    tried = np.linspace(0.0, largest, _CURRENTS).tolist()
    speeds, torques = list(map(largest_speed, tried)), list(map(torque_of, tried))

    def largest_torque(at: float) -> float:
        limited = [brentq(lambda i: largest_speed(i) - at, *between, xtol=1e-9)
                   for between, (low, high) in zip(pairwise(tried), pairwise(speeds), strict=True)
                   if (low >= at) is not (high >= at)]
        return max((*(torque for torque, speed in zip(torques, speeds, strict=True) if speed >= at),
                    *map(torque_of, limited)), default=0.0)

    cold = heat.at_temperatures(FLOATS, p, *start)
    return Curve(currents, *heated(largest), max(speeds[-1], 0.0), max(speeds),
                 np.array([largest_torque(float(at)) for at in speed]),
                 {**{cause: np.full(len(speed), torque_of(current)) for cause, current in currents.items()},
                  "voltage": drive.torque(cold, np.maximum(drive.steady_current(ARRAYS, cold, supply, speed), 0.0))})


def draw(e: Envelope) -> Figure:
    """Return a plot of both envelopes against the motor speed, with their limits."""
    plot, (axes,) = column(f"motor torque [N.m]{ESTIMATE * (TORQUE in e.estimates)}", x="motor speed [rpm]", width=7.5,
                            height=4.4)
    rpm = e.speed * RPM
    for curve, color, name in ((e.short_term, VERMILLION, f"for {e.duration:g} s"),
                               (e.continuous, BLUE, "continuous")):
        axes.fill_between(rpm, curve.torque, color=color, alpha=0.18, linewidth=0.0)
        axes.plot(rpm, curve.torque, color=color, linewidth=2.0, label=f"{name} (limited by {CAUSES[curve.bound_by]})")
        axes.plot(rpm, curve.limits["heat"], color=color, linestyle="--", label=f"winding at its limit, {name}")
    limits = e.short_term.limits
    axes.plot(rpm, limits["peak"], color=PURPLE, linestyle="-.", label="drive's peak current")
    axes.plot(rpm, limits["voltage"], color=GREEN, linestyle=":", label="supply voltage, initial temperature")
    top = max(limits["peak"][0], min(limits["heat"][0], 2.0 * limits["peak"][0]))
    axes.set(xlim=(0.0, rpm[-1]), ylim=(0.0, 1.1 * top))
    plot.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, labelcolor=INK)
    return plot


def write_picture(e: Envelope, path: Path, parameters: ParameterSet) -> None:
    """Write the plot of :func:`draw` as ``.svg``, ``.png`` or ``.pdf``, or a page with it as ``.html``."""
    with style():
        plot = draw(e)
        if path.suffix != ".html":
            write(plot, path)
            return
        shown = picture(plot, "Torque-speed envelope", " ".join([
            f"Torque for {e.duration:g} s and continuous torque (shaded), with their limits.",
            *resting_on({name: names for name, names in e.estimates.items() if name == TORQUE})]))
    write_page(path, "pages/picture.html.j2", [parameters], picture=shown)
