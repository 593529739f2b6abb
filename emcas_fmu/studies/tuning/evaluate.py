"""Judge gains by each figure in each case, as a share of its limit; keep a journal of evaluations."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite, nextafter
from pathlib import Path

from ...bench import verdict
from ...bench.requirements import Requirement
from ...bench.subject import ParameterSubject
from ...pages.numbers import percent
from ...support.writing import append, write
from .study import Study, StudyError

HOPELESS = 10.0  # largest share of a limit; also the share of a figure that does not exist (never reached, unstable)
# The objective is the norm of this order of the worst shares of all requirements. It is close to the largest share, but
# a figure that gains cannot improve, such as a rate that the motor limits, does not hide the other figures.
_NORM = 8


@dataclass(frozen=True)
class Judgement:
    """A judgement of a requirement in a case: the `measured` figure [SI] and its `share` of the limit (1: just met)."""

    requirement: str
    case: str
    measured: float
    share: float

    @property
    def margin(self) -> float:
        """One minus the share; negative if the limit is missed."""
        return 1.0 - self.share

    @property
    def met(self) -> bool:
        """Whether the figure is within its limit."""
        return self.share <= 1.0


@dataclass(frozen=True)
class Evaluation:
    """Gains (SI) by parameter, and their judgements."""

    gains: Mapping[str, float]
    judgements: tuple[Judgement, ...]

    @property
    def worst(self) -> Judgement:
        """The judgement with the largest share."""
        return max(self.judgements, key=lambda j: j.share)

    @cached_property
    def objective(self) -> float:
        """The objective that the search minimises: the 8-norm of the worst shares of the requirements."""
        return float(sum(j.share**_NORM for j in self.by_requirement().values()) ** (1.0 / _NORM))

    def by_requirement(self) -> dict[str, Judgement]:
        """Return the worst judgement of each requirement over all cases, by the requirement's name."""
        worst: dict[str, Judgement] = {}
        for j in self.judgements:
            if j.requirement not in worst or j.share > worst[j.requirement].share:
                worst[j.requirement] = j
        return worst


def margin_text(margin: float) -> str:
    """Return a margin [1] as text, marked as a bound if the share of the limit is HOPELESS."""
    return percent(margin) + " or less" * (margin <= 1.0 - HOPELESS)


def share(requirement: Requirement, measured: float) -> float:
    """Return measured/maximum or minimum/measured of a figure [SI], at most HOPELESS; above 1 for a missed limit.

    HOPELESS also for a figure that is not finite, or that misses a minimum and is not positive.
    """
    if not isfinite(measured):
        return HOPELESS
    ratio = (measured / requirement.limit if requirement.sense == "maximum"
             else requirement.limit / measured if measured > 0.0 else HOPELESS)
    return min(ratio, 1.0) if requirement.kept(measured) else min(max(ratio, nextafter(1.0, inf)), HOPELESS)


def evaluate(study: Study, gains: Sequence[Mapping[str, float]]) -> list[Evaluation]:
    """Judge several sets of gains [SI], independently of each other, by every measurable requirement in its cases.

    The share is HOPELESS for a response that cannot be computed, and for gains that break a rule of the actuator.
    """
    results = verdict.evaluate(ParameterSubject(study.base), study.specification, gains)
    return [Evaluation(dict(each), tuple(
        Judgement(f.requirement.name, f.case.name, f.measured, share(f.requirement, f.measured)) for f in figures))
        for each, figures in zip(gains, results, strict=True)]


class Journal:
    """The evaluations of a study, by gains. With a `path` they are also lines of a file: a stopped search continues.

    Raises StudyError if the file is not a journal, or is the journal of another study.
    """

    def __init__(self, path: Path | None, study: Study) -> None:
        self._path = path
        self._evaluations: dict[tuple[float, ...], Evaluation] = {}
        if path is None:
            return
        header = {"study": study.digest}
        first_line = json.dumps(header) + "\n"
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        # A last line without a line end was cut off when the process was killed: its evaluation is repeated.
        complete = text[:text.rfind("\n") + 1] or (first_line if first_line.startswith(text) else text)
        try:
            first, *entries = map(json.loads, complete.splitlines())
            evaluations = [Evaluation(dict(e["gains"]), tuple(Judgement(*j) for j in e["judgements"])) for e in entries]
            self._evaluations = {tuple(e.gains.values()): e for e in evaluations}
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise StudyError(f"{path}: is not a journal ({error}); name another file") from error
        if first != header:
            raise StudyError(f"{path}: is the journal of another study or parameter set; name another file")
        if complete != text:
            write(path, complete)

    def find(self, gains: Mapping[str, float]) -> Evaluation | None:
        """Return the evaluation of exactly these gains, or None."""
        return self._evaluations.get(tuple(gains.values()))

    def add(self, evaluations: Iterable[Evaluation]) -> None:
        """Add evaluations of new gains, also to the file."""
        new = {tuple(e.gains.values()): e for e in evaluations if self.find(e.gains) is None}
        self._evaluations |= new
        if self._path is not None and new:
            append(self._path, "".join(json.dumps({"gains": e.gains, "judgements": [
                [j.requirement, j.case, j.measured, j.share] for j in e.judgements]}) + "\n" for e in new.values()))

    def __iter__(self) -> Iterator[Evaluation]:
        return iter(self._evaluations.values())
