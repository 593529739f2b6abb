"""The models of other authors that chapter 1 shows, beside the thesis's own (Figures 1.4 to 1.6)."""

from __future__ import annotations

from math import radians

from ...actuators import NONLINEAR
from ...bench.excitation import step_to
from ...bench.metrics import displayed, motion
from .entry import Show, Shown, Table
from .pictures import Panel, angle, of_run, panels, rate
from .runs import Runs

_FIGURES = {"rise_time_s": "rise 10-90 % [s]", "settling_time_s": "settling 2 % [s]",
            "overshoot_percent": "overshoot [%]", "sustained_rate_deg_per_s": "mean rate [deg/s]"}


def beside(model: str, author: str) -> Show:
    """Return what shows a step of an author's model beside one of the nonlinear actuator."""
    def show(runs: Runs) -> Shown:
        (size,) = runs.levels(10.0)
        models = {author: model, "nonlinear actuator": NONLINEAR}
        responses = {name: runs.of(each).run(step_to(radians(size), 0.5)) for name, each in models.items()}
        for run in responses.values():
            run.finished()
        of_author = responses[author]
        rows = [(name, *(displayed(motion(run))[key] for key in _FIGURES))
                                        for name, run in responses.items()]
        return Shown(runs.conditions(f"step to {size:g}°"), panels([
            Panel("fin angle / deg", [of_run(of_author),
                                      *(angle(run.columns, name) for name, run in responses.items())]),
            Panel("fin rate / deg/s", [rate(run.columns) for run in responses.values()])], "time / s", (0.0, 0.35)),
            f"The structure of {author}'s model with the motor, screw and fin of this unit, as far as it has them.",
            Table(("", *_FIGURES.values()), rows),
            "any number of it: the thesis shows a block diagram. docs/model/models.md says what each model leaves out.")

    return show
