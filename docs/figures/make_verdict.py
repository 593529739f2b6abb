"""The tables of docs/tools/verdict.md: wrong actuators that the verdict finds, and sound ones that it passes.

    python docs/figures/make_verdict.py           # writes the tables
    python docs/figures/make_verdict.py --check   # exit code 1 where one is stale

Each wrong actuator is a change of parameters, a deviation of the unit as built, a fault, or a wrong line of a
controller, with the rows of models/requirements.toml that name its cause: it is found where one of them fails. The
sound ones are drawn within tolerances.
"""

from __future__ import annotations

import sys
from atexit import register
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from math import radians
from pathlib import Path
from shutil import copy, rmtree
from tempfile import mkdtemp
from typing import Any, NamedTuple

import numpy as np
from make_tables import main, markdown

from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import Judged, evaluate, judged
from emcas_fmu.files import models_directory
from emcas_fmu.parameters import ParameterSet, load_parameters

UNWOUND = "unwound.py"  # beside this script
SAMPLES, SEED = 50, 1
_DEFAULT = load_parameters().values


class Defect(NamedTuple):
    """A wrong actuator: what is wrong, what differs (of a `model` with parameter `files`), and rows that name it."""

    what: str
    changes: Mapping[str, Any]
    causes: tuple[str, ...]
    model: str = "nonlinear"
    files: tuple[str, ...] = ()


def _times(factor: float, *names: str) -> dict[str, float]:
    return {name: factor * float(_DEFAULT[name]) for name in names}


def _coulomb(factor: float) -> dict[str, float]:
    return _times(factor, *(f"friction.coulomb.positive[{k}]" for k in range(7)))


