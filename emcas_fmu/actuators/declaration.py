"""The declaration of an actuator: its states, variables, rules and equations. Tools use nothing else of an actuator.

The equations are functions of ``ops`` (:class:`emcas_fmu.ops.base.Ops`), ``p``, the parameters by name
(``p.motor.resistance``), and named values; all in SI units.

    initial(ops, p, start)       states at rest at ``start.fin_angle`` [rad], with ``start.encoder_offset`` [counts].
                                 Without a `step`, it may have a fourth argument ``u``, the inputs at the start
    sample(ops, p, x, inputs)    reference and states of the controllers, every controller.sample_time
    step(ops, p, x, u, h)        the plant's states after `h` [s] or at the first event, and the time until then; or
    derivatives(ops, p, x, u)    d/dt of the states. Without a `step` they are integrated with the `discontinuities`
                                 (:mod:`emcas_fmu.steppers.discontinuities`); if fin_angle and fin_rate are states,
                                 the fin's stop is added. Linear analysis also uses the derivatives
                                 (:mod:`emcas_fmu.bench.linear.actuator`): beside a `step` they describe the enabled
                                 actuator without dry friction, gaps and events
    output_values(ops, p, x, u)  every output; if fin_angle and fin_rate are states, the port's may be left out

``x`` has the states by name, ``u`` the inputs of the plant, which are constant during a step (:class:`PlantInputs`).
The functions return a mapping of names to values. `sample` must return ``reference``, `derivatives` without a `step`
every state. A state that another function leaves out does not change; one that `initial` leaves out is 0, fin_angle the
start angle. If `sample` leaves them out, ``measured_fin_angle`` is the position that it read, and ``limited`` is 0.
Results depend on the arguments alone: functions in a user's file are traced twice, and both results are compared.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from inspect import signature
from math import ceil, floor, inf, log10
from pathlib import Path
from typing import Any

from ..control import command_bus
from ..control.trajectory import Ahead, Motion
from ..errors import EmcasError, hint
from ..namespace import Record, namespace
from ..ops.base import Ops, Value
from ..ops.floats import FLOATS
from ..physics.structure import Structure
from ..rules import SLACK, Rule
from ..steppers.discontinuities import Discontinuity
from ..steppers.smooth import Derivatives
from ..variables import Terminal, Variable, parameter, with_outputs
from . import capabilities, fin_port, positional, stepped
from .lists import check_functions, check_imperfections, check_lists
from .plant_fault import PlantFault as PlantFault
from .plant_fault import check_names
from .positional import complete
from .shared import AsDeclared
from .state import FIN as FIN
from .state import PlantInputs as PlantInputs
from .state import SampleInputs as SampleInputs
from .state import State as State
from .supply_line import Supply as Supply

Values = Mapping[str, Value]
Parameters = Any
"""Parameters as attributes by their dotted names, with the actuator's `structure`."""


_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[\d+\])?", re.ASCII)
_BUS = tuple(map(State, command_bus.STATES))


def _no_step(ops: Ops, p: Parameters, x: Record, u: PlantInputs, h: Value) -> tuple[Values, Value]:
    raise NotImplementedError  # replaced by a step that integrates the derivatives


