"""Sample data sets: the experiments of chapter 3 on the model, through a rig's instruments.

The true values are known, so that an identification can be compared with them.
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

SPEEDS_RPM = (25, 50, 500, 1000, 1500, 2000)  # those of the thesis, the slowest for Coulomb friction
TEMPERATURES = (24.0, -6.0)  # degC, those of the thesis
SPIN_UPS = (2.0, 3.1, 4.9)  # times the reference that overcomes Coulomb friction at fin angle 0, known by trial
INTERVALS = (1e-5, 2e-5, 5e-5)  # s, of the fast logger
BACKLASH = radians(0.06)
END = radians(19.5)
_HALF_WAY = 0.7  # speed after half the time over that at half the travel, from rest at constant acceleration
_RPM = 2.0 * pi / 60.0
_SLOW = 200  # rpm: slower sweeps are logged as averages
_PAUSE = 0.15  # s at rest before and between moves
PROVENANCE = "provenance.toml"

Columns = Mapping[str, tuple[Array, str]]
"""Values and their format by header."""


def _current(log: Log, rng: np.random.Generator, averaged: int = 1) -> Array:
    true = log.mean_current if averaged > 1 else log.columns["motor_current"]
    noisy = true + rng.normal(0.0, rig.CURRENT_NOISE / averaged**0.5, len(true))
    # The mean of an averaging logger has finer steps.
    return quantised(noisy, rig.ADC_BITS + (3 if averaged > 1 else 0), rig.CURRENT_RANGE)


def _counts(values: Mapping[str, Any], angle: Array) -> Array:
    q = float(sensors.resolution(nonlinear.ACTUATOR.namespace(values)))
    return np.floor(angle / q) * q


def _motor_end(values: Mapping[str, Any]) -> tuple[float, float]:
    p = nonlinear.ACTUATOR.namespace(values)
    return (float(kinematics.motor_angle(FLOATS, p, -END)), float(kinematics.motor_angle(FLOATS, p, END)))


def _there_and_back(low: float, high: float, speed: float) -> tuple[Callable[[float], float], float]:
    """Return the motor angle over time for a sweep up and one down, and its duration."""
    sweep = (high - low) / speed

    def angle(time: float) -> float:
        up = min(max(time - _PAUSE, 0.0), sweep)
        down = min(max(time - 2.0 * _PAUSE - sweep, 0.0), sweep)
        return low + speed * (up - down)

    return angle, 2.0 * sweep + 3.0 * _PAUSE


def sweep_speeds(values: Mapping[str, Any], speeds: Sequence[float] = SPEEDS_RPM) -> list[float]:
    """Return the speeds [rpm] of the sweeps, the fast ones reduced in one ratio to those that the rig can hold."""
    low, high = _motor_end(values)
    share = min(1.0, rig.fastest_sweep(values, high - low) / (max(speeds) * _RPM))
    return [rpm if rpm < _SLOW else max(round(rpm * share), _SLOW) for rpm in speeds]


def friction_run(values: Mapping[str, Any], rng: np.random.Generator, rpm: float, temperature: float) -> Columns:
    """A sweep up and one down at constant motor speed."""
    signal, duration = _there_and_back(*_motor_end(values), rpm * _RPM)
    every = 10 if rpm < _SLOW else 1
    log = run({**values, "friction.temperature": temperature}, signal, duration, 1e-3, log_every=every, start=-END)
    room = temperature + rng.normal(0.0, 0.1, len(log.time))
    return {"time [s]": (log.time, "%.3f"),
            "motor_angle [rad]": (_counts(values, log.columns["motor_angle"]), "%.4f"),
            "motor_current [A]": (_current(log, rng, every), "%.4f"),
            "temperature [degC]": (np.round(room, 1), "%.1f")}


def inertia_run(values: Mapping[str, Any], rng: np.random.Generator, volts: float) -> Columns:
    """A spin-up by a step of the current demanded, until the fin nears the end of its range."""
    side = 1.0 if volts > 0.0 else -1.0
    log = run(values, lambda t: volts if t >= 0.02 else 0.0, 1.5, 5e-4, start=-side * END, open_loop=True)
    past = side * log.columns["fin_angle"] > END
    stop = int(np.argmax(past)) if past.any() else len(past)
    return {"time [ms]": (log.time[:stop] * 1e3, "%.1f"),
            "motor_angle [deg]": (np.degrees(_counts(values, log.columns["motor_angle"][:stop])), "%.3f"),
            "motor_current [A]": (_current(log, rng)[:stop], "%.3f")}


def spin_up_volts(values: Mapping[str, Any]) -> list[float]:
    """References [V] of the spin-ups, in hundredths.

    They compensate the reduction of the current by the back-EMF half way through the travel.
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
    """Small random steps on a clamped rotor, fast logged: delay and proportional gain."""
    p = nonlinear.ACTUATOR.namespace(values)
    # Steps that use two thirds of the supply, and a logger that resolves delay and rise, which a trial would show.
    reach = round(min(0.63 * p.drive.supply_voltage / (2.0 * p.drive.kp), 10.0) / p.drive.current_gain, 2)
    rise = p.motor.inductance / (p.motor.resistance + p.drive.kp)
    interval = max((t for t in INTERVALS if t <= min(rise, p.drive.transport_delay / 15.0)), default=min(INTERVALS))
    levels = rng.uniform(-reach, reach, 40)
    log = run(values, lambda t: float(levels[int(t / 4e-3) % 40]) if t >= 8e-3 else 0.0, 0.12, interval,
              open_loop=True, clamped=True)
    return {"time [ms]": (log.time * 1e3, "%.2f"), "drive_reference [V]": (_reference(log, rng), "%.4f"),
            "motor_current [A]": (_current(log, rng), "%.3f")}


