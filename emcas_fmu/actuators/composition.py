"""Groups of parameters, rules, outputs and capabilities, from which actuators are composed.

A *moment* is an instant, not a torque: a record of the values at it, from which the outputs are computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce, wraps
from typing import Any, NamedTuple

from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..rules import Rule
from ..variables import Terminal, Variable
from . import as_built, fin_port
from .declaration import Actuator, PlantInputs, Values
from .shared import WITHOUT_EFFECT

Change = Callable[[Ops, Any], Any]
"""A function that returns changed parameters."""


class Output(NamedTuple):
    """An output and its equation, a function of ops and of the results of :attr:`Composition.moment`.

    Without an equation the output is the value of its name in the moment or, if the moment has none, the state.
    """

    variable: Variable
    value: fin_port.Equation | None = None

    def of(self, ops: Ops, p: Any, now: Record) -> Value:
        """Return the output's value [SI] at the moment `now`, for parameters `p` as built."""
        if self.value is not None:
            return self.value(ops, p, now)
        name = self.variable.name
        return getattr(now if name in vars(now) else now.x, name)


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters, rules, outputs and capabilities that an actuator has or lacks together.

    An actuator without the group may use the same equations: the group's parameters then have the values in `absent` or
    in :data:`.shared.WITHOUT_EFFECT`, and its `deviations` are 0. `imperfections` have the form of those of an
    :class:`.Actuator`. `terminal` is the name of the outputs' terminal; empty for none.
    """

    parameters: tuple[Variable, ...] = ()
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()
    provides: tuple[str, ...] = ()
    absent: Mapping[str, Any] = field(default_factory=dict)
    deviations: tuple[as_built.Deviation, ...] = ()
    terminal: str = "motor"
    imperfections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def reworded(self, words: Mapping[str, str], sheets: Mapping[str, str] | None = None) -> Group:
        """Return the group with texts replaced in its variables' descriptions (`words`) and sheets (`sheets`).

        Each mapping has the old text as key and the new one as value.
        """
        def changed(v: Variable) -> Variable:
            return replace(v, description=_replaced(v.description, words), sheet=_replaced(v.sheet, sheets or {}))

        return replace(self, parameters=tuple(map(changed, self.parameters)),
                       outputs=tuple(out._replace(variable=changed(out.variable)) for out in self.outputs))


def _replaced(text: str, words: Mapping[str, str]) -> str:
    return reduce(lambda text, word: text.replace(*word), words.items(), text)


def port(parameters: tuple[Variable, ...] = fin_port.PARAMETERS, rate: fin_port.Equation = lambda ops, p, m: m.rate,
         **descriptions: str) -> Group:
    """Return the group of the fin port; `rate` is the equation of fin_rate, `descriptions` describe outputs by name.

    The equations use the moment of :data:`.fin_port.EQUATIONS`.
    """
    equations = {**fin_port.EQUATIONS, "fin_rate": rate}
    outputs = tuple(Output(v, equations[v.name]) for v in fin_port.described(descriptions))
    return Group(parameters, outputs, terminal="")


def _sorted_by(name: Callable[[Any], str], items: Iterable[Any], order: tuple[str, ...]) -> tuple[Any, ...]:
    """Return items sorted by the first prefix in `order` with which their names begin; without one they come last."""
    def index(item: Any) -> int:
        return next((i for i, prefix in enumerate(order) if name(item).startswith(prefix)), len(order))

    return tuple(sorted(items, key=index))


@dataclass(frozen=True, eq=False)
class Composition:
    """The groups of an actuator, and the function that computes the values from which their outputs follow.

    `moment(ops, p, x, u)` returns the parameters as built, and the values that the equations of the outputs use, at
    states `x` and plant inputs `u`. The orders are prefixes of names: variables are sorted by them, those that match
    none come last. Variables of one prefix, and rules, are in the order of the groups, deviations after parameters.
    """

    groups: tuple[Group, ...]
    moment: Callable[[Ops, Any, Record, PlantInputs], tuple[Any, Record]]
    parameter_order: tuple[str, ...] = ()
    output_order: tuple[str, ...] = ()

    @cached_property
    def deviations(self) -> tuple[as_built.Deviation, ...]:
        """The deviations of the plant from the parameters that the controllers know."""
        return tuple(deviation for group in self.groups for deviation in group.deviations)

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The parameters in the order of the interface."""
        listed = (*(v for group in self.groups for v in group.parameters), *(d.variable for d in self.deviations))
        return _sorted_by(lambda v: v.name, listed, self.parameter_order)

    @cached_property
    def _outputs(self) -> tuple[Output, ...]:
        listed = (out for group in self.groups for out in group.outputs)
        return _sorted_by(lambda out: out.variable.name, listed, self.output_order)

    @cached_property
    def as_built(self) -> Change:
        """The function that returns the plant's parameters from those that the controllers know."""
        return as_built.plant(*self.deviations)

    def output_values(self, ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return every output by name, in SI."""
        p, now = self.moment(ops, p, x, u)
        return {out.variable.name: out.of(ops, p, now) for out in self._outputs}

    def completed(self, p: Any, optional: tuple[Group, ...]) -> Any:
        """Return `p`, with values without effect for the parameters of `optional` groups that are not declared here."""
        declared = {v.name.partition("[")[0] for v in self.parameters}
        absent: dict[str, Any] = {}
        for group in optional:
            names = {v.name.partition("[")[0] for v in group.parameters}
            absent |= {deviation.variable.name: 0.0 for deviation in group.deviations}
            absent |= {name: value for name, value in WITHOUT_EFFECT.items() if name in names} | dict(group.absent)
        return with_values(p, {name: value for name, value in absent.items() if name not in declared})

    def declared(self, rules: tuple[Rule, ...] = (), **terminals: str) -> dict[str, Any]:
        """Return the fields of an actuator's declaration that follow from its groups; `rules` are added to theirs.

        `terminals` are descriptions of terminals by name, by default of `motor` alone; a terminal without outputs is
        left out.
        """
        def members(terminal: str) -> tuple[str, ...]:
            connected = {out.variable for group in self.groups if group.terminal == terminal for out in group.outputs}
            return tuple(out.variable.name for out in self._outputs if out.variable in connected)

        imperfections: dict[str, dict[str, Any]] = {}
        for name, without in (each for group in self.groups for each in group.imperfections.items()):
            imperfections.setdefault(name, {}).update(without)
        return {"outputs": tuple(out.variable for out in self._outputs), "parameters": self.parameters,
                "imperfections": imperfections,
                "rules": (*(rule for group in self.groups for rule in group.rules), *rules),
                "provides": frozenset(capability for group in self.groups for capability in group.provides),
                "terminals": tuple(Terminal(name, description, members(name)) for name, description in (
                    terminals or {"motor": "motor and drive"}).items() if members(name)),
                "nominal": {deviation.variable.name: 0.0 for deviation in self.deviations},
                "output_values": self.output_values}

    def over(self, base: Actuator, change: Change, rules: tuple[Rule, ...] = (), **fields: Any) -> Actuator:
        """Return an actuator of these groups with the equations of `base`, for the parameters that `change` returns.

        `rules` are added to those of the groups. `fields` are other fields of the declaration; to equations among them
        `change` is not applied.
        """
        equations = {name: getattr(base, name) for name in ("initial", "sample", "derivatives", "step", "feed_forward")}
        equations["output_values"] = self.output_values
        changed = {name: with_parameters(equation, change) for name, equation in equations.items() if equation}
        return replace(base, **{**self.declared(rules), **changed, "reference": None, **fields})


def with_parameters(equation: Callable[..., Any], change: Change) -> Callable[..., Any]:
    """Return an equation for the parameters that `change(ops, p)` returns."""
    @wraps(equation)
    def changed(ops: Ops, p: Any, *arguments: Value) -> Any:
        return equation(ops, change(ops, p), *arguments)

    return changed
