"""The second-order actuator of many flight simulations, with limits of rate and position.

    d2(delta)/dt2 = w_n^2 (delta_c - delta) - 2 zeta w_n d(delta)/dt        |d(delta)/dt| <= r    |delta| <= stop

No load moves it. Between the limits it is solved exactly; at the rate limit it moves at that rate until the
linear equation takes it off, and a stop takes its speed away. ``drive.transport_delay`` delays the command, which
is taken at the samples. What belongs to a motor is 0 but for angles and speed, which the kinematics give.
"""

from __future__ import annotations

from typing import Any

from .. import control
from ..ops.base import Ops, Value
from ..physics import kinematics, mechanics
from ..variables import Variable
from . import nonlinear

TITLE = "second-order actuator with limits of rate and position"
PLANT = ("fin angle", "fin rate")
OWN = (
    Variable("second_order.natural_frequency", "Real", "parameter", "fixed", "rad/s", "natural frequency, w_n",
             1e-3, 1e5),
    Variable("second_order.damping", "Real", "parameter", "fixed", "1", "damping ratio, zeta", 0.0, 100.0),
    Variable("second_order.rate_limit", "Real", "parameter", "fixed", "rad/s", "largest fin rate", 1e-6, 1e6),
)
DESCRIPTIONS = {
    "enable": "false: the fin stands where it is, whatever the load",
    "aero_torque": "aerodynamic hinge moment on the fin; moves nothing, and is told in hinge_torque",
    "motor_angle": "motor angle that the kinematics give for the fin's",
    "motor_speed": "motor speed that the kinematics give for the fin's rate",
    "measured_fin_angle": "fin angle at the last sample",
    "saturated": "a limit active: command or rate",
}
# Of the damping from 1, relative: closer the two roots are one to the closed form.
_DOUBLE = 1e-9


def initial(ops: Ops, p: Any) -> tuple[Value, ...]:
    """At rest at fin.start_angle: angle, rate, integral and counts (none), fin angle measured."""
    return p.fin.start_angle, 0.0, 0.0, 0.0, p.fin.start_angle


def sample(ops: Ops, p: Any, angle: Value, rate: Value, integral: Value, counts: Value, command: Value,
           enable: Value) -> tuple[Value, ...]:
    """The command [rad] on its way; a disabled fin's is where it stands."""
    reference = ops.where(enable, control.clipped_command(ops, p, command), angle)
    limited = ops.where(ops.fabs(command) > p.command.limit, 1.0, 0.0)
    return reference, 0.0, 0.0, angle, ops.where(enable, limited, 0.0)


forces = nonlinear.forces


def _free(ops: Ops, p: Any, angle: Value, rate: Value, target: Value, h: Value) -> tuple[Value, ...]:
    """Angle and rate after h [s] without limits, exactly."""
    w, zeta = p.second_order.natural_frequency, p.second_order.damping
    x = angle - target
    split = 1.0 - zeta * zeta
    split = ops.where(ops.fabs(split) > _DOUBLE, split, _DOUBLE)
    root = w * ops.sqrt(ops.fabs(split))
    decay = ops.exp(-zeta * w * h)

    def oscillating() -> tuple[Value, ...]:
        return decay * ops.cos(root * h), decay * ops.sin(root * h) / root

    def creeping() -> tuple[Value, ...]:
        # Each exponential apart: their product with the decay would overflow first.
        slow, fast = ops.exp((root - zeta * w) * h), ops.exp(-(root + zeta * w) * h)
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / root

    c, s = ops.branch(split > 0.0, oscillating, creeping)
    return target + c * x + s * (rate + zeta * w * x), c * rate - s * (zeta * w * rate + w * w * x)


def step(ops: Ops, p: Any, angle: Value, rate: Value, reference: Value, aero_torque: Value, f_x: Value, f_z: Value,
         supply: Value, enable: Value, h: Value) -> tuple[Value, ...]:
    """Angle and rate after h [s], and h: events within a step are met to its order, the second.

    Disabled, the fin stands at once and stays, whatever command is on its way.
    """
    return ops.branch(enable, lambda: _driven(ops, p, angle, rate, reference, h), lambda: (angle, 0.0, h))


def _driven(ops: Ops, p: Any, angle: Value, rate: Value, reference: Value, h: Value) -> tuple[Value, ...]:
    limit, stop = p.second_order.rate_limit, p.fin.stop_angle
    free_angle, free_rate = _free(ops, p, angle, rate, reference, h)
    slewing = ops.fabs(free_rate) > limit
    new_rate = ops.clip(free_rate, -limit, limit)
    # The mean rate, with the time at the limit as the line between both rates has it.
    share = ops.where(slewing, ops.clip((ops.fabs(free_rate) - limit)
                                        / ops.maximum(ops.fabs(free_rate - rate), 1e-300), 0.0, 1.0), 0.0)
    mean = (1.0 - share) * 0.5 * (rate + new_rate) + share * new_rate
    new_angle = ops.where(slewing, angle + h * mean, free_angle)
    beyond = ops.fabs(new_angle) >= stop
    outward = new_rate * new_angle > 0.0
    return (ops.clip(new_angle, -stop, stop), ops.where(ops.both(beyond, outward), 0.0, new_rate), h)


def outputs(ops: Ops, p: Any, angle: Value, rate: Value, active: Value, reference: Value, measured: Value,
            limited: Value, command: Value, aero_torque: Value, f_x: Value, f_z: Value, supply: Value,
            enable: Value) -> tuple[Value, ...]:
    """Every output, in the order of the variable table."""
    motor = kinematics.motor_angle(ops, p, angle)
    tangent = kinematics.lever_tangent(ops, p, motor)
    at_rate = ops.fabs(rate) >= p.second_order.rate_limit * (1.0 - 1e-12)
    return (
        angle,
        rate,
        motor,
        rate * kinematics.reduction_ratio(ops, p, tangent),
        0.0,
        0.0,
        0.0,
        0.0,
        kinematics.nut_position(ops, p, motor),
        mechanics.external_moment(ops, p, tangent, aero_torque, f_x, f_z),
        0.0,
        control.clipped_command(ops, p, command) - angle,
        measured,
        ops.either(at_rate, limited > 0.0),
        ops.fabs(angle) >= p.fin.stop_angle * (1.0 - 1e-12),
    )
