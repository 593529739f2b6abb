"""`emcas validate`: judge an FMU or a parameter set by the reference responses and by requirements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import EmcasError
from . import common

EPILOG = common.examples(
    "validate", "EMCAS.fmu", "EMCAS.fmu --report report.html --junit junit.xml",
    "EMCAS.fmu --case step_plus20 --case load_opposing", "my_actuator.toml --requirements my_requirements.toml",
    "EMCAS_elastic.fmu --inside", "--model elastic+heat")


def validate(
    article: common.SubjectArgument = None,
    case: Annotated[list[str] | None, common.value("Only this case. Repeatable.", "NAME")] = None,
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    as_json: common.JsonOption = None,
    junit: common.JunitOption = None,
    report: common.ReportOption = None,
    directory: Annotated[Path | None, common.value(
        "Folder of the reference files, compared whatever their parameters are. Without it: models/reference, "
        "compared where they are of the subject's parameters.", "DIR")] = None,
    requirements: common.RequirementsOption = None,
    inside: Annotated[bool, typer.Option("--inside", help="Compare trajectories with the references inside the FMU; of "
                                         "another actuator, or other parameters than the defaults, that is so "
                                         "unless --directory is given.")] = False,
) -> None:
    """Run a model on every reference case and judge it by the reference, where there is one of its actuator, and by
    requirements.

    Exit code 0: all that was judged is met, or with --case the actuator has no reference and it ran (JSON: passed is
    null); 1: a criterion is not met, or nothing was judged: a case did not run to its end, or the references are of
    other parameters; 2: it cannot be carried out. In a gate leave --case out: with it no requirement is judged.
    """
    from ..api import validate as run
    from ..studies.validate.validation_output import as_dict, summary, write_junit, write_report

    if case and requirements:
        raise EmcasError("--case and --requirements: with --case no requirement is judged; leave one of them out")
    if inside and directory:
        raise EmcasError("--inside and --directory: references are of one place; give one of them")
    common.check_outputs(as_json, junit, report, inputs=(article, directory, requirements))
    with common.work("validate") as step, common.open_subject(article, model, fin) as subject:
        result = run(subject, case, directory, step, inside, requirements)
    common.write_json(as_dict(result), as_json)
    common.write_results(result, (junit, write_junit), (report, write_report))
    common.conclude(summary(result), passed=result.outcome)
