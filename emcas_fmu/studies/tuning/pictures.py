"""Pictures of a tuning run: responses before and after, the search, what one requirement costs another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from ...bench.subject import ParameterSubject
from ...plots import BLUE, GRAY, GREEN, VERMILLION, Drawing, figure
from .evaluate import HOPELESS
from .measure import Test, response
from .optimise import Result
from .pareto import Conflict, shares

_LEVEL: Mapping[str, Any] = {"color": VERMILLION, "linewidth": 0.7, "linestyle": "--"}
_SHOWN = 1.0  # s of a response, at most: past any settling of use


def drawings(result: Result, conflict: Conflict | None) -> Iterator[Drawing]:
    """Draw every picture the result has something for."""
    if moves := list(dict.fromkeys(r.test for r in result.study.requirements if r.test.kind in ("step", "slew"))):
        yield responses(result, moves)
    yield search(result)
    if conflict is not None:
        yield trade(result, conflict)


def responses(result: Result, moves: Sequence[Test]) -> Drawing:
    """Draw steps and slews in every case, with the gains begun with and those found."""
    subject, columns = ParameterSubject(result.study.base), min(len(moves), 2)
    drawn, grid = figure(-(-len(moves) // columns), columns, width=10.0, height=2.6)
    for axes, test in zip(grid.flat, moves, strict=False):
        for gains, color, label in ((result.before.gains, GRAY, "before"), (result.best.gains, BLUE, "tuned")):
            for case in result.study.cases:
                run = response(test, subject, {**case.values, **gains})
                if run.stopped is not None:
                    continue
                time = run.columns["time"] - run.excitation.begin
                shown = (time > -0.03) & (time <= min(test.duration, _SHOWN))
                axes.plot(time[shown] * 1e3, np.degrees(run.columns["fin_angle"][shown]), color=color, linewidth=0.9,
                          alpha=0.8, label=label if case is result.study.cases[0] else None)
        axes.axhline(degrees(test.amplitude), **_LEVEL)
        load = f", {test.torque:+g} N.m" if test.torque else ""
        axes.set_title(f"{test.kind} to {degrees(test.amplitude):g} deg{load}")
        axes.set(xlabel="time / ms", ylabel="fin angle / deg")
        axes.legend(loc="lower right")
    for axes in grid.flat[len(moves):]:
        axes.set_visible(False)
    return Drawing("Responses", drawn, f"Every case ({', '.join(c.name for c in result.study.cases)}), positive "
                                       "direction, with the gains begun with and those found.")


def search(result: Result) -> Drawing:
    """Draw the best objective as the search went on, and where the evaluated gains lie."""
    names = [t.name for t in result.study.tunables]
    drawn, grid = figure(1, 1 + len(names), width=2.6 * (1 + len(names)), height=2.6)
    first, *others = grid.flat
    first.plot(result.history, color=BLUE)
    first.set(xlabel="generation, then local evaluation", ylabel="best objective", title="Search")
    objective = np.array([e.objective for e in result.evaluated])
    top = float(np.quantile(objective, 0.8))
    for axes, name in zip(others, names, strict=True):
        gains = np.array([e.gains[name] for e in result.evaluated])
        axes.semilogx(gains, np.minimum(objective, top), ".", color=GRAY, markersize=2.0)
        axes.axvline(result.best.gains[name], color=BLUE, linewidth=0.8)
        axes.set(title=name.removeprefix("controller."), xlabel="value")
    return Drawing("Search", drawn, f"{len(result.evaluated)} sets of gains. Each dot is one; the line is the set "
                                    "found. A sharp lower edge tells a gain that matters, a flat one a gain that does "
                                    "not.")


def trade(result: Result, conflict: Conflict) -> Drawing:
    """Draw what one requirement costs another: shares of both limits, and the sets none beats in both."""
    drawn, ((axes,),) = figure(1, 1, width=6.0, height=3.6)
    points = np.array(shares(result.evaluated, conflict.first, conflict.second))
    near = points[(points < min(HOPELESS, 3.0)).all(axis=1)]
    axes.plot(near[:, 0], near[:, 1], ".", color=GRAY, markersize=2.5)
    inside = [p for p in conflict.front if max(p) < 3.0]
    axes.plot([p[0] for p in inside], [p[1] for p in inside], ".-", color=GREEN, label="none is better in both")
    best = shares([result.best], conflict.first, conflict.second)[0]
    axes.plot(*best, "o", color=BLUE, label="found")
    axes.axvline(1.0, **_LEVEL)
    axes.axhline(1.0, **_LEVEL)
    axes.set(xlabel=f"{conflict.first} / limit", ylabel=f"{conflict.second} / limit")
    axes.legend(loc="upper right")
    return Drawing(
        "What one costs the other", drawn,
        f"{conflict.first} and {conflict.second} as shares of their limits, worst case each (rank correlation near the "
        f"best {conflict.correlation:.2f}); below and left of the dashed lines both are met.")
