"""The group of commands. Each is imported when it is called, so that help and version appear at once."""

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

# Set before NumPy is imported. The matrices are small: threads of the linear algebra gain nothing, and on busy cores
# they wait for each other many times as long as they work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

UNREAD = 141
"""Exit code of a command whose reader has closed the pipe, as shells report it for any program."""

# The commands by the panels of `emcas --help`, in their order. Each is the module of its name in this folder, with a
# function of that name and an EPILOG, or with an `app` of several; its docstring begins with the line that is listed.
PANELS: Mapping[str, tuple[str, ...]] = {
    "Use": ("init", "simulate", "build", "parameters", "ssp"),
    "Design": ("explore", "analyse", "envelope", "compare", "identify", "calibrate", "tune", "fit"),
    "Check": ("validate", "report", "campaign", "baseline", "reference"),
}


def summary(name: str) -> str:
    """Return the sentence that describes a command, from the first line of its file; the file is not imported."""
    with files(__package__).joinpath(f"{name}.py").open(encoding="utf-8") as file:
        text = file.readline().strip().strip('"').rpartition("`: ")[2]
    return text[:1].upper() + text[1:]


def check_environment() -> None:
    """Exit with 2 if SOURCE_DATE_EPOCH is not a time: parts of NumPy read it when they are imported."""
    with failures():
        today()


@cache
def load(name: str, program: str = "") -> Any:
    """Import a command and return it; its examples call `program`, by default emcas and its name."""
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
    """Return a command whose help wraps at the terminal's width only, and shows no types such as <bool> or <path>."""
    command.help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(command.help or ""))
    for parameter in command.get_params(typer.Context(command)):  # with --help
        if parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: None  # the help shows its metavar
        elif parameter.metavar is None:
            parameter.metavar = "" if parameter.is_flag else "VALUE"
    for each in getattr(command, "commands", {}).values():
        readable(each)
    return command


class _Printed:
    """Standard output that ends the program if it cannot be written, quietly if its reader has gone.

    An OSError would look like that of a file, and the libraries that print treat it differently.
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
            nowhere = os.open(os.devnull, os.O_WRONLY)  # for what the interpreter flushes when it ends
            os.dup2(nowhere, self.stream.fileno())
            os.close(nowhere)
            if isinstance(error, BrokenPipeError):
                raise SystemExit(UNREAD) from error
            print(f"error: {unwritable('standard output', error)}", file=sys.stderr)
            raise SystemExit(2) from error


@contextmanager
def printing() -> Iterator[None]:
    """End a command whose output cannot be written with one line and exit code 2, not with a traceback."""
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
        """Run a command; if its output cannot be written, end with one line."""
        with printing():
            return super().main(*args, **named)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, and keep them while the command runs: pages name the command that made them."""
        check_environment()
        if args and args[0] in self.commands:
            from ..pages.provenance import made_by

            ctx.with_resource(made_by(["emcas", *args]))
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, in the order of the panels."""
        return list(self.commands)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the summary of every command, without importing any."""
        listed: dict[str, Any] = {name: TyperCommand(name, help=summary(name), rich_help_panel=panel)
                                  for panel, names in PANELS.items() for name in names}
        shown = TyperGroup(name=self.name, commands=listed, params=self.params, help=self.help,
                           rich_markup_mode=self.rich_markup_mode)
        readable(shown).format_help(ctx, formatter)