def _with_port(output_values: Callable[..., Values]) -> Callable[..., Values]:
    @wraps(output_values)
    def outputs(ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Values:
        return fin_port.completed(ops, p, x, u, u.limited > 0.0, output_values(ops, p, x, u))

    return outputs


def _rounded_up(limit: float) -> float:
    """Return a positive limit, rounded up to four significant digits."""
    unit = 10.0 ** (floor(log10(limit)) - 3)
    return float(f"{ceil(limit / unit) * unit:.4g}")


@dataclass(frozen=True)
class Actuator:
    """An actuator behind the fin port (:mod:`emcas_fmu.actuators.fin_port`).

    Only name, title, states, and derivatives or a step must be set. Raises EmcasError if the fields do not fit
    together. The module's docstring describes the functions.

    - ``name``, ``title``, ``origin``: the name is part of the FMU's name; the origin is the source of the equations, in
      sentences
    - ``states``: changed by steps; ``controller_states``: changed by samples, and used by samples only;
      ``sampled_states``: set by samples, used by all equations
    - ``encoder``: the states of angle and speed that the sensors read; ``fin_side``: the states of the fin's angle and
      speed, referred to the motor, behind an elastic drive line; an encoder on the fin (encoder.on_fin) reads the angle
    - ``controllers_read``: names that samples read in addition to the position: states, or "supply"; None: all of them
    - ``reference_output``: name of the output that is the reference of the last sample
    - ``outputs``, ``parameters``: in the order of the interface; unless listed, those of the port come first, the
      supply's power last
    - ``further_inputs``: inputs in addition to the port's: a Boolean is used by samples, a Real by all equations
    - ``supply``: what feeds the actuator; ``terminals``: groups of variables; ``descriptions``: descriptions of inputs
      by name, which replace those of the port and the supply
    - ``rules``: rules in addition to the port's; ``supply_rules``: warnings that need start values of inputs, checked
      when a set of parameters is loaded
    - ``equal_parameters``: pairs of parameters that are equal in SI units: if a file sets only one, the other follows
    - ``files``: parameter files with the defaults, later ones override earlier ones; ``values``: defaults by name,
      which the files override, each in the form of a file: "0.5 mH", or a mapping of value, unit, source and note; a
      value without source is an estimate
    - ``initial``, ``sample``, ``derivatives``, ``discontinuities``, ``step``, ``output_values``: the equations
    - ``structure``: the variant of the shared equations; ``equation_parameters(ops, p)``: their parameters, by default
      with values without effect for those that are not declared (:mod:`emcas_fmu.actuators.shared`)
    - ``as_built(ops, p)``: the plant's parameters, from those that the controllers know; ``nominal``: the values of the
      deviations for which both are equal
    - ``imperfections``: of the held fin angle, such as "backlash"; for each the values [SI] of parameters without it
    - ``longest_tick(ops, p)``: largest internal tick [s]; ``tick_remedy``: how a user makes it longer;
      ``transport_delay(ops, p)``: time [s] from a sample to the drive; None: 0
    - ``feed_forward(ops, p, motion, memory)``: the feed-forward of a motion of the fin (:class:`Motion`, :class:`Ahead`
      of :mod:`emcas_fmu.control.trajectory`), its memory after a sample, and the time [s] after which a reference acts
    - ``faults``: faults of this actuator, which the extension `faults` offers in addition to the general faults
    - ``provides``: capabilities that extensions and tools need (:mod:`emcas_fmu.actuators.capabilities`)
    - ``reference``: an independent integration: a Python file or a module's name, with `simulate(parameters, inputs)`
    - ``without_effect``: inputs that do not change the fin's motion; requirements that need them are not judged, and
      with the supply among them the power does not depend on a shared bus's voltage
    - ``hidden``: inputs of the port that a half, or an actuator with the torque interface, lacks; such an
      actuator may also lack outputs of the port
    - ``modules``: modules whose docstrings describe the equations; ``source``: the user's file; ``begun(ops, p, x,
      u)``: the states, before the first step those that follow from inputs. A user's actuator leaves all three out
    """

    name: str
    title: str
    origin: str = ""
    states: tuple[State, ...] = ()
    controller_states: tuple[State, ...] = ()
    sampled_states: tuple[State, ...] = ()
    encoder: tuple[str, str] = ("fin_angle", "fin_rate")
    fin_side: tuple[str, str] | None = None
    controllers_read: tuple[str, ...] | None = None
    reference_output: str = "drive_reference"
    outputs: tuple[Variable, ...] = ()
    parameters: tuple[Variable, ...] = ()
    further_inputs: tuple[Variable, ...] = ()
    supply: Supply | None = None
    descriptions: Mapping[str, str] = field(default_factory=dict)
    terminals: tuple[Terminal, ...] = ()
    rules: tuple[Rule, ...] = ()
    supply_rules: tuple[Rule, ...] = ()
    equal_parameters: tuple[tuple[str, str], ...] = ()
    files: tuple[Path, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    initial: Callable[..., Values] = lambda ops, p, start: {}
    begun: Callable[[Ops, Parameters, Record, Any], Record] = lambda ops, p, x, u: x
    sample: Callable[[Ops, Parameters, Record, SampleInputs], Values] = lambda ops, p, x, inputs: {"reference": 0.0}
    derivatives: Derivatives | None = None
    discontinuities: tuple[Discontinuity, ...] = ()
    step: Callable[[Ops, Parameters, Record, PlantInputs, Value], tuple[Values, Value]] = _no_step
    output_values: Callable[[Ops, Parameters, Record, PlantInputs], Values] = lambda ops, p, x, u: {}
    structure: Structure = field(default_factory=Structure)
    equation_parameters: Callable[[Ops, Parameters], Parameters] = field(default_factory=AsDeclared)
    as_built: Callable[[Ops, Parameters], Parameters] = lambda ops, p: p
    nominal: Mapping[str, float] = field(default_factory=dict)
    imperfections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    longest_tick: Callable[[Ops, Parameters], Value] = fin_port.max_tick
    tick_remedy: str = "raise solver.max_tick"
    transport_delay: Callable[[Ops, Parameters], Value] | None = None
    feed_forward: Callable[[Ops, Parameters, Motion, Value], tuple[Ahead, Value, Value]] | None = None
    faults: tuple[PlantFault, ...] = ()
    provides: frozenset[str] = frozenset()
    reference: Path | str | None = None
    without_effect: frozenset[str] = frozenset()
    hidden: frozenset[str] = frozenset()
    modules: tuple[Any, ...] = ()
    source: Path | None = None

    def __post_init__(self) -> None:
        check_lists(self)
        check_functions(self)
        outputs = () if self.hidden else fin_port.OUTPUTS
        for attribute, port in (("outputs", outputs), ("parameters", fin_port.PARAMETERS)):
            listed = getattr(self, attribute)
            names = {v.name: v for v in listed}
            for v in port:
                if (other := names.get(v.name, v)).kind != v.kind or other.unit != v.unit:
                    raise EmcasError(f"actuator {self.name}: {v.name} of the fin port is {v.kind} [{v.unit}], not "
                                     f"{other.kind} [{other.unit}]; leave yours out, or rename it")
            object.__setattr__(self, attribute, (*(v for v in port if v.name not in names), *listed))
        if self.supply is not None:
            object.__setattr__(self, "outputs", with_outputs(self.outputs, (self.supply.power,)))
        if self.step is _no_step:
            for name, value in stepped.fields(self).items():
                object.__setattr__(self, name, value)
        elif self.discontinuities or len(signature(self.initial).parameters) == 4:
            raise EmcasError(f"actuator {self.name}: has a step, beside which discontinuities and the argument u of "
                             "`initial` have no effect; leave out the step, or these")
        elif not self.hidden and not hasattr(self.output_values, "__wrapped__"):
            object.__setattr__(self, "output_values", _with_port(self.output_values))
        controllers = (s for s in self.controller_states if s not in _BUS)  # replace() passes those of the bus, too
        object.__setattr__(self, "controller_states", (*controllers, *_BUS))
        # Inputs of the plant first, as the core expects.
        object.__setattr__(self, "further_inputs", tuple(sorted(self.further_inputs, key=lambda v: v.kind != "Real")))
        functions = positional.functions(self)
        all_names = dict.fromkeys(name for _, names, _ in functions for name in names)
        if repeated := [name for _, names, _ in functions for name in names if names.count(name) > 1]:
            raise EmcasError(f"actuator {self.name}: {repeated[0]} is the name of two things; give one of them a "
                             f"name other than {', '.join(all_names)}")
        if isinstance(self.equation_parameters, AsDeclared):
            declared = AsDeclared((v.name for v in self.parameters), self.provides, self.structure.current == "loop")
            object.__setattr__(self, "equation_parameters", declared)
        self._check_interface()
        check_names(self.name, self.faults)
        check_imperfections(self)

    def _check_interface(self) -> None:
        read = (*self.encoder, *(self.fin_side or ()))
        if missing := [name for name in read if name not in {s.name for s in self.states}]:
            raise EmcasError(f"actuator {self.name}: there is no state {missing[0]}; the sensors read fin_angle and "
                             "fin_rate, or the states of angle and speed that encoder=(..., ...) names")
        if unknown := [name for name in self.without_effect if name not in {v.name for v in self.inputs}]:
            raise EmcasError(f"actuator {self.name}: without_effect: there is no input {unknown[0]}"
                             f"{hint(unknown[0], [v.name for v in self.inputs])}")
        variables = (*self.inputs, *self.outputs, *self.parameters)
        if twice := [name for name, times in Counter(v.name for v in variables).items() if times > 1]:
            raise EmcasError(f"actuator {self.name}: {twice[0]} is declared twice; give inputs, outputs and parameters "
                             "different names")
        for v in variables:
            if not _NAME.fullmatch(v.name):
                raise EmcasError(f"actuator {self.name}: name {v.name!r}: use letters, digits and _ (no digit first), "
                                 "dots between groups, and an index at the end, as in motor.current or "
                                 "friction.viscous[0]")
            if v.nominal is not None and not 0.0 < v.nominal < inf:
                raise EmcasError(f"actuator {self.name}: {v.name} has nominal {v.nominal:g}; declare its order of "
                                 "magnitude, above 0, to which hosts relate tolerances")
            if not v.minimum <= v.maximum:
                raise EmcasError(f"actuator {self.name}: {v.name} has a minimum {v.minimum:g} above its maximum "
                                 f"{v.maximum:g}; exchange them")
        declared = {v.name for v in (*self.inputs, *self.outputs, *self.file_entries)}
        for capability in self.provides:
            if capability not in capabilities.NEEDED_VARIABLES:
                raise EmcasError(f"actuator {self.name} provides {capability!r}, which is not in em.capabilities"
                                 f"{hint(capability, capabilities.NEEDED_VARIABLES)}")
            missing = [name for name in capabilities.NEEDED_VARIABLES[capability] if name not in declared]
            missing += [f"state {name}" for name in capabilities.NEEDED_STATES[capability]
                        if name not in self._state_names]
            if isinstance(self.equation_parameters, AsDeclared):
                missing += [name for name in capabilities.NEEDED_PARAMETERS[capability]
                            if name in self.equation_parameters.missing]
            if missing:
                raise EmcasError(f"actuator {self.name} provides {capability!r}, which needs {missing[0]}; declare it, "
                                 "or leave the capability out of provides")

    # -- interface -------------------------------------------------------------

    @cached_property
    def inputs(self) -> tuple[Variable, ...]:
        """The fin port's inputs, the supply's, and the additional ones."""
        port = fin_port.inputs(None if self.supply is None else self.supply.input, self.further_inputs)
        return fin_port.described(self.descriptions, port)

    @cached_property
    def limited_outputs(self) -> tuple[Variable, ...]:
        """The outputs, with limits that hold for all values of parameters that a host may set."""
        most = {v.name: v.maximum for v in self.parameters}

        def limited(v: Variable) -> Variable:
            if not v.limited_by or not all(name in most for name in v.limited_by):
                return v
            size = _rounded_up(sum(most[name] for name in v.limited_by) * (1.0 + SLACK))
            return replace(v, minimum=max(v.minimum, -size), maximum=min(v.maximum, size))

        return tuple(map(limited, self.outputs))

    @cached_property
    def acting_inputs(self) -> tuple[Variable, ...]:
        """The additional inputs that all equations use, not only samples."""
        return tuple(v for v in self.further_inputs if v.kind == "Real")

    @cached_property
    def file_entries(self) -> tuple[Variable, ...]:
        """The entries of a parameter file: the parameters, and the start values of inputs with a `key`."""
        starts = (parameter(v.key, v.unit, v.minimum, v.maximum, f"start value of {v.name}", v.sheet)
                  for v in self.inputs if v.key is not None)
        return (*self.parameters, *starts)

    @cached_property
    def all_rules(self) -> tuple[Rule, ...]:
        """The fin port's rules and the actuator's."""
        return (*fin_port.RULES, *self.rules,
                *fin_port.schedule_rules(self.longest_tick, self.transport_delay, self.tick_remedy))

    def namespace(self, values: Mapping[str, Any]) -> Parameters:
        """Return parameters by name as the namespace that the equations use."""
        return namespace(values, self.structure)

    def plant(self, values: Mapping[str, Any]) -> Parameters:
        """Return the parameters of the plant as built, as a namespace, from the parameters by name."""
        return self.plant_parameters(FLOATS, self.namespace(values))

    def plant_parameters(self, ops: Ops, p: Parameters) -> Parameters:
        """Return the parameters of the equations, as built."""
        return self.as_built(ops, self.equation_parameters(ops, p))

    # -- equations, by name ----------------------------------------------------

    def start(self, ops: Ops, p: Parameters, fin_angle: Value | None = None,
              encoder_offset: Value | None = None) -> dict[str, Value]:
        """Return every state by name, in SI, and ``measured_fin_angle`` [rad], at rest at a fin angle [rad].

        The default angle is fin.start_angle. `encoder_offset` [counts] is the error of the encoder's zero.
        """
        at = Record(fin_angle=p.fin.start_angle if fin_angle is None else fin_angle, encoder_offset=encoder_offset)
        names = self._state_names
        values = complete(self.initial, self.initial(ops, p, at), (), ("measured_fin_angle", *names))
        fin = dict.fromkeys(("measured_fin_angle", *({"fin_angle"} & set(names))), at.fin_angle)
        return {**dict.fromkeys(names, 0.0), **command_bus.start(ops, p, at.fin_angle), **fin, **values}

    @cached_property
    def _state_names(self) -> tuple[str, ...]:
        return tuple(s.name for s in (*self.states, *self.controller_states, *self.sampled_states))

    def position(self, ops: Ops, p: Parameters, x: Record) -> Value:
        """Return the state [rad] that the encoder of position reads."""
        angle = getattr(x, self.encoder[0])
        return angle if self.fin_side is None else ops.where(p.encoder.on_fin, getattr(x, self.fin_side[0]), angle)

    def motor_current(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Value:
        """Return the motor current [A] of an actuator that has one: the state of that name, otherwise the output."""
        if any(s.name == "motor_current" for s in self.states):
            return x.motor_current
        return self.plant_outputs(ops, p, x, u)["motor_current"]

    def commanded(self, ops: Ops, p: Parameters, x: Record, inputs: SampleInputs) -> dict[str, Value]:
        """Return the results of :meth:`sampled`, in SI, for the command that the bus delivers, and the bus's states.

        `inputs.command` [rad] is the command before the bus (:mod:`emcas_fmu.control.command_bus`).
        """
        names = command_bus.STATES
        command, *after = command_bus.delivered(ops, p, inputs.command, *(getattr(x, name) for name in names))
        return {**self.sampled(ops, p, x, inputs.replace(command=command)), **dict(zip(names, after, strict=True))}

    def sampled(self, ops: Ops, p: Parameters, x: Record, inputs: SampleInputs) -> dict[str, Value]:
        """Return the results of a sample by name, in SI; `inputs.command` [rad] is the command after the bus.

        The results are ``reference``, ``measured_fin_angle``, ``limited``, controller states and sampled states.
        """
        names = tuple(s.name for s in (*self.controller_states, *self.sampled_states))
        values = complete(self.sample, self.sample(ops, p, x, inputs), ("reference",),
                          ("measured_fin_angle", "limited", *names))
        before = {name: getattr(x, name) for name in names}
        return {"measured_fin_angle": inputs.position, "limited": 0.0, **before, **values}

    def rates(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> dict[str, Value]:
        """Return d/dt of every state, in SI per s, of an actuator that has derivatives."""
        assert self.derivatives is not None
        names = tuple(s.name for s in self.states)
        return {**dict.fromkeys(names, 0.0), **complete(self.derivatives, self.derivatives(ops, p, x, u), (), names)}

    def plant_outputs(self, ops: Ops, p: Parameters, x: Record, u: PlantInputs) -> Values:
        """Return every output by name, in SI, with the command and the results of the last sample set to 0."""
        unsampled = dict.fromkeys(("command", "sampled_reference", "measured_fin_angle", "limited"), 0.0)
        return self.output_values(ops, p, x, PlantInputs(**{**vars(u), **unsampled}))
