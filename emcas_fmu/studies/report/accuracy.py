"""Static accuracy on a grid of angles, smallest commands that move the fin, and accuracy of the stepping.

The controllers know the nominal actuator exactly: its static errors come from its loops, friction and imperfections,
such as encoder and backlash. An actuator as built deviates from it: a tolerance is a case that changes only parameters
`deviation.*`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, inf, nan, radians, sqrt, tan

import numpy as np

from ...actuators import capabilities
from ...bench.excitation import HOLD, of_case, staircase
from ...bench.measure import columns
from ...bench.metrics import ACCURACY, bidirectional
from ...bench.subject import Subject
from ...control import sensors
from ...ops.floats import FLOATS
from ...physics import kinematics
from ...reference import files
from ...simulation import Array
from .outcome import FigureGroup, Outcome, Quantity, Rig

INTERVALS = 8  # between the angles of the grid
CYCLES = 5  # up and down
GRID_STEP = 0.02  # s between outputs: only the ends of the holds are read
LAST = 0.1  # s, the end of a hold over which the angle is averaged
STATIC = (
    Quantity("largest_error_deg", "largest |angle - command| of all approaches, each a mean over the end of the hold",
             "largest mean error"),
    Quantity("hysteresis_deg", "largest difference at one command between the mean angles reached from below and from "
             "above (reversal value B of ISO 230-2)", "hysteresis"),
    Quantity("repeatability_deg", "largest unidirectional repeatability R: four standard deviations of the approaches "
             "to one angle from one side", "repeatability"),
    Quantity("bidirectional_accuracy_deg", "range of mean error ± two standard deviations over all angles and both "
             "sides (bidirectional accuracy of ISO 230-2)", "accuracy A"),
    Quantity("mean_error_deg", "mean of angle - command over all approaches", "mean error"))

STEP = 0.01  # s between outputs of the threshold
REST = 0.5  # s at rest before a command from rest
MOVED_TO = 1.0  # deg, motion before a reversal or an increment
WITHIN = 0.5  # s after a step, in which the fin has to answer
RATIO = 1.05  # largest ratio of the two sizes that enclose a threshold
THRESHOLD = tuple(
    Quantity(f"{side}_deg", f"smallest step of the command in the {side} direction that the fin answers", side)
    for side in ("positive", "negative"))

STEPPING_CASES = ("step", "load_opposing", "cold", "sag")
SHORTER = 4.0  # factor between the two ticks
_TICK = "solver.max_tick"
STEPPING = (Quantity("fin_angle_deg", "largest difference between both fin angles, read every 1 ms", "fin angle"),)


def static(rig: Rig) -> Outcome:
    """Measure the errors on the grid, `CYCLES` times up and down, without and with each tolerance."""
    tolerances, targets = rig.tolerances, np.linspace(-rig.limit, rig.limit, INTERVALS + 1)
    kind = "estimates" if tolerances.estimated else "tolerances"
    variants = {"grid": {}, **{
        case.name: case.values for case in tolerances.cases if case.values.keys() <= rig.subject.values.keys()}}
    # Each cycle goes up from the lowest target and down again. The lowest target is approached from above only.
    levels = targets[[0, *[*range(1, INTERVALS + 1), *range(INTERVALS - 1, -1, -1)] * CYCLES]]
    grid = staircase(np.radians(levels).tolist(), (HOLD,) * len(levels), step=GRID_STEP)
    runs = rig.subject.run_all(grid, columns(rig.subject, list(variants.values())), ["fin_angle"])
    groups = dict[str, FigureGroup]()
    for k, name in enumerate(variants):
        angle = np.degrees(runs[k].finished()["fin_angle"])[1:].reshape(len(levels), -1)
        means = np.mean(angle[:, -round(LAST / GRID_STEP):], axis=1)
        up, down = (means - levels)[1:].reshape(CYCLES, 2, INTERVALS).swapaxes(0, 1)
        errors = np.full((2, len(targets), CYCLES), nan)  # side, target, cycle; nan: not approached from this side
        errors[0, 1:], errors[1, :-1] = up.T, down[:, ::-1].T
        measured = bidirectional(*errors)
        below, above = measured["means"]
        groups[name] = FigureGroup(
            f"{name.replace('_', ' ')} ({kind})" if k else f"{len(targets)} angles",
            {q.key: measured[q.key.removesuffix("_deg")] for q in STATIC}, STATIC[:1 if k else 3],
            {"command_deg": targets, "error_from_below_deg": below, "error_from_above_deg": above,
             "reversal_deg": measured["reversal"]}, errors)
    return Outcome(
        f"{len(targets)} commands evenly over ±{rig.limit:g} deg, {CYCLES} times up and down, no load. Each is held "
        f"for {HOLD:g} s; its angle is the mean over the last {LAST:g} s. The ends of the range are approached from "
        "one side only and are not part of the hysteresis."
        + f" With tolerances, the actuator deviates from the parameters in its controllers by the {kind} in "
        f"{tolerances.file}."
        * (len(variants) > 1), groups)


def detected_motion(subject: Subject) -> tuple[float, str]:
    """Return the smallest detected motion [rad] and its description.

    With an enabled encoder on the fin, or on the motor of a screw, it is one count at the fin, at the angle at which a
    count is largest; otherwise 1 % of the accuracy of Table 2 of Yerlikaya (2016).
    """
    one_count = "one encoder count at the fin"
    provides, p = subject.actuator.provides, subject.actuator.namespace(subject.values)
    if capabilities.ENCODER not in provides or not p.encoder.enabled or not (
            p.encoder.on_fin or capabilities.SCREW_AND_LEVER in provides):
        return ACCURACY / 100.0, "1 % of the accuracy of Table 2 of Yerlikaya (2016)"
    if p.encoder.on_fin:
        return float(sensors.resolution(p)), one_count
    # The reduction ratio is smallest where the lever is nearest to perpendicular to the screw.
    lever = max(abs(p.kinematics.initial_angle) - subject.command_limit, 0.0)
    return float(sensors.resolution(p) / kinematics.reduction_ratio(FLOATS, p, tan(lever))), one_count


def smallest(moves: Callable[[float], bool], low: float, high: float, ratio: float = RATIO) -> float:
    """Return the smallest size at which `moves` is true, within `ratio`, by logarithmic bisection from `low` to `high`.

    `moves` is false for a size at most `ratio` times smaller, unless it is true even for `low`. nan if it is false for
    `high`.
    """
    if not moves(high):
        return nan
    if moves(low):
        return low
    while high / low > ratio:
        middle = sqrt(low * high)
        low, high = (low, middle) if moves(middle) else (middle, high)
    return high


def motion_beyond(angle: Array, before: int, direction: float) -> float:
    """Return how far [rad] an angle moves beyond its previous range in a direction (1, -1) after row `before`.

    The previous range is that of at most as many rows up to `before`: hunting between two counts is not a response.
    """
    after = direction * angle[before:]
    idle = direction * angle[max(2 * before - len(angle), 0):before + 1]
    return float(np.max(after, initial=-inf) - np.max(idle))


def threshold(rig: Rig) -> Outcome:
    """Measure the smallest steps that the fin answers: from rest, after a reversal, and on in the same direction."""
    (detected, detected_as), moved = detected_motion(rig.subject), min(MOVED_TO, 0.5 * rig.limit)
    lowest = 0.5 * detected  # of the search

    def smallest_step(direction: float, before: float, settle: float) -> float:
        begin = direction * before * radians(moved)

        def motion(size: float) -> float:
            stairs = staircase((begin, begin + direction * size), (settle, WITHIN), step=STEP)
            return motion_beyond(rig.run(stairs).columns["fin_angle"], round(settle / STEP), direction)

        creep = max(motion(0.0), 0.0)

        def moves(size: float) -> bool:
            # Half a thousandth less, since rounding may shorten a motion of one count.
            return motion(size) - creep >= detected * (1.0 - 5e-4)

        return degrees(smallest(moves, lowest, 0.5 * rig.subject.command_limit))

    def group(label: str, before: float, settle: float) -> FigureGroup:
        sizes = {q.key: smallest_step(direction, before, settle)
                 for q, direction in zip(THRESHOLD, (1.0, -1.0), strict=True)}
        return FigureGroup(label, sizes, THRESHOLD, bounds={key: "≤ " for key, size in sizes.items()
                                                            if size <= degrees(lowest)})

    return Outcome(
        f"The fin answers a step of the command if, within {WITHIN:g} s, it moves {degrees(detected):.4f} deg farther "
        f"in the step's direction than without a step: {detected_as}. From rest: at 0 deg, before any motion. "
        f"After reversal: the fin moves {moved:g} deg and rests for {HOLD:g} s, then the command steps back. "
        "Increment: the same, but the command steps on. Each size has its own run; bisection ends within "
        f"{100.0 * (RATIO - 1.0):.0f} %. An integral, if the controller has one, answers even smaller commands later.",
        {name: group(label, before, settle)
         for name, label, before, settle in (
             ("from_rest", "threshold from rest", 0.0, REST),
             ("after_reversal", "threshold after reversal (dead band)", -1.0, HOLD),
             ("increment", "resolution (smallest increment)", 1.0, HOLD))})


def stepping(rig: Rig) -> Outcome:
    """Compare the responses to reference cases with the tick as set and with a shorter one."""
    subject, groups, largest = rig.subject, {}, 0.0
    actuator, values = subject.actuator, subject.values
    tick = float(actuator.longest_tick(FLOATS, actuator.namespace(values)))
    for case in files.cases(subject.model, values):
        excitation = of_case(case.title, case.inputs(), case.step, case.overrides)
        if case.name in STEPPING_CASES and not subject.obstacle(excitation):
            one, other = (rig.run(excitation.with_start_values(changed)).columns["fin_angle"]
                          for changed in ({}, {_TICK: tick / SHORTER}))
            difference = float(np.degrees(np.max(np.abs(one - other))))
            groups[case.name] = FigureGroup(case.title, {"fin_angle_deg": difference}, STEPPING)
            largest = max(largest, degrees(float(np.max(np.abs(excitation.command)))))
    return Outcome(
        f"Reference cases with true angle and speed fed back, run with ticks of at most {1e3 * tick:.3g} ms, as set, "
        f"and of at most {1e3 * tick / SHORTER:.3g} ms ({_TICK}). The difference estimates the error of the stepping "
        "in these motions with the article's parameters; it says nothing about the equations or about other motions. "
        "Motions that amplify small differences, such as a fin that rattles in a gap, differ by more."
        + f" Commands are clipped to {rig.limit:g} deg." * (largest > rig.limit + 1e-9), groups)
