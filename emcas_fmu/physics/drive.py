"""Motor and current-mode drive, equations (2.46), (2.47) and section 3.2.2 of the thesis.

    L di/dt = v - R i - K_e w        T_m = K_t i
    i_ref = clip(K_v u + i_off, +-I_max)        u: analogue reference
    v = clip(K_p (i_ref - i) + xi, +-V_w)        dxi/dt = K_i (i_ref - i), held while v is clipped

V_w is the supply V or, with n > 0 pole pairs, the part of V that the winding's inductive voltage leaves:

    V_w^2 = max(V^2 - (n w L i)^2, 0)
"""

from __future__ import annotations

from typing import Any

from ..ops.base import Ops, Value


def current_reference_raw(p: Any, reference: Value) -> Value:
    """Return the current reference [A] for an analogue reference [V], before the limit."""
    return p.drive.current_gain * reference + p.drive.current_offset


def current_reference(ops: Ops, p: Any, reference: Value) -> Value:
    """Return the current reference [A] for an analogue reference [V], within the drive's limit."""
    limit = p.drive.current_limit
    return ops.clip(current_reference_raw(p, reference), -limit, limit)


def followed(ops: Ops, p: Any, reference: Value) -> Value:
    """Return the analogue reference [V] that the drive can follow: within the current limit, unlimited for a PWM."""
    if p.structure.current == "pwm":
        return reference
    i_ref = current_reference(ops, p, reference)
    return (i_ref - p.drive.current_offset) / p.drive.current_gain


def voltage_demand(p: Any, i_ref: Value, current: Value, integral: Value) -> Value:
    """Return the output [V] of the current controller before the voltage limit."""
    return p.drive.kp * (i_ref - current) + integral


def inductive_voltage(p: Any, speed: Value, current: Value) -> Value:
    """Return the inductive voltage [V] n w L i of the winding, in quadrature with the back-EMF."""
    return p.motor.pole_pairs * speed * p.motor.inductance * current


def voltage_limit(ops: Ops, p: Any, supply: Value, speed: Value, current: Value) -> Value:
    """Return the largest voltage [V] in phase with the back-EMF, at a supply [V], speed [rad/s] and current [A]."""
    def with_inductance() -> tuple[Value, ...]:
        across = inductive_voltage(p, speed, current)
        return (ops.sqrt(ops.maximum(supply * supply - across * across, 0.0)),)

    return ops.branch(p.motor.pole_pairs > 0.0, with_inductance, lambda: (supply,))[0]


def steady_current(ops: Ops, p: Any, supply: Value, speed: Value) -> Value:
    """Return the largest steady current i [A] at a motor speed w [rad/s]: (R i + K_e w)^2 + (n w L i)^2 = V^2.

    If the equation has no solution, return the current with the smallest left side.
    """
    resistance, emf = p.motor.resistance, back_emf(p, speed)
    reactance = inductive_voltage(p, speed, 1.0)
    squared_impedance = resistance * resistance + reactance * reactance
    root = ops.sqrt(ops.maximum(squared_impedance * supply * supply - reactance * reactance * emf * emf, 0.0))
    return (root - resistance * emf) / squared_impedance


def knee_speed(ops: Ops, p: Any, supply: Value, current: Value) -> Value:
    """Return the motor speed [rad/s], 0 or above, at which a steady current [A] needs the whole supply [V]."""
    drop = p.motor.resistance * current
    across = inductive_voltage(p, 1.0, current)
    emf = back_emf(p, 1.0)
    left = supply * supply - drop * drop
    root = ops.sqrt(ops.maximum(emf * emf * supply * supply + across * across * left, 0.0))
    return ops.maximum(left, 0.0) / (drop * emf + root)


