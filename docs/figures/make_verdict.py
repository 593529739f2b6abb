"""Tables of docs/tools/verdict.md: wrong actuators that the verdict detects, and sound actuators that pass.

    python docs/figures/make_verdict.py           # writes the tables
    python docs/figures/make_verdict.py --check   # exit code 1 if a table is stale

Each wrong actuator has changed parameters, a deviation as built, a fault, or a wrong line of a controller, and a list
of the requirements that indicate the cause: the actuator is detected if it misses one of these. The sound actuators are
drawn within tolerances.
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

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.bench.requirements import load_requirements
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.bench.verdict import Judged, evaluate, judged
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.support.files import models_directory

UNWOUND = "unwound.py"  # in the folder of this script
SEED = 1


def samples(model: str) -> int:
    """Return the number of sound actuators to draw, fewer for kinds that are slow to simulate."""
    return 50 if model == NONLINEAR else 25


class Defect(NamedTuple):
    """A wrong actuator: description, changed values, requirements that indicate the `causes`, `factors` of values.

    `model` names the actuator if it is not the one of the list, or adds the extension with "+faults". `files` are sets
    over the shipped values. A defect that no requirement detects has no `causes`, and the reason in `why`.
    """

    what: str
    changes: Mapping[str, Any]
    causes: tuple[str, ...]
    model: str = ""
    files: tuple[str, ...] = ()
    factors: Mapping[str, float] = {}
    why: str = ""


def _fault(what: str, name: str, *causes: str, why: str = "", **amounts: float) -> Defect:
    changes = {f"fault.{name}.active": True, **{f"fault.{name}.{amount}": x for amount, x in amounts.items()}}
    return Defect(what, changes, causes, "+faults", why=why)


def _no_integral(*causes: str) -> Defect:
    return Defect("no integral", {"controller.position.ki": 0.0, "controller.position.setpoint_weight": 1.0}, causes)


def _late() -> Defect:
    return Defect("4 ms more delay in the drive", {"drive.transport_delay": 7.7e-3}, ("phase_margin", "gain_margin"))


def _weak_motor(*causes: str, by: int = 20, why: str = "") -> Defect:
    return Defect(f"torque constant −{by} % as built", {"deviation.motor.torque_constant": -by / 100}, causes, why=why)


def _gain(factor: float, *causes: str) -> Defect:
    return Defect(f"position gain × {factor:g}", {}, causes, factors={"controller.position.kp": factor})


DEFECTS: Mapping[str, Sequence[Defect]] = {
    "nonlinear": (
        Defect("position gain 190 1/s", {"controller.position.kp": 190.0}, ("rest", "phase_margin", "gain_margin")),
        Defect("position gain 120 1/s", {"controller.position.kp": 120.0}, ("phase_margin", "gain_margin")),
        Defect("integral gain 2000 1/s²", {"controller.position.ki": 2000.0}, ("overshoot",)),
        Defect("velocity gain × 2.2", {}, ("gain_margin",), factors={"controller.velocity.kp": 2.2}),
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
        Defect("rotor inertia −25 %", {}, ("gain_margin", "phase_margin"), factors={"inertia.motor": 0.75}),
        Defect("hinge stiffness / 10", {}, ("load_step", "accuracy_loaded"), "elastic", ("hinge-stiffness",), {
            f"drive_line.{part}_stiffness": 0.1 for part in ("fork", "shaft", "structure")}),
        Defect("load observer of 600 1/s", {"controller.load_observer": 600.0}, ("gain_margin",)),
        Defect("I²t limit reached after 10 s of 100 N·m", {"heat.continuous_current": 8.0, "heat.peak_time": 0.4},
               ("endurance",), "nonlinear+heat"),
        Defect("viscous friction × 10 in one direction", {}, ("symmetry",),
               factors={"friction.viscous.positive": 10.0}),
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
    "linear": (
        _gain(2.5, "phase_margin", "gain_margin"),
        _late(),
        _no_integral("accuracy_loaded", "load_recovery"),
        _weak_motor("rated_current", by=40),
        Defect("lever arm +2 % as built", {"deviation.kinematics.moment_arm": 0.02}, ("accuracy_20deg",)),
        _fault("encoder counts backwards", "encoder_reversed", "accuracy_1deg", "accuracy_20deg"),
    ),
    "second-order": (
        Defect("rate limit −20 %", {}, ("unloaded_rate", "loaded_rate"), factors={"second_order.rate_limit": 0.8}),
        Defect("half of the natural frequency", {}, ("bandwidth_1deg", "bandwidth_3p5deg"),
               factors={"second_order.natural_frequency": 0.5}),
        Defect("damping of 0.3", {"second_order.damping": 0.3}, ("small_overshoot", "overshoot")),
        Defect("command rounded to 0.5°", {"command.resolution": radians(0.5)}, ("small_step",)),
        _fault("bus 20 ms late", "command_delay", "lag"),
    ),
    "ristanovic": (
        Defect("PWM gain × 2", {}, ("rest", "rest_current"), factors={"pwm.gain": 2.0}),
        Defect("2 ms of delay in the drive", {"drive.transport_delay": 2e-3}, ("rest", "rest_current")),
        _gain(0.5, "bandwidth_1deg", "bandwidth_3p5deg"),
        _weak_motor("rated_current"),
        _fault("friction × 3", "friction_rise", "bandwidth_1deg"),
        Defect("speed limit 200 rad/s", {"controller.speed_limit": 200.0}, ("unloaded_rate", "loaded_rate")),
        Defect("encoder of 64 pulses", {"encoder.pulses": 64}, ("rest_current_small",)),
        _fault("encoder counts backwards", "encoder_reversed", "accuracy_1deg", "accuracy_20deg"),
        Defect("supply of 24 V", {"drive.supply_voltage": 24.0}, (), why="without back-EMF the supply does not limit "
               "the speed, and 4 V suffice for 100 N·m"),
    ),
    "habibi": (
        _late(),
        _fault("gap worn by 0.3 mm", "backlash_growth", "small_step", "accuracy_loaded"),
        _fault("friction × 3", "friction_rise", "bandwidth_1deg"),
        _weak_motor("rated_current"),
        _no_integral("accuracy_loaded", "load_recovery"),
        _fault("supply sagged to half", "brown_out", "unloaded_rate", "loaded_rate"),
        Defect("contact stiffness / 10", {}, ("torque_reserve", "accuracy_loaded"),
               factors={"drive_line.contact_stiffness": 0.1}),
        Defect("winding resistance × 3", {}, (), factors={"motor.resistance": 3.0}, why="the current loop "
               "compensates it: at 90 % of the supply the rate against 100 N·m is 182°/s, limit 180°/s"),
    ),
    "ozkan": (
        _late(),
        _weak_motor("rated_current"),
        Defect("drive of 30 A", {"drive.current_limit": 30.0}, ("torque_reserve",)),
        _fault("friction × 3", "friction_rise", "bandwidth_1deg"),
        _no_integral("accuracy_loaded", "load_recovery"),
        Defect("friction compensated twice", {"compensation.gain": 2.0}, ("small_overshoot",)),
        Defect("motor shaft a tenth as stiff", {}, (), factors={"drive_line.torsional_compliance": 10.0},
               why="250 N·m twist it by 0.06° at the fin"),
    ),
    "elastic": (
        _late(),
        Defect("rod a tenth as stiff along its axis", {}, ("accuracy_loaded", "load_recovery"),
               factors={"drive_line.axial_compliance": 10.0}),
        _fault("gap worn by 0.3 mm", "backlash_growth", "small_step", "accuracy_loaded"),
        _fault("friction × 3", "friction_rise", "bandwidth_1deg"),
        _weak_motor("rated_current"),
        Defect("friction compensated twice", {"compensation.gain": 2.0}, ("small_overshoot",)),
        Defect("encoder of 64 pulses", {"encoder.pulses": 64}, ("rest_current_small",)),
        Defect("rod a tenth as stiff in torsion", {}, (), factors={"drive_line.torsional_compliance": 10.0},
               why="250 N·m twist it by 0.06° at the fin"),
    ),
    "worm-gear": (
        _gain(2.5, "phase_margin", "gain_margin"),
        Defect("supply of 24 V", {"drive.supply_voltage": 24.0}, ("unloaded_rate",)),
        _fault("flanks without oil", "dry_flanks", "loaded_rate"),
        Defect("0.3° of backlash", {"drive_line.backlash": radians(0.3)}, ("small_step", "accuracy_loaded"),
               "worm-gear-elastic"),
    ),
    "worm-gear-elastic": (
        _late(),
        _fault("teeth worn by 0.3 mm", "backlash_growth", "small_step", "accuracy_loaded"),
        Defect("thrust bearings a tenth as stiff", {}, ("accuracy_loaded", "load_recovery"),
               factors={"drive_line.axial_compliance": 10.0}),
        _fault("flanks without oil", "dry_flanks", "loaded_rate"),
        _fault("vibration that takes the lock", "lost_lock", "rated_current"),
        _fault("supply sagged to half", "brown_out", "unloaded_rate", "loaded_rate"),
        _weak_motor("loaded_rate"),
        _no_integral("accuracy_loaded"),
        Defect("encoder of 64 pulses", {"encoder.pulses": 64}, (),
               why="0.8 A, limit 1 A: the worm holds the fin although the counts excite the motor"),
    ),
    "clutch": (
        _fault("open clutch that drags", "drag", "loaded_rate", "torque_reserve"),
        _fault("half the powder lost", "powder_loss", "torque_reserve", "loaded_rate"),
        _gain(2.5, "phase_margin", "gain_margin"),
    ),
    "series-clutch": (
        _gain(2.5, "phase_margin", "gain_margin"),
        Defect("supply of 24 V", {"drive.supply_voltage": 24.0}, ("unloaded_rate",)),
        _fault("open coil", "coil_open", "unloaded_rate", "loaded_rate"),
        _fault("clutch worn to 15 %", "powder_loss", "loaded_rate", share=0.15),
        Defect("screw and no-back without oil: efficiency of 70 %", {"efficiency.forward": 0.7}, ("loaded_rate",)),
        _weak_motor("loaded_rate", by=40),
        _no_integral("accuracy_loaded"),
        _fault("clutch worn to half", "powder_loss", why="250 N·m need 4.4 N·m at the clutch, which still has 5 N·m"),
        _fault("clutch worn to 30 %", "powder_loss", share=0.3, why="**a gap in the requirements**: the no-back holds "
               "250 N·m, and no requirement has a motion against more than 100 N·m"),
        Defect("drive of 30 A", {"drive.current_limit": 30.0}, (), why="the same gap"),
        _fault("open clutch that drags", "drag", why="the clutch is open only while the actuator is disabled, which "
               "no requirement judges"),
        _fault("no-back that fails", "clutch_engaged", why="the motor then holds the load, as without a no-back: 17 A "
               "under 100 N·m"),
    ),
    "servo": (
        Defect("position gain × 0.5", {}, ("accuracy_loaded", "bandwidth_1deg"), factors={"controller.kp": 0.5}),
        Defect("position gain × 4", {}, ("gain_margin", "phase_margin"), factors={"controller.kp": 4.0}),
        Defect("no derivative", {"controller.kd": 0.0}, ("overshoot",)),
        Defect("dead band of 30 counts", {"controller.dead_band": 30.0}, ("accuracy_20deg", "accuracy_1deg")),
        Defect("encoder of 512 counts", {"encoder.counts": 512, "controller.kp": 160.0, "controller.kd": 0.64},
               ("accuracy_1deg", "rest")),
        Defect("frames of 10 ms", {"controller.sample_time": 0.01}, ("phase_margin", "gain_margin")),
        Defect("PWM limited to 70 %", {}, ("unloaded_rate", "loaded_rate"), factors={"pwm.limit": 0.7}),
        Defect("supply of 20 V", {"drive.supply_voltage": 20.0}, ("unloaded_rate", "loaded_rate")),
        Defect("brushes that lose a fifth of the torque in one direction", {"motor.asymmetry": 0.2}, ("symmetry",)),
        _fault("gear without grease", "dry_gear", "loaded_rate", "accuracy_20deg"),
        _fault("teeth stripped", "stripped_gear", "range"),
        _fault("teeth worn by 1°", "worn_gear", "rest", "overshoot"),
        _fault("magnets that lost 40 % of their flux", "demagnetised", "torque_reserve", "loaded_rate"),
    ),
    "electrohydrostatic": (
        _fault("oil that air makes five times as soft", "air", "load_step"),
        _fault("pump that leaks ten times as much", "leakage", "load_step", "torque_reserve"),
        _fault("relief valve at a fifth", "relief_open", "torque_reserve"),
    ),
    "electrohydraulic": (
        _fault("oil that air makes seven times as soft", "air", "load_step", share=0.14),
        _fault("supply at half its pressure", "brown_out", "loaded_rate"),
        _fault("silted valve, its null shifted", "silting", "symmetry"),
    ),
}
# Half widths of the uniform tolerances of sound actuators: of deviations as built, and of parameters as a share.
_BUILT = {"deviation.kinematics.moment_arm": 0.002, "deviation.kinematics.initial_angle": radians(0.25),
          "deviation.screw.lead": 1e-4, "deviation.motor.torque_constant": 0.05, "deviation.friction.coulomb": 0.3,
          "deviation.friction.viscous": 0.3, "deviation.mass.fin": 0.1}
_SHARES = {"motor.resistance": 0.1, "motor.inductance": 0.2, "inertia.motor": 0.05, "drive.transport_delay": 0.03,
           "drive.current_limit": 0.02, "drive.supply_voltage": 0.03}
# Additional tolerances of single kinds, as a share.
_OF_KINDS = {"drive_line.backlash": 0.2, "drive_line.contact_stiffness": 0.2, "drive_line.axial_compliance": 0.2,
             "drive_line.torsional_compliance": 0.2, "pwm.gain": 0.03, "second_order.natural_frequency": 0.05,
             "second_order.damping": 0.05, "second_order.rate_limit": 0.03, "motor.stall_torque": 0.1,
             "motor.no_load_speed": 0.05, "gear.backlash": 0.2, "friction.gear": 0.3, "friction.gear_load": 0.2,
             "friction.gear_load_rise": 0.2, "friction.gear_viscous": 0.3}
_TEMPERATURE = 10.0, 50.0  # degC


@cache
def _model(name: str) -> str:
    """Return an actuator's name; for a file of this folder, the path of a copy beside a copy of models/emcas.toml."""
    if not name.endswith(".py"):
        return name
    folder = Path(mkdtemp(prefix="emcas-wrong-"))
    register(rmtree, folder, ignore_errors=True)
    copy(models_directory() / "emcas.toml", (folder / name).with_suffix(".toml"))
    return str(copy(Path(__file__).with_name(name), folder / name))


