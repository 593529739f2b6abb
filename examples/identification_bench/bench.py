"""Sample records: the experiments of the thesis's chapter 3 on the model, measured by a rig's instruments.

The true values are known: the results of an identification can be compared with them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import degrees, pi, radians, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from emcas_fmu import __version__
from emcas_fmu.actuators.electromechanical import nonlinear
from emcas_fmu.control import sensors
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.physics import friction, kinematics, mechanics
from emcas_fmu.studies.identification.records import Array

from . import rig
from .rig import Log, quantised, run

SPEEDS_RPM = (25, 50, 500, 1000, 1500, 2000)  # speeds in the thesis; the slowest are for Coulomb friction
TEMPERATURES = (24.0, -6.0)  # degC, in the thesis
SPIN_UPS = (2.0, 3.1, 4.9)  # references over the one that overcomes Coulomb friction at fin angle 0
INTERVALS = (1e-5, 2e-5, 5e-5)  # s, possible intervals of the fast logger
BACKLASH = radians(0.06)
END = radians(19.5)  # fin angle at the ends of a sweep
_HALF_WAY = 0.7  # speed at half the travel over the speed at its end, from rest at constant acceleration
_RPM = 2.0 * pi / 60.0  # rad/s in 1 rpm
_SLOW = 200  # rpm; the rows of slower sweeps are averages
_PAUSE = 0.15  # s at rest before and between moves
PROVENANCE = "provenance.toml"

Columns = Mapping[str, tuple[Array, str]]
"""The values of each column and their format, by the column's header."""


def _current(log: Log, rng: np.random.Generator, averaged: int = 1) -> Array:
    true = log.mean_current if averaged > 1 else log.columns["motor_current"]
    noisy = true + rng.normal(0.0, rig.CURRENT_NOISE / averaged**0.5, len(true))
    # An averaging logger has finer steps.
    return quantised(noisy, rig.ADC_BITS + (3 if averaged > 1 else 0), rig.CURRENT_RANGE)


def _counts(values: Mapping[str, Any], angle: Array) -> Array:
    q = float(sensors.resolution(nonlinear.ACTUATOR.namespace(values)))
    return np.floor(angle / q) * q


def _motor_end(values: Mapping[str, Any]) -> tuple[float, float]:
    p = nonlinear.ACTUATOR.namespace(values)
    return (float(kinematics.motor_angle(FLOATS, p, -END)), float(kinematics.motor_angle(FLOATS, p, END)))


def _there_and_back(low: float, high: float, speed: float) -> tuple[Callable[[float], float], float]:
    """Return the motor angle [rad] over time [s] for a sweep up and down at a `speed` [rad/s], and the duration [s]."""
    sweep = (high - low) / speed

    def angle(time: float) -> float:
        up = min(max(time - _PAUSE, 0.0), sweep)
        down = min(max(time - 2.0 * _PAUSE - sweep, 0.0), sweep)
        return low + speed * (up - down)

    return angle, 2.0 * sweep + 3.0 * _PAUSE


def sweep_speeds(values: Mapping[str, Any], speeds: Sequence[float] = SPEEDS_RPM) -> list[float]:
    """Return the speeds [rpm] of the sweeps; the fast ones are reduced by one factor, with which the rig holds them."""
    low, high = _motor_end(values)
    share = min(1.0, rig.fastest_sweep(values, high - low) / (max(speeds) * _RPM))
    return [rpm if rpm < _SLOW else max(round(rpm * share), _SLOW) for rpm in speeds]


def friction_run(values: Mapping[str, Any], rng: np.random.Generator, rpm: float, temperature: float) -> Columns:
    """Return the record of a sweep up and down at constant motor speed."""
    signal, duration = _there_and_back(*_motor_end(values), rpm * _RPM)
    every = 10 if rpm < _SLOW else 1
    log = run({**values, "friction.temperature": temperature}, signal, duration, 1e-3, log_every=every, start=-END)
    room = temperature + rng.normal(0.0, 0.1, len(log.time))
    return {"time [s]": (log.time, "%.3f"),
            "motor_angle [rad]": (_counts(values, log.columns["motor_angle"]), "%.4f"),
            "motor_current [A]": (_current(log, rng, every), "%.4f"),
            "temperature [degC]": (np.round(room, 1), "%.1f")}


