"""The trial of a user's actuator before its first simulation, for mistakes that would silently give wrong numbers."""

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
from ..support.progress import announce
from . import codegen, contradictions, diagnosis
from .compiled import Array, Tables
from .core import Functions

_INTERVAL = 1e-3  # s between points of time
_SHORT = 50  # points of time of a short run
# Angle at which the fin is released, as a share of the stop angle; a fin beyond this multiple of the angle moves away.
_OFF, _AWAY = 0.02, 5.0
_LEAVES = 0.5  # share of its angle by which a fin that is commanded to stay may leave it
_ELSEWHERE = 0.01  # share of its angle by which a fin may start elsewhere: kinematics may be solved approximately
# An event margin below this value at the start of this number of steps in a row is wrong.
_BELOW, _IN_A_ROW = -1e-9, 10
# Relative difference of a state for the Jacobian, and relative error of derivatives and outputs by rounding.
_DIFFERENCE, _ROUNDING = 1e-6, 1e-8
_NEAR, _BEYOND = 0.9, 1.2  # start angle and command in the trial of command.limit, as shares of this limit
_MOVING = 0.01  # rad, rad/s: offsets from rest at which outputs are compared and a load accelerates the fin
_GROWTH = 0.05  # 1/s, of an unstable mode; a slower growth may be rounding of the Jacobian
# Number of Newton's steps to an equilibrium; smallest relative singular value that is not due to rounding.
_NEWTON, _SINGULAR = 10, 1e-9

Runner = Callable[..., Tables]
_tried: set[str] = set()  # models tried in this process


def try_out(model: str, row: Array, inputs: Sequence[ArrayLike], points: int, run: Runner, by_floats: Runner) -> None:
    """Warn, once in a process, of mistakes in a user's actuator, such as wrong signs, wrong starts and ignored inputs.

    `row` contains its parameters; of its `inputs`, in SI, only the first values of the supply and of further inputs are
    used. A fin is released off centre and observed at `points` of time, 1 ms apart. `run` simulates as
    :func:`.compiled.run_tables`; `by_floats` also does, with a last argument that binds functions to parameters. Raises
    EmcasError for equations that cannot be traced, tables that do not rise, misused discontinuities, a state that no
    sample sets, counts without the offset of homing, outputs that contradict the fin port, and an event margin that is
    below 0 while its mode holds. Parameters that break a limit or rule are not tried.
    """
    actuator = get(model)
    if actuator.source is None or model in _tried:
        return
    codegen.traced(model=model)  # raises EmcasError with the line of an equation that cannot be computed
    values = dict(zip((v.name for v in actuator.parameters), row.tolist(), strict=True))
    if check_parameters(values, model):
        return
    at_rest = {v.name: float(np.asarray(x).flat[0]) for v, x in zip(actuator.inputs, inputs, strict=True)}
    at_rest |= dict.fromkeys((v.name for v in (fin_port.COMMAND, fin_port.AERO_TORQUE, *fin_port.VEHICLE_MOTION)), 0.0)
    base, extensions = parts(model)
    try:
        # Without the extensions, which set all their states.
        samples = contradictions.Samples(get(base), values, at_rest, _supply(actuator, at_rest))
        samples.require_all_set()
        if "homing" in extensions:
            samples.require_offset()
        x, rates, shown = _at_rest(actuator, values, at_rest)
        _require_of_port(actuator, x, shown)
        names = [s.name for s in actuator.states]
        unstable = _unstable(names, x, rates) if actuator.derivatives is not None else ""
    except TableError as error:
        raise _of_table(actuator, values, error) from error
    if isinstance(actuator.step, SwitchedStep) and not unstable:  # large values would be rounded
        stepping = {**at_rest, fin_port.COMMAND.name: 0.5 * values["command.limit"], fin_port.ENABLE.name: 1.0}
        for floats in (False, True):  # steps over floats take ten times as long, but their errors name the line
            watched = _watched(actuator, actuator.step, floats)
            bind = partial(diagnosis.functions, actuator=watched) if floats else partial(_traced, watched)
            with nullcontext() if floats else suppress(EmcasError):
                if not _run(by_floats, model, [values], stepping, _SHORT, bind).failures:
                    break
    simulated = partial(_run, run, model)
    for problem in (*_unused(model), *samples.problems(), *contradictions.at_rest(actuator, shown(x))):
        announce(problem)
    _tried.add(model)
    if actuator.derivatives is not None and (problem := _load_problem(names, x, rates)):
        announce(f"{actuator.source}: {problem}")
    limit = values["command.limit"]
    near = {**values, "fin.start_angle": _NEAR * limit}  # near the limit, where a drive does not saturate
    sound = not check_parameters(near, model)
    if sound:
        responses = _responses(near, {**at_rest, fin_port.ENABLE.name: 1.0}, simulated, limit, _BEYOND * limit)
        if _differ(responses) or samples.follows_beyond(_BEYOND):  # a slow fin does not reach the limit
            announce(f"{actuator.source}: fin_angle follows fin_command beyond command.limit; clip the command by "
                     "em.fin_port.clipped_command(ops, p, inputs.command)")
    if _differ(_responses(values, {**at_rest, fin_port.ENABLE.name: 0.0}, simulated, 0.0, 0.5 * limit)):
        announce(f"{actuator.source}: fin_angle follows fin_command while disabled; use inputs.enable in sample(), or "
                 "u.enabled in the plant")
    if problem := unstable or _moves_away(values, at_rest, points, simulated):
        announce(f"{actuator.source}: from rest, without command and load, {problem}; check the signs of stiffness, "
                 "damping, motor torque and control")
    elif problem := _starts_elsewhere(actuator, values, at_rest, simulated):
        announce(f"{actuator.source}: {problem}")
    elif sound:
        for problem in contradictions.moving(actuator, near, responses, _INTERVAL, not extensions):
            announce(problem)


