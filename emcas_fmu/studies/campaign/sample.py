"""Compute the rows of samples: figures and observations, or the error.

Samples are simulated together, but no row depends on the other samples. Rows are stored as columns, each an array or
list with an entry for every sample.
"""

from __future__ import annotations

import atexit
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators import extension_outputs
from ...bench.fmu_subject import open_subject
from ...bench.measure import recorded
from ...bench.metrics import Figure
from ...bench.subject import Subject
from ...bench.verdict import evaluate, worst_of
from ...errors import EmcasError
from ...fmi.interface import FmuInterface
from ...motions import LEAD_IN
from ...parameters import load_parameters
from ...response import Response
from ...simulation import Array
from . import experiments
from .distributions import CampaignError
from .experiments import REQUIREMENT, Experiment, excitation
from .extension_outputs import observed, reduced, reductions
from .study import Campaign, source_sha256

OK, FAILED = "ok", "failed"
SampleColumns = dict[str, Any]
"""Columns by name, in the order of a row's entries."""
TOGETHER = 30.0  # s, total simulated time of samples that are simulated together: their 4 MB fit in a processor's cache
FEWEST = 8  # smallest number of samples that are simulated together: fewer do not fill the vectors


def columns(study: Campaign) -> dict[str, Figure]:
    """Return the figures in a row by column name."""
    added = {name: r.figure for name, r in reductions(study.model).items() if r.figure}
    return {**{f"{experiment.name}.{name}": figure for experiment in study.experiments
               for name, figure in {**experiments.figures(experiment.kind, study.model), **added}.items()},
            **{f"{REQUIREMENT}.{r.name}": Figure(r.unit, r.title or r.how, bad=r.sign)
               for r in study.specification.requirements}}


def failed(study: Campaign, indices: Sequence[int], drawn: Array, errors: Sequence[str]) -> SampleColumns:
    """Return the rows of failed samples, with the error of each sample and without figures."""
    return _rows(study, indices, drawn, {}, dict(enumerate(errors)))


def listed(rows: SampleColumns) -> list[dict[str, Any]]:
    """Return rows as a list with a mapping from column name to entry for each sample."""
    columns = [column.tolist() if isinstance(column, np.ndarray) else column for column in rows.values()]
    return [dict(zip(rows, row, strict=True)) for row in zip(*columns, strict=True)]


def joined(parts: Sequence[SampleColumns]) -> SampleColumns:
    """Return the rows of all parts as one table."""
    def column(name: str) -> Any:
        columns = [part[name] for part in parts]
        return np.concatenate(columns) if isinstance(columns[0], np.ndarray) else [x for part in columns for x in part]
    return parts[0] if len(parts) == 1 else {name: column(name) for name in parts[0]}


def _rows(study: Campaign, indices: Sequence[int], drawn: Array, entries: Mapping[str, Any], errors: Mapping[int, str]
          ) -> SampleColumns:
    """Return rows from the `entries` of samples by column; `errors` of failed samples are by position in `indices`."""
    count, failures = len(indices), [*errors]
    rows: SampleColumns = {
        "index": np.asarray(indices), "seed": np.full(count, study.seed),
        **{name: np.broadcast_to(values, count) for name, values in study.factor_values(drawn.T).items()}}
    for name in columns(study):
        rows[name] = entries.get(name, np.full(count, np.nan))
        rows[name][failures] = np.nan
    for name in observed(study):
        values = [None] * count if name not in entries else entries[name].tolist()
        rows[name] = [None if k in errors else value for k, value in enumerate(values)]
    rows["status"] = [FAILED if k in errors else OK for k in range(count)]
    rows["error"] = [errors.get(k, "") for k in range(count)]
    return rows


def together(study: Campaign, indices: Sequence[int], drawn: Array, subject: Subject) -> SampleColumns:
    """Return the rows of samples: index, seed, factors, figures (nan if missing), observations, status and error."""
    try:
        return _rows(study, indices, drawn, *_entries(study, drawn, subject))
    # An error in one sample must not end a campaign. Halving the samples again and again finds this sample.
    except Exception as error:  # noqa: BLE001
        half = len(indices) // 2
        if half:
            return joined([together(study, indices[:half], drawn[:half], subject),
                           together(study, indices[half:], drawn[half:], subject)])
        return failed(study, indices, drawn, [_message(error)])


def _message(error: Exception) -> str:
    expected = isinstance(error, (ArithmeticError, ValueError, EmcasError))
    return str(error) if expected else f"{type(error).__name__}: {error}"


def _changes(study: Campaign, values: Mapping[str, Any], subject: Subject) -> dict[str, Any]:
    """Return the parameters that vary between samples or differ from the subject's values."""
    varied = {*(f.name for f in study.factors), *study.followers}
    return {name: value for name, value in values.items() if name in varied or value != subject.values[name]}


