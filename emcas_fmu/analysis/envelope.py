"""What motor and drive give at each speed for long and for a while: torque-speed envelopes (thesis, Figure 3.2).

The largest torque in steady motion is K_t times the least of these currents:

- heat, continuous: in the steady state it makes the winding is at heat.winding_limit;
- heat, short-term: with it the winding gets there in the duration, from the steady state of a preload;
- I2t: heat.continuous_current; short-term what the drive allows through the duration without folding back;
- peak: drive.current_limit;
- voltage: V = R i + K_e w at the supply.

R, K_t and K_e are those of the temperatures that the current itself has made at the end, steady state or duration.
Losses other than in the winding are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm
from scipy.optimize import brentq

from ..errors import EmcasError
from ..ops.floats import FLOATS
from ..parameters import ParameterSet
from ..physics import drive, heat
from ..plots import BLUE, GREEN, INK, PURPLE, VERMILLION, figure, style, svg
from ..tree import changed, tree
from .capability import limit_torque
from .linear import Array

_POINTS = 201
_UNLIMITED = 1e12  # A
_MOLTEN = 1e9  # degC, for what no longer is a number
CAUSES = ("heat", "i2t", "peak")
_WORDS = {"heat": "heat", "i2t": "I2t", "peak": "peak current"}
Temperatures = tuple[float, float]  # of winding and case [degC]


@dataclass(frozen=True)
class Curve:
    """One envelope: currents [A] that each of CAUSES allows, and the torque [N.m] at each speed of the Envelope.

    `winding` and `case` [degC] are the temperatures that the least of these currents makes, below `corner_speed`
    [rad/s], from which the voltage binds (0: at all speeds). `limits` are the torques [N.m] of each cause by itself,
    and of the voltage at the temperatures of the start.
    """

    currents: Mapping[str, float]
    winding: float
    case: float
    corner_speed: float
    torque: Array
    limits: Mapping[str, Array]

    @property
    def current(self) -> float:
        """Largest current [A] at speeds below the corner's."""
        return min(self.currents.values())

    @property
    def bound_by(self) -> str:
        """Which of CAUSES that is; of equals the last, for I2t that allows the peak binds nothing."""
        return min(reversed(CAUSES), key=self.currents.__getitem__)


@dataclass(frozen=True)
class Envelope:
    """Torque against motor speed [rad/s] from 0 to that without load, for any time and for `duration` [s].

    `preload` [1] is the share of the heat's continuous current that flowed before the duration, for long.
    """

    speed: Array
    duration: float
    preload: float
    continuous: Curve
    short_term: Curve


def envelope(parameters: ParameterSet, duration: float, preload: float = 0.0) -> Envelope:
    """The envelopes of a model with heat at its ambient and supply. Raises EmcasError where there are none."""
    p = tree(parameters.values)
    if not hasattr(p, "heat"):
        raise EmcasError(f"--model {parameters.model}: an envelope needs the option heat, as in nonlinear+heat")
    if not 0.0 < duration < np.inf:
        raise EmcasError(f"--duration {duration:g} s: must be above 0")
    if not 0.0 <= preload < 1.0:
        raise EmcasError(f"--preload {preload:g}: must be from 0 to below 1")
    for name, value in (("motor.back_emf_constant", p.motor.back_emf_constant),
                        ("drive.supply_voltage", p.drive.supply_voltage)):
        if value <= 0.0:
            raise EmcasError(f"{name} = {value:g}: must be above 0 for an envelope")
    ambient, limit = p.friction.temperature, p.heat.winding_limit
    if ambient >= limit:
        raise EmcasError(f"friction.temperature = {ambient:g} degC must be below heat.winding_limit = {limit:g} degC")
    steady = continuous_current(p)
    cold = settled(p, 0.0)
    start = settled(p, preload * steady)
    free = [p.drive.supply_voltage / heat.at_temperatures(FLOATS, p, *t).motor.back_emf_constant for t in (cold, start)]
    speed = np.linspace(0.0, max(free), _POINTS)
    peak = p.drive.current_limit
    return Envelope(
        speed, duration, preload,
        _curve(p, speed, (steady, min(p.heat.continuous_current, peak), peak), cold, lambda i: settled(p, i)),
        _curve(p, speed, (short_term_current(p, duration, preload), i2t_current(p, duration), peak), start,
               lambda i: warmed(p, i, duration, start)))


def continuous_current(p: Any) -> float:
    """Current [A] in whose steady state the winding is at heat.winding_limit."""
    loss = (p.heat.winding_limit - p.friction.temperature) / (p.heat.winding_to_case + p.heat.case_to_ambient)
    return float(np.sqrt(loss / heat.resistance(FLOATS, p, p.heat.winding_limit)))


def short_term_current(p: Any, duration: float, preload: float = 0.0) -> float:
    """Constant current [A] that brings the winding to heat.winding_limit in `duration` [s].

    Before, `preload` times the continuous current has flowed for long.
    """
    low = continuous_current(p)
    start = settled(p, preload * low)

    def excess(current: float) -> float:
        return warmed(p, current, duration, start)[0] - float(p.heat.winding_limit)

    high = 2.0 * low
    while excess(high) < 0.0:
        low, high = high, 2.0 * high
    # After a very long time the continuous current has got there, to rounding.
    return low if excess(low) >= 0.0 else float(brentq(excess, low, high, xtol=1e-9))


