"""Identify viscous and Coulomb friction from sweeps at constant speed (section 3.3).

The records are sweeps at several speeds, in both directions, at two temperatures. In windows at constant speed, the
motor's torque minus inertia times acceleration is friction. The model's friction is fitted to all windows at once: per
direction seven Coulomb coefficients and one viscous coefficient, and the two ratios of cold to warm friction. Slow
sweeps determine Coulomb friction over the fin angle, fast sweeps viscous friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...actuators.electromechanical import nonlinear
from ...ops.arrays import ARRAYS
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import friction, mechanics
from ...plotting.plots import Drawing
from ...units import RPM
from . import motion, pictures
from .estimation import Fit
from .records import DIRECTIONS, Array, RecordFile, distinct, divided, read_records, require, sequences
from .result import Estimate, Identification, IdentificationExperiment, estimates, require_certain

EXPERIMENT = IdentificationExperiment(
    "friction", "Viscous and Coulomb friction", ("motor_angle", "motor_current", "temperature"), ("motor_speed",),
    ("motor.torque_constant", "inertia.motor", "inertia.screw", "kinematics.moment_arm", "screw.lead",
     *mechanics.HINGE_VISCOUS, *mechanics.HINGE_DRY), "N.m")
VISCOUS = ("friction.viscous.positive", "friction.viscous.negative")
COULOMB = {d: tuple(f"friction.coulomb.{d}[{n}]" for n in range(7)) for d in ("positive", "negative")}
# The cold point of friction.table, -6 degC by default. The polynomials are valid at the next point, 24 degC.
RATIOS = ("friction.table.viscous[1]", "friction.table.coulomb[1]")
_TABLE = ("friction.table.temperature[1]", "friction.table.temperature[2]")
NAMES = (*VISCOUS, *COULOMB["positive"], *COULOMB["negative"], *RATIOS)

FEWEST_SPEEDS = 3  # smallest number per direction: a line through two points always fits
SPEED_SPREAD = 5.0  # smallest ratio of fastest to slowest speed that separates Coulomb from viscous friction
FEWEST_KELVIN = 10.0  # smallest difference of the temperatures: a third of the 30 K between the points of the table
COVERAGE = 0.75  # share of +-command.limit that sweeps in each direction must cover to determine the polynomials
_CONSTANT = 0.10  # relative band around a sweep's speed
_ACCELERATING = 0.10  # largest share of the torque that accelerates at constant speed
_CREEP = 0.2  # lowest speed in a window without stick-slip, as a share of the sweep's speed
_DRIFT = 5.0  # K, largest change of the temperature within a record
_FEWEST_WINDOWS = 8
_PLAUSIBLE = 30.0  # ratio to the base set's friction beyond which a unit is probably wrong
_WORST_COULOMB, _WORST = 0.2, 0.5  # largest relative 1 sigma in a result: Coulomb friction, other parameters


class SteadySweep(NamedTuple):
    """Consecutive windows at constant `speed` [rad/s], in one `direction` (1, -1) and at one `temperature` [degC].

    `fin` is the fin angle [rad], `torque` the friction torque [N.m] in each window.
    """

    direction: int
    speed: float
    temperature: float
    windows: motion.Averages
    fin: Array
    torque: Array


def identify(paths: Sequence[Path], base: ParameterSet, keep_ratios: bool = False) -> Identification:
    """Identify the friction parameters; with `keep_ratios` from records at one temperature. Raises RecordError.

    With `keep_ratios`, the ratios of cold to warm friction are those of `base`.
    """
    records = read_records(paths, EXPERIMENT.required, EXPERIMENT.optional)
    sweeps, owners = divided(records, lambda record: _sweeps(record, base.values))
    _require(sweeps, base, keep_ratios)
    names = NAMES[:-2] if keep_ratios else NAMES
    level = max(float(np.mean(np.abs(np.concatenate([s.torque for s in sweeps])))), 1e-12)
    fastest = max(s.speed for s in sweeps)
    flat = [level, *[0.0] * 6]  # initial polynomial, since that of the base set may be far off
    start = np.array([*[0.1 * level / fastest] * 2, *flat, *flat, 1.0, 1.0])[:len(names)]
    scale = np.array([*[level / fastest] * 2, *[level] * 14, 1.0, 1.0])[:len(names)]
    fit = motion.fit_motion(base.values, names, [s.windows for s in sweeps], [s.temperature for s in sweeps], start,
                            scale, owners)
    values = {**base.values, **dict(zip(fit.names, fit.values, strict=True))}
    _require_plausible(values, base)
    parameters = estimates(fit, base)
    bands = _require_certain(parameters, fit, base)
    limit = degrees(float(base.values["command.limit"]))
    notes = [f"{len(sweeps)} sweeps at {_listed(sweeps, 'speed')} rpm and {_listed(sweeps, 'temperature')} degC.",
             *(f"Coulomb friction, {d} direction: 1 sigma is at most {band:.2g} N.m within +-{limit:.3g} deg; the "
               "coefficients are strongly correlated, and each alone is less certain."
               for d, band in bands.items()),
             *(["The cold ratios are those of the base parameters, not measured."] if keep_ratios else []),
             "All torques scale with motor.torque_constant, whose uncertainty is not included; an offset of the "
             "current sensor changes the Coulomb friction, with opposite signs in the two directions."]
    return Identification(EXPERIMENT, records, base, fit, parameters, notes, lambda: _drawings(sweeps, fit, values))


def _sweeps(record: RecordFile, values: Mapping[str, Any]) -> list[SteadySweep]:
    """Return the sweeps in a record. Raises RecordError if there is none."""
    motion.check(record, values)
    temperature = record["temperature"]
    record.require(np.ptp(temperature) <= _DRIFT, f"temperature drifts by {np.ptp(temperature):.3g} K within the "
                   f"record; at most {_DRIFT:g} K count as one temperature: wait until it settles, or cut the record")
    # Short windows give the duration of the sweeps; the final windows are a twentieth of it.
    width = max(len(record) // 100, 6)
    first = motion.averages(record, width, max(width // 2, 1))
    moving = float(np.mean(np.abs(first.speed) > 0.5 * np.abs(first.speed).max())) * len(record)
    directions = (first.speed.max() > 0.0) + (first.speed.min() < -0.3 * np.abs(first.speed).max())
    width = int(np.clip(moving / max(directions, 1) / 20.0, 8, 64))
    a = motion.averages(record, width, width // 2)
    p = motion.namespace(values, motion.WARM)
    m, torque = motion.balance(p, a)
    fin = motion.fin_angle(p, a.angle)
    unaccelerated = np.abs(m.inertia * a.acceleration) < _ACCELERATING * np.abs(torque)
    sweeps = []
    slipping = 0
    for direction, _ in DIRECTIONS:
        along = direction * a.speed
        if along.max() < 0.3 * np.abs(a.speed).max():
            continue
        speed = float(np.median(along[along > 0.5 * along.max()]))
        steady = (np.abs(along - speed) < _CONSTANT * speed) & unaccelerated
        smooth = a.slowest > _CREEP * speed
        slipping += int(np.sum((along > 0.3 * speed) & (along < 3.0 * speed) & ~smooth))
        for begin, end in sequences(steady & smooth):
            if end - begin >= _FEWEST_WINDOWS:
                inside = slice(begin + 1, end - 1)  # the first and the last window may overlap other motion
                windows = a.at(inside)
                sweeps.append(SteadySweep(direction, float(np.mean(direction * windows.speed)),
                                          float(np.mean(temperature)), windows, fin[inside], torque[inside]))
    record.require(sweeps, "has no stretch at constant speed: " + (
        "the motion sticks and slips; sweep faster or stiffen the speed control" if slipping > _FEWEST_WINDOWS else
        f"{_FEWEST_WINDOWS} windows in a row within {_CONSTANT:.0%} of one speed are needed; sweep at constant speed "
        f"over the whole range, and log at least {_FEWEST_WINDOWS * 5} samples of it"))
    return sweeps


def _require(sweeps: Sequence[SteadySweep], base: ParameterSet, keep_ratios: bool) -> None:
    """Raise RecordError if the sweeps lack a direction, speeds, part of the range or a temperature."""
    limit = float(base.values["command.limit"])
    for direction, word in DIRECTIONS:
        along = [s for s in sweeps if s.direction == direction]
        require(along, f"there is no sweep in the {word} direction: friction differs with direction; measure both")
        speeds = distinct([s.speed for s in along])
        require(len(speeds) >= FEWEST_SPEEDS, f"too few speeds in the {word} direction ({_listed(along, 'speed')} "
                f"rpm): viscous friction needs at least {FEWEST_SPEEDS} different ones, one of them slow")
        require(speeds[-1] >= SPEED_SPREAD * speeds[0], f"the speeds in the {word} direction "
                f"({_listed(along, 'speed')} rpm) are too alike to separate Coulomb from viscous friction: the fastest "
                f"must be at least {SPEED_SPREAD:g} times the slowest")
        fin = np.concatenate([s.fin for s in along])
        require(fin.min() <= -COVERAGE * limit and fin.max() >= COVERAGE * limit,
                f"sweeps in the {word} direction cover the fin angle from {degrees(fin.min()):.3g} to "
                f"{degrees(fin.max()):.3g} deg; a sixth-order polynomial needs at least "
                f"+-{degrees(COVERAGE * limit):.3g} deg ({COVERAGE:.0%} of command.limit): sweep slowly over the whole "
                "range")
    if keep_ratios:
        return
    cold, warm = (float(base.values[name]) for name in _TABLE)
    inside = np.clip([s.temperature for s in sweeps], cold, warm)
    require(np.ptp(inside) >= FEWEST_KELVIN, "all sweeps are at about the same temperature "
            f"({_listed(sweeps, 'temperature')} degC): the cold ratios need two, at least {FEWEST_KELVIN:g} K apart "
            f"between {cold:g} and {warm:g} degC; measure also at a low temperature, or keep the ratios of the "
            "parameter file with --keep-cold-ratios")
    for end in (inside.min(), inside.max()):
        near = [s.speed for s, t in zip(sweeps, inside, strict=True) if abs(t - end) < 0.5 * FEWEST_KELVIN]
        require(len(distinct(near)) >= 2, f"there is only one speed near {end:.3g} degC: the ratio of viscous friction "
                "needs at least two at each temperature")


def _listed(sweeps: Sequence[SteadySweep], quantity: str) -> str:
    """Return the different speeds [rpm] or temperatures [degC] of sweeps as text."""
    numbers = [getattr(s, quantity) * (RPM if quantity == "speed" else 1.0) for s in sweeps]
    return ", ".join(f"{float(f'{x:.3g}'):g}" for x in distinct(numbers, 1.0 if quantity == "temperature" else 0.0))


def _require_plausible(values: Mapping[str, Any], base: ParameterSet) -> None:
    """Raise RecordError for friction that drives the motion, falls with speed, or is far from that of the base set."""
    p = nonlinear.ACTUATOR.namespace(values)
    for side, direction in DIRECTIONS:
        level, expected = (float(each[COULOMB[direction][0]]) for each in (values, base.values))  # at fin angle 0
        require(level > 0.0, f"the Coulomb friction in the {direction} direction is estimated as {level:.3g} N.m: the "
                "current does not resist the motion; check the signs of motor_current and motor_angle, and the zero of "
                "the current sensor")
        ratio = level / max(expected, 1e-9)
        require(1.0 / _PLAUSIBLE < ratio < _PLAUSIBLE, f"the Coulomb friction in the {direction} direction, "
                f"{level:.3g} N.m, is {ratio:.3g} times that of the base parameters ({expected:.3g} N.m): check the "
                "unit of motor_current and the base's motor.torque_constant")
        require(float(friction.viscous(FLOATS, p, float(side))) > 0.0, f"the viscous friction in the {direction} "
                "direction is not positive: friction falls with speed, contrary to the model; leave out the slowest "
                "sweeps if they are in mixed lubrication, and check that temperature was the same at all speeds")
    for name in RATIOS:
        require(float(values[name]) >= 0.0, f"{name} is {float(values[name]):.3g}, below 0: no single ratio fits the "
                "sweeps; check the column temperature")


def _require_certain(parameters: Sequence[Estimate], fit: Fit, base: ParameterSet) -> dict[str, float]:
    """Return the largest 1 sigma [N.m] of each direction's Coulomb friction within command.limit.

    Raises RecordError for parameters that are too uncertain.
    """
    limit = float(base.values["command.limit"])
    bands = {d: float(_band(fit, d, np.linspace(-limit, limit, 81)).max()) for d in COULOMB}
    for direction, band in bands.items():
        level = next(e.value for e in parameters if e.name == COULOMB[direction][0])
        require(band < _WORST_COULOMB * level, f"Coulomb friction in the {direction} direction is not supported by the "
                f"data: 1 sigma is {band:.2g} N.m of {level:.3g} N.m somewhere within +-{degrees(limit):.3g} deg; "
                "sweep slowly over the whole range, more than once")
    require_certain([e for e in parameters if e.name in (*VISCOUS, *RATIOS)], _WORST,
                    "sweep faster, longer or more often")
    return bands


def _band(fit: Fit, direction: str, fin: Array) -> Array:
    """Return 1 sigma [N.m] of a direction's Coulomb polynomial at fin angles [rad]."""
    # The polynomial is linear in its coefficients: the derivatives are the polynomials of unit coefficients.
    rows = np.array([friction.coulomb_polynomial(unit, fin) for unit in np.eye(7)]).T
    indices = [fit.names.index(n) for n in COULOMB[direction]]
    band: Array = np.sqrt(np.einsum("ij,jk,ik->i", rows, fit.covariance[np.ix_(indices, indices)], rows))
    return band


