"""What an actuator is made of: its states, its own variables, its functions over the operations namespace.

The modules beside this one write them down with one argument a state (:mod:`emcas_fmu.actuators.nonlinear`).
Options (:mod:`emcas_fmu.options`) see the same in groups, so that each adds its own behind those there are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

from ..integrate import Boundary
from ..ops.base import Ops, Value
from ..variables import INPUTS, OUTPUTS, PARAMETERS, Variable

Values = tuple[Value, ...]
# Kept by the controller itself, and shown by every sample.
KEPT, SHOWN = ("integral", "counts"), ("measured", "limited")
_BOUNDARY = ("aero_torque", "f_x", "f_z", "supply", "enable")


class State(NamedTuple):
    """`plant` is moved by steps, the rest by samples: `kept` is seen by them only, `held` by everything."""

    plant: Values
    kept: Values
    held: Values


class Asked(NamedTuple):
    """What a sample takes from outside: `command` [rad], `supply` [V], `enable`, the own inputs."""

    command: Value
    supply: Value
    enable: Value
    own: Values


class Sampled(NamedTuple):
    """What a sample gives: DAC value [V], `measured` fin angle [rad], whether a limit was met, and states."""

    reference: Value
    kept: Values
    measured: Value
    limited: Value
    held: Values


class Shown(NamedTuple):
    """What outputs take besides states and boundary: the last sample's results and the command [rad] now."""

    reference: Value
    measured: Value
    limited: Value
    command: Value


@dataclass(frozen=True)
class Model:
    """States by name, the variables besides the table's, and the functions.

    `initial(ops, p)` gives a State and the fin angle measured; `sample(ops, p, State, Asked)` a Sampled;
    `forces` as in nonlinear.py; `step(ops, p, plant, held, Boundary, h)` the plant after h [s] or at the first
    event before, and the time that took; `put_out(ops, p, plant, held, Boundary, Shown)` every output.
    `direct` names the inputs that own outputs depend on at once, `descriptions` what a variable of the table is here
    where that is something else.
    """

    plant: tuple[str, ...]
    initial: Callable[[Ops, Any], tuple[State, Value]]
    sample: Callable[[Ops, Any, State, Asked], Sampled]
    forces: Callable[..., Values]
    step: Callable[[Ops, Any, Values, Values, Boundary, Value], tuple[Values, Value]]
    put_out: Callable[[Ops, Any, Values, Values, Boundary, Shown], Values]
    kept: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    parameters: tuple[Variable, ...] = ()
    inputs: tuple[Variable, ...] = ()
    outputs: tuple[Variable, ...] = ()
    direct: tuple[tuple[str, tuple[str, ...]], ...] = ()
    descriptions: tuple[tuple[str, str], ...] = ()


def of_module(module: ModuleType) -> Model:
    """The model that a module of this package writes down."""
    count = len(module.PLANT)

    def initial(ops: Ops, p: Any) -> tuple[State, Value]:
        values = module.initial(ops, p)
        return State(values[:count], values[count:-1], ()), values[-1]

    def sample(ops: Ops, p: Any, s: State, a: Asked) -> Sampled:
        reference, integral, counts, measured, limited = module.sample(
            ops, p, *s.plant[:2], *s.kept, a.command, a.enable)
        return Sampled(reference, (integral, counts), measured, limited, ())

    def step(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, h: Value) -> tuple[Values, Value]:
        *moved, used = module.step(ops, p, *plant, *b, h)
        return tuple(moved), used

    def put_out(ops: Ops, p: Any, plant: Values, held: Values, b: Boundary, s: Shown) -> Values:
        reference, *acting = b
        values: Values = module.outputs(ops, p, *plant, reference, *s, *acting)
        return values

    return Model(module.PLANT, initial, sample, module.forces, step, put_out, parameters=module.OWN,
                 descriptions=tuple(getattr(module, "DESCRIPTIONS", {}).items()))


