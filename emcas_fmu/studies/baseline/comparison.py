"""Record the response of a subject to the cases of a baseline, or compare it with the approved response."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from math import copysign, degrees, inf, isnan, radians
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...bench.requirements import load_requirements
from ...bench.subject import Identity, Subject, left_out
from ...errors import EmcasError
from ...support.progress import Progress, silent
from .files import parsed, read_plan
from .model import ALL, Baseline, BaselineMotion, file_unit, output_units, rounded, start_entries

TEMPLATE = Path(__file__).parent / "default.toml"
"""File with the limits and cases of a new baseline."""


def first(subject: Subject) -> tuple[Baseline, list[str]]:
    """Return a first plan for a subject, and omissions with reasons.

    The plan is the template with commands within the subject's range, and with the rated load of its requirements.
    """
    template = read_plan(TEMPLATE)
    written = deepcopy(dict(template.written))
    most = round(degrees(subject.command_limit), 9)
    rated = load_requirements(None, subject.parameters).rated_load
    omitted = []
    for why, names in left_out(ALL, subject.outputs).items():
        omitted.append(f"{', '.join(names)}: {why}")
        for name in names:
            written["limits"]["figures"].pop(name, None)
    for name, case in template.case.items():
        excitation = case.excitation(Path(), subject)
        idle = [key for key in excitation.columns if key in subject.actuator.without_effect
                and np.ptp(excitation.columns[key])]
        why = subject.obstacle(excitation) or "".join(f"{key} has no effect on this actuator's motion" for key in idle)
        if why:
            omitted.append(f"case {name}: {why}")
            del written["case"][name]
            continue
        if isinstance(case, BaselineMotion) and abs(case.amplitude) > radians(most) * (1.0 + 1e-9):
            written["case"][name]["amplitude"] = f"{copysign(most, case.amplitude):.12g} deg"
        if torque := getattr(case, "torque", 0.0):
            written["case"][name]["torque"] = f"{copysign(rated, torque):g} N.m"
    return parsed(written, TEMPLATE, subject.model), omitted


def record(plan: Baseline, subject: Subject, folder: Path, command: str, progress: Progress = silent) -> Baseline:
    """Return the subject's response to the plan's cases as a baseline; `command` is the command line that records it.

    CSV inputs are in `folder`. Raises EmcasError, also if a run does not reach its end.
    """
    response, _, stopped = respond(plan, subject, folder, progress)
    for name, why in stopped.items():
        raise EmcasError(f"{subject.identification.file}: case {name} {why}; a baseline needs every case to run to its "
                         "end")
    return response.model_copy(update={"recorded": {**response.recorded, "command": command}})


def respond(plan: Baseline, subject: Subject, folder: Path, progress: Progress
            ) -> tuple[Baseline, Mapping[str, str], Mapping[str, str]]:
    """Return the subject's response to the plan's cases as a baseline, and by case the titles and why runs ended early.

    Numbers are rounded as in a file. A case that ended early is not in the baseline; its reason is returned. CSV inputs
    are in `folder`. The response does not depend on machine and date. Raises EmcasError.
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
            cases[name] = case.model_copy(update={"figures": case.measure(run, subject)})
        every = round(plan.limits.sample_time / excitation.step)
        traces[name] = {} if case.sweeps else {
            key: np.array([rounded(value) for value in (run.columns[key][::every] * units[key][1]).tolist()])
            for key in plan.limits.traces}
    marks = {"article": about.kind, "file": about.file, "sha256": about.sha256, "guid": about.guid,
             "fin": str(about.fin or ""), "parameters_sha256": about.parameters_sha256, "emcas": __version__}
    return plan.model_copy(update={
        "case": cases, "traces": traces, "recorded": {name: mark for name, mark in marks.items() if mark},
        "parameters": {name: subject.values[name] for name in start_entries(plan.model)}}), titles, stopped


