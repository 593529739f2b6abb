"""Parts that commands share: options for a model, its parameters and outputs; checks; failures; progress."""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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

from ..actuators import EXTENSIONS, FMU_ONLY, HALVES, NAMES, NONLINEAR, split
from ..errors import EmcasError, EmcasWarning, in_words, writing
from ..pages.terminal import table as table
from ..plotting import PICTURES, check_image
from ..support.files import as_given
from ..support.progress import LOG, Progress
from ..support.writing import try_file, try_folder

if TYPE_CHECKING:
    from ..bench.subject import Subject
    from ..parameters import ParameterSet

# Characters that control a terminal or reverse the order of text. In names or texts from files they could hide or forge
# output. Half of a surrogate pair cannot be printed at all.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


class _Plain(Console):
    """A console that prints control characters in texts as escapes such as ``\\x1b``."""

    def render(self, *args: Any, **kwargs: Any) -> Iterable[Segment]:
        """Yield the segments of an object's text, with control characters escaped."""
        for text, style, control in super().render(*args, **kwargs):
            yield Segment(text if control else _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text), style, control)


out = _Plain(highlight=False)
err = _Plain(stderr=True, highlight=False)

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C stopped."""


class _Notes(logging.Handler):
    """Prints announcements of slow work, such as compiling, on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        err.print(escape(record.getMessage()), style="dim", soft_wrap=True)


@contextmanager
def failures() -> Iterator[None]:
    """Print an expected error as a message and exit with 2, without a traceback; print warnings and announcements.

    The functions of all commands run within this context.
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
        message = in_words(error) if isinstance(error, OSError) else str(error)
        err.print(f"[bold red]error:[/] {escape(message)}", soft_wrap=True)
        raise typer.Exit(2) from error


@failures()
def _file(argument: Path | None) -> Path | None:
    """Return the path of the file, or of the shipped set, that an argument names. Raises typer.Exit."""
    from ..parameters import parameter_file

    return argument and parameter_file(argument)


def _files(arguments: list[Path] | None) -> list[Path] | None:
    return arguments and [file for argument in arguments if (file := _file(argument))]


@failures()
def _date(text: str) -> str:
    """Return a date in ISO format; an empty text stays empty. Raises typer.Exit."""
    try:
        return text and calendar.fromisoformat(text).isoformat()
    except ValueError as error:
        raise EmcasError(f"--date {text}: expected a date such as 2026-03-31") from error


def ends_in(ending: str, remedy: str = "") -> Callable[[Path | None], Path | None]:
    """Return a callback that raises typer.Exit, after a message with the `remedy`, for a path without the `ending`.

    The callback accepts existing terminals, pipes and folders; `check_outputs` refuses folders.
    """
    @failures()
    def check(path: Path | None) -> Path | None:
        if path and path.suffix.lower() != ending and (path.is_file() or not path.exists()):
            raise EmcasError(f"{path}: the name of this file must end in {ending}{remedy}")
        return path

    return check


def value(what: str, metavar: str, *names: str, ending: str = "", **more: Any) -> Any:
    """Return an option with a value and the help `what`; `names` are needed if they differ from the argument's name.

    If the value is a file, `ending` is the required ending of its name. `more` are arguments of typer.Option.
    """
    if ending:
        more["callback"] = ends_in(ending)
    return typer.Option(*names, help=what, metavar=metavar, **more)


def page_option(*names: str, what: str = "Write a page with pictures to this file.") -> Any:
    """Return the option for a page."""
    return value(what, "FILE.html", *names,
                 callback=ends_in(".html", "; print the page from a browser for another format"))


def json_option(what: str) -> Any:
    """Return the option --json, which names a file."""
    return value(what, "FILE", "--json", ending=".json")


def output_option(what: str, ending: str = ".toml") -> Any:
    """Return the option --output, which names a parameter file or, with another `ending`, another file."""
    return value(what, "FILE", "--output", "-o", ending=ending)


def plot_option(what: str, more: str = "") -> Any:
    """Return the option --plot; `what` begins its help, `more` ends it."""
    return value(f"{what} to this file: .html, .svg, .png or .pdf.{more}", "FILE", "--plot",
                 callback=failures()(lambda path: check_image(path, PICTURES)))


def _not_fmu_only(model: str | None) -> str | None:
    """Return the model of an option. Raises EmcasError for a model that exists only as an FMU."""
    if only := [each for each in FMU_ONLY if model and each in split(model)[1]]:
        what, option = ("half an actuator", "part") if only[0] in HALVES else ("an output torque", "interface")
        raise EmcasError(f"--model {model}: leave +{only[0]} out; {what} exists only as an FMU: emcas build "
                         f"--{option} {only[0]}")
    return model


def model_option(what: str, more: str = "") -> Any:
    """Return the option --model; `what` begins its help, `more` ends it."""
    return value(f"{what}: {', '.join(NAMES)}, or a Python file that declares one. Append extensions with +, as in "
                 f"elastic+heat+faults: {', '.join(EXTENSIONS)}.{more}", "NAME|FILE.py[+EXTENSION...]", "--model",
                 callback=failures()(_not_fmu_only))


def examples(command: str, *arguments: str, first: str = "Examples:", last: Sequence[str] = ()) -> str:
    """Return the end of a command's help, in paragraphs: `first`, an example for each of the `arguments`, `last`."""
    return "\n\n".join([first, *(f"  emcas {command} {each}".rstrip() for each in arguments), *last])


