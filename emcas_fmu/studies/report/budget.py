"""The accuracy budget: how far each imperfection and tolerance moves the held fin angle, and the sums of these terms.

The actuator without its imperfections (:attr:`.Actuator.imperfections`) holds commands over the range, approached from
both sides; then again with one imperfection, or with one tolerance at either limit. A term is the largest distance from
the mean angle held without. Two terms are errors of the actuator without imperfections: friction is half the difference
between the sides, loop is the distance of their mean from the command.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import degrees
from typing import Any, NamedTuple

import numpy as np

from ...actuators import capabilities
from ...actuators.as_built import IMPERFECTIONS
from ...bench.conditions import resting_on
from ...bench.excitation import COMMAND, HOLD, LOAD, Excitation
from ...bench.measure import columns
from ...bench.metrics import ACCURACY, bidirectional, hold_figures, shown
from ...bench.requirements import Requirement
from ...bench.runs import StoppedError
from ...motions import EXCITATIONS
from ...pages.numbers import rounded
from ...simulation import Array
from ..campaign.distributions import Distribution
from ..campaign.quantiles import Chance, percentiles
from ..campaign.study import hypercube
from .accuracy import GRID_STEP, MOVED_TO
from .outcome import FigureGroup, Outcome, Quantity, Rig

TARGETS = 5  # commands over the range
BEFORE = 1.0  # s, of the hold from which a command is approached
UNITS = 200  # samples of the Monte Carlo simulation, each run once without load and once with it
SEED = 1  # of these samples
QUANTILES = (95, 99)  # %, of the samples
_TEMPERATURE, _RANGE = "friction.temperature", ("friction.identified_from", "friction.identified_to")
QUANTITIES = (Quantity("unloaded_deg", "without load", "unloaded"),
              Quantity("loaded_deg", "in either direction", "loaded"))


class Term(NamedTuple):
    """A term of the budget: name in a result, label, and changed parameters; for a tolerance, those at each limit."""

    name: str
    label: str
    values: tuple[Mapping[str, Any], ...]


def imperfections(rig: Rig) -> list[Term]:
    """Return the imperfections of the subject that are not zero."""
    present = {name: {key: rig.subject.values[key] for key in without}
               for name, without in rig.subject.actuator.imperfections.items()}
    return [Term(name.replace(" ", "_"), name, (values,)) for name, values in present.items()
            if values != rig.subject.actuator.imperfections[name]]


def limits(rig: Rig) -> dict[str, tuple[float, float]]:
    """Return the smallest and largest value [SI] of every parameter with a tolerance; either may be the nominal one.

    The ambient temperature varies over the range in which friction was identified.
    """
    values, cases = rig.subject.values, rig.tolerances.cases
    names = dict.fromkeys(name for case in cases for name in case.values if name in values)
    ends = {name: [values[name], *(case.values[name] for case in cases if name in case.values)] for name in names}
    if capabilities.AMBIENT_TEMPERATURE in rig.subject.actuator.provides and values.keys() >= {*_RANGE}:
        ends[_TEMPERATURE] = [values[_TEMPERATURE], *(values[name] for name in _RANGE)]
    return {name: (min(each), max(each)) for name, each in ends.items() if min(each) < max(each)}


def toleranced(rig: Rig) -> list[Term]:
    """Return the tolerances as terms, with their limits in the label."""
    variables, terms = {v.name: v for v in rig.subject.actuator.parameters}, list[Term]()
    for name, ends in limits(rig).items():
        unit, factor = shown(variables[name].unit)
        low, high = (rounded(factor * end, ".3g") for end in ends)
        span = f"±{high}" if ends[0] == -ends[1] else f"{low} to {high}"
        quantity = variables[name].description.rpartition(" as built of ")[2].removeprefix("the ")
        terms.append(Term(name.removeprefix("deviation.").replace(".", "_"), f"{quantity}, {span} {unit}",
                          tuple({name: end} for end in ends if end != rig.subject.values[name])))
    return terms


def required(rig: Rig, loaded: bool) -> Requirement | None:
    """Return the requirement on the error held after the largest step, with or without a load; otherwise None."""
    held = [r for r in rig.requirements.requirements if r.figure == "held_error" and r.test and r.maximum
            and r.test.kind in EXCITATIONS and EXCITATIONS[r.test.kind].jumps and bool(r.test.torque) is loaded]
    return max(held, key=lambda r: r.test.amplitude if r.test else 0.0, default=None)


def _held(rig: Rig, before: Array, target: Array, loads: Array, changes: Mapping[str, Array]) -> Array:
    """Return the fin angles [rad], an array [run, target, row], while the commands `target` are held.

    Each is approached from the command `before`. Commands [rad] are arrays [target] or [run, target], loads [N.m] and
    `changes` of parameters arrays [run]. Raises StoppedError.
    """
    rows = [round(hold / GRID_STEP) for hold in (BEFORE, HOLD)]
    levels = np.stack([before, target], axis=-1).reshape(*target.shape[:-1], -1)
    command = np.repeat(levels, rows * target.shape[-1], axis=-1)
    excitation = Excitation("holds", {COMMAND: np.concatenate([command, command[..., -1:]], axis=-1)}, BEFORE,
                            GRID_STEP).holding({LOAD: loads[:, np.newaxis]})
    runs = rig.subject.run_all(excitation, changes, ["fin_angle"])
    for error in runs.refused.values():
        raise StoppedError(f"a sample within the tolerances is refused: {error}") from error
    for index in runs.stopped:
        runs[index].finished()
    angle = runs.columns["fin_angle"][:, 1:]
    return angle.reshape(len(angle), -1, sum(rows))[..., rows[0]:]


def _largest(angle: Array, target: Array) -> Any:
    """Return the largest distances [rad] of the held angles from the targets over the last third of the holds."""
    return hold_figures(GRID_STEP * np.arange(angle.shape[-1]), angle, target)["held_error"]


def _sides(of_loads: Any) -> dict[str, float]:
    """Return the QUANTITIES [deg] from three measurements [rad]: without load, and with load in each direction."""
    unloaded, *loaded = np.degrees(of_loads).tolist()
    return {q.key: value for q, value in zip(QUANTITIES, (unloaded, max(loaded)), strict=True)}


def _measured(rig: Rig, terms: Sequence[Term], load: float) -> dict[str, dict[str, float]]:
    """Return the figures of `loop`, `friction` and the terms by name, and last those of the error `as_set`."""
    ideal = {key: value for without in rig.subject.actuator.imperfections.values() for key, value in without.items()}
    variants = [{}, ideal, *({**ideal, **values} for term in terms for values in term.values)]
    limit, loads = rig.subject.command_limit, np.array([0.0, load, -load])
    targets, moved = np.linspace(-limit, limit, TARGETS), np.radians(min(MOVED_TO, 0.5 * rig.limit))
    index = np.arange(1, 2 * TARGETS - 1) // 2  # the ends are approached from one side only
    side = np.tile([1, 0], TARGETS - 1)  # 0: from below, 1: from above
    target = targets[index]
    angle = _held(rig, target + moved * (2 * side - 1), target, np.tile(loads, len(variants)), {
        name: np.repeat(values, len(loads)) for name, values in columns(rig.subject, variants).items()})
    as_set, alone, *others = angle.reshape(len(variants), len(loads), *angle.shape[1:])
    error = hold_figures(GRID_STEP * np.arange(angle.shape[-1]), alone, target)["steady_error"]
    of_sides = np.full((len(loads), 2, TARGETS, 1), np.nan)
    of_sides[:, side, index, 0] = error
    each = [bidirectional(*of_load) for of_load in of_sides]
    found = {"loop": _sides([np.nanmax(np.abs(np.mean(one["means"], axis=0))) for one in each]),  # of both sides
             "friction": _sides([0.5 * one["hysteresis"] for one in each])}
    for term in terms:
        ends, others = others[:len(term.values)], others[len(term.values):]
        found[term.name] = _sides(np.max([_largest(end, target + error) for end in ends], axis=(0, 2)))
    return {**found, "as_set": _sides(np.max(_largest(as_set, target), axis=-1))}


def _drawn(rig: Rig, load: float) -> Array:
    """Return the largest errors [rad] of drawn samples at drawn commands, an array [load, sample].

    Tolerances and commands have uniform distributions between their limits: nothing else is known of a tolerance (JCGM
    100:2008, 4.3.7). Both sides of approach, and both signs of the load, are equally likely.
    """
    bounds = limits(rig)
    *shares, command, side, sign = hypercube(len(bounds) + 3, SEED, UNITS).T
    changes = {name: np.tile(Distribution("uniform", {"low": low, "high": high}).at(share), 2)
               for (name, (low, high)), share in zip(bounds.items(), shares, strict=True)}
    limit, moved = rig.subject.command_limit, np.radians(min(MOVED_TO, 0.5 * rig.limit))
    target = np.tile(limit * (2.0 * command - 1.0), 2)[:, np.newaxis]
    before = np.clip(target + moved * np.where(np.tile(side, 2) < 0.5, -1.0, 1.0)[:, np.newaxis], -limit, limit)
    loads = np.concatenate([np.zeros(UNITS), load * np.where(sign < 0.5, -1.0, 1.0)])
    return np.asarray(_largest(_held(rig, before, target, loads, changes), target)).reshape(2, UNITS)


def measure(rig: Rig) -> Outcome:
    """Measure every term, compute sums and a Monte Carlo simulation, and compare with the required limits."""
    wanted = [required(rig, loaded) for loaded in (False, True)]
    load = abs(wanted[1].test.torque) if wanted[1] and wanted[1].test else rig.load
    wanted = [wanted[0], wanted[1] or wanted[0]]
    limit = [r.limit if r else ACCURACY for r in wanted]
    own, built = imperfections(rig), toleranced(rig)
    found, drawn = _measured(rig, [*own, *built], load), _drawn(rig, load)
    as_set = found.pop("as_set")
    labels = {"loop": "loop: mean of both sides of approach", "friction": "friction: half the difference of the sides",
              **{term.name: term.label for term in (*own, *built)}}
    groups = {name: FigureGroup(labels[name], figures) for name, figures in found.items()}

    def total(name: str, label: str, values: Iterable[Any], headline: bool = False) -> None:
        figures = {q.key: float(value) for q, value in zip(QUANTITIES, values, strict=True)}
        groups[name] = FigureGroup(label, figures, QUANTITIES * headline)

    sums = [[figures[q.key] for figures in found.values()] for q in QUANTITIES]
    total("worst_case", "worst case: sum", [np.sum(terms) for terms in sums], True)
    # For limits of independent terms. A standard uncertainty would combine standard deviations (JCGM 100:2008, 5.1.2).
    total("root_of_squares", "root of the sum of squares", [np.linalg.norm(terms) for terms in sums], True)
    for share in QUANTILES:
        total(f"monte_carlo_{share}", f"Monte Carlo: {share} % of {UNITS} samples",
              np.degrees([percentiles(errors, (share,))[share] for errors in drawn]), share == QUANTILES[0])
    total("as_set", "as set: all imperfections, no tolerance", as_set.values())
    total("required", "required", np.degrees(limit))
    notes = [f"{q.label.capitalize()}, samples within {degrees(most):g} deg "
             f"({f'{r.title or r.name}, {r.source}' if r else 'Table 2 of Yerlikaya (2016)'}): "
             f"{Chance(r, int(np.sum(errors <= most)), UNITS)}, from {UNITS} samples."
             for q, r, most, errors in zip(QUANTITIES, wanted, limit, drawn, strict=True)]
    return Outcome(
        f"{TARGETS} commands over ±{rig.limit:g} deg are held for {HOLD:g} s each, after a motion of "
        f"{min(MOVED_TO, 0.5 * rig.limit):g} deg from either side within the range, without load and with {load:g} N.m "
        "in either direction. The term of an imperfection or a tolerance is the largest distance, over the last third "
        "of a hold, from the mean angle that the actuator without any of them holds; the terms loop and friction are "
        "errors of that angle. The sums include all terms. Monte Carlo: samples of the actuator as set, tolerances "
        "drawn uniformly between their limits, hold one drawn command each; the error of a sample is its largest over "
        "the last third.",
        groups, (*notes, *_limitations(rig, own)), tall=True,
        estimate=f"The tolerances in {rig.tolerances.file} are estimates." if built and rig.tolerances.estimated
        else "")


def _limitations(rig: Rig, own: Sequence[Term]) -> Iterator[str]:
    """Yield notes on terms that depend on estimates, and on terms that the budget lacks."""
    estimates, bounds = rig.subject.identification.estimates, limits(rig)
    yield from resting_on({term.label: [name for name, value in term.values[0].items()
                                        if name in estimates and not isinstance(value, bool)] for term in own})
    if not bounds:
        yield "No tolerance is known: samples differ only in command, side of approach and sign of the load."
    known = dict.fromkeys((*IMPERFECTIONS, *rig.subject.actuator.imperfections))
    if missing := [name for name in known if name not in {term.label for term in own}]:
        yield f"Not in the budget, as this article has none: {', '.join(missing)}."
    if unknown := [name for name in rig.subject.actuator.nominal if name not in bounds]:
        yield f"Not in the budget, as {rig.tolerances.file} has no tolerance of {', '.join(unknown)}."
