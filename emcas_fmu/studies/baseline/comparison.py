"""A recorded response, and another one compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import copysign, degrees, inf, isnan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ... import __version__
from ...bench.metrics import FIGURES, shown
from ...bench.runs import Run
from ...bench.subject import Identification, Subject, left_out
from ...errors import EmcasError
from ...support.progress import Progress
from .model import ALL, Array, Baseline, Case, rounded, start_entries, unit_of

TEMPLATE = Path(__file__).parent / "default.toml"
"""Limits and cases of a new baseline."""


@dataclass(frozen=True)
class Row:
    """One comparison: the `approved` value and the value `now` [unit], nan where a level is never reached.

    `limit` is the largest change, None where nothing is judged. Of a trajectory, the values are those `at` the time [s]
    of their largest difference.
    """

    case: str
    name: str
    unit: str
    approved: float
    now: float
    limit: float | None
    at: float | None = None

    @property
    def change(self) -> float:
        """Now minus approved [unit]; infinite where only one of them is a number."""
        if isnan(self.approved) or isnan(self.now):
            return 0.0 if isnan(self.approved) and isnan(self.now) else inf
        return self.now - self.approved

    @property
    def share(self) -> float:
        """The change as a share of the limit; 0 where nothing is judged."""
        change = abs(self.change)
        if self.limit is None or not change:
            return 0.0
        return change / self.limit if self.limit else inf

    @property
    def passed(self) -> bool:
        """Whether the change is within its limit, with 1e-9 of it for rounding."""
        return self.share <= 1.0 + 1e-9


class Changed(NamedTuple):
    """A parameter, or another mark of the recorded subject, that differs from the approved one."""

    name: str
    approved: str
    now: str


@dataclass(frozen=True)
class Comparison:
    """A comparison: `rows` in the order of the baseline's cases, the `titles` of these, and by case the reason why a
    run `stopped` early.

    `curves` has by case and output times [s] and trajectories, approved and now, in display units.
    """

    baseline: Baseline
    identification: Identification
    titles: Mapping[str, str]
    rows: tuple[Row, ...]
    stopped: Mapping[str, str]
    parameters: tuple[Changed, ...]
    marks: tuple[Changed, ...]
    notes: tuple[str, ...]
    curves: Mapping[str, Mapping[str, tuple[Array, Array, Array]]] = field(repr=False)

    @property
    def drifted(self) -> tuple[Row, ...]:
        """The rows whose change exceeds its limit."""
        return tuple(row for row in self.rows if not row.passed)

    @property
    def judged(self) -> int:
        """The number of comparisons with a limit."""
        return sum(row.limit is not None for row in self.rows)

    @property
    def passed(self) -> bool:
        """Whether every run was finished and nothing drifted."""
        return bool(self.judged) and not self.stopped and not self.drifted


def first(template: Baseline, subject: Subject) -> tuple[Baseline, list[str]]:
    """Return a template for a subject, with commands within its range, and the parts left out with their reasons."""
    most = round(degrees(subject.command_limit), 9)
    missing = left_out({name: FIGURES[name] for name in ALL}, subject.outputs)
    without = [f"{', '.join(names)}: {why}" for why, names in missing.items()]
    figures = {name: limit for name, limit in template.limits.figures.items()
               if not subject.lacking(FIGURES[name].needs)}
    cases: dict[str, Case] = {}
    for name, case in template.cases.items():
        if why := subject.obstacle(case.excitation(Path(), subject)):
            without.append(f"case {name}: {why}")
            continue
        command = getattr(case, "command", None)
        cases[name] = case if command is None else case.model_copy(
            update={"command": copysign(min(abs(command), most), command)})
    limits = template.limits.model_copy(update={"figures": figures})
    return replace(template, model=subject.model, limits=limits, cases=cases), without


def record(plan: Baseline, subject: Subject, folder: Path, command: str, progress: Progress | None = None) -> Baseline:
    """Return the subject's response to the plan's cases as a baseline with the plan's limits.

    CSV inputs are in `folder`. Raises EmcasError where a run does not reach its end.
    """
    cases, traces = {}, {}
    for name, run, figures, curves in _responses(plan, subject, folder, progress):
        if run.stopped is not None:
            raise EmcasError(f"{subject.identification.file}: case {name} {run.reason}; a baseline needs every case to "
                             "run to its end")
        cases[name] = plan.cases[name].model_copy(update={"figures": figures})
        traces[name] = curves
    return replace(plan, cases=cases, traces={name: each for name, each in traces.items() if each},
                   recorded={**_marks(subject), "command": command},
                   parameters={name: subject.values[name] for name in start_entries(plan.model)})


def compare(baseline: Baseline, subject: Subject, folder: Path, progress: Progress | None = None) -> Comparison:
    """Compare the subject's response with the approved one, which is in `folder`. Raises EmcasError."""
    rows: list[Row] = []
    titles, stopped, curves, notes = {}, {}, {}, []
    for name, run, figures, traces in _responses(baseline, subject, folder, progress):
        titles[name] = run.excitation.title
        if run.stopped is not None:
            stopped[name] = run.reason
            continue
        case = baseline.cases[name]
        limits = {**baseline.limits.figures, **case.limits}
        for key, value in case.figures.items():
            if key not in figures:
                raise EmcasError(f"{folder}: case.{name}.figures.{key}: {subject.lacking(FIGURES[key].needs)}; remove "
                                 "the line")
            limit = limits[key].of(value) if key in limits else None
            rows.append(Row(name, key, unit_of(key), value, figures[key], limit))
        if more := [key for key in figures if key not in case.figures]:
            notes.append(f"case {name}: {', '.join(more)} not in the baseline, not compared; record it again")
        curves[name] = dict(_curves(name, baseline, traces, folder))
        for key, (times, old, new) in curves[name].items():
            k = int(np.argmax(np.abs(new - old)))
            rows.append(Row(name, key, shown(subject.outputs[key].unit)[0], float(old[k]), float(new[k]),
                            baseline.limits.traces[key], float(times[k])))
    was, now = baseline.recorded, _marks(subject)
    if "fin" in was and "fin" in now and was["fin"] != now["fin"]:
        notes.append(f"the baseline is of fin {was['fin']}, compared is fin {now['fin']}; see --fin")
    marks = tuple(Changed(key, was.get(key, "-"), now.get(key, "-")) for key in dict.fromkeys((*now, *was))
                  if key != "command" and was.get(key) != now.get(key))
    return Comparison(baseline, subject.identification, titles, tuple(rows), stopped,
                      tuple(_parameters(baseline, subject.values)), marks, tuple(notes), curves)