ModelOption = Annotated[str, model_option("Actuator")]
SubjectArgument = Annotated[Path | None, typer.Argument(
    help="FMU (.fmu), parameter file (.toml) or the name of a shipped set (emcas parameters --sets). Default: "
         "the shipped parameters.", metavar="[FMU|TOML|SET]", show_default=False, callback=_file)]
SubjectModelOption = Annotated[str | None, model_option(
    "Actuator of a parameter file", " Default: nonlinear. An FMU needs this option only if your own Python file "
                                    "declares its actuator.")]
ParametersOption = Annotated[list[Path] | None, value(
    "Parameter file (TOML), or the name of a shipped set (emcas parameters --sets). Its values override the defaults. "
    "Repeatable: a later file overrides the earlier ones.", "FILE|SET", "--parameters", "-p", callback=_files)]
FinOption = Annotated[int | None, value("Number of the fin in an FMU with several fins. Default: 1.", "N", min=1)]
LayoutOption = Annotated[str | None, value(
    "Placement of several fins: plus (one fin along body y) or cross (turned by half the angle between two fins). "
    "Default: cross.", "plus|cross")]
FinFilesOption = Annotated[list[str] | None, value(
    "Parameter file for fin N of several; it overrides the files for all fins. Repeatable.", "N=FILE")]
JsonOption = Annotated[Path | None, json_option("Write all figures to this file.")]
JunitOption = Annotated[Path | None, value("Write JUnit XML to this file.", "FILE", ending=".xml")]
DateOption = Annotated[str, value("Date to print, such as 2026-03-31. Default: SOURCE_DATE_EPOCH or today (UTC).",
                                  "DATE", show_default=False, callback=_date)]
ReportOption = Annotated[Path | None, page_option()]
RequirementsOption = Annotated[Path | None, value(
    "File of requirements (TOML). Default: the actuator's in models/requirements, otherwise models/requirements.toml; "
    "docs/use/requirements.md.", "FILE.toml", ending=".toml")]


def placed(fins: int, layout: str | None, arguments: Iterable[str] | None) -> tuple[str, dict[int, Path]]:
    """Return the layout of several fins, and the files of single fins by number, from the `arguments` of --fin.

    Raises EmcasError if these options appear with one fin, or for an argument that is not N=FILE.
    """
    from ..fmi.interface import fin_files

    if fins == 1 and (layout or arguments):
        raise EmcasError("--layout and --fin are for several fins; add --fins with their number")
    return layout or "cross", fin_files(list(arguments or ()))


def warn(warnings: Iterable[str]) -> None:
    """Print each warning once, on standard error, since programs may read standard output."""
    for warning in dict.fromkeys(warnings):
        err.print(f"[bold yellow]warning:[/] {escape(warning)}", soft_wrap=True)


def parameter_set(files: Iterable[Path] | None, model: str = NONLINEAR) -> ParameterSet:
    """Load parameters as `load_parameters` does, and print their warnings. Raises ParameterError."""
    from ..parameters import load_parameters

    chosen = load_parameters(files, model=model)
    warn(chosen.warnings)
    return chosen


def nonlinear_set(files: Iterable[Path] | None, command: str) -> ParameterSet:
    """Load parameters for a `command` that supports only the nonlinear actuator, and print their warnings.

    Raises ParameterError, or EmcasError with one line if the parameters belong to another actuator.
    """
    from ..parameters import ParameterError

    try:
        return parameter_set(files)
    except ParameterError as error:
        unknown = [problem.partition(" = ")[0].rpartition(": ") for problem in error.problems
                  if ": unknown parameter" in problem]
        if len(unknown) < max(2, len(error.problems)):  # a single misspelt name, or another mistake
            raise
        names = ", ".join(name for _, _, name in unknown)
        raise EmcasError(f"{unknown[0][0]}: {command} needs the parameters of the nonlinear actuator, which has no "
                         f"{names}; give a parameter file of that actuator") from error


