"""`emcas analyse`: compute bandwidth, margins, limits and capability with linear models and describing functions."""

from __future__ import annotations

from math import isfinite, radians
from pathlib import Path
from typing import Annotated

from rich.markup import escape

from ..actuators import NONLINEAR
from ..errors import EmcasError
from . import common

EPILOG = common.examples(
    "analyse", "", "--at 15 --report analysis.html --locus controller.velocity.kp",
    "--model elastic+heat --json analysis.json", "-p my_actuator.toml --rod my_screw.toml --json analysis.json")


def analyse(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    at: Annotated[float, common.value("Fin angle of the operating point, in degrees.", "ANGLE")] = 0.0,
    torque: Annotated[float, common.value("Constant hinge moment at the operating point, in N.m.", "MOMENT")] = 0.0,
    locus: Annotated[str | None, common.value("Parameter that the root locus varies. Default: the controller's first "
                                              "gain.", "NAME")] = None,
    rod: Annotated[Path | None, common.value("Shaft and screw for the natural frequencies (TOML). The file's values "
                                             "override those in models/rod.toml.", "FILE")] = None,
    as_json: common.JsonOption = None,
    report: common.ReportOption = None,
) -> None:
    """Print bandwidth, margins, final values, limits, natural frequencies and capability at an operating point."""
    from .. import api

    common.check_outputs(as_json, report, inputs=(parameters, rod))
    for name, value in (("--at", at), ("--torque", torque)):
        if not isfinite(value):
            raise EmcasError(f"{name} {value}: give a finite number")
    chosen = common.parameter_set(parameters, model)
    with common.work("analyse") as step:
        analysis = api.analyse(chosen, radians(at), torque, locus, rod, step)
    from ..pages.numbers import number
    from ..studies.analysis.report import figures_of, tables, write_report  # needs the extra

    figures = figures_of(analysis)
    common.write_json(figures, as_json)
    common.write_results(analysis, (report, write_report))
    point = figures["operating_point"]
    common.out.print(f"at {number(point['fin_angle_deg'])} deg, {number(point['aero_torque_nm'])} N.m")
    for caption, columns, rows in tables(figures, analysis.actuator.reference_name).values():
        common.out.print(common.table(columns, rows, caption))
    for reason in analysis.left_out.values():
        common.say(escape(f"{reason}."))
    if rod := figures["modes"]:
        common.say("The thesis states natural frequencies of 42 to 139 times the bandwidth, but divides rad/s by Hz; "
                   "the correct factors are {axial_over_bandwidth:.1f} and {torsional_over_bandwidth:.1f}."
                   .format(**rod["thesis"]))
    common.print_written(as_json, report)
