"""Errors of the sensors: the drive's current sensor, and the encoder of position (:mod:`.control.sensor_errors`).

Only actuators with a current limit and a current loop that the package's drive equations step have the current sensor.
The encoder with errors is the one that measures the position. If it is the motor's, the speed has the error's rate of
change. If it is the fin's (`encoder.on_fin`), the motor's encoder, which then measures the speed, is exact. Speed that
is fed back without counts (`encoder.enabled` = false) has no noise. `heat` computes the current within a tick as if the
sensor were exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf, pi
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..control import command_bus, sensor_errors
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..physics import kinematics
from ..rules import rule, when
from ..variables import in_group, integer_parameter, parameter
from .declaration import Extension

ENCODER = in_group(
    "sensor.encoder",
    *(each for name in ("once", "twice") for each in (
        parameter(name, "rad", 0.0, 0.1, f"amplitude of the encoder's error that repeats {name} per turn of its shaft",
                  sheet="encoder: accuracy as mounted, a peak value at its shaft"),
        parameter(f"{name}_phase", "rad", -2.0 * pi, 2.0 * pi,
                  f"phase, at angle 0, of the error that repeats {name} per turn"))),
    parameter("noise", "rad", 0.0, 0.1, "rms noise of the encoder in a sample, at its shaft",
              sheet="encoder: noise, rms at its shaft"),
    integer_parameter("seed", 1, 2_147_483_562, "seed of the sequence of noise"))
CURRENT = in_group(
    "sensor.current",
    parameter("offset", "A", -1e3, 1e3, "measured minus motor current, at a motor current of 0",
              sheet="current sensor: offset, with its drift"),
    parameter("gain_error", "1", -0.5, 0.5, "slope of the measured against the motor current, minus 1",
              sheet="current sensor: sensitivity error, with its drift"))
OF_ENCODER = {"eccentricity of the encoder": {"sensor.encoder.once": 0.0, "sensor.encoder.twice": 0.0},
              "noise of the encoder": {"sensor.encoder.noise": 0.0}}
OF_CURRENT = {"current sensor": {"sensor.current.offset": 0.0, "sensor.current.gain_error": 0.0}}
GENERATORS = (State("sensor_generator_1"), State("sensor_generator_2"))
_MOTOR_COUNTS = "motor_counts"
_OF_COMMAND = ("target", *command_bus.STATES)  # states of the controllers that depend on the command only
_NEEDED = (capabilities.CURRENT_LOOP, capabilities.CURRENT_LIMIT, capabilities.DRIVE_STEP)


def _measures_current(actuator: Actuator) -> bool:
    return actuator.provides.issuperset(_NEEDED)


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with errors of its sensors."""
    measures_current, geared = _measures_current(actuator), capabilities.SCREW_DRIVE in actuator.provides
    angle_name, rate_name = actuator.encoder

    def of_fin(ops: Ops, q: Any, position: Value) -> Value:
        return kinematics.fin_at(ops, q, position) if geared else position

    def on_fin(ops: Ops, p: Any) -> Value:
        return actuator.plant_parameters(ops, p).encoder.on_fin

    def read(ops: Ops, p: Any, position: Value, noise: Value) -> Value:
        """Return the position [rad] that the encoder reads, referred to the motor like `position` [rad]."""
        q = actuator.plant_parameters(ops, p)

        def of_motor() -> tuple[Value, ...]:
            return (sensor_errors.angle(ops, p, position) + noise,)

        def of_hinge() -> tuple[Value, ...]:
            return (kinematics.motor_angle(ops, q, sensor_errors.angle(ops, p, of_fin(ops, q, position)) + noise),)

        return ops.branch(on_fin(ops, p), of_hinge, of_motor)[0] if geared else of_motor()[0]

    def errs(ops: Ops, p: Any) -> Value:
        e = p.sensor.encoder
        return e.once + e.twice + e.noise > 0.0

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        """Return the states at rest; those of the controllers fit the encoder's reading without noise."""
        begun = actuator.start(ops, p, start.fin_angle, start.encoder_offset)
        position = actuator.position(ops, p, Record(**begun))
        names = ("measured_fin_angle", *(s.name for s in actuator.controller_states if s.name not in _OF_COMMAND))

        def as_read() -> tuple[Value, ...]:
            fin = of_fin(ops, actuator.plant_parameters(ops, p), read(ops, p, position, 0.0))
            seen = actuator.start(ops, p, fin, start.encoder_offset)
            if geared and _MOTOR_COUNTS in seen:  # the motor's encoder is exact beside one on the fin
                seen[_MOTOR_COUNTS] = ops.where(on_fin(ops, p), begun[_MOTOR_COUNTS], seen[_MOTOR_COUNTS])
            return tuple(seen[name] for name in names)

        measured = ops.branch(errs(ops, p), as_read, lambda: tuple(begun[name] for name in names))
        seeds = (p.sensor.encoder.seed, sensor_errors.SECOND)
        return {**begun, **dict(zip(names, measured, strict=True)),
                **{s.name: seed for s, seed in zip(GENERATORS, seeds, strict=True)}}

    def sample(ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        """Return the result of a sample of the controllers with the measured position, speed and current."""
        states = tuple(getattr(x, s.name) for s in GENERATORS)
        z, *after = ops.branch(p.sensor.encoder.noise > 0.0, lambda: sensor_errors.draw(ops, *states),
                               lambda: (0.0, *states))
        before = (inputs.position, getattr(x, angle_name), getattr(x, rate_name))

        def measured() -> tuple[Value, ...]:
            position, angle, speed = before
            reading = read(ops, p, position, p.sensor.encoder.noise * z)
            with_error = sensor_errors.slope(ops, p, angle) * speed
            if not geared:
                return reading, reading, with_error
            exact = on_fin(ops, p)
            return reading, ops.where(exact, angle, reading), ops.where(exact, speed, with_error)

        position, angle, speed = ops.branch(errs(ops, p), measured, lambda: before)
        changes = {angle_name: angle, rate_name: speed}
        if measures_current:
            changes["motor_current"] = sensor_errors.current(p, x.motor_current)
        out = actuator.sample(ops, p, x.replace(**changes), inputs.replace(position=position))
        return {**out, **{s.name: state for s, state in zip(GENERATORS, after, strict=True)}}

    def with_sensor(equation: Callable[..., Any]) -> Callable[..., Any]:
        """Return an equation of the plant whose drive controls the measured current."""
        def sensed(ops: Ops, p: Any, x: Record, u: PlantInputs, *h: Value) -> Any:
            return equation(ops, sensor_errors.of_drive(ops, p, u.reference), x, u, *h)

        return sensed

    def output_values(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return the outputs: `current_error` is the measured current's, `saturated` includes a limited reference."""
        over = ops.both(u.enabled, sensor_errors.beyond(ops, p, u.reference))
        seen = u.replace(limited=ops.where(over, 1.0, u.limited))
        out = with_sensor(actuator.output_values)(ops, p, x, seen)
        return {**out, "current_error": (1.0 + p.sensor.current.gain_error) * out["current_error"]}

    def rates(ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return d/dt of the states, without current limit."""
        changed: Values = with_sensor(actuator.rates)(ops, with_values(p, {"drive.current_limit": inf}), x, u)
        return changed

    plant: dict[str, Any] = {}
    if measures_current:
        plant = {"step": with_sensor(actuator.step), "output_values": output_values,
                 "derivatives": rates if actuator.derivatives else None}
    return replace(actuator, initial=initial, sample=sample,
                   controller_states=(*actuator.controller_states, *GENERATORS), **plant)


@rule("sensor.current.offset = %.6g A must be within drive.current_limit = %.6g A: no reference removes a larger one")
def _offset(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    offset, limit = p.sensor.current.offset, p.drive.current_limit
    return when(ops, ops.fabs(offset) >= limit), offset, limit


EXTENSION = Extension(
    "sensors", "errors of current sensor and encoder", extend, needs=(capabilities.ENCODER,),
    parameters=lambda actuator: ENCODER + CURRENT if _measures_current(actuator) else ENCODER,
    rules=lambda actuator: (_offset,) if _measures_current(actuator) else (),
    imperfections=lambda actuator: {**OF_ENCODER, **OF_CURRENT} if _measures_current(actuator) else OF_ENCODER)
