"""Roll control of a sounding rocket in RocketPy: four fins, each turned by an actuator against its hinge moment.

    python examples/sounding_rocket/fly.py --output roll.png

The same flight is computed with each actuator; rocket and autopilot are invented. Needs the extras `rocketpy` and
`native`.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import fmpy
import matplotlib.pyplot as plt
import numpy as np
import typer
from fmpy.simulation import instantiate_fmu

import emcas_fmu as em
from emcas_fmu.commands.common import check_outputs, failures
from emcas_fmu.plotting import check_image

try:
    from rocketpy import Environment, Flight, GenericMotor, NoseCone, Rocket, TrapezoidalFin
    from rocketpy.control.controller import _Controller
    from rocketpy.mathutils import Vector
except ModuleNotFoundError as missing:
    if __name__ != "__main__":
        raise
    print(f"error: the flight needs the Python package {missing.name}, which is not installed: "
          "pip install 'emcas-fmu[rocketpy,native]'", file=sys.stderr)
    sys.exit(2)

ACTUATORS = {"none: the angle is the command": (None, None), "second-order": ("second-order", None),
             "servo": ("servo", None), "servo, set xl330": ("servo", "xl330")}
"""Actuators by title: model, and its parameter set if it is not the default."""
PERIOD = 5e-3  # s, of the autopilot and the exchange of values
FINS = 4
RADIUS = 0.0635  # m, of the body
BEHIND = 0.03  # m, distance of the centre of pressure behind the hinge
MISALIGNED = math.radians(0.5)  # misalignment of every fin: without control the rocket spins
TURN = (2.0, math.radians(90.0))  # time [s] and roll angle [rad] of the command, near the largest dynamic pressure
GAIN, RATE_GAIN = 0.1, 0.006  # fin command per roll angle [rad/rad] and per roll rate [s]
LIMIT = math.radians(6.0)  # largest command


class Roll(NamedTuple):
    """The record of a flight: time [s], roll angle [rad]; command, angle [rad] and hinge moment [N.m] of fin 1."""

    time: Any
    roll: Any
    command: Any
    angle: Any
    hinge_moment: Any


class SteeredFin(TrapezoidalFin):  # type: ignore[misc]
    """A fin that stores its normal force [N], as RocketPy computed it last."""

    normal_force = 0.0

    def compute_forces_and_moments(self, *arguments: Any, **options: Any) -> Any:
        """Return RocketPy's forces [N] and moments [N.m] in the body's frame, and store the normal force."""
        forces = super().compute_forces_and_moments(*arguments, **options)
        self.normal_force = float((self._rotation_body_to_fin @ Vector(list(forces[:3]))).x)
        return forces

    def hinge_moment(self) -> float:
        """Return the moment [N.m] about the hinge, positive along a positive angle of the fin."""
        return BEHIND * self.normal_force


class Unit:
    """The FMU of four actuators, which the autopilot steps."""

    def __init__(self, model: str, parameters: str | None, folder: Path) -> None:
        path = em.build(em.load_parameters(parameters, model=model), folder / "fins.fmu", backend="native",
                        platforms=[fmpy.platform], fins=FINS, references=False).path
        description = fmpy.read_model_description(str(path))
        self._at = {v.name: v.valueReference for v in description.modelVariables}
        self._slave = instantiate_fmu(fmpy.extract(str(path), unzipdir=str(folder / "fins")), description)
        self._slave.setupExperiment(startTime=0.0)
        self._slave.enterInitializationMode()
        self._slave.exitInitializationMode()
        self._now = 0.0

    def _of_fins(self, name: str) -> list[int]:
        return [self._at[f"fin[{fin + 1}].{name}"] for fin in range(FINS)]

    def step(self, to: float, command: float, hinge_moments: list[float]) -> list[float]:
        """Return the fins' angles [rad] at the time `to` [s], for one command [rad] and their hinge moments [N.m]."""
        if to > self._now:
            self._slave.setReal(self._of_fins("fin_command"), [command] * FINS)
            self._slave.setReal(self._of_fins("aero_torque"), hinge_moments)
            self._slave.doStep(self._now, to - self._now)
            self._now = to
        return list(self._slave.getReal(self._of_fins("fin_angle")))


