"""What an actuator declares: its states, variables, rules and equations. Every tool reads this and nothing else.

The equations are functions of ``ops`` (:class:`emcas_fmu.ops.base.Ops`), ``p``, the parameters by name
(``p.motor.resistance``), and named values; all SI.

    initial(ops, p, start)       states at rest: ``start.fin_angle`` [rad], ``start.encoder_offset``
    sample(ops, p, x, inputs)     what the sampled controllers do, every controller.sample_time
    step(ops, p, x, u, h)        the plant after h [s] or at the first event before, and the time that took; or
    derivatives(ops, p, x, u)    d/dt of the states where the equations are smooth: enabled, without dry friction, gaps
                                 and limits. Linear analysis takes these (:mod:`emcas_fmu.bench.linear.actuator`), and
                                 stepping where there is no `step` (:mod:`emcas_fmu.steppers.smooth`)
    output_values(ops, p, x, u)  every output

``x`` has the states by name, ``u`` what acts and is held through a step (:class:`PlantInputs`). The functions give a
mapping of names to values; all but `output_values` leave out what does not change (from 0, for `initial`).
"""

from __future__ import annotations

import keyword
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import signature
from math import ceil, floor, isnan, log10
from pathlib import Path
from typing import Any

from ..control import command as bus
from ..errors import EmcasError, hint, place
from ..namespace import Record, namespace
from ..ops.base import Ops, Value
from ..ops.floats import FLOATS
from ..physics.loads import LOADS
from ..physics.structure import Structure
from ..rules import SLACK, Rule
from ..steppers.smooth import Derivatives, smooth_step
from ..variables import Terminal, Variable, parameter
from . import capabilities, fin_port
from .line import LINES, Line
from .plant_fault import PlantFault as PlantFault
from .plant_fault import check_names

Values = Mapping[str, Value]
Parameters = Any
"""Parameters as attributes by their dotted names, with the actuator's `structure`."""
PlantInputs = Record
"""What acts on the plant through a step. To `step` and `outputs`:

``reference``, as it has arrived in the drive; ``aero_torque`` [N.m]; what the vehicle's motion makes, ``f_x``,
``f_z``, ``wx2_wz2``, ``wx_wz``, ``alpha_x``, ``alpha_y`` (:class:`emcas_fmu.physics.loads.MotionLoads`); ``supply``;
``enabled``; the actuator's further inputs; its sampled states; ``rated_current_limit`` [A], the drive's without a
fault, None where that is drive.current_limit.
To `outputs` besides: ``command`` [rad]; ``sampled_reference``, the last sample's; ``measured_fin_angle`` [rad];
``limited``, whether the last sample met a limit.
"""
SampleInputs = Record
"""What a sample is asked for: ``command`` [rad], ``supply``, ``enable``, the further inputs, and ``encoder_offset``
[counts], None of an encoder whose zero is the fin's, and ``position`` [rad], the state of angle that the encoder of
position reads."""


@dataclass(frozen=True)
class State:
    """A state by name, a Python identifier, with its unit."""

    name: str
    unit: str = ""
    description: str = ""

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()) or keyword.iskeyword(self.name):
            raise EmcasError(f"state {self.name!r}: a state's name is a Python identifier, such as fin_rate")
        if hasattr(Record, self.name):
            raise EmcasError(f"state {self.name!r}: is what a method of x is called; give it another name")


