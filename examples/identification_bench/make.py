"""Make records of a simulated test bench: `python examples/identification_bench/make.py --help`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

EPILOG = "Examples:\n\n  python examples/identification_bench/make.py --seed 7 --directory my_bench"


def make(
    directory: Annotated[Path, typer.Option("--directory", help="Folder to write the records into.", metavar="DIR")],
    seed: Annotated[int, typer.Option(help="Seed of the instruments' noise.", min=0)] = 1,
    parameters: Annotated[Path | None, typer.Option("--parameters", "-p", help="Parameter file of the actuator. "
                                                    "Default: the shipped one.", metavar="FILE.toml")] = None,
) -> None:
    """Write simulated records, with the noise and resolution of instruments, and their provenance."""
    from emcas_fmu.commands.common import check_outputs, failures
    from emcas_fmu.parameters import load_parameters
    from examples.identification_bench.bench import write_bench

    with failures():
        check_outputs(folders=[directory])
        written = write_bench(directory, load_parameters(parameters), seed)
    typer.echo(f"written {len(written)} records to {directory}")


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command(epilog=EPILOG)(make)
    command()
