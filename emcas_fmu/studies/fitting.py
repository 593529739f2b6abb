"""Fit the second-order model to the nonlinear one, for flight simulations in which the difference does not matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees, radians
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ..parameters import ParameterSet, file_entry, load_parameters, write_parameters
from ..simulation import Array, simulate

MODEL = "second-order"
SIZES = (1.0, 2.5, 5.0, 10.0, 20.0)  # deg, of the fitted steps, whose responses are divided by these
STOP = 0.4  # s
# Initial value, lower and upper bound, SI.
_SEARCHED = {"second_order.natural_frequency": (100.0, 5.0, 2000.0), "second_order.damping": (0.7, 0.05, 3.0),
             "second_order.rate_limit": (4.0, 0.1, 100.0), "drive.transport_delay": (3e-3, 0.0, 0.03)}
NAMES = tuple(_SEARCHED)
_BEGIN, _LOWEST, _HIGHEST = np.array(list(_SEARCHED.values())).T
_AT_BOUND = 1e-3  # share of the range: finer than the digits that are written
_NOTE = "Fitted to the nonlinear model."
# Weight of the damping among the residuals. A second pole far beyond the first and a longer delay differ by 0.03 % of a
# step only; the weight prefers less damping.
_LEAST = 0.05
_DIFFERENCE = 3e-3  # relative step of the derivatives: a delay acts in thousandths of the sample time


@dataclass(frozen=True)
class Fit:
    """The fitted parameters, and the largest and the rms difference of each step [% of its size]."""

    parameters: ParameterSet
    sizes: tuple[float, ...]
    largest: tuple[float, ...]
    rms: tuple[float, ...]

    @property
    def at_bound(self) -> dict[str, str]:
        """The fitted values at a bound of the search, with its name: lower or upper."""
        shares = {name: (float(self.parameters.values[name]) - lowest) / (highest - lowest)
                  for name, (_, lowest, highest) in _SEARCHED.items()}
        return {name: "lower" if share < 0.5 else "upper" for name, share in shares.items()
                if min(share, 1.0 - share) <= _AT_BOUND}

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each fitted value at a bound of the search."""
        return tuple(
            f"{name} = {self.parameters.values[name]:.4g} is at the {side} bound of the fit: what fits best may lie "
            "beyond; see whether the differences left are small enough" for name, side in self.at_bound.items())

    def figures(self) -> dict[str, Any]:
        """Return the fitted values and the remaining differences, for JSON."""
        return {"parameters": {name: self.parameters.values[name] for name in NAMES}, "at_bound": self.at_bound,
                "step_deg": self.sizes,
                "largest_difference_percent": self.largest, "rms_difference_percent": self.rms}


def fit(nonlinear: ParameterSet) -> Fit:
    """Fit natural frequency, damping, rate limit and delay by least squares to unloaded steps from rest, both ways.

    Steps beyond command.limit are omitted; the encoder stays as in the set. Raises ParameterError.
    """
    limit = degrees(float(nonlinear.values["command.limit"])) * (1.0 + 1e-9)
    sizes = tuple(size for size in SIZES if size <= limit) or (limit,)
    shared = {e.variable.name: e for e in nonlinear.entries}
    default = load_parameters(model=MODEL)
    base = replace(default, entries=tuple(shared.get(e.variable.name, e) for e in default.entries))
    nonlinear_steps = _responses(nonlinear.values, "nonlinear", sizes)

    def residuals(x: Array) -> Array:
        values = {**base.values, **dict(zip(NAMES, x * _BEGIN, strict=True))}
        differences = np.ravel(_responses(values, MODEL, sizes) - nonlinear_steps)
        return np.append(differences, _LEAST * values["second_order.damping"])

    solution = least_squares(residuals, np.ones(len(NAMES)), bounds=(_LOWEST / _BEGIN, _HIGHEST / _BEGIN),
                             diff_step=_DIFFERENCE, xtol=1e-10, ftol=1e-10)
    units = {e.variable.name: e.variable.unit for e in base.entries}
    fitted = base.with_values({name: file_entry([float(f"{x:.4g}")], units[name], "estimate", _NOTE)
                           for name, x in zip(NAMES, solution.x * _BEGIN, strict=True)})
    left = 100.0 * np.abs(_responses(fitted.values, MODEL, sizes) - nonlinear_steps)
    return Fit(fitted, sizes, tuple(left.max(axis=1).tolist()), tuple(np.sqrt(np.mean(left**2, axis=1)).tolist()))


def _responses(values: Mapping[str, Any], model: str, sizes: tuple[float, ...]) -> Array:
    """Return fin angle over command, the mean of both directions [sizes, rows]."""
    def one(size: float) -> Array:
        return simulate(values, STOP, model=model, fin_command=radians(size))["fin_angle"] / radians(size)

    return np.array([0.5 * (one(size) + one(-size)) for size in sizes])


def write_fitted(fit: Fit, path: Path, command: str) -> None:
    """Write a parameter file of the second-order model with all values that differ from its defaults."""
    left = ", ".join(f"{rms:.2g} % at {size:g} deg" for size, rms in zip(fit.sizes, fit.rms, strict=True))
    write_parameters(fit.parameters, path, [
        "Parameters of the second-order model, over its defaults.", f"Made by: {command}",
        f"Differences left, rms of a step's size: {left}.", *fit.warnings])