def parameters_of(kind: str, defect: Defect) -> ParameterSet:
    """Return the parameters of a wrong actuator."""
    model = kind + defect.model if defect.model.startswith("+") else defect.model or kind
    base = load_parameters(list(defect.files), model=_model(model))
    return base.with_values({**defect.changes, **{name: factor * float(base.values[name])
                                                  for name, factor in defect.factors.items()}})


@cache
def missed(kind: str) -> tuple[str, ...]:
    """Return the requirements that the shipped actuator misses, by which its other forms are not judged."""
    return _failed(_judged(load_parameters(model=kind), [{}])[0])


@cache
def failing(kind: str, number: int) -> tuple[str, ...]:
    """Return the requirements that a wrong actuator, by its index in DEFECTS, misses and the shipped one meets."""
    parameters = parameters_of(kind, DEFECTS[kind][number])
    return tuple(name for name in _failed(_judged(parameters, [{}])[0]) if name not in missed(kind))


def _failed(rows: Sequence[Judged]) -> tuple[str, ...]:
    return tuple(row.name for row in rows if not row.passed and not row.skipped)


def _judged(parameters: ParameterSet, changes: Sequence[Mapping[str, Any]]) -> list[list[Judged]]:
    """Return the judged requirements of each of several actuators that differ from a set by `changes`."""
    subject, specification = ParameterSubject(parameters), load_requirements(None, parameters)
    actuators = evaluate(subject, specification, changes)
    return [[judged(r, [f for f in figures if f.requirement.name == r.name], subject)
             for r in specification.requirements] for figures in actuators]


