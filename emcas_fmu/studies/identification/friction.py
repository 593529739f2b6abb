"""Viscous and Coulomb friction from sweeps at constant speed, section 3.3.

Sweeps at several speeds, both ways, at two temperatures. Of each the windows at constant speed count.
What the motor's torque does not put into acceleration there is friction; the model's own friction is
fitted to all windows at once: seven Coulomb coefficients and a viscous one per direction, and the two
ratios of cold to warm. Slow sweeps tell Coulomb friction against the fin angle, fast ones the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators.electromechanical import nonlinear
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import friction
from . import motion, pictures
from .estimation import METHOD, Fit, fit
from .motion import ARRAYS
from .records import Array, Record, RecordError, grouped, read_records
from .result import Estimate, Identification, Picture, noise

VISCOUS = ("friction.viscous.positive", "friction.viscous.negative")
COULOMB = {d: tuple(f"friction.coulomb.{d}[{n}]" for n in range(7)) for d in ("positive", "negative")}
RATIOS = ("friction.cold_viscous_ratio", "friction.cold_coulomb_ratio")
NAMES = (*VISCOUS, *COULOMB["positive"], *COULOMB["negative"], *RATIOS)

FEWEST_SPEEDS = 3  # per direction: a line through two points fits anything
SPEED_SPREAD = 5.0  # fastest over slowest, or Coulomb and viscous friction look alike
FEWEST_KELVIN = 10.0  # between the temperatures, a third of the 30 K the ratios span
COVERAGE = 0.75  # of +-command.limit that each direction must have been at: the polynomials hold there
_CONSTANT = 0.10  # relative band around a sweep's speed
_ACCELERATING = 0.10  # of a window's driving torque that may go into acceleration: more is no constant speed
_CREEP = 0.2  # of the sweep's speed: slower inside a window is stick-slip
_DRIFT = 5.0  # K within a record
_FEWEST_WINDOWS = 8
_PLAUSIBLE = 30.0  # factor to the base set's friction beyond which a unit is more likely wrong
_WORST_COULOMB, _WORST = 0.2, 0.5  # relative 1 sigma beyond which there is no answer
_GIVEN = ("motor.torque_constant", "inertia.motor", "inertia.screw", "kinematics.moment_arm", "screw.lead",
          "friction.fin_viscous", "friction.fin_coulomb")


@dataclass(frozen=True)
class Sweep:
    """The constant-speed windows of one record in one direction."""

    record: Record
    direction: int
    speed: float
    temperature: float
    windows: motion.Averages


def identify(paths: Sequence[Path], base: ParameterSet, keep_ratios: bool = False) -> Identification:
    """Friction parameters from records with motor_angle, motor_current and temperature.

    `keep_ratios` takes the cold ratios from `base`, for measurements at one temperature. Raises RecordError.
    """
    records = read_records(paths, ("motor_angle", "motor_current", "temperature"), ("motor_speed",))
    sweeps, groups = grouped(records, lambda record: _sweeps(record, base.values))
    _require(sweeps, base, keep_ratios)
    names = NAMES[:-2] if keep_ratios else NAMES
    found_fit = _fit(sweeps, groups, base, names)
    values = {**base.values, **dict(zip(names, found_fit.values, strict=True))}
    _require_plausible(values, base)
    _require_certain(found_fit, names, base)
    estimates = [Estimate(name, float(value), float(sigma), _unit(base, name), True, float(base.values[name]))
                 for name, value, sigma in zip(names, found_fit.values, found_fit.sigmas, strict=True)]
    notes = _notes(sweeps, found_fit, names, base, keep_ratios)
    return Identification(
        "friction", "Viscous and Coulomb friction", records, estimates,
        {name: float(base.values[name]) for name in _GIVEN}, METHOD, notes,
        _pictures(sweeps, found_fit, names, base.values, values), (names, found_fit.correlation),
        noise(records, found_fit, groups, "N.m"))


def _unit(base: ParameterSet, name: str) -> str:
    return next(e.variable.unit for e in base.entries if e.variable.name == name)


def _sweeps(record: Record, values: Mapping[str, Any]) -> list[Sweep]:
    motion.check(record, values)
    temperature = record["temperature"]
    if np.ptp(temperature) > _DRIFT:
        raise record.fail(f"temperature drifts by {np.ptp(temperature):.3g} K within the record; at most {_DRIFT:g} K "
                          "may pass for one temperature: let it settle, or cut the record")
    # A first look in short windows tells how long the sweeps last; then a twentieth of that each.
    width = max(len(record) // 100, 6)
    look = motion.averages(record, width, max(width // 2, 1))
    moving = float(np.mean(np.abs(look.speed) > 0.5 * np.abs(look.speed).max())) * len(record)
    both = (look.speed.max() > 0.0) + (look.speed.min() < -0.3 * np.abs(look.speed).max())
    width = int(np.clip(moving / max(both, 1) / 20.0, 8, 64))
    a = motion.averages(record, width, width // 2)
    m, left = motion.balance(values, a, friction.WARM)
    accelerating = np.abs(m.inertia * a.acceleration)
    found = []
    slipping = 0
    for direction in (1, -1):
        along = direction * a.speed
        if along.max() < 0.3 * np.abs(a.speed).max():
            continue
        speed = float(np.median(along[along > 0.5 * along.max()]))
        steady = np.abs(along - speed) < _CONSTANT * speed
        steady &= accelerating < _ACCELERATING * np.abs(left)
        smooth = a.slowest > _CREEP * speed
        slipping += int(np.sum((along > 0.3 * speed) & (along < 3.0 * speed) & ~smooth))
        for inside in motion.stretches(steady & smooth, _FEWEST_WINDOWS):
            windows = a.at(inside[1:-1])  # the first and last may reach into what came before and after
            found.append(Sweep(record, direction, float(np.mean(direction * windows.speed)),
                               float(np.mean(temperature)), windows))
    if not found:
        raise record.fail("has no stretch at constant speed" + (
            ": the motion is stick-slip; sweep faster or stiffen the speed control" if slipping > _FEWEST_WINDOWS else
            f": {_FEWEST_WINDOWS} windows in a row within {_CONSTANT:.0%} of one speed are needed; sweep at constant "
            f"speed over the whole range, and log at least {_FEWEST_WINDOWS * 5} samples of it"))
    return found


def _fin(sweep: Sweep, values: Mapping[str, Any]) -> Array:
    return motion.fin_angle(nonlinear.ACTUATOR.namespace(values), sweep.windows.angle)


def _require(sweeps: Sequence[Sweep], base: ParameterSet, keep_ratios: bool) -> None:
    """What is needed of all sweeps together."""
    limit = float(base.values["command.limit"])
    for direction, word in ((1, "positive"), (-1, "negative")):
        mine = [s for s in sweeps if s.direction == direction]
        if not mine:
            raise RecordError(f"no sweep in the {word} direction: friction differs with direction; measure both")
        speeds = _distinct([s.speed for s in mine])
        said = ", ".join(f"{s:.3g}" for s in speeds)
        if len(speeds) < FEWEST_SPEEDS:
            raise RecordError(f"too few speeds in the {word} direction ({said} rad/s): viscous friction needs at least "
                              f"{FEWEST_SPEEDS} different ones, one of them slow")
        if speeds[-1] < SPEED_SPREAD * speeds[0]:
            raise RecordError(f"the speeds in the {word} direction ({said} rad/s) are too alike to tell Coulomb from "
                              f"viscous friction: the fastest must be at least {SPEED_SPREAD:g} times the slowest")
        fin = np.concatenate([_fin(s, base.values) for s in mine])
        if fin.min() > -COVERAGE * limit or fin.max() < COVERAGE * limit:
            raise RecordError(f"sweeps in the {word} direction cover the fin angle from {degrees(fin.min()):.3g} to "
                              f"{degrees(fin.max()):.3g} deg; a sixth-order polynomial needs at least "
                              f"+-{degrees(COVERAGE * limit):.3g} deg ({COVERAGE:.0%} of command.limit): sweep slowly "
                              "over the whole range")
    if keep_ratios:
        return
    inside = np.clip([s.temperature for s in sweeps], friction.COLD, friction.WARM)
    if np.ptp(inside) < FEWEST_KELVIN:
        told = ", ".join(f"{t:.3g}" for t in _distinct([s.temperature for s in sweeps], 1.0))
        raise RecordError(f"all sweeps are at about the same temperature ({told} degC): the cold ratios need two, at "
                          f"least {FEWEST_KELVIN:g} K apart between {friction.COLD:g} and {friction.WARM:g} degC; "
                          "measure cold too, or keep the ratios of the parameter file with --keep-cold-ratios")
    for end in (inside.min(), inside.max()):
        near = [s for s, t in zip(sweeps, inside, strict=True) if abs(t - end) < 0.5 * FEWEST_KELVIN]
        if len(_distinct([s.speed for s in near])) < 2:
            raise RecordError(f"only one speed near {end:.3g} degC: the ratio of viscous friction needs at least two "
                              "at each temperature")


def _distinct(numbers: Sequence[float], apart: float = 0.0) -> list[float]:
    """Those that differ by more than 15 %, or by `apart`, sorted."""
    kept: list[float] = []
    for number in sorted(numbers):
        if not kept or number - kept[-1] > (apart or 0.15 * abs(kept[-1])):
            kept.append(number)
    return kept


def _fit(sweeps: Sequence[Sweep], groups: Sequence[Sequence[int]], base: ParameterSet, names: Sequence[str]) -> Fit:
    windows, temperature, ends = _joined(sweeps)
    m, torque = motion.balance(base.values, windows, temperature)
    level = max(float(np.mean(np.abs(torque))), 1e-12)
    fastest = max(s.speed for s in sweeps)
    sizes = {**dict.fromkeys(VISCOUS, level / fastest), **{n: level for d in COULOMB.values() for n in d},
             **dict.fromkeys(RATIOS, 1.0)}
    scale = np.array([sizes[n] for n in names])

    def residuals(x: Array) -> list[Array]:
        values = {**base.values, **dict(zip(names, x.tolist(), strict=True))}
        return np.split(torque - motion.resisting(values, windows, m, temperature), ends)

    # From flat polynomials: those of the base set might be far off.
    begin = {**dict.fromkeys(names, 0.0), **{c[0]: level for c in COULOMB.values()}, **dict.fromkeys(RATIOS, 1.0),
             **dict.fromkeys(VISCOUS, 0.1 * level / fastest)}
    return fit(residuals, np.array([begin[n] for n in names]), scale, groups, motion.OVERLAP)


def _joined(sweeps: Sequence[Sweep]) -> tuple[motion.Averages, Array, Any]:
    """All sweeps' windows one after the other, the temperature at each, and where each sweep but the last ends."""
    lengths = [len(s.windows.time) for s in sweeps]
    temperature = np.repeat([s.temperature for s in sweeps], lengths)
    return motion.joined([s.windows for s in sweeps]), temperature, np.cumsum(lengths)[:-1]


