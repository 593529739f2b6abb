"""The nonlinear electromechanical actuator: motor, current-mode drive, ball screw, lever and fin."""

from __future__ import annotations

from typing import Any

from ...control import controllers, sensors
from ...namespace import Record, with_values
from ...ops.base import Ops, Value
from ...physics import drive, friction, kinematics, loads, mechanics
from ...steppers import rigid
from ...steppers.electrical import Motor, states
from .. import fin_port
from ..declaration import Actuator, PlantInputs, SampleInputs, Values
from . import groups, interface, plausibility

# Largest phase [rad] of the drive's integral action in a tick; a step uses the integral at mid-tick.
_INTEGRAL_PHASE = 0.07
MODULES = (kinematics, mechanics, friction, loads, drive, sensors, controllers, rigid)


def initial(ops: Ops, p: Any, start: Record) -> Values:
    """Return the states of plant and controllers at rest at a fin angle."""
    plant = as_built(ops, p)
    angle = kinematics.motor_angle(ops, plant, start.fin_angle)
    motor_counts = sensors.motor_counts(ops, p, angle)
    measured = sensors.measure(ops, p, plant, angle, angle, 0.0, motor_counts, start.encoder_offset)
    return {"motor_angle": angle, "counts": measured.counts, "motor_counts": motor_counts,
            "measured_fin_angle": measured.fin_angle,
            **controllers.at_rest(ops, p, measured, start.fin_angle)._asdict()}


def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
    """Return the reference and the states of the controllers after a sample; while disabled they are held in reset."""
    measured = sensors.measure(ops, p, as_built(ops, p), inputs.position, x.motor_angle, x.motor_speed, x.motor_counts,
                               inputs.encoder_offset)
    observed: Values = {}
    if inputs.observer is not None:
        speed, states = inputs.observer(ops, p, x, measured, x.motor_current)
        measured, observed = measured._replace(motor_speed=speed), states._asdict()
    loops = controllers.Loops(x.integral, x.velocity_integral, x.target, x.momentum)

    def running() -> tuple[Value, ...]:
        out = controllers.sample(ops, p, loops, measured, x.motor_current, inputs.command, inputs.ahead)
        return out.reference, ops.where(out.limited, 1.0, 0.0), *out.loops

    reference, limited, *after = ops.branch(
        inputs.enable, running, lambda: (0.0, 0.0, *controllers.at_rest(ops, p, measured, inputs.command)))
    return {"reference": reference, "counts": measured.counts, "motor_counts": measured.motor_counts,
            "measured_fin_angle": measured.fin_angle, "limited": limited, **controllers.Loops(*after)._asdict(),
            **observed}


