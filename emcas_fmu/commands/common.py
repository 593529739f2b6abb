"""What the commands share: the options for a model and its parameters, checks beforehand, failures, progress."""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date as calendar
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.segment import Segment
from rich.table import Table

from ..actuators import EXTENSIONS, NAMES, NONLINEAR
from ..errors import EmcasError, EmcasWarning, in_words, writing
from ..support.files import as_given
from ..support.progress import LOG, Progress
from ..support.writing import try_file, try_folder

if TYPE_CHECKING:
    from ..bench.subject import Subject
    from ..parameters import ParameterSet

# What a terminal acts on, or shows in another order than it is written: in a file's names or texts it would hide or
# forge what is printed. Half a surrogate pair cannot be printed at all.
_ACTS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


class _Plain(Console):
    """A console that prints control characters of what it is given as ``\\x1b``."""

    def render(self, *args: Any, **kwargs: Any) -> Iterable[Segment]:
        """Return what is printed of something, piece by piece, its style apart."""
        for text, style, control in super().render(*args, **kwargs):
            yield Segment(text if control else _ACTS.sub(lambda found: ascii(found[0])[1:-1], text), style, control)


out = _Plain(highlight=False)
err = _Plain(stderr=True, highlight=False)

INTERRUPTED = 130
"""Exit code of a run that was stopped by Ctrl-C."""


class _Notes(logging.Handler):
    """Prints what takes long as it begins, on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(escape(record.getMessage()), style="dim", soft_wrap=True)


@contextmanager
def failures() -> Iterator[None]:
    """Print expected failures as a message and exit with 2, never with a traceback; print warnings and what takes long.
    """
    if not LOG.handlers:
        LOG.addHandler(_Notes())
        LOG.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("default", EmcasWarning)
            warnings.showwarning = lambda message, *_: warn([str(message)])
            yield
    except (EmcasError, OSError) as error:
        said = in_words(error) if isinstance(error, OSError) else str(error)
        err.print(f"[bold red]error:[/] {escape(said)}", soft_wrap=True)
        raise typer.Exit(2) from error


def _file(given: Path | None) -> Path | None:
    """Return the file that an argument means, which may be a shipped set's name: commands get files."""
    if given is None:
        return None
    from ..parameters import parameter_file

    with failures():
        return parameter_file(given)


def _files(given: list[Path] | None) -> list[Path] | None:
    return given and [file for each in given if (file := _file(each))]


def ends_in(ending: str, remedy: str = "") -> Callable[[Path | None], Path | None]:
    """Return a check of an output's name, for an option: it ends as a file of its kind does, or is a terminal or pipe.

    A folder of that name is refused where all outputs are (`check_outputs`).
    """
    def check(path: Path | None) -> Path | None:
        with failures():
            if path and path.suffix.lower() != ending and (path.is_file() or not path.exists()):
                raise EmcasError(f"{path}: such a file ends in {ending}{remedy}")
        return path

    return check


def page_option(*names: str, what: str = "Write a page with pictures to this file.") -> Any:
    """Return an option for a page to write."""
    return typer.Option(*names, help=what, metavar="FILE.html", callback=ends_in(
        ".html", "; print the page from a browser for another format"))


def json_option(what: str) -> Any:
    """Return the option --json for a file to write."""
    return typer.Option("--json", help=what, metavar="FILE", callback=ends_in(".json"))


def csv_option(what: str) -> Any:
    """Return the option --output for a table to write."""
    return typer.Option("--output", "-o", help=what, metavar="FILE", callback=ends_in(".csv"))


def toml_option(what: str) -> Any:
    """Return the option --output for a parameter file to write."""
    return typer.Option("--output", "-o", help=what, metavar="FILE", callback=ends_in(".toml"))


def model_option(what: str, more: str = "") -> Any:
    """Return the option --model; `what` begins its help, `more` ends it."""
    return typer.Option("--model", metavar="NAME|FILE.py[+EXTENSION...]", help=(
        f"{what}: {', '.join(NAMES)}, or a Python file that declares one. Behind it extensions, as in "
        f"elastic+heat+faults: {', '.join(EXTENSIONS)}.{more}"))


ModelOption = Annotated[str, model_option("Which actuator")]
SubjectArgument = Annotated[Path | None, typer.Argument(
    help="FMU (.fmu), parameter file (.toml) or the name of a shipped set (emcas parameters --sets); the shipped "
         "parameters unless given.", metavar="[FMU|TOML|SET]", show_default=False, callback=_file)]
SubjectModelOption = Annotated[str | None, model_option(
    "Which actuator a parameter file is of", " Unless given, nonlinear; an FMU has it in its name, except for an "
                                               "actuator in a file of yours.")]
ParametersOption = Annotated[list[Path] | None, typer.Option(
    "--parameters", "-p", help="Parameter file (TOML), or the name of a shipped set (emcas parameters --sets); "
                               "overrides any subset of the defaults (may be given several times: a later one goes "
                               "over those before it).", metavar="FILE|SET", callback=_files)]
FinOption = Annotated[int | None, typer.Option(help="Which fin of a unit of several; the first unless given.",
                                               metavar="N")]
LayoutOption = Annotated[str, typer.Option(help="Placement of several fins: plus has one along body y, cross is half a "
                                                "pitch further.",
                                           metavar="plus|cross")]
