"""Overview of a user's parameter set: its remaining estimates, their effects, and figures that follow from the set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..actuators import capabilities, fin_port, is_shipped
from ..control import sensors
from ..motions import LOAD_RISE
from ..ops.floats import FLOATS
from ..parameters import Entry, ParameterError, ParameterSet, load_parameters
from ..physics import kinematics
from ..simulation import Array, simulate
from ..units import RPM

if TYPE_CHECKING:
    from .analysis.capability import Capability

CHANGE = 0.1  # relative change of a value, of which the effect is measured
DURATION = 0.5  # s, duration of the step response on which the effect is measured


@dataclass(frozen=True)
class EstimatedEntries:
    """An estimate of the default set, or several that belong together: an array, or a pair that is equal in SI units.

    `shipped` is false for a value of a user's actuator. `effect` [rad] is the largest change of the fin angle if the
    value changes by 10 %. It is None if it was not measured, if both changes were refused, or if the change has no
    meaning (a value of 0, a switch, an integer, a temperature).
    """

    names: tuple[str, ...]
    shipped: bool = True
    effect: float | None = None

    @property
    def label(self) -> str:
        """The names, joined by "with"; the name of an array has no index."""
        return " with ".join(dict.fromkeys(name.partition("[")[0] for name in self.names))


def offered(base: ParameterSet) -> dict[str, list[Entry]]:
    """Return the entries for which a user probably has values, by name; the elements of an array are in one list.

    These are the entries whose declaration names a term of a datasheet. For a user's actuator they are also all
    other entries except those of the fin port.
    """
    port = {v.name for v in fin_port.PARAMETERS}
    chosen = [e for e in base.entries if e.variable.sheet or (
        not is_shipped(base.model) and e.variable.name not in port)]
    return {name: list(group) for name, group in groupby(chosen, lambda e: e.variable.name.partition("[")[0])}


def remaining_estimates(parameters: ParameterSet) -> tuple[EstimatedEntries, ...]:
    """Return the estimates of the actuator's default set that `parameters` leave unchanged, in the actuator's order."""
    actuator = parameters.actuator
    default = {e.variable.name: e for e in load_parameters(model=parameters.model).entries}
    remaining = [e.variable.name for e in parameters.entries
                 if e.source == "estimate" and e == default[e.variable.name]]
    followers = {name: other for name, other in actuator.equal_parameters if {name, other} <= {*remaining}}
    leaders = (name for name in remaining if name not in followers.values())
    groups = [tuple(names) for _, names in groupby(leaders, lambda name: name.partition("[")[0])]
    own_files = () if is_shipped(parameters.model) else (
        (actuator.source or Path(actuator.name)).name, *(file.name for file in actuator.files))
    return tuple(EstimatedEntries((*names, *(followers[name] for name in names if name in followers)),
                                  default[names[0]].file not in own_files) for names in groups)


def in_words(parameters: ParameterSet, estimates: Sequence[EstimatedEntries]) -> str:
    """Return the number of remaining estimates as text; for a user's actuator also how many of them are shipped."""
    count = sum(len(each.names) for each in estimates)
    shipped = sum(len(each.names) for each in estimates if each.shipped)
    of_all = f"{count} of {len(parameters.entries)} values"
    if is_shipped(parameters.model):
        return f"shipped estimates: {of_all}"
    return f"estimates: {of_all}, {count - shipped} of your actuator and {shipped} shipped"


def by_group(estimates: Iterable[EstimatedEntries]) -> dict[str, list[str]]:
    """Return the labels of estimates by group, such as ``motor``; these labels do not begin with the group."""
    groups: dict[str, list[str]] = {}
    for estimate in estimates:
        group, dot, name = estimate.label.partition(".")
        groups.setdefault(group if dot else "", []).append(name if dot else group)
    return groups