DEFECTS: Mapping[str, Sequence[Defect]] = {
    "nonlinear": (
        Defect("position gain 190 1/s", {"controller.position.kp": 190.0}, ("rest", "phase_margin", "gain_margin")),
        Defect("position gain 120 1/s", {"controller.position.kp": 120.0}, ("phase_margin", "gain_margin")),
        Defect("integral gain 2000 1/s²", {"controller.position.ki": 2000.0}, ("overshoot",)),
        Defect("velocity gain × 2.2", _times(2.2, "controller.velocity.kp"), ("gain_margin",)),
        Defect("4 ms more delay in the drive", {"drive.transport_delay": 7.7e-3}, ("phase_margin", "lag")),
        Defect("drive with 9 ms of delay", {"drive.transport_delay": 9e-3}, ("rest", "phase_margin")),
        Defect("controllers sampled every 6 ms", {"controller.sample_time": 6e-3}, ("rest", "phase_margin")),
        Defect("no anti-windup", {"controller.antiwindup": 0.0, "controller.drive_antiwindup": 0.0},
               ("slew_overshoot", "overload_rebound")),
        Defect("no anti-windup at the speed limit", {"controller.antiwindup": 0.0}, ("slew_overshoot",)),
        Defect("no anti-windup at the drive's limit", {"controller.drive_antiwindup": 0.0}, ("overload_rebound",)),
        Defect("velocity integral unwound though its gain is 0 (controller line)", {}, ("repeatable",), UNWOUND),
        Defect("supply of 24 V", {"drive.supply_voltage": 24.0}, ("unloaded_rate", "loaded_rate")),
        Defect("torque constant −20 % as built", {"deviation.motor.torque_constant": -0.2}, ("rated_current",)),
        Defect("motor demagnetised by 40 %", {"deviation.motor.torque_constant": -0.4},
               ("rated_current", "torque_reserve")),
        Defect("friction × 3 as built", {"deviation.friction.coulomb": 2.0, "deviation.friction.viscous": 2.0},
               ("bandwidth_1deg", "loaded_rate")),
        Defect("friction compensated twice", {"compensation.gain": 2.0}, ("small_overshoot",)),
        Defect("0.3° of backlash", {"drive_line.backlash": radians(0.3) * 0.05}, ("small_step", "rest_small",
                                                                                  "small_overshoot"), "elastic"),
        Defect("lever arm +2 % as built", {"deviation.kinematics.moment_arm": 0.02}, ("accuracy_20deg",)),
        Defect("assembly angle +2° as built", {"deviation.kinematics.initial_angle": radians(2.0)},
               ("accuracy_20deg",)),
        Defect("stop at 18°", {"fin.stop_angle": radians(18.0), "command.limit": radians(17.9)}, ("range",)),
        Defect("command 10 ms late", {"command.latency": 10e-3}, ("lag",)),
        Defect("command rounded to 0.5°", {"command.resolution": radians(0.5)}, ("small_step",)),
        Defect("speed limit 200 rad/s", {"controller.speed_limit": 200.0}, ("unloaded_rate",)),
        Defect("drive of 30 A", {"drive.current_limit": 30.0}, ("torque_reserve",)),
        Defect("current offset 0.5 A without an integral", {
            "drive.current_offset": 0.5, "controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0},
            ("accuracy_loaded", "load_recovery")),
        Defect("encoder of 64 pulses", {"encoder.pulses": 64}, ("rest_current_small",)),
        Defect("rotor inertia −25 %", _times(0.75, "inertia.motor"), ("gain_margin", "phase_margin")),
        Defect("hinge stiffness / 10", _times(1.0), ("load_step", "accuracy_loaded"), "elastic", ("hinge-stiffness",)),
        Defect("load observer of 600 1/s", {"controller.load_observer": 600.0}, ("gain_margin",)),
        Defect("I²t limit reached after 10 s of 100 N·m", {"heat.continuous_current": 8.0, "heat.peak_time": 0.4},
               ("endurance",), "nonlinear+heat"),
        Defect("viscous friction × 10 in one direction", _times(10.0, "friction.viscous.positive"), ("symmetry",)),
        Defect("drive line jammed", {"fault.jam.active": True}, ("range", "accuracy_20deg"), "nonlinear+faults"),
        Defect("shaft broken", {"fault.free_fin.active": True}, ("load_step", "range"), "nonlinear+faults"),
        Defect("encoder misses 2 % of the counts", {"fault.encoder_dropped.active": True},
               ("accuracy_20deg", "repeatable"), "nonlinear+faults"),
        Defect("encoder reads 1° too much", {"fault.encoder_bias.active": True}, ("accuracy_1deg",),
               "nonlinear+faults"),
        Defect("bus 20 ms late", {"fault.command_delay.active": True}, ("lag",), "nonlinear+faults"),
        Defect("drive derated to 15 %", {"fault.current_derating.active": True}, ("torque_reserve", "endurance"),
               "nonlinear+faults"),
    ),
    "worm-gear": (
        Defect("position gain × 2.5", {"controller.position.kp": 141.0}, ("phase_margin", "gain_margin"), "worm-gear"),
        Defect("supply of 24 V", {"drive.supply_voltage": 24.0}, ("unloaded_rate",), "worm-gear"),
        Defect("flanks without oil", {"fault.dry_flanks.active": True}, ("loaded_rate",), "worm-gear+faults"),
        Defect("0.3° of backlash", {"drive_line.backlash": radians(0.3)}, ("small_step", "accuracy_loaded"),
               "worm-gear-elastic"),
    ),
    "clutch": (
        Defect("open clutch that drags", {"fault.drag.active": True}, ("loaded_rate", "torque_reserve"),
               "clutch+faults"),
        Defect("half the powder lost", {"fault.powder_loss.active": True}, ("torque_reserve", "loaded_rate"),
               "clutch+faults"),
        Defect("position gain × 2.5", {"controller.position.kp": 2.5}, ("phase_margin", "gain_margin"), "clutch"),
    ),
    "electrohydrostatic": (
        Defect("oil that air makes five times as soft", {"fault.air.active": True}, ("load_step",),
               "electrohydrostatic+faults"),
        Defect("pump that leaks ten times as much", {"fault.leakage.active": True}, ("load_step", "torque_reserve"),
               "electrohydrostatic+faults"),
        Defect("relief valve at a fifth", {"fault.relief_open.active": True}, ("torque_reserve",),
               "electrohydrostatic+faults"),
    ),
    "electrohydraulic": (
        Defect("oil that air makes seven times as soft", {"fault.air.active": True, "fault.air.share": 0.14},
               ("load_step",), "electrohydraulic+faults"),
        Defect("supply at half its pressure", {"fault.brown_out.active": True}, ("loaded_rate",),
               "electrohydraulic+faults"),
        Defect("silted valve, its null shifted", {"fault.silting.active": True}, ("symmetry",),
               "electrohydraulic+faults"),
    ),
}
# Of sound units, uniform: of the unit as built over what its controllers know, and of parameters, as a share.
_BUILT = {"deviation.kinematics.moment_arm": 0.002, "deviation.kinematics.initial_angle": radians(0.25),
          "deviation.screw.lead": 1e-4, "deviation.motor.torque_constant": 0.05, "deviation.friction.coulomb": 0.3,
          "deviation.friction.viscous": 0.3, "deviation.mass.fin": 0.1}
_SHARES = {"motor.resistance": 0.1, "motor.inductance": 0.2, "inertia.motor": 0.05, "drive.transport_delay": 0.03,
           "drive.current_limit": 0.02, "drive.supply_voltage": 0.03}
_TEMPERATURE = 10.0, 50.0  # degC


@cache
def _model(name: str) -> str:
    """Return an actuator's name; of a file here that of a copy with the shipped parameters beside it."""
    if not name.endswith(".py"):
        return name
    folder = Path(mkdtemp(prefix="emcas-wrong-"))
    register(rmtree, folder, ignore_errors=True)
    copy(models_directory() / "emcas.toml", (folder / name).with_suffix(".toml"))
    return str(copy(Path(__file__).with_name(name), folder / name))


def parameters_of(defect: Defect) -> ParameterSet:
    """Return the parameters of a wrong actuator."""
    base = load_parameters(list(defect.files), model=_model(defect.model))
    changes = dict(defect.changes)
    if "hinge-stiffness" in defect.files:
        changes = {name: 0.1 * float(base.values[name]) for name in (
            "drive_line.fork_stiffness", "drive_line.shaft_stiffness", "drive_line.structure_stiffness")}
    if defect.model == "clutch" and "controller.position.kp" in changes:
        changes["controller.position.kp"] *= float(base.values["controller.position.kp"])
    return base.with_values(changes)


@cache
def failing(defect_of: str, number: int) -> tuple[str, ...]:
    """Return the rows that a wrong actuator fails, by its place in DEFECTS."""
    parameters = parameters_of(DEFECTS[defect_of][number])
    return tuple(j.name for j in _judged(parameters, [{}])[0] if not j.passed and not j.skipped)


def _judged(parameters: ParameterSet, changes: Sequence[Mapping[str, Any]]) -> list[list[Judged]]:
    """Return the requirements judged of each of several units that differ from a set by `changes`."""
    subject, specification = ParameterSubject(parameters), load_requirements(None, parameters)
    units = evaluate(subject, specification, changes)
    return [[judged(r, [f for f in figures if f.requirement.name == r.name], subject)
             for r in specification.requirements] for figures in units]


def sound(model: str) -> Iterator[dict[str, float]]:
    """Yield the changes of sound units, drawn within tolerances."""
    values, draw = load_parameters(model=model).values, np.random.default_rng(SEED)
    for _ in range(SAMPLES):
        changes = {name: float(draw.uniform(-most, most)) for name, most in _BUILT.items() if name in values}
        changes |= {name: float(values[name]) * (1.0 + float(draw.uniform(-most, most)))
                    for name, most in _SHARES.items() if name in values}
        if "friction.temperature" in values:
            changes["friction.temperature"] = float(draw.uniform(*_TEMPERATURE))
        yield changes


@cache
def falsely_failing(model: str) -> tuple[tuple[str, ...], ...]:
    """Return the rows that each sound unit fails."""
    units = _judged(load_parameters(model=model), list(sound(model)))
    return tuple(tuple(j.name for j in unit if not j.passed and not j.skipped) for unit in units)


def confusion() -> str:
    """The table of how many wrong actuators are found and how many sound ones are failed."""
    rows = []
    for kind, defects in DEFECTS.items():
        found = sum(bool({*failing(kind, k)} & {*defect.causes}) for k, defect in enumerate(defects))
        failed = sum(map(bool, falsely_failing(kind)))
        rows.append((f"`{kind}`", f"{found} of {len(defects)}", f"{failed} of {SAMPLES}"))
    return markdown(("actuator", "wrong ones found by the row that names the cause", "sound ones failed"), rows)


def defects_of(kind: str) -> str:
    """The table of an actuator's defects: what is wrong, the row that names it, what else fails."""
    rows = []
    for k, defect in enumerate(DEFECTS[kind]):
        failed = failing(kind, k)
        named = [name for name in failed if name in defect.causes]
        others = len(failed) - len(named)
        rows.append((defect.what, ", ".join(f"`{name}`" for name in named) or "**not found**",
                     f"{others} more" if others else ""))
    return markdown(("what is wrong", "found by", "and"), rows)


TABLES: Mapping[str, Mapping[str, Callable[[], str]]] = {"tools/verdict.md": {
    "confusion": confusion, **{f"defects {kind}": partial(defects_of, kind) for kind in DEFECTS}}}

if __name__ == "__main__":
    if "--print" in sys.argv:
        for kind, defects in DEFECTS.items():
            for k, defect in enumerate(defects):
                rows = failing(kind, k)
                mark = "ok " if {*rows} & {*defect.causes} else "NOT"
                print(mark, kind, "|", defect.what, "|", ", ".join(rows), flush=True)
            print(kind, [rows for rows in falsely_failing(kind) if rows], flush=True)
        sys.exit()
    sys.exit(main("--check" in sys.argv, TABLES, "make_verdict.py"))
