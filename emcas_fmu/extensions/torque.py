"""Torque out: the fin is a body of the host. Its motion is an input, the actuator's torque about the hinge an output.

    hinge_angle, hinge_rate, fin_command, enable, supply  ->  actuator_torque, armature, and the other outputs

Rotor and fin are rigidly connected, and the rotor's inertia, reflected to the hinge, is usually the larger. A torque
that contains it would be proportional to an acceleration that the host computes from that torque, and would grow from
step to step. The host therefore adds the reflected inertia to the fin's inertia J_f, as the constant `armature`

    A = J_t R(0)^2        J = J_f + A

with the inertia J_t at the motor, and the ratio R(0) of motor to fin speed at fin angle 0. The actuator with its own
fin, the inner fin, runs unchanged. At the beginning of each step of the host, of length h, the inner fin gets the
host's angle and rate, and an estimate T, from the previous step, of all moments on the host's fin except the
actuator's. The torque is constant over the step. It brings the host's fin to the inner fin's rate W at the step's end:

    torque = J (W - w) / h - T        T <- T + J (w' - W) / h        w, w' the host's rate before and after a step

Friction, stops, limits and the lever's ratio are the inner fin's. While it slides and R = R(0), the torque is that of
the motor minus friction, whatever T and J_f are.

A host that integrates by semi-implicit Euler advances the angle by h w': its rate is the mean over the step, which a
smooth motion has half a step before its end. W is then the mean rate of the inner fin, which continues with its rate
plus 3/2 (w' - W), since the difference lasts for another half step. The host's angles and rates show whether the host
integrates in this way. The fin of any other host may pass a stop by its motion in a step; it then returns by a third of
the remaining way in each step, without overshoot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..errors import EmcasError
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import kinematics, loads, mechanics
from ..rules import rule, when
from ..variables import real_input, real_output
from .declaration import Extension

HINGE_ANGLE = real_input("hinge_angle", "rad", "angle of the host's fin about its hinge, at the beginning of the "
                         "step", nominal=0.1)
HINGE_RATE = real_input("hinge_rate", "rad/s", "angular rate of the host's fin, at the beginning of the step",
                        nominal=1.0)
OUTPUTS = (
    real_output("actuator_torque", "N.m", "torque of the actuator on the host's fin, constant over the step, positive "
                "along positive fin angle; without the torque that accelerates the armature", 100.0),
    real_output("armature", "kg.m2", "constant inertia of motor and screw or worm about the hinge, which the host adds "
                "to the fin's", 1.0, minimum=0.0),
)
_BEFORE = -1.0  # s, `step_met` before the first step
STATES = (State("step_met", "s", "beginning of the step to which the states belong"),
          State("elapsed", "s", "time since step_met"),
          State("host_angle", "rad", "angle of the host's fin at step_met"), State("host_rate", "rad/s"),
          State("host_load", "N.m", "moments on the host's fin except the actuator's"),
          State("rate_is_mean", "1", "1 if the host integrates by semi-implicit Euler, otherwise 0"))
_CHANGED = 1e-9  # rad/s, smallest change of rate from which the host's integration is recognized; far above rounding
_RETURN = 1.0 / 3.0  # share of the way back to a stop in a step; there is no overshoot up to 6 - 4 sqrt(2) = 0.343


def _ratio(ops: Ops, p: Any, motor_angle: Value) -> Value:
    return kinematics.reduction_ratio(ops, p, kinematics.lever_tangent(ops, p, motor_angle))


def armature(ops: Ops, p: Any) -> Value:
    """Return the inertia [kg.m2] that turns with the motor, about the hinge at fin angle 0; `p` are those as built."""
    ratio = _ratio(ops, p, kinematics.motor_angle(ops, p, 0.0))
    return mechanics.screw_inertia(p) * ratio * ratio


def _inertia(ops: Ops, p: Any) -> Value:
    """Return the inertia [kg.m2] of the host's fin with the armature."""
    return loads.fin_inertia(p) + armature(ops, p)