FinFilesOption = Annotated[list[str] | None, typer.Option(
    help="Parameter file of one of several fins, over the others' (may be given several times).", metavar="N=FILE")]
JsonOption = Annotated[Path | None, json_option("Write all figures to this file.")]
JunitOption = Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.", metavar="FILE",
                                                 callback=ends_in(".xml"))]
DateOption = Annotated[str | None, typer.Option(help="Date to print, as 2026-03-31; today's (UTC) unless given, or "
                                                     "that of SOURCE_DATE_EPOCH.", metavar="DATE")]
ReportOption = Annotated[Path | None, page_option()]
RequirementsOption = Annotated[Path | None, typer.Option(
    help="Requirements (TOML) in place of the shipped ones, those of Table 2 and of a flight control's review; "
         "docs/use/requirements.md.", metavar="FILE.toml", callback=ends_in(".toml"))]


def calendar_date(text: str) -> str:
    """Return a date as it is printed. Raises EmcasError."""
    try:
        return calendar.fromisoformat(text).isoformat()
    except ValueError as error:
        raise EmcasError(f"--date {text}: expected a date such as 2026-03-31") from error


def warn(warnings: Iterable[str]) -> None:
    """Print warnings on standard error, each once, so that what a program reads from standard output stays clean."""
    for warning in dict.fromkeys(warnings):
        err.print(f"[bold yellow]warning:[/] {escape(warning)}", soft_wrap=True)


def parameter_set(files: Iterable[Path] | None, model: str = NONLINEAR) -> ParameterSet:
    """Return what `load_parameters` does, and print its warnings. Raises ParameterError."""
    from ..parameters import load_parameters

    chosen = load_parameters(files, model=model)
    warn(chosen.warnings)
    return chosen


@contextmanager
def open_subject(path: Path | None, model: str | None = None, fin: int | None = None,
                 parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """Open the subject as `bench.fmu_subject` does, and print its warnings. Raises EmcasError or ParameterError."""
    from ..bench import fmu_subject

    with fmu_subject.open_subject(path, model, fin, parameters) as opened:
        warn(opened.warnings)
        yield opened


def say(line: str) -> None:
    """Print a line of text, which the terminal may wrap."""
    out.print(line, soft_wrap=True)


def right_aligned(table: Table, *columns: int) -> Table:
    """Return a table with the numbers in some columns, or in all but the first, at their right."""
    for place in columns or range(1, len(table.columns)):
        table.columns[place].justify = "right"
    return table


def write_results(result: Any, *outputs: tuple[Path | None, Callable[[Any, Path], object]]) -> None:
    """Write a result by each function to its path; None is one that was not asked for."""
    for path, write in outputs:
        if path:
            write(result, path)


def print_written(*paths: Path | None) -> None:
    """Print which files a command has written; None for one that was not asked for."""
    for path in filter(None, paths):
        say(f"written {escape(str(path))}")


def parameter_arguments(files: Iterable[Path] | None) -> list[str]:
    """Return the arguments that name parameter files, for a command that is written into a result."""
    return [argument for file in files or () for argument in ("--parameters", as_given(file))]


def check_outputs(*files: Path | None, folders: Iterable[Path] = (), inputs: Iterable[Path | None] = ()) -> None:
    """Check before long work that outputs can be written, and that they are neither inputs nor each other.

    `files` need a folder that is there, or is among the `folders`, which are made later where they are missing. An
    input may be a folder: nothing in it may be written then. Raises EmcasError.
    """
    made = [folder.resolve() for folder in folders]
    for folder in made:
        place = next(above for above in (folder, *folder.parents) if above.exists())
        if not place.is_dir():
            raise EmcasError(f"{place}: is a file; give a folder to write to")
        try_folder(place, folder)
    read = [path.resolve() for path in inputs if path is not None]
    taken: set[Path] = set()
    for path in filter(None, files):
        with writing(path):
            target = path.resolve()
            if path.is_dir():
                raise EmcasError(f"{path}: is a folder; give a file to write to")
            if path.exists() and not path.is_file():  # the terminal, a pipe
                continue
            if any(target == source or (source.is_dir() and source in target.parents) for source in read):
                raise EmcasError(f"{path}: is read by this command and would be overwritten; write to another file")
            if target in taken:
                raise EmcasError(f"{path}: is given for two outputs; write each to a file of its own")
            taken.add(target)
            if not target.parent.is_dir():
                if target.parent in made:
                    continue
                raise EmcasError(f"{path}: there is no folder {path.parent}; make it first")
        try_file(path)


def progress_bar() -> Bars:
    """Return a progress bar with the time left, on standard error, that vanishes when it is done."""
    # Where there is no terminal a bar would leave an empty line.
    # Steps may take minutes: the time left is estimated from those of the last hour.
    return Bars(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                TextColumn("left about"), TimeRemainingColumn(), console=err, transient=True,
                speed_estimate_period=3600.0, disable=not err.is_terminal)


def stepper(bars: Bars, label: str) -> Progress:
    """Return a callback that moves a progress bar."""
    task = bars.add_task(label, total=None)
    return lambda name, done, total: bars.update(task, description=f"{label} {name}", completed=done, total=total)
