"""Threshold and resolution: the smallest commands that move the fin."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, inf, nan, radians, sqrt

import numpy as np

from ...bench.excitation import HOLD, staircase
from .outcome import Array, Outcome, Quantity, Value
from .rig import Rig

STEP = 0.01  # s, of the outputs
REST = 0.5  # s at rest before a command from rest
MOVED_TO = 1.0  # deg, the motion before a reversal or an increment
WITHIN = 0.5  # s in which the fin has to answer
RATIO = 1.05  # of the larger to the smaller size that encloses the figure

QUANTITIES = (
    Quantity("positive_deg", "positive", "smallest step of the command, in the positive direction, that is answered"),
    Quantity("negative_deg", "negative", "smallest step of the command, in the negative direction, that is answered"),
)


def smallest(moves: Callable[[float], bool], low: float, high: float, ratio: float = RATIO) -> float:
    """Return the smallest size that moves, within `ratio`, by bisection on a logarithmic scale between two sizes.

    The size returned moves and a size `ratio` times smaller does not, unless the lowest does already.
    nan where not even the highest moves.
    """
    if not moves(high):
        return nan
    if moves(low):
        return low
    while high / low > ratio:
        middle = sqrt(low * high)
        low, high = (low, middle) if moves(middle) else (middle, high)
    return high


def answered(angle: Array, before: int, direction: float, detected: float) -> bool:
    """Return whether the angle leaves its range of as long before, after row `before`, by `detected` in a direction.

    What the fin does at rest (hunting between two counts, say) is no answer.
    """
    after = direction * angle[before:]
    idle = direction * angle[max(2 * before - len(angle), 0):before + 1]
    # Half a thousandth less: a motion of one count, computed, may be a rounding short of it.
    return bool(np.max(after, initial=-inf) - np.max(idle) >= detected * (1.0 - 5e-4))


def measure(rig: Rig) -> Outcome:
    """Measure the threshold from rest, after a reversal, and in the same direction, both signs."""
    count = rig.count
    figures: dict[str, dict[str, Value]] = {}
    moved = min(MOVED_TO, 0.5 * rig.limit)
    tests = {"from_rest": (0.0, 1.0, REST), "after_reversal": (moved, -1.0, HOLD), "increment": (moved, 1.0, HOLD)}
    for group, (first, sense, settle) in tests.items():
        figures[group] = {}
        for name, direction in (("positive_deg", 1.0), ("negative_deg", -1.0)):
            begin = direction * sense * radians(first)

            def moves(size: float, begin: float = begin, direction: float = direction, settle: float = settle) -> bool:
                stairs = staircase((begin, begin + direction * size), (settle, WITHIN), step=STEP)
                return answered(rig.run(stairs).columns["fin_angle"], round(settle / STEP), direction, count)

            figures[group][name] = degrees(smallest(moves, 0.5 * count, 0.5 * rig.subject.command_limit))
    labels = {"from_rest": "threshold from rest", "after_reversal": "threshold after reversal (dead band)",
              "increment": "resolution (smallest increment)"}
    return Outcome(
        f"A step of the command counts as answered if the fin moves by {degrees(count):.4f} deg (a count of the "
        f"encoder at the fin, where there is one) in its direction within {WITHIN:g} s. From rest: at 0 deg, never "
        f"moved. After reversal: the fin has moved {moved:g} deg and stood for {HOLD:g} s, then the command steps "
        f"back. Increment: likewise, the command steps on. By bisection to {100.0 * (RATIO - 1.0):.0f} %, each size in "
        "a run of its own. Integral action answers still smaller commands later.", QUANTITIES, figures,
        tuple(f"{group}.{q.key}" for group in tests for q in QUANTITIES), labels)
