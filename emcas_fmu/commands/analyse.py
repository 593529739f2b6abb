"""`emcas analyse`: linear and describing-function analysis: bandwidth, margins, limits, capability."""

from __future__ import annotations

from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

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
        from ..studies.analysis.report import figures_of, write_report  # needs the extra

        figures = figures_of(analysis)
        common.write_results(figures, (as_json, write_json))
        common.write_results(analysis, (report, write_report))
    for table in _tables(figures, analysis.actuator.reference_name):
        common.out.print(table)
    lines = [f"{why}." for why in analysis.left_out.values()]
    if analysis.modes:
        thesis = analysis.modes[1]
        lines.append("The thesis's natural frequencies of {:.1f} and {:.1f} times the bandwidth divide rad/s by Hz; "
                     "the factors are {:.1f} and {:.1f}.".format(*thesis.slipped, *thesis.ratios))
    for line in lines:
        common.say(escape(line))
    common.print_written(as_json, report)


def _tables(f: dict[str, Any], reference: str) -> list[Table]:
    from ..pages.numbers import number

    models = {"here": f["linear"]} | ({} if "thesis_linear" in f["left_out"] else {"thesis": f["thesis_linear"]})
    at, rod = f["operating_point"], f["modes"]
    first = Table("linear", *models, title=f"at {number(at['fin_angle_deg'])} deg, {number(at['aero_torque_nm'])} N.m",
                  title_justify="left")
    for key, label in (("bandwidth_3db_hz", "bandwidth -3 dB / Hz"), ("bandwidth_90deg_hz", "bandwidth -90 deg / Hz"),
                       ("gain_margin_db", f"gain margin at {reference} / dB"),
                       ("phase_margin_deg", "phase margin there / deg"), ("delay_margin_s", "delay margin there / s")):
        first.add_row(label, *(number(model[key]) if model else "unstable" for model in models.values()))
    for name in ("axial", "torsional") if rod else ():
        frequencies = [number(one[f"{name}_hz"]) for one in (rod, rod["thesis"])]
        first.add_row(f"{name} natural frequency of the rod / Hz", *frequencies[:len(models)])
    loops = Table("loop", "gain margin / dB", "phase margin / deg", "delay margin / ms")
    for name, m in f["linear"]["loops"].items():
        delay = m["delay_margin_s"]
        loops.add_row(name, number(m["gain_margin_db"]), number(m["phase_margin_deg"]),
                      number(None if delay is None else 1e3 * delay))
    finals = Table("final error", "1 deg command / deg", f"{f['final_values']['load_step_nm']:g} N.m load / deg")
    for name, label in (("p", "P"), ("pi", "PI"), ("as_set", "as set")):
        if name in f["final_values"]:
            row = f["final_values"][name]
            finals.add_row(label, number(row["command_error_deg"]), number(row["load_error_deg"]))
    limits = "limits" not in f["left_out"]
    swept = Table("amplitude / deg", "-3 dB / Hz", "-90 deg / Hz",
                  *(("rate", "current", "voltage", "DAC") if limits else ()),
                  caption="right: frequency / Hz from which the limit acts" if limits else None, caption_justify="left")
    for s in f["sweep"]:
        swept.add_row(*map(number, (s["amplitude_deg"], s["bandwidth_3db_hz"], s["bandwidth_90deg_hz"],
                                    *s["limit_onset_hz"].values())))
    return [common.right_aligned(table) for table in (first, loops, finals, swept)]
