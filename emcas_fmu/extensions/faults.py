"""Faults of an actuator, switched while running or scheduled, and a built-in test that looks for them.

A fault begins and ends with a sample of the controllers (:mod:`emcas_fmu.extensions.fault_list`). Without one the
trajectories are those of the actuator, bit for bit. What the encoder counts is

    seen = angle + offset + bias        offset += gain (moved - share max(moved, 0)) - moved

with `moved` since the sample before, gain 0 while it is frozen and -1 reversed, and a share of the counts of positive
motion dropped: motion that was missed stays missed, as in an incremental encoder. A jam holds the rotor; with an
elastic drive line the fin may still give. A broken shaft (:mod:`emcas_fmu.physics.free_fin`) and a grown gap do not
heal: they last until reset. The faults of its kind that an actuator declares
(:class:`emcas_fmu.actuators.declaration.PlantFault`) are other values of the plant's parameters, from the sample with
which they begin; how much of them there is may change between samples.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Acting, Actuator, Asked, State, Values, with_outputs
from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..physics import free_fin, kinematics
from ..physics.loads import NONE
from ..rules import SLACK, Rule, when
from ..variables import Variable, integer_output
from . import fault_list, monitors
from .declaration import Extension
from .fault_effects import SOUND, Held, acting, at_line, blocked, faulted, standing
from .status import DISABLED, OPERATIONAL, STATUS


def _word(name: str, description: str, bits: tuple[str, ...]) -> Variable:
    listed = ", ".join(f"{2**i} {bit}" for i, bit in enumerate(bits))
    return integer_output(name, f"{description}, a bit each: {listed}", bits)


FAULT_WORD = "fault_word"
BUILT_IN_TEST = _word("built_in_test", "monitors tripped", tuple(monitor.name for monitor in monitors.MONITORS))
_BROKEN = (State("fin_broken_off"), State("broken_fin_angle", "rad"), State("broken_fin_rate", "rad/s"))
_HELD = tuple(f"fault_{name}" for name in Held._fields)
_WAITING = tuple(f"command_{i + 1}_ago" for i in range(fault_list.LONGEST_COMMAND_DELAY))


class _Kept(NamedTuple):
    """What samples keep: their number; of the last the encoder's angle and offset, command, angle, modelled angle."""

    samples: Value
    angle: Value
    offset: Value
    command: Value
    measured: Value
    modelled: Value


_KEPT = tuple(f"last_{name}" for name in _Kept._fields)


def _fin(ops: Ops, p: Any, motor: Value) -> Value:
    return kinematics.fin_angle(ops, p, kinematics.lever_tangent(ops, p, motor))


