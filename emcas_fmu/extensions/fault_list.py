"""All faults: parameters, needs, when they are active, and what they change. Their order is that in `fault_word`.

General faults come first, then those that an actuator declares for its kind
(:class:`emcas_fmu.actuators.declaration.PlantFault`), which replace general faults of the same name. A fault that only
changes parameters of the plant is one entry of FAULTS. Other effects on the plant are functions below, whose argument
`on` contains for each general fault, by name, whether it is active; a fault that the actuator lacks never is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from math import pi
from typing import Any, NamedTuple

from ..actuators import as_built, capabilities
from ..actuators.declaration import Actuator, PlantFault, PlantInputs, State, Values
from ..actuators.plant_fault import scaled
from ..errors import EmcasError, location
from ..namespace import Names, Record, value_of, with_values, with_values_where
from ..ops.base import Ops, Value
from ..physics import inverter, mechanics, winding
from ..variables import Variable, in_group, tunable

# Longest delay of a command, in sample times; each of them needs a state.
LONGEST_COMMAND_DELAY = 50
MOST = 31  # largest number of flags in an Integer
_SLACK = 1e-6  # of a sample time: rounding does not delay a fault that begins at a sample
_HEAVY = 1e9  # kg.m2: the inertia of a blocked rotor or fin
_LEAST_SUPPLY = 1e-9  # smallest share of the supply by which a power is divided: an ideal drive works even at 0 V
_FRICTION = (*as_built.COULOMB.scales, *as_built.VISCOUS.scales)
_STUB = 1e-3  # share of the fin's inertia that remains at a fork without fin: some actuators divide by this inertia


@dataclass(frozen=True)
class Fault(PlantFault):
    """A general fault.

    The actuator must provide one of the capabilities in `needs`, if there are any; for a fault `of_supply` it must have
    a supply. A fault `of_signals` acts in samples only: on commands, readings of the position sensor, or the reference.
    """

    changes: Callable[[Ops, Any, Any], Values] = lambda ops, p, amounts: {}
    needs: tuple[str, ...] = ()
    of_supply: bool = False
    of_signals: bool = False


def _without_fin(ops: Ops, p: Any, amounts: Any) -> Values:
    """Return the changed parameters of a drive that moves only a stub of the fin."""
    bar = ("load.torsion_bar",) if p.structure.torsion_bar else ()
    gone = ("inertia.shaft", "mass.fin", "mass.shaft", *mechanics.HINGE_VISCOUS, *mechanics.HINGE_DRY, *bar)
    return {"inertia.fin": _STUB * p.inertia.fin, **dict.fromkeys(gone, 0.0)}


FULL_REFERENCE: dict[str, Callable[[Any], Value]] = {
    capabilities.REFERENCE_LIMIT: lambda p: p.drive.reference_limit,
    capabilities.COMMAND_REFERENCE: lambda p: p.fin.stop_angle,
    capabilities.DUTY_REFERENCE: lambda p: p.pwm.limit / p.pwm.full}
"""The largest reference of the controllers, by the capability that names the quantity of the reference."""
FAULTS = (
    Fault("jam", "the drive line is blocked"),
    Fault("free_fin", "the shaft is broken between fork and fin, permanently: the fin floats", _without_fin,
          needs=(capabilities.SCREW_DRIVE,), lasting=True),
    Fault("hard_over", "the controller puts out a constant", amounts=(
        tunable("share", "1", -1.0, 1.0, "share of the largest reference that the controller puts out"),),
        needs=tuple(FULL_REFERENCE), of_signals=True),
    Fault("drive_loss", "the drive is off, and the controller does not notice"),
    Fault("current_derating", "the drive lowers its current limit",
          lambda ops, p, amounts: scaled(p, amounts.share, "drive.current_limit"), (
              tunable("share", "1", 0.0, 1.0, "remaining share of drive.current_limit"),),
          needs=(capabilities.CURRENT_LIMIT,)),
    Fault("brown_out", "the supply sags", amounts=(
        tunable("share", "1", 0.0, 1.0, "remaining share of the supply"),), of_supply=True),
    Fault("encoder_freeze", "the position sensor shows no motion", of_signals=True),
    Fault("encoder_bias", "the position sensor reads too much", amounts=(
        tunable("angle", "rad", -0.5, 0.5, "excess of the sensor's reading, as an angle of the fin"),),
        of_signals=True),
    Fault("encoder_dropped", "the position sensor misses a share of positive motion", amounts=(
        tunable("share", "1", 0.0, 1.0, "share of positive motion that is missed"),), of_signals=True),
    Fault("encoder_reversed", "the position sensor shows motion backwards", of_signals=True),
    Fault("command_freeze", "commands no longer arrive; the last one is held", of_signals=True),
    Fault("command_delay", "commands arrive late", amounts=(
        tunable("time", "s", 0.0, 5.0, "delay of commands, in whole samples, at most "
                                       f"{LONGEST_COMMAND_DELAY} of them"),), of_signals=True),
    Fault("friction_rise", "friction at motor and fin rises",
          lambda ops, p, amounts: scaled(p, amounts.factor, *_FRICTION), (
              tunable("factor", "1", 1.0, 1e4, "factor by which friction rises"),),
          needs=(capabilities.SCREW_DRIVE,)),
    Fault("backlash_growth", "the gap in the drive line grows permanently by wear",
          lambda ops, p, amounts: {"drive_line.backlash": p.drive_line.backlash + amounts.gap}, (
              tunable("gap", "m", 0.0, 0.01, "growth of the gap"),),
          needs=(capabilities.BACKLASH,), lasting=True, grows=True),
    Fault("winding_short", "the motor's terminals are shorted, and the controller does not notice", amounts=(
        tunable("pole_pairs", "1", 0.0, 1e3, "pole pairs of the motor (0: its inductance has no effect)"),),
        needs=(capabilities.PHASES,)),
    Fault("phase_loss", "a phase of the motor is open, and the controller does not notice", amounts=(
        tunable("pole_pairs", "1", 1.0, 1e3, "pole pairs of the motor"),
        tunable("angle", "rad", -pi, pi, "motor angle at which there is no torque")),
        needs=(capabilities.PHASES,)),
)
"""The general faults. A new one is appended: this moves only the bits of the faults that actuators declare."""


def general(actuator: Actuator) -> tuple[Fault, ...]:
    """Return the general faults that an actuator can have, without those that it declares itself."""
    declared = {fault.name for fault in actuator.faults}
    return tuple(fault for fault in FAULTS if fault.name not in declared
                 and (not fault.needs or actuator.provides.intersection(fault.needs))
                 and (not fault.of_supply or actuator.supply is not None))


def has(actuator: Actuator, name: str) -> bool:
    """Return whether an actuator can have the general fault of this name, and does not replace it."""
    return name in (fault.name for fault in general(actuator))


def possible(actuator: Actuator) -> tuple[PlantFault, ...]:
    """Return the faults an actuator can have, in the order of their bits."""
    by_name: dict[str, PlantFault] = {fault.name: fault for fault in (*general(actuator), *actuator.faults)}
    return tuple(by_name[name] for name in bits(actuator) if name in by_name)


def bits(actuator: Actuator) -> tuple[str, ...]:
    """Return the names of the bits of an actuator's `fault_word`, the lowest first: general faults, then its own.

    Raises EmcasError for more faults than bits.
    """
    faults: tuple[PlantFault, ...] = (*FAULTS, *actuator.faults)
    names = tuple(dict.fromkeys(fault.name for fault in faults))
    if len(names) > MOST:
        raise EmcasError(f"actuator {actuator.name}: {len(actuator.faults)} faults are declared; fault_word has room "
                         f"for {MOST - len(FAULTS)} in addition to the general ones")
    return names


def parameters(fault: PlantFault) -> tuple[Variable, ...]:
    """Return the parameters of a fault: its switch, its schedule and its amounts."""
    return in_group(
        f"fault.{fault.name}",
        Variable("active", "Boolean", "parameter", "tunable", "", fault.description, start=False),
        *(replace(tunable(name, "s", 0.0, 1e9, described), start=0.0) for name, described in (
            ("begin", f"time at which {fault.name} begins by schedule"),
            ("end", f"time at which {fault.name} ends by schedule (at or before begin: no schedule)"))),
        *fault.amounts)


def state(fault: PlantFault) -> State:
    """Return the state of a fault of the plant: 1 while it is active. Samples set it, steps and samples read it."""
    return State(f"plant_fault_{fault.name}")


class Grown(NamedTuple):
    """An amount that does not fall before reset: its fault, its parameter, and the state that contains it."""

    fault: str
    parameter: str
    state: str


def grown(faults: Iterable[PlantFault]) -> tuple[Grown, ...]:
    """Return the amounts of faults that grow."""
    return tuple(Grown(fault.name, f"fault.{fault.name}.{v.name}", f"{state(fault).name}_{v.name}")
                 for fault in faults if fault.grows for v in fault.amounts)


def active(ops: Ops, p: Any, x: Record, faults: Iterable[PlantFault], time: Value) -> dict[str, Value]:
    """Return by name whether each fault is active in a sample at `time` [s from the start]: switched on or scheduled.

    A lasting fault that was active in the last sample remains active.
    """
    instant = time + _SLACK * p.controller.sample_time

    def is_active(fault: PlantFault, switch: Any) -> Value:
        on = ops.either(switch.active, ops.both(instant >= switch.begin, instant < switch.end))
        return ops.either(on, getattr(x, state(fault).name) > 0.0) if fault.lasting else on

    return {fault.name: is_active(fault, getattr(p.fault, fault.name)) for fault in faults}


def of_plant(actuator: Actuator) -> tuple[PlantFault, ...]:
    """Return the faults of an actuator's plant, each of which has a :func:`state`."""
    return (*(fault for fault in general(actuator) if not fault.of_signals), *actuator.faults)


