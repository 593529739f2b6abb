"""`emcas compare`: measure parameter sets or actuators against the same requirements, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..actuators import NONLINEAR, split
from . import common

EPILOG = common.examples(
    "compare", "", "default my_actuator.toml --report compare.html",
    "drive-si drive-pi -p my_actuator.toml --json compare.json",
    "nonlinear worm-gear electrohydraulic --report kinds.html", "my_actuator.py nonlinear --report kinds.html")


def compare(
    sets: Annotated[list[str] | None, typer.Argument(
        help="Shipped sets (emcas parameters --sets), parameter files (TOML), the word default for the default set, or "
             "actuators (names or Python files) with their default sets. Default: the default set and, for an "
             "actuator with a current loop, drive-si, drive-scaled and drive-pi.", metavar="[SET|FILE|ACTUATOR]...",
        show_default=False)] = None,
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    requirements: common.RequirementsOption = None,
    as_json: common.JsonOption = None,
    report: common.ReportOption = None,
) -> None:
    """Measure parameter sets or actuators against the same requirements, one column each.

    Exit code: 0 even if requirements are missed (emcas validate judges), 2 for an error. Every set overrides the files
    of --parameters.
    """
    from ..studies.compare.sets import as_dict, load_sets, summary, write_report
    from ..studies.compare.sets import compare as run

    named = [Path(split(each)[0]) for each in sets or ()]
    common.check_outputs(as_json, report, inputs=(named, parameters, requirements))
    chosen = load_sets(sets or (), model, parameters or ())
    common.warn(warning for each in chosen.values() for warning in each.warnings)
    with common.work("compare") as step:
        result = run(chosen, step, requirements)
    common.write_json(as_dict(result), as_json)
    common.write_results(result, (report, write_report))
    common.conclude(summary(result), as_json, report)
