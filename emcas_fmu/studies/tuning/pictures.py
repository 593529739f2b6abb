"""The pictures of a search for gains: responses, the search, and two requirements that conflict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import degrees
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from ...bench.measure import Test, response
from ...bench.subject import ParameterSubject
from ...plotting.plots import BLUE, GRAY, GREEN, VERMILLION, Drawing, column, figure, legend, panel_grid
from .evaluate import HOPELESS, Evaluation
from .optimise import Tuning

_LEVEL: Mapping[str, Any] = {"color": VERMILLION, "linewidth": 0.7, "linestyle": "--"}
_SHOWN = 1.0  # s, longest plotted time: longer than any settling time of interest
_NEAR = 1.6  # largest objective at which evaluations are used to find conflicts, as a multiple of the best objective


def drawings(result: Tuning, pair: tuple[str, str] | None = None) -> Iterator[Drawing]:
    """Yield the pictures of a result; `pair` are the requirements of the trade-off (default: the most conflicting)."""
    if moves := list(dict.fromkeys(
            r.test for r in result.study.requirements if r.test and r.test.kind in ("step", "slew"))):
        yield responses(result, moves)
    yield search(result)
    if conflicting := conflict(result.evaluated, pair):
        yield trade(result, *conflicting)


def responses(result: Tuning, moves: Sequence[Test]) -> Drawing:
    """Plot the responses to `moves` (steps and slews) in every case, with the initial and the returned gains."""
    subject, columns = ParameterSubject(result.study.base), min(len(moves), 2)
    plot, grid = panel_grid(len(moves), columns, width=10.0, height=2.6)
    for axes, test in zip(grid, moves, strict=True):
        for gains, color, label in ((result.before.gains, GRAY, "initial"), (result.best.gains, BLUE, "returned")):
            for case in result.study.cases:
                run = response(test, subject, {**case.values, **gains})
                if run.stopped is not None:
                    continue
                time = run.columns["time"] - run.excitation.begin
                shown = (time > -0.03) & (time <= min(test.duration, _SHOWN))
                axes.plot(time[shown] * 1e3, np.degrees(run.columns["fin_angle"][shown]), color=color, linewidth=0.9,
                          alpha=0.8, label=label)
        axes.axhline(degrees(test.amplitude), **_LEVEL)
        load = f", {test.torque:+g} N.m" if test.torque else ""
        axes.set_title(f"{test.kind} to {degrees(test.amplitude):g} deg{load}")
        axes.set(xlabel="time [ms]", ylabel="fin angle [deg]")
        legend(axes, loc="lower right")
    return Drawing("Responses", plot, f"Every case ({', '.join(c.name for c in result.study.cases)}), positive "
                                      "direction, with the initial and the returned gains.")


def search(result: Tuning) -> Drawing:
    """Plot the best objective during the search and, over each gain, all objectives (worst 20 % at the upper edge)."""
    names = [t.name for t in result.study.tunables]
    plot, grid = figure(1, 1 + len(names), width=2.6 * (1 + len(names)), height=2.6)
    first, *others = grid.flat
    first.plot(result.history, color=GRAY)
    first.axhline(result.before.objective, label="initial", **_LEVEL)
    first.axhline(result.best.objective, label="returned", **{**_LEVEL, "color": BLUE})
    first.legend(loc="upper right")
    first.set(xlabel="generation, then local iteration", ylabel="best objective", title="Search")
    objective = np.array([e.objective for e in result.evaluated])
    top = float(np.quantile(objective, 0.8))
    for axes, name in zip(others, names, strict=True):
        gains = np.array([e.gains[name] for e in result.evaluated])
        axes.semilogx(gains, np.minimum(objective, top), ".", color=GRAY, markersize=2.0)
        axes.axvline(result.best.gains[name], color=BLUE, linewidth=0.8)
        axes.set(title=name.removeprefix("controller."), xlabel="value")
    return Drawing("Search", plot, f"{len(result.evaluated)} sets of gains, one dot each; the vertical line is the "
                                   "returned gain. A gain matters if the lower edge of its dots has a sharp minimum.")


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the Pareto front of points whose coordinates should be small, by ascending first coordinate."""
    best: list[tuple[float, float]] = []
    for x, y in sorted(set(points)):
        if not best or y < best[-1][1]:
            best.append((x, y))
    return best


def shares(evaluations: Sequence[Evaluation], first: str, second: str) -> list[tuple[float, float]]:
    """Return the shares of two requirements, each in its worst case, as a pair for each evaluation."""
    return [(e.by_requirement()[first].share, e.by_requirement()[second].share) for e in evaluations]


def conflict(evaluations: Sequence[Evaluation], pair: tuple[str, str] | None = None
             ) -> tuple[str, str, float] | None:
    """Return a pair of requirements, by default the two that conflict most, with the rank correlation of their shares.

    The correlation is over the evaluations near the best objective. Return None if there are no evaluations or, without
    a `pair`, if all correlations are above -0.3.
    """
    if not evaluations:
        return None
    best = min(e.objective for e in evaluations)
    near = [e.by_requirement() for e in evaluations if e.objective <= _NEAR * best]
    columns = {name: np.array([judgements[name].share for judgements in near]) for name in near[0]}
    # Figures that hardly vary, or do not exist in some evaluations, are not used.
    varying = [name for name, column in columns.items() if np.ptp(column) > 0.02 and column.max() < HOPELESS]
    rated = [(_correlation(columns[first], columns[second]), first, second)
             for first, second in ([pair] if pair else combinations(varying, 2))]
    correlation, first, second = min(rated, key=lambda entry: entry[0], default=(0.0, "", ""))
    if not pair and correlation > -0.3:
        return None
    return first, second, correlation


def _correlation(first: Any, second: Any) -> float:
    """Return the rank correlation of two columns; 0 if one is constant."""
    return float(spearmanr(first, second).statistic) if min(np.ptp(first), np.ptp(second)) > 0.0 else 0.0


def trade(result: Tuning, first: str, second: str, correlation: float) -> Drawing:
    """Plot two requirements against each other, each as a share of its limit, with their Pareto front."""
    plot, (axes,) = column(f"share of {second}", x=f"share of {first}", width=6.0, height=3.6)
    pairs = shares(result.evaluated, first, second)
    points = np.array(pairs)
    near = points[(points < min(HOPELESS, 3.0)).all(axis=1)]
    axes.plot(near[:, 0], near[:, 1], ".", color=GRAY, markersize=2.5)
    shown = [p for p in front(pairs) if max(p) < 3.0]
    axes.plot([p[0] for p in shown], [p[1] for p in shown], ".-", color=GREEN, label="best combinations")
    best = shares([result.best], first, second)[0]
    axes.plot(*best, "o", color=BLUE, label="returned")
    axes.axvline(1.0, **_LEVEL)
    axes.axhline(1.0, **_LEVEL)
    axes.legend(loc="upper right")
    return Drawing(
        "Trade-off between two requirements", plot,
        f"{first} and {second} as shares of their limits, each in its worst case (rank correlation near the best: "
        f"{correlation:.2f}). Both are met below and left of the dashed lines.")
