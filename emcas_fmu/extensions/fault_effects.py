"""What faults of the plant do to a step: parameters, surroundings, and a rotor that stands."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..actuators import capabilities
from ..actuators.declaration import Acting, Actuator
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from .status import OPERATIONAL

_HEAVY = 1e9  # kg.m2: a rotor that nothing moves
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


def faulted(ops: Ops, p: Any, actuator: Actuator, f: Held) -> Any:
    """Return the parameters of the plant under the faults."""
    if capabilities.SCREW_DRIVE not in actuator.provides:
        return p
    broken = f.free > 0.0
    friction = p.friction
    changes = {
        "inertia.motor": ops.where(f.jam > 0.0, _HEAVY, p.inertia.motor),
        "inertia.fin": ops.where(broken, _STUB, 1.0) * p.inertia.fin,
        "inertia.shaft": ops.where(broken, 0.0, p.inertia.shaft),
        "mass.fin": ops.where(broken, 0.0, p.mass.fin),
        "mass.shaft": ops.where(broken, 0.0, p.mass.shaft),
        "friction.coulomb.positive": tuple(f.friction * c for c in friction.coulomb.positive),
        "friction.coulomb.negative": tuple(f.friction * c for c in friction.coulomb.negative),
        "friction.viscous.positive": f.friction * friction.viscous.positive,
        "friction.viscous.negative": f.friction * friction.viscous.negative,
        "friction.fin_viscous": ops.where(broken, 0.0, f.friction * friction.fin_viscous),
        "friction.fin_coulomb": ops.where(broken, 0.0, f.friction * friction.fin_coulomb),
    }
    if capabilities.CURRENT_LIMIT in actuator.provides:
        changes["drive.current_limit"] = f.current * p.drive.current_limit
    if capabilities.BACKLASH in actuator.provides:
        changes["drive_line.backlash"] = p.drive_line.backlash + f.gap
    if p.structure.torsion_bar:
        changes["load.torsion_bar"] = ops.where(broken, 0.0, p.load.torsion_bar)
    return with_values(p, changes)


def acting(ops: Ops, p: Any, actuator: Actuator, f: Held, u: Acting) -> Acting:
    """Return what acts on the plant under the faults: supply, bridge, load, and the current limit without them."""
    changes = {}
    if capabilities.SUPPLY_VOLTAGE in actuator.provides:
        changes["supply"] = f.supply * u.supply
    changes["enabled"] = ops.both(u.enabled, ops.negate(f.lost > 0.0))
    if capabilities.SCREW_DRIVE in actuator.provides:
        changes["aero_torque"] = ops.where(f.free > 0.0, 0.0, u.aero_torque)
        changes["alpha_x"] = ops.where(f.jam > 0.0, 0.0, u.alpha_x)  # what jams the rotor turns it with the vehicle
    if capabilities.CURRENT_LIMIT in actuator.provides:
        changes["rated_current_limit"] = p.drive.current_limit
    return u.replace(**changes)


def standing(ops: Ops, actuator: Actuator, x: Record, jam: Value, then: Record | None = None) -> Record:
    """Return the states with a rotor that stands where it is, or where it was `then`, if it is jammed."""
    angle, speed = actuator.encoder  # of an actuator with a motor, its
    changes = {speed: ops.where(jam, 0.0, getattr(x, speed))}
    if then is not None:
        changes[angle] = ops.where(jam, getattr(then, angle), getattr(x, angle))
    return x.replace(**changes)
