"""Two bodies on one axis with set-valued dry friction: on each of them, and between them in clutches.

    J_s w' = t_s - sum_k l_k F_k        J_m m' = t_m - sum_k m_k F_k        s_k = l_k w + m_k m

w and m are the speeds of screw and motor, s_k the speed at which a friction slides. There are four frictions: the
screw's (s = w), the motor's (s = m), that of a clutch which turns the screw with the motor (s = m - w), and that of a
clutch which turns the screw against the motor (s = -m - w). The torque of a friction that slides is F_k = C_k sgn s_k.
At s_k = 0 a friction sticks if a torque within +-C_k keeps s_k at 0. The accelerations minimise a convex function (the
principle of least constraint), so every state has one solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..ops.base import Ops, Value
from . import stick

SCREW, MOTOR, WITH, AGAINST = range(4)
NAMES = ("screw", "motor", "with", "against")
_SHARES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))  # (l_k, m_k)
# For each friction the direction (w, m) of a motion in which it sticks: l_k w + m_k m = 0.
_ALONG = ((0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (1.0, -1.0))
# A direction in each of the eight sectors between those of _ALONG; in a sector no sliding speed is zero.
_SECTORS = ((2.0, 1.0), (1.0, 2.0), (-1.0, 2.0), (-2.0, 1.0), (-2.0, -1.0), (-1.0, -2.0), (1.0, -2.0), (2.0, -1.0))


class Dry(NamedTuple):
    """The torques of a dry friction [N.m], both positive, against positive and negative sliding."""

    high: Value
    low: Value


class Bodies(NamedTuple):
    """Inertias of screw and motor [kg.m2], their torques [N.m] without dry friction, and the four frictions."""

    inertias: tuple[Value, Value]
    torques: tuple[Value, Value]
    dry: Sequence[Dry]


def _dot(pair: Sequence[float], values: Sequence[Value]) -> Value:
    """Return the scalar product of shares and values; no product is computed for shares of 0, 1 and -1."""
    total: Value = 0.0
    for share, value in zip(pair, values, strict=True):
        if share:
            total = total + (value if share == 1.0 else -value if share == -1.0 else share * value)
    return total


def slips(screw: Value, motor: Value) -> list[Value]:
    """Return the speeds [rad/s] at which the four frictions slide."""
    return [_dot(shares, (screw, motor)) for shares in _SHARES]


def _sliding(ops: Ops, b: Bodies, signs: Sequence[Value]) -> tuple[Value, Value]:
    """Return the torques [N.m] of screw and motor under the frictions that slide in these directions (0: sticks)."""
    torques = list(b.torques)
    for shares, dry, sign in zip(_SHARES, b.dry, signs, strict=True):
        felt = ops.where(sign > 0.0, dry.high, ops.where(sign < 0.0, -dry.low, 0.0))
        torques = [t - _dot((share,), (felt,)) if share else t for t, share in zip(torques, shares, strict=True)]
    return torques[0], torques[1]


def _holding(b: Bodies, k: int, torques: tuple[Value, Value]) -> Value:
    """Return the torque [N.m] of friction k that keeps it sticking under these torques of screw and motor [N.m]."""
    if k in (SCREW, MOTOR):
        return torques[k]
    (inertia, other), (screw, motor) = b.inertias, torques
    return (inertia * motor - other * screw if k == WITH else -inertia * motor - other * screw) / (inertia + other)


def _drag(b: Bodies, along: tuple[float, float], forward: bool) -> Value:
    """Return the friction [N.m] against a start along (w, m) = `along`, or in the opposite direction: not `forward`."""
    total: Value = 0.0
    for shares, dry in zip(_SHARES, b.dry, strict=True):
        slip = sum(x * y for x, y in zip(shares, along, strict=True)) * (1.0 if forward else -1.0)
        if slip:
            total = total + abs(slip) * (dry.high if slip > 0.0 else dry.low)
    return total


def directions(ops: Ops, b: Bodies, screw: Value, motor: Value) -> tuple[Value, ...]:
    """Return the directions (-1, 1, or 0: sticks) in which the four frictions slide at speeds [rad/s]."""
    speeds = slips(screw, motor)
    signs = [ops.sign(speed) for speed in speeds]

    def moving() -> tuple[Value, ...]:  # at most one friction sticks
        torques = _sliding(ops, b, signs)
        return tuple(ops.where(ops.equal(sign, 0.0),
                               stick.start(ops, _holding(b, k, torques), dry.high, -dry.low), sign)
                     for k, (dry, sign) in enumerate(zip(b.dry, signs, strict=True)))

    rests = ops.both(ops.equal(screw, 0.0), ops.equal(motor, 0.0))
    return ops.branch(rests, lambda: _from_rest(ops, b), moving)


def _from_rest(ops: Ops, bodies: Bodies) -> tuple[Value, ...]:
    """Return the directions in which the frictions of bodies at rest slide: the one consistent choice."""
    b = bodies._replace(dry=[Dry(d.high * stick.EDGE, d.low * stick.EDGE) for d in bodies.dry])
    starts: tuple[Value, ...] = (0.0,) * len(_SHARES)

    def select(condition: Value, signs: Sequence[Value]) -> None:
        nonlocal starts
        starts = tuple(ops.where(condition, sign, before) for sign, before in zip(signs, starts, strict=True))

    for sector in _SECTORS:
        signs = [1.0 if _dot(shares, sector) > 0.0 else -1.0 for shares in _SHARES]
        torques = _sliding(ops, b, signs)
        rates = [t / inertia for t, inertia in zip(torques, b.inertias, strict=True)]
        holds: Value = True
        for shares, sign in zip(_SHARES, signs, strict=True):
            holds = ops.both(holds, sign * _dot(shares, rates) >= 0.0)
        select(holds, signs)
    rests: Value = True
    for k, along in enumerate(_ALONG):
        for forward in (True, False):
            way = along if forward else (-along[0], -along[1])
            signs = [0.0 if i == k else (1.0 if _dot(shares, way) > 0.0 else -1.0)
                     for i, shares in enumerate(_SHARES)]
            pushing, held = _dot(way, b.torques), _holding(b, k, _sliding(ops, b, signs))
            overcome = ops.both(pushing > 0.0, pushing >= _drag(b, along, forward))
            sticks = ops.both(held < b.dry[k].high, held > -b.dry[k].low)
            select(ops.both(overcome, sticks), signs)
            rests = ops.both(rests, ops.negate(overcome))
    select(rests, (0.0,) * len(_SHARES))
    return starts


def _rest_margins(ops: Ops, b: Bodies) -> list[Value]:
    """Return the margins [N.m] against a start along each of _ALONG, either way; above 0 while both bodies rest."""
    margins = []
    for along in _ALONG:
        pushing = _dot(along, b.torques)
        margins.append(ops.minimum(_drag(b, along, True) - pushing, pushing + _drag(b, along, False)))
    return margins


def accelerations(ops: Ops, b: Bodies, signs: Sequence[Value]) -> tuple[Value, Value]:
    """Return d/dt of both speeds [rad/s2], screw and motor; while a clutch sticks, equal to the bit except for sign."""
    sticks = [ops.equal(sign, 0.0) for sign in signs]
    screw, motor = _sliding(ops, b, signs)
    together = (screw + motor) / (b.inertias[0] + b.inertias[1])
    opposite = (screw - motor) / (b.inertias[0] + b.inertias[1])
    first = ops.where(sticks[WITH], together, ops.where(sticks[AGAINST], opposite, screw / b.inertias[0]))
    second = ops.where(sticks[WITH], together, ops.where(sticks[AGAINST], -opposite, motor / b.inertias[1]))
    return ops.where(sticks[SCREW], 0.0, first), ops.where(sticks[MOTOR], 0.0, second)


def friction_torques(ops: Ops, b: Bodies, signs: Sequence[Value]) -> list[Value]:
    """Return the four friction torques [N.m]; not valid while both bodies rest."""
    torques = _sliding(ops, b, signs)
    return [ops.where(sign > 0.0, dry.high, ops.where(sign < 0.0, -dry.low, _holding(b, k, torques)))
            for k, (dry, sign) in enumerate(zip(b.dry, signs, strict=True))]


def margins(ops: Ops, b: Bodies, signs: Sequence[Value], screw: Value, motor: Value) -> dict[str, Value]:
    """Return the event margins by name: speeds [rad/s] of sliding frictions, reserves [N.m] of sticking ones."""
    torques = _sliding(ops, b, signs)
    rests = ops.both(ops.equal(signs[SCREW], 0.0), ops.equal(signs[MOTOR], 0.0))
    still = _rest_margins(ops, b)

    def one(k: int, speed: Value) -> Value:
        held = _holding(b, k, torques)
        sticking = ops.minimum(b.dry[k].high - held, held + b.dry[k].low)
        sliding = ops.where(ops.equal(signs[k], 0.0), sticking, signs[k] * speed)
        return ops.where(rests, still[k], sliding)

    return {NAMES[k]: one(k, speed) for k, speed in enumerate(slips(screw, motor))}


def landed(ops: Ops, signs: Sequence[Value], begin: tuple[Value, Value], end: tuple[Value, Value],
           events: Any) -> tuple[Value, Value]:
    """Return both speeds [rad/s], screw and motor, after a step; if a clutch sticks, equal to the bit except for sign.

    `begin` and `end` are both speeds before and after the step; `events` is true for each margin that fell to 0. A
    friction that slides sticks if its margin fell to 0, or if it would slide against the direction of its start.
    """
    before, after = slips(*begin), slips(*end)

    def sticks(k: int) -> Value:
        sliding = ops.negate(ops.equal(signs[k], 0.0))
        backwards = ops.both(ops.equal(before[k], 0.0), after[k] * signs[k] <= 0.0)
        return ops.where(sliding, ops.either(events[NAMES[k]], backwards), True)

    still, halted = sticks(SCREW), sticks(MOTOR)
    joined, opposed = sticks(WITH), sticks(AGAINST)
    either = ops.either(joined, opposed)
    # Bodies that stick together come to rest together.
    screw = ops.where(ops.either(still, ops.both(either, halted)), 0.0, end[0])
    motor = ops.where(joined, screw, ops.where(opposed, -screw, ops.where(halted, 0.0, end[1])))
    return screw, motor