def _identifiers(prefix: str, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(prefix + re.sub(r"\W+", "_", name) for name in names)


@dataclass(frozen=True)
class Actuator:
    """A model to choose, with one argument a state again: what is traced into the kernels.

    Parameters of the table that it does not read stay in its interface, so that a host may exchange one model for
    another. Own variables stand behind the table's.
    """

    name: str
    title: str
    modules: tuple[ModuleType, ...]
    model: Model

    @property
    def plant(self) -> tuple[str, ...]:
        return self.model.plant

    @property
    def kept(self) -> tuple[str, ...]:
        """States that only samples see: the controllers' own two first."""
        return KEPT + self.model.kept

    @property
    def shown(self) -> tuple[str, ...]:
        """What samples show: the measured fin angle, whether a limit was met, the states held for all."""
        return SHOWN + self.model.held

    @property
    def own(self) -> tuple[Variable, ...]:
        """Parameters besides the table's."""
        return self.model.parameters

    @property
    def inputs(self) -> tuple[Variable, ...]:
        return INPUTS + self.model.inputs

    @property
    def outputs(self) -> tuple[Variable, ...]:
        return OUTPUTS + self.model.outputs

    @property
    def parameters(self) -> tuple[Variable, ...]:
        return PARAMETERS + self.own

    @property
    def functions(self) -> tuple[tuple[str, tuple[str, ...], Callable[..., Values]], ...]:
        """Name, names of the arguments and the function of each that is traced.

        initial() gives plant, kept, measured angle and held; sample() takes plant, kept, held and what it is asked,
        gives the reference, kept and shown; step() takes plant, held, the reference in the drive and the boundary;
        outputs() plant, that reference, the DAC's, shown, command and boundary.
        """
        m = self.model
        plant, kept = _identifiers("", self.plant), (*KEPT, *_identifiers("kept_", m.kept))
        held, own = _identifiers("held_", m.held), _identifiers("own_", [v.name for v in m.inputs])
        return (
            ("initial", (), self._initial),
            ("sample", (*plant, *kept, *held, "command", "supply", "enable", *own), self._sample),
            ("forces", ("a_x", "a_y", "a_z", "roll", "pitch"), m.forces),
            ("step", (*plant, *held, "active", *_BOUNDARY, "h"), self._step),
            ("outputs", (*plant, "active", "reference", *SHOWN, *held, "command", *_BOUNDARY), self._outputs),
        )

    def _initial(self, ops: Ops, p: Any) -> Values:
        state, measured = self.model.initial(ops, p)
        return *state.plant, *state.kept, measured, *state.held

    def _sample(self, ops: Ops, p: Any, *a: Value) -> Values:
        m, held, own = self.model, len(self.model.held), len(self.model.inputs)
        plant, a = a[:len(m.plant)], a[len(m.plant):]
        kept, a = a[:len(self.kept)], a[len(self.kept):]
        command, supply, enable = a[held:len(a) - own]
        s = m.sample(ops, p, State(plant, kept, a[:held]), Asked(command, supply, enable, a[len(a) - own:]))
        return s.reference, *s.kept, s.measured, s.limited, *s.held

    def _step(self, ops: Ops, p: Any, *a: Value) -> Values:
        m = self.model
        plant, a = a[:len(m.plant)], a[len(m.plant):]
        held, (*boundary, h) = a[:len(m.held)], a[len(m.held):]
        moved, used = m.step(ops, p, plant, held, Boundary(*boundary), h)
        return *moved, used

    def _outputs(self, ops: Ops, p: Any, *a: Value) -> Values:
        m = self.model
        plant, (active, reference, measured, limited, *a_rest) = a[:len(m.plant)], a[len(m.plant):]
        held, (command, *acting) = tuple(a_rest[:len(m.held)]), a_rest[len(m.held):]
        return m.put_out(ops, p, plant, held, Boundary(active, *acting), Shown(reference, measured, limited, command))


def split(values: Values, count: int) -> tuple[Values, Values]:
    """What an option's inner model has, and the `count` values of the option's own behind it."""
    return values[:len(values) - count], values[len(values) - count:]


def replaced(model: Model, outputs: Values, changes: Mapping[str, Value]) -> Values:
    """A model's outputs with some, by name, replaced."""
    names = [v.name for v in OUTPUTS + model.outputs]
    return tuple(changes.get(name, value) for name, value in zip(names, outputs, strict=True))
