"""`emcas calibrate`: fit the parameters of any actuator to measured records."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

from ..actuators import NONLINEAR
from . import common, identify

EPILOG = common.examples(
    "calibrate", "steps.csv sweep.csv --free inertia.motor,friction.viscous --output mine.toml",
    "bench_*.csv -p data_sheet.toml --free 'motor.torque_constant=0.08..0.14 N*m/A' "
    "--prior 'motor.torque_constant=0.11+-0.01 N*m/A' --hold-out flight.csv -o mine.toml --report fit.html",
    "run.csv --model my_actuator.py --free gear.friction --compare fin_angle --robust --json fit.json",
    last=["  python build_fmu.py -p mine.toml"])


def calibrate(
    files: Annotated[list[Path], typer.Argument(
        help="CSV files of measurements to fit. The columns are time and the actuator's inputs and outputs, each with "
             "its unit in the header, as in motor_current [A].", metavar="FILE...")],
    free: Annotated[list[str], common.value(
        "Parameters to fit, separated by commas, as NAME or NAME=LOWER..UPPER UNIT. Default bounds: a fifth of the "
        "initial value and five times this value. Repeatable.", "NAME[=BOUNDS]", "--free")],
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    prior: Annotated[list[str] | None, common.value(
        "Prior knowledge of a free parameter: NAME=VALUE+-SIGMA UNIT. Repeatable.", "NAME=VALUE+-SIGMA")] = None,
    hold_out: Annotated[list[Path] | None, common.value(
        "CSV file that is not fitted but compared with the fitted model. Repeatable.", "FILE")] = None,
    compare: Annotated[list[str] | None, common.value(
        "Output to compare. Default: every output that all fitted files have. Repeatable.", "OUTPUT")] = None,
    delays: Annotated[bool, typer.Option("--delays", help="Also fit the delay of each measured output.")] = False,
    robust: Annotated[bool, typer.Option("--robust", help="Weight large errors by their size instead of its square, "
                                         "for records with stick and slip or outliers.")] = False,
    seed: Annotated[int, common.value("Seed of the starting points.", "N", min=0)] = 1,
    output: Annotated[Path | None, common.output_option(
        "Write a parameter file: the fitted values, and the values set by --parameters.")] = None,
    report: common.ReportOption = None,
    as_json: common.JsonOption = None,
) -> None:
    """Fit parameters of an actuator so that its simulation follows measurements; compute uncertainties.

    The measured inputs drive the actuator, and its outputs are compared with the measured outputs. Exit code 1: the
    records do not determine a parameter, the fit is poor or has not settled, a value is at its bound or far from its
    prior, or a record has a fault. Ctrl-C ends the fit: the best values are shown and written, with exit code 130.
    """
    from .. import api

    held_out = hold_out or []
    identify.check_outputs([*files, *held_out], parameters, output, report, as_json)
    base = common.parameter_set(parameters, model)
    names = [name.strip() for text in free for name in text.split(",") if name.strip()]
    with common.work("calibrate") as step:
        result = api.calibrate(files, base, names, held_out, compare or (), prior or (), delays, robust, seed, step)
    identify.write(result, parameters, output, report, as_json)
    identify.show(result, *(common.table(["output", ">rms", ">mean size", ">largest", "unit", ">fit / %"], (
        [c.variable.name, *(f"{c.figures[name]:.3g}" for name in ("rms", "mean_abs", "largest")), c.unit, c.fit]
        for c in group), f"Error of the calibrated model: {name}, {use}", whole=range(6))
        for (name, use), group in groupby(result.comparisons, lambda c: (c.record.name, c.use))))
    common.warn(result.problems)
    common.print_written(output, report, as_json)
    if result.problems:
        raise typer.Exit(common.INTERRUPTED if result.stopped else 1)