def _require_plausible(values: Mapping[str, Any], base: ParameterSet) -> None:
    ours, theirs = nonlinear.ACTUATOR.namespace(values), base.nested()
    for direction, side in (("positive", 1.0), ("negative", -1.0)):
        found, expected = (float(friction.coulomb_polynomial(getattr(p.friction.coulomb, direction), 0.0))
                           for p in (ours, theirs))
        if found <= 0.0:
            raise RecordError(f"the Coulomb friction found in the {direction} direction is {found:.3g} N.m: the "
                              "current does not resist the motion; check the signs of motor_current and motor_angle, "
                              "and the zero of the current sensor")
        if not 1.0 / _PLAUSIBLE < found / max(expected, 1e-9) < _PLAUSIBLE:
            raise RecordError(f"the Coulomb friction found in the {direction} direction, {found:.3g} N.m, is "
                              f"{found / expected:.3g} times that of the base parameters ({expected:.3g} N.m): check "
                              "the unit of motor_current and the base's motor.torque_constant")
        if float(friction.viscous(FLOATS, ours, side)) <= 0.0:
            raise RecordError(f"the viscous friction found in the {direction} direction is not positive: friction "
                              "falls with speed, which the model does not know; leave out the slowest sweeps if they "
                              "are in mixed lubrication, and check that temperature was the same at all speeds")
    for name in RATIOS:
        if float(values[name]) < 0.0:
            raise RecordError(f"{name} is {float(values[name]):.3g}: the sweeps do not agree with one ratio; check the "
                              "column temperature")


