"""The search for gains: differential evolution within the bounds, then Nelder-Mead from the best gains.

Both searches minimise :attr:`.evaluate.Evaluation.objective`. Then the result is chosen among the best gains, rounded
to the digits of a parameter file.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, pairwise, repeat
from math import exp, floor, inf, log, log10, nan
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from ...errors import EmcasError
from ...parameters import ParameterSet
from ...runtime import library
from ...support.progress import Progress, silent, uninterrupted
from .evaluate import Evaluation, Journal, evaluate, margin_text
from .study import Study, Tunable

_DIGITS = 3  # significant digits of returned gains: as many as a person would set
_POPULATION = 12  # sets of gains in a generation, for each tunable parameter
_LOCAL = 60  # most evaluations of the local search, for each tunable parameter
_STEPS = 1000  # steps of 1 ms for a requirement in a case: a low estimate of the work
_TOGETHER = 16  # most sets of gains in one task: enough for vectors, and few to lose if the process is killed
_SLACK = 0.03  # a requirement is binding if its share is below the worst share by this at most
# Numbers of rounded sets of gains that are judged with their neighbours: after a complete search, and after Ctrl-C. Ten
# after a complete search are too few: near a limit that is missed abruptly, the best ten are almost the same gains.
_CANDIDATES, _HURRIED = 20, 4

Gains = Mapping[str, float]
_Map = Callable[..., Iterable[list[Evaluation]]]


@dataclass(frozen=True)
class Tuning:
    """The result of a search; gains are in SI."""

    study: Study
    seed: int
    best: Evaluation
    """The returned gains with their judgements."""
    before: Evaluation
    """The initial gains, those of the parameter set, with their judgements."""
    nearby: float
    """Largest objective of the returned gains and their neighbours, in which one gain differs by one in its third
    significant digit; nan if Ctrl-C came before the neighbours were judged."""
    evaluated: tuple[Evaluation, ...]
    """All evaluations in the journal, including those of earlier searches."""
    history: tuple[float, ...]
    """Best objective after each generation of the global search and each iteration of the local search."""
    stopped: bool
    """Whether Ctrl-C ended the search."""

    @property
    def met(self) -> bool:
        """Whether every requirement is met in every case."""
        return self.best.worst.met

    @property
    def unimproved(self) -> bool:
        """Whether the search found no better gains than the initial ones, which are then returned."""
        return self.best == self.before

    @property
    def tuned(self) -> ParameterSet:
        """The study's parameter set with the returned gains."""
        return self.study.base.with_values(self.best.gains)

    @property
    def at_bound(self) -> dict[str, str]:
        """The names of the tuned gains near a bound, each with that bound; empty if the initial gains are returned."""
        bounds = {t.name: t.bound(self.best.gains[t.name]) for t in self.study.tunables}
        return {name: bound for name, bound in bounds.items() if bound and not self.unimproved}

    @property
    def binding(self) -> list[str]:
        """The requirements with the worst share or a share below it by 0.03 at most; the worst first."""
        ranked = sorted(self.best.by_requirement().items(), key=lambda item: -item[1].share)
        return [name for name, j in ranked if j.share >= self.best.worst.share - _SLACK]


def rounded(gains: Gains, study: Study) -> dict[str, float]:
    """Return the gains, limited to the bounds and rounded to three significant digits, or to more near a bound."""
    def shortest(t: Tunable) -> float:
        value = min(max(gains[t.name], t.lower), t.upper)
        digits = (float(f"{value:.{count}g}") for count in range(_DIGITS, 18))
        return next(each for each in digits if t.lower <= each <= t.upper)

    return {t.name: shortest(t) for t in study.tunables}


def neighbours(gains: Gains, study: Study) -> list[Gains]:
    """Return sets of gains, within the bounds, in which one gain differs by one in its third significant digit."""
    sets: list[Gains] = []
    for t in study.tunables:
        step = 10.0 ** (floor(log10(abs(gains[t.name]) or 1.0)) - _DIGITS + 1)
        sets += ({**gains, t.name: float(f"{value:.10g}")} for value in (gains[t.name] - step, gains[t.name] + step)
                 if t.lower <= value <= t.upper)
    return sets


def tune(study: Study, seed: int = 1, generations: int = 12, workers: int = 1, journal: Journal | None = None,
         progress: Progress = silent) -> Tuning:
    """Search for the gains with the smallest objective, and return the result.

    The candidates are the initial gains, and the best gains of the search after rounding if they are not worse. Each
    candidate is rated by the largest objective of its gains and their neighbours; the smallest rating decides. The same
    study, seed and number of generations give the same gains for any number of workers.

    `generations` is the number of generations of the global search, `workers` the number of processes (1: this one).
    Evaluations in the `journal` are not repeated, and new evaluations are added to it; without a journal they stay in
    memory. `progress` receives the stage with its worst requirement, the number of finished parts, and the total number
    of parts: the generations and the local search. Ctrl-C ends the search with the best gains so far. Raises
    KeyboardInterrupt if Ctrl-C comes before the initial gains are judged, and EmcasError if a worker process dies.
    """
    evaluations = journal if journal is not None else Journal(None, study)
    search = _Search(study, evaluations, progress, generations, workers)
    bounds = [(log(t.lower), log(t.upper)) for t in study.tunables]
    initial_gains: Gains = {t.name: float(study.base.values[t.name]) for t in study.tunables}
    initial: Evaluation | None = None
    expected = (_POPULATION * (generations + 1) + _LOCAL) * len(bounds)
    library.compile_for(study.base.model, expected * len(study.requirements) * len(study.cases) * _STEPS)
    try:
        with _processes(workers) as search.map:
            (initial,) = search.all([initial_gains])
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
            returned, nearby, stopped = _choose(search, initial, _candidates(search.seen, study, _CANDIDATES))
    except KeyboardInterrupt:
        if initial is None:
            raise
        search.map, search.workers = map, 1
        returned, nearby, _ = _choose(search, initial, _candidates(evaluations, study, _HURRIED))
        stopped = True
    return Tuning(study, seed, returned, initial, nearby, tuple(evaluations), tuple(search.history), stopped)


