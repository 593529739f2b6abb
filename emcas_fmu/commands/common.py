"""What the commands share: output, failures, progress, the option for parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..actuators import NAMES, OPTIONS
from ..errors import EmcasError
from ..parameters import ParameterError

out = Console()
err = Console(stderr=True)

ModelOption = Annotated[str, typer.Option(
    "--model", help=f"Which model of the actuator: {', '.join(NAMES)}. Behind it options, as in elastic+heat+faults: "
                    f"{', '.join(OPTIONS)}.", metavar="NAME[+OPTION...]")]
SubjectModelOption = Annotated[str | None, typer.Option(
    "--model", help="Which actuator a parameter file is of, with its options, as in elastic+heat; nonlinear unless "
                    "given. An FMU tells it by its name.", metavar="NAME[+OPTION...]")]
FinOption = Annotated[int | None, typer.Option(help="Which fin of a unit of several; the first unless given.",
                                               metavar="N")]
ParametersOption = Annotated[Path | None, typer.Option(
    "--parameters", "-p", help="Parameter file (TOML); overrides any subset of the defaults.", metavar="FILE")]


@contextmanager
def failures() -> Iterator[None]:
    """Expected failures as a message and exit code 2, never a traceback."""
    try:
        yield
    except (EmcasError, ParameterError, OSError) as error:
        err.print(f"[bold red]error:[/] {escape(str(error))}", highlight=False, soft_wrap=True)
        raise typer.Exit(2) from error


def check_outputs(*paths: Path | None, inputs: Iterable[Path | None] = ()) -> None:
    """Before long work: files to be written must have a folder, and be neither inputs nor each other.

    An input may be a folder: nothing in it may be written then. Raises EmcasError.
    """
    read = [path.resolve() for path in inputs if path is not None]
    taken: set[Path] = set()
    for path in paths:
        if path is None:
            continue
        target = path.resolve()
        if any(target == own or (own.is_dir() and own in target.parents) for own in read):
            raise EmcasError(f"{path}: is read by this command and would be overwritten; write to another file")
        if target in taken and target != Path("/dev/stdout"):
            raise EmcasError(f"{path}: is given for two outputs; write each to a file of its own")
        taken.add(target)
        if path is not None and path.is_dir():
            raise EmcasError(f"{path}: is a folder")
        if path is not None and not path.parent.is_dir():
            raise EmcasError(f"{path}: there is no folder {path.parent}; make it first")


def progress_bar() -> Progress:
    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                    console=err, transient=True)


def stepper(progress: Progress, label: str) -> Callable[[str, int, int], None]:
    """A callback(name, done, total) that moves a progress bar."""
    task = progress.add_task(label, total=None)
    return lambda name, done, total: progress.update(task, description=f"{label} {name}", completed=done, total=total)
