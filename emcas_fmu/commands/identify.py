"""`emcas identify`: identify parameters from bench measurements."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from . import common

if TYPE_CHECKING:
    from ..studies.identification.result import Identification

EPILOG = common.examples(
    "identify", "drive drive_*.csv --output identified.toml",
    "inertia inertia_*.csv -p identified.toml -o identified.toml",
    "friction friction_*.csv -p identified.toml -o identified.toml --report r.html",
    "backlash backlash.csv --json backlash.json",
    first="Examples, in a folder of records such as examples/identification_bench/records:",
    last=["  emcas parameters -p identified.toml"])
# Experiments without additional options: the help, and the arguments of an example.
_EXPERIMENTS = {
    "drive": ("""Identify current gain, offset, delay and current-loop gains from the drive's reference and current.

    Columns: time, drive_reference, motor_current; also motor_speed, unless the rotor is clamped.
    """, "fast.csv staircase.csv --output identified.toml --report drive.html"),
    "backlash": ("""Identify the backlash at the fin from fin angle and motor angle.

    It is only reported: the nonlinear actuator has no parameter for it. Columns: time, motor_angle, fin_angle.
    """, "reversals.csv --json backlash.json --report backlash.html"),
    "inertia": ("""Identify the total inertia at the motor, and the rotor's share, from spin-ups in both directions.

    Columns: time, motor_angle, motor_current (motor_speed, if present, is checked).
    """, "plus_*.csv minus_*.csv -p base.toml --output identified.toml"),
}

FilesArgument = Annotated[list[Path], typer.Argument(help="CSV files of measurements.", metavar="FILE...")]
OutputOption = Annotated[Path | None, common.output_option(
    "Write a parameter file: the identified values, and the values set by --parameters.")]

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="rich", epilog=EPILOG,
                  help="Identify parameters from bench measurements. Each column has its unit in the header, as in "
                       "motor_current [A]; see docs/tools/identification.md.")


@common.failures()
def _identify(kind: str, files: list[Path], parameters: list[Path] | None, output: Path | None, report: Path | None,
              as_json: Path | None, **options: Any) -> None:
    check_outputs(files, parameters, output, report, as_json)
    experiment = import_module(f"..studies.identification.{kind}", __package__)
    result: Identification = experiment.identify(
        files, common.nonlinear_set(parameters, f"emcas identify {kind}"), **options)
    write(result, parameters, output, report, as_json)
    show(result)
    common.print_written(output, report, as_json)


def check_outputs(files: list[Path], parameters: list[Path] | None, output: Path | None, report: Path | None,
                  as_json: Path | None) -> None:
    """Check outputs as `common.check_outputs` does; `output` may overwrite one of the `parameters`."""
    common.check_outputs(report, as_json, inputs=(files, parameters))
    common.check_outputs(output, report, as_json, inputs=(files,))


def write(result: Identification, parameters: list[Path] | None, output: Path | None, report: Path | None,
          as_json: Path | None) -> None:
    """Write the requested files of a result; its base set was read from the files `parameters`."""
    from ..studies.identification.result import write_identified

    common.write_results(result, (output, lambda each, path: write_identified(each, path, parameters or ())),
                         (report, type(result).write_report))
    common.write_json(result.document(), as_json)


def show(result: Identification, *tables: Any) -> None:
    """Print a table of the estimates, the other `tables`, and the notes."""
    estimates = common.table(["name", ">value", ">1 sigma", "unit", ">base set"], (
        [e.name, f"{e.value:.6g}", f"{e.sigma:.2g}", e.unit, "" if e.base is None else f"{e.base:.6g}"]
        for e in result.estimates), result.experiment.title, whole=range(5))
    for each in (estimates, *tables):
        common.out.print(each)
    for line in result.notes:
        common.say(escape(line))


@app.command(epilog=common.examples(
    "identify", "friction sweep_*.csv -p base.toml -o identified.toml --report friction.html"))
def friction(
    files: FilesArgument, parameters: common.ParametersOption = None, output: OutputOption = None,
    report: common.ReportOption = None, as_json: common.JsonOption = None,
    keep_cold_ratios: Annotated[bool, typer.Option("--keep-cold-ratios", help="Keep the cold-to-warm ratios of "
                                                   "--parameters: all sweeps have one temperature.")] = False,
) -> None:
    """Identify viscous and Coulomb friction per direction, and cold-to-warm ratios, from sweeps of the fin's range.

    Each sweep has a constant speed. Columns: time, motor_angle, motor_current, temperature (motor_speed, if present, is
    checked).
    """
    _identify("friction", files, parameters, output, report, as_json, keep_ratios=keep_cold_ratios)


def _add(kind: str, text: str, arguments: str) -> None:
    @app.command(kind, help=text, epilog=common.examples("identify", f"{kind} {arguments}"))
    def command(files: FilesArgument, parameters: common.ParametersOption = None, output: OutputOption = None,
                report: common.ReportOption = None, as_json: common.JsonOption = None) -> None:
        _identify(kind, files, parameters, output, report, as_json)


for _kind, (_text, _arguments) in _EXPERIMENTS.items():
    _add(_kind, _text, _arguments)
