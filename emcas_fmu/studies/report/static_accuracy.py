"""Static accuracy on a grid of angles, each approached from both sides, of the nominal actuator and with tolerances.

The controllers know the nominal actuator exactly, so that its errors come from friction and encoder alone; in a fleet
the actuators as built count. The tolerances are the cases of ``models/tuning.toml`` that change deviations alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import Any

import numpy as np

from ...bench.excitation import HOLD, staircase
from ...bench.metrics import bidirectional
from ...bench.requirements import Case
from ...parameters import load_parameters
from ..tuning.study import shipped_cases
from .outcome import Array, Outcome, Quantity, Rig

INTERVALS = 8  # of the range
CYCLES = 5
STEP = 0.02  # s, of the outputs: only the ends of the holds are read
LAST = 0.1  # s, the end of a hold over which the angle is averaged

QUANTITIES = (
    Quantity("largest_error_deg", "largest mean error", "largest |angle - command| of any approach, as a mean over the "
             "end of the hold"),
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

    Each cycle begins at the lowest target, which is therefore approached from above only.
    """
    up = [(k, 0) for k in range(1, targets)]
    down = [(k, 1) for k in range(targets - 2, -1, -1)]
    return [(k, side, cycle) for cycle in range(cycles) for k, side in up + down]


def tolerances() -> list[Case]:
    """Return the cases of the shipped tuning study that change only how the actuator as built deviates."""
    return [case for case in shipped_cases(load_parameters())
            if case.values and all(name.startswith("deviation.") for name in case.values)]


def _errors(rig: Rig, targets: Array, visits: list[tuple[int, int, int]], values: Mapping[str, Any]) -> Array:
    """Return the errors [deg] (side, target, cycle) of every hold; nan where no approach is from that side."""
    # The first hold is at the lowest target, before any cycle.
    levels = tuple(radians(targets[k]) for k in (0, *(k for k, _, _ in visits)))
    hold, last = round(HOLD / STEP), round(LAST / STEP)
    grid = staircase(levels, (HOLD,) * len(levels), step=STEP).with_start_values(values)
    angle = np.degrees(rig.run(grid).columns["fin_angle"])
    errors = np.full((2, len(targets), CYCLES), np.nan)
    for number, (k, side, cycle) in enumerate(visits, start=2):
        end = number * hold
        errors[side, k, cycle] = np.mean(angle[end - last + 1:end + 1]) - targets[k]
    return errors


def measure(rig: Rig) -> Outcome:
    """Measure the errors on the grid, `CYCLES` times up and down."""
    targets = np.linspace(-rig.limit, rig.limit, INTERVALS + 1)
    visits = course(len(targets), CYCLES)
    names = rig.subject.values.keys()
    cases = {"grid": {}, **{case.name: case.values for case in tolerances() if case.values.keys() <= names}}
    errors = {name: _errors(rig, targets, visits, values) for name, values in cases.items()}
    accuracy = {name: bidirectional(*sides) for name, sides in errors.items()}
    figures = {name: {q.key: measured[q.key.removesuffix("_deg")] for q in QUANTITIES}
               for name, measured in accuracy.items()}
    labels = {name: name.replace("_", " ") + " (estimates)" for name in cases}
    return Outcome(
        f"{len(targets)} angles evenly over ±{rig.limit:g} deg, {CYCLES} times up and down, no load. Each is held "
        f"for {HOLD:g} s; its angle is the mean of the last {LAST:g} s. The ends of the range can be approached "
        "from one side only and are no part of the hysteresis. With tolerances the unit as built deviates from the "
        "parameters in its controllers, by the estimates of models/tuning.toml.", QUANTITIES, figures,
        (*(f"grid.{key}" for key in ("largest_error_deg", "hysteresis_deg", "repeatability_deg")),
         *(f"{name}.largest_error_deg" for name in cases if name != "grid")),
        {**labels, "grid": f"{len(targets)} angles"},
        {"grid": {"command_deg": targets, "error_from_below_deg": accuracy["grid"]["means"][0],
                  "error_from_above_deg": accuracy["grid"]["means"][1], "reversal_deg": accuracy["grid"]["reversal"]}},
        dict(zip(("below", "above"), errors["grid"], strict=True)))
