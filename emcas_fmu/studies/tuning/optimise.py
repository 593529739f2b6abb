"""The search: differential evolution over the bounds, then Nelder-Mead from the best, on the worst requirement.

The gains that are returned are chosen last, from gains rounded as they are written to a file.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise, repeat
from math import exp, floor, inf, log, log10, nan
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from ...parameters import ParameterSet
from ...runtime import library
from ...support.progress import Progress, silent, uninterrupted
from .evaluate import Evaluation, Journal, evaluate
from .study import Study, Tunable

_DIGITS = 3  # significant, of gains: as many as a person would set
_POPULATION = 12  # individuals for each tunable
_LOCAL = 60  # evaluations for each tunable
_STEPS = 1000  # least number of 1 ms that a requirement is simulated in a case
_TOGETHER = 16  # most sets of gains evaluated at once: enough for vectors, few to lose if the run is killed
_SLACK = 0.03  # share of a limit; a requirement this close to the worst one binds, too
# Number of rounded gains that are judged with their neighbours, after a whole search and after Ctrl-C. Near a limit
# that is crossed abruptly the best ten of a search are almost the same gains.
_CHOICE, _HURRIED = 20, 4

Gains = Mapping[str, float]
_Map = Callable[..., Iterable[list[Evaluation]]]


@dataclass(frozen=True)
class Result:
    """The result of a run: the gains it returns, as they are written, the initial ones, and all evaluations."""

    study: Study
    seed: int
    best: Evaluation
    before: Evaluation
    nearby: float
    """Largest objective of the returned gains and their neighbours, of which one gain differs by a unit of its third
    digit; nan if Ctrl-C came before these were judged."""
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
        """Whether the search has found nothing better than the initial gains, which are then returned."""
        return self.best == self.before

    @property
    def tuned(self) -> ParameterSet:
        """The parameter set that was tuned, with the best gains."""
        return self.study.base.with_values(self.best.gains)

    @property
    def at_bound(self) -> dict[str, str]:
        """The gains at a bound of the search, with its name: lower or upper."""
        bounds = {t.name: t.bound(self.best.gains[t.name]) for t in self.study.tunables}
        return {name: bound for name, bound in bounds.items() if bound}

    @property
    def binding(self) -> list[str]:
        """The requirements that limit the smallest margin, the worst first."""
        ranked = sorted(self.best.by_requirement().items(), key=lambda item: -item[1].share)
        return [name for name, j in ranked if j.share >= self.best.worst.share - _SLACK]


def rounded(gains: Gains, study: Study) -> dict[str, float]:
    """Return the gains with three significant digits, or with the more that are needed to stay within the bounds."""
    def within(t: Tunable) -> float:
        value = min(max(gains[t.name], t.lower), t.upper)
        digits = (float(f"{value:.{count}g}") for count in range(_DIGITS, 18))
        return next(each for each in digits if t.lower <= each <= t.upper)

    return {t.name: within(t) for t in study.tunables}


def neighbours(gains: Gains, study: Study) -> list[Gains]:
    """Return the gains within the bounds of which one differs by a unit of its third digit."""
    near: list[Gains] = []
    for t in study.tunables:
        unit = 10.0 ** (floor(log10(abs(gains[t.name]) or 1.0)) - _DIGITS + 1)
        for value in (gains[t.name] - unit, gains[t.name] + unit):
            if t.lower <= value <= t.upper:
                near.append({**gains, t.name: float(f"{value:.10g}")})
    return near


def tune(study: Study, seed: int = 1, generations: int = 12, workers: int = 1, journal: Journal | None = None,
         progress: Progress = silent) -> Result:
    """Return the gains with the largest smallest margin over requirements and cases, or the initial ones if better.

    The returned gains were judged as they are written. The same study and seed give the same gains for any number of
    worker processes and any initial gains, unless the initial ones are better. Ctrl-C ends the search with the best
    gains so far; raises KeyboardInterrupt if not even the initial ones were judged.
    """
    evaluations = journal if journal is not None else Journal(None, study)
    search = _Search(study, evaluations, progress, generations, workers)
    bounds = [(log(t.lower), log(t.upper)) for t in study.tunables]
    begun: Gains = {t.name: float(study.base.values[t.name]) for t in study.tunables}
    before: Evaluation | None = None
    judged = (_POPULATION * (generations + 1) + _LOCAL) * len(bounds)
    library.compile_for(study.base.model, judged * len(study.requirements) * len(study.cases) * _STEPS)
    try:
        with _processes(workers) as search.map:
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
        search.map, search.workers = map, 1
        returned, nearby, _ = _chosen(search, before, _written(evaluations, study, _HURRIED))
        stopped = True
    return Result(study, seed, returned, before, nearby, tuple(evaluations), tuple(search.history), stopped)


def _written(evaluations: Iterable[Evaluation], study: Study, count: int) -> list[Gains]:
    """Return the best gains of a search, rounded and without duplicates."""
    written: Iterable[Gains] = (rounded(e.gains, study) for e in sorted(evaluations, key=lambda e: e.objective))
    return list({tuple(gains.values()): gains for gains in written}.values())[:count]


def _chosen(search: _Search, before: Evaluation, choice: list[Gains]) -> tuple[Evaluation, float, bool]:
    """Return rounded gains, the largest objective of them and their neighbours, and whether Ctrl-C was pressed.

    The initial gains and those of the `choice` that are not worse compete by that objective: gains that miss a limit
    as soon as a third digit changes are not robust. Ctrl-C ends the choice.
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
    """Return the logarithms of the best gains and of a step of 5 % of each, inwards near a bound."""
    corner = np.log(list(best.gains.values()))
    simplex = np.tile(corner, (len(bounds) + 1, 1))
    for i, (_, upper) in enumerate(bounds):
        simplex[i + 1, i] += 0.05 if corner[i] + 0.05 <= upper else -0.05
    return simplex


