"""The stored table: a changed sign, operator or constant anywhere in the equations changes one of its numbers.

Trajectories have the same bits on every platform, and the table has 12 digits. The tolerance of 1e-9 is far above this,
and far below the effect of a changed equation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from emcas_fmu.actuators import NAMES, NONLINEAR, get
from emcas_fmu.parameters import load_parameters
from tests.marks import others_slow

from . import runs, table
from .points import points
from .runs import fullest, models

STORED = table.stored()
RENEW = "python -m tests.trajectories writes the table again, after a change that is intended"
# These models take seconds to trace. The quick models include the default actuator with each extension, the elastic one
# with homing and with faults, and ristanovic with all its extensions.
LARGE = {fullest(name) for name in (NONLINEAR, "elastic", "worm-gear")}
MODELS = others_slow(models(), lambda model: model not in LARGE)


def same(values: Any) -> Any:
    return pytest.approx(values, rel=1e-9, abs=0.0)


def test_table_has_every_model() -> None:
    assert list(STORED["trajectories"]) == list(STORED["rules"]) == list(STORED["points"]) == models(), RENEW


@pytest.mark.parametrize("model", MODELS)
def test_declared_limits_and_starts_are_those_of_the_table(model: str) -> None:
    stored: Mapping[str, Any] = STORED["declared"]
    declared = table.declared(model)
    assert declared == {name: stored.get(f"{model} {name}", stored[name]) for name in declared}


@pytest.mark.parametrize("model", MODELS)
def test_results_of_functions_at_points_are_those_of_the_table(model: str) -> None:
    at_points, stored = points(model), STORED["points"][model]
    assert list(at_points) == list(stored), RENEW
    wrong = [name for name, marks in at_points.items() if marks != same(stored[name])]
    assert not wrong, f"{model}: {', '.join(wrong)} changed"


@pytest.mark.parametrize("model", MODELS)
def test_trajectories_are_those_of_the_table(model: str) -> None:
    trajectories = table.trajectories(model)
    stored = STORED["trajectories"][model]
    assert list(trajectories) == list(stored), RENEW
    names = [v.name for v in get(model).outputs]
    for run, marks in trajectories.items():
        assert len(marks) == len(stored[run]), RENEW
        wrong = [f"{names[k % len(names)]}: {mark} is no longer {before}"
                 for k, (mark, before) in enumerate(zip(marks, stored[run])) if mark != same(before)]
        assert not wrong, f"{model}, {run}: {'; '.join(wrong)}"


@pytest.mark.parametrize("model", MODELS)
def test_results_of_rules_are_those_of_the_table(model: str) -> None:
    assert table.rules(model) == same(STORED["rules"][model])


def test_runs_include_the_term_of_every_parameter() -> None:
    """A parameter whose shipped value is 0 removes its term from the equations, so it needs a value in `runs.OTHER`."""
    zero = {v.name for name in NAMES for v in get(name).parameters if v.kind == "Real"
            and load_parameters(model=name).values[v.name] == 0.0}
    assert zero <= runs.OTHER.keys()