def i2t_current(p: Any, duration: float) -> float:
    """Constant current [A] that the drive allows for `duration` [s] before it folds back, from an empty I2t load."""
    def excess(current: float) -> float:
        return float(heat.loaded(FLOATS, p, 0.0, current * current, duration)) - heat.FOLDING

    peak = p.drive.current_limit
    if excess(peak) <= 0.0:
        return float(peak)
    return float(brentq(excess, min(p.heat.continuous_current, peak), peak, xtol=1e-12))


def _rates(p: Any, current: float) -> tuple[Array, Array]:
    """A and b of d(winding, case)/dt = A (winding, case) + b [K/s] under a constant current [A], from the physics."""
    def at(winding: float, case: float) -> Array:
        inward, outward = heat.flows(p, winding, case)
        loss = heat.resistance(FLOATS, p, winding) * current * current
        return np.array([(loss - inward) / p.heat.winding_capacity, (inward - outward) / p.heat.case_capacity])

    low, high = p.friction.temperature, p.heat.winding_limit
    base = at(low, low)
    a = np.column_stack([at(high, low) - base, at(low, high) - base]) / (high - low)
    return a, base - a @ np.array([low, low])


def settled(p: Any, current: float) -> Temperatures:
    """Steady temperatures under a current [A] up to the continuous one."""
    a, b = _rates(p, current)
    winding, case = np.linalg.solve(a, -b)
    return float(winding), float(case)


def warmed(p: Any, current: float, time: float, start: Temperatures) -> Temperatures:
    """Temperatures after `time` [s] of a constant current [A], exact; _MOLTEN where they overflow."""
    a, b = _rates(p, current)
    with np.errstate(all="ignore"):
        moved = expm(np.block([[a, b[:, None]], [np.zeros((1, 3))]]) * time) @ np.array([*start, 1.0])
    winding, case = (float(x) if isfinite(x) else _MOLTEN for x in moved[:2])
    return winding, case


def _curve(p: Any, speed: Array, allowed: tuple[float, ...], start: Temperatures,
           heated: Callable[[float], Temperatures]) -> Curve:
    """`heated` gives the temperatures that a current makes."""
    currents = dict(zip(CAUSES, allowed, strict=True))
    largest, supply = min(allowed), p.drive.supply_voltage

    def torque_of(current: float) -> float:
        # Of a current that heat does not allow, at the temperatures of what it allows.
        return float(drive.torque(heat.at_temperatures(FLOATS, p, *heated(min(current, allowed[0]))), current))

    def excess(current: float, at: float) -> float:
        q = heat.at_temperatures(FLOATS, p, *heated(current))
        return float(q.motor.resistance * current + drive.back_emf(q, at) - supply)

    def current_at(at: float) -> float:
        if excess(largest, at) <= 0.0:
            return largest
        return 0.0 if excess(0.0, at) >= 0.0 else float(brentq(excess, 0.0, largest, (at,), xtol=1e-9))

    hot = heat.at_temperatures(FLOATS, p, *heated(largest))
    cold = changed(heat.at_temperatures(FLOATS, p, *start), {"drive.current_limit": _UNLIMITED})
    return Curve(currents, *heated(largest),
                 max((supply - hot.motor.resistance * largest) / hot.motor.back_emf_constant, 0.0),
                 np.array([torque_of(current_at(at)) for at in speed]),
                 {**{cause: np.full(len(speed), torque_of(current)) for cause, current in currents.items()},
                  "voltage": np.maximum(limit_torque(cold, speed, 1.0), 0.0)})


def draw(e: Envelope) -> Figure:
    """Both envelopes over the motor speed, and the limits they are made of."""
    made, ((axes,),) = figure(1, width=7.5, height=4.4)
    rpm = e.speed * 30.0 / pi
    for curve, color, name in ((e.short_term, VERMILLION, f"for {e.duration:g} s"),
                               (e.continuous, BLUE, "for any time")):
        axes.fill_between(rpm, curve.torque, color=color, alpha=0.18, linewidth=0.0)
        axes.plot(rpm, curve.torque, color=color, linewidth=2.0, label=f"{name} (limited by {_WORDS[curve.bound_by]})")
        axes.plot(rpm, curve.limits["heat"], color=color, linestyle="--", label=f"winding at its limit, {name}")
    cold = e.short_term
    axes.plot(rpm, cold.limits["peak"], color=PURPLE, linestyle="-.", label="drive's peak current")
    axes.plot(rpm, cold.limits["voltage"], color=GREEN, linestyle=":", label="supply voltage, as cold as at the start")
    top = max(cold.limits["peak"][0], min(cold.limits["heat"][0], 2.0 * cold.limits["peak"][0]))
    axes.set(xlabel="motor speed [rpm]", ylabel="motor torque [N.m]", xlim=(0.0, rpm[-1]), ylim=(0.0, 1.1 * top))
    made.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, labelcolor=INK)
    return made


def write_picture(e: Envelope, path: Path) -> None:
    """The picture of :func:`draw` as ``.html``, ``.svg``, ``.png`` or ``.pdf``."""
    with style():
        made = draw(e)
        if path.suffix == ".html":
            path.write_text("<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><title>EM-CAS envelope</title>"
                            "<meta name=\"color-scheme\" content=\"light dark\"><body style=\"margin:1rem\">"
                            f"{svg(made, 'Torque-speed envelope')}</body></html>\n", encoding="utf-8")
        else:
            made.savefig(path, dpi=150, facecolor="white")