def inertia_run(values: Mapping[str, Any], rng: np.random.Generator, volts: float) -> Columns:
    """Return the record of a spin-up by a step of the reference, until the fin is near the end of its range."""
    side = 1.0 if volts > 0.0 else -1.0
    log = run(values, lambda t: volts if t >= 0.02 else 0.0, 1.5, 5e-4, start=-side * END, open_loop=True)
    past = side * log.columns["fin_angle"] > END
    stop = int(np.argmax(past)) if past.any() else len(past)
    return {"time [ms]": (log.time[:stop] * 1e3, "%.1f"),
            "motor_angle [deg]": (np.degrees(_counts(values, log.columns["motor_angle"][:stop])), "%.3f"),
            "motor_current [A]": (_current(log, rng)[:stop], "%.3f")}


def spin_up_volts(values: Mapping[str, Any]) -> list[float]:
    """Return the references [V] of the spin-ups, rounded to hundredths.

    They compensate the current that the back-EMF takes at half the travel.
    """
    p = nonlinear.ACTUATOR.namespace(values)
    low, high = _motor_end(values)
    level = max(float(friction.coulomb(FLOATS, p, side, 0.0)) for side in (1.0, -1.0))
    inertia = float(mechanics.coefficients(FLOATS, p, 0.5 * (low + high)).inertia)
    volts = []
    for share in SPIN_UPS:
        speed = sqrt((share - 1.0) * level / inertia * (high - low)) * _HALF_WAY
        current = share * level / p.motor.torque_constant
        demand = current + (p.motor.resistance * current + p.motor.back_emf_constant * speed) / p.drive.kp
        volts.append(round(min(demand / p.drive.current_gain, p.drive.reference_limit), 2))
    return volts


def _reference(log: Log, rng: np.random.Generator) -> Array:
    noisy = log.reference + rng.normal(0.0, rig.REFERENCE_NOISE, len(log.reference))
    return quantised(noisy, rig.ADC_BITS + 2, rig.REFERENCE_RANGE)


def drive_fast(values: Mapping[str, Any], rng: np.random.Generator) -> Columns:
    """Return a fast record of small random steps on a clamped rotor, for delay and proportional gain."""
    p = nonlinear.ACTUATOR.namespace(values)
    # The steps use two thirds of the supply; the logger's interval resolves delay and rise.
    reach = round(min(0.63 * p.drive.supply_voltage / (2.0 * p.drive.kp), 10.0) / p.drive.current_gain, 2)
    rise = p.motor.inductance / (p.motor.resistance + p.drive.kp)
    interval = max((t for t in INTERVALS if t <= min(rise, p.drive.transport_delay / 15.0)), default=min(INTERVALS))
    levels = rng.uniform(-reach, reach, 40)
    log = run(values, lambda t: float(levels[int(t / 4e-3) % 40]) if t >= 8e-3 else 0.0, 0.12, interval,
              open_loop=True, clamped=True)
    return {"time [ms]": (log.time * 1e3, "%.2f"), "drive_reference [V]": (_reference(log, rng), "%.4f"),
            "motor_current [A]": (_current(log, rng), "%.3f")}


def drive_slow(values: Mapping[str, Any], rng: np.random.Generator) -> Columns:
    """Return a slow record of a staircase over half the drive's current on a clamped rotor, for gains and offset."""
    step = round(min(0.55 * values["drive.current_limit"] / values["drive.current_gain"],
                     0.9 * values["drive.reference_limit"]) / 4.0, 2)
    levels = tuple(step * k for k in (0.0, 2.0, 4.0, 0.0, -4.0, -2.0, 1.0, 3.0, -3.0, -1.0))
    log = run(values, lambda t: levels[int(t / 6.0) % 10], 60.0, 1e-2, log_every=2, sample_time=1e-2, open_loop=True,
              clamped=True)
    return {"time [s]": (log.time, "%.2f"), "drive_reference [V]": (_reference(log, rng), "%.4f"),
            "motor_current [A]": (_current(log, rng, 20), "%.4f")}


def play(angle: Array, width: float) -> Array:
    """Return the angle [rad] of the driven side of a gap; it rests until the driving side has crossed the gap.

    `angle` is the angle of the driving side, `width` that of the gap [rad].
    """
    driven = np.empty_like(angle)
    at = angle[0]
    for i, a in enumerate(angle):
        at = min(max(at, a - 0.5 * width), a + 0.5 * width)
        driven[i] = at
    return driven