@dataclass(frozen=True)
class Row:
    """One comparison: the `approved` value and the value `now` [unit]; nan if a level is never reached.

    `limit` is the largest permitted change; None if the change is not judged. A trajectory has the values `at` the time
    [s] of the largest difference; a figure has `at` None.
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
        """Present minus approved value [unit]; infinite if only one of them is a number."""
        if isnan(self.approved) or isnan(self.now):
            return 0.0 if isnan(self.approved) and isnan(self.now) else inf
        return self.now - self.approved

    @property
    def share(self) -> float:
        """The size of the change as a share of the limit; 0 if the change is not judged."""
        change = abs(self.change)
        if self.limit is None or not change:
            return 0.0
        return change / self.limit if self.limit else inf

    @property
    def passed(self) -> bool:
        """Whether the change is within its limit, with a margin of 1e-9 of the limit for rounding errors."""
        return self.share <= 1.0 + 1e-9


@dataclass(frozen=True)
class Comparison:
    """The response of a subject `now`, compared with a baseline in `rows`, in the order of the baseline's cases.

    By case, `titles` has the titles and `stopped` the reasons why runs ended early. `parameters` and `marks`
    (identification) have the entries that differ between the recorded and the present subject, each with `name`, the
    `approved` value and the value `now`.
    """

    baseline: Baseline
    now: Baseline
    about: Identity
    titles: Mapping[str, str]
    stopped: Mapping[str, str]
    rows: tuple[Row, ...]
    parameters: tuple[Mapping[str, str], ...]
    marks: tuple[Mapping[str, str], ...]
    notes: tuple[str, ...]

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
        """Whether at least one comparison was judged, every run reached its end and nothing drifted."""
        return bool(self.judged) and not self.stopped and not self.drifted

    @property
    def verdict(self) -> str:
        """The verdict in a sentence."""
        if not self.judged and not self.stopped:
            return "nothing was judged: the baseline has no limits"
        if self.passed:
            return f"no drift: {self.judged} comparisons are within their limits"
        parts = [f"{len(self.drifted)} of {self.judged} comparisons drifted"] if self.drifted else []
        parts += [f"{len(self.stopped)} of {len(self.baseline.case)} cases did not run to the end"] * bool(self.stopped)
        return " and ".join(parts)


def compare(baseline: Baseline, subject: Subject, folder: Path, progress: Progress = silent) -> Comparison:
    """Compare the subject's response with the approved one; `folder` is the baseline's. Raises EmcasError."""
    present, titles, stopped = respond(baseline, subject, folder, progress)
    units, rows, notes = output_units(baseline.model), [], []
    for name, case in present.case.items():
        limits, approved = {**baseline.limits.figures, **case.limits}, baseline.case[name].figures
        for key, value in approved.items():
            if key not in case.figures:
                why = subject.lacking(ALL[key].needs) or f"a {case.kind} has no such figure"
                raise EmcasError(f"{folder}: case.{name}.figures.{key}: {why}; remove the line")
            rows.append(Row(name, key, file_unit(key), value, case.figures[key],
                            limits[key].of(value) if key in limits else None))
        if more := [key for key in case.figures if key not in approved]:
            notes.append(f"case {name}: the baseline has no {', '.join(more)}; record it again to compare them")
        for key, new in present.traces[name].items():
            old = baseline.traces[name][key]
            if len(old) != len(new):
                raise EmcasError(f"{folder / name}.csv: has {len(old)} rows, the case now has {len(new)}; was the case "
                                 "edited? Record the baseline again")
            k = int(np.argmax(np.abs(new - old)))
            rows.append(Row(name, key, units[key][0], float(old[k]), float(new[k]), baseline.limits.traces[key],
                            round(k * baseline.limits.sample_time, 9)))
    was, now = baseline.recorded, present.recorded
    if "fin" in was and "fin" in now and was["fin"] != now["fin"]:
        notes.append(f"the baseline was recorded with fin {was['fin']}, but fin {now['fin']} was compared; choose the "
                     "fin with --fin")
    marks = ({"name": key, "approved": was.get(key, "-"), "now": now.get(key, "-")}
             for key in dict.fromkeys((*now, *was)) if key != "command" and was.get(key) != now.get(key))
    parameters = ({"name": v.name, "approved": _quantity(baseline.parameters.get(v.name), v.unit),
                   "now": _quantity(present.parameters[v.name], v.unit)}
                  for v in start_entries(baseline.model).values()
                  if baseline.parameters.get(v.name) != present.parameters[v.name])
    return Comparison(baseline, present, subject.identification, titles, stopped, tuple(rows), tuple(parameters),
                      tuple(marks), tuple(notes))


def _quantity(value: Any, unit: str) -> str:
    if value is None:
        return "-"
    number = str(value).lower() if isinstance(value, bool) else f"{value:.6g}"
    return number if unit in ("", "1") else f"{number} {unit}"
