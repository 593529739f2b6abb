"""`emcas report`: carry out an actuator's acceptance test and write the report for signature."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import EmcasError
from . import common

EPILOG = common.examples(
    "report", "", "EMCAS.fmu --output report.html --date 2026-03-31 --document AT-0042 --revision B",
    "my_actuator.toml --requirements specification.toml --load 60 --junit junit.xml",
    "EMCAS.fmu --mission flight.csv --json figures.json", "--model elastic+heat --output elastic.html")


def report(
    article: common.SubjectArgument = None,
    parameters: common.ParametersOption = None,
    output: Annotated[Path, common.page_option("--output", "-o", what="Page to write.")] = Path("report.html"),
    requirements: common.RequirementsOption = None,
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    mission: Annotated[Path | None, common.value("Mission profile instead of the synthetic one: CSV of time (s) and "
                                                 "inputs in SI.", "FILE.csv")] = None,
    load: Annotated[float | None, common.value("Rated hinge moment in N.m. Default: that of the required loaded "
                                               "rate, such as 100.", "MOMENT")] = None,
    document: Annotated[str, common.value("Document number of the report.", "TEXT")] = "",
    revision: Annotated[str, common.value("Revision of the report.", "TEXT")] = "",
    date: common.DateOption = "",
    as_json: common.JsonOption = None,
    junit: common.JunitOption = None,
) -> None:
    """Carry out an actuator's acceptance test on an FMU or a parameter set, and write the report for signature."""
    from ..bench.excitation import csv_file
    from ..bench.requirements import load_requirements
    from ..studies.report.acceptance import as_dict, carry_out, summary, write_junit, write_report

    common.check_outputs(output, as_json, junit, inputs=(article, parameters, requirements, mission))
    if load is not None and not 0.0 < load < float("inf"):
        raise EmcasError(f"--load {load:g}: must be finite and above 0, in N.m")
    with common.work("test") as step, common.open_subject(article, model, fin, parameters) as subject:
        profile = csv_file(mission, model=subject.model) if mission else None
        result = carry_out(subject, load=load, profile=profile, progress=step,
                           specification=load_requirements(requirements, subject.parameters))
    write_report(result, output, date, document, revision)
    common.write_json(as_dict(result, date), as_json)
    common.write_results(result, (junit, write_junit))
    common.conclude(summary(result), output, as_json, junit, passed=result.passed)