@contextmanager
def open_subject(path: Path | None, model: str | None = None, fin: int | None = None,
                 parameters: Sequence[Path] | None = None) -> Iterator[Subject]:
    """Open a subject as `fmu_subject.open_subject` does, and print its warnings. Raises EmcasError, ParameterError."""
    from ..bench import fmu_subject

    with fmu_subject.open_subject(path, model, fin, parameters) as opened:
        warn(opened.warnings)
        yield opened


def say(line: str) -> None:
    """Print a line of text, which the terminal may wrap."""
    out.print(line, soft_wrap=True)


def write_results(result: Any, *outputs: tuple[Path | None, Callable[[Any, Path], object]]) -> None:
    """Write a result to each path that is not None, by the function beside it."""
    for path, write in outputs:
        if path:
            write(result, path)


def write_json(figures: Mapping[str, Any], path: Path | None) -> None:
    """Write figures as JSON, unless the path is None."""
    from ..bench import writers

    write_results(figures, (path, writers.write_json))


def conclude(parts: Iterable[Any], *written: Path | None, passed: bool | None = True) -> None:
    """Print the parts of a result and the paths of the written files; exit with 1 if `passed` is False."""
    for part in parts:
        out.print(part)
    print_written(*written)
    if passed is False:
        raise typer.Exit(1)


def print_written(*paths: Path | None) -> None:
    """Print the paths of the files that a command has written; None is left out."""
    for path in filter(None, paths):
        say(f"written {escape(str(path))}")


def parameter_arguments(files: Iterable[Path] | None, shown: Callable[[str], str] = str) -> list[str]:
    """Return the arguments that name parameter files, each passed through `shown`, for the command line in a result."""
    return [argument for file in files or () for argument in ("--parameters", shown(as_given(file)))]


def option(name: str, value: object, default: object = None) -> list[str]:
    """Return an option and its value for the command line in a result; an empty list for None and the default."""
    return [] if value in (None, default) else [name, str(value)]


def check_outputs(*files: Path | None, folders: Iterable[Path] = (),
                  inputs: Iterable[Path | Iterable[Path] | None] = ()) -> None:
    """Check, before long work, that outputs can be written and differ from the inputs and from each other.

    The folders of `files` must exist or be among the `folders`, which are made later. An input is one path or several;
    if it is a folder, no output may be in it. Raises EmcasError.
    """
    made = [folder.resolve() for folder in folders]
    for folder in made:
        existing = next(above for above in (folder, *folder.parents) if above.exists())
        if not existing.is_dir():
            raise EmcasError(f"{existing}: is a file; give a folder for the output")
        try_folder(existing, folder)
    read = [path.resolve() for each in inputs for path in ([each] if isinstance(each, Path) else each or ())]
    written: set[Path] = set()
    for path in filter(None, files):
        with writing(path):
            target = path.resolve()
            if path.is_dir():
                raise EmcasError(f"{path}: is a folder; give a file for the output")
            if path.exists() and not path.is_file():  # a terminal or a pipe
                continue
            if any(target == source or (source.is_dir() and source in target.parents) for source in read):
                raise EmcasError(f"{path}: is read by this command and would be overwritten; write to another file")
            if target in written:
                raise EmcasError(f"{path}: is the path of two outputs; write each to a different file")
            written.add(target)
            if not target.parent.is_dir():
                if target.parent in made:
                    continue
                raise EmcasError(f"{path}: there is no folder {path.parent}; make it first")
        try_file(path)


def progress_bar() -> Bars:
    """Return a progress bar on standard error with the remaining time; it disappears at the end of the work."""
    # Disabled without a terminal, where it would leave an empty line. A step may take minutes, so the remaining time is
    # estimated from the steps of the last hour.
    return Bars(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                TextColumn("remaining about"), TimeRemainingColumn(), console=err, transient=True,
                speed_estimate_period=3600.0, disable=not err.is_terminal)


def stepper(bars: Bars, label: str) -> Progress:
    """Add a task to a progress bar, and return the callback that updates it."""
    task = bars.add_task(label, total=None)
    return lambda name, done, total: bars.update(task, description=f"{label} {name}", completed=done, total=total)


def _lines(label: str) -> Progress:
    """Return a callback that prints a line on standard error whenever another part is done or a stage begins."""
    last = 0, ""

    def report(name: str, done: int, total: int) -> None:
        nonlocal last
        if (now := (done, name.partition(",")[0])) != last:
            last = now
            err.print(escape(f"{label} {done} of {total}: {name}"), soft_wrap=True)

    return report


@contextmanager
def work(label: str, lines: bool = False) -> Iterator[Progress]:
    """Show a progress bar for the work of a command, and yield the callback that updates it.

    Without a terminal the callback prints lines if `lines` is true, otherwise nothing.
    """
    with progress_bar() as bars:
        yield _lines(label) if lines and not err.is_terminal else stepper(bars, label)
