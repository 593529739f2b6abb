"""Figures 1.4 to 1.6, models of other authors, and 1.7 to 1.12, other kinds of actuation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import radians

from emcas_fmu.actuators import NONLINEAR
from emcas_fmu.bench.excitation import LOAD, step_to
from emcas_fmu.bench.metrics import displayed, motion_figures
from emcas_fmu.motions import RATED

from .entry import Show, Shown, Table
from .pictures import Line, Panel, angle, command_of, panels, rate
from .runs import Runs

_THESIS = "nonlinear actuator"
_FIGURES = {"rise_time_s": "rise 10-90 % [s]", "settling_time_s": "settling 2 % [s]",
            "overshoot_percent": "overshoot [%]", "sustained_rate_deg_per_s": "mean rate [deg/s]"}
_OF_AUTHOR = ("The structure of {}'s model, with this actuator's motor, screw and fin as far as it has them.",
              "all numbers: the thesis shows only a block diagram. docs/model/models.md lists the effects that each "
              "model leaves out.")
_OF_KIND = ("An actuator with {}, sized for the same task; all its numbers are estimates.",
            "all numbers: the thesis describes this kind only in words. docs/model/comparison.md compares all kinds in "
            "figures.")


def author(model: str, name: str) -> Show:
    """Return a function that shows a step of an author's model beside a step of the nonlinear actuator."""
    return _beside({name: model}, _OF_AUTHOR[0].format(name), _OF_AUTHOR[1])


def kind(name: str, *models: str) -> Show:
    """Return a function that shows a step of each of the `models` of a kind beside a step of the nonlinear actuator."""
    return _beside({model: model for model in models}, _OF_KIND[0].format(name), _OF_KIND[1])


def circuit(model: str, further: Sequence[tuple[str, str, float]]) -> Show:
    """Return a function that shows pressures and `further` outputs (name, label, factor) of a hydraulic actuator."""
    def show(runs: Runs) -> Shown:
        (size,) = runs.levels(10.0)
        run = runs.of(model).run(step_to(radians(size), 0.5).holding({LOAD: -RATED}))
        run.finished()

        def curve(output: str, factor: float) -> Line:
            return Line(run.columns["time"], factor * run.columns[output], output.replace("_", " "))

        return Shown(runs.conditions(f"step to {size:g}°", f"{RATED:g} N·m against it"), panels([
            Panel("pressure / MPa", [curve(name, 1e-6) for name in ("pressure_1", "pressure_2")]),
            *(Panel(label, [curve(output, factor)]) for output, label, factor in further)], "time [s]", (0.0, 0.35)),
            "The behaviour of the circuit that the thesis describes; all its numbers are estimates.",
            unknown="all numbers: the thesis describes the circuit only in words.")

    return show


def _beside(others: Mapping[str, str], caption: str, unknown: str) -> Show:
    def show(runs: Runs) -> Shown:
        (size,) = runs.levels(10.0)
        models = {**others, _THESIS: NONLINEAR}
        responses = {name: runs.of(each).run(step_to(radians(size), 0.5)) for name, each in models.items()}
        for run in responses.values():
            run.finished()
        rows = [(name, *(displayed(motion_figures(run))[key] for key in _FIGURES)) for name, run in responses.items()]
        return Shown(runs.conditions(f"step to {size:g}°"), panels([
            Panel("fin angle [deg]", [command_of(responses[_THESIS]),
                                      *(angle(run.columns, name) for name, run in responses.items())]),
            Panel("fin rate [deg/s]", [rate(run.columns) for run in responses.values()])], "time [s]", (0.0, 0.35)),
            caption, Table(("", *_FIGURES.values()), rows), unknown)

    return show