def _responses(plan: Baseline, subject: Subject, folder: Path, progress: Progress | None
               ) -> Iterator[tuple[str, Run, dict[str, float], dict[str, Array]]]:
    """Yield each case with its run, figures and trajectories as in a file; without these where the run ended early."""
    for done, (name, case) in enumerate(plan.cases.items()):
        if progress:
            progress(name, done, len(plan.cases))
        excitation = case.excitation(folder, subject)
        run = subject.run(excitation)
        if run.stopped is not None:
            yield name, run, {}, {}
            continue
        with np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain
            measured = case.measure(run, subject)
        figures = {key: rounded(measured[key] * shown(FIGURES[key].unit)[1]) for key in ALL
                   if key in case.measured and key in measured}
        every = round(plan.limits.sample_time / excitation.step)
        traces = {} if case.kind == "sweep" else {
            key: np.array([rounded(v) for v in (run.columns[key] * shown(subject.outputs[key].unit)[1])[::every]
                           .tolist()]) for key in plan.limits.traces}
        yield name, run, figures, traces


def _curves(case: str, baseline: Baseline, traces: Mapping[str, Array], folder: Path
            ) -> Iterator[tuple[str, tuple[Array, Array, Array]]]:
    for key, new in traces.items():
        old = baseline.traces[case][key]
        if len(old) != len(new):
            raise EmcasError(f"{folder / case}.csv: has {len(old)} rows, the case now gives {len(new)}; was the case "
                             "edited? Record the baseline again")
        yield key, (np.round(np.arange(len(new)) * baseline.limits.sample_time, 9), old, new)


def _marks(subject: Subject) -> dict[str, str]:
    """Return the provenance of a baseline, independent of where and when it is recorded."""
    about = subject.identification
    marks = {"article": about.kind, "file": about.file, "sha256": about.sha256, "guid": about.guid,
             "fin": str(about.fin or ""), "parameters_sha256": about.parameters_sha256, "emcas": __version__}
    return {name: value for name, value in marks.items() if value}


def _parameters(baseline: Baseline, now: Mapping[str, Any]) -> Iterator[Changed]:
    for v in start_entries(baseline.model).values():
        old, new = baseline.parameters.get(v.name), now[v.name]
        if old != new:
            unit = "" if v.unit in ("", "1") else f" {v.unit}"
            yield Changed(v.name, "-" if old is None else f"{_in_words(old)}{unit}", f"{_in_words(new)}{unit}")


def _in_words(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:.6g}"