@dataclass(frozen=True)
class Supply:
    """The line that feeds the actuator: its input, and for several fins on one line what loads it.

    The input's unit says what kind of line it is (:data:`.line.LINES`). `power` is the output of the power drawn [W].
    Of a bus, `inverse_inductance(ops, p)` is 1/L [1/H] of what its voltage drives, 0 of what it drives at once;
    `inverse_inductance(ops, p, interval)` what of it counts within an interval [s].
    """

    input: Variable
    power: Variable
    inverse_inductance: Callable[..., Value] = lambda ops, p: 0.0

    def __post_init__(self) -> None:
        if self.input.kind != "Real" or self.input.unit not in LINES:
            raise EmcasError(f"supply {self.input.name} [{self.input.unit}]: the line that feeds an actuator is one of "
                             "voltage [V] or of pressure [Pa]; declare another input among further_inputs")
        if (self.power.name, self.power.unit) != ("supply_power", "W"):
            raise EmcasError(f"supply {self.input.name}: its power is called {self.power.name} [{self.power.unit}]; "
                             "every actuator's is supply_power [W]")
        if (count := len(signature(self.inverse_inductance).parameters)) not in (2, 3):
            raise EmcasError(f"supply {self.input.name}: inverse_inductance takes {count} argument{'s'[:count != 1]}; "
                             "give a function of (ops, p) or of (ops, p, interval)")

    def within(self, ops: Ops, p: Parameters, interval: Value) -> Value:
        """Return 1/L [1/H] that counts within an interval [s]."""
        within = (interval,) if len(signature(self.inverse_inductance).parameters) == 3 else ()
        return self.inverse_inductance(ops, p, *within)

    @property
    def line(self) -> Line:
        """The kind of line."""
        return LINES[self.input.unit]


_BUS = tuple(map(State, bus.STATES))


def _at_start_angle(ops: Ops, p: Parameters, start: Record) -> Values:
    return {"fin_angle": start.fin_angle, "measured_fin_angle": start.fin_angle}


def _none_sampled(ops: Ops, p: Parameters, x: Record, inputs: SampleInputs) -> Values:
    return {"reference": 0.0}


