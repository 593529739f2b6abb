"""Faults on any model, switched while running or scheduled, and a built-in test that looks for them.

A fault begins and ends with a sample of the controllers (:mod:`emcas_fmu.options.fault_list`). Without one the
trajectories are those of the model, bit for bit. What the encoder counts is

    seen = angle + offset + bias        offset += gain (moved - share max(moved, 0)) - moved

with `moved` since the sample before, gain 0 while it is frozen and -1 reversed, and a share of the counts of positive
motion dropped: motion that was missed stays missed, as in an incremental encoder. A jam holds the rotor; with an
elastic drive line the fin may still give. A broken shaft (:mod:`emcas_fmu.physics.free_fin`) and a grown gap do not
heal: they last until reset.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from .. import control
from ..actuators.model import Asked, Model, Sampled, Shown, State, Values, replaced, split
from ..consistency import LONGEST_COMMAND_DELAY
from ..integrate import Boundary
from ..ops.base import Ops, Value
from ..physics import free_fin, kinematics
from ..tree import changed
from ..variables import OUTPUTS, Variable
from . import fault_list, monitors
from .fault_effects import SOUND, Held, faulted, standing, surroundings
from .status import DISABLED, OPERATIONAL, STATUS

TITLE = "faults and built-in test"
PARAMETERS = fault_list.PARAMETERS + monitors.PARAMETERS
WORDS = (
    Variable("fault_word", "Integer", "output", "discrete", "", "faults active, a bit each: "
             + ", ".join(f"{2**i} {fault.name}" for i, fault in enumerate(fault_list.FAULTS))),
    Variable("built_in_test", "Integer", "output", "discrete", "", "monitors tripped, a bit each: "
             + ", ".join(f"{2**i} {name}" for i, (name, _) in enumerate(monitors.MONITORS))),
)
_PLANT = ("fin broken off", "broken fin angle", "broken fin rate")


class _Kept(NamedTuple):
    """What samples keep: their number; of the last the encoder's angle and offset, command, angle, modelled angle."""

    samples: Value
    angle: Value
    offset: Value
    command: Value
    measured: Value
    modelled: Value


def unfit(model: str, options: tuple[str, ...]) -> str:
    """Nothing: faults may be laid over any model. What does nothing in one is told in docs/faults.md."""
    return ""


def _at_fin(model: Model) -> bool:
    """Whether a model's angle is the fin's, and its reference a command."""
    return model.plant[0] == "fin angle"


def _fin(ops: Ops, p: Any, motor: Value) -> Value:
    return kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, motor))


def _picked(ops: Ops, samples: Value, values: Values) -> Value:
    """The value that was so many samples ago; `values` from now on back."""
    found = values[-1]
    for i in reversed(range(len(values) - 1)):
        found = ops.where(samples < i + 0.5, values[i], found)
    return found


