"""The search: differential evolution over the bounds, then Nelder-Mead from the best, on the worst requirement.

What is returned is chosen last, among gains as they are written.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from math import exp, floor, inf, log, log10, nan
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread, current_thread, main_thread
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from ...bench.requirements import Case
from ...parameters import ParameterSet
from ...runtime import library
from ...support.progress import Progress, silent
from .evaluate import Evaluation, Journal, evaluate
from .study import Study, Tunable

# Gains are given with as many digits as a person would set.
_DIGITS = 3
_POPULATION = 12  # individuals for each tunable
_LOCAL = 60  # evaluations for each tunable
_STEPS = 1000  # of 1 ms, at least, for a requirement in a case
_TOGETHER = 16  # sets of gains at once, at most: many enough for vectors, and few to lose where a run is killed
_SLACK = 0.03  # of a limit, within which a requirement binds as the worst does
# Gains that are judged as they would be written, with their neighbours: after a whole search, and after Ctrl-C. Beside
# a limit that is crossed at once the best ten of a search are all of one place.
_CHOICE, _HURRIED = 20, 4

Gains = Mapping[str, float]
_Evaluator = Callable[[list[Gains]], Iterable[list[Evaluation]]]


@dataclass(frozen=True)
class Result:
    """What a run found: the gains it returns, as they are written, those begun with, and everything evaluated."""

    study: Study
    seed: int
    best: Evaluation
    before: Evaluation
    nearby: float
    """Largest objective of the returned gains and of those with one of them changed by a unit of its third digit; nan
    where Ctrl-C came before."""
    evaluated: tuple[Evaluation, ...]
    history: tuple[float, ...]
    """Best objective after each generation of the global search and each evaluation of the local one."""
    stopped: bool
    """Whether Ctrl-C ended the search."""

    @property
    def met(self) -> bool:
        """Whether every requirement is met in every case."""
        return self.best.worst.met

    @property
    def unimproved(self) -> bool:
        """Whether nothing better was found than the gains begun with, which are then returned."""
        return self.best == self.before

    @property
    def tuned(self) -> ParameterSet:
        """The parameter set that was tuned, with the best gains."""
        return self.study.base.with_values(self.best.gains)

    @property
    def at_bound(self) -> dict[str, str]:
        """The gains at a bound of the search, with which one: lower or upper."""
        bounds = {t.name: t.bound(self.best.gains[t.name]) for t in self.study.tunables}
        return {name: bound for name, bound in bounds.items() if bound}

    @property
    def binding(self) -> list[str]:
        """Requirements that stand between here and more margin, the worst first."""
        ranked = sorted(self.best.by_requirement().items(), key=lambda item: -item[1].share)
        return [name for name, j in ranked if j.share >= self.best.worst.share - _SLACK]


def rounded(gains: Gains, study: Study) -> dict[str, float]:
    """Return the gains with three significant digits, or with as many more as keep them between their bounds."""
    def within(t: Tunable) -> float:
        value = min(max(gains[t.name], t.lower), t.upper)
        digits = (float(f"{value:.{count}g}") for count in range(_DIGITS, 18))
        return next(each for each in digits if t.lower <= each <= t.upper)

    return {t.name: within(t) for t in study.tunables}


def neighbours(gains: Gains, study: Study) -> list[Gains]:
    """Return gains of which one is changed by a unit of its third digit, up or down, between the bounds."""
    found: list[Gains] = []
    for t in study.tunables:
        unit = 10.0 ** (floor(log10(abs(gains[t.name]) or 1.0)) - _DIGITS + 1)
        for value in (gains[t.name] - unit, gains[t.name] + unit):
            if t.lower <= value <= t.upper:
                found.append({**gains, t.name: float(f"{value:.10g}")})
    return found


def tune(study: Study, seed: int = 1, generations: int = 12, workers: int = 1, journal: Journal | None = None,
         progress: Progress = silent) -> Result:
    """Return the gains with the largest smallest margin over requirements and cases, never worse than those begun with.

    Every gain returned was judged as it is written. The same study and seed give the same gains, whatever the number of
    worker processes and whatever gains the set begins with, unless those are better. Ctrl-C ends the search, with the
    best gains judged so far; raises KeyboardInterrupt where none were, not those begun with either.
    """
    evaluations = journal if journal is not None else Journal(None, study)
    search = _Search(study, evaluations, progress, generations)
    bounds = [(log(t.lower), log(t.upper)) for t in study.tunables]
    begun: Gains = {t.name: float(study.base.values[t.name]) for t in study.tunables}
    before: Evaluation | None = None
    judged = (_POPULATION * (generations + 1) + _LOCAL) * len(bounds)
    library.compile_for(study.base.model, judged * len(study.requirements) * len(study.cases) * _STEPS)
    try:
        with _pool(study, workers) as search.evaluator:
            (before,) = search.all([begun])
            differential_evolution(
                lambda x: np.array(search.objectives(list(np.atleast_2d(x.T)))), bounds,
                rng=np.random.default_rng(seed), popsize=_POPULATION, maxiter=generations, tol=1e-3,
                updating="deferred", polish=False, init="sobol", vectorized=True,
                callback=lambda *_, **__: search.note("global", 1))
            best = search.best
            minimize(lambda x: search.objectives([x])[0], [log(v) for v in best.gains.values()], method="Nelder-Mead",
                     bounds=bounds, options={"maxfev": _LOCAL * len(bounds), "xatol": 2e-3, "fatol": 1e-4,
                                             "initial_simplex": _simplex(best, bounds)},
                     callback=lambda *_: search.note("local"))
            returned, nearby, stopped = _chosen(search, before, _written(search.seen, study, _CHOICE))
    except KeyboardInterrupt:
        if before is None:
            raise
        with _pool(study, 1) as search.evaluator:
            returned, nearby, _ = _chosen(search, before, _written(evaluations, study, _HURRIED))
        stopped = True
    return Result(study, seed, returned, before, nearby, tuple(evaluations), tuple(search.history), stopped)


def _written(evaluations: Iterable[Evaluation], study: Study, count: int) -> list[Gains]:
    """Return the best gains of a search as they would be written, each once."""
    found: list[Gains] = []
    for evaluation in sorted(evaluations, key=lambda e: e.objective):
        if len(found) == count:
            break
        if (gains := rounded(evaluation.gains, study)) not in found:
            found.append(gains)
    return found


def _chosen(search: _Search, before: Evaluation, choice: list[Gains]) -> tuple[Evaluation, float, bool]:
    """Return gains as they are written, the largest objective of them and their neighbours, and whether Ctrl-C came.

    Of the gains begun with and those of the `choice` that are not worse, it is those with the smallest such objective:
    a limit that is crossed where a third digit changes is no place to stay. Ctrl-C ends the choice.
    """
    best, nearby, stopped = before, inf, False
    try:
        for gains in (before.gains, *choice):
            own, *others = search.all([gains, *neighbours(gains, search.study)])
            largest = max(e.objective for e in (own, *others))
            if own.objective <= before.objective and largest < nearby:
                best, nearby = own, largest
    except KeyboardInterrupt:
        stopped = True
    return best, nearby if nearby < inf else nan, stopped


def _simplex(best: Evaluation, bounds: Sequence[tuple[float, float]]) -> Any:
    """Return the best and a step of 5 % of each gain, inwards where a bound is near."""
    corner = np.log(list(best.gains.values()))
    simplex = np.tile(corner, (len(bounds) + 1, 1))
    for i, (_, upper) in enumerate(bounds):
        simplex[i + 1, i] += 0.05 if corner[i] + 0.05 <= upper else -0.05
    return simplex


class _Search:
    """Evaluates what is not in the journal, and remembers the best."""

    def __init__(self, study: Study, journal: Journal, progress: Progress, generations: int) -> None:
        self.study = study
        self._names = [t.name for t in study.tunables]
        self._journal, self._progress = journal, progress
        self._done, self._total = 0, generations + 1
        self.evaluator: _Evaluator = lambda _: ()
        self.history: list[float] = []
        self.seen: list[Evaluation] = []  # of this run, in its order, whatever else the journal holds
        self._best: Evaluation | None = None

    @property
    def best(self) -> Evaluation:
        assert self._best is not None
        return self._best

    def all(self, gains: list[Gains]) -> list[Evaluation]:
        missing = {tuple(g.values()): g for g in gains if self._journal.find(g) is None}
        for several in self.evaluator(list(missing.values())):
            self._journal.add(several)
        return [e for e in map(self._journal.find, gains) if e is not None]

    def objectives(self, points: list[Any]) -> list[float]:
        # Ten digits: a journal holds what was evaluated, not a rounding error beside it.
        gains: list[Gains] = [{n: float(f"{exp(v):.10g}") for n, v in zip(self._names, x, strict=True)} for x in points]
        evaluations = self.all(gains)
        self.seen += evaluations
        self._best = min([*([self._best] if self._best else []), *evaluations], key=lambda e: e.objective)
        return [e.objective for e in evaluations]

    def note(self, stage: str, generations: int = 0) -> None:
        """Keep the best objective in the history after further `generations`, and report it."""
        self._done += generations
        self.history.append(self.best.objective)
        self._progress(f"{stage}, worst {self.best.worst.share:.3f} of its limit ({self.best.worst.requirement})",
                       min(self._done, self._total), self._total)


_study: Study | None = None


def _begin(study: Study) -> None:
    global _study
    _study = study
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends the search
    parent = parent_process()
    if parent is not None:  # a run that is killed takes its workers along
        Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()


def _part(gains: Sequence[Gains], cases: Sequence[Case]) -> list[Evaluation]:
    assert _study is not None
    return evaluate(replace(_study, cases=tuple(cases)), gains)


def _parted(gains: Sequence[Gains], study: Study, workers: int) -> Iterator[tuple[Sequence[Gains], Any]]:
    """Return gains in parts, each with the groups of cases that as many workers judge at the same time."""
    together = _TOGETHER if library.available(study.base.model) else 1  # in Python nothing is gained
    size = min(together, -(-len(gains) // workers) or 1)
    groups = 1 if len(gains) > 1 else min(workers, len(study.cases))
    ends = [len(study.cases) * k // groups for k in range(groups + 1)]
    for first in range(0, len(gains), size):
        yield gains[first:first + size], [study.cases[low:high] for low, high in pairwise(ends)]


@contextmanager
def _pool(study: Study, workers: int) -> Iterator[_Evaluator]:
    """Evaluate lists of gains part by part, in worker processes if there is more than one."""
    if workers <= 1:
        yield lambda gains: (evaluate(study, part) for part, _ in _parted(gains, study, 1))
        return
    executor = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin, initargs=(study,))

    def by_workers(gains: list[Gains]) -> Iterator[list[Evaluation]]:
        parts = [[executor.submit(_part, part, cases) for cases in groups]
                 for part, groups in _parted(gains, study, workers)]
        for futures in parts:
            yield [Evaluation(of[0].gains, tuple(j for each in of for j in each.judgements))
                   for of in zip(*(future.result() for future in futures), strict=True)]

    try:
        with _interrupts_held():
            for _ in range(workers):  # each starts a process, if the first does not start all
                executor.submit(int)
        yield by_workers
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C from processes begun inside, and from this one until the end; the main thread alone can."""
    if current_thread() is not main_thread():
        yield
        return
    caught: list[int] = []
    masks = hasattr(signal, "pthread_sigmask")  # Windows has none: its workers may tell of a Ctrl-C as they begin
    handler = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    if masks:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if masks:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, handler)
    if caught:
        raise KeyboardInterrupt
