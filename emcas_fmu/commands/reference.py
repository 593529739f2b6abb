"""`emcas reference`: regenerate the reference responses by independent integration, or compare with them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ..actuators import NONLINEAR
from ..errors import EmcasError
from . import common

EPILOG = ("Examples:\n\n  emcas reference --check\n\n  emcas reference --case step_plus1 --directory ref"
          "\n\n  emcas reference --parameters my_actuator.toml --directory my_references"
          "\n\n  emcas reference --model my_actuator.py --directory my_references")


def reference(
    directory: Annotated[Path | None, typer.Option(help="Folder of the reference files. Default with "
                                                                 "--check: the shipped ones.", metavar="DIR")] = None,
    case: Annotated[list[str] | None, typer.Option(help="Only this case. Repeatable.",
                                                   metavar="NAME")] = None,
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    check: Annotated[bool, typer.Option("--check", help="Compare with the files there instead of writing.")] = False,
) -> None:
    """Regenerate the reference responses by independent integration, or compare with those stored."""
    from ..reference import files
    from ..support.files import models_directory

    with common.failures():
        if not directory and not check:
            raise EmcasError("--directory is missing: give a folder to write the reference files to")
        if not directory and (parameters or model != NONLINEAR):
            raise EmcasError("--parameters and --model need --directory: the shipped references are of the default "
                             "actuator with its default parameters")
        folder = directory or models_directory() / "reference"
        if not check:
            common.check_outputs(folders=(folder,))
        chosen = common.parameter_set(parameters, model)
        if not check:
            common.check_outputs(*files.outputs(folder, case, chosen), folders=(folder,))
        with common.progress_bar() as progress:
            step = common.stepper(progress, "reference")
            if not check:
                files.regenerate(folder, names=case, progress=step, parameters=chosen)
            else:
                rows = files.compare(folder, names=case, progress=step, parameters=chosen)
    if not check:
        common.say(f"written to {escape(str(folder))}")
        return
    table = Table("case", "variable", "largest difference", "allowed", "")
    for name, variable, difference, tolerance in rows:
        verdict = "ok" if difference <= tolerance else "FAIL"
        table.add_row(name, variable, f"{difference:.3g}", f"{tolerance:.3g}", verdict)
    common.out.print(table)
    if any(difference > tolerance for *_, difference, tolerance in rows):
        raise typer.Exit(1)
