"""`emcas validate`: judge an FMU or a parameter set by the reference responses and by requirements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import EmcasError
from . import common

EPILOG = ("Examples:\n\n  emcas validate EMCAS.fmu\n\n  emcas validate EMCAS.fmu --report report.html "
                   "--junit junit.xml\n\n  emcas validate EMCAS.fmu --case step_plus20 --case load_opposing"
          "\n\n  emcas validate my_actuator.toml --requirements my_requirements.toml"
          "\n\n  emcas validate EMCAS_elastic.fmu --inside\n\n  emcas validate --model elastic+heat")


def validate(
    article: common.SubjectArgument = None,
    case: Annotated[list[str] | None, typer.Option(help="Only this case (may be given several times).",
                                                   metavar="NAME")] = None,
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    as_json: common.JsonOption = None,
    junit: common.JunitOption = None,
    report: common.ReportOption = None,
    directory: Annotated[Path | None, typer.Option(
        help="Folder of the reference files, compared whatever their parameters are. Without it: models/reference, "
             "compared where they are of the subject's parameters.", metavar="DIR")] = None,
    requirements: common.RequirementsOption = None,
    inside: Annotated[bool, typer.Option("--inside", help="Compare trajectories with the references inside the FMU; of "
                                         "another actuator, or other parameters than the defaults, that is so "
                                         "unless --directory is given.")] = False,
) -> None:
    """Run a model on every reference case and judge it by the reference, where there is one of its actuator, and by
    requirements.

    Exit code 0: all that was judged is met, or with --case the actuator has no reference and it ran (JSON: passed is
    null); 1: a criterion is not met, or nothing was judged: a case did not run to its end, or the references are of
    other parameters; 2: it cannot be carried out.
    In a gate leave --case out: with it no requirement is judged.
    """
    from ..api import validate as run
    from ..bench.writers import write_json
    from ..studies.validate.validation_output import as_dict, summary, write_junit, write_report

    with common.failures():
        if case and requirements:
            raise EmcasError("--case and --requirements: with --case no requirement is judged; leave one of them out")
        if inside and directory:
            raise EmcasError("--inside and --directory: references are of one place; give one of them")
        common.check_outputs(as_json, junit, report, inputs=(article, directory, requirements))
        with common.progress_bar() as progress, common.open_subject(article, model, fin) as subject:
            result = run(subject, case, directory, common.stepper(progress, "validate"), inside, requirements)
        common.write_results(as_dict(result), (as_json, write_json))
        common.write_results(result, (junit, write_junit), (report, write_report))
    for part in summary(result):
        common.out.print(part)
    if result.outcome is False:
        raise typer.Exit(1)
