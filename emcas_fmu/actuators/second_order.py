"""The second-order actuator of many flight simulations, with limits of rate and position.

    d2(delta)/dt2 = w_n^2 (delta_c - delta) - 2 zeta w_n d(delta)/dt        |d(delta)/dt| <= r    |delta| <= stop

delta is the fin angle, delta_c the command, sampled and delayed by ``drive.transport_delay``, r the rate limit. No load
moves the fin. Between the limits the solution is exact; at the rate limit the fin moves at that rate until the linear
equation slows it down, and a stop brings it to rest.
"""

from __future__ import annotations

import sys
from typing import Any

from ..namespace import Record
from ..ops.base import Ops, Value
from ..variables import parameter
from . import capabilities, fin_port
from .composition import Composition, Group, port
from .declaration import FIN, Actuator, PlantInputs, SampleInputs, Values

PARAMETERS = (
    parameter("drive.transport_delay", "s", 0.0, 0.1, "delay from the sampled command to the fin",
              sheet="specification: delay of the actuator", display="ms"),
    parameter("second_order.natural_frequency", "rad/s", 1e-3, 1e5, "natural frequency, w_n",
              sheet="specification: natural frequency of the actuator", quantity="AngularFrequency"),
    parameter("second_order.damping", "1", 0.0, 100.0, "damping ratio, zeta",
              sheet="specification: damping ratio of the actuator"),
    parameter("second_order.rate_limit", "rad/s", 1e-6, 1e6, "largest fin rate",
              sheet="specification: largest fin rate"),
)
# Smallest |1 - zeta^2|: nearer to the double root, zeta = 1, the closed form uses this value.
_DOUBLE = 1e-9


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference [rad]: the clipped command or, while disabled, the fin angle."""
    command = fin_port.clipped_command(ops, p, inputs.command)
    limited = ops.where(ops.fabs(inputs.command) > p.command.limit, 1.0, 0.0)
    return {"reference": ops.where(inputs.enable, command, x.fin_angle),
            "limited": ops.where(inputs.enable, limited, 0.0)}


def _free(ops: Ops, p: Any, angle: Value, rate: Value, target: Value, h: Value) -> tuple[Value, ...]:
    """Return angle [rad] and rate [rad/s] after `h` [s] without limits, exactly."""
    w, zeta = p.second_order.natural_frequency, p.second_order.damping
    x = angle - target
    split = 1.0 - zeta * zeta
    split = ops.where(ops.fabs(split) > _DOUBLE, split, _DOUBLE)
    root = w * ops.sqrt(ops.fabs(split))
    decay = ops.exp(-zeta * w * h)

    def underdamped() -> tuple[Value, ...]:
        return decay * ops.cos(root * h), decay * ops.sin(root * h) / root

    def overdamped() -> tuple[Value, ...]:
        # Two exponentials, since the hyperbolic functions of root * h would overflow.
        slow, fast = ops.exp((root - zeta * w) * h), ops.exp(-(root + zeta * w) * h)
        return 0.5 * (slow + fast), 0.5 * (slow - fast) / root

    c, s = ops.branch(split > 0.0, underdamped, overdamped)
    return target + c * x + s * (rate + zeta * w * x), c * rate - s * (zeta * w * rate + w * w * x)


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the fin's states after `h` [s], and `h`: events do not end a step, and their error is of second order.

    A disabled fin comes to rest at once and stays at rest, even if delayed commands arrive.
    """
    angle, rate = ops.branch(u.enabled, lambda: _driven(ops, p, x.fin_angle, x.fin_rate, u.reference, h),
                             lambda: (x.fin_angle, 0.0))
    return {"fin_angle": angle, "fin_rate": rate}, h


def _driven(ops: Ops, p: Any, angle: Value, rate: Value, reference: Value, h: Value) -> tuple[Value, ...]:
    limit, stop = p.second_order.rate_limit, p.fin.stop_angle
    free_angle, free_rate = _free(ops, p, angle, rate, reference, h)
    slewing = ops.fabs(free_rate) > limit
    new_rate = ops.clip(free_rate, -limit, limit)
    # The share of the step at the limit follows from linear interpolation between both rates.
    share = ops.where(slewing, ops.clip((ops.fabs(free_rate) - limit)
                                        / ops.maximum(ops.fabs(free_rate - rate), 1e-300), 0.0, 1.0), 0.0)
    mean = (1.0 - share) * 0.5 * (rate + new_rate) + share * new_rate
    new_angle = ops.where(slewing, angle + h * mean, free_angle)
    beyond = ops.fabs(new_angle) >= stop
    outward = new_rate * new_angle > 0.0
    return (ops.clip(new_angle, -stop, stop), ops.where(ops.both(beyond, outward), 0.0, new_rate))


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters, and the values from which the outputs follow."""
    at_rate = ops.fabs(x.fin_rate) >= p.second_order.rate_limit * (1.0 - 1e-12)
    return p, fin_port.at_fin(ops, p, x, u, ops.either(at_rate, u.limited > 0.0))


COMPOSITION = Composition((
    port(measured_fin_angle="fin angle at the last sample", saturated="a limit is active: command or rate"),
    Group(PARAMETERS, provides=(capabilities.COMMAND_REFERENCE,), terminal="")), moment)
ACTUATOR = Actuator(
    **COMPOSITION.declared(),
    name="second-order",
    title="second-order actuator with limits of rate and position",
    origin="No load moves the fin: hinge moment, gravity and the vehicle's motion appear in hinge_torque alone. There "
           "is no motor and no supply.",
    states=FIN,
    descriptions={
        "enable": "false: the fin stays where it is, whatever the load",
        "angular_acceleration.x": "vehicle angular acceleration about body x; has no effect",
        "aero_torque": "aerodynamic hinge moment on the fin; part of hinge_torque, but does not move the fin",
    },
    sample=sample,
    step=step,
    transport_delay=fin_port.transport_delay,
    without_effect=frozenset({"aero_torque"}),
    modules=(sys.modules[__name__],),
)
