"""`python -m docs.thesis`: reproduce figures and tables of the thesis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from emcas_fmu.commands import common
from emcas_fmu.commands.group import check_environment, printing, readable

PROGRAM = ("python", "-m", "docs.thesis")

EPILOG = ("Examples:\n\n  python -m docs.thesis --output thesis.html\n\n  python -m docs.thesis --only 5.18 --only "
          "\"Table 20\"\n\n  python -m docs.thesis -p my_actuator.toml --output mine.html --json mine.json")

app = typer.Typer(add_completion=False, rich_markup_mode="rich")


class Program(TyperCommand):
    """A program whose output, help and provenance are like those of an `emcas` command."""

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        readable(self)

    def main(self, *args: Any, **named: Any) -> Any:
        """Run the program; end with a one-line message if its output cannot be written."""
        with printing():
            return super().main(*args, **named)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, and store them for the provenance in the page."""
        check_environment()
        from emcas_fmu.pages.provenance import made_by

        ctx.with_resource(made_by([*PROGRAM, *args]))
        return super().parse_args(ctx, args)


@app.command(" ".join(PROGRAM), cls=Program, epilog=EPILOG)
def thesis(
    parameters: common.ParametersOption = None,
    output: Annotated[Path | None, common.page_option(
        "--output", "-o", what="Page to write. Default: thesis.html; with --only no page.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Only this entry: a figure by its number, a table as in "
                                                        "\"Table 4\". Repeatable.",
                                                   metavar="ENTRY")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Show each entry of the thesis's lists of figures and tables, or the reason why it is not shown.

    All entries take about 14 s of processor time. Exit code 1: an entry failed with these parameters.
    """
    from .entries import find
    from .output import summary, write_json, write_page
    from .runs import Runs
    from .study import carry_out

    page = output if output or only else Path("thesis.html")
    with common.failures():
        common.check_outputs(page, as_json, inputs=parameters or ())
        entries, runs = find(only or ()), Runs(parameters or ())
        common.warn(runs.parameters.warnings)
        with common.work("thesis") as step:
            result = carry_out(runs, entries, step)
        if page:
            write_page(result, page)
        if as_json:
            write_json(result, as_json)
    for part in summary(result, not only):
        common.out.print(part, highlight=False, soft_wrap=isinstance(part, str))
    common.print_written(page, as_json)
    if result.stopped:
        raise typer.Exit(1)


if __name__ == "__main__":
    app(prog_name=" ".join(PROGRAM))