def backlash_run(values: Mapping[str, Any], rng: np.random.Generator, width: float = BACKLASH) -> Columns:
    """Return a record of slow sweeps with encoders on motor and fin; the gap is added to the rigid model's angles."""
    signal, duration = _there_and_back(*_motor_end(values), 100 * _RPM)
    log = run(values, lambda t: signal(t % duration), 2.0 * duration, 1e-3, log_every=5, start=-END)
    direct = play(log.columns["fin_angle"], width) + radians(rng.normal(0.0, 0.02))
    return {"time [s]": (log.time, "%.3f"),
            "motor_angle [rad]": (_counts(values, log.columns["motor_angle"]), "%.4f"),
            "fin_angle [deg]": (np.degrees(_counts(values, direct + rng.normal(0.0, 1e-5, len(direct)))), "%.4f")}


def data_sets(values: Mapping[str, Any], seed: int, *, speeds: Sequence[float] = SPEEDS_RPM,
              temperatures: Sequence[float] = TEMPERATURES, backlash: float = BACKLASH,
              kinds: Sequence[str] = ("friction", "drive", "inertia", "backlash")) -> Iterator[tuple[str, Columns]]:
    """Yield name and columns of each record; the noise of a record does not depend on the other records."""
    def rng(*key: int) -> np.random.Generator:
        return np.random.default_rng([seed, *key])

    if "friction" in kinds:
        for i, temperature in enumerate(temperatures):
            for j, rpm in enumerate(sweep_speeds(values, speeds)):
                name = f"friction_{rpm:04.0f}rpm_{'minus' if temperature < 0 else ''}{abs(temperature):.0f}degC"
                yield name, friction_run(values, rng(0, i, j), rpm, temperature)
    if "drive" in kinds:
        yield "drive_fast", drive_fast(values, rng(1, 0))
        yield "drive_slow", drive_slow(values, rng(1, 1))
    if "inertia" in kinds:
        for i, volts in enumerate(spin_up_volts(values)):
            for j, side in enumerate((1.0, -1.0)):
                name = f"inertia_{'plus' if side > 0 else 'minus'}_{volts * 1e3:04.0f}mV"
                yield name, inertia_run(values, rng(2, i, j), side * volts)
    if "backlash" in kinds:
        yield "backlash", backlash_run(values, rng(3), backlash)


def write_record(path: Path, columns: Columns) -> None:
    """Write a record as a CSV file."""
    table = np.column_stack([values for values, _ in columns.values()])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        np.savetxt(file, table, fmt=[form for _, form in columns.values()], delimiter=",", header=",".join(columns),
                   comments="")


def write_bench(directory: Path, parameters: ParameterSet, seed: int) -> list[Path]:
    """Write every record and the provenance into `directory`; return the paths of the records."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, columns in data_sets(parameters.values, seed):
        paths.append(directory / f"{name}.csv")
        write_record(paths[-1], columns)
    (directory / PROVENANCE).write_text(_provenance(parameters, seed, paths), encoding="utf-8", newline="\n")
    return paths


TRUTHS = ("drive.current_gain", "drive.current_offset", "drive.transport_delay", "drive.kp", "drive.ki",
          "inertia.motor", "friction.viscous.positive", "friction.viscous.negative",
          *(f"friction.coulomb.{d}[{n}]" for d in ("positive", "negative") for n in range(7)),
          "friction.table.viscous[1]", "friction.table.coulomb[1]")


def _provenance(parameters: ParameterSet, seed: int, paths: Sequence[Path]) -> str:
    default = load_parameters().values
    changed = {n: x for n, x in parameters.values.items() if x != default[n]}
    option = " --parameters FILE" if changed else ""
    lines = ["# How the records were made, and the values that an identification should return, SI.",
             f'command = "python examples/identification_bench/make.py --seed {seed}{option}"', f"seed = {seed}",
             f'emcas_version = "{__version__}"',
             f"current_noise_a = {rig.CURRENT_NOISE}", f"reference_noise_v = {rig.REFERENCE_NOISE}",
             f"adc_bits = {rig.ADC_BITS}", f"dac_bits = {rig.DAC_BITS}",
             f"backlash_deg = {degrees(BACKLASH):.6g}", "", "[truth]"]
    lines += [f"{json.dumps(name)} = {float(parameters.values[name])!r}" for name in TRUTHS]
    if changed:  # the contents of FILE
        lines += ["", "[parameters]", *(f"{json.dumps(n)} = {json.dumps(x)}" for n, x in changed.items())]
    lines += ["", "[sha256]"]
    lines += [f'"{path.name}" = "{hashlib.sha256(path.read_bytes()).hexdigest()}"' for path in paths]
    return "\n".join([*lines, ""])
