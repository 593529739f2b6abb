"""Static accuracy on a grid of angles, each approached from both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bench import HOLD, Bench
from .outcome import Array, Outcome, Quantity

NAME = "static_accuracy"
INTERVALS = 8  # of the range
CYCLES = 5
STEP = 0.02  # s, of the outputs: only what is held is looked at
AVERAGED = 0.1  # s, the end of each hold

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


@dataclass(frozen=True)
class Bidirectional:
    """Figures of a bidirectional grid, in the unit of the errors; `reversal` is of each target, nan at the ends."""

    largest_error: float
    hysteresis: float
    repeatability: float
    accuracy: float
    mean_error: float
    reversal: Array


def bidirectional(below: Array, above: Array) -> Bidirectional:
    """Figures of errors (target, cycle) of approaches from below and from above.

    ISO 230-2 (2014), "Determination of accuracy and repeatability of positioning of numerically
    controlled axes". A target that has no approach from one side has nan there.
    """
    errors = np.stack([below, above])  # side, target, cycle
    known = ~np.isnan(errors).all(axis=2)
    means = np.full(known.shape, np.nan)
    spreads = np.full(known.shape, np.nan)
    means[known] = errors[known].mean(axis=1)
    spreads[known] = errors[known].std(axis=1, ddof=1) if errors.shape[2] > 1 else 0.0
    reversal = means[0] - means[1]
    both = ~np.isnan(reversal)
    return Bidirectional(
        float(np.nanmax(np.abs(errors))), float(np.max(np.abs(reversal[both]), initial=0.0)),
        float(4.0 * np.nanmax(spreads)), float(np.nanmax(means + 2.0 * spreads) - np.nanmin(means - 2.0 * spreads)),
        float(np.nanmean(errors)), reversal)


def course(targets: int, cycles: int) -> list[tuple[int, int, int]]:
    """(target, side, cycle) of every hold: up from the lowest target and down again, `cycles` times; side 0 is below.

    The lowest target itself is where each cycle begins, so that it has approaches from above only.
    """
    up = [(k, 0) for k in range(1, targets)]
    down = [(k, 1) for k in range(targets - 2, -1, -1)]
    return [(k, side, cycle) for cycle in range(cycles) for k, side in up + down]


def measure(bench: Bench) -> Outcome:
    """The grid, `CYCLES` times up and down."""
    targets = np.linspace(-bench.limit, bench.limit, INTERVALS + 1)
    visits = course(len(targets), CYCLES)
    hold = round(HOLD / STEP)
    # First to the lowest target, which no cycle has approached yet.
    command = np.repeat([targets[0], *(targets[k] for k, _, _ in visits)], hold)
    run = bench.run({"fin_command": np.radians(np.append(command, command[-1]))}, STEP)
    angle = np.degrees(run["fin_angle"])
    errors = np.full((2, len(targets), CYCLES), np.nan)
    last = round(AVERAGED / STEP)
    for number, (k, side, cycle) in enumerate(visits, start=2):
        end = number * hold
        errors[side, k, cycle] = np.mean(angle[end - last + 1:end + 1]) - targets[k]
    found = bidirectional(*errors)
    figures = {"grid": {
        "largest_error_deg": found.largest_error, "hysteresis_deg": found.hysteresis,
        "repeatability_deg": found.repeatability, "bidirectional_accuracy_deg": found.accuracy,
        "mean_error_deg": found.mean_error}}
    known = [_row_means(side) for side in errors]
    return Outcome(
        NAME, "Static accuracy",
        f"{len(targets)} angles evenly over ±{bench.limit:g} deg, {CYCLES} times up and down, no load. Each is held "
        f"for {HOLD:g} s; its angle is the mean of the last {AVERAGED:g} s. The ends of the range can be approached "
        "from one side only and are no part of the hysteresis.", QUANTITIES, figures,
        tuple(f"grid.{key}" for key in ("largest_error_deg", "hysteresis_deg", "repeatability_deg")),
        {"grid": f"{len(targets)} angles"},
        {"grid": {"command_deg": targets, "error_from_below_deg": known[0], "error_from_above_deg": known[1],
                  "reversal_deg": found.reversal}},
        {"below": {"errors_deg": errors[0]}, "above": {"errors_deg": errors[1]}})


def _row_means(errors: Array) -> Array:
    means = np.full(len(errors), np.nan)
    known = ~np.isnan(errors).all(axis=1)
    means[known] = errors[known].mean(axis=1)
    return means