def _run(run: Runner, model: str, sets: Sequence[Mapping[str, Any]], inputs: Mapping[str, float], points: int,
         *bind: Callable[..., Any]) -> Tables:
    rows = np.array([list(values.values()) for values in sets])
    columns = [np.broadcast_to(x, (*np.shape(x)[:-1], points)) for x in inputs.values()]
    return run(rows, columns, _INTERVAL, contradictions.outputs(get(model)), model, 1, (), 0.0, *bind)


def _off(values: Mapping[str, Any]) -> float:
    """Return the angle [rad] off centre at which a fin is released."""
    return float(min(_OFF * values["fin.stop_angle"], 0.5 * values["command.limit"]))


def _released(values: Mapping[str, Any], inputs: Mapping[str, Any], points: int, run: Callable[..., Tables],
              command: float = 0.0, enable: float = 1.0) -> Mapping[str, Array]:
    """Return outputs of two fins, released on either side of the centre; `command` is a share of their angles."""
    sides = _off(values) * np.array([[1.0], [-1.0]])
    sets = [{**values, "fin.start_angle": angle, "command.resolution": 0.0} for angle in sides.flat]
    acting = {**inputs, fin_port.COMMAND.name: command * sides, fin_port.ENABLE.name: enable}
    return run(sets, acting, points).columns


def _half_distance(released: Mapping[str, Array]) -> Array:
    """Return half the distance [rad] between two fins, where it is finite; a preload, which moves both, is left out."""
    angles = released["fin_angle"]
    one, other = angles[:, np.isfinite(angles).all(axis=0)]
    half: Array = np.abs(one - other) / 2.0
    return half


def _unused(model: str) -> Iterator[str]:
    """Yield messages about parameters and inputs in a user's file on which nothing, or no motion, depends.

    Variables of the port and of capabilities are left out: tools and extensions may use them.
    """
    base, _ = parts(model)
    actuator, used = get(base), codegen.used(base)
    assert actuator.source is not None  # only users' actuators are tried
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
               "inputs.supply in sample() or u.supply in the plant, or leave supply out")


def _require_of_port(actuator: Actuator, x: Array, shown: Callable[[Array], Mapping[str, Value]]) -> None:
    """Raise EmcasError for outputs of the fin port that contradict states or each other, at a command of 0."""
    fin = ("fin_angle", "fin_rate")
    x = x + _MOVING * np.array([s.name in (*actuator.encoder, *fin) for s in actuator.states])
    outputs, states = shown(x), dict(zip((s.name for s in actuator.states), x.tolist(), strict=True))
    expected = {name: states[name] for name in fin if name in states} | {"tracking_error": -outputs["fin_angle"]}
    for name, value in expected.items():
        if abs(outputs[name] - value) > _ROUNDING * _MOVING:  # false if a value is not finite
            raise EmcasError(f"{of_function(actuator, 'outputs')} returns {name} = {outputs[name]:.4g} instead of "
                             f"{value:.4g}; leave it out: the fin port has it")


