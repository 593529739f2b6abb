"""Electromagnetic clutches: coil with its amplifier, eddy currents, torque, slip heat.

    L di/dt = v - R i                      v = clip(R i_ref + K_p (i_ref - i), -V_c, V)
    t_e dphi/dt = i - phi                  i and phi are never below 0
    C = k_T T_r (r + (1 - r) phi/I_r)      k_T = max(1 + a (T - T_0), 0.1)
    C_th dT/dt = sum |F_k s_k| - (T - T_a)/R_th

v is the coil's voltage, from an amplifier on a supply V, and i its current. A negative v is the suppressor's, which
absorbs the coil's energy, since the amplifier returns no current to the supply. phi is the flux, expressed as the
steady coil current that holds it; it lags because of eddy currents in the body. C is the torque at which the clutch
slips, at any slip speed; T_r and I_r are rated torque and current, r is the share of T_r that remains without current.
F_k and s_k are torque and slip speed of a clutch: one body at the temperature T absorbs the heat of all clutches. In
data sheets of magnetic particle clutches the torque is proportional to the current at any slip speed. Data sheets of
friction clutches have only the rated point: for these the proportion is an engineering choice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..ops.base import Ops, Value

LEAST_FACTOR = 0.1  # smallest k_T
_BAND = 1e-9  # a demand is limited if it exceeds a limit by more than this share of the limit


class Coil(NamedTuple):
    """A coil in a mode: current reference [A], gain K_p of its amplifier [V/A], the voltage limit that is reached
    (`side` 1: the supply's, -1: the suppressor's, 0: none), and the supply [V]."""

    reference: Value
    gain: Value
    side: Value
    supply: Value

    def demand(self, p: Any, current: Value) -> Value:
        """Return the amplifier's voltage [V] at a current [A], before its limits."""
        return p.coil.resistance * self.reference + self.gain * (self.reference - current)

    def voltage(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return the voltage [V] on the coil."""
        at_limit = ops.where(self.side > 0.0, self.supply, -p.coil.suppression_voltage)
        return ops.where(ops.equal(self.side, 0.0), self.demand(p, current), at_limit)

    def rate(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return di/dt [A/s]."""
        return (self.voltage(ops, p, current) - p.coil.resistance * current) / p.coil.inductance

    def power(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return the power [W] that the amplifier draws from the supply: 0 while the coil's voltage is negative."""
        return ops.maximum(self.voltage(ops, p, current), 0.0) * current

    def margin(self, ops: Ops, p: Any, current: Value) -> Value:
        """Return the event margin [V] of the demand: its distance to the nearer limit or, at a limit, its excess."""
        clamp, demand = p.coil.suppression_voltage, self.demand(p, current)
        beyond = ops.where(self.side > 0.0, demand - self.supply, -clamp - demand)
        return ops.where(ops.equal(self.side, 0.0), ops.minimum(self.supply - demand, demand + clamp), beyond)


def coil(ops: Ops, p: Any, reference: Value, gain: Value, current: Value, supply: Value) -> Coil:
    """Return the mode of a coil at a current reference and a current [A], a `gain` K_p [V/A] and a supply [V]."""
    supply = ops.maximum(supply, 0.0)
    free = Coil(reference, gain, 0.0, supply)
    demand, clamp = free.demand(p, current), p.coil.suppression_voltage
    side = ops.where(demand > supply * (1.0 + _BAND), 1.0, ops.where(demand < -clamp * (1.0 + _BAND), -1.0, 0.0))
    return free._replace(side=side)


def flux_rate(p: Any, current: Value, flux: Value) -> Value:
    """Return dphi/dt [A/s] at a coil current and a flux [A]."""
    return (current - flux) / p.clutch.eddy_time


def torque_per_ampere(p: Any) -> Value:
    """Return the slope [N.m/A] of a clutch's torque over its current, at the reference temperature."""
    return p.clutch.rated_torque * (1.0 - p.clutch.residual) / p.clutch.rated_current


def share_at(ops: Ops, p: Any, temperature: Value) -> Value:
    """Return k_T [-], the ratio of the torque at a temperature [degC] to that at the reference temperature."""
    change = p.clutch.temperature_coefficient * (temperature - p.clutch.reference_temperature)
    return ops.maximum(1.0 + change, LEAST_FACTOR)


def capacity(p: Any, flux: Value, share: Value = 1.0) -> Value:
    """Return C [N.m], the torque at which a clutch slips at a flux [A]; `share` is k_T times the clutch's scatter."""
    return share * (p.clutch.rated_torque * p.clutch.residual + torque_per_ampere(p) * flux)


def warming(p: Any, heat: Value, temperature: Value) -> Value:
    """Return dT/dt [K/s] at a temperature [degC] under the heat of slipping [W]."""
    lost = (temperature - p.friction.temperature) / p.clutch.thermal_resistance
    return (heat - lost) / p.clutch.heat_capacity
