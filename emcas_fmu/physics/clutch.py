"""Electromagnetic clutches: coil with its amplifier, eddy currents, torque, slip heat.

    L di/dt = v - R i                      v = clip(R i_ref + K_p (i_ref - i), -V_c, V)
    t_e dphi/dt = i - phi                  i and phi are never below 0
    C = k_T T_r (r + (1 - r) phi/I_r)      k_T = max(1 + a (T - T_0), 0.1)
    C_th dT/dt = sum |F_k s_k| - (T - T_a)/R_th

v is the amplifier's, of a supply V; below 0 it is that of the suppressor, which takes the coil's energy, as the
amplifier draws no current backwards. phi is the flux, as the coil current that holds it when steady, behind eddy
currents in the body. C is the torque at which the clutch slips, whatever the slip speed, r the part that is left of it
without current. F_k s_k is what slipping makes of heat, in one body of all clutches. A torque in proportion to the
current, whatever the slip speed, is what data sheets of magnetic particle clutches show; for friction clutches, of
which they give the rated point alone, it is an engineering choice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value

LEAST = 0.1  # a line of torque over temperature is not followed below this share
_BAND = 1e-9  # of a limit, within which a demand that comes from beyond counts as free


class Coil(NamedTuple):
    """A coil in a mode: the current asked for [A], its amplifier's gain K_p [V/A], the limit at which that stands (1:
    the supply's, -1: the suppressor's, 0: none), the supply [V]."""

    asked: Value
    gain: Value
    side: Value
    supply: Value

    def demand(self, p: Any, current: Value) -> Value:
        """Return the voltage [V] that brings the current [A] to the one asked for, before its limits."""
        return p.coil.resistance * self.asked + self.gain * (self.asked - current)

    def voltage(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return the voltage [V] on it."""
        at_limit = ops.where(self.side > 0.0, self.supply, -p.coil.suppression_voltage)
        return ops.where(ops.equal(self.side, 0.0), self.demand(p, current), at_limit)

    def rate(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return di/dt [A/s]."""
        return (self.voltage(ops, p, current) - p.coil.resistance * current) / p.coil.inductance

    def drawn(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return the power [W] that its amplifier draws; below 0 V the suppressor takes the coil's."""
        return ops.maximum(self.voltage(ops, p, current), 0.0) * current

    def margin(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return what is above 0 [V] until the demand meets its limit, or leaves it."""
        clamp, demand = p.coil.suppression_voltage, self.demand(p, current)
        beyond = ops.where(self.side > 0.0, demand - self.supply, -clamp - demand)
        return ops.where(ops.equal(self.side, 0.0), ops.minimum(self.supply - demand, demand + clamp), beyond)


def coil(ops: Ops, p: Any, asked: Value, gain: Value, current: Value, supply: Value) -> Coil:
    """Return a coil of a current [A] in its mode, at a supply [V]."""
    supply = ops.maximum(supply, 0.0)
    free = Coil(asked, gain, 0.0, supply)
    demand, clamp = free.demand(p, current), p.coil.suppression_voltage
    side = ops.where(demand > supply * (1.0 + _BAND), 1.0, ops.where(demand < -clamp * (1.0 + _BAND), -1.0, 0.0))
    return free._replace(side=side)


def flux_rate(p: Any, current: Value, flux: Value) -> Value:
    """Return dphi/dt [A/s]."""
    return (current - flux) / p.clutch.eddy_time


def torque_per_ampere(p: Any) -> Value:
    """Return what a clutch's torque rises with its current [N.m/A], at the reference temperature."""
    return p.clutch.rated_torque * (1.0 - p.clutch.residual) / p.clutch.rated_current


def share_at(ops: Ops, p: Any, temperature: Value) -> Value:
    """Return the torque at a temperature [degC] over that at the reference, k_T."""
    return ops.maximum(1.0 + p.clutch.temperature_coefficient * (temperature - p.clutch.reference_temperature), LEAST)


def capacity(p: Any, flux: Value, share: Value = 1.0) -> Value:
    """Return C [N.m], the torque at which a clutch of a flux [A] slips, of k_T and its scatter together = `share`."""
    return share * (p.clutch.rated_torque * p.clutch.residual + torque_per_ampere(p) * flux)


def warming(p: Any, heat: Value, temperature: Value) -> Value:
    """Return dT/dt [K/s] under a power of slip [W]."""
    lost = (temperature - p.friction.temperature) / p.clutch.thermal_resistance
    return (heat - lost) / p.clutch.heat_capacity