def _drawings(sweeps: Sequence[SteadySweep], fit: Fit, values: Mapping[str, Any]) -> Iterator[Drawing]:
    yield pictures.panels(
        "Coulomb friction against fin angle", (
            (f"{word} direction", _against_fin(direction, word, sweeps, fit, values))
            for direction, word in DIRECTIONS), "fin angle [deg]", "Coulomb friction at the motor [N.m]",
        "Windows of the slowest sweeps minus the viscous friction, and the fitted sixth-order polynomials with their "
        "2-sigma band, for each direction of motion.")
    yield pictures.panels(
        "Friction against speed", [("", _against_speed(sweeps, values))], "motor speed [rpm]",
        "friction at fin angle 0 [N.m]",
        "Mean friction of each sweep, reduced to fin angle 0 with the fitted polynomials, and the fitted line, whose "
        "slope is the viscous coefficient.")
    yield pictures.residuals([(f"{s.direction * s.speed * RPM:+.3g} rpm", np.degrees(s.fin)) for s in sweeps], fit,
                             "fin angle [deg]", "residual torque [N.m]")


def _against_fin(direction: int, word: str, sweeps: Sequence[SteadySweep], fit: Fit,
                 values: Mapping[str, Any]) -> Iterator[pictures.Series]:
    """Yield the friction of the slowest sweeps in a direction, warm and cold, minus the viscous friction."""
    slow = min(s.speed for s in sweeps if s.direction == direction)
    for s in sweeps:
        if s.direction != direction or s.speed > 1.15 * slow:
            continue
        p = motion.namespace(values, s.temperature)
        grid = np.linspace(s.fin.min(), s.fin.max(), 200)
        viscous = float(friction.viscous(FLOATS, p, direction)) * s.speed
        model = friction.coulomb(ARRAYS, p, float(direction), grid)
        warm = np.maximum(friction.coulomb_polynomial(getattr(p.friction.coulomb, word), grid), 1e-12)
        yield pictures.Series(f"{s.temperature:.3g} degC", np.degrees(s.fin), direction * s.torque - viscous,
                              np.degrees(grid), model, 2.0 * _band(fit, word, grid) * model / warm)


def _against_speed(sweeps: Sequence[SteadySweep], values: Mapping[str, Any]) -> Iterator[pictures.Series]:
    """Yield the mean friction of each sweep over speed, by direction and temperature, reduced to fin angle 0."""
    for (direction, word), t in product(DIRECTIONS, distinct([s.temperature for s in sweeps], 5.0)):
        if not (alike := [s for s in sweeps if s.direction == direction and abs(s.temperature - t) < 5.0]):
            continue
        p = motion.namespace(values, float(np.mean([s.temperature for s in alike])))
        # Coulomb friction at fin angle 0 replaces that at each window's fin angle.
        centre = float(friction.coulomb(FLOATS, p, float(direction), 0.0))
        torque = np.array([np.mean(direction * s.torque - friction.coulomb(ARRAYS, p, float(direction), s.fin))
                           + centre for s in alike])
        speed = np.array([s.speed for s in alike])
        grid = np.linspace(0.0, speed.max(), 2)
        line = centre + float(friction.viscous(FLOATS, p, direction)) * grid
        yield pictures.Series(f"{word}, {t:.3g} degC", speed * RPM, torque, grid * RPM, line)
