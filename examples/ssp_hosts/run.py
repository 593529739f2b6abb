"""Run an SSP archive in a host: `python examples/ssp_hosts/run.py --help`."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Annotated

import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

EPILOG = ("Examples:\n\n  python examples/ssp_hosts/run.py EMCAS.ssp --set 'fin1.fin_command=0.1'"
          "\n\n  python examples/ssp_hosts/run.py EMCAS.ssp --host libcosimpy --variant cold --output cold.csv")


def run(
    ssp: Annotated[Path, typer.Argument(help="Archive to run.", metavar="FILE.ssp")],
    host: Annotated[str, typer.Option(help="fmpy, libcosimpy or ecospy.")] = "fmpy",
    variant: Annotated[str, typer.Option(help="Variant of the archive.")] = "nominal",
    inputs: Annotated[list[str] | None, typer.Option("--set", help="Constant value of an input. Repeatable.",
                                                     metavar="NAME=VALUE")] = None,
    duration: Annotated[float, typer.Option(help="Duration of the run [s].")] = 0.3,
    step: Annotated[float, typer.Option(help="Step of the host [s].")] = 1e-3,
    output: Annotated[Path, typer.Option("--output", "-o", help="CSV file of all outputs.")] = Path("outputs.csv"),
) -> None:
    """Step a variant of an archive in a host, with constant inputs, and write its outputs."""
    from emcas_fmu.commands.common import check_outputs
    from emcas_fmu.errors import EmcasError
    from examples.ssp_hosts import hosts

    try:
        check_outputs(output, inputs=[ssp])
        with hosts.open(ssp, host, variant, step) as system, output.open("w", encoding="utf-8", newline="") as file:
            for setting in inputs or []:
                name, _, text = setting.partition("=")
                try:
                    system.set(name, text == "true" if text in ("true", "false") else float(text))
                except ValueError as error:
                    raise EmcasError(f"--set {setting}: expected NAME=VALUE with a number, true or false") from error
            rows = csv.writer(file)
            rows.writerow(["time", *system.outputs])
            for _ in range(round(duration / step)):
                system.step()
                rows.writerow([system.time, *(float(system.get(name)) for name in system.outputs)])
    except (EmcasError, OSError) as error:
        typer.echo(f"Error: {error}", err=True)
        raise typer.Exit(2) from error
    typer.echo(f"written {output}")


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command(epilog=EPILOG)(run)
    command()