def word(ops: Ops, names: tuple[str, ...], on: Mapping[str, Value]) -> Value:
    """Return `fault_word`, in which `names` are the bits, for the faults that are active according to `on`."""
    return reduce(lambda total, name: total + ops.where(on[name], float(2**names.index(name)), 0.0),
                  (name for name in names if name in on), 0.0)


def faulted(ops: Ops, p: Any, actuator: Actuator, on: Mapping[str, Value], active: Mapping[str, Value], x: Record,
            h: Value) -> Any:
    """Return the parameters of the faulty plant for a step of `h` [s] from `x`.

    `active` contains by name whether each fault of the plant is active, those that the actuator declares included.
    """
    q = changed(ops, p, general(actuator), on)
    if capabilities.SCREW_DRIVE in actuator.provides:
        q = with_values_where(ops, on["jam"], q, {"inertia.motor": _HEAVY})
    q = _of_winding(ops, q, actuator, on, x, h)
    return changed(ops, q, actuator.faults, active)


def changed(ops: Ops, p: Any, faults: Iterable[PlantFault], on: Mapping[str, Value]) -> Any:
    """Return the plant's parameters as the active ones of `faults` change them, one after another."""
    return reduce(lambda q, fault: _under(ops, q, fault, getattr(p.fault, fault.name), on[fault.name]), faults, p)


