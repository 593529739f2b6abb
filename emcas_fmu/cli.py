"""The `emcas` command. Exit codes: 0 done, 1 a check failed, 2 the request cannot be carried out."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from . import __version__
from .bench.provenance import made_by
from .commands import (
    analyse,
    baseline,
    build,
    campaign,
    compare,
    envelope,
    explore,
    fit,
    identify,
    parameters,
    reference,
    report,
    simulate,
    ssp,
    thesis,
    tune,
    validate,
)
from .commands.common import out


class Commands(TyperGroup):
    """The commands; what a command writes can say how it was called."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the arguments as they were given, for as long as the command runs."""
        ctx.with_resource(made_by(["emcas", *args]))
        return super().parse_args(ctx, args)


app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, rich_markup_mode="rich",
                  help="Electromechanical control actuation system as an FMI 2.0 co-simulation FMU.")
app.command(epilog=analyse.EPILOG)(analyse.analyse)
app.add_typer(baseline.app, name="baseline")
app.command(epilog=build.EPILOG)(build.build)
app.command(epilog=campaign.EPILOG)(campaign.campaign)
app.command(epilog=compare.EPILOG)(compare.compare)
app.command(epilog=envelope.EPILOG)(envelope.envelope)
app.command(epilog=explore.EPILOG)(explore.explore)
app.command(epilog=fit.EPILOG)(fit.fit)
app.add_typer(identify.app, name="identify")
app.command(name="parameters", epilog=parameters.EPILOG)(parameters.show_parameters)
app.command(epilog=reference.EPILOG)(reference.reference)
app.command(epilog=report.EPILOG)(report.report)
app.command(epilog=simulate.EPILOG)(simulate.simulate)
app.add_typer(ssp.app, name="ssp")
app.command(epilog=thesis.EPILOG)(thesis.thesis)
app.command(epilog=tune.EPILOG)(tune.tune)
app.command(epilog=validate.EPILOG)(validate.validate)


def _version(value: bool) -> None:
    if value:
        out.print(f"emcas {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                               help="Print the version and exit.")] = False) -> None:
    """Electromechanical control actuation system as an FMI 2.0 co-simulation FMU."""


def build_command() -> None:
    """`emcas build` as a program of its own."""
    program = typer.Typer(add_completion=False, rich_markup_mode="rich")
    program.command(epilog=build.EPILOG.replace("emcas build", "python build_fmu.py"))(build.build)
    program()


if __name__ == "__main__":
    sys.exit(app())