def drive_slow(values: Mapping[str, Any], rng: np.random.Generator) -> Columns:
    """A staircase over half the drive's current on a clamped rotor, slowly logged: gain, offset, integral gain."""
    step = round(min(0.55 * values["drive.current_limit"] / values["drive.current_gain"],
                     0.9 * values["drive.reference_limit"]) / 4.0, 2)
    levels = tuple(step * k for k in (0.0, 2.0, 4.0, 0.0, -4.0, -2.0, 1.0, 3.0, -3.0, -1.0))
    log = run(values, lambda t: levels[int(t / 6.0) % 10], 60.0, 1e-2, log_every=2, sample_time=1e-2, open_loop=True,
              clamped=True)
    return {"time [s]": (log.time, "%.2f"), "drive_reference [V]": (_reference(log, rng), "%.4f"),
            "motor_current [A]": (_current(log, rng, 20), "%.4f")}


def play(angle: Array, width: float) -> Array:
    """Return the driven side of a gap of this width [rad]: it rests until the driving side has crossed the gap."""
    driven = np.empty_like(angle)
    at = angle[0]
    for i, a in enumerate(angle):
        at = min(max(at, a - 0.5 * width), a + 0.5 * width)
        driven[i] = at
    return driven


def backlash_run(values: Mapping[str, Any], rng: np.random.Generator, width: float = BACKLASH) -> Columns:
    """Slow sweeps with encoders on motor and fin. The model's drive line is rigid: the gap is added afterwards."""
    signal, duration = _there_and_back(*_motor_end(values), 100 * _RPM)
    log = run(values, lambda t: signal(t % duration), 2.0 * duration, 1e-3, log_every=5, start=-END)
    direct = play(log.columns["fin_angle"], width) + radians(rng.normal(0.0, 0.02))
    return {"time [s]": (log.time, "%.3f"),
            "motor_angle [rad]": (_counts(values, log.columns["motor_angle"]), "%.4f"),
            "fin_angle [deg]": (np.degrees(_counts(values, direct + rng.normal(0.0, 1e-5, len(direct)))), "%.4f")}


def data_sets(values: Mapping[str, Any], seed: int, *, speeds: Sequence[float] = SPEEDS_RPM,
              temperatures: Sequence[float] = TEMPERATURES, backlash: float = BACKLASH,
              kinds: Sequence[str] = ("friction", "drive", "inertia", "backlash")) -> Iterator[tuple[str, Columns]]:
    """Yield name and columns of every record. The noise of a record does not depend on the other records."""
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
    """One CSV file."""
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
    given = " --parameters FILE" if changed else ""
    lines = ["# How the records were made, and the values an identification ought to find, SI.",
             f'command = "python examples/identification_bench/make.py --seed {seed}{given}"', f"seed = {seed}",
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
