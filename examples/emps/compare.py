"""Compare the EMPS drive with its records: `python examples/emps/compare.py --help`."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

EPILOG = ("Examples:\n\n  python examples/emps/compare.py --records my_records --json emps.json --plot emps.svg"
          "\n\n  EMCAS_RECORDS=my_records python examples/emps/compare.py --fit")
NO_RECORDS = 3  # exit code
# The authors' plant has no lag, and only dry and viscous friction. Their dry frictions F_c+ and F_c- become a mean and
# an offset of half their difference (Janot, Gautier, Brunot 2019, 3.4 and 4.2).
_PLAIN = {"friction.build_up": 0.0, "friction.load_positive": 0.0, "friction.load_negative": 0.0, "drive.lag": 1e-6,
          **{f"friction.{name}_{side}": 0.0 for name in ("slope", "curvature") for side in ("positive", "negative")}}
AUTHORS: Mapping[str, Mapping[str, float]] = {
    "symmetrical": {**_PLAIN, "inertia.fin": 95.1089, "friction.dry": 20.3935, "axis.offset": -3.1648,
                    "friction.viscous_positive": 203.5034, "friction.viscous_negative": 203.5034},
    "asymmetrical": {**_PLAIN, "inertia.fin": 95.1540, "friction.dry": (20.1440 + 20.6277) / 2.0,
                     "axis.offset": (20.1440 - 20.6277) / 2.0, "friction.viscous_positive": 166.7061,
                     "friction.viscous_negative": 240.4236}}
PRINTED = {"fitted": {"force_percent": 5.848, "position_percent": 0.013752},
           "unseen": {"force_percent": 8.9409, "position_percent": 0.0080248}}  # with symmetrical friction
# Start values of a calibration: the authors' asymmetrical friction, of which a part builds up with speed.
BEGIN = {**AUTHORS["asymmetrical"], "friction.dry": 15.0, "friction.build_up": 5.0, "friction.build_up_rate": 0.02,
         "drive.lag": 1e-4}


def compare(
    records: Annotated[Path | None, typer.Option(help="Folder with DATA_EMPS.mat and DATA_EMPS_PULSES.mat, or with a "
                                                 "folder emps that contains them.", metavar="DIR",
                                                 envvar="EMCAS_RECORDS")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the figures.", metavar="FILE")] = None,
    plot: Annotated[Path | None, typer.Option(help="File for a plot of measured and simulated signals, .svg or .png.",
                                              metavar="FILE")] = None,
    fit: Annotated[bool, typer.Option("--fit", help="Calibrate on the first record, from the authors' parameters, "
                                      "instead of reading emps.toml (10 s).")] = False,
    terms: Annotated[bool, typer.Option("--terms", help="Also print the errors without each term of the model, on "
                                        "stages of the first record that are held out (two minutes).")] = False,
) -> None:
    """Print the errors of the model, and of the authors' parameters, on the fitted and on the unseen record.

    Exit codes: 0 done, 2 an error, 3 no records.
    """
    from emcas_fmu.commands.common import check_outputs, err, failures, out, work
    from emcas_fmu.pages.terminal import table
    from emcas_fmu.plotting import check_image
    from emcas_fmu.support.writing import write
    from examples.emps.calibration import FREE, calibrated, cross_validation
    from examples.emps.records import FITTED, UNSEEN, NoRecordsError, folder_of, load
    from examples.emps.simulated import errors, parameters

    with failures():
        try:
            folder = folder_of(records)
        except NoRecordsError as error:
            err.print(f"[bold red]error:[/] {error}", soft_wrap=True)
            raise typer.Exit(NO_RECORDS) from error
        check_outputs(json_file, check_image(plot), inputs=[folder])
        fitted, unseen = load(folder / FITTED), load(folder / UNSEEN)
        shipped = parameters()
        values = calibrated(fitted, {**shipped, **BEGIN}) if fit else shipped
        sets = {"model": values, **{name: {**shipped, **changes} for name, changes in AUTHORS.items()}}
        results = {name: {"fitted": asdict(errors(fitted, each)), "unseen": asdict(errors(unseen, each))}
                   for name, each in sets.items()}
        model = results.pop("model")
        document: dict[str, Any] = {
            **model, "authors": {**results, "printed": PRINTED}, "parameters": {name: values[name] for name in FREE},
            "records": {record.name: record.sha256 for record in (fitted, unseen)}}
        if terms:
            with work("calibrate", lines=True) as progress:
                document["terms"] = cross_validation(fitted, values, progress)
        if json_file:
            write(json_file, json.dumps(document, indent=1) + "\n")
        if plot:
            _plot(plot, (fitted, unseen), values)
    rows = [(f"authors, {name}", each) for name, each in document["authors"].items()] + [("this model", model)]
    out.print(table(("parameters", "record", ">force\n%", ">position\n%", ">windows\nmm", ">with level\nmm"),
                    [(words, record, *(each[record].get(key) for key in (
                        "force_percent", "position_percent", "window_rms_mm", "window_rms_mm_level")))
                     for words, each in rows for record in ("fitted", "unseen")]))
    if fit:
        out.print(table(("parameter", ">calibrated", ">emps.toml"), [(name, values[name], shipped[name])
                                                                    for name in FREE]))
    if terms:
        out.print(table(("model", ">force, fitted\n%", ">force, held out\n%", ">windows, held out\nmm"),
                        [(words, *each) for words, each in document["terms"].items()]))


def _plot(path: Path, records: tuple[Any, ...], values: Mapping[str, float]) -> None:
    """Write a picture of measured and simulated forces in both records, and of position errors in open-loop windows."""
    import numpy as np

    from emcas_fmu.plotting import plots
    from examples.emps.records import SAMPLE_TIME
    from examples.emps.simulated import force, in_windows, under_loops

    with plots.style():
        figure, grid = plots.figure(3, len(records), width=11.0, x="time [s]", sharex=True, sharey="row",
                                    y=("force [N]", "measured -\nsimulated [N]", "error of open-loop\nwindows [mm]"))
        for column, record in zip(grid.T, records, strict=True):
            time = np.arange(len(record)) * SAMPLE_TIME
            simulated = force(under_loops(record, [values])[1][0])
            off = 1e3 * in_windows(record, [values])[0]
            column[0].set_title(record.name)
            column[0].plot(time, force(record.voltage), color=plots.GRAY, label="measured")
            column[0].plot(time, simulated, color=plots.BLUE, label="simulated", linewidth=0.8)
            column[1].plot(time, force(record.voltage) - simulated, color=plots.VERMILLION, linewidth=0.5)
            for window, error in zip(time[:off.size].reshape(off.shape), off, strict=True):
                column[2].plot(window, error, color=plots.BLUE)
        plots.legend(grid[0, 0])
        plots.write(figure, path)


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command(epilog=EPILOG)(compare)
    command()
