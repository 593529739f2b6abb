"""The sampled response of the drive's current loop to a reference that arrives between samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.signal import cont2discrete, lfilter

from ...actuators.electromechanical import nonlinear
from ...physics import drive
from .records import Array


def response(parameters: Any, initial: float, reference: Array, speed: Array | None, step: float,
             values: Mapping[str, Any]) -> Array:
    """Return the linear loop's current [A] at each row, for the rows' reference [V] and motor speed [rad/s] or None.

    `parameters` are K_v [A/V], i_off [A], T_d [s], K_p [V/A] and K_i [V/(A.s)]; the loop starts at rest with
    xi = `initial` [V]. Rows are `step` [s] apart.
    """
    gain, offset, delay, kp, ki = parameters
    p = nonlinear.ACTUATOR.namespace({**values, "drive.current_gain": gain, "drive.current_offset": offset})
    demanded = drive.current_reference_raw(p, reference)
    resistance, inductance = values["motor.resistance"], values["motor.inductance"]
    a = np.array([[-(resistance + kp) / inductance, 1.0 / inductance], [-ki, 0.0]])
    b = np.array([kp / inductance, ki])
    e = np.array([-1.0 / inductance, 0.0])
    whole = int(np.floor(delay / step))
    fraction = delay / step - whole
    f, late = _held(a, b, step * (1.0 - fraction))  # the part of the interval after the arrival
    _, early = _held(a, b, step * fraction)
    phi, back = _held(a, e, step)
    # x_k+1 = Phi x_k + f(early) u_k-whole-1 + late u_k-whole
    before = np.concatenate([np.full(whole + 1, demanded[0]), demanded])[:len(demanded)]
    now = np.concatenate([np.full(whole, demanded[0]), demanded])[:len(demanded)]
    # Steady state: the current at xi = initial and the first demand.
    rest = np.array([(kp * demanded[0] + initial) / (resistance + kp), initial])
    pushed = np.outer(before, f @ early) + np.outer(now, late)
    if speed is not None:
        pushed = pushed + np.outer(drive.back_emf(p, speed), back)
    return _first_state(phi, rest, pushed)


def _held(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """Return the transition matrix over `time` [s], and the effect of a constant input."""
    transition, added, *_ = cont2discrete((a, b[:, None], np.eye(2), np.zeros((2, 1))), time)
    return transition, added[:, 0]


def _first_state(phi: Array, start: Array, pushed: Array) -> Array:
    """Return the first component of x_k+1 = phi x_k + pushed_k, by its difference equation."""
    trace, determinant = float(np.trace(phi)), float(np.linalg.det(phi))
    # (z^2 - trace z + det) x = adj(z - phi) pushed: the first row of it.
    total = np.concatenate([start[:1], pushed[:-1, 0]])
    before = np.concatenate([start[None], pushed[:-2]])
    total[1:] += phi[0, 1] * before[:, 1] - phi[1, 1] * before[:, 0]
    current: Array = lfilter([1.0], [1.0, -trace, determinant], total)
    return current