def _starts_elsewhere(actuator: Actuator, values: Mapping[str, Any], inputs: Mapping[str, float], run: Runner) -> str:
    """Return a message if a fin, commanded to stay at its start angle, is elsewhere or always saturated; or ""."""
    staying = _released(values, inputs, _SHORT, run, command=1.0)
    off, start, half = _off(values), staying["fin_angle"][0, 0], _half_distance(staying)
    if abs(start - off) > _ELSEWHERE * off:
        return (f"fin_angle starts at {degrees(start):.3g} deg for fin.start_angle = {degrees(off):.3g} deg; let "
                "initial() set the states from start.fin_angle")
    farthest = float(np.max(np.abs(half - off), initial=0.0))
    driven = not values.get("homing.required") and (actuator.supply is None or _supply(actuator, inputs) > 0.0)
    if driven and farthest > _LEAVES * off:
        return (f"fin_angle leaves fin.start_angle = {degrees(off):.3g} deg by {degrees(farthest):.3g} deg, though "
                "commanded to stay; let initial() set every angle, such as the motor's, from start.fin_angle")
    if driven and (staying["saturated"][:, 1:] == 1.0).all():  # no sample has acted at the first point
        return ("saturated is always true, though fin_angle is commanded to stay; sample() must return limited = 0 "
                "where no limit acts")
    return ""


def _supply(actuator: Actuator, inputs: Mapping[str, float]) -> float:
    return inputs[actuator.supply.input.name] if actuator.supply else 0.0


def _of_table(actuator: Actuator, values: Mapping[str, Any], error: TableError) -> EmcasError:
    """Return the error for a table whose points do not rise, with its line and, if they are parameters, its name."""
    assert actuator.source is not None
    p, arrays = actuator.namespace(values), (v.name[:-3] for v in actuator.parameters if v.name.endswith("[0]"))
    name = next((name for name in arrays if value_of(p, name) == tuple(error.points)), None)
    remedy = f"; {name}: refuse such values by rules=(em.rising({name!r}, {len(error.points)}),)" if name else ""
    return EmcasError(f"{refusal(error, actuator.source)}{remedy}")


def _traced(watched: Actuator, values: Mapping[str, Any], model: str) -> Functions:
    """Return the functions of the traced program; each of its steps first calls the step of the `watched` copy."""
    k = [name for name, _, _ in codegen.functions(watched)].index("step")
    watch = diagnosis.functions(values, model, actuator=watched, follow=False)[k]
    program = codegen.bound_functions(values, model)

    def step(*arguments: float) -> tuple[Any, ...]:
        watch(*arguments)
        return program[k](*arguments)

    return (*program[:k], step, *program[k + 1:])


def _watched(actuator: Actuator, step: SwitchedStep, moves: bool) -> Actuator:
    """Return a copy whose step, which moves the states only if `moves`, checks discontinuities and event margins."""
    assert actuator.source is not None
    source = actuator.source
    below: Counter[str] = Counter()

    def watched(ops: Ops, p: Any, x: Record, u: Record, h: Value) -> tuple[Mapping[str, Value], Value]:
        try:
            built = step.as_built(ops, p)
            step.system.check(ops, built, step.system.begun(ops, built, x, u, h)[0], u)
        except EmcasError as error:
            # Every message matches.
            kind, name = re.match(r"(\w+)(?: of)? (\w+)", str(error)).groups()  # type: ignore[union-attr]
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
    """Return the states at rest while disabled, and functions for their derivatives and for outputs at a command of 0.

    The arguments for the derivatives are states, an aerodynamic moment [N.m] and whether the drive is enabled; for the
    outputs the states alone.
    """
    assert actuator.source is not None  # only users' actuators are tried
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
        by_name = actuator.rates(ops, p, named(at), inputs_at(aero_torque, enabled))
        return np.array([float(by_name[name]) for name in names])

    states = vars(actuator.begun(ops, p, Record(**start), inputs_at(0.0, False)))
    return np.array([float(states[name]) for name in names]), rates, lambda at: actuator.plant_outputs(
        ops, p, named(at), inputs_at(0.0, False))


