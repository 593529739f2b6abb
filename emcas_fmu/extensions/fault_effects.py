"""What faults of the plant do to a step: parameters, surroundings, and a rotor, or a fin, that stands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantFault, PlantInputs
from ..errors import EmcasError, place
from ..namespace import Names, Record, with_values
from ..ops.base import Ops, Value
from ..physics import mechanics
from .status import OPERATIONAL

_HEAVY = 1e9  # kg.m2: a rotor, or a fin, that nothing moves
_STUB = 1e-3  # of the fin's inertia, left at the fork: some models divide by it


class Held(NamedTuple):
    """What samples hand to steps; `acting` is whether any of the others does anything."""

    acting: Value
    jam: Value
    free: Value
    lost: Value
    current: Value
    supply: Value
    friction: Value
    gap: Value
    faults: Value
    built_in_test: Value
    verdict: Value


SOUND = Held(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, OPERATIONAL)


def faulted(ops: Ops, p: Any, actuator: Actuator, f: Held, declared: Mapping[str, Value]) -> Any:
    """Return the parameters of the plant under the faults; `declared` has whether (above 0) those of its kind act."""
    changes: dict[str, Value] = {}
    if capabilities.SCREW_DRIVE in actuator.provides:
        changes |= _of_screw_drive(ops, p, f)
    if capabilities.CURRENT_LIMIT in actuator.provides:
        changes["drive.current_limit"] = f.current * p.drive.current_limit
    if capabilities.BACKLASH in actuator.provides:
        changes["drive_line.backlash"] = p.drive_line.backlash + f.gap
    if capabilities.SCREW_DRIVE in actuator.provides and p.structure.torsion_bar:
        changes["load.torsion_bar"] = ops.where(f.free > 0.0, 0.0, p.load.torsion_bar)
    q = with_values(p, changes) if changes else p
    for fault in actuator.faults:
        q = _under(ops, q, fault, getattr(p.fault, fault.name), declared[fault.name] > 0.0)
    return q


def _of_screw_drive(ops: Ops, p: Any, f: Held) -> dict[str, Value]:
    broken = f.free > 0.0
    friction, hinge = p.friction, mechanics.hinge_friction(p)
    return {
        "inertia.motor": ops.where(f.jam > 0.0, _HEAVY, p.inertia.motor),
        "inertia.fin": ops.where(broken, _STUB, 1.0) * p.inertia.fin,
        "inertia.shaft": ops.where(broken, 0.0, p.inertia.shaft),
        "mass.fin": ops.where(broken, 0.0, p.mass.fin),
        "mass.shaft": ops.where(broken, 0.0, p.mass.shaft),
        "friction.coulomb.positive": tuple(f.friction * c for c in friction.coulomb.positive),
        "friction.coulomb.negative": tuple(f.friction * c for c in friction.coulomb.negative),
        "friction.viscous.positive": f.friction * friction.viscous.positive,
        "friction.viscous.negative": f.friction * friction.viscous.negative,
        "friction.fin_viscous": ops.where(broken, 0.0, f.friction * hinge.viscous),
        "friction.fin_coulomb": ops.where(broken, 0.0, f.friction * hinge.dry),
    }


def _under(ops: Ops, p: Any, fault: PlantFault, amounts: Any, on: Value) -> Any:
    """Return the parameters of the plant under a fault that an actuator declares: `p` where it does not act."""
    before: dict[str, Value] = {}

    def acting() -> tuple[Value, ...]:
        given = fault.changes(ops, p, amounts)
        before.update((name, _value(p, name, fault)) for name in given)
        for name, value in given.items():
            if not _alike(value, before[name]):
                raise EmcasError(f"{place(fault.changes)} gives {name} = {value!r}; as much as there is before is "
                                 "needed: a number, or a tuple of as many")
        return _flat(given.values())

    # Floats call one of both: where it does not act nothing is in `before`, and nothing changes.
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
    value = p
    try:
        for part in name.split("."):
            value = getattr(value, part)
    except AttributeError as error:
        raise EmcasError(f"{place(fault.changes)} changes {name} for fault {fault.name}: {error}") from error
    if isinstance(value, Names):
        raise EmcasError(f"{place(fault.changes)} changes {name} for fault {fault.name}, a group of parameters; there "
                         f"is {', '.join(f'{name}.{each}' for each in vars(value))}")
    return value


def blocked(ops: Ops, p: Any, actuator: Actuator, u: PlantInputs, jam: Value) -> tuple[Any, PlantInputs]:
    """Return parameters and surroundings in which a jam of the fin itself holds it through a step.

    Of an actuator without screw drive that reads its fin and feels forces: its inertia is one that nothing moves, and
    is not turned with the vehicle. What little it moves :func:`standing` takes back.
    """
    elsewhere = {capabilities.SCREW_DRIVE, capabilities.COMMAND_REFERENCE} & actuator.provides
    if elsewhere or actuator.encoder[0] != "fin_angle":
        return p, u
    still = {name: ops.where(jam, 0.0, getattr(u, name)) for name in ("wx2_wz2", "wx_wz", "alpha_y")}
    return with_values(p, {"inertia.fin": ops.where(jam, _HEAVY, p.inertia.fin)}), u.replace(**still)


def acting(ops: Ops, p: Any, actuator: Actuator, f: Held, u: PlantInputs) -> PlantInputs:
    """Return what acts on the plant under the faults: supply, bridge, load, and the current limit without them."""
    changes = {}
    if actuator.supply is not None:
        changes["supply"] = f.supply * u.supply
    changes["enabled"] = ops.both(u.enabled, ops.negate(f.lost > 0.0))
    if capabilities.SCREW_DRIVE in actuator.provides:
        changes["aero_torque"] = ops.where(f.free > 0.0, 0.0, u.aero_torque)
        changes["alpha_x"] = ops.where(f.jam > 0.0, 0.0, u.alpha_x)  # what jams the rotor turns it with the vehicle
    if capabilities.CURRENT_LIMIT in actuator.provides:
        changes["rated_current_limit"] = p.drive.current_limit
    return u.replace(**changes)


def at_line(ops: Ops, f: Held, power: Value) -> Value:
    """Return the power [W] at the line of a `power` [W] of the actuator, between which a brown-out drops the supply.

    Current or flow drawn is the same before and behind the drop, which turns the difference into heat. Power given back
    reaches the line as it is: the drop adds none.
    """
    drawn = ops.both(power > 0.0, f.supply > 0.0)
    (given,) = ops.branch(drawn, lambda: (power / f.supply,), lambda: (power,))
    return given


def standing(ops: Ops, actuator: Actuator, x: Record, jam: Value, then: Record | None = None) -> Record:
    """Return the states with a rotor that stands where it is, or where it was `then`, if it is jammed."""
    angle, speed = actuator.encoder  # of an actuator with a motor, its
    changes = {speed: ops.where(jam, 0.0, getattr(x, speed))}
    if then is not None:
        changes[angle] = ops.where(jam, getattr(then, angle), getattr(x, angle))
    return x.replace(**changes)
