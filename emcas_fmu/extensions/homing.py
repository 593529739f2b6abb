"""Homing on the hard stops: a drive with an incremental encoder determines the angle of its fin.

With homing.required the controllers assume at the start that the fin is at zero: the offset of the encoder's counts is
minus the true counts at fin.start_angle. A rising edge of `home` starts a run (:mod:`emcas_fmu.extensions.homing_run`):

    unreferenced -> seeking (one stop) -> crossing (to the other) -> returning (to zero) -> ready
                    any of these -> failed (wrong travel, way back blocked, timeout) or unreferenced (disabled)

Only a ready actuator follows its command. While it is unreferenced or failed, the drive's bridge is open as if the
drive were disabled, whatever reference is still in its delay. The thesis also homes its actuator (section 5.3.1, Figure
5.12), but does not describe the steps.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..actuators.electromechanical.rules import inertias
from ..namespace import Record
from ..ops.base import Ops, Value
from ..physics import drive
from ..physics.friction import coulomb_polynomial
from ..rules import Rule, at_most, rule, when
from ..variables import boolean_input, boolean_output, in_group, parameter, switch
from . import homing_run
from .declaration import Extension
from .status import DISABLED, FAILED, HOMING, OPERATIONAL, STATUS, UNREFERENCED

PARAMETERS = in_group(
    "homing",
    switch("required", "true: the start angle is unknown, and commands are ignored until homed; false: it is known"),
    switch("positive_first", "true: the run begins towards the positive stop; false: towards the negative one"),
    switch("verify", "true: a run also goes to the other stop and checks the travel; false: it trusts the first stall"),
    parameter("speed", "rad/s", radians(0.1), radians(100.0), "mean fin rate during a run"),
    parameter("reference_limit", "V", 1e-3, 1e3, "largest DAC output during a run, and at a stop"),
    parameter("stall_time", "s", 1e-3, 10.0, "time at reference_limit without motion after which the fin is "
              "stalled; also the time at zero that ends the return"),
    parameter("travel_tolerance", "rad", radians(1e-3), radians(20.0),
              "largest difference of the travel between the stops from 2 fin.stop_angle"),
    parameter("return_tolerance", "rad", radians(1e-3), radians(20.0), "distance from zero at which the return ends"),
    parameter("timeout", "s", 1e-2, 1e4, "longest duration of a run"),
)
HOME = boolean_input("home", "a rising edge while enabled and not homing starts a homing run", False)
HOMED = boolean_output("homed", "the controllers know the fin's angle and follow the command when enabled")
# Time [s] to start, to reverse and to settle at zero: an estimate, three times the time of a fin without load.
SETTLES = 0.3


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with an offset of its encoder and the state machine that finds it."""
    def initial(ops: Ops, p: Any, start: Record) -> Values:
        x = Record(**actuator.start(ops, p, start.fin_angle))
        offset = ops.where(p.homing.required, -homing_run.reading(ops, p, actuator.position(ops, p, x), x.counts), 0.0)
        begun = actuator.start(ops, p, start.fin_angle, offset)
        phase = ops.where(p.homing.required, homing_run.UNKNOWN, homing_run.READY)
        return {**begun, "homing_offset": offset, "homing_phase": phase}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        return {**homing_run.sample(ops, p, actuator, x, inputs), "home_before": ops.where(inputs.home, 1.0, 0.0)}

    def powered(ops: Ops, u: PlantInputs) -> PlantInputs:
        return u.replace(enabled=ops.both(u.enabled, homing_run.driven(ops, u.homing_phase)))

    def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        return actuator.step(ops, p, x, powered(ops, u), h)

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        values = actuator.output_values(ops, p, x, powered(ops, u))
        phase = u.homing_phase
        ready = ops.equal(phase, homing_run.READY)
        failed = ops.equal(phase, homing_run.FAILED)
        status = ops.where(ready, values.get(STATUS.name, OPERATIONAL), ops.where(
            homing_run.moving(ops, phase), HOMING, ops.where(failed, FAILED, UNREFERENCED)))
        return {**values, STATUS.name: ops.where(u.enabled, status, DISABLED), HOMED.name: ready}

    return replace(
        actuator, initial=initial, sample=sample, step=step, output_values=output_values,
        controller_states=(*actuator.controller_states, State("home_before"), *map(State, homing_run.HOMING_STATES)),
        sampled_states=(*actuator.sampled_states, State("homing_phase", start=homing_run.READY)),
        further_inputs=(*actuator.further_inputs, HOME))


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    @rule("homing.timeout = %.6g s must be above %.6g s: two ways between the stops, one to zero and 2.5 "
          f"homing.travel_tolerance at homing.speed, 3 homing.stall_time, and {SETTLES:g} s to settle")
    def time(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        # From one stop to the other, back to the first and to zero, each followed by the time of a stall. At a constant
        # motor speed zero is not the middle in time. A way between the stops may be longer by the tolerance.
        stop = p.fin.stop_angle
        if homing_run.run_in_cascade(actuator):
            initial = actuator.equation_parameters(ops, p).kinematics.initial_angle
            zero, high, low = ops.tan(initial), ops.tan(initial + stop), ops.tan(initial - stop)
        else:
            zero, high, low = (actuator.start(ops, p, angle)[actuator.encoder[0]] for angle in (0.0, stop, -stop))
        back = ops.maximum(high - zero, zero - low) / (high - low)
        way = (2.0 + back) * 2.0 * stop + 2.5 * p.homing.travel_tolerance
        least = way / p.homing.speed + 3.0 * p.homing.stall_time + SETTLES
        return when(ops, p.homing.timeout <= least), p.homing.timeout, least

    @rule("homing.stall_time = %.6g s is over before a torque of %.6g N.m at the motor, minus friction of %.6g N.m at "
          "a stop, brings the fin from rest to homing.speed = %.6g rad/s, drive.transport_delay included; raise "
          "homing.stall_time or homing.reference_limit, or lower homing.speed")
    def stall(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        # A motor that accelerates may look stalled. It accelerates for the shortest time at the smallest ratio, d/l.
        p = actuator.equation_parameters(ops, p)
        push, stop, coulomb = drive.stall_torque(p, p.homing.reference_limit), p.fin.stop_angle, p.friction.coulomb
        friction = ops.maximum(coulomb_polynomial(coulomb.positive, stop), coulomb_polynomial(coulomb.negative, -stop))
        load, rotor = inertias(p, 0.0)
        needed = (load + rotor) * p.homing.speed * p.kinematics.moment_arm / p.screw.lead
        lasts = p.homing.stall_time - p.drive.transport_delay
        return when(ops, needed >= lasts * (push - friction)), p.homing.stall_time, push, friction, p.homing.speed

    push = at_most("homing.reference_limit", "drive.reference_limit", "V")
    return (push, time, stall) if homing_run.run_in_cascade(actuator) else (push, time)


EXTENSION = Extension(
    "homing", "homing on the hard stops", extend,
    # A motor current pushes against the stop, and `sample` limits it by drive.reference_limit; initial and sample add
    # encoder_offset to the encoder's counts.
    needs=(capabilities.REFERENCE_LIMIT, capabilities.ENCODER, capabilities.MOTOR_CURRENT, capabilities.POSITION_LOOP),
    parameters=lambda actuator: PARAMETERS, outputs=(STATUS, HOMED), rules=_rules)
