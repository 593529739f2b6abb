"""`emcas init`: write the first files for your actuator."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..parameters import load_parameters
from ..support.writing import write_folder
from . import common

EPILOG = common.examples("init", "my_actuator", "my_actuator --model electrohydrostatic",
                         "my_actuator --model elastic+heat --force")


def init(
    folder: Annotated[Path, typer.Argument(help="Folder for the files; created if missing.",
                                           metavar="FOLDER")] = Path(),
    model: common.ModelOption = NONLINEAR,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Write a parameter file to fill in from datasheets, and files for tuning, campaign and requirements.

    The parameter file lists, as comments, every value that a datasheet, a drawing or the controller can provide, with
    its usual name there, its unit, its default and the source of the default.
    """
    from ..studies.starter import commands, starter_files

    base = load_parameters(model=model)
    files = starter_files(base)
    paths = [folder / name for name in files]
    common.check_outputs(folders=(folder,))
    if (existing := [str(path) for path in paths if path.exists()]) and not force:
        raise EmcasError(f"{', '.join(existing)}: exists already; give another folder, or --force to overwrite")
    write_folder(folder, files)
    common.print_written(*paths)
    first = commands(base, files)[0][0]
    change_folder = "" if folder.resolve() == Path().resolve() else f"cd {shlex.quote(str(folder))} && "
    common.say(f"next: fill in the values that you have, then run {escape(change_folder + first)}")
