"""The group of commands: each is imported when it is called, so that help and version come at once."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.resources import files
from typing import Any, TextIO, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from ..errors import unwritable
from ..support.dates import today
from .common import failures

# Before NumPy comes. The matrices here are small: threads of the linear algebra gain nothing, and where the cores are
# busy their waiting for each other takes many times the work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

UNREAD = 141
"""Exit code of a command whose output nobody reads to its end, as a shell has it of any program."""

# What `emcas --help` lists, by the panels it stands in and in their order. A command is the module here of its name,
# whose docstring begins with what is listed; in it the function of that name with its EPILOG, or an `app` of several.
PANELS: Mapping[str, tuple[str, ...]] = {
    "Use": ("init", "simulate", "build", "parameters", "ssp"),
    "Design": ("explore", "analyse", "envelope", "compare", "identify", "tune", "fit"),
    "Check": ("validate", "report", "campaign", "baseline", "reference"),
}


def summary(name: str) -> str:
    """Return what a command does, in a sentence: the first line of its file, without its name, unread but for that."""
    with files(__package__).joinpath(f"{name}.py").open(encoding="utf-8") as file:
        text = file.readline().strip().strip('"').rpartition("`: ")[2]
    return text[:1].upper() + text[1:]


def check_environment() -> None:
    """Exit with 2 where SOURCE_DATE_EPOCH is no time: NumPy, too, reads it, when a part of it is first imported."""
    with failures():
        today()


def load(name: str, program: str = "") -> Any:
    """Import a command and return it; its examples call it `program`, or emcas and its name."""
    module = import_module(f".{name}", __package__)
    if (app := getattr(module, "app", None)) is None:
        app = typer.Typer(add_completion=False, rich_markup_mode="rich")
        called = f"emcas {name}"
        app.command(name, epilog=module.EPILOG.replace(called, program or called))(getattr(module, name))
    command = get_command(app)
    command.name = name
    return without_types(command)


def without_types(command: Any) -> Any:
    """Return a command whose help shows what a value means, not its Python type: no <bool>, <path> or <list[str]>."""
    for parameter in command.get_params(typer.Context(command)):  # --help is among them
        if parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: None  # its metavar stands before it
        elif parameter.metavar is None:
            parameter.metavar = "" if parameter.is_flag else "VALUE"
    for each in getattr(command, "commands", {}).values():
        without_types(each)
    return command


class _Printed:
    """Standard output that ends the program where it cannot be written: with a line, or quietly where nobody reads it
    any more. An OSError would look like one of a file, and the libraries that print do not agree on what to do with it.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write as the stream does. Raises SystemExit."""
        with self._ending():
            return self.stream.write(text)

    def flush(self) -> None:
        """Have it all written. Raises SystemExit."""
        with self._ending():
            self.stream.flush()

    @contextmanager
    def _ending(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            nowhere = os.open(os.devnull, os.O_WRONLY)  # for what the interpreter has left to write when it ends
            os.dup2(nowhere, self.stream.fileno())
            os.close(nowhere)
            if isinstance(error, BrokenPipeError):
                raise SystemExit(UNREAD) from error
            print(f"error: {unwritable('standard output', error)}", file=sys.stderr)
            raise SystemExit(2) from error


@contextmanager
def printing() -> Iterator[None]:
    """Let a command end with a line and exit code 2, not with a traceback, where what it prints cannot be written."""
    stream = sys.stdout
    if stream is None:  # the shell has closed it
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


class _Loaded(Mapping[str, Any]):
    """Commands by name, each imported when it is asked for."""

    def __init__(self) -> None:
        self._names = [name for names in PANELS.values() for name in names]
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._made:
            self._made[name] = load(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class LazyGroup(TyperGroup):
    """The commands of `PANELS`."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = cast(Any, _Loaded())

    def main(self, *args: Any, **named: Any) -> Any:
        """Run a command, and end with a line where what it prints cannot be written."""
        with printing():
            return super().main(*args, **named)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the arguments as they were given, for as long as the command runs: pages say how they were made."""
        check_environment()
        if args and args[0] in self.commands:
            from ..bench.provenance import made_by

            ctx.with_resource(made_by(["emcas", *args]))
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, in the order of the panels."""
        return list(self.commands)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """List the commands by their summaries, without importing them."""
        listed: dict[str, Any] = {name: TyperCommand(name, help=summary(name), rich_help_panel=panel)
                                  for panel, names in PANELS.items() for name in names}
        shown = TyperGroup(name=self.name, commands=listed, params=self.params, help=self.help,
                           rich_markup_mode=self.rich_markup_mode)
        without_types(shown).format_help(ctx, formatter)