def rocket(fins: list[SteeredFin]) -> Rocket:
    """Return a rocket of 19 kg with a motor of 2 kN for 3 s, and steered fins at its tail."""
    motor = GenericMotor(thrust_source=2000.0, burn_time=3.0, chamber_radius=0.05, chamber_height=0.5,
                         chamber_position=0.0, propellant_initial_mass=3.0, nozzle_radius=0.03, dry_mass=1.8,
                         center_of_dry_mass_position=0.0, dry_inertia=(0.1, 0.1, 0.002))
    made = Rocket(radius=RADIUS, mass=14.4, inertia=(6.3, 6.3, 0.034), power_off_drag=0.5, power_on_drag=0.5,
                  center_of_mass_without_motor=0.0, coordinate_system_orientation="tail_to_nose")
    made.add_motor(motor, position=-1.1)
    made.add_surfaces(NoseCone(length=0.55, kind="von karman", base_radius=RADIUS, rocket_radius=RADIUS), 1.28)
    made.add_surfaces(fins, [-1.05] * FINS)
    return made


def fly(model: str | None, parameters: str | None = None, duration: float = 4.0) -> Roll:
    """Return a flight of `duration` [s] from ignition with four actuators of a model, or without actuators."""
    fins = [SteeredFin(angular_position=90.0 * k, root_chord=0.12, tip_chord=0.06, span=0.11, rocket_radius=RADIUS,
                       cant_angle=math.degrees(MISALIGNED)) for k in range(FINS)]
    rows: list[tuple[float, ...]] = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        unit = Unit(model, parameters, Path(folder)) if model else None

        def autopilot(time: float, _rate: float, state: list[float], *_: Any) -> None:
            roll_rate = state[-1]
            roll = (rows[-1][1] if rows else 0.0) + PERIOD * roll_rate  # integrated like a gyro's rate
            target = TURN[1] if time >= TURN[0] else 0.0
            # A positive angle of the fins rolls the rocket to negative angles in RocketPy's axes.
            command = max(-LIMIT, min(LIMIT, RATE_GAIN * roll_rate - GAIN * (target - roll)))
            moments = [fin.hinge_moment() for fin in fins]
            angles = unit.step(time, command, moments) if unit else [command] * FINS
            for fin, angle in zip(fins, angles, strict=True):
                fin.cant_angle_rad = angle + MISALIGNED
            rows.append((time, roll, command, angles[0], moments[0]))

        steered = rocket(fins)
        # RocketPy's public interface has controllers for air brakes only.
        steered._add_controllers(_Controller(fins, lambda t, r, x, h, o, i: autopilot(t, r, x), 1.0 / PERIOD))
        Flight(rocket=steered, environment=Environment(), rail_length=5.0, inclination=85.0, heading=0.0,
               max_time=duration, time_overshoot=False)
    return Roll(*np.array(rows).T)


def held(flight: Roll) -> float:
    """Return the largest distance [rad] of the roll from its target in the last second."""
    last = flight.time > flight.time[-1] - 1.0
    return float(np.max(np.abs(flight.roll[last] - TURN[1])))


def picture(flights: dict[str, Roll], path: Path) -> None:
    """Write a picture of roll angle, and of angle and hinge moment of fin 1, in several flights."""
    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7.0, 7.5), layout="constrained")
    for title, flight in flights.items():
        for axis, values in zip(axes, (np.degrees(flight.roll), np.degrees(flight.angle), flight.hinge_moment)):
            axis.plot(flight.time, values, label=title, linewidth=1.0)
    for axis, label in zip(axes, ("roll / °", "fin 1 / °", "hinge moment / N·m")):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_ylim(-60.0, 180.0)
    axes[0].legend(fontsize="small")
    axes[-1].set_xlabel("time / s")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main(output: Annotated[Path, typer.Option(help="Picture to write: .png, .svg or .pdf.")] = Path("roll.png"),
         ) -> None:
    """Fly with every actuator, print a line for each, and write a picture."""
    with failures():
        check_outputs(check_image(output))
        flights = {}
        for title, (model, parameters) in ACTUATORS.items():
            print(f"{title} ...", flush=True)
            flights[title] = fly(model, parameters)
            largest = np.max(np.abs(flights[title].hinge_moment))
            print(f"  roll in the last second within {math.degrees(held(flights[title])):.0f}° of its target, hinge "
                  f"moment up to {largest:.1f} N·m", flush=True)
        picture(flights, output)
        print(f"written {output}")


if __name__ == "__main__":
    command = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    command.command()(main)
    command()
