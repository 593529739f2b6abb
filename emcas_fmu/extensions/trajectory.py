"""Two degrees of freedom: a trajectory generator, and feed-forward where the actuator has one.

The command becomes a motion within limits of rate, acceleration and jerk (:mod:`emcas_fmu.control.trajectory`). An
actuator with a feed-forward (`feed_forward` of its declaration) adds to its reference the one that this motion needs,
computed with the inverse plant model. The reference acts some milliseconds later, so the position loop follows the
motion delayed by that time, with a setpoint weight of 1 and its rate fed forward. The feedback only corrects what the
model does not explain, and may have the gains of a robust loop. The controllers of other actuators follow the motion as
their command.

With trajectory.natural_frequency = 0 the actuator is unchanged. The motion begins at rest at the measured fin
angle: at the start, whenever the drive is enabled, and after homing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import radians
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, SampleInputs, State, Values
from ..control import controllers, trajectory
from ..control.trajectory import Ahead
from ..namespace import Record, with_values_where
from ..ops.base import Ops, Value
from ..rules import SLACK, Rule, rule, when
from ..variables import in_group, parameter, tunable
from . import homing_run
from .declaration import Extension

PARAMETERS = in_group(
    "trajectory",
    parameter("natural_frequency", "rad/s", 0.0, 1e4, "natural frequency of the generated motion (0: none)",
              quantity="AngularFrequency"),
    tunable("damping", "1", 0.1, 10.0, "damping of the generated motion"),
    tunable("rate_limit", "rad/s", radians(0.1), 1e3, "largest fin rate of the generated motion", display="deg/s"),
    tunable("acceleration_limit", "rad/s2", 1e-3, 1e6, "largest acceleration of the generated motion"),
    tunable("jerk_limit", "rad/s3", 1.0, 1e12, "largest change of that acceleration with time"),
)
TRACKING = in_group("trajectory", tunable("tracking_limit", "rad", radians(0.01), 10.0,
                                          "lag of the fin behind the generated motion beyond which this slows down"))
"""The additional parameter of actuators that slow the motion down: those with feed-forward and a position integral."""
_LINE = tuple(f"trajectory_angle_{k}" for k in range(trajectory.LONGEST_LAG + 1))
_RESTING = ("trajectory_rate", "trajectory_acceleration", "trajectory_memory", "trajectory_lost",
            "trajectory_overload")
_ALONE = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 1.0,
          "command.update_time": 0.0}
"""Parameters of controllers that follow a motion with its rate fed forward at every sample."""
_INTEGRAL = "controller.position.ki"
_INTEGRALS = (_INTEGRAL, "controller.velocity.ki")
_NONE = 1e-12  # lost share of a sample's travel up to which the loops still integrate; rounding leaves less


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator whose controllers follow a generated motion."""
    def initial(ops: Ops, p: Any, start: Record) -> Values:
        alone = _alone(ops, p, actuator, p.trajectory.natural_frequency > 0.0)
        begun = actuator.start(ops, alone, start.fin_angle, start.encoder_offset)
        return {**begun, **_resting(begun["measured_fin_angle"])}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        return _sample(ops, p, actuator, x, inputs)

    return replace(actuator, initial=initial, sample=sample,
                   controller_states=(*actuator.controller_states, *map(State, (*_RESTING, *_LINE))))


def _resting(angle: Value) -> dict[str, Value]:
    return {**dict.fromkeys(_RESTING, 0.0), **dict.fromkeys(_LINE, angle)}


def _changed(ops: Ops, p: Any, actuator: Actuator, when: Value, values: Mapping[str, Value]) -> Any:
    """Return the parameters, changed where `when` holds to those of `values` that the actuator has."""
    declared = {v.name for v in actuator.parameters}
    return with_values_where(ops, when, p, {name: value for name, value in values.items() if name in declared})


def _alone(ops: Ops, p: Any, actuator: Actuator, on: Value) -> Any:
    return p if actuator.feed_forward is None else _changed(ops, p, actuator, on, _ALONE)