def _extend(actuator: Actuator) -> Actuator:
    if "fin_broken_off" in {s.name for s in actuator.states}:
        raise EmcasError(f"model {actuator.name}: a fault breaks the fin off, but with torque out the fin is the "
                         "host's; leave +faults out")

    def loaded(x: Record, u: PlantInputs) -> PlantInputs:
        """Return the plant's inputs with the moment on the host's fin, which includes that of the vehicle's motion."""
        return u.replace(**{**dict.fromkeys(loads.LOADS, 0.0), "aero_torque": x.host_load})

    def within(ops: Ops, p: Any, angle: Value) -> Value:
        return ops.clip(angle, -p.fin.stop_angle, p.fin.stop_angle)

    def reached(ops: Ops, p: Any, x: Record) -> tuple[Value, Value, Value]:
        """Return the expected rates [rad/s] of the host's fin and the inner fin, and 1/elapsed time [1/s]."""
        tangent = kinematics.lever_tangent(ops, p, x.motor_angle)
        rate = x.motor_speed / kinematics.reduction_ratio(ops, p, tangent)
        per_time = ops.where(x.elapsed > 0.0, 1.0 / ops.where(x.elapsed > 0.0, x.elapsed, 1.0), 0.0)
        mean = (kinematics.fin_angle(ops, p, tangent) - x.host_angle) * per_time
        back = _RETURN * (within(ops, p, x.host_angle) - x.host_angle) * per_time
        return ops.where(x.rate_is_mean > 0.0, mean, rate + back), rate, per_time

    def met(ops: Ops, p: Any, x: Record, u: Any) -> Record:
        """Return the states; at the beginning of a step of the host they get the motion of the host's fin."""
        built = actuator.plant_parameters(ops, p)

        def begun() -> tuple[Value, ...]:
            expected, rate, per_time = reached(ops, built, x)
            known = ops.negate(ops.equal(x.step_met, _BEFORE))
            difference = ops.where(known, u.hinge_rate - expected, 0.0)
            advance = (u.hinge_angle - x.host_angle) * per_time
            mean = 0.5 * (x.host_rate + u.hinge_rate)
            euler, exact = ops.fabs(advance - u.hinge_rate), ops.fabs(advance - mean)
            changes = ops.both(known, ops.fabs(u.hinge_rate - x.host_rate) > _CHANGED)
            is_mean = ops.where(changes, ops.where(euler < exact, 1.0, 0.0), x.rate_is_mean)
            rate = ops.where(known, rate + ops.where(x.rate_is_mean > 0.0, 1.5, 1.0) * difference, u.hinge_rate)
            angle = kinematics.motor_angle(ops, built, within(ops, built, u.hinge_angle))
            return (angle, rate * _ratio(ops, built, angle), u.step_begin, 0.0, u.hinge_angle, u.hinge_rate,
                    x.host_load + _inertia(ops, built) * difference * per_time, is_mean)

        names = ("motor_angle", "motor_speed", *(s.name for s in STATES))
        kept = tuple(getattr(x, name) for name in names)
        values = ops.branch(ops.equal(u.step_begin, x.step_met), lambda: kept, begun)
        return x.replace(**dict(zip(names, values, strict=True)))

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        return {**actuator.start(ops, p, start.fin_angle, start.encoder_offset), "step_met": _BEFORE,
                "host_angle": start.fin_angle, "rate_is_mean": 1.0}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        x = met(ops, p, x, inputs)
        return actuator.sampled(ops, p, x, inputs.replace(position=actuator.position(ops, p, x)))

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        x = met(ops, p, x, u)
        moved, used = actuator.step(ops, p, x, loaded(x, u), h)
        return {**vars(x), **moved, "elapsed": x.elapsed + used}, used

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        built = actuator.plant_parameters(ops, p)
        expected, _, per_time = reached(ops, built, x)
        torque = _inertia(ops, built) * (expected - x.host_rate) * per_time - x.host_load
        return {**actuator.output_values(ops, p, x, loaded(x, u)),
                "actuator_torque": torque, "armature": armature(ops, built)}

    described = {"hinge_torque": "moment on the host's fin, except the actuator's, estimated from its motion",
                 "fin_angle": "fin angle at the end of the step, predicted at its beginning",
                 "fin_rate": "fin angular rate at the end of the step, predicted at its beginning"}
    return replace(
        actuator, states=(*actuator.states, *STATES), initial=initial, sample=sample, step=step,
        output_values=output_values, derivatives=None,
        outputs=fin_port.described(described, actuator.outputs),
        further_inputs=(*actuator.further_inputs, HINGE_ANGLE, HINGE_RATE, fin_port.STEP_BEGIN),
        hidden=frozenset(v.name for v in (fin_port.AERO_TORQUE, *fin_port.VEHICLE_MOTION, fin_port.STEP_BEGIN)))


@rule("loads.gravity is true, but the fin's weight is the host's; set loads.gravity to false")
def _weight(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    return (when(ops, p.loads.gravity),)


EXTENSION = Extension(
    "torque", "torque out, the fin is the host's", _extend,
    needs=(capabilities.RIGID_DRIVE_LINE, capabilities.SCREW_DRIVE), outputs=OUTPUTS, rules=lambda actuator: (_weight,))