def _load_problem(names: Sequence[str], x: Array, rates: Callable[..., Array]) -> str:
    """Return a message if a hinge moment does not accelerate a moving fin in the moment's direction; otherwise ""."""
    if "fin_rate" not in names:
        return ""
    fin = names.index("fin_rate")
    moving = x + _MOVING * np.eye(len(x))[fin]  # dry friction does not hold it
    up, down = (np.array([rates(moving, torque, enabled)[fin] for enabled in (False, True)]) for torque in (1.0, -1.0))
    if not np.isfinite([up, down]).all():
        return ""  # the simulation names the value
    if (up == down).all():  # a brake may hold it while disabled
        return "d(fin_rate)/dt does not depend on aero_torque; add em.fin_port.hinge_torque to the torques on the fin"
    if (up < down).any():
        return "d(fin_rate)/dt falls with aero_torque; check the sign of em.fin_port.hinge_torque"
    return ""


def _unstable(names: Sequence[str], x: Array, rates: Callable[..., Array]) -> str:
    """Return a message about a state that grows while disabled, at the start and at the nearest equilibrium; or ""."""
    if not _grows(names, _jacobian(x, rates)):
        return ""
    scale = 1.0 + np.abs(x)
    for _ in range(_NEWTON):  # Newton's method approaches the equilibrium
        jacobian, residual = _jacobian(x, rates), rates(x)
        if not np.isfinite(jacobian).all():
            return ""  # the simulation names the value
        x = x - scale * np.linalg.lstsq(jacobian * scale / scale[:, np.newaxis], residual / scale, rcond=_SINGULAR)[0]
    return _grows(names, _jacobian(x, rates))


def _jacobian(x: Array, rates: Callable[..., Array]) -> Array:
    """Return the derivatives of `rates` with respect to the states `x`; those within rounding are 0."""
    differences, before = np.diag(_DIFFERENCE * (1.0 + np.abs(x))), rates(x)[:, np.newaxis]
    after = np.stack([rates(x + difference) for difference in differences], axis=1)
    with np.errstate(invalid="ignore"):  # rates may be infinite
        changes: Array = after - before
    changes[np.abs(changes) <= _ROUNDING * (np.abs(after) + np.abs(before))] = 0.0
    return changes / np.diag(differences)


def _grows(names: Sequence[str], jacobian: Array) -> str:
    """Return a message about a state that grows by the `jacobian`; "" if none does, or the jacobian is not finite."""
    if not np.isfinite(jacobian).all():
        return ""  # the simulation names the value
    for name, rise in zip(names, np.diag(jacobian), strict=True):
        if rise > 0.0:
            return f"d({name})/dt rises with {name}, by {rise:.3g} 1/s: it drives itself"
    growth, modes = np.linalg.eig(jacobian)
    fastest = int(np.argmax(growth.real))
    if growth[fastest].real <= _GROWTH:
        return ""
    most = names[int(np.argmax(np.abs(modes[:, fastest])))]
    return (f"the states grow without bound while disabled, by a factor of e in {1.0 / growth[fastest].real:.3g} s, "
            f"{most} most of all")


def _responses(values: Mapping[str, Any], inputs: Mapping[str, float], run: Callable[..., Tables], *commands: float
           ) -> Mapping[str, Array]:
    """Return the outputs [commands, points] under two commands [rad], from rest and without load."""
    commanded = {**inputs, fin_port.COMMAND.name: np.array([commands]).T}
    return run([values, values], commanded, _SHORT).columns


def _differ(responses: Mapping[str, Array]) -> bool:
    one, other = responses["fin_angle"]
    return not np.array_equal(one, other, equal_nan=True)


def _moves_away(values: Mapping[str, Any], inputs: Mapping[str, float], points: int, run: Runner) -> str:
    """Return a message if a fin that is released off centre does not stay near the centre; otherwise ""."""
    off = _off(values)
    for enable, drive in ((0.0, "disabled"), (1.0, "enabled")):
        half = _half_distance(_released(values, inputs, points, run, enable=enable))
        if (farthest := float(np.max(half, initial=0.0))) > _AWAY * off:
            return f"fin_angle grows from {degrees(off):.2g} to {degrees(farthest):.2g} deg while {drive}"
    return ""