def _candidates(evaluations: Iterable[Evaluation], study: Study, count: int) -> list[Gains]:
    """Return the best `count` sets of gains, rounded and without duplicates."""
    best: Iterable[Gains] = (rounded(e.gains, study) for e in sorted(evaluations, key=lambda e: e.objective))
    return list({tuple(gains.values()): gains for gains in best}.values())[:count]


def _choose(search: _Search, initial: Evaluation, candidates: list[Gains]) -> tuple[Evaluation, float, bool]:
    """Return the evaluation of the chosen gains, the largest objective near them, and whether Ctrl-C was pressed.

    The initial gains, and candidates that are not worse, are compared by the largest objective of the gains and their
    neighbours: gains that miss a limit if a third digit changes are not robust. This objective is nan if Ctrl-C came
    before the neighbours of any gains were judged.
    """
    best, nearby, stopped = initial, inf, False
    try:
        for gains in (initial.gains, *candidates):
            own, *others = search.all([gains, *neighbours(gains, search.study)])
            largest = max(e.objective for e in (own, *others))
            if own.objective <= initial.objective and largest < nearby:
                best, nearby = own, largest
    except KeyboardInterrupt:
        stopped = True
    return best, nearby if nearby < inf else nan, stopped


def _simplex(best: Evaluation, bounds: Sequence[tuple[float, float]]) -> Any:
    """Return a simplex of logarithms: the best gains, and these with one gain 5 % larger (smaller near its bound)."""
    corner = np.log(list(best.gains.values()))
    simplex = np.tile(corner, (len(bounds) + 1, 1))
    for i, (_, upper) in enumerate(bounds):
        simplex[i + 1, i] += 0.05 if corner[i] + 0.05 <= upper else -0.05
    return simplex


class _Search:
    """Looks evaluations up in the journal, and computes those that are not in it.

    `map` is the built-in function, or the map of `workers` processes. `seen` contains the evaluations in the order in
    which this search requested them; the journal may contain others. `history` has the best objective at each note.
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
        # Rounded to ten digits, since the journal finds gains only if they are equal.
        gains: list[Gains] = [{n: float(f"{exp(v):.10g}") for n, v in zip(self._names, x, strict=True)} for x in points]
        evaluations = self.all(gains)
        self.seen += evaluations
        return [e.objective for e in evaluations]

    def note(self, stage: str, generations: int = 0) -> None:
        """Append the best objective to the history, and report `generations` more generations as done."""
        self._done += generations
        self.history.append(self.best.objective)
        worst = self.best.worst
        self._progress(f"{stage} search, worst requirement {worst.requirement} with a margin of "
                       f"{margin_text(worst.margin)}", min(self._done, self._total), self._total)


def _prepare_worker() -> None:
    """Let a worker process ignore Ctrl-C, which its parent handles, and end when its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()


def _evaluated(run: _Map, study: Study, gains: Sequence[Gains], workers: int) -> Iterator[list[Evaluation]]:
    """Yield evaluations in parts: workers divide the sets of gains or, if there is only one set, its cases."""
    if len(gains) > 1:
        together = _TOGETHER if library.available(study.base.model) else 1  # the Python kernel has no vectors
        size = min(together, -(-len(gains) // workers))
        yield from run(evaluate, repeat(study), [gains[k:k + size] for k in range(0, len(gains), size)])
    elif gains:
        ends = [len(study.cases) * k // workers for k in range(workers + 1)]
        studies = [replace(study, cases=study.cases[low:high]) for low, high in pairwise(ends) if low < high]
        judgements = (each.judgements for (each,) in run(evaluate, studies, repeat(gains)))
        yield [Evaluation(gains[0], tuple(chain.from_iterable(judgements)))]


@contextmanager
def _processes(count: int) -> Iterator[_Map]:
    """Yield the map of `count` worker processes, or for one the built-in map. Raises EmcasError if a worker dies.

    Threads would wait for the interpreter's lock, since most of the work is done in Python.
    """
    if count <= 1:
        yield map
        return
    executor = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_prepare_worker)
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows, where starting workers may report a Ctrl-C
    try:
        with uninterrupted():
            if masks:  # processes inherit the mask
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                for _ in range(count):
                    executor.submit(int)  # starts a process, if none is idle
            finally:
                if masks:
                    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        yield executor.map
    except BrokenProcessPool as error:
        raise EmcasError(f"tune: one of {count} worker processes died (out of memory, or killed); use fewer workers; a "
                         "journal keeps the finished evaluations, and the same search continues from them") from error
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
