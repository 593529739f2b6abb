"""Section 3.3: friction measured by the rig over speed, fin angle and temperature.

Figures 3.14 to 3.35, Tables 13 to 15.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from emcas_fmu.errors import EmcasError
from emcas_fmu.ops.arrays import ARRAYS
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.physics import friction as physics
from emcas_fmu.physics.friction import POLYNOMIAL_SPAN
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import Array

from .entry import Shown, Table
from .friction_rig import REACH, RPM, Sweep
from .pictures import DASHED, DOTS, Line, Panel, panels
from .runs import COLD, WARM, Runs

SPEEDS = (50, 500, 1000, 1500, 2000)  # rpm, of the sweeps for viscous friction
SLOW = 25  # rpm, of the sweep for Coulomb friction
DIRECTIONS = {1: "positive", -1: "negative"}
_ORDER = 6  # of the thesis's polynomials
_UNKNOWN = ("the rig's motor, its acceleration and the range of the sweep, which are estimates here, and the "
            "noise of its instruments, which is zero here.")


def _conditions(temperature: float | str, speed: str) -> str:
    at = f"{temperature:g}" if isinstance(temperature, float) else temperature
    return (f"{at} °C · rig's motor: {speed}, {100 * REACH:.0f} % of the range of commands up and down · actuator's "
            "drive off, no load")


def _parameters(runs: Runs, temperature: float) -> Any:
    return runs.parameters.with_values({"friction.temperature": temperature}).nested()


def _coulomb(runs: Runs, temperature: float, direction: int, fin: Any) -> Any:
    """Return the set's Coulomb friction [N.m] at fin angles [rad]."""
    return physics.coulomb(ARRAYS, _parameters(runs, temperature), float(direction), fin)


def sweep(runs: Runs, rpm: int, temperature: float) -> Shown:
    """Show speed and current of the rig's motor (Figures 3.14 to 3.23); if slow, also the fin angle (3.28, 3.30)."""
    s = runs.friction(rpm, temperature)
    parts = [Panel("speed [rpm]", [Line(s.time, s.commanded / RPM, "command", plots.COMMAND_STYLE),
                                   Line(s.time, s.motor_speed / RPM, "rig's motor")]),
             Panel("current [A]", [Line(s.time, s.current)])]
    if rpm == SLOW:
        parts.append(Panel("fin angle [deg]", [Line(s.time, np.degrees(s.fin_angle))]))
    rows = tuple((name, s.mean_current(d), s.mean_friction(d)) for d, name in DIRECTIONS.items())
    return Shown(_conditions(temperature, f"{rpm} rpm"), panels(parts, "time [s]", height=1.8),
                 "The current at constant speed shows the friction of actuator and rig; the peaks are due to the "
                 "acceleration in the ramps and, at the start, to breakaway.",
                 Table(("direction", "mean current at constant speed [A]", "friction of the actuator [N.m]"), rows),
                 _UNKNOWN)


def _points(runs: Runs, temperature: float) -> dict[int, tuple[Array, Array]]:
    """Return, by direction, the speeds [rpm] and the actuator's mean friction [N.m] at each speed."""
    sweeps = [runs.friction(rpm, temperature) for rpm in SPEEDS]
    return {d: (np.array([s.speed for s in sweeps]) / RPM, np.array([s.mean_friction(d) for s in sweeps]))
            for d in DIRECTIONS}


def against_speed(runs: Runs, *temperatures: float) -> Shown:
    """Show friction over motor speed at one temperature (Figures 3.24, 3.25) or several (3.26)."""
    lines, columns = [], ["motor speed [rpm]"]
    torques: list[Array] = []
    for color, temperature in zip(plots.COLORS, temperatures, strict=False):
        for d, (speed, torque) in _points(runs, temperature).items():
            columns.append(f"{DIRECTIONS[d]}, {temperature:g} °C [N.m]")
            torques.append(torque)
            lines.append(Line(d * speed, d * torque, "" if d < 0 else f"{temperature:g} °C",
                              {"color": color, "marker": "o", "markersize": 4.0}))
    rows = tuple((float(rpm), *(float(torque[i]) for torque in torques)) for i, rpm in enumerate(SPEEDS))
    listed = " and ".join(f"{t:g}" for t in temperatures)
    return Shown(_conditions(listed, f"{SPEEDS[0]} to {SPEEDS[-1]} rpm"),
                 panels([Panel("friction torque [N.m]", lines)], "motor speed [rpm]"),
                 "Means at constant speed within a fifth of the largest command, without the rig's friction.",
                 Table(tuple(columns), rows), _UNKNOWN)


