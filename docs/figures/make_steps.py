"""Plot the README's picture: `python docs/figures/make_steps.py EMCAS.fmu`."""

from __future__ import annotations

import sys

import numpy as np
from fmpy import simulate_fmu
from make_tables import save
from matplotlib.text import Text

from emcas_fmu.plotting import plots
from emcas_fmu.reference import files
from emcas_fmu.support.files import models_directory

CASES = {"step_plus20": plots.PURPLE, "step_plus10": plots.GREEN, "step_plus5": plots.VERMILLION,
         "step_plus1": plots.BLUE}


def main(fmu: str) -> None:
    folder = models_directory() / "reference"
    with plots.style():
        figure, ((angle,), (error,)) = plots.figure(2, height=2.0, width=8.0, sharex=True, height_ratios=(3, 1))
        for name, color in CASES.items():
            inputs = files.read_csv(files.path_of(folder, name, "in.csv"))
            reference = files.read_csv(files.path_of(folder, name, "ref.csv"))
            signals = np.zeros(len(inputs["time"]), dtype=[(key, float) for key in inputs])
            for key, column in inputs.items():
                signals[key] = column
            result = simulate_fmu(fmu, input=signals, start_values={"encoder.enabled": False}, stop_time=0.5,
                                  output_interval=1e-3, output=["fin_angle"])
            time, response = result["time"] * 1e3, np.degrees(result["fin_angle"])
            angle.plot(time, response, color=color, label=f"{np.degrees(inputs['fin_command'].max()):.0f}°")
            label = "independent reference" if name == "step_plus1" else None
            angle.plot(reference["time"][::12] * 1e3, np.degrees(reference["fin_angle"][::12]), "o", color="#444444",
                       markersize=2.5, fillstyle="none", label=label)
            error.plot(time, (response - np.degrees(reference["fin_angle"])) * 1e3, color=color)
        angle.set(ylabel="fin angle [deg]", title="Step responses of EMCAS.fmu under fmpy")
        error.set(ylabel="error [mdeg]", xlabel="time [ms]", ylim=(-1.0, 1.0), xlim=(0, 400))
        angle.legend(loc="upper left")
    for text in figure.findobj(Text):
        text.set(color="#222222")
    save(figure, "steps", 150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "EMCAS.fmu")
