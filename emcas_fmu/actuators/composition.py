"""Groups of parameters, rules, outputs and capabilities, of which actuators are composed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Any, NamedTuple

from ..namespace import Record, with_values
from ..ops.base import Ops, Value
from ..rules import Rule
from ..variables import Terminal, Variable
from .declaration import Actuator, PlantInputs, Values

Change = Callable[[Ops, Any], Any]
"""A function that returns changed parameters."""


class Output(NamedTuple):
    """An output and its equation, a function of ops, the parameters as built and :attr:`Composition.moment`."""

    variable: Variable
    value: Callable[[Ops, Any, Record], Value]


@dataclass(frozen=True, eq=False)
class Group:
    """Parameters, rules, outputs and capabilities that an actuator has or lacks together.

    An actuator without the group may use the same equations, with the values `absent` of the group's parameters, and
    deviations of 0. `wired` says whether the outputs belong to the motor's terminal.
    """

    parameters: tuple[Variable, ...] = ()
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()
    provides: frozenset[str] = frozenset()
    absent: Mapping[str, Any] = field(default_factory=dict)
    wired: bool = True

    @property
    def nominal(self) -> dict[str, float]:
        """The values of the deviations of a plant that its controllers know exactly."""
        return {v.name: 0.0 for v in self.parameters if v.name.startswith("deviation.")}


def _sorted_by(name: Callable[[Any], str], items: Iterable[Any], order: tuple[str, ...]) -> tuple[Any, ...]:
    """Return items by the first prefix of their name in an `order`; the others last, all else as before."""
    def index(item: Any) -> int:
        return next((i for i, prefix in enumerate(order) if name(item).startswith(prefix)), len(order))

    return tuple(sorted(items, key=index))


@dataclass(frozen=True, eq=False)
class Composition:
    """The groups of an actuator, and the function from which their outputs follow.

    `moment(ops, p, x, u)` returns the parameters as built, and whatever the equations of the outputs use at states `x`
    under plant inputs `u`. The orders are prefixes of names: variables that match none come last, group by group. Rules
    are in the order of the groups.
    """

    groups: tuple[Group, ...]
    moment: Callable[[Ops, Any, Record, PlantInputs], tuple[Any, Record]]
    parameter_order: tuple[str, ...] = ()
    output_order: tuple[str, ...] = ()

    @cached_property
    def parameters(self) -> tuple[Variable, ...]:
        """The parameters in the order of the interface."""
        listed = (v for group in self.groups for v in group.parameters)
        return _sorted_by(lambda v: v.name, listed, self.parameter_order)

    @cached_property
    def _outputs(self) -> tuple[Output, ...]:
        listed = (out for group in self.groups for out in group.outputs)
        return _sorted_by(lambda out: out.variable.name, listed, self.output_order)

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """The outputs in the order of the interface."""
        return tuple(out.variable for out in self._outputs)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """The rules, group by group."""
        return tuple(rule for group in self.groups for rule in group.rules)

    @property
    def provides(self) -> frozenset[str]:
        """The capabilities of all groups."""
        return frozenset().union(*(group.provides for group in self.groups))

    @property
    def nominal(self) -> dict[str, float]:
        """The values of the deviations of a plant that its controllers know exactly."""
        return {name: value for group in self.groups for name, value in group.nominal.items()}

    def terminals(self, description: str) -> tuple[Terminal, ...]:
        """Return the terminal of the motor's side."""
        wired = {out.variable for group in self.groups if group.wired for out in group.outputs}
        return (Terminal("motor", description, tuple(v.name for v in self.outputs if v in wired)),)

    def output_values(self, ops: Ops, p: Any, x: Record, u: PlantInputs) -> Values:
        """Return every output."""
        p, now = self.moment(ops, p, x, u)
        return {out.variable.name: out.value(ops, p, now) for out in self._outputs}

    def completed(self, p: Any, optional: tuple[Group, ...]) -> Any:
        """Return parameters with the values `absent` of those that only the `optional` groups have."""
        declared = {v.name.partition("[")[0] for v in self.parameters}
        absent = {name: value for group in optional for name, value in (group.nominal | dict(group.absent)).items()}
        return with_values(p, {name: value for name, value in absent.items() if name not in declared})

    def declared(self, rules: tuple[Rule, ...] = (), terminal: str = "motor and drive") -> dict[str, Any]:
        """Return the fields of an actuator's declaration that follow from its groups, with further `rules`."""
        return {"outputs": self.outputs, "parameters": self.parameters, "rules": (*self.rules, *rules),
                "provides": self.provides, "terminals": self.terminals(terminal), "nominal": self.nominal,
                "output_values": self.output_values}

    def over(self, base: Actuator, change: Change, rules: tuple[Rule, ...] = (), **fields: Any) -> Actuator:
        """Return an actuator of these groups with the equations of `base`, for the parameters that `change` returns.

        `rules` are added to those of the groups. `fields` are other fields of the declaration, used unchanged: an
        equation among them gets the actuator's parameters without `change`.
        """
        declared = {**self.declared(rules), "initial": base.initial, "sample": base.sample,
                    "derivatives": base.derivatives, "step": base.step}
        equations = ("initial", "sample", "derivatives", "step", "output_values")
        declared |= {name: with_parameters(declared[name], change) for name in equations}
        return replace(base, **{**declared, "reference": None, **fields})


def with_parameters(equation: Callable[..., Any], change: Change) -> Callable[..., Any]:
    """Return an equation for the parameters that `change(ops, p)` returns."""
    @wraps(equation)
    def changed(ops: Ops, p: Any, *arguments: Value) -> Any:
        return equation(ops, change(ops, p), *arguments)

    return changed
