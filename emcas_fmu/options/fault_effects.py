"""What faults of the plant do to a step: parameters, surroundings, and a rotor that stands."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..actuators.model import Model, Values
from ..integrate import Boundary
from ..ops.base import Ops, Value
from ..tree import changed
from .status import OPERATIONAL

_HEAVY = 1e9  # kg.m2: a rotor that nothing moves
_STUB = 1e-3  # of the fin's inertia, left at the fork: some models divide by it


class Held(NamedTuple):
    """What samples tell to steps; `acting` is whether any of the others does anything."""

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


def faulted(ops: Ops, p: Any, f: Held) -> Any:
    """Parameters of the plant under the faults; drive.sound_current_limit [A] is its current limit without."""
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
        "drive.current_limit": f.current * p.drive.current_limit,
        "drive.sound_current_limit": p.drive.current_limit,
    }
    if hasattr(p, "drive_line") and hasattr(p.drive_line, "backlash"):
        changes["drive_line.backlash"] = p.drive_line.backlash + f.gap
    if hasattr(p, "load"):
        changes["load.torsion_bar"] = ops.where(broken, 0.0, p.load.torsion_bar)
    return changed(p, changes)


def surroundings(ops: Ops, f: Held, b: Boundary) -> Boundary:
    """What acts on the plant under the faults: supply, bridge, load."""
    return b._replace(supply=f.supply * b.supply, enabled=ops.both(b.enabled, ops.negate(f.lost > 0.0)),
                      aero_torque=ops.where(f.free > 0.0, 0.0, b.aero_torque))


def standing(ops: Ops, p: Any, model: Model, plant: Values, jam: Value, then: Values | None = None) -> Values:
    """A plant whose rotor stands where it is, or where it was `then`, if it is jammed."""
    elastic = "angle at the other side" in model.plant
    places = {0: 0, 1: 1}
    changes = list(plant)
    if elastic:
        at = model.plant.index("angle at the other side")
        places |= {at: 0, at + 1: 1}
    for place, kind in places.items():
        rotor = jam
        if elastic:
            on_fin = p.encoder.on_fin
            rotor = ops.both(jam, ops.negate(on_fin) if place < 2 else on_fin)
        if kind == 1:
            changes[place] = ops.where(rotor, 0.0, plant[place])
        elif then is not None:
            changes[place] = ops.where(rotor, then[place], plant[place])
    return tuple(changes)
