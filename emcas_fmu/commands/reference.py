"""`emcas reference`: compute the reference responses by independent integration, or check stored ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ..actuators import NONLINEAR
from ..errors import EmcasError
from . import common

EPILOG = common.examples(
    "reference", "--check", "--case step_plus1 --directory ref",
    "--parameters my_actuator.toml --directory my_references", "--model my_actuator.py --directory my_references")


def reference(
    directory: Annotated[Path | None, common.value("Folder of the reference files. Default with --check: the "
                                                   "package's.", "DIR")] = None,
    case: Annotated[list[str] | None, common.value("Only this case. Repeatable.", "NAME")] = None,
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    check: Annotated[bool, typer.Option("--check", help="Compare with the files in the folder, write none.")] = False,
) -> None:
    """Compute the reference responses by independent integration; write them, or check stored ones."""
    from ..reference import files
    from ..support.files import models_directory

    if not directory and not check:
        raise EmcasError("--directory is missing: give a folder for the reference files")
    if not directory and (parameters or model != NONLINEAR):
        raise EmcasError("--parameters and --model need --directory: the shipped references are for the default "
                         "actuator with its default parameters")
    folder = directory or models_directory() / "reference"
    if not check:  # the folder first, since the names of its files depend on the parameters
        common.check_outputs(folders=(folder,))
    chosen = common.parameter_set(parameters, model)
    if not check:
        common.check_outputs(*files.outputs(folder, case, chosen), folders=(folder,))
    with common.work("reference") as step:
        if not check:
            files.regenerate(folder, names=case, progress=step, parameters=chosen)
            common.say(f"written to {escape(str(folder))}")
            return
        rows = files.compare(folder, names=case, progress=step, parameters=chosen)
    common.conclude([common.table(["case", "variable", "largest difference", "allowed", ""], (
        [name, variable, f"{difference:.3g}", f"{tolerance:.3g}", "ok" if difference <= tolerance else "FAIL"]
        for name, variable, difference, tolerance in rows))],
        passed=all(difference <= tolerance for *_, difference, tolerance in rows))
