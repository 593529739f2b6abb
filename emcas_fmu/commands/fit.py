"""`emcas fit`: fit the second-order model to the nonlinear actuator."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ..actuators import NONLINEAR, full_name
from ..errors import EmcasError
from . import common

if TYPE_CHECKING:
    from ..parameters import ParameterSet

EPILOG = ("Examples:\n\n  emcas fit\n\n  emcas fit -p my_actuator.toml --output my_second_order.toml"
          "\n\n  python build_fmu.py --model second-order -p my_second_order.toml")


def fit(
    parameters: common.ParametersOption = None,
    model: Annotated[str, typer.Option(help="Only the nonlinear actuator is fitted.", metavar="NAME")] = NONLINEAR,
    output: Annotated[Path | None, common.toml_option("Write a parameter file of the second-order model.")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Fit natural frequency, damping, rate limit and delay of the second-order model to the nonlinear one."""
    from ..bench.writers import write_json
    from ..studies import fitting

    with common.failures():
        common.check_outputs(output, as_json, inputs=parameters or ())
        fitted = fitting.fit(_nonlinear(parameters, model))
        common.warn(fitted.warnings)
        if output:
            fitting.write_fitted(fitted, output, shlex.join(["emcas", "fit", *common.parameter_arguments(parameters)]))
        if as_json:
            write_json(fitted.figures(), as_json)
    entries = {e.variable.name: e for e in fitted.parameters.entries}
    for name in fitting.NAMES:
        common.out.print(f"{name} = {entries[name].value:.4g} {entries[name].variable.unit}")
    table = Table("step / deg", "largest difference / %", "rms / %")
    for size, largest, rms in zip(fitted.sizes, fitted.largest, fitted.rms, strict=True):
        table.add_row(f"{size:g}", f"{largest:.2g}", f"{rms:.2g}")
    common.out.print(table)
    common.print_written(output)


def _nonlinear(files: list[Path] | None, model: str) -> ParameterSet:
    """Return the parameters of the nonlinear actuator. Raises EmcasError, in one line if they are those of another."""
    from ..parameters import ParameterError

    needs = "emcas fit needs the parameters of the nonlinear actuator"
    if full_name(model) != NONLINEAR:
        raise EmcasError(f"--model {model}: {needs}; leave --model out")
    try:
        return common.parameter_set(files)
    except ParameterError as error:
        unknown = [problem.partition(" = ")[0].rpartition(": ") for problem in error.problems
                  if ": unknown parameter" in problem]
        if len(unknown) < max(2, len(error.problems)):  # a misspelt name, or another mistake
            raise
        names = ", ".join(name for _, _, name in unknown)
        raise EmcasError(f"{unknown[0][0]}: {needs}, which has no {names}; give a file of that actuator") from error
