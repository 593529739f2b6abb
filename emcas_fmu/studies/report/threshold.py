"""Threshold and resolution: the smallest commands that move the fin."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, degrees, inf, nan, pi, radians, sqrt

import numpy as np

from ...bench.excitation import HOLD, staircase
from ...bench.metrics import ACCURACY
from ...bench.subject import Subject
from .outcome import Array, Outcome, Quantity, Rig

STEP = 0.01  # s, of the outputs
REST = 0.5  # s at rest before a command from rest
MOVED_TO = 1.0  # deg, the motion before a reversal or an increment
WITHIN = 0.5  # s in which the fin has to answer
RATIO = 1.05  # of the larger to the smaller size that encloses the figure

QUANTITIES = tuple(
    Quantity(f"{side}_deg", side, f"smallest step of the command, in the {side} direction, that is answered")
    for side in ("positive", "negative"))
# Label, direction of the motion before the step (0: none), and the time [s] before the step.
_TESTS = {"from_rest": ("threshold from rest", 0.0, REST),
          "after_reversal": ("threshold after reversal (dead band)", -1.0, HOLD),
          "increment": ("resolution (smallest increment)", 1.0, HOLD)}


def count(subject: Subject) -> float:
    """Return the smallest motion that is detected [rad]: one encoder count at the fin, the largest over the commands.

    For an actuator without encoder and screw it is a hundredth of the accuracy of Table 2.
    """
    values = subject.values
    if not {"encoder.pulses", "encoder.multiplier", "encoder.on_fin"} <= values.keys():
        return ACCURACY / 100.0
    turn = float(2.0 * pi / (values["encoder.pulses"] * values["encoder.multiplier"]))
    if values["encoder.on_fin"]:
        return turn
    if not {"screw.lead", "kinematics.moment_arm", "kinematics.initial_angle"} <= values.keys():
        return ACCURACY / 100.0
    # The least reduction ratio d/(l cos^2) is where the lever is perpendicular to the screw, or at an end of the range.
    limit, start = subject.command_limit, values["kinematics.initial_angle"]
    lever = 0.0 if abs(start) <= limit else abs(start) - limit
    return float(turn * values["screw.lead"] / values["kinematics.moment_arm"] * cos(lever) ** 2)


def smallest(moves: Callable[[float], bool], low: float, high: float, ratio: float = RATIO) -> float:
    """Return the smallest size that moves, within `ratio`, by bisection on a logarithmic scale between two sizes.

    The returned size moves and a size `ratio` times smaller does not, unless even the lowest moves.
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
    """Return whether the angle, after row `before`, leaves its previous range by `detected` in a direction.

    The previous range is that of as many rows before: motion at rest, such as hunting between two counts, is no answer.
    """
    after = direction * angle[before:]
    idle = direction * angle[max(2 * before - len(angle), 0):before + 1]
    # Half a thousandth less: a computed motion of one count may be short by rounding.
    return bool(np.max(after, initial=-inf) - np.max(idle) >= detected * (1.0 - 5e-4))


def measure(rig: Rig) -> Outcome:
    """Measure the threshold from rest, after a reversal, and in the same direction, for both signs."""
    detected, moved = count(rig.subject), min(MOVED_TO, 0.5 * rig.limit)

    def threshold(direction: float, before: float, settle: float) -> float:
        begin = direction * before * radians(moved)

        def moves(size: float) -> bool:
            stairs = staircase((begin, begin + direction * size), (settle, WITHIN), step=STEP)
            return answered(rig.run(stairs).columns["fin_angle"], round(settle / STEP), direction, detected)

        return degrees(smallest(moves, 0.5 * detected, 0.5 * rig.subject.command_limit))

    return Outcome(
        f"A step of the command counts as answered if the fin moves by {degrees(detected):.4f} deg (a count of the "
        f"encoder at the fin, where there is one) in its direction within {WITHIN:g} s. From rest: at 0 deg, never "
        f"moved. After reversal: the fin has moved {moved:g} deg and stood for {HOLD:g} s, then the command steps "
        f"back. Increment: likewise, the command steps on. By bisection to {100.0 * (RATIO - 1.0):.0f} %, each size in "
        "a run of its own. Integral action answers still smaller commands later.", QUANTITIES,
        {group: {q.key: threshold(direction, before, settle)
                 for q, direction in zip(QUANTITIES, (1.0, -1.0), strict=True)}
         for group, (_, before, settle) in _TESTS.items()},
        tuple(f"{group}.{q.key}" for group in _TESTS for q in QUANTITIES),
        {group: label for group, (label, *_) in _TESTS.items()})