def viscous_fit(runs: Runs, temperature: float = WARM) -> Shown:
    """Show the straight line through friction over speed, whose slope is the viscous coefficient (Figure 3.27)."""
    lines, rows = [], []
    for color, (d, (speed, torque)) in zip(plots.COLORS, _points(runs, temperature).items(), strict=False):
        slope, level = _line(speed, torque)
        lines += [Line(speed, torque, f"{DIRECTIONS[d]}, rig", {**DOTS, "color": color}),
                  Line(speed, level + slope * speed * RPM, "line", {"color": color})]
        rows.append((DIRECTIONS[d], slope, float(physics.viscous(FLOATS, _parameters(runs, temperature), float(d))),
                     level))
    return Shown(_conditions(temperature, f"{SPEEDS[0]} to {SPEEDS[-1]} rpm"),
                 panels([Panel("friction torque [N.m]", lines)], "motor speed [rpm]"),
                 "Least squares through the points of each direction. At constant motor speed the lever "
                 "still accelerates the fin: a torque that grows with the square of the speed helps one direction, "
                 "hinders the other and changes the slopes. The mean of the slopes does not have this error.",
                 Table(("direction", "viscous coefficient, rig [N.m.s/rad]", "parameter [N.m.s/rad]",
                        "friction at zero speed, rig [N.m]"), rows), _UNKNOWN)


def _line(speed: Array, torque: Array) -> tuple[float, float]:
    """Return slope [N.m.s/rad] and level [N.m] of friction over speed [rpm]. Raises EmcasError below two points."""
    measured = np.isfinite(torque)
    if np.count_nonzero(measured) < 2:
        raise EmcasError("the friction rig's motor moves the fin at constant speed through angle 0 at fewer than two "
                         "speeds: reduce friction (friction.coulomb, friction.fin_coulomb) or raise command.limit")
    slope, level = np.polyfit(speed[measured] * RPM, torque[measured], 1)
    return float(slope), float(level)


def _coulomb_points(runs: Runs, temperature: float, direction: int) -> tuple[Array, Array]:
    """Return fin angle [rad] and Coulomb friction [N.m] of the slow sweep, without the viscous part."""
    s: Sweep = runs.friction(SLOW, temperature)
    slope, _ = _line(*_points(runs, temperature)[direction])
    return s.fin_angle[s.steady[direction]], s.friction(direction) - slope * s.speed


def against_angle(runs: Runs, *temperatures: float) -> Shown:
    """Show Coulomb friction over the fin angle at one temperature (Figures 3.29, 3.31) or several (3.32)."""
    lines, rows = [], []
    for color, temperature in zip(plots.COLORS, temperatures, strict=False):
        for d, name in DIRECTIONS.items():
            fin, torque = _coulomb_points(runs, temperature, d)
            lines.append(Line(np.degrees(fin), d * torque, "" if d < 0 else f"{temperature:g} °C", {"color": color}))
            rows.append((f"{temperature:g} °C, {name}", float(torque.min()), float(torque.mean()), float(torque.max())))
    listed = " and ".join(f"{t:g}" for t in temperatures)
    return Shown(_conditions(listed, f"{SLOW} rpm"),
                 panels([Panel("Coulomb friction [N.m]", lines)], "fin angle [deg]"),
                 "At the motor axis; negative for motion in the negative direction. The viscous part, from the line "
                 "through the faster sweeps, is subtracted.",
                 Table(("", "smallest [N.m]", "mean [N.m]", "largest [N.m]"), rows), _UNKNOWN)


def polynomial(runs: Runs, direction: int, temperature: float = WARM) -> Array:
    """Return the coefficients [N.m] of (fin angle/20 deg)^0 to ^6 fitted to the slow sweep in a direction."""
    fin, torque = _coulomb_points(runs, temperature, direction)
    fitted: Array = np.polynomial.polynomial.polyfit(fin / POLYNOMIAL_SPAN, torque, _ORDER)
    return fitted


