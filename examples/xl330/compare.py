"""Compare the simulated XL330 with records of a real one: `python examples/xl330/compare.py --help`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from emcas_fmu.api import EmcasError, ParameterSet
from emcas_fmu.commands.common import check_outputs
from emcas_fmu.plotting import check_image
from emcas_fmu.support.writing import write
from examples.xl330 import records
from examples.xl330.calibration import GENERATIONS, calibrated, groups, typical, unseen
from examples.xl330.records import Array, Record

NO_RECORDS, REFUSED, INTERRUPTED = 3, 2, 130  # exit codes


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the mean absolute error of the simulated position for each record; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", nargs="+", type=Path, metavar="FILE", help="records, or folders of them; default: "
                        f"the folder that the environment variable {records.FOLDER} names")
    parser.add_argument("--json", type=Path, metavar="FILE", help="file for the errors")
    parser.add_argument("--plot", type=Path, metavar="FILE",
                        help="picture of measured and simulated positions, .svg, .png or .pdf")
    parser.add_argument("--fit", action="store_true", help="calibrate on these records, from the data sheet's values, "
                        "instead of using the shipped set (a minute)")
    parser.add_argument("--unseen", action="store_true", help="also calibrate without a part of these records, and "
                        "print the errors of this part: in turn a group with one record of each gain and trajectory, "
                        "and a single record (ten minutes)")
    parser.add_argument("-p", "--parameters", nargs="+", type=Path, default=(), metavar="FILE",
                        help=f"parameter files that override the set {records.SET}")
    options = parser.parse_args(arguments)
    try:
        check_outputs(options.json, check_image(options.plot), inputs=[options.records])
        base = records.shipped(options.parameters)
        runs = [records.read(path) for path in records.files(options.records)]
        values = calibrated(runs, base, report=_report("all records")) if options.fit else {}
        positions = [records.simulated(run, base, values) for run in runs]
        errors = [float(records.error(run, position)) for run, position in zip(runs, positions, strict=True)]
        mean = sum(errors) / len(errors)
        print(f"{'record':32} {'gain':>5} {'trajectory':16} {'mean absolute error':>19}")
        for run, each in zip(runs, errors, strict=True):
            print(f"{run.path.name:32} {run.gain:5.0f} {run.trajectory:16} {each:14.1f} mrad")
        print(f"{f'mean of {len(runs)}':55} {mean:14.1f} mrad")
        if options.fit:
            print(f"\n{'parameter, SI':32} {'start':>9} {'calibrated':>10} {'in use':>9}")
            for name, start in typical().items():
                print(f"{name:32} {start:9.3g} {values[name]:10.3g} {records.value(base, name):9.3g}")
        left_out = {words: _unseen(words, runs, base, splits) for words, splits in (
            ("one of each gain and trajectory", groups(runs)), ("one record", [[run] for run in runs]))
            } if options.unseen else {}
        if options.json:
            listed = [{"file": run.path.name, "sha256": run.sha256, "kp": run.gain, "trajectory": run.trajectory,
                       "mean_abs_error_mrad": each} for run, each in zip(runs, errors, strict=True)]
            write(options.json, json.dumps({"mean_abs_error_mrad": mean, "records": listed, "calibrated": values,
                                            "unseen": left_out}, indent=2) + "\n")
        if options.plot:
            draw(options.plot, runs, positions, errors)
    except records.NoRecordsError as error:
        print(error, file=sys.stderr)
        return NO_RECORDS
    except EmcasError as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def _report(words: str) -> Callable[[int, float], None]:
    """Return a function that prints the progress of a calibration to a terminal."""
    def show(generation: int, cost: float) -> None:
        if sys.stderr.isatty():
            last = generation == GENERATIONS
            print(f"\r{words}: {generation} of {GENERATIONS}, {cost:.1f} mrad ", end="\n" if last else "",
                  file=sys.stderr, flush=True)

    return show


def _unseen(words: str, runs: Sequence[Record], base: ParameterSet, splits: Sequence[Sequence[Record]]) -> list[Any]:
    """Print and return, for each split, the errors [mrad] of its records by file with a set from all other records."""
    print(f"\ncalibrated without {words}, error of the records left out")
    found = []
    for k, split in enumerate(splits):
        found.append(unseen(runs, base, split, _report(f"{words}, {k + 1} of {len(splits)}")))
        for run in split:
            print(f"{run.path.name:32} {run.gain:5.0f} {run.trajectory:16} {found[-1][run.path.name]:14.1f} mrad",
                  flush=True)
    errors = [each for split in found for each in split.values()]
    print(f"{'mean':55} {sum(errors) / len(errors):14.1f} mrad")
    return found


def draw(path: Path, runs: Sequence[Record], positions: Sequence[Array], errors: Sequence[float]) -> None:
    """Write a picture of goal, measured and simulated position of each record."""
    from emcas_fmu.plotting import plots

    with plots.style():
        figure, panels = plots.panel_grid(len(runs), 2, width=12.0, height=2.6)
        for axes, run, position, error in zip(panels, runs, positions, errors, strict=True):
            axes.plot(run.time, run.goal, label="goal", **plots.COMMAND_STYLE)
            axes.plot(run.time, run.position, label="measured")
            axes.plot(run.time, position, "--", label="simulated")
            axes.set(title=f"gain {run.gain:.0f}, {run.trajectory}: {error:.1f} mrad", ylabel="rad")
        plots.legend(panels[0])
        figure.supxlabel("time [s]")
        plots.write(figure, path)


if __name__ == "__main__":
    sys.exit(main())
