"""`emcas fit`: the second-order model that comes nearest to an actuator."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ..bench.writers import write_json
from ..parameters import load_parameters
from .common import ParametersOption, check_outputs, failures, out, parameter_arguments, print_written

EPILOG = ("Examples:\n\n  emcas fit\n\n  emcas fit -p my_actuator.toml --output my_second_order.toml"
          "\n\n  python build_fmu.py --model second-order -p my_second_order.toml")


def fit(
    parameters: ParametersOption = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write a parameter file of the second-order "
                                                "model.", metavar="FILE")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write the figures to this file.",
                                                 metavar="FILE")] = None,
) -> None:
    """Fit natural frequency, damping, rate limit and delay of the second-order model to the nonlinear one."""
    from ..studies import fitting

    with failures():
        check_outputs(output, as_json, inputs=parameters or ())
        fitted = fitting.fit(load_parameters(parameters))
        if output:
            fitting.write_fitted(fitted, output, shlex.join(["emcas", "fit", *parameter_arguments(parameters)]))
        if as_json:
            write_json(fitted.figures(), as_json)
    entries = {e.variable.name: e for e in fitted.parameters.entries}
    for name in fitting.NAMES:
        out.print(f"{name} = {entries[name].value:.4g} {entries[name].variable.unit}", highlight=False)
    table = Table("step / deg", "largest difference / %", "rms / %")
    for size, largest, rms in zip(fitted.sizes, fitted.largest, fitted.rms, strict=True):
        table.add_row(f"{size:g}", f"{largest:.2g}", f"{rms:.2g}")
    out.print(table)
    print_written(output)
