"""The thesis's linear model, (2.18)-(2.26), under its sampled controllers.

The assembly angle is zero and the fin angle small, so that the reduction ratio is the constant N = d/l:

    J_eq dw/dt = K_t i - B_eq w       J_eq = J_m + J_s + m_n l^2 + J_ft/N^2,   B_eq = b_m + b_f/N^2
    L di/dt = K_p (i_ref - i) + xi - R i - K_e w      dxi/dt = K_i (i_ref - i)      i_ref = K_v u(t - T_d)
    u_k = K_vel e_w + V_k - T_l/(K_t K_v)        e_w = K_pos (b r - theta) + I_k + v_ff (r - r_k-1)/T_s - w
    I_k+1 = I_k + T_s K_i,pos (r - theta)        V_k+1 = V_k + T_s K_i,vel e_w        r = N command
    T_l = L (J_eq w - m_k)                       m_k+1 = m_k + T_s (K_t i + T_l)

The plant's N, J_eq, B_eq, K_t and K_e are those of the actuator as built; those of the controllers are nominal, without
``deviation.*``. The model has no limits, Coulomb friction, friction compensation, current offset, encoder counts or
loads. The command is delayed by whole samples and held for one sample; it is not rounded. The controllers are sampled
at T_s. Matrix exponentials give the plant between samples without integration error. This model shares with the
nonlinear reference only parameters (as built, over temperature, summed about the hinge) and the rounding of times to
samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import EmcasError
from .controllers import whole_samples
from .events import Array
from .screw import over_temperature
from .vehicle import as_built, hinge_friction


def obstacle(values: Mapping[str, Any]) -> str:
    """Return the reason, with a remedy, why the linear model is not valid for these parameters; "" if it is."""
    is_held = whole_samples(values, "command.update_time") > 1
    for name, unit, present in (("command.resolution", "rad", values["command.resolution"] > 0.0),
                              ("command.update_time", "s", is_held)):
        if present:
            return f"{name} = {values[name]:g} {unit}: the linear model has no such effect; set it to 0"
    return ""


class LinearModel:
    """Discrete state space of the closed loop at the controllers' sample times, after the command's latency.

    ``sample_time`` is in s; the input is the fin command [rad], the output the fin angle [rad]. ``update``, ``drive``
    and ``output`` are its matrices; ``dac_input`` is the effect on the next state of a voltage added to the DAC value.
    The state is motor angle, speed, current, xi, I, V, r_k-1, m and the DAC values on their way to the drive.
    Raises EmcasError if the model is not valid for the parameters (`obstacle`).
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        if why := obstacle(values):
            raise EmcasError(why)
        self.values, self.sample_time = values, float(values["controller.sample_time"])
        _, self.ratio, self.inertia = _plant(values)
        plant, built_ratio, _ = _plant(as_built(values))
        whole, rest = divmod(float(values["drive.transport_delay"]), self.sample_time)
        if self.sample_time - rest < 1e-9 * self.sample_time:  # a delay of whole periods except for rounding
            whole, rest = whole + 1, 0.0
        # In each period the older DAC value acts for `rest`, then the newer one.
        first, second = (scipy.linalg.expm(plant * time) for time in (rest, self.sample_time - rest))
        self.free, self.older, self.newer = (second @ first)[:4, :4], second[:4, :4] @ first[:4, 4], second[:4, 4]
        size = 9 + int(whole)
        unit = np.eye(size + 2)
        following = self._next(unit[:size], unit[size], unit[size + 1])
        self.update, self.drive, self.dac_input = following[:, :size], following[:, size], following[:, size + 1]
        self.latency = whole_samples(values, "command.latency")
        self.output = np.zeros(size)
        self.output[0] = 1.0 / built_ratio

    def _next(self, states: Array, command: Array, added: Array) -> Array:
        """Return `states` (rows) one sample later, for a command [rad] and a voltage [V] `added` to the DAC value."""
        p, period = self.values, self.sample_time
        theta, speed, current, _, integral, velocity_integral, previous_target, momentum, *dac = states
        target = self.ratio * command
        fed_forward = p["controller.position.velocity_feedforward"] / period * (target - previous_target)
        weighted = p["controller.position.setpoint_weight"] * target - theta
        error = p["controller.position.kp"] * weighted + integral + fed_forward - speed
        torque_constant, bandwidth = p["motor.torque_constant"], p["controller.load_observer"]
        load = bandwidth * (self.inertia * speed - momentum)
        dac.append(p["controller.velocity.kp"] * error + velocity_integral
                   - load / (torque_constant * p["drive.current_gain"]) + added)
        observed = momentum + period * (torque_constant * current + load)
        return np.array([
            *(self.free @ states[:4] + np.outer(self.older, dac[0]) + np.outer(self.newer, dac[1])),
            integral + period * p["controller.position.ki"] * (target - theta),
            velocity_integral + period * p["controller.velocity.ki"] * error, target,
            observed if bandwidth else np.zeros_like(observed), *dac[1:]])

    def simulate(self, command: Array) -> Array:
        """Return the fin angle [rad] at each sample, from rest, for the fin command [rad] at each sample."""
        state, angles = np.zeros(len(self.drive)), np.empty(len(command))
        for k, value in enumerate(np.append(np.zeros(self.latency), command)[:len(command)]):
            angles[k] = self.output @ state
            state = self.update @ state + self.drive * value
        return angles

    def frequency_response(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the complex ratio of fin angle to command [1] at frequencies [Hz] below half the sample rate."""
        identity = np.eye(len(self.drive))
        shift = np.exp(2j * np.pi * np.asarray(frequency) * self.sample_time)
        return np.array([self.output @ np.linalg.solve(z * identity - self.update, self.drive) / z**self.latency
                         for z in shift])


def _plant(values: Mapping[str, Any]) -> tuple[Array, float, float]:
    """Return the matrix of d/dt (theta, w, i, xi, u at the drive), the ratio N [1] and the inertia J_eq [kg.m2]."""
    lead = values["screw.lead"]
    ratio = values["kinematics.moment_arm"] / lead
    fin = values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]
    inertia = values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2 + fin / ratio**2
    # One viscous coefficient holds for both directions.
    motor_viscous = 0.5 * (values["friction.viscous.positive"] + values["friction.viscous.negative"])
    motor_viscous *= over_temperature(values, "viscous")
    viscous = motor_viscous + hinge_friction(values)[1] / ratio**2
    kp, ki, gain = values["drive.kp"], values["drive.ki"], values["drive.current_gain"]
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1, 1], a[1, 2] = -viscous / inertia, values["motor.torque_constant"] / inertia
    a[2] = 0.0, -values["motor.back_emf_constant"], -values["motor.resistance"] - kp, 1.0, kp * gain
    a[2] /= values["motor.inductance"]
    a[3, 2], a[3, 4] = -ki, ki * gain
    return a, ratio, float(inertia)
