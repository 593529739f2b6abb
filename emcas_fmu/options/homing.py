"""Homing on the hard stops: a drive with an incremental encoder finds out where its fin stands.

At power-on the controllers believe the fin at zero, wherever it is: their counts are the true ones plus an offset
that is -(those of fin.start_angle). A rising edge of `home` starts a run (:mod:`emcas_fmu.options.homing_run`):

    unreferenced -> seeking (one stop) -> crossing (to the other) -> returning (to zero) -> ready
                    any of them -> failed (not the travel there is, no way back, too late) or unreferenced (disabled)

Only a ready actuator follows its command. Unreferenced or failed, the drive's bridge is open, as it is while disabled,
whatever is on its way in the drive. The thesis (section 5.3.1, Figure 5.12) homes its actuator too; the steps are lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import radians
from typing import Any

from ..actuators.model import KEPT, Asked, Model, Sampled, Shown, State, Values, replaced, split
from ..integrate import Boundary
from ..ops.base import Ops, Value
from ..tree import changed
from ..variables import OUTPUTS, Variable
from . import homing_run as run
from .status import DISABLED, FAILED, HOMING, OPERATIONAL, STATUS, UNREFERENCED

TITLE = "homing on the hard stops"


def _own(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"homing.{name}", "Real", "parameter", "fixed", unit, description, minimum, maximum)


def _switch(name: str, description: str) -> Variable:
    return Variable(f"homing.{name}", "Boolean", "parameter", "fixed", "", description)


PARAMETERS = (
    _switch("required", "true: the start angle is not known and no command followed until homed; false: it is known"),
    _switch("positive_first", "true: the positive stop is sought first; false: the negative one"),
    _switch("verify", "true: the other stop is sought too, and the way between them judged; false: any stall is one"),
    _own("speed", "rad/s", radians(0.1), radians(100.0), "mean fin rate towards the stops and back"),
    _own("reference_limit", "V", 1e-3, 1e3, "largest DAC output while homing: the push against a stop"),
    _own("stall_time", "s", 1e-3, 10.0, "time at reference_limit without motion that makes a stall; also at zero, the "
         "time that ends the return"),
    _own("travel_tolerance", "rad", radians(1e-3), radians(20.0),
         "largest difference of the way between the stops from 2 fin.stop_angle"),
    _own("return_tolerance", "rad", radians(1e-3), radians(20.0), "largest angle from zero that ends the return"),
    _own("timeout", "s", 1e-2, 1e4, "longest homing run"),
)
HOME = Variable("home", "Boolean", "input", "discrete", "",
                "a rising edge while enabled and not homing starts a homing run", start=False)
HOMED = Variable("homed", "Boolean", "output", "discrete", "",
                 "the controllers know the fin's angle and follow the command when enabled")
PHASE = "homing phase"


def unfit(model: str, options: Sequence[str]) -> str:
    """Why it cannot be laid over a model: nothing if it can."""
    if model == "second-order":
        return "needs a motor that pushes against a stop; the second-order model has none"
    if model == "linear":
        return "needs a limit of the reference to tell a stall; the linear model has no limits"
    return ""


def extended(model: Model) -> Model:
    """`model` with the offset of its encoder, and the state machine that finds it, in front of its controllers."""
    kept = len(KEPT) + len(model.kept)

    def initial(ops: Ops, p: Any) -> tuple[State, Value]:
        state, _ = model.initial(ops, p)
        offset = ops.where(p.homing.required, -run.reading(ops, p, state), 0.0)
        state, measured = model.initial(ops, changed(p, {"encoder.offset": offset}))
        phase = ops.where(p.homing.required, run.UNKNOWN, run.READY)
        begun = run.Progress(offset, *(0.0,) * (len(run.Progress._fields) - 1))
        return State(state.plant, (*state.kept, 0.0, *begun), (*state.held, phase)), measured

    def sample(ops: Ops, p: Any, s: State, a: Asked) -> Sampled:
        inner_kept, (before, *progress) = s.kept[:kept], s.kept[kept:]
        inner_held, (phase,) = split(s.held, 1)
        inner_own, (home,) = split(a.own, 1)
        inner, asked = State(s.plant, inner_kept, inner_held), a._replace(own=inner_own)
        edge = ops.both(home, ops.negate(before))
        found = run.sample(ops, p, model, inner, asked, edge, phase, run.Progress(*progress))
        seen = found.sampled
        return seen._replace(kept=(*seen.kept, ops.where(home, 1.0, 0.0), *found.progress),
                             held=(*seen.held, found.phase))

    def powered(ops: Ops, held: Values, b: Boundary) -> tuple[Values, Value, Boundary]:
        inner_held, (phase,) = split(held, 1)
        return inner_held, phase, b._replace(enabled=ops.both(b.enabled, run.driven(ops, phase)))

    def step(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, h: Value) -> tuple[Values, Value]:
        inner_held, _, acting = powered(ops, held, b)
        return model.step(ops, p, plant, inner_held, acting, h)

    told = STATUS in model.outputs  # by an option below

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, s: Shown) -> Values:
        inner_held, phase, acting = powered(ops, held, b)
        values = model.put_out(ops, p, plant, inner_held, acting, s)
        ready = ops.equal(phase, run.READY)
        names = [v.name for v in OUTPUTS + model.outputs]
        well = values[names.index(STATUS.name)] if told else OPERATIONAL
        status = ops.where(ready, well, ops.where(
            run.moving(ops, phase), HOMING, ops.where(ops.equal(phase, run.FAILED), FAILED, UNREFERENCED)))
        status = ops.where(b.enabled, status, DISABLED)
        if told:
            return *replaced(model, values, {STATUS.name: status}), ready
        return *values, status, ready

    outputs = (*model.outputs, HOMED) if told else (*model.outputs, STATUS, HOMED)
    direct = dict(model.direct)
    direct[STATUS.name] = tuple(dict.fromkeys((*direct.get(STATUS.name, ()), "enable")))
    return replace(model, initial=initial, sample=sample, step=step, put_out=put_out,
                   kept=(*model.kept, "home before", *(f"homing {name}" for name in run.Progress._fields)),
                   held=(*model.held, PHASE), parameters=model.parameters + PARAMETERS,
                   inputs=(*model.inputs, HOME), outputs=outputs, direct=tuple(direct.items()))
