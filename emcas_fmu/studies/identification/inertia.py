"""Total inertia at the motor from spin-ups, and what it leaves for the rotor, (2.8)-(2.17).

Steps of current turn the motor up from rest, at several levels and both ways. Windows of the motion
balance K_t i against inertia times acceleration and friction. Friction is not taken from the parameter
set but found along, per direction: viscous coefficient and sixth-order Coulomb polynomial. Levels apart
are what tells inertia from friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators.electromechanical import nonlinear
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import friction, kinematics, mechanics
from . import motion, pictures
from .estimation import METHOD, Fit, fit
from .friction import COULOMB, VISCOUS
from .records import Array, Record, RecordError, grouped, read_records
from .result import Estimate, Identification, Picture, noise

TOTAL = "total inertia at the motor"  # at fin angle 0
MOTOR = "inertia.motor"
SPREAD = 1.5  # highest over lowest torque between runs of one direction, at least
_LEVELS = tuple(name for d in ("positive", "negative") for name in COULOMB[d])
_NAMES = (MOTOR, *VISCOUS, *_LEVELS)
_WORST = 0.1
_SCALE = 40.0  # factor of a file's own inertia to the base set's beyond which a unit must be wrong
_FASTEST = 0.02  # of the largest speed: slower windows may touch standstill
_GIVEN = ("motor.torque_constant", "inertia.screw", "inertia.fin", "inertia.shaft", "inertia.fork", "mass.nut",
          "kinematics.moment_arm", "kinematics.initial_angle", "screw.lead")


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """inertia.motor from spin-up records with motor_angle and motor_current. Raises RecordError."""
    records = read_records(paths, ("motor_angle", "motor_current"), ("motor_speed",))
    parts, groups = grouped(records, lambda record: _moving(record, base.values))
    _require_scale(records, [[parts[i] for i in members] for members in groups], base)
    _require(parts, base)
    found_fit = _fit(parts, groups, base)
    motor, sigma = float(found_fit.values[0]), float(found_fit.sigmas[0])
    values = {**base.values, MOTOR: motor}
    total = _total(values)
    if not sigma < _WORST * total:
        raise RecordError(f"the inertia is not supported by the data: {total:.3g} +- {sigma:.2g} kg.m2 in total; spin "
                          "up at levels of current further apart, so that it can be told from friction")
    if motor <= 0.0:
        raise RecordError(f"the total inertia at the motor is found as {total:.4g} kg.m2, but screw, nut and fin side "
                          f"of the base parameters alone make {total - motor:.4g}: check inertia.fin, .fork, .shaft "
                          "and .screw, mass.nut and the unit of motor_current")
    expected = float(base.values[MOTOR])
    if not 1.0 / 30.0 < motor / expected < 30.0:
        raise RecordError(f"inertia.motor is found as {motor:.4g} kg.m2, {motor / expected:.3g} times that of the base "
                          "parameters: check the units of motor_current, motor_angle and time in the headers")
    estimates = [Estimate(MOTOR, motor, sigma, "kg.m2", True, expected),
                 Estimate(TOTAL, total, sigma, "kg.m2", False, _total(base.values))]
    notes = [
        f"{len(parts)} stretches of motion; torques from {_torques(parts, base.values).min():.3g} to "
        f"{_torques(parts, base.values).max():.3g} N.m.",
        f"Friction found along, positive and negative direction: Coulomb {found_fit.values[3]:.3g} and "
        f"{found_fit.values[10]:.3g} N.m at fin angle 0, viscous {found_fit.values[1]:.3g} and "
        f"{found_fit.values[2]:.3g} N.m.s/rad.",
        "The total is that at fin angle 0. It scales with motor.torque_constant; inertia.motor is what screw, nut and "
        "fin side of the parameter set leave of it. Their uncertainties are not included.",
    ]
    return Identification("inertia", "Inertia", records, estimates, {n: float(base.values[n]) for n in _GIVEN}, METHOD,
                          notes, _pictures(parts, records, groups, found_fit, base.values),
                          (_NAMES, found_fit.correlation), noise(records, found_fit, groups, "N.m"))


def _total(values: Mapping[str, Any]) -> float:
    p = nonlinear.ACTUATOR.namespace(values)
    angle = float(kinematics.motor_angle(FLOATS, p, 0.0))
    return float(mechanics.coefficients(FLOATS, p, angle, 0.0, 0.0, 0.0).inertia)


def _moving(record: Record, values: Mapping[str, Any]) -> list[motion.Averages]:
    """Stretches of a record in which the motor slides one way."""
    motion.check(record, values)
    speed = np.abs(np.diff(record["motor_angle"])) / record.step
    count = max(int(np.sum(speed > 0.05 * speed.max())), 1)
    width = int(np.clip(count / 12, 8, 64))
    a = motion.averages(record, width, max(width // 2, 1))
    sliding = a.slowest > _FASTEST * np.abs(a.speed).max()
    found = [a.at(inside) for inside in motion.stretches(sliding, 4)]
    if not found:
        raise record.fail(f"no motion long enough to tell an acceleration: fewer than 4 windows of {width} samples; "
                          "log faster, or with a smaller current")
    return found


def _torques(parts: Sequence[motion.Averages], values: Mapping[str, Any]) -> Array:
    found: Array = np.array([np.mean(np.abs(a.current)) for a in parts]) * float(values["motor.torque_constant"])
    return found


def _require_scale(records: Sequence[Record], parts: Sequence[Sequence[motion.Averages]], base: ParameterSet) -> None:
    """Refuse a file whose torque and acceleration are no pair: one wrong unit among several would bend them all."""
    expected = _total(base.values)
    for record, mine in zip(records, parts, strict=True):
        torque = float(np.mean(_torques(mine, base.values)))
        implied = torque / float(np.mean(np.abs(np.concatenate([a.acceleration for a in mine]))))
        # Friction only adds to the torque, and most of all where a spin-up hardly overcomes it.
        if not 1.0 / _SCALE < implied / expected < 10.0 * _SCALE:
            raise record.fail(
                f"torque and acceleration do not belong together: motor.torque_constant times motor_current, "
                f"{torque:.3g} N.m, over the acceleration is {implied:.3g} kg.m2, {implied / expected:.2g} times the "
                f"inertia of the base parameters; check the units in the header (motor_current was read as "
                f"{record.written['motor_current']}, motor_angle as {record.written['motor_angle']}, time as "
                f"{record.written['time']})")


def _require(parts: Sequence[motion.Averages], base: ParameterSet) -> None:
    torque = _torques(parts, base.values)
    for direction, word in ((1.0, "positive"), (-1.0, "negative")):
        mine = np.array([np.sign(a.speed[0]) == direction for a in parts])
        if not mine.any():
            raise RecordError(f"no spin-up in the {word} direction: the friction to be taken off differs with "
                              "direction; measure both")
        accelerations = np.concatenate([a.acceleration for a, m in zip(parts, mine, strict=True) if m])
        braking = accelerations.min() < -0.3 * accelerations.max() < 0.0 or accelerations.max() < 0.0
        if torque[mine].max() < SPREAD * torque[mine].min() and not braking:
            raise RecordError(f"the spin-ups in the {word} direction are at one level of torque "
                              f"({', '.join(f'{t:.3g}' for t in torque[mine])} N.m): inertia and friction look alike; "
                              f"spin up at levels at least {SPREAD:g} times apart")


def _fit(parts: Sequence[motion.Averages], groups: Sequence[Sequence[int]], base: ParameterSet) -> Fit:
    whole = motion.joined(parts)
    ends = np.cumsum([len(a.time) for a in parts])[:-1]
    values = {**base.values, "friction.temperature": friction.WARM}

    def residuals(x: Array) -> list[Array]:
        candidate = {**values, **dict(zip(_NAMES, x.tolist(), strict=True))}
        m, left = motion.balance(candidate, whole, friction.WARM)
        return list(np.split(left - motion.resisting(candidate, whole, m, friction.WARM), ends))

    start = np.array([float(values[n]) for n in _NAMES])
    level = float(np.mean(_torques(parts, values)))
    sizes = np.array([start[0], *[1e-2 * level] * 2, *[level] * 14])
    sizes[1:3] /= float(np.abs(whole.speed).max()) / 10.0
    return fit(residuals, start, sizes, groups, motion.OVERLAP)


def _pictures(parts: Sequence[motion.Averages], records: Sequence[Record], groups: Sequence[Sequence[int]], found: Fit,
              values: Mapping[str, Any]) -> list[Picture]:
    fitted = {**values, **dict(zip(_NAMES, found.values.tolist(), strict=True))}
    p = nonlinear.ACTUATOR.namespace({**fitted, "friction.temperature": friction.WARM})

    def balance() -> Any:
        """Torque that is not friction against acceleration: the slope is the inertia."""
        series = []
        for record, members in zip(records, groups, strict=True):
            for i in members:
                a = parts[i]
                m, _ = motion.balance(fitted, a, friction.WARM)
                driving = m.inertia * a.acceleration + found.residuals[i]
                order = np.argsort(a.acceleration)
                series.append(pictures.Series(record.name, a.acceleration, driving, a.acceleration[order],
                                              (m.inertia * a.acceleration)[order], None))
        return pictures.panels([("", series)], "motor acceleration [rad/s²]", "torque less friction [N.m]")

    def residual_series() -> list[tuple[str, Array, Array]]:
        return [(records[g].name, np.degrees(motion.fin_angle(p, parts[i].angle)), found.residuals[i])
                for g, members in enumerate(groups) for i in members]

    return [
        Picture("Torque against acceleration", "Windows of all spin-ups, friction found along taken off; the slope of "
                                               "the lines is the inertia, which varies by the fin's share over "
                                               f"+-{degrees(values['command.limit']):.3g} deg.",
                balance),
        pictures.residuals(residual_series, "fin angle [deg]", "residual torque [N.m]", found),
    ]
