"""Compare coupled halves with the whole actuator: `python examples/hardware_in_the_loop/run.py --help`."""

from __future__ import annotations

import sys
from math import tan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

import emcas_fmu as emcas
from examples.hardware_in_the_loop.coupling import Half, Signals, coupled

EPILOG = ("Examples:\n\n  python examples/hardware_in_the_loop/run.py"
          "\n\n  python examples/hardware_in_the_loop/run.py --model servo --at-once"
          "\n\n  python examples/hardware_in_the_loop/run.py --own-controller")
INPUTS: dict[str, Any] = {"fin_command": lambda t: 0.2 if t > 0.02 else 0.0,
                          "aero_torque": lambda t: -5.0 if t > 0.15 else 0.0}


class OwnController:
    """A controller in plain Python that replaces the FMU's: proportional loops of position and speed.

    It converts a command [rad] to a motor angle by the kinematics of lever and screw, and limits speed and reference.
    """

    def __init__(self, p: Any) -> None:
        self._p, self._reference = p, 0.0

    def signals(self) -> Signals:
        """Return the reference [V]."""
        return {"drive_reference": self._reference}

    def step(self, time: float, size: float, inputs: Signals) -> None:
        """Compute the reference [V] from command [rad], motor angle [rad] and motor speed [rad/s] in `inputs`."""
        p, lever = self._p, self._p.kinematics
        tangent = tan(inputs["fin_command"] + lever.initial_angle) - tan(lever.initial_angle)
        error = tangent * lever.moment_arm / p.screw.lead - inputs["motor_angle"]
        most, full = p.controller.speed_limit, p.drive.reference_limit
        speed = min(max(p.controller.position.kp * error, -most), most)
        self._reference = min(max(p.controller.velocity.kp * (speed - inputs["motor_speed"]), -full), full)


def run(
    model: Annotated[str, typer.Option(help="Actuator with extensions, or its file.", metavar="NAME")] = "nonlinear",
    stop: Annotated[float, typer.Option(help="Duration [s].")] = 0.3,
    step: Annotated[float, typer.Option(help="Communication step [s].")] = 1e-3,
    at_once: Annotated[bool, typer.Option("--at-once", help="Step both halves at once instead of in turn.")] = False,
    own_controller: Annotated[bool, typer.Option("--own-controller", help="Use a controller in plain Python instead of "
                                                 "the FMU (for an actuator with lever and screw).")] = False,
) -> None:
    """Couple controllers and plant, two FMUs, and print the difference of the fin angle from the whole actuator's."""
    try:
        parameters = emcas.load_parameters(model=model)
        whole = emcas.simulate(parameters, stop=stop, step=step, **INPUTS)
        with TemporaryDirectory() as folder:
            files = {part: Path(folder) / f"{part}.fmu" for part in ("controller", "plant")}
            for part, file in files.items():
                if part == "plant" or not own_controller:
                    emcas.build(parameters, file, part=part)
            with Half(files["plant"]) as plant:
                if own_controller:
                    try:
                        response = coupled(OwnController(parameters.nested()), plant, stop, step, INPUTS, not at_once)
                    except (AttributeError, KeyError) as error:
                        raise emcas.EmcasError(f"--own-controller: reads motor angle, lever, screw and limits, which "
                                               f"{model} does not have; choose nonlinear, or leave it out") from error
                else:
                    with Half(files["controller"]) as controllers:
                        response = coupled(controllers, plant, stop, step, INPUTS, not at_once)
    except emcas.EmcasError as error:
        typer.echo(f"Error: {error}", err=True)
        raise typer.Exit(2) from error
    difference = np.degrees(np.abs(response["fin_angle"] - whole["fin_angle"]))
    typer.echo(f"fin angle at {stop:g} s: {np.degrees(response['fin_angle'][-1]):.4f} deg, of the whole actuator "
               f"{np.degrees(whole['fin_angle'][-1]):.4f} deg; largest difference {difference.max():.3g} deg")


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command(epilog=EPILOG)(run)
    command()
