"""Inverter of a three-phase motor: dead time between its switches, and the diodes of an open bridge.

In the dead time t_d between two switches of a phase, its current flows through a diode. At f switching periods a second
the phase lacks V t_d f along its current on average (Jeong and Park, *The analysis and compensation of dead-time
effects in PWM inverters*, IEEE Trans. Ind. Electron. 38, 1991): in the field-oriented drive, over an electrical turn,
the fundamental of that square wave, line to line,

    V_d = (4 sqrt(3)/pi) V t_d f        v - V_d clip(i/i_r, +-1)        i_r = V/(16 L f)

below the ripple i_r in proportion to the current, which then reverses in each period. i_r is the largest amplitude of
the ripple, that of pulses of half the time; 0.05 or 0.4 A instead move the default fin by less than 0.002 deg. The
missing voltage does not leave the supply and is no loss: the motor's power is that of the voltage that remains.

An open bridge rectifies: its diodes conduct from the motor into the supply V where the mean of the rectified back-EMF E
(the amplitude line to line), 3 E/pi, exceeds it, and after the bridge has opened, until no current is left:

    L di/dt = -+ V_o - R_b i - K_e w        V_o = pi V/3        R_b = sqrt(R^2 + (0.8 n w L)^2)

against the current's sign, with n pole pairs. Of R_b only R is loss: V_o |i| + (R_b - R) i^2 returns to the supply. R_b
is an estimate: a fit to the three phases on the diodes of a stiff supply, whose braking current it has within 13 % for
3 to 8 pole pairs of the default motor at E from 1.1 to 1.4 V; below it is off by 0.4 A at most, where the three phases
conduct in pulses. The power returned is then 4 % too large at most.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

from ..ops.base import Ops, Value
from . import drive

_FUNDAMENTAL = 4.0 * sqrt(3.0) / pi
_RIPPLE = 1.0 / 16.0
_TINY = 1e-300
_RECTIFIED = pi / 3.0
_REACTIVE = 0.8


def dead_voltage(ops: Ops, p: Any, supply: Value) -> Value:
    """Return the voltage V_d [V] that the dead time takes along the current, at a supply [V]."""
    return _FUNDAMENTAL * (p.inverter.dead_time * p.inverter.switching_frequency) * ops.maximum(supply, 0.0)


def _within_ripple(p: Any) -> Value:
    """Return the resistance [Ohm] with the drop of the dead time at currents below the ripple, V_d/i_r."""
    frequency = p.inverter.switching_frequency
    return _FUNDAMENTAL / _RIPPLE * p.motor.inductance * p.inverter.dead_time * (frequency * frequency)


def dead_resistance(ops: Ops, p: Any, supply: Value, current: Value) -> Value:
    """Return the resistance [Ohm] with the drop of the dead time at a current [A], from a supply [V]."""
    return ops.minimum(dead_voltage(ops, p, supply) / ops.maximum(ops.fabs(current), _TINY), _within_ripple(p))


def settled(ops: Ops, p: Any, supply: Value, source: Value, resistance: Value) -> Value:
    """Return the current [A] of a source [V] behind a resistance [Ohm] with the drop of the dead time."""
    dead, least = dead_voltage(ops, p, supply), _within_ripple(p)
    beyond = ops.fabs(source) - dead
    return ops.where(beyond * least > resistance * dead, ops.sign(source) * beyond / resistance,
                     source / (resistance + least))


def onset(ops: Ops, supply: Value) -> Value:
    """Return the back-EMF [V] at which the diodes of an open bridge begin to conduct into a supply [V]."""
    return _RECTIFIED * ops.maximum(supply, 0.0)


def rectifying_resistance(ops: Ops, p: Any, speed: Value) -> Value:
    """Return R_b less R [Ohm] of conducting diodes at a motor speed [rad/s]."""
    resistance = p.motor.resistance
    across = _REACTIVE * p.inverter.pole_pairs * speed * p.motor.inductance
    return ops.sqrt(resistance * resistance + across * across) - resistance


def current_side(ops: Ops, p: Any, supply: Value, speed: Value, current: Value) -> Value:
    """Return the sign of the current (-1, 0, 1) that the diodes of an open bridge let flow at a motor speed [rad/s].

    0: they do not conduct. A `current` [A] that flows continues; another begins against the back-EMF.
    """
    emf = drive.back_emf(p, speed)
    begins = ops.where(ops.fabs(emf) > onset(ops, supply), -ops.sign(emf), 0.0)
    conducts = ops.where(ops.equal(current, 0.0), begins, ops.sign(current))
    return ops.where(p.inverter.pole_pairs > 0.0, conducts, 0.0)
