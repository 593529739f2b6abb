"""What the table keeps: a changed sign, operator or constant anywhere in the equations moves a number of it.

The trajectories are the same on every platform to the bit; a billionth is far above the digits that the table keeps and
far below what any change of an equation does.
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

KEPT = table.kept()
# The default actuator has each extension alone, the elastic one homing and faults, ristanovic all it can have; these
# take seconds to trace.
DEAR = {fullest(name) for name in (NONLINEAR, "elastic", "worm-gear")}
MODELS = others_slow(models(), lambda model: model not in DEAR)


def same(values: Any) -> Any:
    return pytest.approx(values, rel=1e-9, abs=0.0)


def test_every_model_is_in_it() -> None:
    assert list(KEPT["trajectories"]) == list(KEPT["rules"]) == list(KEPT["points"]) == models()


@pytest.mark.parametrize("model", MODELS)
def test_limits_and_starts_are_those_declared(model: str) -> None:
    kept: Mapping[str, Any] = KEPT["declared"]
    assert table.declared(model) == {name: kept.get(f"{model} {name}", kept[name]) for name in table.declared(model)}


@pytest.mark.parametrize("model", MODELS)
def test_functions_at_points(model: str) -> None:
    at_points, kept = points(model), KEPT["points"][model]
    assert list(at_points) == list(kept)
    wrong = [name for name, marks in at_points.items() if marks != same(kept[name])]
    assert not wrong, f"{model}: {', '.join(wrong)} moved"


@pytest.mark.parametrize("model", MODELS)
def test_trajectories(model: str) -> None:
    moved = table.trajectories(model)
    kept = KEPT["trajectories"][model]
    assert list(moved) == list(kept)
    names = [v.name for v in get(model).outputs]
    for run, marks in moved.items():
        assert len(marks) == len(kept[run])
        wrong = [f"{names[k % len(names)]}: {mark} is no longer {before}"
                 for k, (mark, before) in enumerate(zip(marks, kept[run])) if mark != same(before)]
        assert not wrong, f"{model}, {run}: {'; '.join(wrong)}"


@pytest.mark.parametrize("model", MODELS)
def test_rules_judge_alike(model: str) -> None:
    assert table.rules(model) == same(KEPT["rules"][model])


def test_no_term_is_left_out() -> None:
    """A parameter that is 0 as shipped leaves its term out of the equations: `runs.OTHER` brings it in."""
    zero = {v.name for name in NAMES for v in get(name).parameters if v.kind == "Real"
            and load_parameters(model=name).values[v.name] == 0.0}
    assert zero <= runs.OTHER.keys()
