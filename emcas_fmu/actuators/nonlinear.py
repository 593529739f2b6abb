"""The nonlinear electromechanical actuator: what a sample does, what a step does, what is put out.

Each function is traced into the kernels under its own name, with its arguments in
the order given here; all values SI.
"""

from __future__ import annotations

from typing import Any

from .. import control, sensors
from ..integrate import Boundary, Plant, advance
from ..ops.base import Ops, Value
from ..physics import drive, kinematics, loads, mechanics

TITLE = "nonlinear electromechanical actuator"
PLANT = ("motor angle", "motor speed", "motor current", "drive integral")
OWN = ()


def initial(ops: Ops, p: Any) -> tuple[Value, ...]:
    """Plant and controller at rest at fin.start_angle: angle, speed, current, xi, I, counts, measured fin angle."""
    angle = kinematics.motor_angle(ops, p, p.fin.start_angle)
    counts = sensors.counts(ops, p, angle)
    measured = sensors.measure(ops, p, angle, 0.0, counts)
    return angle, 0.0, 0.0, 0.0, 0.0, counts, measured.fin_angle


def sample(ops: Ops, p: Any, angle: Value, speed: Value, integral: Value, counts: Value,
           command: Value, enable: Value) -> tuple[Value, ...]:
    """One sample of the controllers: DAC value u, I, counts, measured fin angle, whether a limit was met.

    While the drive is disabled the controllers are held in reset.
    """
    measured = sensors.measure(ops, p, angle, speed, counts)

    def running() -> tuple[Value, ...]:
        out = control.output(ops, p, integral, measured, command)
        return out.reference, control.update(ops, p, integral, out), ops.where(out.limited, 1.0, 0.0)

    reference, integral, limited = ops.branch(enable, running, lambda: (0.0, 0.0, 0.0))
    return reference, integral, measured.counts, measured.fin_angle, limited


def forces(ops: Ops, p: Any, a_x: Value, a_y: Value, a_z: Value, roll: Value, pitch: Value) -> tuple[Value, ...]:
    """Specific force in the fin's frame, x and z, from acceleration and attitude."""
    return loads.specific_force(ops, p, (a_x, a_y, a_z), roll, pitch)


def step(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, reference: Value,
         aero_torque: Value, f_x: Value, f_z: Value, supply: Value, enable: Value, h: Value) -> tuple[Value, ...]:
    """The plant after h [s] or at the first event before, and the time that took."""
    plant, used = advance(ops, p, Plant(angle, speed, current, integral),
                          Boundary(reference, aero_torque, f_x, f_z, supply, enable), h)
    return (*plant, used)


def outputs(ops: Ops, p: Any, angle: Value, speed: Value, current: Value, integral: Value, active: Value,
            reference: Value, measured: Value, limited: Value, command: Value, aero_torque: Value, f_x: Value,
            f_z: Value, supply: Value, enable: Value) -> tuple[Value, ...]:
    """Every output, in the order of the variable table.

    `active` is the reference in the drive, `reference` the DAC's, `measured` the last
    fin angle measured, `limited` whether the last sample met a limit.
    """
    tangent = kinematics.lever_tangent(ops, p, angle)
    fin = kinematics.fin_angle(ops, p, tangent)
    limit = ops.maximum(supply, 0.0)

    def powered() -> tuple[Value, ...]:
        i_ref = drive.current_reference(ops, p, active)
        demand = drive.voltage_demand(p, i_ref, current, integral)
        clipped = ops.either(ops.fabs(demand) > limit,
                             ops.fabs(drive.current_reference_raw(p, active)) > p.drive.current_limit)
        return ops.clip(demand, -limit, limit), current, ops.where(clipped, 1.0, 0.0)

    voltage, flowing, clipped = ops.branch(enable, powered, lambda: (drive.back_emf(p, speed), 0.0, 0.0))
    stop = p.fin.stop_angle * (1.0 - 1e-12)
    return (
        fin,
        speed / kinematics.reduction_ratio(ops, p, tangent),
        angle,
        speed,
        flowing,
        voltage,
        drive.torque(p, flowing),
        reference,
        kinematics.nut_position(ops, p, angle),
        mechanics.external_moment(ops, p, tangent, aero_torque, f_x, f_z),
        voltage * flowing,
        control.clipped_command(ops, p, command) - fin,
        measured,
        ops.either(clipped > 0.0, limited > 0.0),
        ops.fabs(fin) >= stop,
    )
