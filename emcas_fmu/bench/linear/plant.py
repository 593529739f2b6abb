"""A plant at rest, linearised there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import control as ct
import numpy as np

from .smooth import OUTPUTS, Traced
from .systems import Array, System, measured
from .systems import sampled as sampled_plant

_ITERATIONS = 30


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """A plant at rest, linearised there.

    ``states`` are its states at rest, ``reference`` holds it there, ``outputs`` are OUTPUTS. ``residual`` is the
    largest remaining rate of a state, ``scale`` the effect of the reference on the rates. ``continuous`` is the
    linearised plant, ``voltage`` the derivative of the motor voltage with respect to its states.
    """

    states: Array
    reference: float
    outputs: Array
    residual: float
    scale: float
    continuous: System
    voltage: Array

    @lru_cache(maxsize=64)  # noqa: B019 - plants are few, and linear_plant keeps them
    def sampled(self, period: float, whole: int, rest: float) -> System:
        """Return the plant at the samples, with the delay, as :func:`.systems.sampled` does; times in s."""
        return sampled_plant(self.continuous, period, whole, rest)


@lru_cache(maxsize=64)
def linear_plant(traced: Traced, start: tuple[float, ...], held: tuple[float, ...], gains: tuple[float, ...],
                 fin_angle: float, aero_torque: float) -> LinearPlant:
    """Return a plant at rest at a fin angle [rad] under a hinge moment [N.m].

    The iteration begins at the states `start`; the sampled states are `held`. Raises ArithmeticError if values are not
    finite.
    """
    count, begin = len(start), np.array(start)
    names = traced.states

    def at(states: Array, reference: float) -> tuple[Array, Array]:
        return traced.plant([*states, reference, aero_torque, *held], gains)

    # States with zero rates, such as an integral without gain, are not modes; those with equal rates are one mode.
    rows = [tuple(row) for row in at(begin, 0.0)[1][:count]]
    groups = {row: [i for i, other in enumerate(rows) if other == row] for row in rows if any(row)}
    spread = np.array([[float(i in group) for group in groups.values()] for i in range(count)])
    used = [group[0] for group in groups.values()]
    size, fin = len(used), count + OUTPUTS.index("fin_angle")

    def balance(unknown: Array) -> tuple[Array, Array]:
        values, slopes = at(begin + spread @ unknown[:size], unknown[size])
        rows = [*used, fin]
        return (values[rows] - np.append(np.zeros(size), fin_angle),
                np.column_stack([slopes[rows, :count] @ spread, slopes[rows, count]]))

    solution = solve(balance, np.zeros(size + 1))
    reference, rest = float(solution[size]), begin + spread @ solution[:size]
    residual, slopes = balance(solution)
    scale = np.max(np.abs(slopes[:size, size])) * max(abs(reference), 1.0)
    values, slopes = at(rest, reference)
    c = np.vstack([spread, slopes[fin, :count] @ spread])
    inputs = ["reference", "aero_torque", *traced.sampled]
    continuous = ct.ss(
        slopes[used, :count] @ spread, slopes[used, count:], c, np.zeros((count + 1, len(inputs))), inputs=inputs,
        outputs=[*map(measured, names), "fin_angle"], states=[names[i] for i in used])
    return LinearPlant(rest, reference, values[count:], float(np.max(np.abs(residual))), float(scale), continuous,
                       slopes[count + OUTPUTS.index("motor_voltage"), :count] @ spread)


def solve(equations: Callable[[Array], tuple[Array, Array]], guess: Array) -> Array:
    """Return the solution of equations by Newton's method, with least squares where they are dependent.

    `equations(guess)` returns their values and Jacobian. An equation that no unknown affects keeps its residual. Raises
    ArithmeticError if values are not finite.
    """
    for _ in range(_ITERATIONS):
        values, slopes = equations(guess)
        if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
            raise ArithmeticError("the equations give values that are not finite")
        rows = np.max(np.abs(slopes), axis=1, initial=0.0)
        rows[rows == 0.0] = 1.0
        change = np.linalg.lstsq(slopes / rows[:, None], -values / rows, rcond=None)[0]
        guess = guess + change
        if np.all(np.abs(change) <= 1e-13 * (1.0 + np.abs(guess))):
            break
    return guess
