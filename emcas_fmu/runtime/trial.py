"""The trial of a user's actuator before its first simulation: mistakes that would give wrong numbers in silence."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..actuators import capabilities, fin_port, get, parts
from ..actuators.declaration import Actuator, PlantInputs
from ..actuators.external import of_function, refusal
from ..actuators.positional import identifier
from ..errors import EmcasError, declared_in, location
from ..namespace import Record, value_of
from ..ops.base import Ops, Value
from ..ops.derived import TableError
from ..ops.located import LocatedFloats, located
from ..parameters import check_parameters
from ..physics.loads import LOADS
from ..steppers.events import SwitchedStep
from ..support.progress import warn
from . import codegen, contradictions, diagnosis
from .compiled import Array, Tables
from .core import Functions

_INTERVAL = 1e-3  # of points of time [s]
_STEP = 50  # points of a step to half the largest command
# Where the fin is released [share of the stop angle], and the ratio of distances from which on it moves away.
_OFF, _AWAY = 0.02, 5.0
_LEAVES = 0.5  # share of its angle by which a servo that is commanded to stay there hardly leaves it
_ELSEWHERE = 0.01  # share of it by which it may start elsewhere: kinematics may be solved approximately
# A margin that is below this at the start of so many steps in a row is not about to be lost: an event would be there.
_BELOW, _IN_A_ROW = -1e-9, 10
# Difference of a state, to find its effect on its derivative; and the latter's rounding, or that of outputs.
_DIFFERENCE, _ROUNDING = 1e-6, 1e-8
_NEAR, _BEYOND = 0.9, 1.2  # start and command of a trial of the command's limit, in shares of it
_MOVING = 0.01  # [rad, rad/s] of a fin whose outputs are compared, or that a load accelerates
_GROWTH = 0.05  # [1/s] of a mode; less is rounding of the Jacobian
# Newton's steps to an equilibrium; and the smallest singular value, relative, that is none of rounding.
_NEWTON, _SINGULAR = 10, 1e-9

Run = Callable[..., Tables]
_tried: set[str] = set()


def try_out(model: str, row: Array, inputs: Sequence[ArrayLike], points: int, run: Run, by_floats: Run) -> None:
    """Warn, once in a process, of a user's actuator that is unstable at rest, starts elsewhere, or ignores an input.

    `row` are its parameters. Of each of its `inputs`, SI, the first value is used if it is the supply's or a further
    one. A fin off centre is released for `points` of time, 1 ms apart. `run` simulates as
    :func:`.compiled.run_tables`, and so does `by_floats`, with a last argument that binds functions to parameters.
    Raises EmcasError for equations that cannot be traced, misused discontinuities, a state that no sample sets, outputs
    that contradict the port, and an event margin that is below 0 while its mode holds.
    """
    actuator = get(model)
    if actuator.source is None or model in _tried:
        return
    codegen.traced(model=model)  # names the line of an equation that cannot be computed
    values = dict(zip((v.name for v in actuator.parameters), row.tolist(), strict=True))
    if check_parameters(values, model):
        return
    at_rest = {v.name: float(np.asarray(x).flat[0]) for v, x in zip(actuator.inputs, inputs, strict=True)}
    at_rest |= dict.fromkeys((v.name for v in (fin_port.COMMAND, fin_port.AERO_TORQUE, *fin_port.MOTION)), 0.0)
    base, extensions = parts(model)
    try:
        sampled = contradictions.Sampled(get(base), values, at_rest, _supply(actuator, at_rest))  # extensions set all
        sampled.require_all_set()
        if "homing" in extensions:
            sampled.require_offset()
        x, rates, shown = _at_rest(actuator, values, at_rest)
        _require_of_port(actuator, x, shown)
        names = [s.name for s in actuator.states]
        seen = _unstable(names, x, rates) if actuator.derivatives is not None else ""
    except TableError as error:
        raise _of_table(actuator, values, error) from error
    if isinstance(actuator.step, SwitchedStep) and not seen:  # values that have grown are rounded
        stepping = {**at_rest, fin_port.COMMAND.name: 0.5 * values["command.limit"], fin_port.ENABLE.name: 1.0}
        for floats in (False, True):  # steps over floats need ten times as long, but say where they fail
            watched = _watched(actuator, actuator.step, floats)
            bind = partial(diagnosis.functions, actuator=watched) if floats else partial(_traced, watched)
            with nullcontext() if floats else suppress(EmcasError):
                if not _run(by_floats, model, [values], stepping, _STEP, bind).failures:
                    break
    in_time = partial(_run, run, model)
    for wrong in (*_in_vain(model), *sampled.unsaid(), *contradictions.at_rest(actuator, shown(x))):
        warn(wrong)
    _tried.add(model)
    if actuator.derivatives is not None and (ignored := _unloaded(names, x, rates)):
        warn(f"{actuator.source}: {ignored}")
    limit = values["command.limit"]
    near = {**values, "fin.start_angle": _NEAR * limit}  # where no drive is at its limit
    sound = not check_parameters(near, model)
    if sound:
        moved = _moved(near, {**at_rest, fin_port.ENABLE.name: 1.0}, in_time, limit, _BEYOND * limit)
        if _differ(moved) or sampled.follows_beyond(_BEYOND):  # a slow fin does not get there
            warn(f"{actuator.source}: fin_angle follows fin_command beyond command.limit; clip the command, by "
                 "em.fin_port.clipped_command(ops, p, inputs.command)")
    if _differ(_moved(values, {**at_rest, fin_port.ENABLE.name: 0.0}, in_time, 0.0, 0.5 * limit)):
        warn(f"{actuator.source}: fin_angle follows fin_command while disabled; use inputs.enable in sample(), or "
             "u.enabled in the plant")
    if seen := seen or _moves_away(values, at_rest, points, in_time):
        warn(f"{actuator.source}: from rest, without command and load, {seen}; check the signs of stiffness, damping, "
             "motor torque and control")
    elif seen := _starts_elsewhere(actuator, values, at_rest, in_time):
        warn(f"{actuator.source}: {seen}")
    elif sound:
        for wrong in contradictions.moving(actuator, near, moved, _INTERVAL, not extensions):
            warn(wrong)


def _run(run: Run, model: str, sets: Sequence[Mapping[str, Any]], inputs: Mapping[str, float], points: int,
         *bind: Callable[..., Any]) -> Tables:
    rows = np.array([list(values.values()) for values in sets])
    columns = [np.broadcast_to(x, (*np.shape(x)[:-1], points)) for x in inputs.values()]
    return run(rows, columns, _INTERVAL, contradictions.outputs(get(model)), model, 1, (), 0.0, *bind)


def _off(values: Mapping[str, Any]) -> float:
    """Return the angle [rad] beside the centre from which a fin is released."""
    return float(min(_OFF * values["fin.stop_angle"], 0.5 * values["command.limit"]))


def _released(values: Mapping[str, Any], inputs: Mapping[str, Any], points: int, run: Callable[..., Tables],
              command: float = 0.0, enable: float = 1.0) -> Mapping[str, Array]:
    """Return outputs of two fins, released to either side of the centre; `command` is a share of their angles."""
    sides = _off(values) * np.array([[1.0], [-1.0]])
    sets = [{**values, "fin.start_angle": angle, "command.resolution": 0.0} for angle in sides.flat]
    acting = {**inputs, fin_port.COMMAND.name: command * sides, fin_port.ENABLE.name: enable}
    return run(sets, acting, points).columns


def _apart(released: Mapping[str, Array]) -> Array:
    """Return half the distance [rad] of two fins, where it is finite: that both go to one side is a preload."""
    angles = released["fin_angle"]
    one, other = angles[:, np.isfinite(angles).all(axis=0)]
    apart: Array = np.abs(one - other) / 2.0
    return apart


def _in_vain(model: str) -> Iterator[str]:
    """Yield in words what a file declares in vain: parameters and inputs on which nothing, or no motion, depends.

    The port, capabilities and the extensions that need these may use what the actuator's equations do not.
    """
    base, _ = parts(model)
    actuator, used = get(base), codegen.used(base)
    assert actuator.source is not None  # only a user's is tried
    anywhere = {v.name for v in fin_port.PARAMETERS}.union(*used.values(), *(
        (*capabilities.NEEDED_VARIABLES[each], *capabilities.NEEDED_PARAMETERS[each]) for each in actuator.provides))
    for v in (*actuator.parameters, *actuator.further_inputs):
        if not anywhere & {v.name, identifier(v.name)}:
            yield (f"{declared_in(actuator.source, v.name)}: nothing depends on {v.name}; use it in an equation or a "
                   "rule, or leave it out")
    if not used["step"] & {"active", *(s.name for s in actuator.sampled_states)}:
        yield f"{actuator.source}: no motion depends on the reference of sample(); use u.reference in the plant"
    if actuator.supply and "supply" not in used["sample"] | used["step"]:
        yield (f"{actuator.source}: no motion depends on {actuator.supply.input.name}; limit the drive by "
               "inputs.supply of sample(), or u.supply of the plant, or leave supply out")


def _require_of_port(actuator: Actuator, x: Array, shown: Callable[[Array], Mapping[str, Value]]) -> None:
    """Raise EmcasError for outputs of the fin port that contradict states or each other, at a command of 0."""
    fin = ("fin_angle", "fin_rate")
    x = x + _MOVING * np.array([s.name in (*actuator.encoder, *fin) for s in actuator.states])
    outputs, states = shown(x), dict(zip((s.name for s in actuator.states), x.tolist(), strict=True))
    expected = {name: states[name] for name in fin if name in states} | {"tracking_error": -outputs["fin_angle"]}
    for name, value in expected.items():
        if abs(outputs[name] - value) > _ROUNDING * _MOVING:  # false for what is not finite
            raise EmcasError(f"{of_function(actuator, 'outputs')} returns {name} = {outputs[name]:.4g} where it is "
                             f"{value:.4g}; leave it out: the fin port has it")


def _starts_elsewhere(actuator: Actuator, values: Mapping[str, Any], inputs: Mapping[str, float], run: Run) -> str:
    """Return in words that a fin does not start at its angle, or leaves it or is at a limit when commanded to stay;
    "" otherwise.
    """
    held = _released(values, inputs, _STEP, run, command=1.0)
    off, begun, apart = _off(values), held["fin_angle"][0, 0], _apart(held)
    if abs(begun - off) > _ELSEWHERE * off:
        return (f"fin_angle starts at {degrees(begun):.3g} deg for fin.start_angle = {degrees(off):.3g} deg; let "
                "initial() set the states from start.fin_angle")
    farthest = float(np.max(np.abs(apart - off), initial=0.0))
    driven = not values.get("homing.required") and (actuator.supply is None or _supply(actuator, inputs) > 0.0)
    if driven and farthest > _LEAVES * off:
        return (f"fin_angle leaves fin.start_angle = {degrees(off):.3g} deg by {degrees(farthest):.3g} deg, though "
                "commanded to stay; let initial() set every angle, such as the motor's, from start.fin_angle")
    if driven and (held["saturated"][:, 1:] == 1.0).all():  # no sample has acted at the first point
        return ("saturated is true all the time, though fin_angle is commanded to stay; `limited` of sample() is above "
                "0 at a limit, otherwise 0")
    return ""


def _supply(actuator: Actuator, inputs: Mapping[str, float]) -> float:
    return inputs[actuator.supply.input.name] if actuator.supply else 0.0


def _of_table(actuator: Actuator, values: Mapping[str, Any], error: TableError) -> EmcasError:
    """Return an error of a table whose points do not rise, with its line and, if its points are parameters, its name.
    """
    assert actuator.source is not None
    p, arrays = actuator.namespace(values), (v.name[:-3] for v in actuator.parameters if v.name.endswith("[0]"))
    name = next((name for name in arrays if value_of(p, name) == tuple(error.points)), None)
    remedy = f"; {name}: refuse such values by rules=(em.rising({name!r}, {len(error.points)}),)" if name else ""
    return EmcasError(f"{refusal(error, actuator.source)}{remedy}")


def _traced(watched: Actuator, values: Mapping[str, Any], model: str) -> Functions:
    """Return the functions of the traced program; before each of its steps runs that of a `watched` copy."""
    k = [name for name, _, _ in codegen.functions(watched)].index("step")
    watch = diagnosis.functions(values, model, actuator=watched, follow=False)[k]
    program = codegen.bound(values, model)

    def step(*arguments: float) -> tuple[Any, ...]:
        watch(*arguments)
        return program[k](*arguments)

    return (*program[:k], step, *program[k + 1:])


def _watched(actuator: Actuator, step: SwitchedStep, moves: bool) -> Actuator:
    """Return a copy whose step raises EmcasError for an event margin that stays below 0.

    Unless it `moves`, the step changes no state.
    """
    assert actuator.source is not None
    source = actuator.source
    below: Counter[str] = Counter()

    def watched(ops: Ops, p: Any, x: Record, u: Record, h: Value) -> tuple[Mapping[str, Value], Value]:
        try:
            built = step.as_built(ops, p)
            step.system.check(ops, built, step.system.begun(ops, built, x, u, h)[0], u)
        except EmcasError as error:
            kind, name = re.match(r"(\w+)(?: of)? (\w+)", str(error)).groups()  # type: ignore[union-attr]  # of every one
            raise EmcasError(f"{declared_in(source, name, kind)}: {error}") from error
        for name, margin in step.margins(ops, p, x, u, h).items():
            below[name] = below[name] + 1 if margin < _BELOW else 0
            if below[name] == _IN_A_ROW:
                raise EmcasError(f"{location(step.system.margins)}: {name} = {margin:.3g} is below 0 in {_IN_A_ROW} "
                                 "steps in a row; a margin is above 0 while its mode holds, and 0 at the event: change "
                                 "its sign, or the mode")
        return step(ops, p, x, u, h) if moves else ({s.name: getattr(x, s.name) for s in actuator.states}, h)

    return replace(actuator, step=watched)


def _at_rest(actuator: Actuator, values: Mapping[str, Any], inputs: Mapping[str, float]
             ) -> tuple[Array, Callable[..., Array], Callable[[Array], Mapping[str, Value]]]:
    """Return the states at rest while disabled, and functions for d/dt and for outputs at a command of 0.

    Their arguments are states; those of d/dt also an aerodynamic moment [N.m], and whether the drive is enabled.
    """
    assert actuator.source is not None  # only a user's is tried
    ops, of_file = LocatedFloats(actuator.source), partial(located, path=actuator.source)
    p = actuator.namespace({name: of_file(value) for name, value in values.items()})
    start, names = actuator.start(ops, p, of_file(0.0), of_file(0.0)), [s.name for s in actuator.states]
    acting = {**{s.name: start[s.name] for s in actuator.sampled_states}, **dict.fromkeys((*LOADS, "reference"), 0.0),
              "supply": _supply(actuator, inputs),
              **{identifier(v.name): inputs[v.name] for v in actuator.acting_inputs}}

    def inputs_at(aero_torque: float, enabled: bool) -> PlantInputs:
        return PlantInputs(**{name: of_file(value) for name, value in {**acting, "aero_torque": aero_torque}.items()},
                           enabled=enabled, rated_current_limit=None)

    def named(at: Array) -> Record:
        return Record(**dict(zip(names, map(of_file, at.tolist()), strict=True)))

    def rates(at: Array, aero_torque: float = 0.0, enabled: bool = False) -> Array:
        found = actuator.rates(ops, p, named(at), inputs_at(aero_torque, enabled))
        return np.array([float(found[name]) for name in names])

    begun = vars(actuator.begun(ops, p, Record(**start), inputs_at(0.0, False)))
    return np.array([float(begun[name]) for name in names]), rates, lambda at: actuator.plant_outputs(
        ops, p, named(at), inputs_at(0.0, False))


def _unloaded(names: Sequence[str], x: Array, rates: Callable[..., Array]) -> str:
    """Return in words that the hinge moment does not accelerate a moving fin its way; "" if it does.

    Only a fin_rate that is a state is tried.
    """
    if "fin_rate" not in names:
        return ""
    fin = names.index("fin_rate")
    moving = x + _MOVING * np.eye(len(x))[fin]  # dry friction does not hold it
    up, down = (np.array([rates(moving, torque, enabled)[fin] for enabled in (False, True)]) for torque in (1.0, -1.0))
    if not np.isfinite([up, down]).all():
        return ""  # the simulation says where
    if (up == down).all():  # a brake may hold it while disabled
        return "d(fin_rate)/dt does not depend on aero_torque; add em.fin_port.hinge_torque to the torques on the fin"
    if (up < down).any():
        return "d(fin_rate)/dt falls with aero_torque; check the sign of em.fin_port.hinge_torque"
    return ""


def _unstable(names: Sequence[str], x: Array, rates: Callable[..., Array]) -> str:
    """Return in words a state that grows by the derivatives at rest while disabled; "" if there is none.

    It grows where the actuator starts and at the equilibrium next to it, which Newton's steps approach.
    """
    if not _grows(names, _jacobian(x, rates)):
        return ""
    scale = 1.0 + np.abs(x)
    for _ in range(_NEWTON):
        jacobian, residual = _jacobian(x, rates), rates(x)
        if not np.isfinite(jacobian).all():
            return ""  # the simulation says where
        x = x - scale * np.linalg.lstsq(jacobian * scale / scale[:, np.newaxis], residual / scale, rcond=_SINGULAR)[0]
    return _grows(names, _jacobian(x, rates))


def _jacobian(x: Array, rates: Callable[..., Array]) -> Array:
    """Return the derivatives of `rates` by the states `x`, without rounding."""
    differences, before = np.diag(_DIFFERENCE * (1.0 + np.abs(x))), rates(x)[:, np.newaxis]
    after = np.stack([rates(x + difference) for difference in differences], axis=1)
    with np.errstate(invalid="ignore"):  # where they are not finite
        changes: Array = after - before
    changes[np.abs(changes) <= _ROUNDING * (np.abs(after) + np.abs(before))] = 0.0
    return changes / np.diag(differences)


def _grows(names: Sequence[str], jacobian: Array) -> str:
    """Return in words a state that grows by the derivatives; "" if there is none, or they are not finite."""
    if not np.isfinite(jacobian).all():
        return ""  # the simulation says where
    for name, own in zip(names, np.diag(jacobian), strict=True):
        if own > 0.0:
            return f"d({name})/dt rises with {name}, by {own:.3g} 1/s: it drives itself"
    growth, modes = np.linalg.eig(jacobian)
    fastest = int(np.argmax(growth.real))
    if growth[fastest].real <= _GROWTH:
        return ""
    most = names[int(np.argmax(np.abs(modes[:, fastest])))]
    return f"the states grow without bound while disabled, e-fold in {1.0 / growth[fastest].real:.3g} s, most {most}"


def _moved(values: Mapping[str, Any], inputs: Mapping[str, float], run: Callable[..., Tables], *commands: float
           ) -> Mapping[str, Array]:
    """Return how the fin moves under each of two commands [rad], from rest and without load."""
    under = {**inputs, fin_port.COMMAND.name: np.array([commands]).T}
    return run([values, values], under, _STEP).columns


def _differ(moved: Mapping[str, Array]) -> bool:
    """Return whether the fin moves in two ways."""
    one, other = moved["fin_angle"]
    return not np.array_equal(one, other, equal_nan=True)


def _moves_away(values: Mapping[str, Any], inputs: Mapping[str, float], points: int, run: Run) -> str:
    """Return in words that a fin that is released beside its centre does not stay near it; "" if it does."""
    off = _off(values)
    for enable, drive in ((0.0, "disabled"), (1.0, "enabled")):
        apart = _apart(_released(values, inputs, points, run, enable=enable))
        if (farthest := float(np.max(apart, initial=0.0))) > _AWAY * off:
            return f"fin_angle grows from {degrees(off):.2g} to {degrees(farthest):.2g} deg while {drive}"
    return ""