def _sample(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs) -> dict[str, Value]:
    on = p.trajectory.natural_frequency > 0.0
    follows = ops.both(on, inputs.enable)
    if hasattr(x, "homing_phase"):
        follows = ops.both(follows, ops.equal(x.homing_phase, homing_run.READY))
    limit, angles = p.command.limit, tuple(getattr(x, name) for name in _LINE)
    motion = trajectory.move(ops, p, angles[0], x.trajectory_rate, x.trajectory_acceleration,
                             controllers.clipped_command(ops, p, inputs.command))
    memory, followed, q = 0.0, motion.next_angle, _alone(ops, p, actuator, on)
    if actuator.feed_forward is not None:
        ahead, memory, time = actuator.feed_forward(ops, p, motion, x.trajectory_memory)
        followed = trajectory.delayed(ops, time / p.controller.sample_time, angles)
        # While the motion is slowed, only the remaining share is fed forward, and the loops do not integrate the error,
        # unless the motion stands still.
        before = x.trajectory_lost
        left = 1.0 - before
        inputs = inputs.replace(ahead=Ahead(left * ahead.speed, left * ahead.reference, follows))
        held = ops.both(on, ops.both(before > _NONE, before < 1.0))
        q = _changed(ops, q, actuator, held, dict.fromkeys(_INTEGRALS, 0.0))
    followed = ops.clip(followed, -limit, limit)
    out = actuator.sampled(ops, q, x, inputs.replace(command=ops.where(on, followed, inputs.command)))
    excess, lost, overload = 0.0, 0.0, 0.0
    if _slows(actuator):
        distance, slows = followed - out["measured_fin_angle"], p.controller.position.ki > 0.0
        if capabilities.SCREW_EQUATIONS in actuator.provides:
            observes = p.controller.load_observer > 0.0
            slows = ops.either(slows, observes)
            integral, overload = trajectory.integral(
                ops, p, distance, out["limited"], x.trajectory_overload, x.integral, out["integral"])
            out["integral"] = ops.where(ops.both(follows, observes), integral, out["integral"])
        # Without integral and observer a load leaves a steady error, which would slow every motion.
        excess, lost = (ops.where(slows, value, 0.0) for value in trajectory.excess(ops, p, motion, distance))
    values = (trajectory.slowed(motion, lost), motion.acceleration, memory, lost, overload)
    line = (motion.next_angle, *angles[:-1])
    moved = {**dict(zip(_RESTING, values, strict=True)),
             **{name: angle - excess for name, angle in zip(_LINE, line, strict=True)}}
    rests = _resting(out["measured_fin_angle"])
    limited = ops.where(ops.both(follows, ops.fabs(inputs.command) > limit), 1.0, out["limited"])
    return {**out, "limited": limited,
            **{name: ops.where(follows, value, rests[name]) for name, value in moved.items()}}


def _slows(actuator: Actuator) -> bool:
    return actuator.feed_forward is not None and _INTEGRAL in {v.name for v in actuator.parameters}


@rule("trajectory.jerk_limit = %.6g rad/s3 must be at least %.6g rad/s3 (1.5 times acceleration_limit times "
      "natural_frequency), or the motion brakes too late")
def _jerk(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    t = p.trajectory
    least = 1.5 * t.acceleration_limit * t.natural_frequency
    return when(ops, t.jerk_limit < least * (1.0 - SLACK)), t.jerk_limit, least


@rule("trajectory.natural_frequency = %.6g rad/s with trajectory.damping = %.6g is too fast for samples of "
      "controller.sample_time = %.6g s: the product of the three must be at most 0.5")
def _sampled(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    t, period = p.trajectory, p.controller.sample_time
    fast = 2.0 * t.damping * t.natural_frequency * period
    return when(ops, fast > 1.0 + SLACK), t.natural_frequency, t.damping, period


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    if (feed_forward := actuator.feed_forward) is None:
        return _jerk, _sampled

    @rule("controller.sample_time = %.6g s: a reference acts after %.6g s, longer than the extension "
          f"trajectory can delay a motion, {trajectory.LONGEST_LAG} samples; raise the sample time")
    def delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        rest = trajectory.Motion(0.0, 0.0, 0.0, 0.0, 0.0)
        time = ops.where(p.trajectory.natural_frequency > 0.0, feed_forward(ops, p, rest, 0.0)[2], 0.0)
        return when(ops, time > trajectory.LONGEST_LAG * p.controller.sample_time), p.controller.sample_time, time

    return _jerk, _sampled, delay


EXTENSION = Extension(
    "trajectory", "trajectory generator and feed-forward", extend, needs=(capabilities.POSITION_LOOP,),
    parameters=lambda actuator: PARAMETERS + TRACKING if _slows(actuator) else PARAMETERS, rules=_rules,
    references=("emcas_fmu.reference.plant",), command_switch="trajectory.natural_frequency")
