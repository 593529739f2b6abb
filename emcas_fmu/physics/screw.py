"""Efficiency of the screw: the share of the load that acts on the rotor.

The axial force F on the screw is a load L = F l at the motor (l: lead per radian). L contains everything on the load
side of the screw and is positive if it resists positive motion. The torque e L acts on the rotor:

    J_r dw/dt = T_m - C_m sgn w - b_m w - e L        J_r of motor and screw; T_m includes other torques on the rotor
    L = J_l dw/dt + L_0                              J_l = m_nut l^2 + J_ft/R^2
    L_0 = C_f sgn w/R + b_f w/R^2 - T_f/R - l P_n - J_ft R'/R^4 w^2
    e = 1/forward where the motor drives the load, L sgn w > 0        e = backward where the load drives the motor

The screw turns (e - 1) L w >= 0 into heat. e L has a kink at L = 0 and no jump. The acceleration is unique while
J_r + e J_l > 0. L then has the sign of J_l net + J_r L_0, with net = T_m - C_m sgn w - b_m w. The load cannot drive a
screw with a backward efficiency of 0 or less.

The efficiencies are parameters, or those of worm and wheel (:mod:`emcas_fmu.physics.worm`) with l = 1 and R = N.
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value
from . import worm
from .loads import fin_inertia
from .mechanics import Mechanics, hinge_damping, hinge_dry, hinge_friction, with_hinge_friction


def lossy(p: Any) -> bool:
    """Return whether the screw has losses."""
    return bool(p.structure.screw_losses)


def falls(p: Any) -> bool:
    """Return whether the screw is a worm, whose efficiencies may depend on the speed."""
    return bool(p.structure.worm)


def constant(ops: Ops, p: Any) -> Value:
    """Return whether the efficiencies of a worm are the same at every speed."""
    return ops.equal(p.worm.static_ratio, 1.0)


def forward(ops: Ops, p: Any, speed: Value = 0.0) -> Value:
    """Return e [-] at a motor speed [rad/s] where the motor drives the load."""
    return 1.0 / worm.forward(ops, p, speed) if p.structure.worm else 1.0 / p.efficiency.forward


def backward(ops: Ops, p: Any, speed: Value = 0.0) -> Value:
    """Return e [-] at a motor speed [rad/s] where the load drives the motor."""
    return worm.backward(ops, p, speed) if p.structure.worm else p.efficiency.backward


def share(ops: Ops, p: Any, transmitted: Value, direction: Value, speed: Value = 0.0) -> Value:
    """Return e [-] for a load `transmitted` [N.m] in motion along `direction`, at a motor speed [rad/s]."""
    return ops.where(transmitted * direction > 0.0, forward(ops, p, speed), backward(ops, p, speed))


def hold(ops: Ops, p: Any, transmitted: Value, direction: Value) -> Value:
    """Return the friction [N.m] at rest that a load `transmitted` [N.m] adds against a start along `direction`."""
    return (share(ops, p, transmitted, direction) - 1.0) * transmitted * direction


def held(ops: Ops, p: Any, m: Mechanics, high: Value, low: Value) -> tuple[Value, Value]:
    """Return the torques [N.m] beyond which a rotor at rest starts: `high` and `low`, each with the load's friction."""
    hinge = hinge_dry(p, m)
    return high + hold(ops, p, hinge - behind(m), 1.0), low - hold(ops, p, -hinge - behind(m), -1.0)


def rotor_inertia(p: Any) -> Value:
    """Return J_r [kg.m2] on the motor's side of the screw."""
    return p.inertia.motor + p.inertia.screw


def nut_inertia(p: Any) -> Value:
    """Return the inertia of the nut in J_l [kg.m2]."""
    return p.mass.nut * p.screw.lead * p.screw.lead


def load_inertia(p: Any, gain: Value) -> Value:
    """Return J_l [kg.m2] of nut and fin behind a rigid line with the `gain` 1/R."""
    return nut_inertia(p) + fin_inertia(p) * (gain * gain)


def behind(m: Mechanics) -> Value:
    """Return the part [N.m] of the external load that acts on the rotor through the screw."""
    return m.load - m.rotor


def load(p: Any, m: Mechanics, speed: Value, direction: Value) -> Value:
    """Return L_0 [N.m] behind a rigid line at a motor speed [rad/s], in motion along `direction`."""
    hinge = direction * hinge_friction(p).dry * m.gain + hinge_damping(p, m) * speed
    return hinge - behind(m) - m.centrifugal * speed * speed


def felt(p: Any, m: Mechanics, e: Value) -> tuple[Any, Mechanics]:
    """Return parameters and coefficients with all terms of the load side multiplied by `e`."""
    inertia = m.inertia + (e - 1.0) * load_inertia(p, m.gain)
    load = e * behind(m) + m.rotor
    return with_hinge_friction(p, e), m._replace(inertia=inertia, load=load, centrifugal=e * m.centrifugal)


def transmitted(ops: Ops, p: Any, net: Value, inertia: Value, at_rest: Value, direction: Value,
                speed: Value = 0.0) -> tuple[Value, Value]:
    """Return L [N.m] and e [-] of a screw that turns at a speed [rad/s], from `net` [N.m], `inertia` J_l [kg.m2] and
    `at_rest` L_0 [N.m]."""
    rotor = rotor_inertia(p)
    weighed = inertia * net + rotor * at_rest
    e = share(ops, p, weighed, direction, speed)
    return weighed / (rotor + e * inertia), e