def curve_fit(runs: Runs, *directions: int) -> Shown:
    """Show the sixth-order polynomials fitted to the slow sweep (Figures 3.33 to 3.35)."""
    lines, rows = [], []
    for color, d in zip(plots.COLORS, directions, strict=False):
        fin, torque = _coulomb_points(runs, WARM, d)
        fitted = physics.coulomb_polynomial(polynomial(runs, d), fin)
        every = max(len(fin) // 60, 1)
        lines += [Line(np.degrees(fin[::every]), d * torque[::every], f"{DIRECTIONS[d]}, rig",
                       {**DOTS, "markersize": 2.6, "color": color}),
                  Line(np.degrees(fin), d * fitted, "polynomial", {"color": color}),
                  Line(np.degrees(fin), d * _coulomb(runs, WARM, d, fin), "parameters",
                       {**DASHED, "color": plots.INK, "linewidth": 0.9})]
        rows.append((DIRECTIONS[d], 1e3 * float(np.max(np.abs(fitted - torque))),
                     1e3 * float(np.max(np.abs(fitted - _coulomb(runs, WARM, d, fin))))))
    return Shown(_conditions(WARM, f"{SLOW} rpm"), panels([Panel("Coulomb friction [N.m]", lines)], "fin angle [deg]"),
                 "The friction compensation feeds such polynomials forward; Table 15 has the coefficients.",
                 Table(("direction", "largest difference from the rig [mN.m]", "from the parameters [mN.m]"), rows),
                 _UNKNOWN)


def temperatures(runs: Runs) -> Shown:
    """Show friction at both temperatures and their ratio (Table 13)."""
    rows = []
    for d, name in DIRECTIONS.items():
        (speed, warm), (_, cold) = _points(runs, WARM)[d], _points(runs, COLD)[d]
        slow = [runs.friction(SLOW, t).mean_friction(d) for t in (WARM, COLD)]
        for rpm, one, other in zip((SLOW, *speed), (slow[0], *warm), (slow[1], *cold), strict=True):
            rows.append((f"{name}, {rpm:.0f} rpm", float(one), float(other), float(other / one)))
    return Shown(_conditions(f"{WARM:g} and {COLD:g}", f"{SLOW} to {SPEEDS[-1]} rpm"),
                 table=Table(("direction, motor speed", f"{WARM:g} °C [N.m]", f"{COLD:g} °C [N.m]", "cold over warm"),
                             rows), unknown=_UNKNOWN)


def summary(runs: Runs) -> Shown:
    """Show the friction parameters at 24 degC: measured by the rig, and those of the set (Table 14)."""
    p, rows = _parameters(runs, WARM), []
    for d, name in DIRECTIONS.items():
        slope, level = _line(*_points(runs, WARM)[d])
        rows += [(f"viscous, {name} [N.m.s/rad]", slope, float(physics.viscous(FLOATS, p, float(d)))),
                 (f"Coulomb, {name}, at zero speed [N.m]", level, float(physics.coulomb(FLOATS, p, float(d), 0.0)))]
    return Shown(_conditions(WARM, f"{SPEEDS[0]} to {SPEEDS[-1]} rpm"),
                 table=Table(("", "rig", "parameters"), rows),
                 caption="Coulomb friction about fin angle 0: Figure 3.29 has it over the range.", unknown=_UNKNOWN)


def coefficients(runs: Runs) -> Shown:
    """Show the coefficients of the fitted polynomials beside those of the set (Table 15)."""
    fitted = {d: polynomial(runs, d) for d in DIRECTIONS}
    rows = tuple((f"{n}", *(float(x) for d, name in DIRECTIONS.items()
                            for x in (fitted[d][n], runs.values[f"friction.coulomb.{name}[{n}]"])))
                 for n in range(_ORDER + 1))
    return Shown(_conditions(WARM, f"{SLOW} rpm"),
                 table=Table(("power of (fin angle / 20°)", *(f"{name}, {who} [N.m]" for name in DIRECTIONS.values()
                                                              for who in ("rig", "parameters"))), rows),
                 caption="Single coefficients are poorly determined; the curves agree (Figure 3.35).",
                 unknown=_UNKNOWN)
