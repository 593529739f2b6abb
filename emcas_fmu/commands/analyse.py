"""`emcas analyse`: linear and describing-function analysis: bandwidth, margins, limits, capability."""

from __future__ import annotations

from math import isfinite, radians
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Column, Table

from ..actuators import NONLINEAR
from ..errors import EmcasError
from . import common

EPILOG = ("Examples:\n\n  emcas analyse\n\n  emcas analyse --at 15 --report analysis.html "
          "--locus controller.velocity.kp"
          "\n\n  emcas analyse --model elastic+heat --json analysis.json"
          "\n\n  emcas analyse -p my_actuator.toml --rod my_screw.toml --json analysis.json")


def analyse(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    at: Annotated[float, typer.Option(help="Fin angle of the operating point, in degrees.", metavar="ANGLE")] = 0.0,
    torque: Annotated[float, typer.Option(help="Constant hinge moment there, in N.m.", metavar="MOMENT")] = 0.0,
    locus: Annotated[str | None, typer.Option(help="Parameter of the root locus. Default: the first gain of the "
                                                   "controller.", metavar="NAME")] = None,
    rod: Annotated[Path | None, typer.Option(help="Shaft and screw for the natural frequencies (TOML); overrides any "
                                                  "subset of models/rod.toml.", metavar="FILE")] = None,
    as_json: common.JsonOption = None,
    report: common.ReportOption = None,
) -> None:
    """Linearise at an operating point: bandwidth, margins, final values, limits, natural frequencies, capability."""
    from ..api import analyse as run

    with common.failures():
        common.check_outputs(as_json, report, inputs=(*(parameters or ()), rod))
        for name, value in (("--at", at), ("--torque", torque)):
            if not isfinite(value):
                raise EmcasError(f"{name} {value}: give a finite number")
        chosen = common.parameter_set(parameters, model)
        with common.progress_bar() as progress:
            analysis = run(chosen, radians(at), torque, locus, rod, common.stepper(progress, "analyse"))
        from ..bench.writers import write_json
        from ..pages.numbers import number
        from ..studies.analysis.report import figures_of, tables, write_report  # needs the extra

        figures = figures_of(analysis)
        common.write_results(figures, (as_json, write_json))
        common.write_results(analysis, (report, write_report))
    point = figures["operating_point"]
    common.out.print(f"at {number(point['fin_angle_deg'])} deg, {number(point['aero_torque_nm'])} N.m")
    for caption, columns, rows in tables(figures, analysis.actuator.reference_name).values():
        table = Table(*(Column(escape(name.lstrip(">")), justify="right" if name[:1] == ">" else "left")
                        for name in columns), title=caption, title_justify="left")
        for row in rows:
            table.add_row(*(escape(cell) if isinstance(cell, str) else number(cell) for cell in row))
        common.out.print(table)
    lines = [f"{why}." for why in analysis.left_out.values()]
    if analysis.modes:
        thesis = analysis.modes[1]
        lines.append("The thesis's natural frequencies of {:.1f} and {:.1f} times the bandwidth divide rad/s by Hz; "
                     "the factors are {:.1f} and {:.1f}.".format(*thesis.slipped, *thesis.ratios))
    for line in lines:
        common.say(escape(line))
    common.print_written(as_json, report)