def _of_winding(ops: Ops, p: Any, actuator: Actuator, on: Mapping[str, Value], x: Record, h: Value) -> Any:
    """Return the plant's parameters with failed windings: shorted at the speed of `x`, or open at mid-step's angle.

    The speed at mid-step would need the torque of the step. The switches that short the terminals have no dead time;
    two phases in series have the dead time of both.
    """
    if capabilities.PHASES not in actuator.provides:
        return p
    in_series, without_switching = ({"inverter.dead_time": share * p.inverter.dead_time} if p.structure.inverter else {}
                                    for share in (inverter.IN_SERIES, 0.0))
    if has(actuator, "phase_loss"):
        lost = p.fault.phase_loss
        angle = x.motor_angle + 0.5 * h * x.motor_speed - lost.angle
        p = with_values_where(ops, on["phase_loss"], p, {
            **winding.single_phase(ops, p, lost.pole_pairs, angle), **in_series})
    if has(actuator, "winding_short"):
        p = with_values_where(ops, on["winding_short"], p, {
            **winding.shorted(p, p.fault.winding_short.pole_pairs, x.motor_speed), **without_switching})
    return p


def _under(ops: Ops, p: Any, fault: PlantFault, amounts: Any, on: Value) -> Any:
    """Return the plant's parameters with the `changes` of a fault, if it is `on`, otherwise `p`."""
    before: dict[str, Value] = {}

    def acting() -> tuple[Value, ...]:
        changes = fault.changes(ops, p, amounts)
        before.update((name, _value(p, name, fault)) for name in changes)
        for name, value in changes.items():
            if not _alike(value, before[name]):
                raise EmcasError(f"{location(fault.changes)} returns {name} = {value!r}; return a number or, for an "
                                 "array, a tuple of the same length")
        return _flat(changes.values())

    # With floats only one function is called: if the fault is off, `before` is empty, and nothing changes.
    values = iter(ops.branch(on, acting, lambda: _flat(before.values())))
    return with_values(p, {name: tuple(next(values) for _ in old) if isinstance(old, tuple) else next(values)
                           for name, old in before.items()})


def _alike(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other)
    return not isinstance(one, (tuple, list, str, type(None))) and not isinstance(other, tuple)


