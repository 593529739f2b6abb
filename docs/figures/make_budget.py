"""Tables and picture of docs/model/accuracy.md: budgets of actuators; an encoder on the fin, behind compliance.

    python docs/figures/make_budget.py           # writes the picture, and the tables between their markers
    python docs/figures/make_budget.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from math import degrees, pi, radians
from typing import Any

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.bench.excitation import step_to
from emcas_fmu.bench.measure import Test, measure
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.pages.numbers import rounded
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.studies.report import budget
from emcas_fmu.studies.report.outcome import Outcome, Rig

LOAD = 100.0  # N.m
BASE = load_parameters("hinge-stiffness", model="elastic")
FINE = 64  # factor of the pulses with which a count on the fin equals that of the motor's encoder, at the fin
ON_FIN = {"encoder.on_fin": True}
SETS: Mapping[str, ParameterSet] = {
    "motor": BASE, "fin": BASE.with_values(ON_FIN),
    f"fin, {FINE} times the counts": BASE.with_values(
        {**ON_FIN, "encoder.pulses": FINE * BASE.values["encoder.pulses"]})}
# Without dry friction about the hinge, with viscous friction as in docs/model/elastic.md: the fin is free in the gap.
LOOSE = {"friction.fin_coulomb": 0.0, "friction.fin_viscous": 5.0}
STEPS = tuple(Test("step", radians(size), 6.0) for size in (0.3, 1.0, 5.0, 20.0))
ACTUATORS: Mapping[str, ParameterSet] = {
    **{f"`{name}`": load_parameters(model=name) for name in ("nonlinear", "elastic")},
    "`elastic` with `hinge-stiffness`": BASE,
    **{f"`{name}`": load_parameters(model=name) for name in ("worm-gear", "clutch", "electrohydraulic", "servo")}}
TOTALS = ("as_set", "root_of_squares", "worst_case", "monte_carlo_95", "monte_carlo_99", "required")


def _worst(parameters: ParameterSet, tests: tuple[Test, ...], figure: str) -> float:
    """Return the largest value of a figure in several tests."""
    return float(max(measure(test, ParameterSubject(parameters), [{}], (figure,), ("maximum",))[0, 0]
                     for test in tests))


def _angle(degree: float) -> str:
    return f"{rounded(degree, '.2g')}°"


def _both(outcome: Outcome) -> dict[str, str]:
    """Return the values of every group of a budget as text, "without load / with load"."""
    return {name: " / ".join(_angle(float(value)) for value in group.values())
            for name, group in outcome.figures.items()}


def _column(parameters: ParameterSet) -> dict[str, str]:
    """Return the cells of a set's column, by the titles of their rows."""
    groups = _both(budget.measure(Rig(ParameterSubject(parameters))))
    ((gain, phase),) = measure(Test("linear"), ParameterSubject(parameters), [{}], ("gain_margin", "phase_margin"),
                               ("minimum", "minimum"))
    turn = 2.0 * pi / (parameters.values["encoder.pulses"] * parameters.values["encoder.multiplier"])
    small = turn * parameters.values["screw.lead"] / parameters.values["kinematics.moment_arm"]
    loaded = (Test("load", duration=6.0, torque=LOAD),)

    return {
        "a count, at the fin": _angle(degrees(turn if parameters.values["encoder.on_fin"] else small)),
        **{f"{words}, without load / with 100 N·m": groups[name] for words, name in (
            ("compliance", "compliance"), ("backlash", "backlash"), ("encoder", "encoder"), ("as set", "as_set"),
            ("root of the sum of squares", "root_of_squares"), ("worst case", "worst_case"),
            ("95 % of drawn actuators", "monte_carlo_95"))},
        "gain margin": f"{gain:.1f} dB", "phase margin": f"{degrees(phase):.0f}°",
        "hunting, without load / with 100 N·m": " / ".join(
            _angle(degrees(_worst(parameters, tests, "ripple"))) for tests in (STEPS, loaded)),
        "hunting without dry friction about the hinge, without load / with 100 N·m": " / ".join(
            _angle(degrees(_worst(parameters.with_values(LOOSE), tests, "ripple"))) for tests in (STEPS, loaded)),
        "motor current while it hunts, rms": f"{_worst(parameters, STEPS, 'current_ripple'):.2f} A",
    }


def _budget_of(parameters: ParameterSet) -> list[str]:
    """Return the totals of a budget, and its largest terms under the load."""
    outcome = budget.measure(Rig(ParameterSubject(parameters)))
    groups = _both(outcome)
    terms = {name: group for name, group in outcome.groups.items() if name not in TOTALS}
    largest = sorted(terms.values(), key=lambda group: -group.figures["loaded_deg"])[:2]
    return [*(groups[name] for name in ("as_set", "root_of_squares", "worst_case", "monte_carlo_95", "required")),
            ", ".join(f"{group.label.partition(',')[0].partition(':')[0]} {_angle(group.figures['loaded_deg'])}"
                      for group in largest)]


def budgets() -> str:
    """Return the table of the budgets of ACTUATORS."""
    return markdown(("", "as set", "root of the sum of squares", "worst case", "95 % of drawn actuators", "required",
                     "largest terms, loaded"),
                    ((name, *_budget_of(parameters)) for name, parameters in ACTUATORS.items()))


def encoders() -> str:
    """Return the table of the figures of SETS, in columns."""
    columns = {name: _column(parameters) for name, parameters in SETS.items()}
    return markdown(("encoder of the position on the", *columns),
                    zip(next(iter(columns.values())), *(column.values() for column in columns.values()), strict=True))


def _draw() -> None:
    """Plot the error over time: after a step against a load, and at rest without dry friction about the hinge."""
    with plots.style():
        figure, ((loaded, rest),) = plots.figure(1, 2, height=3.2)
        for (name, parameters), color in zip(SETS.items(), plots.COLORS, strict=False):
            def error(values: Mapping[str, Any], size: float, load: float, base: ParameterSet = parameters) -> Any:
                run = ParameterSubject(base.with_values(values)).run(step_to(radians(size), 6.0, load))
                return run.columns["time"], np.degrees(run.columns["fin_angle"]) - size

            loaded.plot(*error({}, 10.0, -LOAD), color=color, label=f"on the {name}")
            rest.plot(*error(LOOSE, 1.0, 0.0), color=color, linewidth=0.9)
        plots.limits(loaded, 0.2, sides=True)
        loaded.set(xlabel="time [s]", ylabel="angle - command [deg]", xlim=(0.0, 3.0), ylim=(-1.0, 0.5),
                   title="10° against 100 N·m")
        rest.set(xlabel="time [s]", ylabel="angle - command [deg]", xlim=(3.0, 6.0), ylim=(-0.12, 0.12),
                 title="At rest at 1°, no dry friction about the hinge")
        loaded.legend(loc="lower right")
        save(figure, "encoder_place")


TABLES = {"model/accuracy.md": {"budgets": budgets, "encoders": encoders}}

if __name__ == "__main__":
    check = "--check" in sys.argv[1:]
    if not check:
        _draw()
    sys.exit(main(check, TABLES, "make_budget.py"))
