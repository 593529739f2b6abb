"""`emcas baseline`: an approved response, recorded once and checked at every change."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from .common import ParametersOption, check_outputs, failures, out, parameter_arguments, progress_bar, stepper

_LOG_WIDTH = 110
_RECORD = ("Examples:\n\n  emcas baseline record my_actuator.toml --output baseline"
           "\n\n  emcas baseline record EMCAS4.fmu --fin 2 --output baseline_fin2"
           "\n\n  emcas baseline record my_actuator.toml --output baseline --fresh")
_CHECK = ("Examples:\n\n  emcas baseline check my_actuator.toml --baseline baseline"
          "\n\n  emcas baseline check EMCAS.fmu --baseline baseline --junit drift.xml --report drift.html"
          "\n\n  emcas baseline check EMCAS.fmu --markdown summary.md --all")

app = typer.Typer(add_completion=False, rich_markup_mode="rich", no_args_is_help=True,
                  epilog="Examples:\n\n  emcas baseline record my_actuator.toml --output baseline"
                         "\n\n  emcas baseline check EMCAS.fmu --baseline baseline --junit drift.xml",
                  help="Record the approved response of an actuator, or fail where another drifts from it.")
_Model = Annotated[Path, typer.Argument(help="FMU (.fmu, run by fmpy) or parameter file (.toml, run by the kernel).",
                                        metavar="FMU|TOML", show_default=False)]
_Fin = Annotated[int | None, typer.Option(help="Which fin of an FMU of several; the first unless given.", metavar="N")]


@app.command(epilog=_RECORD)
def record(
    model: _Model,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write; limits and cases of a baseline "
                                                                "that is there are kept.",
                                         metavar="DIR")] = Path("baseline"),
    fin: _Fin = None,
    parameters: ParametersOption = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Begin with the shipped limits and cases.")] = False,
) -> None:
    """Approve the present response: write its figures and trajectories as text to commit."""
    from ..baseline.compare import TEMPLATE, first
    from ..baseline.compare import record as run
    from ..baseline.model import FILE
    from ..baseline.read import read
    from ..baseline.subject import opened_subject
    from ..baseline.write import write

    with failures():
        check_outputs(output / FILE, folders=(output,), inputs=(model, *(parameters or ())))
        # Limits and cases alone: what was approved may be incomplete, as after a case was added by hand.
        old = read(output / FILE) if (output / FILE).exists() and not fresh else None
        # Without the folder: the same response gives the same bytes wherever it is kept.
        command = shlex.join(["emcas", "baseline", "record", model.name, *(["--fin", str(fin)] if fin else []),
                              *parameter_arguments(Path(file.name) for file in parameters or ())])
        with progress_bar() as progress, opened_subject(model, fin, parameters) as subject:
            plan = old or first(read(TEMPLATE), subject)
            made = run(plan, subject, output, command, stepper(progress, "record"))
        written = write(made, output)
        size = sum(path.stat().st_size for path in written)
    out.print(f"written {escape(str(output))}  {len(written)} files, {size / 1024:.0f} KiB; "
              f"{len(made.cases)} cases, limits and cases {'kept' if old else 'as shipped'}",
              highlight=False, soft_wrap=True)


@app.command(epilog=_CHECK)
def check(
    model: _Model,
    baseline: Annotated[Path, typer.Option("--baseline", "-b", help="Folder `emcas baseline record` wrote.",
                                           metavar="DIR")] = Path("baseline"),
    fin: _Fin = None,
    parameters: ParametersOption = None,
    everything: Annotated[bool, typer.Option("--all", help="Show every comparison, not only what drifted and, of "
                                                           "other cases, what comes nearest.")] = False,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write all comparisons to this file.",
                                                 metavar="FILE")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.", metavar="FILE")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Append the table to this file, as to $GITHUB_STEP_SUMMARY.",
                                                  metavar="FILE.md")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a page with pictures to this file.",
                                                metavar="FILE.html")] = None,
) -> None:
    """Compare the response with the approved one; exit code 1 if it drifts."""
    from ..baseline.compare import compare
    from ..baseline.read import read
    from ..baseline.results import append_markdown, write_json, write_junit
    from ..baseline.subject import opened_subject
    from ..baseline.summary import summary
    from ..baseline.table import remedy

    with failures():
        check_outputs(as_json, junit, markdown, report, inputs=(model, *(parameters or ()), baseline))
        approved = read(baseline)
        with progress_bar() as progress, opened_subject(model, fin, parameters) as subject:
            result = compare(approved, subject, baseline, stepper(progress, "check"))
        advice = remedy(result, shlex.join([str(model), *parameter_arguments(parameters)]), str(baseline))
        # A log has no width of its own, and a folded table is hard to read there.
        console = out if out.is_terminal else Console(width=_LOG_WIDTH)
        for part in summary(result, everything):
            console.print(part, highlight=False)
        if not result.passed:
            out.print(escape(advice), highlight=False, soft_wrap=True)
        for path, write in ((as_json, write_json), (junit, write_junit)):
            if path:
                write(result, path)
        if markdown:
            append_markdown(result, advice, markdown, everything)
        if report:
            from ..baseline.report import write_report

            write_report(result, advice, report)
    if not result.passed:
        raise typer.Exit(1)
