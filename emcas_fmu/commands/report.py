"""`emcas report`: carry out an actuator's acceptance test and write the report to sign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import EmcasError
from . import common

EPILOG = ("Examples:\n\n  emcas report\n\n  emcas report EMCAS.fmu --output report.html --date 2026-03-31"
          " --document AT-0042 --revision B"
          "\n\n  emcas report my_actuator.toml --requirements specification.toml --load 60 --junit junit.xml"
          "\n\n  emcas report EMCAS.fmu --mission flight.csv --json figures.json"
          "\n\n  emcas report --model elastic+heat --output elastic.html")


def report(
    article: common.SubjectArgument = None,
    parameters: common.ParametersOption = None,
    output: Annotated[Path, common.page_option("--output", "-o", what="Page to write.")] = Path("report.html"),
    requirements: common.RequirementsOption = None,
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    mission: Annotated[Path | None, typer.Option(help="Mission profile instead of the synthetic one: CSV of time (s) "
                                                      "and inputs in SI.", metavar="FILE.csv")] = None,
    load: Annotated[float | None, typer.Option(help="Rated hinge moment of the article in N.m; 100, that of Table 2, "
                                                    "unless given.", metavar="MOMENT")] = None,
    document: Annotated[str, typer.Option(help="Number of the document that the report is.", metavar="TEXT")] = "",
    revision: Annotated[str, typer.Option(help="Revision of that document.", metavar="TEXT")] = "",
    date: common.DateOption = None,
    as_json: common.JsonOption = None,
    junit: common.JunitOption = None,
) -> None:
    """Carry out an actuator's acceptance test on an FMU or a parameter set, and write the report to sign."""
    from ..bench.excitation import csv_file
    from ..bench.requirements import load_requirements
    from ..bench.writers import write_json
    from ..motions import RATED
    from ..studies.report.acceptance import carry_out
    from ..studies.report.acceptance_output import as_dict, summary, write_junit, write_report

    with common.failures():
        common.check_outputs(output, as_json, junit, inputs=(article, *(parameters or ()), requirements, mission))
        if load is not None and not 0.0 < load < float("inf"):
            raise EmcasError(f"--load {load:g}: must be above 0, in N.m")
        printed = common.calendar_date(date) if date else ""
        with common.progress_bar() as progress, common.open_subject(article, model, fin, parameters) as subject:
            profile = csv_file(mission, model=subject.model) if mission else None
            result = carry_out(subject, load=load or RATED, profile=profile,
                               specification=load_requirements(requirements, subject.parameters),
                               progress=common.stepper(progress, "test"))
        write_report(result, output, printed, document, revision)
        common.write_results(as_dict(result, printed), (as_json, write_json))
        common.write_results(result, (junit, write_junit))
    for part in summary(result):
        common.out.print(part)
    common.print_written(output, as_json, junit)
    if not result.passed:
        raise typer.Exit(1)