def _no_step(ops: Ops, p: Parameters, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    raise NotImplementedError  # one made of the derivatives takes its place


def _no_outputs(ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Values:
    return {}


def _unchanged(ops: Ops, p: Parameters) -> Parameters:
    return p


def _rounded_up(limit: float) -> float:
    """Return a positive limit with four digits, no smaller."""
    unit = 10.0 ** (floor(log10(limit)) - 3)
    return float(f"{ceil(limit / unit) * unit:.4g}")


def identifier(name: str) -> str:
    """Return a variable's name as an identifier: ``acceleration.x`` gives acceleration_x."""
    return re.sub(r"\W+", "_", name)


def _complete(function: Callable[..., Any], given: Any, names: Iterable[str], optional: Iterable[str] = ()
              ) -> Mapping[str, Value]:
    """Return what an actuator's function gave, if these are all the names it has. Raises EmcasError."""
    if not isinstance(given, Mapping):
        raise EmcasError(f"{place(function)} gives {type(given).__name__}; a mapping of names to values is needed")
    needed = list(names)
    known = {*needed, *optional}
    if missing := [name for name in needed if name not in given]:
        raise EmcasError(f"{place(function)} gives no {', '.join(missing)}")
    if unknown := [name for name in given if name not in known]:
        raise EmcasError(f"{place(function)} gives {', '.join(map(str, unknown))}, which is not declared; there is "
                         f"{', '.join(sorted(known))}")
    for name, value in given.items():
        if value is None or isinstance(value, (str, Sequence, Mapping)) or (isinstance(value, float) and isnan(value)):
            raise EmcasError(f"{place(function)} gives {name} = {value!r}; a number is needed")
    return given


@dataclass(frozen=True)
class Actuator:
    """An actuator behind the fin port (:mod:`emcas_fmu.actuators.fin_port`).

    Its functions are described in this module's docstring; what is not given has a sensible default. Raises EmcasError
    where the parts do not fit together.
    """

    name: str
    title: str
    # Where the equations come from, in sentences.
    origin: str = ""

    # States: moved by steps; moved by samples, which alone see them; set by samples and seen by everything.
    states: tuple[State, ...] = ()
    controller_states: tuple[State, ...] = ()
    sampled_states: tuple[State, ...] = ()
    # Those, of angle and speed, that the sensors read; and those of the fin, referred to the motor, where it turns by
    # itself behind an elastic drive line: an encoder on the fin (encoder.on_fin) reads its angle.
    encoder: tuple[str, str] = ("fin_angle", "fin_rate")
    fin_side: tuple[str, str] | None = None

    # Variables. Outputs and parameters are complete, the port's among them, in the interface's order.
    outputs: tuple[Variable, ...] = ()
    parameters: tuple[Variable, ...] = ()
    # Besides the port's: a Boolean is seen by samples only, a Real by everything.
    further_inputs: tuple[Variable, ...] = ()
    supply: Supply | None = None
    # Of inputs of the port that mean something else here, by name.
    descriptions: Mapping[str, str] = field(default_factory=dict)
    terminals: tuple[Terminal, ...] = ()
    # Rules besides the port's; and pairs that are equal in SI units, of which one follows from the other.
    rules: tuple[Rule, ...] = ()
    # Warnings that need start values of inputs, such as the supply's, too: of a loaded set, not of the equations.
    supply_rules: tuple[Rule, ...] = ()
    equal_parameters: tuple[tuple[str, str], ...] = ()
    # Parameter files with the defaults, the later over the earlier, all over ``models/emcas.toml``.
    files: tuple[Path, ...] = ()

    # Equations.
    initial: Callable[[Ops, Parameters, Record], Values] = _at_start_angle
    sample: Callable[[Ops, Parameters, Record, SampleInputs], Values] = _none_sampled
    derivatives: Derivatives | None = None
    step: Callable[[Ops, Parameters, Record, PlantInputs, Value], tuple[Values, Value]] = _no_step
    output_values: Callable[[Ops, Parameters, Record, PlantInputs], Values] = _no_outputs
    # Which of the shared equations hold; and the parameters that these use, with constants in place of those that this
    # actuator does not have.
    structure: Structure = field(default_factory=Structure)
    equation_parameters: Callable[[Ops, Parameters], Parameters] = _unchanged
    # Parameters of the plant where it differs from what the controllers know, and values of the parameters by which it
    # does that make it nominal.
    as_built: Callable[[Ops, Parameters], Parameters] = _unchanged
    nominal: Mapping[str, float] = field(default_factory=dict)
    # Largest internal tick [s], and what makes it longer; time [s] from a sample to the drive.
    longest_tick: Callable[[Ops, Parameters], Value] = fin_port.max_tick
    tick_remedy: str = "raise solver.max_tick"
    transport_delay: Callable[[Ops, Parameters], Value] | None = None

    # Faults of its kind, which the extension `faults` offers beside the general ones.
    faults: tuple[PlantFault, ...] = ()
    # What extensions and tools ask for (:mod:`emcas_fmu.actuators.capabilities`).
    provides: frozenset[str] = frozenset()
    # An independent integration: a Python file, or a module's name, with ``simulate(parameters, inputs)``.
    reference: Path | str | None = None
    # Modules whose docstrings are the equations; the user's file that declares it.
    modules: tuple[Any, ...] = ()
    source: Path | None = None

    def __post_init__(self) -> None:
        if self.step is _no_step:
            if self.derivatives is None:
                raise EmcasError(f"actuator {self.name}: has neither step nor derivatives; smooth equations need only "
                                 "derivatives")
            object.__setattr__(self, "step", smooth_step(self._every_rate, [s.name for s in self.states]))
        declared = (s for s in self.controller_states if s not in _BUS)  # one made of another has them already
        object.__setattr__(self, "controller_states", (*declared, *_BUS))
        # Those that act on the plant first: the core takes them so.
        object.__setattr__(self, "further_inputs", tuple(sorted(self.further_inputs, key=lambda v: v.kind != "Real")))
        arguments = [a for _, names, _ in self.functions for a in names]
        repeated = [name for _, names, _ in self.functions for name in names if names.count(name) > 1]
        if repeated:
            raise EmcasError(f"actuator {self.name}: {repeated[0]} is the name of two things; states, inputs and what "
                             f"acts ({', '.join(dict.fromkeys(arguments))}) have names of their own")
        self._check_interface()
        check_names(self.name, self.faults)

    def _check_interface(self) -> None:
        sensed = (*self.encoder, *(self.fin_side or ()))
        if missing := [name for name in sensed if name not in {s.name for s in self.states}]:
            raise EmcasError(f"actuator {self.name}: there is no state {missing[0]}; the sensors read fin_angle and "
                             "fin_rate, or the states of angle and speed that encoder=(..., ...) names")
        count = Counter(v.name for v in (*self.inputs, *self.outputs, *self.parameters))
        if twice := [name for name, times in count.items() if times > 1]:
            raise EmcasError(f"actuator {self.name}: {twice[0]} is declared twice; inputs, outputs and parameters have "
                             "names of their own")
        for kind, needed in (("output", fin_port.OUTPUTS), ("parameter", fin_port.PARAMETERS)):
            if missing := [v.name for v in needed if v.name not in count]:
                raise EmcasError(f"actuator {self.name}: {kind} {missing[0]} of the fin port is missing; it has "
                                 f"{', '.join(v.name for v in needed)}")
        for v in (*self.outputs, *self.parameters, *self.further_inputs):
            if not v.minimum <= v.maximum:
                raise EmcasError(f"actuator {self.name}: {v.name} has minimum {v.minimum:g} above maximum "
                                 f"{v.maximum:g}")
        for capability in self.provides:
            if capability not in capabilities.NEEDED_VARIABLES:
                raise EmcasError(f"actuator {self.name} provides {capability!r}, which nothing asks for"
                                 f"{hint(capability, capabilities.NEEDED_VARIABLES)}")
            missing = [name for name in capabilities.NEEDED_VARIABLES[capability] if name not in count]
            missing += [f"state {name}" for name in capabilities.NEEDED_STATES.get(capability, ())
                        if name not in self._state_names]
            if missing:
                raise EmcasError(f"actuator {self.name} provides {capability!r}, which needs {missing[0]}; declare it, "
                                 "or leave that out of provides")

    # -- interface -------------------------------------------------------------

    @cached_property
    def inputs(self) -> tuple[Variable, ...]:
        """The fin port's inputs, the supply, the further ones."""
        port = fin_port.inputs(None if self.supply is None else self.supply.input, self.further_inputs)
        return tuple(replace(v, description=self.descriptions.get(v.name, v.description)) for v in port)

    @cached_property
    def limited_outputs(self) -> tuple[Variable, ...]:
        """The outputs with the limits that follow from those of parameters, which a host may change."""
        most = {v.name: v.maximum for v in self.parameters}

        def limited(v: Variable) -> Variable:
            if not v.limited_by or not all(name in most for name in v.limited_by):
                return v
            size = _rounded_up(sum(most[name] for name in v.limited_by) * (1.0 + SLACK))
            return replace(v, minimum=max(v.minimum, -size), maximum=min(v.maximum, size))

        return tuple(map(limited, self.outputs))

    @cached_property
    def acting_inputs(self) -> tuple[Variable, ...]:
        """Those of the further inputs that steps and outputs see."""
        return tuple(v for v in self.further_inputs if v.kind == "Real")

    @cached_property
    def file_entries(self) -> tuple[Variable, ...]:
        """What a parameter file may give: the parameters, and start values of inputs."""
        starts = (parameter(v.key, v.unit, v.minimum, v.maximum, f"start value of {v.name}", v.sheet)
                  for v in self.inputs if v.key is not None)
        return (*self.parameters, *starts)

    @cached_property
    def all_rules(self) -> tuple[Rule, ...]:
        """The fin port's rules and the actuator's."""
        return (*fin_port.RULES, *self.rules,
                *fin_port.schedule_rules(self.longest_tick, self.transport_delay, self.tick_remedy))

    def namespace(self, values: Mapping[str, Any]) -> Parameters:
        """Return parameters by name as what the equations take."""
        return namespace(values, self.structure)

    def plant(self, values: Mapping[str, Any]) -> Parameters:
        """Return parameters by name as those of the plant as built."""
        return self.plant_parameters(FLOATS, self.namespace(values))

    def plant_parameters(self, ops: Ops, p: Parameters) -> Parameters:
        """Return the parameters with which the equations describe the plant as built."""
        return self.as_built(ops, self.equation_parameters(ops, p))

    # -- what is traced ----------------------------------------------------------

    @cached_property
    def functions(self) -> tuple[tuple[str, tuple[str, ...], Callable[..., tuple[Value, ...]]], ...]:
        """Name, names of the arguments, and the function of each that is traced, with one argument for each value.

        initial() gives states, controller states, measured angle and sampled states; sample() the reference,
        controller states, measured angle, whether a limit was met, sampled states; step() states and the time it took.
        """
        plant, kept, held = (tuple(s.name for s in states)
                             for states in (self.states, self.controller_states, self.sampled_states))
        acting = (*LOADS, "supply", "enable", *(identifier(v.name) for v in self.acting_inputs))
        return (
            ("initial", (), self._initial),
            ("sample", (*plant, *kept, *held, "command", "supply", "enable",
                        *(identifier(v.name) for v in self.further_inputs)), self._sample),
            ("motion_loads", tuple(identifier(v.name) for v in fin_port.MOTION), fin_port.motion_loads),
            ("step", (*plant, *held, "active", *acting, "h"), self._step),
            ("outputs", (*plant, "active", "reference", "measured", "limited", *held, "command", *acting),
             self._output_values),
        )

    def start(self, ops: Ops, p: Parameters, fin_angle: Value | None = None,
              encoder_offset: Value | None = None) -> dict[str, Value]:
        """Return every state by name, and ``measured_fin_angle`` [rad], at rest at a fin angle [rad].

        fin.start_angle unless given; the encoder's zero is `encoder_offset` [counts] off.
        """
        at = Record(fin_angle=p.fin.start_angle if fin_angle is None else fin_angle, encoder_offset=encoder_offset)
        names = self._state_names
        given = _complete(self.initial, self.initial(ops, p, at), ("measured_fin_angle",), names)
        return {**dict.fromkeys(names, 0.0), **bus.start(ops, p, at.fin_angle), **given}

    @cached_property
    def _state_names(self) -> tuple[str, ...]:
        return tuple(s.name for s in (*self.states, *self.controller_states, *self.sampled_states))

    def _initial(self, ops: Ops, p: Parameters) -> tuple[Value, ...]:
        begun = self.start(ops, p)
        return tuple(begun[name] for name in (
            *(s.name for s in (*self.states, *self.controller_states)), "measured_fin_angle",
            *(s.name for s in self.sampled_states)))

    def _sample(self, ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        names = self._state_names
        x = Record(**dict(zip(names, arguments, strict=False)))
        command, supply, enable, *further = arguments[len(names):]
        inputs = Record(command=command, supply=supply, enable=enable, encoder_offset=None,
                        position=self.position(ops, p, x),
                        **{identifier(v.name): value for v, value in zip(self.further_inputs, further, strict=True)})
        given = self.commanded(ops, p, x, inputs)
        kept, held = (tuple(s.name for s in states) for states in (self.controller_states, self.sampled_states))
        return tuple(given[name] for name in ("reference", *kept, "measured_fin_angle", "limited", *held))

    def position(self, ops: Ops, p: Parameters, x: Record) -> Value:
        """Return the state of angle [rad] that the encoder of position reads."""
        angle = getattr(x, self.encoder[0])
        return angle if self.fin_side is None else ops.where(p.encoder.on_fin, getattr(x, self.fin_side[0]), angle)

    def motor_current(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Value:
        """Return the motor current [A] of an actuator that has one: the state of that name, else the output."""
        if any(s.name == "motor_current" for s in self.states):
            return x.motor_current
        return self.plant_outputs(ops, p, x, u)["motor_current"]

    def commanded(self, ops: Ops, p: Parameters, x: Record, inputs: SampleInputs) -> dict[str, Value]:
        """Return :meth:`sampled` with the command taken from the bus (:mod:`emcas_fmu.control.command`)."""
        command, *after = bus.taken(ops, p, inputs.command, *(getattr(x, name) for name in bus.STATES))
        return {**self.sampled(ops, p, x, inputs.replace(command=command)), **dict(zip(bus.STATES, after, strict=True))}

    def sampled(self, ops: Ops, p: Parameters, x: Record, inputs: SampleInputs) -> dict[str, Value]:
        """Return all that a sample gives: ``reference``, ``measured_fin_angle``, ``limited``, controller states and
        sampled states; the command is that which the controllers have."""
        names = tuple(s.name for s in (*self.controller_states, *self.sampled_states))
        given = _complete(self.sample, self.sample(ops, p, x, inputs), ("reference",),
                          ("measured_fin_angle", "limited", *names))
        before = {name: getattr(x, name) for name in names}
        return {"measured_fin_angle": inputs.position, "limited": 0.0, **before, **given}

    def rates(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> dict[str, Value]:
        """Return d/dt of every state of an actuator that has derivatives."""
        assert self.derivatives is not None
        names = tuple(s.name for s in self.states)
        return {**dict.fromkeys(names, 0.0), **_complete(self.derivatives, self.derivatives(ops, p, x, u), (), names)}

    def _every_rate(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Mapping[str, Value]:
        assert self.derivatives is not None
        return _complete(self.derivatives, self.derivatives(ops, p, x, u), (s.name for s in self.states))

    def plant_outputs(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Values:
        """Return every output, those of command and sample as if both were 0."""
        unsampled = dict.fromkeys(("command", "sampled_reference", "measured_fin_angle", "limited"), 0.0)
        return self.output_values(ops, p, x, Record(**{**vars(u), **unsampled}))

    def _acting(self, held: Iterable[Value], active: Value, acting: Iterable[Value]) -> dict[str, Value]:
        names = (*(s.name for s in self.sampled_states), "reference", *LOADS, "supply", "enabled",
                 *(identifier(v.name) for v in self.acting_inputs))
        return {**dict(zip(names, (*held, active, *acting), strict=True)), "rated_current_limit": None}

    def _step(self, ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        plant = tuple(s.name for s in self.states)
        x = Record(**dict(zip(plant, arguments, strict=False)))
        split = len(plant) + len(self.sampled_states)
        active, *acting, h = arguments[split:]
        moved, used = self.step(ops, p, x, Record(**self._acting(arguments[len(plant):split], active, acting)), h)
        moved = {**vars(x), **_complete(self.step, moved, (), plant)}
        return (*(moved[name] for name in plant), used)

    def _output_values(self, ops: Ops, p: Parameters, *arguments: Value) -> tuple[Value, ...]:
        plant = tuple(s.name for s in self.states)
        x = Record(**dict(zip(plant, arguments, strict=False)))
        active, reference, measured, limited, *rest = arguments[len(plant):]
        held, (command, *acting) = rest[:len(self.sampled_states)], rest[len(self.sampled_states):]
        u = Record(**self._acting(held, active, acting), command=command, sampled_reference=reference,
                   measured_fin_angle=measured, limited=limited)
        given = _complete(self.output_values, self.output_values(ops, p, x, u), (v.name for v in self.outputs))
        return tuple(given[v.name] for v in self.outputs)


def with_outputs(outputs: tuple[Variable, ...], further: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Return outputs with further ones behind them, each once."""
    names = {v.name for v in outputs}
    return (*outputs, *(v for v in further if v.name not in names))