def _flat(values: Iterable[Value]) -> tuple[Value, ...]:
    return tuple(each for value in values for each in (value if isinstance(value, tuple) else (value,)))


def _value(p: Any, name: str, fault: PlantFault) -> Value:
    """Return a parameter by its dotted name. Raises EmcasError for one that the plant does not have."""
    try:
        value = value_of(p, name)
    except AttributeError as error:
        raise EmcasError(f"{location(fault.changes)} changes {name} for fault {fault.name}: {error}") from error
    if isinstance(value, Names):
        raise EmcasError(f"{location(fault.changes)} changes {name} for fault {fault.name}, a group of parameters; "
                         f"there is {', '.join(f'{name}.{each}' for each in vars(value))}")
    return value


def blocked(ops: Ops, p: Any, actuator: Actuator, u: PlantInputs, jam: Value) -> tuple[Any, PlantInputs]:
    """Return parameters and inputs of the plant with which a jammed fin is blocked during a step.

    They only change if the encoder reads the fin and loads move the fin: the fin then gets a huge inertia, and does not
    turn with the vehicle. :func:`standing` removes the small motion that remains.
    """
    other = {capabilities.SCREW_DRIVE, capabilities.COMMAND_REFERENCE} & actuator.provides
    if other or actuator.encoder[0] != "fin_angle":
        return p, u
    still = {name: ops.where(jam, 0.0, getattr(u, name)) for name in ("wx2_wz2", "wx_wz", "alpha_y")}
    return with_values(p, {"inertia.fin": ops.where(jam, _HEAVY, p.inertia.fin)}), u.replace(**still)


def acting(ops: Ops, p: Any, actuator: Actuator, on: Mapping[str, Value], u: PlantInputs) -> PlantInputs:
    """Return the inputs of the faulty plant: supply, bridge, loads, and the current limit without faults."""
    changes = {}
    if actuator.supply is not None:
        changes["supply"] = share_of_supply(ops, p, on) * u.supply
    changes["enabled"] = ops.either(ops.both(u.enabled, ops.negate(on["drive_loss"])), on["winding_short"])
    if capabilities.SCREW_DRIVE in actuator.provides:
        changes["aero_torque"] = ops.where(on["free_fin"], 0.0, u.aero_torque)
        changes["alpha_x"] = ops.where(on["jam"], 0.0, u.alpha_x)  # a blocked rotor turns with the vehicle
    if capabilities.CURRENT_LIMIT in actuator.provides:
        changes["rated_current_limit"] = p.drive.current_limit
    return u.replace(**changes)


def share_of_supply(ops: Ops, p: Any, on: Mapping[str, Value]) -> Value:
    """Return the share of the supply that a brown-out leaves; 1 without one."""
    active = on["brown_out"]
    return 1.0 if active is False else ops.where(active, p.fault.brown_out.share, 1.0)


def at_line(ops: Ops, share: Value, power: Value) -> Value:
    """Return the power [W] from the supply for the `power` [W] that an actuator consumes at a `share` of the supply.

    Current or flow is the same on both sides of a brown-out's drop, which dissipates the difference. Power that the
    actuator returns reaches the supply unchanged.
    """
    consumes = ops.both(power > 0.0, share > 0.0)
    return ops.branch(consumes, lambda: (power / ops.maximum(share, _LEAST_SUPPLY),), lambda: (power,))[0]


def returned_charge(ops: Ops, share: Value, before: Value, after: Value) -> Value:
    """Return the charge [A.s] from the supply after a step, which changes it from `before` to `after` behind the drop.

    Returned power reaches the supply unchanged, as a smaller charge at a higher voltage.
    """
    gained = after - before
    return before + ops.where(gained < 0.0, share * gained, gained)


def standing(ops: Ops, actuator: Actuator, x: Record, jam: Value, then: Record | None = None) -> Record:
    """Return the states; if the rotor is jammed it is at rest, at its present angle or at that of `then`."""
    angle, speed = actuator.encoder  # the motor's, if there is one
    changes = {speed: ops.where(jam, 0.0, getattr(x, speed))}
    if then is not None:
        changes[angle] = ops.where(jam, getattr(then, angle), getattr(x, angle))
    return x.replace(**changes)


def without_loop(ops: Ops, actuator: Actuator, x: Record, on: Mapping[str, Value]) -> Record:
    """Return the states; with shorted terminals the integral of the current loop is 0."""
    if capabilities.PHASES not in actuator.provides:
        return x
    return x.replace(drive_integral=ops.where(on["winding_short"], 0.0, x.drive_integral))