def _require_certain(found: Fit, names: Sequence[str], base: ParameterSet) -> None:
    values = dict(zip(names, zip(found.values, found.sigmas, strict=True), strict=True))
    limit = float(base.values["command.limit"])
    for direction, coefficients in COULOMB.items():
        level = values[coefficients[0]][0]
        band = float(_band(found, names, direction, np.linspace(-limit, limit, 81)).max())
        if not band < _WORST_COULOMB * level:
            raise RecordError(f"Coulomb friction in the {direction} direction is not supported by the data: 1 sigma is "
                              f"{band:.2g} N.m of {level:.3g} N.m somewhere within +-{degrees(limit):.3g} deg; sweep "
                              "slowly over the whole range, more than once")
    for name in (*VISCOUS, *(n for n in RATIOS if n in values)):
        value, sigma = values[name]
        if not sigma < _WORST * abs(value):
            raise RecordError(f"{name} is not supported by the data: {value:.3g} +- {sigma:.2g}; sweep faster, longer "
                              "or more often")


def _coulomb(coefficients: Any, fin: Array) -> Array:
    found: Array = friction.coulomb_polynomial(coefficients, fin) + 0.0 * fin
    return found


def _band(found: Fit, names: Sequence[str], direction: str, fin: Array) -> Array:
    """1-sigma of a direction's Coulomb polynomial at fin angles."""
    # The polynomial is linear in its coefficients: its gradient is itself, for unit coefficients.
    rows = np.array([_coulomb(np.eye(7)[n], fin) for n in range(7)]).T
    at = [names.index(n) for n in COULOMB[direction]]
    block = found.covariance[np.ix_(at, at)]
    band: Array = np.sqrt(np.einsum("ij,jk,ik->i", rows, block, rows))
    return band


