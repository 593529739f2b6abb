"""Two degrees of freedom: a trajectory generator, and feed-forward where the actuator has one.

The command is shaped to a motion within limits of rate, acceleration and jerk (:mod:`emcas_fmu.control.trajectory`). An
actuator with a feed-forward (`feed_forward` of its declaration) adds the reference that causes this motion, by the
inverse of its plant. That acts some milliseconds later, so the position loop follows the motion as it was that long
ago, with a setpoint weight of 1 and its rate fed forward. Feedback is left with what the model does not explain, and
may have the gains of a robust loop. The controllers of other actuators follow the motion as their command.

With trajectory.natural_frequency = 0 the actuator is unchanged. The motion begins where the fin is, at rest: at the
start, whenever the drive is enabled, and after homing.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, SampleInputs, State, Values
from ..control import controllers, trajectory
from ..namespace import Record, value_of, with_values
from ..ops.base import Ops, Value
from ..rules import Rule, rule, when
from ..variables import in_group, tunable
from . import homing_run
from .declaration import Extension

PARAMETERS = in_group(
    "trajectory",
    tunable("natural_frequency", "rad/s", 0.0, 1e4, "natural frequency of the motion to a command (0: none)",
            quantity="AngularFrequency"),
    tunable("damping", "1", 0.1, 10.0, "damping of that motion"),
    tunable("rate_limit", "rad/s", radians(0.1), 1e3, "largest fin rate of that motion", display="deg/s"),
    tunable("acceleration_limit", "rad/s2", 1e-3, 1e6, "largest acceleration of that motion"),
    tunable("jerk_limit", "rad/s3", 1.0, 1e12, "fastest change of that acceleration"),
)
TRACKING = in_group("trajectory", tunable("tracking_limit", "rad", radians(1e-3), 10.0,
                                          "angle of the fin behind that motion beyond which this slows down"))
"""Parameters beside PARAMETERS of actuators with a feed-forward."""
_LINE = tuple(f"trajectory_angle_{k}" for k in range(trajectory.LONGEST + 1))
_RESTING = ("trajectory_rate", "trajectory_acceleration", "trajectory_memory", "trajectory_slowed")
_ALONE = {"controller.position.setpoint_weight": 1.0, "controller.position.velocity_feedforward": 1.0,
          "command.update_time": 0.0}
"""Parameters of controllers that follow a motion whose rate is fed forward at every sample."""


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator whose controllers follow a generated motion."""
    def initial(ops: Ops, p: Any, start: Record) -> Values:
        begun = actuator.start(ops, p, start.fin_angle, start.encoder_offset)
        return {**begun, **_resting(begun["measured_fin_angle"])}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        return _sample(ops, p, actuator, x, inputs)

    return replace(actuator, initial=initial, sample=sample,
                   controller_states=(*actuator.controller_states, *map(State, (*_RESTING, *_LINE))))


def _resting(angle: Value) -> dict[str, Value]:
    return {**dict.fromkeys(_RESTING, 0.0), **dict.fromkeys(_LINE, angle)}


def _sample(ops: Ops, p: Any, actuator: Actuator, x: Record, inputs: SampleInputs) -> dict[str, Value]:
    on = p.trajectory.natural_frequency > 0.0
    follows = ops.both(on, inputs.enable)
    if hasattr(x, "homing_phase"):
        follows = ops.both(follows, ops.equal(x.homing_phase, homing_run.READY))
    angles = tuple(getattr(x, name) for name in _LINE)
    motion = trajectory.move(ops, p, angles[0], x.trajectory_rate, x.trajectory_acceleration,
                             controllers.clipped_command(ops, p, inputs.command))
    memory, followed, q = 0.0, motion.next_angle, p
    if actuator.feed_forward is not None:
        ahead, memory, time = actuator.feed_forward(ops, p, motion, x.trajectory_memory)
        followed = trajectory.delayed(ops, time / p.controller.sample_time, angles)
        inputs = inputs.replace(ahead=ahead._replace(active=follows))
        declared = {v.name for v in actuator.parameters}
        q = with_values(p, {name: ops.where(on, value, value_of(p, name)) for name, value in _ALONE.items()
                            if name in declared})
        if (gain := "controller.position.ki") in declared:
            held = ops.both(on, x.trajectory_slowed > 0.0)
            q = with_values(q, {gain: ops.where(held, 0.0, p.controller.position.ki)})
    out = actuator.sampled(ops, q, x, inputs.replace(command=ops.where(on, followed, inputs.command)))
    excess, slowed = 0.0, 0.0
    if actuator.feed_forward is not None:
        excess, slowed = trajectory.excess(ops, p, motion, followed - out["measured_fin_angle"])
    values = (trajectory.slowed(p, motion, excess), motion.acceleration, memory, slowed)
    line = (motion.next_angle, *angles[:-1])
    moved = {**dict(zip(_RESTING, values, strict=True)),
             **{name: angle - excess for name, angle in zip(_LINE, line, strict=True)}}
    rests = _resting(out["measured_fin_angle"])
    return {**out, **{name: ops.where(follows, value, rests[name]) for name, value in moved.items()}}


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    if (feed_forward := actuator.feed_forward) is None:
        return ()

    @rule("controller.sample_time = %.6g s: a reference acts after %.6g s, longer than the "
          f"{trajectory.LONGEST} samples by which the extension trajectory delays a motion; raise the sample time")
    def delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        rest = trajectory.Motion(0.0, 0.0, 0.0, 0.0, 0.0)
        time = feed_forward(ops, p, rest, 0.0)[2]
        return when(ops, time > trajectory.LONGEST * p.controller.sample_time), p.controller.sample_time, time

    return (delay,)


EXTENSION = Extension(
    "trajectory", "trajectory generator and feed-forward", extend, needs=(capabilities.POSITION_LOOP,),
    parameters=lambda actuator: PARAMETERS if actuator.feed_forward is None else PARAMETERS + TRACKING, rules=_rules,
    references=("emcas_fmu.reference.simulate",))
