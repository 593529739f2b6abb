"""`emcas identify`: measurements in, parameter file out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ..parameters import load_parameters
from .common import ParametersOption, check_outputs, failures, out

if TYPE_CHECKING:
    from ..parameters import ParameterSet
    from ..studies.identification.result import Identification

EPILOG = ("Examples:\n\n  emcas identify drive models/bench/drive_*.csv --output identified.toml"
          "\n\n  emcas identify inertia models/bench/inertia_*.csv -p identified.toml -o identified.toml"
          "\n\n  emcas identify friction models/bench/friction_*.csv -p identified.toml -o identified.toml --report "
          "r.html"
          "\n\n  emcas identify backlash models/bench/backlash.csv --json backlash.json"
          "\n\n  emcas parameters -p identified.toml")
_COMMON = "Columns carry their unit in the header, as in  motor_current [A]: docs/tools/identification.md."
_FRICTION = "Examples:\n\n  emcas identify friction sweep_*.csv -p base.toml -o identified.toml --report friction.html"
_DRIVE = "Examples:\n\n  emcas identify drive fast.csv staircase.csv --output identified.toml --report drive.html"
_BACKLASH = "Examples:\n\n  emcas identify backlash reversals.csv --json backlash.json --report backlash.html"
_INERTIA = "Examples:\n\n  emcas identify inertia up_*.csv down_*.csv -p base.toml --output identified.toml"

FilesArgument = Annotated[list[Path], typer.Argument(help="CSV files of measurements.", metavar="FILE...")]
OutputOption = Annotated[Path | None, typer.Option("--output", "-o", help="Write a parameter file: the identified "
                                                                          "values "
                                                   "and what --parameters already changed.", metavar="FILE.toml")]
ReportOption = Annotated[Path | None, typer.Option(help="Write a page with pictures to this file.",
                                                   metavar="FILE.html")]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write all figures to this file.", metavar="FILE")]

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="rich", epilog=EPILOG,
                  help="Identify parameters from bench measurements. " + _COMMON)


def _carry_out(run: Callable[[ParameterSet], Identification], records: Sequence[Path],
               parameters: list[Path] | None, output: Path | None, report: Path | None, as_json: Path | None) -> None:
    from ..studies.identification.parameter_file import write_identified
    from ..studies.identification.report import write_report
    from ..studies.identification.result import write_json

    with failures():
        # The set may be written over: experiments chain through one file.
        check_outputs(report, as_json, inputs=(*records, *(parameters or ())))
        check_outputs(output, report, as_json, inputs=records)
        base = load_parameters(parameters)
        result = run(base)
        if output:
            write_identified(result, base, output, parameters or ())
        if report:
            write_report(result, report)
        if as_json:
            write_json(result, as_json)
    _show(result)
    for path in (output, report, as_json):
        if path:
            out.print(f"written {escape(str(path))}", highlight=False, soft_wrap=True)


def _show(result: Identification) -> None:
    table = Table("name", "value", "1 sigma", "unit", "base set", title=result.title, title_justify="left")
    for column in table.columns:
        column.no_wrap = True
    for place in (1, 2, 4):
        table.columns[place].justify = "right"
    for e in result.estimates:
        table.add_row(escape(e.name), f"{e.value:.6g}", f"{e.sigma:.2g}", escape(e.unit),
                      "" if e.base is None else f"{e.base:.6g}")
    out.print(table)
    for note in result.notes:
        out.print(escape(note), highlight=False, soft_wrap=True)


@app.command(name="friction", epilog=_FRICTION)
def identify_friction(
    files: FilesArgument, parameters: ParametersOption = None, output: OutputOption = None, report: ReportOption = None,
    as_json: JsonOption = None,
    keep_cold_ratios: Annotated[bool, typer.Option("--keep-cold-ratios", help="Take the ratios of cold to warm "
                                                                              "friction "
                                                   "from the parameters: for sweeps at one temperature.")] = False,
) -> None:
    """Viscous and Coulomb friction per direction, and cold ratios, from sweeps at constant speed.

    Columns: time, motor_angle, motor_current, temperature (motor_speed is checked if there is one).
    """
    from ..studies.identification.friction import identify

    _carry_out(lambda base: identify(files, base, keep_cold_ratios), files, parameters, output, report, as_json)


@app.command(name="drive", epilog=_DRIVE)
def identify_drive(
    files: FilesArgument, parameters: ParametersOption = None, output: OutputOption = None, report: ReportOption = None,
    as_json: JsonOption = None,
) -> None:
    """Current gain, offset, transport delay and current-loop gains from the drive's reference and current.

    Columns: time, drive_reference, motor_current; motor_speed unless the rotor is clamped.
    """
    from ..studies.identification.drive import identify

    _carry_out(lambda base: identify(files, base), files, parameters, output, report, as_json)


@app.command(name="backlash", epilog=_BACKLASH)
def identify_backlash(
    files: FilesArgument, parameters: ParametersOption = None, output: OutputOption = None, report: ReportOption = None,
    as_json: JsonOption = None,
) -> None:
    """Backlash at the fin from its angle measured directly and through the motor; reported, no parameter.

    Columns: time, motor_angle, fin_angle.
    """
    from ..studies.identification.backlash import identify

    _carry_out(lambda base: identify(files, base), files, parameters, output, report, as_json)


@app.command(name="inertia", epilog=_INERTIA)
def identify_inertia(
    files: FilesArgument, parameters: ParametersOption = None, output: OutputOption = None, report: ReportOption = None,
    as_json: JsonOption = None,
) -> None:
    """Total inertia at the motor, and the rotor's share of it, from spin-ups.

    Columns: time, motor_angle, motor_current (motor_speed is checked if there is one).
    """
    from ..studies.identification.inertia import identify

    _carry_out(lambda base: identify(files, base), files, parameters, output, report, as_json)
