"""`emcas thesis`: reproduce the thesis figure by figure and table by table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import common

EPILOG = ("Examples:\n\n  emcas thesis --output thesis.html\n\n  emcas thesis --only 5.18 --only \"Table 20\""
          "\n\n  emcas thesis -p my_actuator.toml --output mine.html --json mine.json")


def thesis(
    parameters: common.ParametersOption = None,
    output: Annotated[Path | None, common.page_option(
        "--output", "-o", what="Page to write; thesis.html unless given, with --only none.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Only this entry: a figure by its number, a table as in "
                                                        "\"Table 4\" (may be given several times).",
                                                   metavar="ENTRY")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Go through the thesis's lists of figures and tables: what meets the thesis, what has own values, and why not.

    The whole takes about a minute. Exit code 1: an entry could not be carried out with these parameters.
    """
    from ..studies.thesis.entries import find
    from ..studies.thesis.output import summary, write_json, write_page
    from ..studies.thesis.runs import Runs
    from ..studies.thesis.study import carry_out

    page = output if output or only else Path("thesis.html")
    with common.failures():
        common.check_outputs(page, as_json, inputs=parameters or ())
        entries, runs = find(only or ()), Runs(parameters or ())
        common.warn(runs.parameters.warnings)
        with common.progress_bar() as bars:
            result = carry_out(runs, entries, common.stepper(bars, "thesis"))
        if page:
            write_page(result, page)
        if as_json:
            write_json(result, as_json)
    for part in summary(result, not only):
        common.out.print(part, highlight=False, soft_wrap=isinstance(part, str))
    common.print_written(page, as_json)
    if result.stopped:
        raise typer.Exit(1)
