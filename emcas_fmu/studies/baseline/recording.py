"""The response of a subject to the cases of a baseline."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from math import copysign, degrees
from pathlib import Path

import numpy as np

from ... import __version__
from ...bench.metrics import FIGURES, shown
from ...bench.subject import Identification, Subject, left_out
from ...errors import EmcasError
from ...support.progress import Progress, silent
from .files import parsed, read
from .model import ALL, Baseline, output_units, rounded, start_entries

TEMPLATE = Path(__file__).parent / "default.toml"
"""Limits and cases of a new baseline."""


@dataclass(frozen=True)
class Response:
    """The response to the cases of a plan, as a `baseline` with the plan's limits, and its cases' `titles`.

    `stopped` has by case the reason why a run ended early; such a case is not in the baseline.
    """

    baseline: Baseline
    identification: Identification
    titles: Mapping[str, str]
    stopped: Mapping[str, str]


def first(subject: Subject) -> tuple[Baseline, list[str]]:
    """Return the template for a subject, with commands within its range, and the parts left out with their reasons."""
    template = read(TEMPLATE)
    written = deepcopy(dict(template.written))
    most = round(degrees(subject.command_limit), 9)
    without = []
    for why, names in left_out({name: FIGURES[name] for name in ALL}, subject.outputs).items():
        without.append(f"{', '.join(names)}: {why}")
        for name in names:
            written["limits"]["figures"].pop(name, None)
    for name, case in template.case.items():
        if why := subject.obstacle(case.excitation(Path(), subject)):
            without.append(f"case {name}: {why}")
            del written["case"][name]
        elif abs(command := getattr(case, "command", 0.0)) > most:
            written["case"][name]["command"] = f"{copysign(most, command):.12g} deg"
    return parsed(written, TEMPLATE, subject.model), without


def record(plan: Baseline, subject: Subject, folder: Path, command: str, progress: Progress = silent) -> Baseline:
    """Return the subject's response to the plan's cases as a baseline, recorded by a `command`.

    CSV inputs are in `folder`. Raises EmcasError where a run does not reach its end.
    """
    response = respond(plan, subject, folder, progress)
    for name, why in response.stopped.items():
        raise EmcasError(f"{subject.identification.file}: case {name} {why}; a baseline needs every case to run to its "
                         "end")
    return response.baseline.model_copy(update={"recorded": {**response.baseline.recorded, "command": command}})


def respond(plan: Baseline, subject: Subject, folder: Path, progress: Progress) -> Response:
    """Return the subject's response to the plan's cases, with numbers as in a file; CSV inputs are in `folder`.

    Where and when it is recorded makes no difference. Raises EmcasError.
    """
    titles, stopped, cases, traces = {}, {}, {}, {}
    units, about = output_units(plan.model), subject.identification
    for done, (name, case) in enumerate(plan.case.items()):
        progress(name, done, len(plan.case))
        excitation = case.excitation(folder, subject)
        run = subject.run(excitation)
        titles[name] = excitation.title
        if run.stopped is not None:
            stopped[name] = run.reason
            continue
        with np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain
            figures = case.measure(run, subject)
        cases[name] = case.model_copy(update={"figures": {
            key: rounded(value * shown(FIGURES[key].unit)[1]) for key, value in figures.items()}})
        every = round(plan.limits.sample_time / excitation.step)
        traces[name] = {} if case.sweeps else {
            key: np.array([rounded(value) for value in (run.columns[key][::every] * units[key][1]).tolist()])
            for key in plan.limits.traces}
    marks = {"article": about.kind, "file": about.file, "sha256": about.sha256, "guid": about.guid,
             "fin": str(about.fin or ""), "parameters_sha256": about.parameters_sha256, "emcas": __version__}
    return Response(plan.model_copy(update={
        "case": cases, "traces": traces, "recorded": {name: mark for name, mark in marks.items() if mark},
        "parameters": {name: subject.values[name] for name in start_entries(plan.model)}}), about, titles, stopped)
