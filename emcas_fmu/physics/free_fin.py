"""A fin whose shaft is broken at the fork: fin and shaft turn about the hinge between the stops, without a drive.

    (J_fin + J_shaft) d2(delta)/dt2 = T_f - b_f d(delta)/dt - C_f sgn(d(delta)/dt)

T_f is that of (2.27)-(2.45) without the fork; a torsion bar adds its torque.
"""

from __future__ import annotations

from typing import Any

from ..namespace import Record, with_values
from ..ops.base import TINY, Ops, Value
from . import mechanics


def moment(ops: Ops, p: Any, angle: Value, u: Record) -> Value:
    """Return the external moment [N.m] on the broken fin at its angle [rad]."""
    tangent = ops.tan(angle + p.kinematics.initial_angle)
    bar = p.load.torsion_bar * angle if p.structure.torsion_bar else 0.0
    forkless = with_values(p, {"mass.fork": 0.0, "inertia.fork": 0.0})
    return mechanics.external_moment(ops, forkless, tangent, u.replace(aero_torque=u.aero_torque - bar))


def _acceleration(ops: Ops, p: Any, torque: Value, rate: Value, h: Value) -> Value:
    """Return the acceleration [rad/s2] over `h` [s] by the midpoint rule; 0 for a fin at rest that friction holds."""
    dry, viscous = mechanics.hinge_friction(p)
    way = ops.where(rate > 0.0, 1.0, ops.where(rate < 0.0, -1.0, ops.where(torque > 0.0, 1.0, -1.0)))
    net = torque - way * dry
    rests = ops.both(ops.equal(rate, 0.0), ops.fabs(torque) <= dry)
    inertia = p.inertia.fin + p.inertia.shaft + 0.5 * h * viscous
    return ops.where(rests, 0.0, net - viscous * rate) / inertia


def advance(ops: Ops, p: Any, angle: Value, rate: Value, u: Record, h: Value) -> tuple[Value, Value]:
    """Return angle [rad] and rate [rad/s] of the fin after `h` [s] under the loads `u`, within the stops."""
    torque = moment(ops, p, angle + 0.5 * h * rate, u)
    first = _acceleration(ops, p, torque, rate, h)
    turns = rate * (rate + h * first) < 0.0
    until = ops.where(turns, ops.clip(-rate / ops.where(ops.fabs(first) > TINY, first, TINY), 0.0, h), h)
    middle = angle + until * (rate + 0.5 * until * first)
    there = ops.where(turns, 0.0, rate + until * first)
    rest = h - until
    second = ops.where(turns, _acceleration(ops, p, torque, 0.0, rest), 0.0)
    end, speed = middle + 0.5 * rest * rest * second, there + rest * second
    stop = p.fin.stop_angle
    stopped = ops.either(ops.both(end >= stop, speed > 0.0), ops.both(end <= -stop, speed < 0.0))
    return ops.clip(end, -stop, stop), ops.where(stopped, 0.0, speed)
