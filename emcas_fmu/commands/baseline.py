"""`emcas baseline`: record the approved response of an actuator, and check later responses against it."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from ..support.files import as_given
from . import common

_LOG_WIDTH = 110  # characters per line of the table in a log file, which has no width

app = typer.Typer(add_completion=False, rich_markup_mode="rich", no_args_is_help=True,
                  epilog=common.examples("baseline", "record my_actuator.toml --output baseline",
                                         "check EMCAS.fmu --baseline baseline --junit drift.xml"),
                  help="Record the approved response of an actuator, or check that a response does not drift from it.")


@app.command(epilog=common.examples(
    "baseline record", "my_actuator.toml --output baseline", "EMCAS4.fmu --fin 2 --output baseline_fin2",
    "my_actuator.toml --output baseline --fresh", "--model my_actuator.py --output baseline"))
@common.failures()
def record(
    subject: common.SubjectArgument = None,
    output: Annotated[Path, common.value("Folder for the baseline. Limits and cases already there are kept.",
                                         "DIR", "--output", "-o")] = Path("baseline"),
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    parameters: common.ParametersOption = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Use the shipped limits and cases instead of those in "
                                                            "the folder.")] = False,
) -> None:
    """Write the figures and trajectories of the present, approved response as text files to commit."""
    from ..studies.baseline import comparison, files
    from ..studies.baseline.model import FILE

    file = output / FILE
    common.check_outputs(file, folders=(output,), inputs=(subject, parameters))
    with common.work("record") as step, common.open_subject(subject, model, fin, parameters) as opened:
        keeps = file.exists() and not fresh
        plan, left_out = (files.read_plan(file, opened.model), []) if keeps else comparison.first(opened)
        common.check_outputs(*(output / f"{name}.csv" for name, case in plan.case.items() if not case.sweeps),
                             folders=(output,))
        # File names without folders: the same response gives the same bytes in any folder.
        command = ["emcas", "baseline", "record",
                   *_arguments(subject, model, fin, parameters, lambda path: Path(path).name)]
        made = comparison.record(plan, opened, output, shlex.join(command), step)
    written = files.write(made, output)
    size = sum(path.stat().st_size for path in written)
    common.warn(f"left out: {what}" for what in left_out)
    common.say(f"written {escape(str(output))}  {len(written)} files, {size / 1024:.0f} KiB; "
               f"{len(made.case)} cases, limits and cases {'kept' if keeps else 'as shipped'}")


def _arguments(subject: Path | None, model: str | None, fin: int | None, parameters: list[Path] | None,
               shown: Callable[[str], str] = str) -> list[str]:
    """Return the arguments that name an actuator, for the command line in a result."""
    return [*([shown(as_given(subject))] if subject else []), *common.option("--model", model and shown(model)),
            *common.option("--fin", fin), *common.parameter_arguments(parameters, shown)]


@app.command(epilog=common.examples(
    "baseline check", "my_actuator.toml --baseline baseline",
    "EMCAS.fmu --baseline baseline --junit drift.xml --report drift.html", "EMCAS.fmu --markdown summary.md --all"))
@common.failures()
def check(
    subject: common.SubjectArgument = None,
    baseline: Annotated[Path, common.value("Folder that `emcas baseline record` wrote.", "DIR", "--baseline",
                                           "-b")] = Path("baseline"),
    model: common.SubjectModelOption = None,
    fin: common.FinOption = None,
    parameters: common.ParametersOption = None,
    everything: Annotated[bool, typer.Option("--all", help="Show every comparison, not only those that drifted and, in "
                                                           "each other case, the one nearest to its limit.")] = False,
    as_json: Annotated[Path | None, common.json_option("Write all comparisons to this file.")] = None,
    junit: common.JunitOption = None,
    markdown: Annotated[Path | None, common.value("Append the table to this file, such as $GITHUB_STEP_SUMMARY.",
                                                  "FILE.md")] = None,
    report: common.ReportOption = None,
) -> None:
    """Compare the response with the approved one; exit code 1 if it drifts."""
    from ..studies.baseline import comparison_output
    from ..studies.baseline.comparison import compare
    from ..studies.baseline.files import read

    common.check_outputs(as_json, junit, markdown, report, inputs=(subject, parameters, baseline))
    with common.work("check") as step, common.open_subject(subject, model, fin, parameters) as opened:
        result = compare(read(baseline, opened.model), opened, baseline, step)
    advice = comparison_output.remedy(result, shlex.join(["emcas", "baseline", "record", *_arguments(
        subject, model, fin, parameters), "--output", str(baseline)]), str(baseline))
    common.write_json(comparison_output.as_dict(result), as_json)
    common.write_results(result, (junit, comparison_output.write_junit),
                         (markdown, lambda one, path: comparison_output.append_markdown(one, advice, path, everything)),
                         (report, lambda each, path: comparison_output.write_report(each, advice, path)))
    console = common.out if common.out.is_terminal else Console(width=_LOG_WIDTH)
    for part in comparison_output.summary(result, everything):
        console.print(part, highlight=False)
    if not result.passed:
        common.say(escape(advice))
        raise typer.Exit(1)
