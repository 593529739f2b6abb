"""Recording a response, and comparing another with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import copysign, degrees, inf, isnan
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..actuators import NONLINEAR, get
from ..bench.subject import Identification, Subject
from ..errors import EmcasError
from .measure import FIGURES, figures
from .model import TRACES, Approved, Array, Baseline, rounded

Progress = Callable[[str, int, int], None]
TEMPLATE = Path(__file__).parent / "default.toml"
"""Limits and cases of a new baseline."""


@dataclass(frozen=True)
class Row:
    """One comparison: `approved` and `now` [unit], nan where never reached; `limit` None where nothing is judged.

    Of a trajectory they are the values `at` the time [s] where they differ most.
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
        """Now less approved [unit]; infinite where only one of them is a number."""
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
        """Whether the change is within its limit; a 1e-9 of it is rounding."""
        return self.share <= 1.0 + 1e-9


@dataclass(frozen=True)
class Changed:
    """A parameter, or another mark of what was recorded, that is not the approved one."""

    name: str
    approved: str
    now: str


@dataclass(frozen=True)
class Comparison:
    """`rows` in the order of the baseline's cases; `stopped` tells by case why its run ended early.

    `curves` are trajectories by case and output, approved and now, in display units at `times` [s].
    """

    baseline: Baseline
    identification: Identification
    fin: int | None
    rows: tuple[Row, ...]
    stopped: Mapping[str, str]
    parameters: tuple[Changed, ...]
    marks: tuple[Changed, ...]
    notes: tuple[str, ...]
    curves: Mapping[str, Mapping[str, tuple[Array, Array, Array]]] = field(repr=False)

    @property
    def drifted(self) -> tuple[Row, ...]:
        """What is out of its limit."""
        return tuple(row for row in self.rows if not row.passed)

    @property
    def judged(self) -> int:
        """How many comparisons have a limit."""
        return sum(row.limit is not None for row in self.rows)

    @property
    def passed(self) -> bool:
        """Whether every run was finished and nothing drifted."""
        return bool(self.judged) and not self.stopped and not self.drifted


def first(template: Baseline, subject: Subject) -> Baseline:
    """A template for a subject: no command beyond what it follows."""
    most = round(degrees(subject.values["command.limit"]), 9)

    def fitting(approved: Approved) -> Approved:
        entries = dict(approved.case.entries)
        if "command" in entries:
            entries["command"] = copysign(min(abs(entries["command"]), most), entries["command"])
        return replace(approved, case=replace(approved.case, entries=entries))

    return replace(template, cases=tuple(map(fitting, template.cases)))


def record(plan: Baseline, subject: Subject, folder: Path, command: str, progress: Progress | None = None) -> Baseline:
    """The subject's response to the plan's cases as a baseline; limits are the plan's.

    CSV inputs are looked for in `folder`. Raises EmcasError where a run does not reach its end.
    """
    done = []
    for approved, found, traces, stopped in _responses(plan, subject, folder, progress):
        if stopped:
            raise EmcasError(f"{subject.identification.file}: case {approved.case.name} {stopped}; a baseline needs "
                             "every case to run to its end")
        done.append(replace(approved, figures=found, traces=traces))
    return replace(plan, cases=tuple(done), recorded={**_marks(subject), "command": command},
                   parameters={v.name: subject.values[v.name] for v in get(NONLINEAR).file_entries})


def compare(baseline: Baseline, subject: Subject, folder: Path, progress: Progress | None = None) -> Comparison:
    """The subject's response against the approved one, which `folder` is of. Raises EmcasError."""
    rows: list[Row] = []
    stops, curves, notes = {}, {}, []
    for approved, found, traces, stopped in _responses(baseline, subject, folder, progress):
        name = approved.case.name
        if stopped:
            stops[name] = stopped
            continue
        limits = {**baseline.limits.figures, **approved.limits}
        for key, value in approved.figures.items():
            if key not in found:
                raise EmcasError(f"{folder}: case.{name}.figures.{key}: a case of kind {approved.case.kind} has no "
                                 "such figure; remove the line")
            limit = limits[key].of(value) if key in limits else None
            rows.append(Row(name, key, FIGURES[key].unit, value, found[key], limit))
        if more := [key for key in found if key not in approved.figures]:
            notes.append(f"case {name}: {', '.join(more)} not in the baseline, not compared; record it again")
        curves[name] = dict(_curves(approved, traces, baseline.limits.sample_time, folder))
        for key, (times, old, new) in curves[name].items():
            k = int(np.argmax(np.abs(new - old)))
            rows.append(Row(name, key, TRACES[key][0], float(old[k]), float(new[k]), baseline.limits.traces[key],
                            float(times[k])))
    was, now = baseline.recorded, _marks(subject)
    if "fin" in was and "fin" in now and was["fin"] != now["fin"]:
        notes.append(f"the baseline is of fin {was['fin']}, compared is fin {now['fin']}; see --fin")
    marks = tuple(Changed(key, was.get(key, "-"), now.get(key, "-")) for key in dict.fromkeys((*now, *was))
                  if key != "command" and was.get(key) != now.get(key))
    return Comparison(baseline, subject.identification, subject.identification.fin, tuple(rows), stops,
                      tuple(_parameters(baseline.parameters, subject.values)), marks, tuple(notes), curves)


def _responses(plan: Baseline, subject: Subject, folder: Path, progress: Progress | None
               ) -> Iterator[tuple[Approved, dict[str, float], dict[str, Array], str]]:
    """Each case with figures and trajectories as a file would hold them, or why its run ended early."""
    for done, approved in enumerate(plan.cases):
        if progress:
            progress(approved.case.name, done, len(plan.cases))
        excitation = approved.case.excitation(folder)
        run = subject.run(excitation)
        if run.stopped is not None:
            yield approved, {}, {}, (f"went no further than {run.stopped:.6g} s: "
                                     f"{run.messages[-1] if run.messages else 'it gave no reason'}")
            continue
        found = {name: rounded(value) for name, value in figures(approved.case, excitation, run.columns).items()}
        every = round(plan.limits.sample_time / excitation.step)
        traces = {} if approved.case.kind == "sweep" else {
            name: np.array([rounded(v) for v in (run.columns[name] * TRACES[name][1])[::every].tolist()])
            for name in plan.limits.traces}
        yield approved, found, traces, ""


def _curves(approved: Approved, traces: Mapping[str, Array], step: float, folder: Path
            ) -> Iterator[tuple[str, tuple[Array, Array, Array]]]:
    for key, new in traces.items():
        old = approved.traces[key]
        if len(old) != len(new):
            raise EmcasError(f"{folder / approved.case.name}.csv: has {len(old)} rows, the case now gives {len(new)}; "
                             "was the case edited? Record the baseline again")
        yield key, (np.round(np.arange(len(new)) * step, 9), old, new)


def _marks(subject: Subject) -> dict[str, str]:
    """What a baseline tells of where it comes from: nothing that depends on where or when it is recorded."""
    about = subject.identification
    marks = {"article": about.kind, "file": about.file, "sha256": about.sha256, "guid": about.guid,
             "fin": str(about.fin or ""), "parameters_sha256": about.parameters_sha256, "emcas": __version__}
    return {name: value for name, value in marks.items() if value}


def _parameters(approved: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[Changed]:
    for v in get(NONLINEAR).file_entries:
        old, new = approved.get(v.name), now[v.name]
        if old != new:
            unit = "" if v.unit in ("", "1") else f" {v.unit}"
            yield Changed(v.name, "-" if old is None else f"{_told(old)}{unit}", f"{_told(new)}{unit}")


def _told(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:.6g}"