class _Search:
    """Evaluates gains that are not in the journal, and remembers the best.

    `map` is the function of that name, or that of `workers` processes; `seen` are the evaluations of this search, in
    order, of which the journal may have more.
    """

    def __init__(self, study: Study, journal: Journal, progress: Progress, generations: int, workers: int) -> None:
        self.study, self.workers = study, workers
        self._names = [t.name for t in study.tunables]
        self._journal, self._progress = journal, progress
        self._done, self._total = 0, generations + 1
        self.map: _Map = map
        self.history: list[float] = []
        self.seen: list[Evaluation] = []

    @property
    def best(self) -> Evaluation:
        return min(self.seen, key=lambda e: e.objective)

    def all(self, gains: list[Gains]) -> list[Evaluation]:
        missing = {tuple(g.values()): g for g in gains if self._journal.find(g) is None}
        for several in _evaluated(self.map, self.study, list(missing.values()), self.workers):
            self._journal.add(several)
        return [e for e in map(self._journal.find, gains) if e is not None]

    def objectives(self, points: list[Any]) -> list[float]:
        # Ten digits, so that the journal is searched by gains without rounding errors.
        gains: list[Gains] = [{n: float(f"{exp(v):.10g}") for n, v in zip(self._names, x, strict=True)} for x in points]
        evaluations = self.all(gains)
        self.seen += evaluations
        return [e.objective for e in evaluations]

    def note(self, stage: str, generations: int = 0) -> None:
        """Append the best objective to the history after further `generations`, and report it."""
        self._done += generations
        self.history.append(self.best.objective)
        self._progress(f"{stage}, worst {self.best.worst.share:.3f} of its limit ({self.best.worst.requirement})",
                       min(self._done, self._total), self._total)


def _begin() -> None:
    """Prepare a worker process: the parent alone handles Ctrl-C, and a parent that is killed ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()


def _evaluated(run: _Map, study: Study, gains: Sequence[Gains], workers: int) -> Iterator[list[Evaluation]]:
    """Yield the evaluations of gains part by part; workers share the gains, of a single set of gains the cases."""
    if len(gains) > 1:
        together = _TOGETHER if library.available(study.base.model) else 1  # the Python kernel has no vectors
        size = min(together, -(-len(gains) // workers))
        yield from run(evaluate, repeat(study), [gains[k:k + size] for k in range(0, len(gains), size)])
    elif gains:
        ends = [len(study.cases) * k // workers for k in range(workers + 1)]
        studies = [replace(study, cases=study.cases[low:high]) for low, high in pairwise(ends) if low < high]
        of_cases = [each for (each,) in run(evaluate, studies, repeat(gains))]
        yield [Evaluation(gains[0], tuple(j for each in of_cases for j in each.judgements))]


@contextmanager
def _processes(count: int) -> Iterator[_Map]:
    """The `map` of several worker processes, or the usual one.

    Processes, since most of the work is Python's: threads would wait for the interpreter's lock.
    """
    if count <= 1:
        yield map
        return
    executor = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_begin)
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows, whose workers may report a Ctrl-C as they start
    try:
        with uninterrupted():
            if masks:  # processes inherit the mask
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                for _ in range(count):  # a task starts one process, or all of them
                    executor.submit(int)
            finally:
                if masks:
                    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        yield executor.map
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
