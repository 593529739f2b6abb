"""Fit the second-order model to steps of the nonlinear actuator, for flight simulations."""

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
SIZES = (1.0, 2.5, 5.0, 10.0, 20.0)  # deg, sizes of the fitted steps; each response is divided by its step's size
STOP = 0.4  # s, duration of each response
# Initial value, lower bound and upper bound of each fitted parameter, SI.
_SEARCHED = {"second_order.natural_frequency": (100.0, 5.0, 2000.0), "second_order.damping": (0.7, 0.05, 3.0),
             "second_order.rate_limit": (4.0, 0.1, 100.0), "drive.transport_delay": (3e-3, 0.0, 0.03)}
FITTED = tuple(_SEARCHED)
_BEGIN, _LOWEST, _HIGHEST = np.array(list(_SEARCHED.values())).T
_AT_BOUND = 1e-3  # largest distance from a bound, as a share of the range, at which a value counts as at the bound
_NOTE = "Fitted to the nonlinear model."
_INITIAL = "Initial value of a fit whose steps do not depend on it."
# Weight of the damping as an additional residual, so that the fit prefers less damping. Without it, large dampings fit
# almost equally well: a second pole far beyond the first and a longer delay differ by only 0.03 % of a step.
_DAMPING_WEIGHT = 0.05
_DERIVATIVE_STEP = 3e-3  # relative change of a parameter for a numerical derivative


@dataclass(frozen=True)
class SecondOrderFit:
    """The fitted parameters; for each of the `sizes` [deg] the `largest` and the `rms` difference [% of the size].

    `undetermined` are the names of the parameters on which no response depends; they have their initial values.
    """

    parameters: ParameterSet
    undetermined: tuple[str, ...]
    sizes: tuple[float, ...]
    largest: tuple[float, ...]
    rms: tuple[float, ...]

    @property
    def at_bound(self) -> dict[str, str]:
        """The bound, ``lower`` or ``upper``, by the name of each fitted parameter that is at one."""
        shares = {name: (float(self.parameters.values[name]) - lowest) / (highest - lowest)
                  for name, (_, lowest, highest) in _SEARCHED.items()}
        return {name: "lower" if share < 0.5 else "upper" for name, share in shares.items()
                if min(share, 1.0 - share) <= _AT_BOUND}

    @property
    def warnings(self) -> tuple[str, ...]:
        """A message for each value that is not determined, and for each fitted value at a bound."""
        return tuple(
            f"{name} = {self.parameters.values[name]:.4g} is the initial value: no step depends on it"
            for name in self.undetermined) + tuple(
            f"{name} = {self.parameters.values[name]:.4g} is at the {side} bound of the fit: the best value may be "
            "beyond it; check whether the remaining differences are small enough"
            for name, side in self.at_bound.items())

    def figures(self) -> dict[str, Any]:
        """Return the fitted values [SI] and the remaining differences [% of the size] for JSON."""
        return {"parameters": {name: self.parameters.values[name] for name in FITTED}, "at_bound": self.at_bound,
                "undetermined": self.undetermined, "step_deg": self.sizes,
                "largest_difference_percent": self.largest, "rms_difference_percent": self.rms}


def fit(nonlinear: ParameterSet) -> SecondOrderFit:
    """Fit natural frequency, damping, rate limit and delay by least squares to steps from rest without load, both ways.

    `nonlinear` are the parameters of the nonlinear actuator. Steps beyond command.limit are omitted; if all are, a
    step to command.limit is used. Other parameters that both models have get the values of `nonlinear`. Raises
    ParameterError if a simulation refuses the values.
    """
    limit = degrees(float(nonlinear.values["command.limit"])) * (1.0 + 1e-9)
    sizes = tuple(size for size in SIZES if size <= limit) or (limit,)
    shared = {e.variable.name: e for e in nonlinear.entries}
    default = load_parameters(model=MODEL)
    base = replace(default, entries=tuple(shared.get(e.variable.name, e) for e in default.entries))
    nonlinear_steps = _responses(nonlinear.values, "nonlinear", sizes)

    def residuals(x: Array) -> Array:
        values = {**base.values, **dict(zip(FITTED, x * _BEGIN, strict=True))}
        differences = np.ravel(_responses(values, MODEL, sizes) - nonlinear_steps)
        return np.append(differences, _DAMPING_WEIGHT * values["second_order.damping"])

    solution = least_squares(residuals, np.ones(len(FITTED)), bounds=(_LOWEST / _BEGIN, _HIGHEST / _BEGIN),
                             diff_step=_DERIVATIVE_STEP, xtol=1e-10, ftol=1e-10)
    units = {e.variable.name: e.variable.unit for e in base.entries}
    undetermined = tuple(name for name, column in zip(FITTED, solution.jac.T, strict=True) if not column.any())
    fitted = base.with_values({
        name: file_entry([float(f"{x:.4g}")], units[name], "estimate", _INITIAL if name in undetermined else _NOTE)
        for name, x in zip(FITTED, solution.x * _BEGIN, strict=True)})
    differences = 100.0 * np.abs(_responses(fitted.values, MODEL, sizes) - nonlinear_steps)
    return SecondOrderFit(fitted, undetermined, sizes, tuple(differences.max(axis=1).tolist()),
                          tuple(np.sqrt(np.mean(differences**2, axis=1)).tolist()))


def _responses(values: Mapping[str, Any], model: str, sizes: tuple[float, ...]) -> Array:
    """Return the ratio of fin angle to command [sizes, rows], the mean of both directions; `sizes` are in degrees."""
    def ratio(size: float) -> Array:
        return simulate(values, STOP, model=model, fin_command=radians(size))["fin_angle"] / radians(size)

    return np.array([0.5 * (ratio(size) + ratio(-size)) for size in sizes])


def write_fitted(fit: SecondOrderFit, path: Path, command: str) -> None:
    """Write a parameter file for the second-order model, with all values that differ from its defaults."""
    remaining = ", ".join(f"{rms:.2g} % at {size:g} deg" for size, rms in zip(fit.sizes, fit.rms, strict=True))
    write_parameters(fit.parameters, path, [
        "Parameters of the second-order model that differ from its defaults.", f"Made by: {command}",
        f"Remaining differences, rms as a share of the step: {remaining}.", *fit.warnings])
