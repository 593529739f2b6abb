"""`emcas validate`: judge an FMU or a parameter set by reference responses and by requirements."""

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
        "Folder of reference files, which are compared even if they are for other parameters. Default: "
        "models/reference, compared only where they are for the subject's parameters.", "DIR")] = None,
    requirements: common.RequirementsOption = None,
    inside: Annotated[bool, typer.Option("--inside", help="Compare trajectories with the references inside the FMU. "
                                         "Without --directory, this is the default for an FMU of another actuator "
                                         "or with other parameters than the defaults.")] = False,
) -> None:
    """Run an FMU or a parameter set on every reference case; judge it by the actuator's references and by requirements.

    Exit code 0: every criterion is met, or, with --case, the cases ran to their ends and the actuator has no reference
    (JSON: passed is null). 1: a criterion is missed, or nothing was judged because a case stopped early or the
    references are for other parameters. 2: the request cannot be executed. In a gate leave --case out: with it no
    requirement is judged.
    """
    from .. import api
    from ..studies.validate.validation_output import as_dict, summary, write_junit, write_report

    if case and requirements:
        raise EmcasError("--case and --requirements: with --case no requirement is judged; leave one of them out")
    if inside and directory:
        raise EmcasError("--inside and --directory: both choose the references; give one of them")
    common.check_outputs(as_json, junit, report, inputs=(article, directory, requirements))
    with common.work("validate") as step, common.open_subject(article, model, fin) as subject:
        result = api.validate(subject, case, directory, step, inside, requirements)
    common.write_json(as_dict(result), as_json)
    common.write_results(result, (junit, write_junit), (report, write_report))
    common.conclude(summary(result), report, as_json, junit, passed=result.outcome)