def derivatives(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
    """Return d/dt of the states, (2.17), (2.46), (2.47), without dry friction and limits of the drive.

    Viscous friction is the mean of both directions.
    """
    p = as_built(ops, p)
    m = mechanics.coefficients(ops, p, x.motor_angle, u)
    speed, current = x.motor_speed, x.motor_current
    damping = friction.mean_viscous(ops, p) + mechanics.hinge_damping(p, m)
    driving = drive.torque(p, drive.flowing(p, u.reference, current))
    torque = driving + m.load - damping * speed + m.centrifugal * speed * speed
    rise, integral = drive.rates(p, u.reference, speed, current, x.drive_integral)
    return {"motor_angle": speed, "motor_speed": torque / m.inertia, "motor_current": rise, "drive_integral": integral}


def step(ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    """Return the plant's states after `h` [s] or at the first event, and the time [s] until then."""
    plant, used = rigid.advance(ops, as_built(ops, p), states(Motor, x), u, h)
    return plant._asdict(), used


def moment(ops: Ops, p: Any, x: Record, u: PlantInputs) -> tuple[Any, Record]:
    """Return the parameters as built, and the values from which the outputs follow."""
    p = as_built(ops, p)
    voltage, current, clipped = electrical(ops, p, x.motor_speed, x, u)
    return p, interface.moment(ops, p, x, u, x.motor_angle, x.motor_speed, motor_voltage=voltage, motor_current=current,
                               limited=ops.either(clipped > 0.0, u.limited > 0.0))


COMPOSITION = interface.composed(moment, *groups.with_screw(groups.SCREW), groups.LOSSLESS, groups.SHAFT, *groups.SERVO)
as_built = COMPOSITION.as_built


def electrical(ops: Ops, p: Any, speed: Value, x: Record, u: PlantInputs) -> tuple[Value, ...]:
    """Return motor voltage [V] and current [A] at a motor speed [rad/s], and 1 where the drive limits, else 0."""
    if p.structure.current == "ideal":  # the voltage is the one that such a loop needs
        current = ops.where(u.enabled, drive.current_reference(ops, p, u.reference), 0.0)
        over = ops.both(u.enabled, ops.fabs(drive.current_reference_raw(p, u.reference)) > p.drive.current_limit)
        return p.motor.resistance * current + drive.back_emf(p, speed), current, ops.where(over, 1.0, 0.0)
    supply = ops.maximum(u.supply, 0.0)

    def powered() -> tuple[Value, ...]:
        voltage, clipped = drive.applied_voltage(ops, p, u.reference, speed, x.motor_current, x.drive_integral, supply)
        return voltage, x.motor_current, ops.where(clipped, 1.0, 0.0)

    return ops.branch(u.enabled, powered, lambda: (drive.back_emf(p, speed), 0.0, 0.0))


def constant_friction(p: Any) -> Any:
    """Return parameters with viscous and constant Coulomb friction at the motor, both equal in both directions."""
    viscous, coulomb = p.friction.viscous, p.friction.coulomb
    mean = 0.5 * (viscous.positive + viscous.negative)
    constant = (0.5 * (coulomb.positive[0] + coulomb.negative[0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return with_values(p, {
        "friction.viscous.positive": mean, "friction.viscous.negative": mean,
        "friction.coulomb.positive": constant, "friction.coulomb.negative": constant})


def longest_tick(ops: Ops, p: Any) -> Value:
    """Return the largest tick [s] that resolves the current loop's integral action."""
    longest = p.solver.max_tick
    gain = ops.where(p.drive.ki > 0.0, p.drive.ki, 1.0)
    resolved = _INTEGRAL_PHASE * ops.sqrt(p.motor.inductance / gain)
    return ops.where(p.drive.ki > 0.0, ops.minimum(resolved, longest), longest)


ACTUATOR = Actuator(
    **COMPOSITION.declared(plausibility.RULES),
    name="nonlinear",
    title="Nonlinear electromechanical control actuation system: brushless motor, current-mode drive, ball screw, "
          "lever and fin, with position, velocity and current loops",
    origin="The model is that of Ü. Yerlikaya, Dynamic modeling and control of an electromechanical control actuation "
           "system, M.S. thesis, METU, 2016; numbers in brackets are its equations. Where the thesis gives no number, "
           "the default is an engineering estimate, marked as such; it is not a measurement of the thesis's prototype.",
    states=interface.MOTOR_STATES + interface.DRIVE,
    controller_states=interface.CONTROLLER,
    encoder=("motor_angle", "motor_speed"),
    controllers_read=("motor_speed", "motor_current"),
    supply=interface.SUPPLY,
    descriptions=interface.INPUT_DESCRIPTIONS,
    supply_rules=plausibility.SUPPLY_RULES,
    equal_parameters=interface.EQUAL,
    as_built=as_built,
    initial=initial,
    sample=sample,
    derivatives=derivatives,
    step=step,
    longest_tick=longest_tick,
    tick_remedy=interface.TICK_REMEDY,
    transport_delay=fin_port.transport_delay,
    feed_forward=controllers.feed_forward,
    reference="emcas_fmu.reference.plant",
    modules=MODULES,
)
