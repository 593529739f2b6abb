"""Identify the total inertia at the motor from spin-ups, and the rotor's share, (2.8)-(2.17).

Steps of current accelerate the motor from rest, at several levels and in both directions. In windows of the motion,
K_t i equals inertia times acceleration plus friction. Friction is fitted together with the inertia: a viscous
coefficient and a sixth-order Coulomb polynomial for each direction. The different levels separate inertia from
friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators.electromechanical import nonlinear
from ...ops.floats import FLOATS
from ...parameters import ParameterSet
from ...physics import kinematics, mechanics
from ...plotting.plots import Drawing
from . import motion, pictures
from .estimation import Fit
from .friction import COULOMB, VISCOUS
from .records import DIRECTIONS, Array, RecordFile, divided, read_records, require, sequences
from .result import Estimate, Identification, IdentificationExperiment, estimates, require_certain

EXPERIMENT = IdentificationExperiment(
    "inertia", "Inertia", ("motor_angle", "motor_current"), ("motor_speed",),
    ("motor.torque_constant", "inertia.screw", "inertia.fin", "inertia.shaft", "inertia.fork", "mass.nut",
     "kinematics.moment_arm", "kinematics.initial_angle", "screw.lead"), "N.m")
TOTAL = "total inertia at the motor"  # at fin angle 0
MOTOR = "inertia.motor"
SPREAD = 1.5  # smallest ratio of highest to lowest torque in one direction
_NAMES = (MOTOR, *VISCOUS, *COULOMB["positive"], *COULOMB["negative"])
_WORST = 0.1  # largest relative 1 sigma of the total inertia in a result
_SCALE = 40.0  # largest plausible ratio of the base set's inertia to that of a file; for the inverse, ten times this
_SLOWEST = 0.02  # share of the largest speed below which a window may contain standstill


def identify(paths: Sequence[Path], base: ParameterSet) -> Identification:
    """Identify inertia.motor and the total inertia from spin-ups. Raises RecordError."""
    records = read_records(paths, EXPERIMENT.required, EXPERIMENT.optional)
    parts, owners = divided(records, lambda record: _moving(record, base.values))
    _require(parts, base)
    start, torque = np.array([float(base.values[n]) for n in _NAMES]), _torques(parts, base.values)
    level, fastest = float(np.mean(torque)), max(float(np.abs(a.speed).max()) for a in parts)
    scale = np.array([start[0], *[1e-2 * level / (fastest / 10.0)] * 2, *[level] * 14])
    fit = motion.fit_motion(base.values, _NAMES, parts, [motion.WARM] * len(parts), start, scale, owners)
    rotor = estimates(fit, base)[0]
    assert rotor.base is not None
    total = _total({**base.values, MOTOR: rotor.value})
    whole = Estimate(TOTAL, total, rotor.sigma, rotor.unit, _total(base.values), parameter=False)
    require_certain([whole], _WORST, "use more different levels of current, to separate inertia from friction")
    require(rotor.value > 0.0, f"the total inertia at the motor is estimated as {total:.4g} kg.m2, but screw, nut and "
            f"fin side of the base parameters alone have {total - rotor.value:.4g}: check inertia.fin, .fork, .shaft "
            "and .screw, mass.nut and the unit of motor_current")
    require(1.0 / 30.0 < rotor.value / rotor.base < 30.0, f"inertia.motor is estimated as {rotor.value:.4g} kg.m2, "
            f"{rotor.value / rotor.base:.3g} times that of the base parameters: check the units of motor_current, "
            "motor_angle and time in the headers")
    notes = [
        f"{len(parts)} stretches of motion; torques from {torque.min():.3g} to {torque.max():.3g} N.m.",
        f"Estimated friction, positive and negative direction: Coulomb {fit.values[3]:.3g} and "
        f"{fit.values[10]:.3g} N.m at fin angle 0, viscous {fit.values[1]:.3g} and {fit.values[2]:.3g} N.m.s/rad.",
        "The total applies at fin angle 0. It scales with motor.torque_constant; inertia.motor is the total minus the "
        "inertias of screw, nut and fin side in the parameter set. Their uncertainties are not included.",
    ]
    return Identification(EXPERIMENT, records, base, fit, [rotor, whole], notes,
                          lambda: _drawings(parts, records, fit, base.values))


def _total(values: Mapping[str, Any]) -> float:
    """Return the inertia [kg.m2] at the motor at fin angle 0."""
    p = nonlinear.ACTUATOR.namespace(values)
    angle = float(kinematics.motor_angle(FLOATS, p, 0.0))
    return float(mechanics.coefficients(FLOATS, p, angle).inertia)


def _moving(record: RecordFile, values: Mapping[str, Any]) -> list[motion.Averages]:
    """Return the stretches of a record in which the motor slides in one direction. Raises RecordError."""
    motion.check(record, values)
    speed = np.abs(np.diff(record["motor_angle"])) / record.step
    count = max(int(np.sum(speed > 0.05 * speed.max())), 1)
    width = int(np.clip(count / 12, 8, 64))
    a = motion.averages(record, width, max(width // 2, 1))
    sliding = a.slowest > _SLOWEST * np.abs(a.speed).max()
    stretches = [a.at(slice(begin, end)) for begin, end in sequences(sliding) if end - begin >= 4]
    record.require(stretches, f"no motion is long enough to show an acceleration: fewer than 4 windows of {width} "
                   "samples; log at a higher rate, or accelerate with less current")
    # A wrong unit in one file would distort the fit of all files.
    expected, torque = _total(values), float(np.mean(_torques(stretches, values)))
    implied = torque / float(np.mean(np.abs(np.concatenate([a.acceleration for a in stretches]))))
    # The torque includes friction, which is most of it in a spin-up that hardly overcomes friction.
    record.require(1.0 / _SCALE < implied / expected < 10.0 * _SCALE, "torque and acceleration do not fit together: "
                   f"motor.torque_constant times motor_current, {torque:.3g} N.m, over the acceleration is "
                   f"{implied:.3g} kg.m2, {implied / expected:.2g} times the inertia of the base parameters; check the "
                   f"units in the header (motor_current was read as {record.units['motor_current']}, motor_angle as "
                   f"{record.units['motor_angle']}, time as {record.units['time']})")
    return stretches


def _torques(parts: Sequence[motion.Averages], values: Mapping[str, Any]) -> Array:
    """Return the mean motor torque [N.m] of each stretch."""
    return np.array([np.mean(np.abs(a.current)) for a in parts]) * float(values["motor.torque_constant"])


def _require(parts: Sequence[motion.Averages], base: ParameterSet) -> None:
    """Raise RecordError for spin-ups in one direction only, or at one torque in a direction without braking."""
    for direction, word in DIRECTIONS:
        stretches = [a for a in parts if np.sign(a.speed[0]) == direction]
        require(stretches, f"there is no spin-up in the {word} direction: the friction to subtract differs with "
                "direction; measure both")
        torque = _torques(stretches, base.values)
        accelerations = np.concatenate([a.acceleration for a in stretches])
        braking = accelerations.min() < -0.3 * accelerations.max() < 0.0 or accelerations.max() < 0.0
        require(torque.max() >= SPREAD * torque.min() or braking, f"the spin-ups in the {word} direction are at one "
                f"level of torque ({', '.join(f'{t:.3g}' for t in torque)} N.m): inertia and friction cannot be "
                f"separated; use levels with a ratio of at least {SPREAD:g}")


def _drawings(parts: Sequence[motion.Averages], records: Sequence[RecordFile], fit: Fit,
              values: Mapping[str, Any]) -> Iterator[Drawing]:
    p = motion.namespace({**values, **dict(zip(_NAMES, fit.values.tolist(), strict=True))}, motion.WARM)
    names = [records[owner].name for owner in fit.owners]
    series = []
    for name, a, residuals in zip(names, parts, fit.residuals, strict=True):
        inertial = motion.balance(p, a)[0].inertia * a.acceleration
        order = np.argsort(a.acceleration)
        series.append(pictures.Series(name, a.acceleration, inertial + residuals, a.acceleration[order],
                                      inertial[order]))
    yield pictures.panels(
        "Torque against acceleration", [("", series)], "motor acceleration [rad/s²]", "torque minus friction [N.m]",
        "Windows of all spin-ups minus the estimated friction. The slope of the lines is the inertia; the fin's share "
        f"varies over +-{degrees(values['command.limit']):.3g} deg.")
    yield pictures.residuals([(name, np.degrees(motion.fin_angle(p, a.angle))) for name, a in zip(names, parts)], fit,
                             "fin angle [deg]", "residual torque [N.m]")
