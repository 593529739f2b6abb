"""The group of commands. A command is imported only when it is called, so that help and version appear at once."""

from __future__ import annotations

import inspect
import os
import re
import sys
from collections import UserDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any, TextIO, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from ..errors import unwritable
from ..support.dates import today
from .common import failures

# Set before NumPy is imported. The matrices are small: threads in linear algebra gain nothing, and on busy cores they
# wait for each other much longer than they work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

UNREAD = 141
"""Exit code if the reader of the output has closed the pipe, as shells report it for any program."""

# Commands by the panels of `emcas --help`, in its order. The module with a command's name, in this folder, has either a
# function of that name, whose arguments are the options, and an EPILOG of examples, or an `app` of several commands.
# The first line of the module describes the command in `emcas --help`.
PANELS: Mapping[str, tuple[str, ...]] = {
    "Use": ("init", "simulate", "build", "parameters", "ssp"),
    "Design": ("explore", "analyse", "envelope", "compare", "identify", "calibrate", "tune", "fit"),
    "Check": ("validate", "report", "campaign", "baseline", "reference"),
}


def sentence(name: str) -> str:
    """Return the sentence that describes a command, read from the first line of its file without importing it."""
    with files(__package__).joinpath(f"{name}.py").open(encoding="utf-8") as file:
        text = file.readline().strip().strip('"').rpartition("`: ")[2]
    return text[:1].upper() + text[1:]


def check_environment() -> None:
    """Exit with 2 if SOURCE_DATE_EPOCH is not a valid time: parts of NumPy read it when they are imported."""
    with failures():
        today()


@cache
def load(name: str, program: str = "") -> Any:
    """Import a command and return it; its examples call `program`, by default ``emcas NAME``."""
    module = import_module(f".{name}", __package__)
    if (app := getattr(module, "app", None)) is None:
        app = typer.Typer(add_completion=False, rich_markup_mode="rich")
        called = f"emcas {name}"
        app.command(name, epilog=module.EPILOG.replace(called, program or called))(
            failures()(getattr(module, name)))
    command = get_command(app)
    command.name = name
    return readable(command)


def readable(command: Any) -> Any:
    """Return a command after changing its help, which then wraps only at the terminal's width and shows no types."""
    command.help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(command.help or ""))
    for parameter in command.get_params(typer.Context(command)):  # with --help
        if parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: None  # its metavar is enough
        elif parameter.metavar is None:
            parameter.metavar = "" if parameter.is_flag else "VALUE"
    for each in getattr(command, "commands", {}).values():
        readable(each)
    return command


class _Printed:
    """Standard output that ends the program if writing fails: with one line and exit code 2, or with UNREAD alone if
    the reader has closed the pipe.

    An OSError would look like the error of a file, and libraries that print handle it in different ways.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write text. Raises SystemExit."""
        with self._ending():
            return self.stream.write(text)

    def flush(self) -> None:
        """Flush the stream. Raises SystemExit."""
        with self._ending():
            self.stream.flush()

    @contextmanager
    def _ending(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            sink = os.open(os.devnull, os.O_WRONLY)  # receives what the interpreter flushes when it ends
            os.dup2(sink, self.stream.fileno())
            os.close(sink)
            if isinstance(error, BrokenPipeError):
                raise SystemExit(UNREAD) from error
            print(f"error: {unwritable('standard output', error)}", file=sys.stderr)
            raise SystemExit(2) from error


@contextmanager
def printing() -> Iterator[None]:
    """End a command whose standard output cannot be written, without a traceback, as :class:`_Printed` describes."""
    stream = sys.stdout
    if stream is None:  # closed by the shell
        yield
        return
    sys.stdout = cast(TextIO, _Printed(stream))
    try:
        yield
    except SystemExit:
        sys.stdout.flush()
        raise
    else:
        sys.stdout.flush()
    finally:
        sys.stdout = stream


class _Commands(UserDict[str, Any]):
    """Commands by name, each imported when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        return load(super().__getitem__(name))


class LazyGroup(TyperGroup):
    """The commands of `PANELS`."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = cast(Any, _Commands({name: name for names in PANELS.values() for name in names}))

    def main(self, *args: Any, **named: Any) -> Any:
        """Run a command; if its output cannot be written, end as `printing` does."""
        with printing():
            return super().main(*args, **named)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, and store them while the command runs, for pages, which name their command."""
        check_environment()
        if args and args[0] in self.commands:
            from ..pages.provenance import made_by

            ctx.with_resource(made_by(["emcas", *args]))
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, in the order of the panels."""
        return list(self.commands)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the summary of every command, without importing the commands."""
        listed: dict[str, Any] = {name: TyperCommand(name, help=sentence(name), rich_help_panel=panel)
                                  for panel, names in PANELS.items() for name in names}
        shown = TyperGroup(name=self.name, commands=listed, params=self.params, help=self.help,
                           rich_markup_mode=self.rich_markup_mode)
        readable(shown).format_help(ctx, formatter)
