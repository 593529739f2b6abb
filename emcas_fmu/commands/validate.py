"""`emcas validate`: an FMU judged by the references and by Table 2."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .common import check_outputs, failures, out, progress_bar, stepper

EPILOG = ("Examples:\n\n  emcas validate EMCAS.fmu\n\n  emcas validate EMCAS.fmu --report report.html "
                   "--junit junit.xml\n\n  emcas validate EMCAS.fmu --case step_plus20 --case load_opposing")


def validate(
    fmu: Annotated[Path, typer.Argument(help="FMU to judge.", metavar="FMU")],
    case: Annotated[list[str] | None, typer.Option(help="Only this case (may be given several times).")] = None,
    fin: Annotated[int | None, typer.Option(help="Which fin of a unit of several; the first unless given.",
                                            metavar="N")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write all figures to this file.",
                                                    metavar="FILE")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.", metavar="FILE")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a page with pictures to this file.",
                                                   metavar="FILE.html")] = None,
    directory: Annotated[Path | None, typer.Option(help="Folder of the reference files; models/reference "
                                                      "unless given.", metavar="DIR")] = None,
) -> None:
    """Run an FMU on every reference case and judge it by the reference and by the thesis's Table 2."""
    from ..validation.results import write_json, write_junit
    from ..validation.summary import summary
    from ..validation.validate import validate as run

    with failures():
        check_outputs(as_json, junit, report, inputs=(fmu, directory))
        with progress_bar() as progress:
            result = run(fmu, case, directory, stepper(progress, "validate"), fin)
        for part in summary(result):
            out.print(part, highlight=False)
        for path, write in ((as_json, write_json), (junit, write_junit)):
            if path:
                write(result, path)
        if report:
            from ..validation.report import write_report

            write_report(result, report)
    if not result.passed:
        raise typer.Exit(1)
