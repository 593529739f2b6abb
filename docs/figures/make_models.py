"""Plot the picture of docs/model/models.md: `python docs/figures/make_models.py`."""

from __future__ import annotations

from functools import partial
from math import radians

import numpy as np
from make_tables import MODELS, save

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate

# Step [deg], load [N.m], end of the run [s], title of the panel.
CASES = ((2.0, 0.0, 0.12, "2°, unloaded"), (15.0, 0.0, 0.2, "15°, unloaded"),
         (15.0, -100.0, 0.2, "15° against 100 N·m"), (15.0, 100.0, 0.2, "15° with 100 N·m"))


def _step(angle: float, time: float) -> float:
    """Return the command [rad] at a time [s]: a step to `angle` [deg] at 0.02 s."""
    return radians(angle) if time > 0.0199 else 0.0


def main() -> None:
    colors = dict(zip((name for name in MODELS if name != NONLINEAR), plots.COLORS, strict=True))
    with plots.style():
        figure, axes = plots.figure(2, 2, height=2.9)
        for (angle, load, stop, title), axis in zip(CASES, axes.flat, strict=True):
            for name in MODELS:
                run = simulate(load_parameters(model=name).values, stop, 2.5e-4, model=name, aero_torque=load,
                               fin_command=partial(_step, angle))
                axis.plot(run["time"], np.degrees(run["fin_angle"]), label=name, color=colors.get(name, plots.GRAY),
                          linewidth=4.0 if name == NONLINEAR else 1.1, alpha=0.6 if name == NONLINEAR else 1.0)
            axis.set(title=title, xlabel="time [s]", ylabel="fin angle [deg]", xlim=(0.0, stop),
                     ylim=(-0.3 * angle, 1.4 * angle))
        figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=len(MODELS))
        save(figure, "models")


if __name__ == "__main__":
    main()
