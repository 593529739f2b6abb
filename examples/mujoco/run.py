"""Roll the tail by 60 deg and back on four actuators: `python examples/mujoco/run.py --help`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from math import degrees, inf, radians
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

import emcas_fmu as emcas
from emcas_fmu.commands.common import check_outputs
from emcas_fmu.plotting import check_image, plots
from examples.hardware_in_the_loop.coupling import Half
from examples.mujoco.rig import COLUMNS, FINS, Array, Rig

EPILOG = ("Examples:\n\n  python examples/mujoco/run.py --plot roll.png"
          "\n\n  python examples/mujoco/run.py --model worm-gear --inertia 4")
_AT = {name: i for i, name in enumerate(COLUMNS)}


def roll_command(time: float) -> float:
    """Return the commanded roll angle [rad] at a time [s]."""
    return radians(60.0) if 0.05 <= time < 0.9 else 0.0


def plot(rows: Array, path: Path) -> None:
    """Write a picture of roll angle, and of angle and actuator torque of fin 1; `rows` has COLUMNS [SI]."""
    time = rows[:, 0]
    with plots.style():
        figure, (roll, fin, torque) = plots.column("roll [deg]", "fin 1 [deg]", "torque [N·m]", x="time [s]")
        roll.plot(time, np.degrees([roll_command(t) for t in time]), label="command", **plots.COMMAND_STYLE)
        roll.plot(time, np.degrees(rows[:, _AT["roll"]]), label="motion")
        fin.plot(time, np.degrees(rows[:, _AT["fin1_command"]]), **plots.COMMAND_STYLE)
        fin.plot(time, np.degrees(rows[:, _AT["fin1_angle"]]))
        torque.plot(time, rows[:, _AT["fin1_torque"]])
        plots.legend(roll)
        plots.write(figure, path)


def run(
    model: Annotated[str, typer.Option(help="Actuator with extensions.", metavar="NAME")] = "nonlinear",
    stop: Annotated[float, typer.Option(help="Duration [s].")] = 1.6,
    step: Annotated[float, typer.Option(help="Time step of MuJoCo, and communication step [s].")] = 1e-3,
    inertia: Annotated[float, typer.Option(help="Ratio of the fins' inertia to that in the file.")] = 1.0,
    picture: Annotated[Path | None, typer.Option("--plot", help="Picture to write: .png, .svg or .pdf.")] = None,
) -> None:
    """Roll a tail with four fins in MuJoCo, each fin turned by an FMU with torque out."""
    try:
        check_outputs(check_image(picture))
        if not (0.0 < step <= stop < inf and 0.0 < inertia < inf):
            raise emcas.EmcasError(f"--stop {stop:g}, --step {step:g}, --inertia {inertia:g}: must be above 0, and the "
                                   "step not above the stop")
        with TemporaryDirectory() as folder, ExitStack() as opened:
            file = Path(folder) / "actuator.fmu"
            emcas.build(emcas.load_parameters(model=model), file, interface="torque")
            rows = Rig([opened.enter_context(Half(file)) for _ in FINS], step, inertia).run(stop, roll_command)
    except emcas.EmcasError as error:
        typer.echo(f"Error: {error}", err=True)
        raise typer.Exit(2) from error
    if picture:
        plot(rows, picture)
    angles, torques = (np.abs(rows[:, [_AT[f"{fin}_{what}"] for fin in FINS]]) for what in ("angle", "torque"))
    typer.echo(f"roll at {stop:g} s: {degrees(rows[-1, _AT['roll']]):.3f} deg, at most "
               f"{degrees(rows[:, _AT['roll']].max()):.2f} deg; fins up to {np.degrees(angles.max()):.2f} deg, "
               f"torque up to {torques.max():.0f} N.m")


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command(epilog=EPILOG)(run)
    command()
