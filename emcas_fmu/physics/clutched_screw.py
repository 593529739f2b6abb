"""A rotor that drives a loaded screw through one friction clutch: sticking, sliding and the direction of the load.

    J_m m' = t_m - C_m sgn m - F                        |F| <= C, and F = C sgn(m - w) while the clutch slips
    J_s w' = t_s - C_s sgn w + F - e L                  L = J_l w' + L_0        e of :mod:`emcas_fmu.physics.screw`

m and w are the speeds of rotor and screw. F is the clutch's torque, C the torque at which it slips, L the load behind
the screw. Three dry frictions are set-valued: the rotor's, the screw's (at rest with the part that its load adds) and
the clutch's. If F rises, w' does not fall and m' does not rise. The clutch therefore holds if |F| <= C for the F that
keeps both speeds equal; every state has one solution.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from .stick import start


class Train(NamedTuple):
    """Rotor, clutch and screw at one instant: inertias [kg.m2] and torques [N.m] of the module's equations.

    `rotor` is J_m, `screw` J_s, `behind_inertia` J_l, `rotor_torque` t_m, `screw_torque` t_s, `dry` C_m, `capacity` C.
    `sliding` and `load` are C_s and L_0, each for positive and for negative motion. `behind` is -L_0 at rest without
    friction. A screw at rest starts under a torque above `high` or below `low`. `forward` and `backward` are e [-]
    where the screw drives the load and where the load drives the screw.
    """

    rotor: Value
    screw: Value
    behind_inertia: Value
    rotor_torque: Value
    screw_torque: Value
    dry: Value
    capacity: Value
    sliding: tuple[Value, Value]
    load: tuple[Value, Value]
    behind: Value
    high: Value
    low: Value
    forward: Value
    backward: Value


class Directions(NamedTuple):
    """Directions of sliding (-1, 1, or 0: sticks) of screw, rotor and clutch, and the present e (`felt`).

    The slip of the clutch is the rotor's speed minus the screw's.
    """

    screw: Value
    rotor: Value
    clutch: Value
    felt: Value


def _along(ops: Ops, pair: tuple[Value, Value], direction: Value) -> Value:
    return ops.where(direction > 0.0, pair[0], pair[1])


def _driving(ops: Ops, t: Train, m: Directions) -> tuple[Value, Value, Value]:
    """Return torque [N.m] and inertia [kg.m2] of the screw's motion, and the rotor's torque without the clutch."""
    rotor = t.rotor_torque - m.rotor * t.dry
    joined = ops.equal(m.clutch, 0.0)
    net = t.screw_torque - m.screw * _along(ops, t.sliding, m.screw) + ops.where(joined, rotor, m.clutch * t.capacity)
    return net, t.screw + ops.where(joined, t.rotor, 0.0), rotor


def _with_load_factor(ops: Ops, t: Train, m: Directions) -> Directions:
    """Return the motion with its e: the forward value if the screw drives the load, else the backward one."""
    net, inertia, _ = _driving(ops, t, m)
    against = (t.behind_inertia * net + inertia * _along(ops, t.load, m.screw)) * m.screw > 0.0
    return m._replace(felt=ops.where(against, t.forward, t.backward))


def accelerations(ops: Ops, t: Train, m: Directions) -> tuple[Value, Value]:
    """Return d/dt of the speeds of screw and rotor [rad/s2], equal while the clutch holds."""
    net, inertia, rotor = _driving(ops, t, m)
    screw_rate = (net - m.felt * _along(ops, t.load, m.screw)) / (inertia + m.felt * t.behind_inertia)
    screw_rate = ops.where(ops.equal(m.screw, 0.0), 0.0, screw_rate)
    rotor_rate = ops.where(ops.equal(m.rotor, 0.0), 0.0, (rotor - m.clutch * t.capacity) / t.rotor)
    return screw_rate, ops.where(ops.equal(m.clutch, 0.0), screw_rate, rotor_rate)


def transmitted(ops: Ops, t: Train, m: Directions) -> Value:
    """Return the load L [N.m] behind a screw that turns."""
    rate, _ = accelerations(ops, t, m)
    return t.behind_inertia * rate + _along(ops, t.load, m.screw)


def _between(ops: Ops, t: Train) -> tuple[Value, Value]:
    """Return the smallest and the largest torque [N.m] from rotor to screw under which both stay at rest."""
    applied = t.screw_torque + t.behind
    return (ops.maximum(t.rotor_torque - t.dry, t.low - applied), ops.minimum(t.rotor_torque + t.dry, t.high - applied))


def held(ops: Ops, t: Train, m: Directions) -> Value:
    """Return F [N.m] of a clutch that holds. With both bodies at rest F is not unique: return the one nearest to 0."""
    rate, _ = accelerations(ops, t, m)
    least, most = _between(ops, t)
    resting = ops.maximum(least, ops.minimum(most, 0.0))
    return ops.where(ops.equal(m.screw, 0.0), resting, t.rotor_torque - m.rotor * t.dry - t.rotor * rate)


def torque(ops: Ops, t: Train, m: Directions) -> Value:
    """Return the clutch's torque F [N.m]."""
    return ops.where(ops.equal(m.clutch, 0.0), ops.clip(held(ops, t, m), -t.capacity, t.capacity),
                     m.clutch * t.capacity)