def _notes(sweeps: Sequence[Sweep], found: Fit, names: Sequence[str], base: ParameterSet,
           keep_ratios: bool) -> list[str]:
    limit = float(base.values["command.limit"])
    fin = np.linspace(-limit, limit, 81)
    lines = [f"{len(sweeps)} sweeps at {', '.join(f'{s:.3g}' for s in _distinct([s.speed for s in sweeps]))} rad/s and "
             f"{', '.join(f'{t:.3g}' for t in _distinct([s.temperature for s in sweeps], 1.0))} degC."]
    lines += [f"Coulomb friction, {d} direction: 1 sigma is at most {_band(found, names, d, fin).max():.2g} N.m within "
              f"+-{degrees(limit):.3g} deg; the coefficients are strongly correlated, so that each alone is less "
              "certain."
              for d in COULOMB]
    if keep_ratios:
        lines.append("The cold ratios are those of the base parameters, not measured.")
    lines.append("All torques scale with motor.torque_constant, whose own uncertainty is not included; an offset of "
                 "the current sensor goes into the Coulomb friction, with opposite signs in the two directions.")
    return lines


def _pictures(sweeps: Sequence[Sweep], found: Fit, names: Sequence[str], base: Mapping[str, Any],
              values: Mapping[str, Any]) -> list[Picture]:
    p = nonlinear.ACTUATOR.namespace(values)
    windows = [(s, _fin(s, base), motion.balance(base, s.windows, s.temperature)) for s in sweeps]
    points = [(s, fin, s.direction * torque) for s, fin, (_, torque) in windows]

    def against_fin(direction: int) -> list[pictures.Series]:
        """Friction of the slowest sweep, warm and cold, less what is viscous."""
        series = []
        name = "positive" if direction > 0 else "negative"
        mine = [(s, fin, t) for s, fin, t in points if s.direction == direction]
        slow = min(s.speed for s, _, _ in mine)
        for s, fin, torque in mine:
            if s.speed > 1.15 * slow:
                continue
            q = nonlinear.ACTUATOR.namespace({**values, "friction.temperature": s.temperature})
            grid = np.linspace(fin.min(), fin.max(), 200)
            label = f"{s.temperature:.3g} degC"
            viscous = float(friction.viscous(FLOATS, q, direction)) * s.speed
            model = friction.coulomb(ARRAYS, q, float(direction), grid)
            band = 2.0 * _band(found, names, name, grid) * model / np.maximum(_coulomb(
                getattr(p.friction.coulomb, name), grid), 1e-12)
            series.append(pictures.Series(label, np.degrees(fin), torque - viscous, np.degrees(grid), model, band))
        return series

    def against_speed() -> list[pictures.Series]:
        series = []
        for direction, word in ((1, "positive"), (-1, "negative")):
            for t in _distinct([s.temperature for s in sweeps], 5.0):
                mine = [(s, fin, torque) for s, fin, torque in points
                        if s.direction == direction and abs(s.temperature - t) < 5.0]
                if not mine:
                    continue
                q = nonlinear.ACTUATOR.namespace(
                    {**values, "friction.temperature": float(np.mean([s.temperature for s, _, _ in mine]))})
                # What is Coulomb is taken off at each fin angle and put back as that at fin angle 0.
                centre = float(friction.coulomb(FLOATS, q, float(direction), 0.0))
                torque = np.array([np.mean(tq - friction.coulomb(ARRAYS, q, float(direction), fin)) + centre
                                   for _, fin, tq in mine])
                speed = np.array([s.speed for s, _, _ in mine])
                grid = np.linspace(0.0, speed.max(), 2)
                line = centre + float(friction.viscous(FLOATS, q, direction)) * grid
                series.append(pictures.Series(f"{word}, {t:.3g} degC", speed, torque, grid, line, None))
        return series

    def residual_series() -> list[tuple[str, Array, Array]]:
        return [(f"{s.direction * s.speed:+.3g} rad/s", np.degrees(fin), r)
                for (s, fin, _), r in zip(points, found.residuals, strict=True)]

    return [
        Picture("Coulomb friction against fin angle",
                "Windows of the slowest sweeps with the viscous part taken off, and the fitted sixth-order "
                "polynomials with their 2-sigma band, per direction of motion.",
                lambda: pictures.panels([("positive direction", against_fin(1)), ("negative "
                                                                                  "direction", against_fin(-1))],
                                        "fin angle [deg]", "Coulomb friction at the motor [N.m]")),
        Picture("Friction against speed",
                "Mean of each sweep at constant speed, reduced to fin angle 0 with the fitted polynomials, and the "
                "fitted line: its slope is the viscous coefficient.",
                lambda: pictures.panels([("", against_speed())], "motor speed [rad/s]",
                                        "friction at fin angle 0 [N.m]")),
        pictures.residuals(residual_series, "fin angle [deg]", "residual torque [N.m]", found),
    ]
