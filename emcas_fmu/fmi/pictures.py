"""Pictures in the documentation of an FMU: responses with its parameters."""

from __future__ import annotations

from functools import lru_cache
from math import radians

import numpy as np
from matplotlib.figure import Figure

from ..errors import BuildError
from ..motions import STEP
from ..parameters import ParameterSet, are_defaults
from ..plotting.plots import INK, Picture, figure, panel_grid, style, svg
from ..plotting.traces import SHOWN, trace
from ..reference import files
from ..simulation import simulate
from ..support.files import models_directory

_AMPLITUDES = (1.0, 5.0, 10.0, 20.0)  # deg
_START, _STOP = 0.05, 0.4  # s


def _steps(parameters: ParameterSet) -> Figure:
    default = are_defaults(parameters)
    plot, ((axes,),) = figure(1, height=4.0, width=8.0)
    axes.set(xlabel="time [ms]", ylabel="fin angle [deg]")
    after_step = np.arange(round(_STOP / STEP) + 1) * STEP > _START - 1e-9
    for amplitude, side, color in [(a, s, f"C{i}") for i, a in enumerate(_AMPLITUDES) for s in (1, -1)]:
        result = simulate(parameters.values, _STOP, kernel="python", model=parameters.model,
                          fin_command=radians(amplitude * side) * after_step)
        axes.plot(result["time"] * 1e3, np.degrees(result["fin_angle"]), color=color,
                  label=f"±{amplitude:g}°" if side > 0 else None)
        sign = "plus" if side > 0 else "minus"
        path = files.path_of(models_directory() / "reference", f"step_{sign}{amplitude:g}", "ref.csv")
        if default and path.is_file():
            reference = files.read_csv(path)
            dots = np.flatnonzero(reference["time"] <= _STOP)[::8]
            axes.plot(reference["time"][dots] * 1e3, np.degrees(reference["fin_angle"][dots]), ".", color=INK,
                      markersize=2.5, label="independent reference" if (amplitude, side) == (20.0, 1) else None)
    axes.legend(loc="upper left")
    return plot


def _slew(parameters: ParameterSet) -> Figure:
    """Plot the response to a step to the command limit."""
    limit = float(parameters.values["command.limit"])
    result = simulate(parameters.values, 0.25, step=0.5e-3, kernel="python", model=parameters.model,
                      fin_command=lambda t: limit if t > 0.01 else 0.0)
    shown = [name for name in ("fin_angle", "fin_rate", "motor_current", "motor_voltage") if name in result]
    plot, grid = panel_grid(len(shown), 2, "time [ms]", width=8.0, sharex=True)
    for axes, name in zip(grid, shown, strict=True):
        trace(axes, result, name, unit=1e3)
        axes.set_ylabel(SHOWN[name][0])
    return plot


@lru_cache(maxsize=8)  # several FMUs are often built from one set
def response_pictures(parameters: ParameterSet) -> tuple[Picture, ...]:
    """Return pictures of responses computed with this parameter set. Raises BuildError if they cannot be computed."""
    captions = {"Step responses; dots, where shown, are the stored independent reference.": _steps,
                "A step to the command limit.": _slew}
    try:
        with style():
            return tuple(Picture(caption, svg(draw(parameters), caption), caption)
                         for caption, draw in captions.items())
    except ArithmeticError as error:
        raise BuildError(f"the responses on the FMU's page cannot be computed: {error}") from error
