"""Faults of an actuator, switched during the run or scheduled, and a built-in test that may detect them.

A fault begins and ends with a sample of the controllers (:mod:`emcas_fmu.extensions.fault_list`). Without a fault the
trajectories are those of the actuator, bit for bit. The position sensor reads

    seen = angle + offset + bias        offset += gain (moved - share max(moved, 0)) - moved

`moved` is the motion since the last sample, `gain` is 0 while the sensor is frozen, -1 while it is reversed, else 1;
`share` is the lost part of the counts of positive motion, `bias` the excess of the reading. Motion that the sensor has
missed remains missing, as in an incremental encoder. A jam blocks the rotor; behind an elastic drive line the fin may
still move. A broken shaft (:mod:`emcas_fmu.physics.free_fin`) and a grown gap last until reset. Faults of the plant
change its parameters from the sample with which they begin; their amounts may change between samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import combinations, product, starmap
from typing import Any, NamedTuple

from ..actuators import capabilities, fin_port
from ..actuators.declaration import Actuator, PlantInputs, SampleInputs, State, Values
from ..namespace import Record, value_of, with_values
from ..ops.base import Ops, Value
from ..physics import free_fin, kinematics
from ..physics.loads import NONE
from ..rules import SLACK, Rule, rule, when
from ..variables import Variable, integer_output, with_outputs
from . import fault_list, monitors
from .declaration import Extension, also_read
from .fault_list import acting, at_line, blocked, faulted, returned_charge, share_of_supply, standing, without_loop
from .pole_pairs import one_motor
from .status import DISABLED, OPERATIONAL, STATUS


def _word(name: str, description: str, bits: tuple[str, ...]) -> Variable:
    listed = ", ".join(f"{2**i} {bit}" for i, bit in enumerate(bits))
    return integer_output(name, f"{description}, a bit each: {listed}", bits)


FAULT_WORD = "fault_word"
BUILT_IN_TEST = _word("built_in_test", "monitors tripped", tuple(monitor.name for monitor in monitors.MONITORS))
_BROKEN = (State("fin_broken_off"), State("broken_fin_angle", "rad"), State("broken_fin_rate", "rad/s"))
# Set by samples, for steps and outputs: 1 if a fault of the plant is active; values of the outputs.
_SAMPLED = (State("fault_acting"), State("fault_bits"), State("monitor_bits"),
            State("fault_verdict", start=OPERATIONAL))
_EARLIER_COMMANDS = tuple(f"command_{i + 1}_ago" for i in range(fault_list.LONGEST_COMMAND_DELAY))


class _LastSample(NamedTuple):
    """Number of `samples`, and values of the last one [rad]; `angle` and `offset` are those of the encoder."""

    samples: Value
    angle: Value
    offset: Value
    command: Value
    measured: Value
    modelled: Value


_LAST_SAMPLE = tuple(f"last_{name}" for name in _LastSample._fields)


def _picked(ops: Ops, samples: Value, values: Sequence[Value]) -> Value:
    """Return the value a number of samples ago, or the oldest one; `values` begin with the present value."""
    chosen = values[-1]
    for i in reversed(range(len(values) - 1)):
        chosen = ops.where(samples < i + 0.5, values[i], chosen)
    return chosen


def extend(actuator: Actuator) -> Actuator:
    """Return the actuator with faults and monitors."""
    faulty = _Faulty(actuator)
    word = _word(FAULT_WORD, "faults active", faulty.bits)
    sampled = (*_LAST_SAMPLE, *faulty.counters, *faulty.flags, *_EARLIER_COMMANDS)
    return replace(
        actuator, states=(*actuator.states, *faulty.broken),
        controllers_read=also_read(actuator, *faulty.read, "supply"),
        controller_states=(*actuator.controller_states, *map(State, sampled)),
        sampled_states=(*actuator.sampled_states, *_SAMPLED, *map(fault_list.state, faulty.of_plant),
                        *(State(amount.state) for amount in faulty.grown)),
        outputs=with_outputs(actuator.outputs, (STATUS, word, BUILT_IN_TEST)),
        initial=faulty.initial, sample=faulty.sample, step=faulty.step, output_values=faulty.output_values)


class _Faulty:
    """The functions of an actuator with faults and monitors; they call those of the `actuator`, which has neither."""

    def __init__(self, actuator: Actuator) -> None:
        self.actuator, self.has_status = actuator, STATUS in actuator.outputs
        # Behind a gear the encoder may be on motor or fin, and the fin may break off.
        self.geared = capabilities.SCREW_DRIVE in actuator.provides
        self.broken = _BROKEN if self.geared else ()
        self.faults, self.of_plant = fault_list.general(actuator), fault_list.of_plant(actuator)
        self.grown = fault_list.grown(self.of_plant)
        self.bits, self.watched = fault_list.bits(actuator), monitors.possible(actuator)
        # States that samples read: for the encoder, the monitors and a fin that has broken off.
        self.read = (actuator.encoder[1], *(s.name for s in actuator.states if s.name == "motor_current"),
                     *(s.name for s in self.broken))
        # Names of states: counter and flag of each monitor.
        self.counters, self.flags = (tuple(f"{monitor.name}_{kind}" for monitor in self.watched)
                                     for kind in ("counter", "flag"))

    def initial(self, ops: Ops, p: Any, start: Record) -> Values:
        """Return the states at the start, without a fault."""
        actuator = self.actuator
        at_rest = actuator.start(ops, p, start.fin_angle, start.encoder_offset)
        measured = at_rest["measured_fin_angle"]
        plant = actuator.plant_parameters(ops, p)
        encoder_angle = self._encoder(ops, plant, actuator.position(ops, p, Record(**at_rest)))
        last = _LastSample(0.0, encoder_angle, 0.0, p.fin.start_angle, measured, measured)
        return {**at_rest, **_named(_LAST_SAMPLE, last), **dict.fromkeys(_EARLIER_COMMANDS, p.fin.start_angle),
                **{s.name: s.start for s in _SAMPLED}}

    def sample(self, ops: Ops, p: Any, x: Record, inputs: SampleInputs) -> Values:
        """Return the result of a sample by name, with the states of faults and monitors."""
        actuator = self.actuator
        q = actuator.equation_parameters(ops, p)
        last, earlier_commands = _LastSample(*_of(x, _LAST_SAMPLE)), _of(x, _EARLIER_COMMANDS)
        time = last.samples * p.controller.sample_time
        active = fault_list.active(ops, p, x, (*self.faults, *actuator.faults), time)
        on = self._general(active)

        angle, offset, position, as_read = self._seen(ops, p, x, inputs, last, on)
        delay = ops.floor(self._amount(p, "command_delay", "time") / p.controller.sample_time + 0.5)
        arriving = ops.where(on["command_delay"], _picked(ops, delay, (inputs.command, *earlier_commands)),
                             inputs.command)
        command = ops.where(on["command_freeze"], last.command, arriving)

        supply = fault_list.share_of_supply(ops, p, on) * inputs.supply
        sampled = actuator.sampled(ops, p, x.replace(**as_read),
                                   inputs.replace(command=command, supply=supply, position=position))
        reference = sampled["reference"]
        if fault_list.has(actuator, "hard_over"):
            full = next(full(p) for kind, full in fault_list.FULL_REFERENCE.items() if kind in actuator.provides)
            reference = ops.where(ops.both(on["hard_over"], inputs.enable), p.fault.hard_over.share * full, reference)

        # The monitors are active only in closed loop.
        u = PlantInputs(reference=0.0, **vars(NONE), supply=supply, enabled=inputs.enable, rated_current_limit=None,
                        **{v.name: 0.0 for v in actuator.acting_inputs},
                        **{s.name: sampled[s.name] for s in actuator.sampled_states})
        watching = ops.both(inputs.enable, ops.equal(self._status(ops, p, x, u), OPERATIONAL))
        has_current = capabilities.MOTOR_CURRENT in actuator.provides
        measurements = monitors.Watched(
            command, sampled["measured_fin_angle"], last.measured, last.modelled, reference,
            actuator.motor_current(ops, p, x, u) if has_current else 0.0, supply, watching)
        modelled = monitors.modelled(ops, p, monitors.response(p, actuator), measurements)
        counted, tripped = monitors.judged(ops, q, self.watched, modelled, _of(x, self.counters), _of(x, self.flags),
                                           measurements)
        of_plant = {fault_list.state(fault).name: active[fault.name] for fault in self.of_plant}
        this = _LastSample(last.samples + 1.0, angle, offset, command, sampled["measured_fin_angle"], modelled)
        return {**sampled, "reference": reference, **_named(_LAST_SAMPLE, this), **_named(self.counters, counted),
                **_named(self.flags, tripped),
                **_named(_EARLIER_COMMANDS, (inputs.command, *earlier_commands[:-1])),
                **{name: ops.where(acts, 1.0, 0.0) for name, acts in of_plant.items()},
                **{state: ops.where(active[fault], ops.maximum(getattr(x, state), value_of(p, amount)), 0.0)
                   for fault, amount, state in self.grown},
                "fault_acting": ops.where(reduce(ops.either, of_plant.values()), 1.0, 0.0),
                "fault_bits": fault_list.word(ops, self.bits, active),
                "monitor_bits": monitors.word(self.watched, tripped), "fault_verdict": monitors.status(ops, tripped)}

    def step(self, ops: Ops, p: Any, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
        """Return the plant's states after `h` [s] or at the first event, and the time [s] until then."""
        actuator = self.actuator
        names, broken = [s.name for s in actuator.states], [s.name for s in self.broken]

        def sound() -> tuple[Value, ...]:
            moved, used = actuator.step(ops, p, x, u, h)
            return *({**vars(x), **moved}[name] for name in (*names, *broken)), used

        def faulty() -> tuple[Value, ...]:
            active = self._active(u)
            on = self._general(active)
            q, jam = self._plant(ops, p, u), on["jam"]
            begun = without_loop(ops, actuator, standing(ops, actuator, x, jam), on)
            under, around = blocked(ops, faulted(ops, q, actuator, on, active, begun, h), actuator,
                                    acting(ops, p, actuator, on, u), jam)
            moved, used = actuator.step(ops, under, begun, around, h)
            if "supply_charge" in moved:
                moved = {**moved, "supply_charge": returned_charge(
                    ops, share_of_supply(ops, p, on), x.supply_charge, moved["supply_charge"])}
            after = standing(ops, actuator, begun.replace(**moved), jam, begun)
            free = ops.branch(on["free_fin"], lambda: self._floating(ops, p, q, on, x, u, used),
                              lambda: (0.0, 0.0, 0.0)) if self.geared else ()
            return *_of(after, names), *free, used

        *moved, used = ops.branch(u.fault_acting > 0.0, faulty, sound)
        return _named((*names, *broken), moved), used

    def output_values(self, ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return the outputs, with those of faults and monitors."""
        actuator, active = self.actuator, self._active(u)
        q, on = self._plant(ops, p, u), self._general(active)
        under, around = faulted(ops, q, actuator, on, active, x, 0.0), acting(ops, p, actuator, on, u)
        outputs = dict(actuator.output_values(ops, under, without_loop(ops, actuator, x, on), around))
        if actuator.supply is not None:
            name = actuator.supply.power.name
            outputs[name] = at_line(ops, share_of_supply(ops, p, on), outputs[name])
        if self.geared:
            outputs |= _off_shaft(ops, q, x, u, outputs)
        verdict = ops.where(u.enabled, u.fault_verdict, DISABLED)
        if self.has_status:
            status = self._status(ops, p, x, u)
            verdict = ops.where(ops.equal(status, OPERATIONAL), verdict, status)
        return {**outputs, STATUS.name: verdict, FAULT_WORD: u.fault_bits, BUILT_IN_TEST.name: u.monitor_bits}

    def _amount(self, p: Any, fault: str, amount: str) -> Value:
        """Return an amount of a general fault; 0 if the actuator replaces the fault."""
        return value_of(p, f"fault.{fault}.{amount}") if fault_list.has(self.actuator, fault) else 0.0

    def _plant(self, ops: Ops, p: Any, u: PlantInputs) -> Any:
        """Return the parameters of the plant, with the amounts that have grown."""
        return with_values(self.actuator.plant_parameters(ops, p),
                           {amount: getattr(u, state) for _, amount, state in self.grown})

    def _encoder(self, ops: Ops, p: Any, angle: Value) -> Value:
        """Return the angle [rad] of the shaft with the encoder of position, from the actuator's `angle` [rad]."""
        return ops.where(p.encoder.on_fin, kinematics.fin_at(ops, p, angle), angle) if self.geared else angle

    def _read(self, ops: Ops, p: Any, counted: Value, bias: Value) -> Value:
        """Return the position [rad] as read for a `counted` angle [rad], with a `bias` [rad] of the fin angle."""
        if not self.geared:
            return counted + bias
        fin = ops.where(p.encoder.on_fin, counted, kinematics.fin_at(ops, p, counted)) + bias
        at_motor = kinematics.motor_angle(ops, p, fin)
        return ops.where(ops.both(ops.equal(bias, 0.0), ops.negate(p.encoder.on_fin)), counted, at_motor)

    def _seen(self, ops: Ops, p: Any, x: Record, inputs: SampleInputs, last: _LastSample, on: Mapping[str, Value],
              ) -> tuple[Value, Value, Value, Values]:
        """Return the encoder's angle and offset [rad], the position [rad] as read, and the states as read, by name."""
        plant = self.actuator.plant_parameters(ops, p)
        angle_name, rate_name = self.actuator.encoder
        angle, speed = self._encoder(ops, plant, inputs.position), getattr(x, rate_name)
        off = ops.both(x.fin_broken_off > 0.0, plant.encoder.on_fin) if self.geared else False
        if self.geared:
            angle = ops.where(off, x.broken_fin_angle, angle)
        moved = angle - last.angle
        gain = ops.where(on["encoder_freeze"], 0.0, ops.where(on["encoder_reversed"], -1.0, 1.0))
        missed = ops.where(on["encoder_dropped"], self._amount(p, "encoder_dropped", "share"), 0.0)
        offset = last.offset + (gain * (moved - missed * ops.maximum(moved, 0.0)) - moved)
        counting = gain * (1.0 - ops.where(speed > 0.0, missed, 0.0))
        wrong = ops.either(ops.either(on["encoder_bias"], ops.negate(ops.equal(offset, 0.0))), off)
        bias = ops.where(on["encoder_bias"], self._amount(p, "encoder_bias", "angle"), 0.0)
        # Without a fault the angle is unchanged to the bit.
        (position,) = ops.branch(wrong, lambda: (self._read(ops, plant, angle + offset, bias),),
                                 lambda: (inputs.position,))
        # With an encoder on the fin, the motor's encoder reads these states; it has no fault.
        as_read = {angle_name: position, rate_name: counting * speed}
        if self.geared:
            as_read = {name: ops.where(plant.encoder.on_fin, getattr(x, name), counted)
                      for name, counted in as_read.items()}
        return angle, offset, position, as_read

    def _active(self, u: PlantInputs) -> Mapping[str, Value]:
        """Return by name whether each fault of the plant is active."""
        return {fault.name: getattr(u, fault_list.state(fault).name) > 0.0 for fault in self.of_plant}

    def _general(self, active: Mapping[str, Value]) -> Mapping[str, Value]:
        """Return by name whether each general fault is active; one that the actuator lacks or replaces never is."""
        return {**{fault.name: False for fault in fault_list.FAULTS},
                **{fault.name: active[fault.name] for fault in self.faults if fault.name in active}}

    def _status(self, ops: Ops, p: Any, x: Record, u: PlantInputs) -> Value:
        """Return the status of the actuator without faults, which does not show a bridge that a fault opens."""
        return self.actuator.plant_outputs(ops, p, x, u)[STATUS.name] if self.has_status else OPERATIONAL

    def _floating(self, ops: Ops, p: Any, q: Any, on: Mapping[str, Value], x: Record, u: PlantInputs, used: Value
                  ) -> tuple[Value, ...]:
        """Return 1 (the fin is broken off), and its angle [rad] and rate [rad/s] after `used` [s].

        The other general faults `on` also act on the fin, such as a rise of friction.
        """
        q = fault_list.changed(ops, q, (fault for fault in self.faults if fault.name != "free_fin"), on)
        now = self.actuator.plant_outputs(ops, p, x, u)
        whole = ops.equal(x.fin_broken_off, 0.0)
        return 1.0, *free_fin.advance(ops, q, ops.where(whole, now["fin_angle"], x.broken_fin_angle),
                                      ops.where(whole, now["fin_rate"], x.broken_fin_rate), u, used)


def _named(names: Iterable[str], values: Iterable[Value]) -> dict[str, Value]:
    return dict(zip(names, values, strict=True))


def _of(holder: PlantInputs | Record, names: Iterable[str]) -> list[Value]:
    """Return the values of these names."""
    return [getattr(holder, name) for name in names]


def _off_shaft(ops: Ops, q: Any, x: Record, u: PlantInputs, outputs: Values) -> Values:
    """Return the outputs of the fin or, if it has broken off, of the free fin."""
    fin, broken = x.broken_fin_angle, x.fin_broken_off > 0.0
    values = {
        "fin_angle": fin, "fin_rate": x.broken_fin_rate,
        "tracking_error": fin_port.clipped_command(ops, q, u.command) - fin,
        "hinge_torque": free_fin.moment(ops, q, fin, u),
        "at_stop": ops.fabs(fin) >= fin_port.stop_edge(q),
    }
    return {name: ops.where(broken, value, outputs[name]) for name, value in values.items()}


@rule(f"fault.command_delay.time = %.6g s must be at most {fault_list.LONGEST_COMMAND_DELAY} times "
      "controller.sample_time = %.6g s")
def _command_delay(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
    late, period = p.fault.command_delay, p.controller.sample_time
    used = ops.either(late.active, late.end > late.begin)
    longest = fault_list.LONGEST_COMMAND_DELAY * period * (1.0 + SLACK)
    return when(ops, ops.both(used, late.time > longest)), late.time, period


def _rules(actuator: Actuator) -> tuple[Rule, ...]:
    of_faults, others = ([v.name for v in variables if v.name.endswith(".pole_pairs")] for variables in (
        [v for fault in fault_list.possible(actuator) for v in fault_list.parameters(fault)], actuator.parameters))
    general = (_command_delay,) if fault_list.has(actuator, "command_delay") else ()
    return (*general, *starmap(one_motor, [*combinations(of_faults, 2), *product(of_faults, others)]))


EXTENSION = Extension(
    "faults", "faults and built-in test", extend, parameters=lambda actuator: (
        *(v for fault in fault_list.possible(actuator) for v in fault_list.parameters(fault)),
        *monitors.parameters(actuator)), rules=_rules)
