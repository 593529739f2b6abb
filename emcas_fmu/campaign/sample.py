"""One sample: from the factors' values to a row of figures, whatever happens on the way."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from ..simulation import Array
from . import measure, own
from .experiments import excitation
from .plan import Plan, followed, varied
from .runners import Runner, runner

OK, FAILED = "ok", "failed"
Row = dict[str, Any]


def columns(plan: Plan) -> list[str]:
    """Names of a row's figures."""
    return [name for experiment in plan.experiments
            for name in (*measure.names(experiment), *own.names(experiment, plan.model))]


def observed(plan: Plan) -> dict[str, str]:
    """Names of what a row tells besides figures, with the kind of each: Integer, Boolean or String."""
    return {name: kind for experiment in plan.experiments
            for name, kind in own.observed(experiment, plan.model).items()}


def row(plan: Plan, index: int, drawn: Sequence[float], run: Runner) -> Row:
    """Index, seed, what varied, figures (nan where there is none), status and error of a sample."""
    chosen = {f.name: f.value(x) for f, x in zip(plan.factors, drawn, strict=True)}
    about: Row = {"index": index, "seed": plan.seed, **chosen, **followed(plan, chosen)}
    try:
        return {**about, **_figures(plan, chosen, run), "status": OK, "error": ""}
    # Nothing one sample does may end a campaign.
    except Exception as error:  # noqa: BLE001
        expected = isinstance(error, (ArithmeticError, ValueError))
        return failed(plan, about, str(error) if expected else f"{type(error).__name__}: {error}")


def failed(plan: Plan, about: Row, error: str) -> Row:
    """The row of a sample without figures."""
    return {**about, **dict.fromkeys(columns(plan), float("nan")), **dict.fromkeys(observed(plan)),
            "status": FAILED, "error": error}


def _figures(plan: Plan, chosen: dict[str, Any], run: Runner) -> Row:
    values, numbers = varied(plan, chosen)
    found: Row = {}
    for experiment in plan.experiments:
        made = excitation(experiment, values, numbers, plan.model)
        response = run(values, made)
        found |= measure.figures(experiment, numbers, made, response)
        found |= own.reduced(experiment, plan.model, made, response)
    return {name: found[name] for name in (*columns(plan), *observed(plan))}


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Plan:
    plan: Plan = pickle.loads(packed)
    return plan


def rows(packed: bytes, indices: Sequence[int], drawn: Array) -> list[Row]:
    """Rows of samples; `drawn` (indices, factors). The work of a task.

    Raises CampaignError where no sample can be run here at all, as without the FMU.
    """
    plan = _unpacked(packed)
    run = runner(plan)
    return [row(plan, index, values.tolist(), run) for index, values in zip(indices, drawn, strict=True)]