def extended(inner: Model) -> Model:
    """The model with faults and monitors; see the module's docstring."""
    volts = not _at_fin(inner)
    current = inner.plant.index("motor current") if "motor current" in inner.plant else None
    names = [v.name for v in OUTPUTS + inner.outputs]
    has_status = STATUS.name in names
    kept = (*_Kept._fields, *(f"{name} {kind}" for kind in ("counter", "flag") for name, _ in monitors.MONITORS),
            *(f"command {i + 1} ago" for i in range(LONGEST_COMMAND_DELAY)))

    def encoder(ops: Ops, p: Any, angle: Value) -> Value:
        """What an encoder turns with, the motor or the fin, at the model's first angle [rad]."""
        return ops.where(p.encoder.on_fin, _fin(ops, p, angle), angle) if volts else angle

    def read(ops: Ops, p: Any, counted: Value, bias: Value) -> Value:
        """The model's first angle [rad] that an encoder's counts tell, and too much by `bias` [rad] of the fin."""
        if not volts:
            return counted + bias
        fin = ops.where(p.encoder.on_fin, counted, _fin(ops, p, counted)) + bias
        at_motor = kinematics.motor_angle(ops, p, fin)
        return ops.where(ops.both(ops.equal(bias, 0.0), ops.negate(p.encoder.on_fin)), counted, at_motor)

    def initial(ops: Ops, p: Any) -> tuple[State, Value]:
        s, measured = inner.initial(ops, p)
        start = _Kept(0.0, encoder(ops, p, s.plant[0]), 0.0, p.fin.start_angle, measured, measured)
        waiting = (p.fin.start_angle,) * LONGEST_COMMAND_DELAY
        return State((*s.plant, 0.0, 0.0, 0.0), (*s.kept, *start, *(0.0,) * (2 * monitors.COUNT), *waiting),
                     (*s.held, *SOUND)), measured

    def sample(ops: Ops, p: Any, s: State, a: Asked) -> Sampled:
        plant, (broken, fin, _) = split(s.plant, len(_PLANT))
        inner_kept, own = split(s.kept, len(kept))
        inner_held, held = split(s.held, len(SOUND))
        first = len(_Kept._fields)
        k, before, watched = _Kept(*own[:first]), Held(*held), own[first:first + 2 * monitors.COUNT]
        counters, flags = watched[:monitors.COUNT], watched[monitors.COUNT:]
        line = own[first + 2 * monitors.COUNT:]
        on = fault_list.active(ops, p, k.samples * p.controller.sample_time)

        angle = encoder(ops, p, plant[0])
        if volts:
            angle = ops.where(ops.both(broken > 0.0, p.encoder.on_fin), fin, angle)
        moved = angle - k.angle
        gain = ops.where(on["encoder_freeze"], 0.0, ops.where(on["encoder_reversed"], -1.0, 1.0))
        missed = ops.where(on["encoder_dropped"], p.fault.encoder_dropped.share, 0.0)
        offset = k.offset + (gain * (moved - missed * ops.maximum(moved, 0.0)) - moved)
        counting = gain * (1.0 - ops.where(plant[1] > 0.0, missed, 0.0))
        wrong = ops.either(ops.either(on["encoder_bias"], ops.negate(ops.equal(offset, 0.0))),
                           ops.both(broken > 0.0, p.encoder.on_fin))
        bias = ops.where(on["encoder_bias"], p.fault.encoder_bias.angle, 0.0)
        # Where nothing is wrong the angle goes through as it is, to the bit.
        (seen,) = ops.branch(wrong, lambda: (read(ops, p, angle + offset, bias),), lambda: (plant[0],))

        late = ops.floor(p.fault.command_delay.time / p.controller.sample_time + 0.5)
        arriving = ops.where(on["command_delay"], _picked(ops, late, (a.command, *line)), a.command)
        command = ops.where(on["command_freeze"], k.command, arriving)

        now = Held(
            0.0, ops.where(on["jam"], 1.0, 0.0),
            ops.where(ops.either(on["free_fin"], before.free > 0.0), 1.0, 0.0),
            ops.where(on["drive_loss"], 1.0, 0.0),
            ops.where(on["current_derating"], p.fault.current_derating.share, 1.0),
            ops.where(on["brown_out"], p.fault.brown_out.share, 1.0),
            ops.where(on["friction_rise"], p.fault.friction_rise.factor, 1.0),
            ops.maximum(before.gap, ops.where(on["backlash_growth"], p.fault.backlash_growth.gap, 0.0)),
            0.0, 0.0, 0.0)
        of_plant = ("jam", "free_fin", "drive_loss", "current_derating", "brown_out", "friction_rise")
        acting = ops.either(before.free > 0.0, now.gap > 0.0)
        for name in of_plant:
            acting = ops.either(acting, on[name])
        on["free_fin"], on["backlash_growth"] = now.free > 0.0, now.gap > 0.0  # for good

        supply = now.supply * a.supply
        r = inner.sample(ops, p, State((seen, counting * plant[1], *plant[2:]), inner_kept, inner_held),
                         a._replace(command=command, supply=supply))
        full = p.drive.reference_limit if volts else p.fin.stop_angle
        reference = ops.where(ops.both(on["hard_over"], a.enable), p.fault.hard_over.share * full, r.reference)

        # An actuator that is not in closed loop follows no command.
        here = Boundary(0.0, 0.0, 0.0, 0.0, supply, a.enable)
        watching = ops.both(a.enable, ops.equal(status(ops, p, s.plant, r.held, here), OPERATIONAL))
        seen_by = monitors.Watched(
            command, r.measured, k.measured, k.modelled, reference if volts else None,
            None if current is None or hasattr(p, "pwm") else plant[current], supply, watching)
        counters, flags = monitors.judged(ops, p, counters, flags, seen_by)
        now = now._replace(acting=ops.where(acting, 1.0, 0.0), faults=fault_list.word(ops, on),
                           built_in_test=monitors.word(flags), verdict=monitors.verdict(ops, flags))
        keep = _Kept(k.samples + 1.0, angle, offset, command, r.measured, monitors.modelled(ops, p, seen_by))
        return Sampled(reference, (*r.kept, *keep, *counters, *flags, a.command, *line[:-1]), r.measured, r.limited,
                       (*r.held, *now))

    def status(ops: Ops, p: Any, plant: Values, inner_held: Values, b: Boundary) -> Value:
        """What the model says of itself where it is sound; the bridge open by a fault is unknown to it."""
        if not has_status:
            return OPERATIONAL
        inner_plant, _ = split(plant, len(_PLANT))
        found = inner.put_out(ops, p, inner_plant, inner_held, b, Shown(0.0, 0.0, 0.0, 0.0))
        return found[names.index(STATUS.name)]

    def step(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, h: Value) -> tuple[Values, Value]:
        inner_plant, own = split(plant, len(_PLANT))
        inner_held, told = split(held, len(SOUND))
        f = Held(*told)

        def sound() -> Values:
            moved, used = inner.step(ops, p, inner_plant, inner_held, b, h)
            return *moved, *own, used

        def faulty() -> Values:
            jam = f.jam > 0.0
            begun = standing(ops, p, inner, inner_plant, jam)
            moved, used = inner.step(ops, faulted(ops, p, f), begun, inner_held, surroundings(ops, f, b), h)
            moved = standing(ops, p, inner, moved, jam, begun)
            return *moved, *ops.branch(f.free > 0.0, lambda: floating(used), lambda: (0.0, 0.0, 0.0)), used

        def floating(used: Value) -> Values:
            mode, angle, rate = own
            rubbing = changed(p, {"friction.fin_viscous": f.friction * p.friction.fin_viscous,
                                  "friction.fin_coulomb": f.friction * p.friction.fin_coulomb})
            fin, fin_rate, *_ = inner.put_out(ops, p, inner_plant, inner_held, b, Shown(0.0, 0.0, 0.0, 0.0))
            whole = ops.equal(mode, 0.0)
            return 1.0, *free_fin.advance(ops, rubbing, ops.where(whole, fin, angle), ops.where(whole, fin_rate, rate),
                                          b.aero_torque, b.f_x, b.f_z, used)

        *moved, used = ops.branch(f.acting > 0.0, faulty, sound)
        return tuple(moved), used

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, s: Shown) -> Values:
        inner_plant, (mode, fin, rate) = split(plant, len(_PLANT))
        inner_held, told = split(held, len(SOUND))
        f = Held(*told)
        found = inner.put_out(ops, faulted(ops, p, f), inner_plant, inner_held, surroundings(ops, f, b), s)
        by_name = dict(zip(names, found, strict=True))
        broken = mode > 0.0
        values = {
            "fin_angle": fin, "fin_rate": rate,
            "tracking_error": control.clipped_command(ops, p, s.command) - fin,
            "hinge_torque": free_fin.moment(ops, p, fin, b.aero_torque, b.f_x, b.f_z),
            "at_stop": ops.fabs(fin) >= p.fin.stop_angle * (1.0 - 1e-12),
        }
        changes = {name: ops.where(broken, value, by_name[name]) for name, value in values.items()}
        verdict = ops.where(b.enabled, f.verdict, DISABLED)
        if has_status:
            known = status(ops, p, plant, inner_held, b)
            changes[STATUS.name] = ops.where(ops.equal(known, OPERATIONAL), verdict, known)
        return (*replaced(inner, found, changes), *(() if has_status else (verdict,)), f.faults, f.built_in_test)

    return replace(inner, plant=inner.plant + _PLANT, kept=inner.kept + kept, held=inner.held + Held._fields,
                   initial=initial, sample=sample, step=step, put_out=put_out,
                   parameters=inner.parameters + PARAMETERS,
                   outputs=inner.outputs + (() if has_status else (STATUS,)) + WORDS,
                   direct=(*inner.direct, (STATUS.name, ("enable",))))
