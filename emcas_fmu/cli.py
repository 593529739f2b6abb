"""The `emcas` command. Exit codes: 0 success, 1 failed check, 2 impossible request, 130 Ctrl-C, 141 closed pipe."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from . import __version__
from .commands.group import LazyGroup, check_environment, load, printing

app = typer.Typer(cls=LazyGroup, no_args_is_help=True, add_completion=False, rich_markup_mode="rich")


def _version(value: bool) -> None:
    if value:
        print(f"emcas {__version__}")
        raise typer.Exit


@app.callback()
def main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                               help="Print the version and exit.")] = False) -> None:
    """Simulate fin actuators for flight simulation, or build them as FMUs for co-simulation (FMI 2.0 or 3.0).

    emcas COMMAND --help prints a command's options and examples.
    """


def build_command() -> None:
    """Run `emcas build` as the program build_fmu.py."""
    with printing():
        try:
            check_environment()
        except typer.Exit as stop:
            sys.exit(stop.exit_code)
        load("build", "python build_fmu.py")()


if __name__ == "__main__":
    sys.exit(app())
