"""One sample: from the factors' values to a row of figures, whatever happens on the way."""

from __future__ import annotations

import atexit
import pickle
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ...actuators import extension_outputs
from ...bench.metrics import Figure
from ...bench.subject import Subject, open_subject
from ...errors import EmcasError
from ...simulation import Array
from ...variables import Variable
from . import measure
from .distributions import CampaignError
from .experiments import excitation
from .extension_outputs import reduced, reductions
from .plan import Plan, source_sha256

OK, FAILED = "ok", "failed"
Row = dict[str, Any]


def columns(plan: Plan) -> dict[str, Figure]:
    """Return a row's figures by column name."""
    added = {name: r.figure for name, r in reductions(plan.model).items() if r.figure}
    return {f"{experiment.name}.{name}": figure for experiment in plan.experiments
            for name, figure in {**measure.figures(experiment.kind, plan.model), **added}.items()}


def observed(plan: Plan) -> dict[str, Variable]:
    """Return the outputs of which a row has more than figures, by column name."""
    return {f"{experiment.name}.{name}": r.output for experiment in plan.experiments
            for name, r in reductions(plan.model).items() if r.figure is None}


def row(plan: Plan, index: int, drawn: Sequence[float], subject: Subject) -> Row:
    """Return index, seed, what varied, figures (nan where there is none), status and error of a sample."""
    try:
        return {**_identity(plan, index, drawn), **_figures(plan, drawn, subject), "status": OK, "error": ""}
    # Nothing one sample does may end a campaign.
    except Exception as error:  # noqa: BLE001
        expected = isinstance(error, (ArithmeticError, ValueError, EmcasError))
        return failed(plan, index, drawn, str(error) if expected else f"{type(error).__name__}: {error}")


def failed(plan: Plan, index: int, drawn: Sequence[float], error: str) -> Row:
    """Return the row of a sample without figures."""
    return {**_identity(plan, index, drawn), **dict.fromkeys(columns(plan), float("nan")),
            **dict.fromkeys(observed(plan)), "status": FAILED, "error": error}


def _identity(plan: Plan, index: int, drawn: Sequence[float]) -> Row:
    return {"index": index, "seed": plan.seed, **plan.chosen(drawn)}


def _figures(plan: Plan, drawn: Sequence[float], subject: Subject) -> Row:
    values, numbers = plan.varied(drawn)
    changes = {name: value for name, value in values.items() if value != subject.values[name]}
    entries: Row = {}
    for experiment in plan.experiments:
        outputs = _outputs(experiment.kind, plan.model)
        run = subject.run(excitation(experiment, values, numbers, plan.model), changes, outputs, measure.POWER_ROWS,
                          [name for name in outputs if name == measure.POWER])
        if run.stopped is not None:
            raise ArithmeticError("; ".join(run.messages[-3:]) or run.reason)
        figures = measure.measured(experiment, numbers, run, measure.leaps(subject, changes, run))
        entries |= measure.named(experiment, plan.model, figures)
        entries |= reduced(experiment, plan.model, run)
    return {name: entries[name] for name in (*columns(plan), *observed(plan))}


@cache
def _outputs(kind: str, model: str) -> tuple[str, ...]:
    """Return the outputs that are recorded for a kind of experiment."""
    needed = (name for figure in measure.figures(kind, model).values() for name in figure.needs)
    return tuple(dict.fromkeys((*needed, *(v.name for v in extension_outputs(model)))))


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Plan:
    plan: Plan = pickle.loads(packed)
    return plan


def subject_of(plan: Plan) -> Subject:
    """Return what runs the samples of a campaign in this process, opened once.

    Raises CampaignError where a file is not the one the campaign began with.
    """
    return _opened(plan.fmu, plan.fmu_sha256, plan.fin, plan.model, plan.model_sha256)


@lru_cache(maxsize=4)
def _opened(fmu: str, fmu_sha256: str, fin: int, model: str, model_sha256: str) -> Subject:
    _check_same(model.partition("+")[0], source_sha256(model), model_sha256)
    stack = ExitStack()
    subject = stack.enter_context(open_subject(Path(fmu) if fmu else None, model, fin if fmu else None))
    atexit.register(stack.close)
    _check_same(fmu, subject.identification.sha256, fmu_sha256)
    return subject


def _check_same(path: str, digest: str, begun: str) -> None:
    if digest != begun:
        raise CampaignError(f"{path}: is not the file the campaign began with (SHA-256 {digest[:16]}, not "
                            f"{begun[:16]}); every worker must see the same file")


def rows(packed: bytes, indices: Sequence[int], drawn: Array) -> list[Row]:
    """Return the rows of samples, which is the work of a task; `drawn` (indices, factors).

    Raises CampaignError where no sample can be run here at all, as without the FMU.
    """
    plan = _unpacked(packed)
    subject = subject_of(plan)
    return [row(plan, index, values.tolist(), subject) for index, values in zip(indices, drawn, strict=True)]
