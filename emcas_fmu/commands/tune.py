"""`emcas tune`: find controller gains that meet requirements, simulated with limits, friction and delay."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..actuators import NONLINEAR
from ..errors import EmcasError
from . import common

EPILOG = common.examples(
    "tune", "--output tuned.toml --report tuning.html",
    "my_requirements.toml -p my_actuator.toml --output tuned.toml --journal tuning.jsonl",
    "gains.toml --model my_actuator.py --output tuned.toml",
    "--pareto overshoot_5deg --pareto time_to_accuracy_20deg --report tuning.html")


def tune(
    study: Annotated[Path | None, typer.Argument(
        help="Study: requirements, cases and the parameters to tune (TOML). Default: the actuator's file in "
             "models/tuning, otherwise models/tuning.toml.", metavar="FILE")] = None,
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    requirements: Annotated[Path | None, common.value("File of requirements (TOML) that replace the study's; "
                                                      "docs/use/requirements.md.", "FILE.toml", ending=".toml")] = None,
    output: Annotated[Path | None, common.output_option(
        "Write a parameter file: the gains, and the values set by --parameters.")] = None,
    report: common.ReportOption = None,
    as_json: common.JsonOption = None,
    seed: Annotated[int, common.value("Seed of the random search; the same seed gives the same gains.", "N",
                                      min=0)] = 1,
    generations: Annotated[int, common.value("Generations of the global search.", "N", min=1)] = 12,
    workers: Annotated[int | None, common.value("Number of processes. Default: one per processor.", "N", min=1)] = None,
    journal: Annotated[Path | None, common.value("Store every evaluation in this file, and reuse those already in it.",
                                                 "FILE")] = None,
    pareto: Annotated[list[str] | None, common.value(
        "Plot the trade-off between two requirements, each named by this option. Default: the two that conflict most.",
        "REQUIREMENT")] = None,
) -> None:
    """Find controller gains that meet requirements in all cases, simulated with limits, friction and delay.

    The result is judged with the digits in the parameter file, and is never worse than the initial gains.
    The shipped study takes about a minute on two processors. Ctrl-C ends the search: the best gains so far are shown
    and written, and the exit code is 130.
    """
    from .. import api
    from ..studies.overview import stalled
    from ..studies.tuning.output import at_bounds, objectives, summary, verdict, write_json, write_report, write_tuned
    from ..studies.tuning.study import load_study, shipped_study

    common.check_outputs(output, report, as_json, journal, inputs=(study, parameters, requirements))
    base = common.parameter_set(parameters, model)
    chosen = load_study(study, base) if study else shipped_study(base)
    chosen = chosen.judged_by(requirements) if requirements else chosen
    names = [r.name for r in chosen.requirements]
    if pareto is not None and (len(pareto) != 2 or len({*pareto}.intersection(names)) != 2):
        raise EmcasError(f"--pareto must appear twice, with two different requirements among {', '.join(names)}")
    common.warn(stalled(base, max(abs(getattr(r.test, "torque", 0.0)) for r in chosen.requirements)))
    try:
        with common.work("tune", lines=True) as step:
            result = api.tune(base, chosen, seed, generations, workers, journal, step)
    except KeyboardInterrupt:
        common.err.print("stopped before any gains were judged; nothing is written")
        raise typer.Exit(common.INTERRUPTED) from None
    command = shlex.join([
        "emcas", "tune", *([str(study)] if study else []), *common.parameter_arguments(parameters),
        *common.option("--requirements", requirements), *common.option("--model", model, NONLINEAR),
        *common.option("--seed", seed), *common.option("--generations", generations)])
    common.write_results(result, (output, lambda each, path: write_tuned(each, path, command)),
                         (as_json, lambda each, path: write_json(each, path, command)),
                         (report, lambda each, path: write_report(each, path, (pareto[0], pareto[1]) if pareto else
                                                                  None)))
    common.out.print(summary(result))
    for line in filter(None, (verdict(result), objectives(result), at_bounds(result))):
        common.say(line)
    common.out.print(f"{len(result.evaluated)} evaluations")
    common.print_written(output, as_json, report, journal)
    if result.stopped:
        raise typer.Exit(common.INTERRUPTED)
    if not result.met:
        raise typer.Exit(1)
