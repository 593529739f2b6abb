"""Compare the simulated XL330 with records of a real one: `python examples/xl330/compare.py --help`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from emcas_fmu.api import EmcasError
from emcas_fmu.support.writing import check_target, write
from examples.xl330 import records
from examples.xl330.records import Array, Record

NO_RECORDS, REFUSED = 3, 2  # exit codes


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the mean absolute error of the simulated position for each record; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", nargs="+", type=Path, metavar="FILE", help="records, or folders of them; default: "
                        f"the folder that the environment variable {records.FOLDER} names")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the errors here, too")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw measured and simulated position")
    parser.add_argument("-p", "--parameters", nargs="+", type=Path, default=(), metavar="FILE",
                        help=f"parameter files over the set {records.SET}")
    options = parser.parse_args(arguments)
    try:
        if options.plot:
            check_target(options.plot, ".png", EmcasError)
        base = records.shipped(options.parameters)
        runs = [records.read(path) for path in records.files(options.records)]
        positions = [records.simulated(run, base, records.TILT) for run in runs]
        errors = [records.error(run, position) for run, position in zip(runs, positions, strict=True)]
        mean = sum(errors) / len(errors)
        print(f"{'record':32} {'gain':>5} {'trajectory':16} {'mean absolute error':>19}")
        for run, each in zip(runs, errors, strict=True):
            print(f"{run.path.name:32} {run.gain:5.0f} {run.trajectory:16} {each:14.1f} mrad")
        print(f"{f'mean of {len(runs)}':55} {mean:14.1f} mrad")
        if options.json:
            listed = [{"file": run.path.name, "kp": run.gain, "trajectory": run.trajectory, "mean_abs_error_mrad": each}
                      for run, each in zip(runs, errors, strict=True)]
            write(options.json, json.dumps({"mean_abs_error_mrad": mean, "records": listed}, indent=2) + "\n")
        if options.plot:
            draw(options.plot, runs, positions, errors)
    except records.NoRecordsError as error:
        print(error, file=sys.stderr)
        return NO_RECORDS
    except EmcasError as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    return 0


def draw(path: Path, runs: Sequence[Record], positions: Sequence[Array], errors: Sequence[float]) -> None:
    """Write a picture of goal, measured and simulated position of each record."""
    from emcas_fmu.figures import plots

    with plots.style():
        figure, panels = plots.panels(len(runs), 2, width=12.0, height=2.6)
        for axes, run, position, error in zip(panels, runs, positions, errors, strict=True):
            axes.plot(run.time, run.goal, label="goal", **plots.COMMAND)
            axes.plot(run.time, run.position, label="measured")
            axes.plot(run.time, position, "--", label="simulated")
            axes.set(title=f"gain {run.gain:.0f}, {run.trajectory}: {error:.1f} mrad", ylabel="rad")
        plots.legend(panels[0])
        figure.supxlabel("time [s]")
        plots.write(figure, path)


if __name__ == "__main__":
    sys.exit(main())
