"""The thesis's linear model, (2.18)-(2.26), under its sampled controllers.

The assembly angle is taken as zero and the fin angle as small, so that the reduction ratio is
the constant N = d/l:

    J_eq dw/dt = K_t i - B_eq w       J_eq = J_m + J_s + m_n l^2 + J_ft/N^2,   B_eq = b_m + b_f/N^2
    L di/dt = K_p (i_ref - i) + xi - R i - K_e w      dxi/dt = K_i (i_ref - i)      i_ref = K_v u(t - T_d)
    u_k = K_vel (K_pos e + I - w),   I_k+1 = I_k + T_s K_i,pos e,   e = N command - theta

Without limits, Coulomb friction and its compensation, current offset, encoder counts or loads.
Controllers are sampled at T_s and the plant between the samples is solved exactly by matrix
exponentials, so no integration error is mixed into a comparison. Nothing of the nonlinear
model's code is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.floating[Any]]


class LinearModel:
    """Discrete state space of the closed loop at the controllers' sample times.

    ``sample_time`` [s]; the input is the fin command [rad], the output the fin angle [rad].
    The state is motor angle, speed, current, xi, I and the DAC values on their way to the drive.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.sample_time = period = float(values["controller.sample_time"])
        plant, ratio = _plant(values)
        whole, rest = divmod(float(values["drive.transport_delay"]), period)
        if period - rest < 1e-9 * period:  # a delay of whole periods, but for rounding
            whole, rest = whole + 1, 0.0
        late = int(whole)
        # In each period the older DAC value acts for `rest`, then the newer one.
        before, after = expm(plant * rest), expm(plant * (period - rest))
        free = (after @ before)[:4, :4]
        older = after[:4, :4] @ before[:4, 4]
        newer = after[:4, 4]
        size = 5 + late + 1
        # Positions: 5 is the value in the drive, 5 + late the last one written; the sample now follows it.
        update = np.zeros((size, size))
        update[:4, :4] = free
        control = np.zeros(size)
        position_gain, velocity_gain = values["controller.position.kp"], values["controller.velocity.kp"]
        control[0], control[1], control[4] = -velocity_gain * position_gain, -velocity_gain, velocity_gain
        demand = velocity_gain * position_gain * ratio
        line = np.zeros((late + 2, size))  # DAC values from the oldest to the one written now
        line[:-1, 5:] = np.eye(late + 1)
        line[-1] = control
        update[:4] += np.outer(older, line[0]) + np.outer(newer, line[1])
        update[4, 4], update[4, 0] = 1.0, -period * values["controller.position.ki"]
        update[5:] = line[1:]
        drive = np.zeros(size)
        drive[4] = period * values["controller.position.ki"] * ratio
        drive[-1] = demand
        if late == 0:  # the value written now already acts in this period
            drive[:4] += newer * demand
        self.update, self.drive = update, drive
        self.output = np.zeros(size)
        self.output[0] = 1.0 / ratio

    def simulate(self, command: Array) -> Array:
        """Return fin angle [rad] at each sample, from rest, before that sample's command [rad] acts."""
        state, angles = np.zeros(len(self.drive)), np.empty(len(command))
        for k, value in enumerate(command):
            angles[k] = self.output @ state
            state = self.update @ state + self.drive * value
        return angles

    def frequency_response(self, frequency: Array) -> NDArray[np.complex128]:
        """Return fin angle over command [1] at frequencies [Hz] below half the sample rate."""
        identity = np.eye(len(self.drive))
        shift = np.exp(2j * np.pi * np.asarray(frequency) * self.sample_time)
        return np.array([self.output @ np.linalg.solve(z * identity - self.update, self.drive) for z in shift])


def _plant(values: Mapping[str, Any]) -> tuple[Array, float]:
    """Return d/dt of (theta, w, i, xi, u in the drive), and N."""
    lead = values["screw.lead"]
    ratio = values["kinematics.moment_arm"] / lead
    fin = values["inertia.fin"] + values["inertia.shaft"] + values["inertia.fork"]
    inertia = values["inertia.motor"] + values["inertia.screw"] + values["mass.nut"] * lead**2 + fin / ratio**2
    # One viscous coefficient stands for both directions.
    motor_viscous = 0.5 * (values["friction.viscous.positive"] + values["friction.viscous.negative"])
    coldness = min(max((24.0 - values["friction.temperature"]) / 30.0, 0.0), 1.0)
    motor_viscous *= 1.0 + (values["friction.cold_viscous_ratio"] - 1.0) * coldness
    viscous = motor_viscous + values["friction.fin_viscous"] / ratio**2
    kp, ki, gain = values["drive.kp"], values["drive.ki"], values["drive.current_gain"]
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1, 1], a[1, 2] = -viscous / inertia, values["motor.torque_constant"] / inertia
    a[2] = 0.0, -values["motor.back_emf_constant"], -values["motor.resistance"] - kp, 1.0, kp * gain
    a[2] /= values["motor.inductance"]
    a[3, 2], a[3, 4] = -ki, ki * gain
    return a, ratio