def motion(ops: Ops, t: Train, screw_speed: Value, rotor_speed: Value) -> Directions:
    """Return the motion at speeds of screw and rotor [rad/s]."""
    turns, slip = ops.sign(screw_speed), ops.sign(rotor_speed - screw_speed)
    # Rotor and screw as one body, which the frictions of both hold at rest.
    applied = t.screw_torque + t.behind + t.rotor_torque
    starts = start(ops, applied, t.high + t.dry, t.low - t.dry)
    way = ops.where(ops.equal(turns, 0.0), starts, turns)
    joined = _with_load_factor(ops, t, Directions(way, way, 0.0, 0.0))
    slip = ops.where(ops.equal(slip, 0.0), start(ops, held(ops, t, joined), t.capacity, -t.capacity), slip)
    # Rotor and screw as two bodies, under the torque of the slipping clutch.
    pushed = slip * t.capacity
    screw_way = ops.where(ops.equal(turns, 0.0), start(ops, t.screw_torque + t.behind + pushed, t.high, t.low), turns)
    rotor_way = ops.sign(rotor_speed)
    rotor_way = ops.where(ops.equal(rotor_way, 0.0), start(ops, t.rotor_torque - pushed, t.dry, -t.dry), rotor_way)
    apart = _with_load_factor(ops, t, Directions(screw_way, rotor_way, slip, 0.0))
    return Directions(*(ops.where(ops.equal(slip, 0.0), one, other) for one, other in zip(joined, apart, strict=True)))


def margins(ops: Ops, t: Train, m: Directions, screw_speed: Value, rotor_speed: Value) -> dict[str, Value]:
    """Return the event margins by name: sliding speeds [rad/s], reserves of sticking frictions and load [N.m], or 1."""
    joined = ops.equal(m.clutch, 0.0)
    screw_rests, rotor_rests = ops.equal(m.screw, 0.0), ops.equal(m.rotor, 0.0)
    rests = ops.both(joined, screw_rests)
    pushed, (least, most) = m.clutch * t.capacity, _between(ops, t)
    together = ops.minimum(most, t.capacity) - ops.maximum(least, -t.capacity)
    applied = t.screw_torque + t.behind + pushed
    screw = ops.where(screw_rests, ops.minimum(t.high - applied, applied - t.low), m.screw * screw_speed)
    rotor = ops.where(rotor_rests, t.dry - ops.fabs(t.rotor_torque - pushed), m.rotor * rotor_speed)
    clutch = ops.where(joined, t.capacity - ops.fabs(held(ops, t, m)), m.clutch * (rotor_speed - screw_speed))
    load = m.screw * transmitted(ops, t, m) * ops.where(ops.equal(m.felt, t.forward), 1.0, -1.0)
    return {"screw": ops.where(rests, together, screw), "rotor": ops.where(joined, 1.0, rotor),
            "clutch": ops.where(rests, 1.0, clutch), "load": ops.where(screw_rests, 1.0, load)}


def landed(ops: Ops, m: Directions, begin: tuple[Value, Value], end: tuple[Value, Value], events: Any
           ) -> tuple[Value, Value]:
    """Return the speeds [rad/s] of screw and rotor after a step, equal to the bit if the clutch sticks.

    `begin` and `end` are both speeds before and after the step; `events` is true for each margin that fell to 0. A
    friction that slides sticks if its margin fell to 0, or if it would slide against the direction of its start.
    """
    def stops(direction: Value, before: Value, after: Value, event: Value) -> Value:
        backwards = ops.both(ops.equal(before, 0.0), after * direction <= 0.0)
        return ops.where(ops.equal(direction, 0.0), True, ops.either(event, backwards))

    still = stops(m.screw, begin[0], end[0], events["screw"])
    halted = stops(m.rotor, begin[1], end[1], events["rotor"])
    joined = stops(m.clutch, begin[1] - begin[0], end[1] - end[0], events["clutch"])
    screw_speed = ops.where(ops.either(still, ops.both(joined, halted)), 0.0, end[0])
    return screw_speed, ops.where(joined, screw_speed, ops.where(halted, 0.0, end[1]))
