"""Inverter of a three-phase motor: dead time between its switches, and the diodes of an open bridge.

While both switches of a phase are off, for the dead time t_d, the phase current flows through a diode. With f switching
periods a second on a supply V the phase loses V t_d f on average, in the direction of its current (Jeong and Park, *The
analysis and compensation of dead-time effects in PWM inverters*, IEEE Trans. Ind. Electron. 38, 1991). A field-oriented
drive loses the fundamental of this square wave over an electrical turn, line to line:

    V_d = (4 sqrt(3)/pi) V t_d f        v - V_d clip(i/i_r, +-1)        i_r = V/(16 L f)

Below the ripple i_r, where the current reverses in each period, the lost voltage is proportional to the current. i_r is
the largest amplitude of the ripple, at a duty cycle of one half; with 0.05 or 0.4 A instead the default fin angle
differs by less than 0.002 deg in steps, 0.008 deg in a sag of the supply. The lost voltage takes no power from the
supply: the motor's power is that of the remaining voltage.

An open bridge rectifies. Its diodes conduct from the motor into the supply V if the mean 3 E/pi of the rectified
back-EMF exceeds V (E: its amplitude line to line). When the bridge opens, they also conduct until the current is 0:

    L di/dt = -+ V_s - R_s i - K_e w

with V_s against the current. With n pole pairs, and X = n w L, up to E/V = 1.4

    V_s = V_o = pi V/3        R_s = R_b = sqrt(R^2 + (0.8 X)^2)

where V_o |i| + (R_b - R) i^2 returns to the supply. R_b is an estimate, fitted to three phases on the diodes of a stiff
supply.

From E/V = 2 on all phases conduct at all times. With the amplitude I of their current and the fundamental V_1 of the
bridge's voltage, which is in phase with the current,

    (V_1 + R I)^2 + (X I)^2 = E^2        V_1 = (2 sqrt(3)/pi) V        r = I/|i| = E/(V_1 + R I)
    V_s = r V_1        R_s = r^2 R

V_1 I = V_s |i| returns to the supply; R I^2 is heat. At V = 0 the current is that of shorted terminals
(:mod:`.winding`), and no power returns. Between E/V = 1.4 and 2 the constants change linearly with E/V. I is that of a
constant speed: if the bridge opens at a motor speed of 277 rad/s and V = 0, the fin moves 7 % further than with three
phases. docs/model/drive.md compares the braking current with that of three phases, up to 350 rad/s. The returned power
is at most 4 % too large where the phases conduct in pulses.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Any, NamedTuple

from ..ops.base import TINY, Ops, Value
from . import drive

_FUNDAMENTAL = 4.0 * sqrt(3.0) / pi
IN_SERIES = 2.0 / _FUNDAMENTAL
"""Ratio [-] of the voltage that two phases in series lose, 2 V t_d f, to V_d."""
_RIPPLE = 1.0 / 16.0
_RECTIFIED = pi / 3.0
_REACTIVE = 0.8
_LINE = 2.0 * sqrt(3.0) / pi
_FITTED, _CONTINUOUS = 1.4, 2.0  # E/V up to which R_b is fitted, and from which all phases conduct at all times


class Diodes(NamedTuple):
    """Voltage V_s [V] and resistance R_s [Ohm] of conducting diodes, and the part of R_s that is loss [Ohm]."""

    voltage: Value
    resistance: Value
    loss: Value


def dead_voltage(ops: Ops, p: Any, supply: Value) -> Value:
    """Return the voltage V_d [V] that the drive loses by the dead time, at a supply [V]."""
    return _FUNDAMENTAL * (p.inverter.dead_time * p.inverter.switching_frequency) * ops.maximum(supply, 0.0)


def _within_ripple(p: Any) -> Value:
    """Return V_d/i_r, the resistance [Ohm] that is equivalent to the dead time at currents below the ripple."""
    frequency = p.inverter.switching_frequency
    return _FUNDAMENTAL / _RIPPLE * p.motor.inductance * p.inverter.dead_time * (frequency * frequency)


def dead_resistance(ops: Ops, p: Any, supply: Value, current: Value) -> Value:
    """Return the resistance [Ohm] that is equivalent to the dead time at a current [A] and a supply [V]."""
    return ops.minimum(dead_voltage(ops, p, supply) / ops.maximum(ops.fabs(current), TINY), _within_ripple(p))


def settled(ops: Ops, p: Any, supply: Value, source: Value, resistance: Value) -> Value:
    """Return the steady current [A] from a source [V] through a resistance [Ohm] and the drop of the dead time."""
    dead, within = dead_voltage(ops, p, supply), _within_ripple(p)
    beyond = ops.fabs(source) - dead
    return ops.where(beyond * within > resistance * dead, ops.sign(source) * beyond / resistance,
                     source / (resistance + within))


def onset(ops: Ops, supply: Value) -> Value:
    """Return the back-EMF [V] at which the diodes of an open bridge begin to conduct into a supply [V]."""
    return _RECTIFIED * ops.maximum(supply, 0.0)


def diodes(ops: Ops, p: Any, supply: Value, speed: Value) -> Diodes:
    """Return the constants of conducting diodes of an open bridge at a supply [V] and a motor speed [rad/s]."""
    resistance, emf = p.motor.resistance, ops.fabs(drive.back_emf(p, speed))
    reactance, supply = p.inverter.pole_pairs * speed * p.motor.inductance, ops.maximum(supply, 0.0)
    fitted = ops.sqrt(resistance * resistance + _REACTIVE * reactance * (_REACTIVE * reactance))
    start = onset(ops, supply)

    line = _LINE * supply
    squared_impedance = resistance * resistance + reactance * reactance
    root = ops.sqrt(ops.maximum(squared_impedance * emf * emf - reactance * reactance * line * line, 0.0))
    active = (reactance * reactance * line + resistance * root) / squared_impedance  # V_1 + R I
    ratio = ops.maximum(emf / ops.maximum(active, TINY), 1.0)
    loss = ratio * ratio * resistance

    share = ops.clip((emf - _FITTED * supply) / ops.maximum((_CONTINUOUS - _FITTED) * supply, TINY), 0.0, 1.0)
    return Diodes(*((1.0 - share) * low + share * high for low, high in
                    ((start, ratio * line), (fitted, loss), (resistance, loss))))


def current_side(ops: Ops, p: Any, supply: Value, speed: Value, current: Value) -> Value:
    """Return the sign (-1, 1) of the current through the diodes of an open bridge, 0 without diodes or conduction.

    A `current` [A] that flows keeps its sign; a new current flows against the back-EMF of the `speed` [rad/s].
    """
    emf = drive.back_emf(p, speed)
    begins = ops.where(ops.fabs(emf) > onset(ops, supply), -ops.sign(emf), 0.0)
    conducts = ops.where(ops.equal(current, 0.0), begins, ops.sign(current))
    return ops.where(p.inverter.pole_pairs > 0.0, conducts, 0.0)
