"""Static accuracy on a grid of angles, each approached from both sides."""

from __future__ import annotations

from math import radians

import numpy as np

from ...bench.excitation import staircase
from ...bench.metrics import HELD, bidirectional
from ...bench.verdict import HOLD
from .outcome import Outcome, Quantity
from .rig import Rig

INTERVALS = 8  # of the range
CYCLES = 5
STEP = 0.02  # s, of the outputs: only what is held is looked at

QUANTITIES = (
    Quantity("largest_error_deg", "largest error", "largest |angle - command| of any approach"),
    Quantity("hysteresis_deg", "hysteresis", "largest difference, at one angle, of the mean angles it is approached "
             "with from below and from above (reversal value B of ISO 230-2)"),
    Quantity("repeatability_deg", "repeatability", "largest unidirectional repeatability R: four standard deviations "
             "of the approaches to one angle from one side"),
    Quantity("bidirectional_accuracy_deg", "accuracy A", "range of mean error ± two standard deviations over all "
             "angles and both sides (bidirectional accuracy of ISO 230-2)"),
    Quantity("mean_error_deg", "mean error", "mean of angle - command over all approaches"),
)


def course(targets: int, cycles: int) -> list[tuple[int, int, int]]:
    """Return (target, side, cycle) of every hold: up from the lowest target and down again; side 0 is below.

    The lowest target itself is where each cycle begins, so that it has approaches from above only.
    """
    up = [(k, 0) for k in range(1, targets)]
    down = [(k, 1) for k in range(targets - 2, -1, -1)]
    return [(k, side, cycle) for cycle in range(cycles) for k, side in up + down]


def measure(rig: Rig) -> Outcome:
    """Measure the errors on the grid, `CYCLES` times up and down."""
    targets = np.linspace(-rig.limit, rig.limit, INTERVALS + 1)
    visits = course(len(targets), CYCLES)
    # First to the lowest target, which no cycle has approached yet.
    levels = tuple(radians(targets[k]) for k in (0, *(k for k, _, _ in visits)))
    hold, last = round(HOLD / STEP), round(HELD / STEP)
    angle = np.degrees(rig.run(staircase(levels, (HOLD,) * len(levels), step=STEP)).columns["fin_angle"])
    errors = np.full((2, len(targets), CYCLES), np.nan)
    for number, (k, side, cycle) in enumerate(visits, start=2):
        end = number * hold
        errors[side, k, cycle] = np.mean(angle[end - last + 1:end + 1]) - targets[k]
    approaches = bidirectional(*errors)
    figures = {"grid": {q.key: getattr(approaches, q.key.removesuffix("_deg")) for q in QUANTITIES}}
    return Outcome(
        f"{len(targets)} angles evenly over ±{rig.limit:g} deg, {CYCLES} times up and down, no load. Each is held "
        f"for {HOLD:g} s; its angle is the mean of the last {HELD:g} s. The ends of the range can be approached "
        "from one side only and are no part of the hysteresis.", QUANTITIES, figures,
        tuple(f"grid.{key}" for key in ("largest_error_deg", "hysteresis_deg", "repeatability_deg")),
        {"grid": f"{len(targets)} angles"},
        {"grid": {"command_deg": targets, "error_from_below_deg": approaches.means[0],
                  "error_from_above_deg": approaches.means[1], "reversal_deg": approaches.reversal}},
        {"below": {"errors_deg": errors[0]}, "above": {"errors_deg": errors[1]}})
