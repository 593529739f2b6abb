"""Plot the picture of docs/model/elastic.md, and print its tables of limit cycles and the numbers of its text."""

from __future__ import annotations

from itertools import product
from math import degrees, pi, sin, tan
from typing import Any

import numpy as np
from make_tables import save

from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate

MODEL = "elastic"
GAPS = (0.0, 25e-6, 50e-6, 100e-6, 200e-6)
STEPS = (0.0195, 0.02, 0.03, -0.1)  # rad
GAINS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)
DAMPED = {"friction.fin_viscous": 5.0}
DRY = (0.0, 2.0)  # N.m of friction about the hinge: none, and the default
BASE = load_parameters(model=MODEL)


def _indirect(motor_angle: Any) -> Any:
    """Return the fin angle [rad] that follows from a motor angle [rad] without gap and compliance."""
    values, start = BASE.values, BASE.values["kinematics.initial_angle"]
    return np.arctan(values["screw.lead"] / values["kinematics.moment_arm"] * motor_angle + tan(start)) - start


def _draw() -> None:
    """Plot the fin angle over a slow cycle of 2 deg. Friction at the fin makes the flank change with the direction."""
    with plots.style():
        figure, axes = plots.figure(1, 2, height=3.4)
        for gap, color in ((0.0, plots.GREEN), (50e-6, plots.BLUE), (100e-6, plots.VERMILLION)):
            values = BASE.with_values({"drive_line.backlash": gap, "friction.fin_coulomb": 5.0, **DAMPED}).values
            run = simulate(values, 8.0, model=MODEL, fin_command=lambda t: 0.035 * sin(0.5 * pi * t))
            cycle = slice(4000, None)
            direct, indirect = (np.degrees(a[cycle]) for a in (run["fin_angle"], _indirect(run["motor_angle"])))
            label = f"gap {gap * 1e6:.0f} µm"
            axes[0][0].plot(indirect, direct, color=color, label=label)
            axes[0][1].plot(indirect, direct - indirect, color=color, label=label)
            print(f"gap {gap * 1e6:.0f} um: direct less indirect spans {np.ptp(direct - indirect):.4f} deg, "
                  f"the gap is {degrees(gap / 0.05):.4f} deg at 0.05 m")
        axes[0][0].set(xlabel="indirect fin angle, through the motor [deg]", ylabel="direct fin angle [deg]",
                       xlim=(1.5, 2.1), ylim=(1.5, 2.1), title="At a reversal")
        axes[0][1].set(xlabel="indirect fin angle, through the motor [deg]", ylabel="direct less indirect [deg]",
                       title="Over the cycle")
        axes[0][1].legend(loc="center", bbox_to_anchor=(0.5, 0.62))
        save(figure, "elastic_hysteresis")


def _width(values: Any, step: float) -> float:
    """Return the peak-to-peak motion of the fin [deg] in the last 3 s of a run of 20 s with a step [rad]."""
    run = simulate(values, 20.0, model=MODEL, fin_command=lambda t: step if t > 0.05 else 0.0)
    return float(np.degrees(np.ptp(run["fin_angle"][17000:])))


def _limit_cycles() -> None:
    """Print tables of the largest width [deg] of a limit cycle after STEPS, over gaps and gains."""
    for dry, on_fin in product(DRY, (True, False)):
        print(f"\n{dry:g} N.m, loop closed {'at the fin' if on_fin else 'at the motor'}")
        print("| gap | " + " | ".join(f"×{gain:g}" for gain in GAINS) + " |")
        for gap in GAPS:
            row = []
            for gain in GAINS:
                values = BASE.with_values({
                    "drive_line.backlash": gap, "encoder.on_fin": on_fin, "encoder.enabled": False, **DAMPED,
                    "friction.fin_coulomb": dry,
                    "controller.position.kp": gain * BASE.values["controller.position.kp"]}).values
                row.append(f"{max(_width(values, step) for step in STEPS):.3f}")
            print(f"| {gap * 1e6:.0f} µm ({degrees(gap / 0.05):.3f}°) | " + " | ".join(row) + " |")


def main() -> None:
    _draw()
    _limit_cycles()


if __name__ == "__main__":
    main()