def by_effect(parameters: ParameterSet, torque: float = 0.0) -> tuple[EstimatedEntries, ...]:
    """Return the remaining estimates with the effect of a 10 % change of each, the largest effect first.

    The effect [rad] is the largest difference of the fin angle within 0.5 s after a step to half of command.limit
    against a hinge moment `torque` [N.m]. Plant and controllers both use the changed value: 10 % more or, if this
    value is refused, 10 % less.
    """
    unchanged = _response(parameters, torque)
    estimates = [replace(each, effect=_effect(parameters, each.names, torque, unchanged))
                 for each in remaining_estimates(parameters)]
    return tuple(sorted(estimates, key=lambda e: -1.0 if e.effect is None else e.effect, reverse=True))


def _response(parameters: ParameterSet, torque: float) -> Array:
    command = 0.5 * float(parameters.values["command.limit"])
    run = simulate(parameters.values, DURATION, model=parameters.model, fin_command=command,
                   aero_torque=lambda time: -torque * min(time / LOAD_RISE, 1.0))
    return run["fin_angle"]


def _effect(parameters: ParameterSet, names: Iterable[str], torque: float, unchanged: Array) -> float | None:
    variables = {e.variable.name: e.variable for e in parameters.entries}
    values = {name: float(parameters.values[name]) for name in names
              if variables[name].kind == "Real" and variables[name].unit != "degC"}
    if not any(values.values()):
        return None
    for factor in (1.0 + CHANGE, 1.0 - CHANGE):
        with suppress(ParameterError, ArithmeticError):
            changed = parameters.with_values({name: factor * value for name, value in values.items()})
            return float(np.max(np.abs(_response(changed, torque) - unchanged)))
    return None


def _capability(parameters: ParameterSet) -> Capability | None:
    """Return the capability of motor and drive; None for an actuator without the capabilities that it needs."""
    from .analysis.capability import NEEDS, capability  # here, since the import of the analysis is slow

    able = parameters.actuator.provides.issuperset(NEEDS)
    return capability(parameters.values, parameters.model) if able else None


def stalled(parameters: ParameterSet, torque: float) -> Iterator[str]:
    """Yield a warning if the hinge moment `torque` [N.m] exceeds the smallest stall moment in the range of commands."""
    can = _capability(parameters)
    if can is not None and torque > (smallest := float(np.min(can.stall))):
        yield (f"a hinge moment of {torque:.6g} N.m stalls the actuator: with motor.torque_constant, "
               "drive.current_limit, reduction and friction, the smallest stall moment in the range of commands is "
               f"{smallest:.4g} N.m")


def amounts_to(parameters: ParameterSet) -> Mapping[str, str]:
    """Return figures that follow from a parameter set, as texts by name; none without motor, screw and lever."""
    actuator, can = parameters.actuator, _capability(parameters)
    if can is None or capabilities.SCREW_AND_LEVER not in actuator.provides:
        return {}
    p = actuator.plant(parameters.values)
    stop = p.fin.stop_angle
    travel = [float(kinematics.nut_position(FLOATS, p, kinematics.motor_angle(FLOATS, p, angle)))
              for angle in (-stop, stop)]
    ratio = float(np.min(can.ratio))
    free = p.drive.supply_voltage / p.motor.back_emf_constant if p.motor.back_emf_constant else float("inf")
    return {
        "motor turns per turn of the fin": f"{ratio:.4g} to {float(np.max(can.ratio)):.4g}",
        "no-load speed of the motor at the supply": f"{RPM * free:.4g} rpm",
        "smallest fin rate without load": f"{degrees(float(np.min(can.rate))):.4g} deg/s",
        "smallest hinge moment that stalls it": f"{float(np.min(can.stall)):.4g} N.m",
        "stroke of the nut from stop to stop": f"{1e3 * (travel[1] - travel[0]):.4g} mm",
        "one count of the motor's encoder": f"{degrees(float(sensors.resolution(p)) / ratio):.3g} deg of the fin",
    }