def applied_voltage(ops: Ops, p: Any, reference: Value, speed: Value, current: Value, integral: Value, supply: Value
                    ) -> tuple[Value, Value]:
    """Return the winding's voltage [V], and whether this voltage or the current reference is limited.

    `reference` is the analogue reference [V] in the drive, `supply` the drive's supply voltage [V]. A PWM amplifier has
    no current reference.
    """
    if p.structure.current == "pwm":
        demand = pwm_voltage(p, reference)
        return ops.clip(demand, -supply, supply), ops.fabs(demand) > supply
    limit = voltage_limit(ops, p, supply, speed, current)
    i_ref = current_reference(ops, p, reference)
    demand = voltage_demand(p, i_ref, current, integral)
    clipped = ops.either(ops.fabs(demand) > limit,
                         ops.fabs(current_reference_raw(p, reference)) > p.drive.current_limit)
    return ops.clip(demand, -limit, limit), clipped


def pwm_voltage(p: Any, reference: Value) -> Value:
    """Return the winding's voltage [V] from a PWM amplifier for an analogue reference [V], before the limit."""
    return p.pwm.gain * reference


def flowing(p: Any, reference: Value, current: Value) -> Value:
    """Return the motor current [A]: the state `current`, or with an ideal loop the current reference without limit."""
    return current_reference_raw(p, reference) if p.structure.current == "ideal" else current


def rates(p: Any, reference: Value, speed: Value, current: Value, integral: Value) -> tuple[Value, Value]:
    """Return di/dt [A/s] and dxi/dt [V/s] at an analogue reference [V] and a motor speed [rad/s], without limits."""
    if p.structure.current == "ideal":
        return 0.0, 0.0
    if p.structure.current == "pwm":
        voltage, rise = pwm_voltage(p, reference), 0.0
    else:
        i_ref = current_reference_raw(p, reference)
        voltage, rise = voltage_demand(p, i_ref, current, integral), p.drive.ki * (i_ref - current)
    return (voltage - p.motor.resistance * current - back_emf(p, speed)) / p.motor.inductance, rise


def lag(p: Any) -> Value:
    """Return the time constant [s] of the current: L/(R + K_p) behind its reference, L/R for a PWM, 0 if ideal."""
    if p.structure.current == "ideal":
        return 0.0
    return p.motor.inductance / (p.motor.resistance + (p.drive.kp if p.structure.current == "loop" else 0.0))


def inverse(p: Any, current: Value, speed: Value, integral: Value) -> tuple[Value, Value]:
    """Return the reference [V] for a motor current [A] at a motor speed [rad/s], without offset and limits, and the
    current loop's integral [V] a sample time later; `integral` [V] is the present one."""
    if p.structure.current == "ideal":
        return current / p.drive.current_gain, integral
    voltage = p.motor.resistance * current + back_emf(p, speed)
    if p.structure.current == "pwm":
        return voltage / p.pwm.gain, integral
    error = (voltage - integral) / p.drive.kp
    return (current + error) / p.drive.current_gain, integral + p.controller.sample_time * p.drive.ki * error


def back_emf(p: Any, speed: Value) -> Value:
    """Return the back-EMF [V] at a motor speed [rad/s]."""
    return p.motor.back_emf_constant * speed


def stall_torque(p: Any, reference: Value) -> Value:
    """Return the torque [N.m] of a motor at rest under an analogue reference [V], without offset and limits."""
    current = (p.pwm.gain * reference / p.motor.resistance if p.structure.current == "pwm"
               else p.drive.current_gain * reference)
    return p.motor.torque_constant * current


def torque(p: Any, current: Value) -> Value:
    """Return the motor torque [N.m] at a motor current [A], (2.47)."""
    return p.motor.torque_constant * current


def limit_torque(ops: Ops, p: Any, supply: Value, speed: Value) -> Value:
    """Return the largest motor torque T [N.m] in steady motion at a motor speed w [rad/s]; the smallest is -T(-w)."""
    current = steady_current(ops, p, supply, speed)
    return torque(p, ops.clip(current, -p.drive.current_limit, p.drive.current_limit))
