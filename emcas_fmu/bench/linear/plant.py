"""The plant at rest, and its linear model there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import control as ct
import numpy as np

from ...ops.symbols import Linearised
from .equations import OUTPUTS
from .systems import Array, System, measured
from .systems import sampled as sampled_plant

_ITERATIONS = 30  # largest number of Newton's iterations
_REST = 1e-6  # largest rate at rest, as a share of the reference's effect on the rates


class UnsmoothError(ArithmeticError):
    """Equations have no finite value or slope; the message names the first such equation."""


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """A plant at rest, linearised there.

    ``states`` are its states at rest, ``reference`` is the reference that holds it, ``outputs`` are OUTPUTS. ``moves``
    names the equation that is violated most if no reference holds the plant; otherwise it is empty. ``continuous`` is
    the linearised plant, ``voltage`` the derivative of the motor voltage with respect to the states of ``continuous``.
    """

    states: Array
    reference: float
    outputs: Array
    moves: str
    continuous: System
    voltage: Array

    @lru_cache(maxsize=64)  # noqa: B019 - plants are few, and linear_plant keeps them
    def sampled(self, period: float, whole: int, rest: float) -> System:
        """Return the plant at the samples, with the delay, as :func:`.systems.sampled` does; times in s."""
        return sampled_plant(self.continuous, period, whole, rest)


@lru_cache(maxsize=64)
def linear_plant(equations: Linearised, names: tuple[str, ...], sampled: tuple[str, ...], begin: tuple[float, ...],
                 held: tuple[float, ...], gains: tuple[float, ...], fin_angle: float, aero_torque: float
                 ) -> LinearPlant:
    """Return a plant at rest at a fin angle [rad] under a hinge moment [N.m].

    `equations` are those of :class:`.smooth.Traced`, `names` and `sampled` the names of states and sampled states. The
    iteration begins at the states and the reference `begin`; `held` and `gains` are the values of sampled states and
    gains. Raises UnsmoothError if a slope or a value at `begin` is not finite, ArithmeticError if a later value is not.
    """
    count, states, reference = len(names), np.array(begin[:-1]), begin[-1]
    called = (*(f"d/dt of {name}" for name in names), "the error of fin_angle")

    def at(x: Array, reference: float) -> tuple[Array, Array]:
        values, slopes = equations([*x, reference, aero_torque, *held], gains)
        if beyond := _not_finite(values, called):
            raise ArithmeticError(f"{beyond} is not finite")
        if steep := _not_finite(slopes, called):
            raise UnsmoothError(f"{steep} has no finite slope, as a root of 0 has none")
        return values, slopes

    # States whose rates are always 0, such as an integral without gain, are no modes; those with equal rates are one.
    fin = count + OUTPUTS.index("fin_angle")
    try:
        rates, slopes = at(states, reference)
    except ArithmeticError as error:
        raise UnsmoothError(error) from error
    rows = [(float(rate), *row) for rate, row in zip(rates[:count], slopes, strict=False)]
    groups = {row: [i for i, other in enumerate(rows) if other == row] for row in rows if any(row)}
    spread = np.array([[float(i in group) for group in groups.values()] for i in range(count)]).reshape(count, -1)
    used = [group[0] for group in groups.values()]
    size = len(used)

    def balance(unknown: Array) -> tuple[Array, Array]:
        values, slopes = at(states + spread @ unknown[:size], unknown[size])
        rows = [*used, fin]
        return (values[rows] - np.append(np.zeros(size), fin_angle),
                np.column_stack([slopes[rows, :count] @ spread, slopes[rows, count]]))

    solution = solve(balance, np.append(np.zeros(size), reference))
    residual, slopes = balance(solution)
    scale = np.max(np.abs(slopes[:size, size]), initial=0.0) * max(abs(solution[size]), 1.0)
    reference, rest = float(solution[size]), states + spread @ solution[:size]
    values, slopes = at(rest, reference)
    c = np.vstack([spread, slopes[fin, :count] @ spread])
    inputs = ["reference", "aero_torque", *sampled]
    continuous = ct.ss(
        slopes[used, :count] @ spread, slopes[used, count:], c, np.zeros((count + 1, len(inputs))), inputs=inputs,
        outputs=[*map(measured, names), "fin_angle"], states=[names[i] for i in used])
    worst = int(np.argmax(np.abs(residual)))
    moves = "" if abs(residual[worst]) <= _REST * scale else [*(called[i] for i in used), called[-1]][worst]
    return LinearPlant(rest, reference, values[count:], moves, continuous,
                       slopes[count + OUTPUTS.index("motor_voltage"), :count] @ spread)


def _not_finite(rows: Array, names: Sequence[str]) -> str:
    """Return the name of the first row that is not finite; empty if all named rows are finite."""
    return next((name for name, row in zip(names, rows, strict=False) if not np.isfinite(row).all()), "")


def solve(equations: Callable[[Array], tuple[Array, Array]], guess: Array) -> Array:
    """Return the solution of equations by Newton's method, with least squares where they are dependent.

    `equations(guess)` returns their values and Jacobian. An equation that no unknown affects keeps its residual.
    Without convergence, the last iterate is returned. Raises ArithmeticError if values are not finite.
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