def sound(model: str) -> Iterator[dict[str, float]]:
    """Yield the changes of parameters of sound actuators, drawn within tolerances."""
    values, draw = load_parameters(model=model).values, np.random.default_rng(SEED)
    for _ in range(samples(model)):
        changes = {name: float(draw.uniform(-most, most)) for name, most in _BUILT.items() if name in values}
        changes |= {name: float(values[name]) * (1.0 + float(draw.uniform(-most, most)))
                    for name, most in _SHARES.items() if name in values}
        if "friction.temperature" in values:
            changes["friction.temperature"] = float(draw.uniform(*_TEMPERATURE))
        changes |= {name: float(values[name]) * (1.0 + float(draw.uniform(-most, most)))
                    for name, most in _OF_KINDS.items() if name in values}
        yield changes


@cache
def falsely_failing(model: str) -> tuple[tuple[str, ...], ...]:
    """Return the requirements that each sound actuator misses and the shipped one meets."""
    actuators = _judged(load_parameters(model=model), list(sound(model)))
    return tuple(tuple(name for name in _failed(rows) if name not in missed(model)) for rows in actuators)


def confusion() -> str:
    """Return the table of the numbers of wrong actuators that are detected, and of sound actuators that fail."""
    rows = []
    for kind, defects in DEFECTS.items():
        detected = sum(bool({*failing(kind, k)} & {*defect.causes}) for k, defect in enumerate(defects))
        failed = sum(map(bool, falsely_failing(kind)))
        rows.append((f"`{kind}`", f"{detected} of {len(defects)}", f"{failed} of {samples(kind)}"))
    return markdown(("actuator", "wrong ones detected by a requirement that indicates the cause",
                     "sound ones that fail"), rows)


def defects_of(kind: str) -> str:
    """Return the table of an actuator's defects, with the requirements that indicate them and the number of others."""
    rows = []
    for k, defect in enumerate(DEFECTS[kind]):
        failed = failing(kind, k)
        named = [name for name in failed if name in defect.causes]
        others = len(failed) - len(named)
        rows.append((defect.what, ", ".join(f"`{name}`" for name in named) or f"not detected: {defect.why}",
                     f"{others} more" if others else ""))
    return markdown(("defect", "detected by", "other requirements"), rows)


TABLES: Mapping[str, Mapping[str, Callable[[], str]]] = {"tools/verdict.md": {
    "confusion": confusion, **{f"defects {kind}": partial(defects_of, kind) for kind in DEFECTS}}}

if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv, TABLES, "make_verdict.py"))