def _picked(ops: Ops, samples: Value, values: Sequence[Value]) -> Value:
    """Return the value that was so many samples ago; `values` from now on back."""
    chosen = values[-1]
    for i in reversed(range(len(values) - 1)):
        chosen = ops.where(samples < i + 0.5, values[i], chosen)
    return chosen


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with faults and monitors; see the module's docstring."""
    has = actuator.provides.__contains__
    geared = has(capabilities.SCREW_DRIVE)  # its encoder may sit on motor or fin, and its fin may break off
    faults, watched, bits = fault_list.general(actuator), monitors.possible(actuator), fault_list.bits(actuator)
    of_kind = {fault.name: f"plant_fault_{fault.name}" for fault in actuator.faults}  # whether each acts, a state
    has_status = STATUS in actuator.outputs
    angle_name, rate_name = actuator.encoder
    counters, flags = (tuple(f"{monitor.name}_{kind}" for monitor in watched) for kind in ("counter", "flag"))

    def encoder(ops: Ops, p: Any, angle: Value) -> Value:
        """Return what the encoder of position turns with, motor or fin, at the state of angle that it reads [rad]."""
        return ops.where(p.encoder.on_fin, _fin(ops, p, angle), angle) if geared else angle

    def read(ops: Ops, p: Any, counted: Value, bias: Value) -> Value:
        """Return the angle [rad] that an encoder's counts mean, and too much by `bias` [rad] of the fin."""
        if not geared:
            return counted + bias
        fin = ops.where(p.encoder.on_fin, counted, _fin(ops, p, counted)) + bias
        at_motor = kinematics.motor_angle(ops, p, fin)
        return ops.where(ops.both(ops.equal(bias, 0.0), ops.negate(p.encoder.on_fin)), counted, at_motor)

    def initial(ops: Ops, p: Any, start: Record) -> Values:
        begun = actuator.start(ops, p, start.fin_angle, start.encoder_offset)
        measured = begun["measured_fin_angle"]
        turned = encoder(ops, actuator.plant_parameters(ops, p), actuator.position(ops, p, Record(**begun)))
        kept = _Kept(0.0, turned, 0.0, p.fin.start_angle, measured, measured)
        return {**begun, **dict(zip(_KEPT, kept, strict=True)), **dict.fromkeys(_WAITING, p.fin.start_angle),
                **dict(zip(_HELD, SOUND, strict=True))}

    def held(u: Acting | Record) -> Held:
        return Held(*(getattr(u, name) for name in _HELD))

    def declared(u: Acting | Record) -> dict[str, Value]:
        return {name: getattr(u, state) for name, state in of_kind.items()}

    def sample(ops: Ops, p: Any, x: Record, asked: Asked) -> Values:
        q = actuator.equation_parameters(ops, p)
        k, before = _Kept(*(getattr(x, name) for name in _KEPT)), held(x)
        line = [getattr(x, name) for name in _WAITING]
        time = k.samples * p.controller.sample_time
        there = fault_list.active(ops, p, faults, time)
        on = {**{fault.name: False for fault in fault_list.FAULTS}, **there}
        kinds = fault_list.active(ops, p, actuator.faults, time)
        for fault in actuator.faults:
            if fault.lasting:
                kinds[fault.name] = ops.either(kinds[fault.name], getattr(x, of_kind[fault.name]) > 0.0)

        plant = actuator.plant_parameters(ops, p)
        angle, speed = encoder(ops, plant, asked.position), getattr(x, rate_name)
        off = ops.both(x.fin_broken_off > 0.0, plant.encoder.on_fin) if geared else False
        if geared:
            angle = ops.where(off, x.broken_fin_angle, angle)
        moved = angle - k.angle
        gain = ops.where(on["encoder_freeze"], 0.0, ops.where(on["encoder_reversed"], -1.0, 1.0))
        missed = ops.where(on["encoder_dropped"], p.fault.encoder_dropped.share, 0.0)
        offset = k.offset + (gain * (moved - missed * ops.maximum(moved, 0.0)) - moved)
        counting = gain * (1.0 - ops.where(speed > 0.0, missed, 0.0))
        wrong = ops.either(ops.either(on["encoder_bias"], ops.negate(ops.equal(offset, 0.0))), off)
        bias = ops.where(on["encoder_bias"], p.fault.encoder_bias.angle, 0.0)
        # Where nothing is wrong the angle goes through as it is, to the bit.
        (seen,) = ops.branch(wrong, lambda: (read(ops, plant, angle + offset, bias),), lambda: (asked.position,))
        # The motor's encoder counts the speed: one on the fin takes no part in that.
        turned = {angle_name: seen, rate_name: counting * speed}
        if geared:
            turned = {name: ops.where(plant.encoder.on_fin, getattr(x, name), counted)
                      for name, counted in turned.items()}

        late = ops.floor(p.fault.command_delay.time / p.controller.sample_time + 0.5)
        arriving = ops.where(on["command_delay"], _picked(ops, late, (asked.command, *line)), asked.command)
        command = ops.where(on["command_freeze"], k.command, arriving)

        def amount(fault: str, name: str, without: float) -> Value:
            """Return how much of a fault acts, `without` where it does not."""
            return without if on[fault] is False else ops.where(on[fault], getattr(getattr(p.fault, fault), name),
                                                                without)

        now = Held(
            0.0, ops.where(on["jam"], 1.0, 0.0),
            ops.where(ops.either(on["free_fin"], before.free > 0.0), 1.0, 0.0) if geared else 0.0,
            ops.where(on["drive_loss"], 1.0, 0.0),
            amount("current_derating", "share", 1.0),
            amount("brown_out", "share", 1.0),
            amount("friction_rise", "factor", 1.0),
            ops.maximum(before.gap, amount("backlash_growth", "gap", 0.0)) if has(capabilities.BACKLASH) else 0.0,
            0.0, 0.0, 0.0)
        of_plant = ("jam", "free_fin", "drive_loss", "current_derating", "brown_out", "friction_rise")
        acts = ops.either(before.free > 0.0, now.gap > 0.0)
        for name in of_plant:
            acts = ops.either(acts, on[name])
        for kind in kinds.values():
            acts = ops.either(acts, kind)
        lasting = {"free_fin": now.free > 0.0, "backlash_growth": now.gap > 0.0}  # for good
        shown = {**there, **{name: still for name, still in lasting.items() if name in there}, **kinds}

        supply = now.supply * asked.supply
        given = actuator.sampled(ops, p, x.replace(**turned),
                                 asked.replace(command=command, supply=supply, position=seen))
        reference = given["reference"]
        if any(fault.name == "hard_over" for fault in faults):
            full = p.drive.reference_limit if has(capabilities.REFERENCE_LIMIT) else p.fin.stop_angle
            reference = ops.where(ops.both(on["hard_over"], asked.enable), p.fault.hard_over.share * full, reference)

        # An actuator that is not in closed loop follows no command.
        here = Record(reference=0.0, **vars(NONE), supply=supply, enabled=asked.enable, rated_current_limit=None,
                      **{v.name: 0.0 for v in actuator.acting_inputs},
                      **{s.name: given[s.name] for s in actuator.sampled_states})
        watching = ops.both(asked.enable, ops.equal(status(ops, p, x, here), OPERATIONAL))
        current = actuator.motor_current(ops, p, x, here) if has(capabilities.MOTOR_CURRENT) else 0.0
        seen_by = monitors.Watched(
            command, given["measured_fin_angle"], k.measured, k.modelled, reference, current, supply, watching)
        response = monitors.response(p, actuator)
        counted, tripped = monitors.judged(
            ops, q, watched, response, [getattr(x, name) for name in counters], [getattr(x, name) for name in flags],
            seen_by)
        now = now._replace(acting=ops.where(acts, 1.0, 0.0), faults=fault_list.word(ops, bits, shown),
                           built_in_test=monitors.word(watched, tripped), verdict=monitors.verdict(ops, tripped))
        kept = _Kept(k.samples + 1.0, angle, offset, command, given["measured_fin_angle"],
                     monitors.modelled(ops, p, response, seen_by))
        return {**given, "reference": reference, **dict(zip(_KEPT, kept, strict=True)),
                **dict(zip(counters, counted, strict=True)), **dict(zip(flags, tripped, strict=True)),
                **dict(zip(_WAITING, (asked.command, *line[:-1]), strict=True)), **dict(zip(_HELD, now, strict=True)),
                **{of_kind[name]: ops.where(kind, 1.0, 0.0) for name, kind in kinds.items()}}

    def status(ops: Ops, p: Any, x: Record, u: Acting) -> Value:
        """Return what the actuator says of itself where it is sound; the bridge open by a fault is unknown to it."""
        return actuator.plant_outputs(ops, p, x, u)[STATUS.name] if has_status else OPERATIONAL

    def step(ops: Ops, p: Any, x: Record, u: Acting, h: Value) -> tuple[Values, Value]:
        f = held(u)
        names = [s.name for s in actuator.states]
        broken = [s.name for s in _BROKEN] if geared else []

        def sound() -> tuple[Value, ...]:
            moved, used = actuator.step(ops, p, x, u, h)
            return *({**vars(x), **moved}[name] for name in (*names, *broken)), used

        def faulty() -> tuple[Value, ...]:
            jam = f.jam > 0.0
            q = actuator.plant_parameters(ops, p)
            begun = standing(ops, actuator, x, jam)
            under, around = blocked(ops, faulted(ops, q, actuator, f, declared(u)), actuator,
                                    acting(ops, p, actuator, f, u), jam)
            moved, used = actuator.step(ops, under, begun, around, h)
            after = standing(ops, actuator, begun.replace(**moved), jam, begun)
            free = ops.branch(f.free > 0.0, lambda: floating(q, used), lambda: (0.0, 0.0, 0.0)) if geared else ()
            return *(getattr(after, name) for name in names), *free, used

        def floating(q: Any, used: Value) -> tuple[Value, ...]:
            rubbing = with_values(q, {"friction.fin_viscous": f.friction * q.friction.fin_viscous,
                                      "friction.fin_coulomb": f.friction * q.friction.fin_coulomb})
            now = actuator.plant_outputs(ops, p, x, u)
            whole = ops.equal(x.fin_broken_off, 0.0)
            return 1.0, *free_fin.advance(ops, rubbing, ops.where(whole, now["fin_angle"], x.broken_fin_angle),
                                          ops.where(whole, now["fin_rate"], x.broken_fin_rate), u, used)

        *moved, used = ops.branch(f.acting > 0.0, faulty, sound)
        return dict(zip((*names, *broken), moved, strict=True)), used

    def output_values(ops: Ops, p: Any, x: Record, u: Acting) -> Values:
        f = held(u)
        q = actuator.plant_parameters(ops, p)
        under, around = faulted(ops, q, actuator, f, declared(u)), acting(ops, p, actuator, f, u)
        outputs = dict(actuator.output_values(ops, under, x, around))
        if actuator.supply is not None:
            name = actuator.supply.power.name
            outputs[name] = at_line(ops, f, outputs[name])
        if geared:
            outputs |= off_shaft(ops, q, x, u, outputs)
        verdict = ops.where(u.enabled, f.verdict, DISABLED)
        if has_status:
            known = status(ops, p, x, u)
            verdict = ops.where(ops.equal(known, OPERATIONAL), verdict, known)
        return {**outputs, STATUS.name: verdict, FAULT_WORD: f.faults, BUILT_IN_TEST.name: f.built_in_test}

    def off_shaft(ops: Ops, q: Any, x: Record, u: Acting, outputs: Values) -> Values:
        """Return the outputs that are of a fin that is broken off, where it is."""
        fin, broken = x.broken_fin_angle, x.fin_broken_off > 0.0
        values = {
            "fin_angle": fin, "fin_rate": x.broken_fin_rate,
            "tracking_error": fin_port.clipped_command(ops, q, u.command) - fin,
            "hinge_torque": free_fin.moment(ops, q, fin, u),
            "at_stop": ops.fabs(fin) >= fin_port.stop_edge(q),
        }
        return {name: ops.where(broken, value, outputs[name]) for name, value in values.items()}

    return replace(
        actuator, states=(*actuator.states, *(_BROKEN if geared else ())),
        controller_states=(*actuator.controller_states, *map(State, (*_KEPT, *counters, *flags, *_WAITING))),
        sampled_states=(*actuator.sampled_states, *map(State, (*_HELD, *of_kind.values()))),
        outputs=with_outputs(actuator.outputs, (STATUS, _word(FAULT_WORD, "faults active", bits), BUILT_IN_TEST)),
        initial=initial, sample=sample, step=step, output_values=output_values)


def _parameters(actuator: Actuator) -> tuple[Variable, ...]:
    faults = fault_list.possible(actuator)
    return (*(v for fault in faults for v in fault_list.parameters(fault)), *monitors.parameters(actuator))


def _command_delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    """Check a delay that is switched on or scheduled; others may wait for a longer sample time."""
    late, period = p.fault.command_delay, p.controller.sample_time
    used = ops.either(late.active, late.end > late.begin)
    longest = fault_list.LONGEST_COMMAND_DELAY * period * (1.0 + SLACK)
    return when(ops, ops.both(used, late.time > longest)), late.time, period


RULES = (Rule(_command_delay, "fault.command_delay.time = %.6g s must be at most "
                              f"{fault_list.LONGEST_COMMAND_DELAY} times controller.sample_time = %.6g s"),)
EXTENSION = Extension("faults", "faults and built-in test", extend, parameters=_parameters,
                      rules=lambda actuator: RULES, module=sys.modules[__name__])