def _entries(study: Campaign, drawn: Array, subject: Subject) -> tuple[dict[str, Any], dict[int, str]]:
    """Return figures and observations of samples by column, and the errors of failed samples by row of `drawn`."""
    values, numbers = study.varied(drawn.T)
    changes = _changes(study, values, subject)
    excitations = [excitation(experiment, values, numbers, study.model) for experiment in study.experiments]
    entries: dict[str, Any] = {}
    errors: dict[int, str] = {}
    for experiment, applied in zip(study.experiments, excitations, strict=True):
        outputs = _outputs(experiment.kind, study.model)
        runs = subject.run_all(applied, changes, outputs, experiments.POWER_ROWS,
                               [name for name in outputs if name == experiments.POWER])
        errors = {**{k: _message(error) for k, error in runs.refused.items()},
                  **{k: "; ".join(messages[-3:]) or runs[k].reason for k, (_, messages) in runs.stopped.items()},
                  **errors}
        finished, run = runs.finished()
        if not len(finished):
            continue
        changes_of_run, numbers_of_run = ({name: value[finished] if np.ndim(value) else value
                                           for name, value in table.items()} for table in (changes, numbers))
        leaps = experiments.leaps(subject, changes_of_run, run)
        figures = experiments.measured(experiment, numbers_of_run, run, leaps)
        for name, column in {**figures, **reduced(study.model, run)}.items():
            entry = np.full(len(drawn), np.nan if column.dtype.kind == "f" else 0, column.dtype)
            entry[finished] = column
            entries[f"{experiment.name}.{name}"] = entry
    good = [k for k in range(len(drawn)) if k not in errors]
    differences = [{name: value[k].item() if np.ndim(value) else value for name, value in changes.items()}
                   for k in good]
    verdicts = evaluate(subject, study.specification, differences) if good else []
    for r in study.specification.requirements:
        column = entries[f"{REQUIREMENT}.{r.name}"] = np.full(len(drawn), np.nan)
        column[good] = [worst_of(f for f in verdict if f.requirement is r).measured for verdict in verdicts]
    return entries, errors


@cache
def _outputs(kind: str, model: str) -> tuple[str, ...]:
    """Return the outputs to record in an experiment of a `kind`."""
    needed = recorded(experiments.figures(kind, model))
    return tuple(dict.fromkeys((*needed, *(v.name for v in extension_outputs(model)))))


def subject_of(study: Campaign) -> Subject:
    """Return the subject of a campaign; each process opens it once.

    Raises CampaignError if the subject's FMU or Python file has changed since the campaign began.
    """
    return _opened(study.fmu, study.fmu_sha256, study.fin, study.model, study.model_sha256)


@lru_cache(maxsize=4)
def _opened(fmu: str, fmu_sha256: str, fin: int, model: str, model_sha256: str) -> Subject:
    _check_same(model.partition("+")[0], source_sha256(model), model_sha256)
    stack = ExitStack()
    subject = stack.enter_context(open_subject(Path(fmu) if fmu else None, model, fin if fmu else None))
    atexit.register(stack.close)
    _check_same(fmu, subject.identification.sha256, fmu_sha256)
    return subject


def _check_same(path: str, digest: str, initial: str) -> None:
    if digest != initial:
        raise CampaignError(f"{path}: is not the file with which the campaign began (SHA-256 {digest[:16]}, not "
                            f"{initial[:16]}); every worker must see the same file")


def rows(study: Campaign, indices: Sequence[int], drawn: Array) -> SampleColumns:
    """Return the rows of samples with the `drawn` values [indices, factors]: the work of a task.

    Raises CampaignError if no sample can be run, for example because a requirement cannot be measured, and EmcasError
    if the FMU cannot be opened.
    """
    subject = subject_of(study)
    size = max(FEWEST, int(TOGETHER / max(LEAD_IN + experiment.duration for experiment in study.experiments)))
    for r in study.specification.requirements:
        if why := r.obstacle(subject):
            raise CampaignError(f"requirement {r.name}: {why}")
    return joined([together(study, indices[k:k + size], drawn[k:k + size], subject)
                   for k in range(0, len(indices), size)])


def history(study: Campaign, experiment: Experiment, index: int) -> Response:
    """Run a sample again in an experiment, and return all outputs over time, since rows have figures only.

    The response of a sample that failed ends at the failure. Raises EmcasError if there is no response.
    """
    subject, (values, numbers) = subject_of(study), study.varied(study.draw([index])[0].tolist())
    applied = excitation(experiment, values, numbers, study.model)
    changes = subject.changed(applied, _changes(study, values, subject))
    run = subject.run(applied, changes)
    rows = len(run.columns["time"])
    if rows < 2:
        raise EmcasError(f"experiment {experiment.name}: there is no response; {'; '.join(run.messages) or run.reason}")
    finished = replace(run.excitation, title=f"{experiment.name}: {run.excitation.title}", columns={
        name: column[:rows] for name, column in run.excitation.columns.items()})
    parameters = load_parameters(model=study.model).with_values({**values, **changes})
    return Response(FmuInterface(1, study.model), (parameters,), finished, run.columns)
