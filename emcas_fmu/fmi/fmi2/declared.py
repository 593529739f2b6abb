"""Declarations of the generated slave: variables, parameters and rules, and their distribution to line and fins.

It is embedded in the FMU and imports only the standard library and other embedded modules.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite, nan
from typing import Any, ClassVar

from ...rules import check_ranges, check_rules
from ...runtime.core import Core, Functions, Sizes, inputs_of
from ...runtime.multi_fin import MultiFin
from .reporting import ReportingSlave


class DeclaredSlave(ReportingSlave):
    """Base of the slave: the class attributes of the generated class, its variables' values, and checks of these."""

    make: ClassVar[Callable[[Mapping[str, Any]], Functions]]  # the core's functions with these parameters
    make_checks: ClassVar[Callable[[Mapping[str, Any]], tuple[Callable[[float], tuple[Any, ...]], ...]]]
    rules: ClassVar[tuple[tuple[str, bool, bool], ...]]  # for each check: message, whether scanned, whether it warns
    make_line_checks: ClassVar[Callable[[Mapping[str, Any]], tuple[Callable[[float], tuple[Any, ...]], ...]]]
    line_rules: ClassVar[tuple[tuple[str, bool, bool], ...]]  # of the line; if empty, there is no make_line_checks
    # By value reference, each variable's name, kind, whether it is fixed, minimum and maximum; and its start value.
    rows: ClassVar[tuple[tuple[str, str, bool, float, float], ...]]
    start_values: ClassVar[tuple[Any, ...]]
    # Indices of the rows: inputs, then outputs, then parameters; `motion` are the inputs of the vehicle's motion.
    inputs: ClassVar[range]
    outputs: ClassVar[range]
    parameters: ClassVar[range]
    motion: ClassVar[slice]
    held: ClassVar[tuple[int, ...]]  # indices of inputs that are parameters of the FMU
    hidden: ClassVar[tuple[int, ...]]  # indices of inputs that the model description does not have
    fmu_guid: ClassVar[str]
    sizes: ClassVar[Sizes]  # of a core
    no_supply: ClassVar[str]  # "supply_voltage = 0"; empty without a supply
    power: ClassVar[int | None]  # index of the supply's power among a fin's outputs; None without a supply
    names: ClassVar[tuple[str, ...]]  # of one fin's parameters; in the rows the line's parameters precede the fins'
    fin_inputs: ClassVar[tuple[tuple[int, ...], ...]]  # value references of each fin's inputs
    mixing: ClassVar[tuple[int, ...]]  # value references of the mixing inputs; empty for a single fin
    of_fin: ClassVar[str]  # prefix of a fin's messages, with %d for its number; empty for a single fin
    step_begin: ClassVar[int | None]  # index of the input for the beginning of the host's step [s], if any
    # Computed once per class.
    _kinds: ClassVar[dict[str, frozenset[int]]]  # indices of the rows by kind
    _output_slice: ClassVar[slice]
    _several: ClassVar[bool]  # whether there are several fins
    _line_parameters: ClassVar[int]  # their number
    _nan_loads: ClassVar[Any]  # motion loads of a motion that is not finite

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if not hasattr(cls, "rows"):  # a base of the generated class
            return
        cls._kinds = {kind: frozenset(i for i, r in enumerate(cls.rows) if r[1] == kind) - set(cls.hidden)
                      for kind in ("Real", "Integer", "Boolean", "String")}
        cls._output_slice = slice(cls.outputs.start, cls.outputs.stop)
        cls._several = len(cls.fin_inputs) > 1
        cls._line_parameters = len(cls.parameters) - len(cls.names) * len(cls.fin_inputs)
        loads = (nan,) * (cls.sizes.loads - 1)
        cls._nan_loads = [loads] * len(cls.fin_inputs) if cls._several else loads

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._values: list[Any] = list(self.start_values)
        self._warned: set[tuple[str, int]] = set()  # warnings that hold and have been logged

    def _fins(self, values: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
        """Return each fin's parameters by their names in a single actuator; the key is the prefix of its messages."""
        count, numbers = len(self.names), list(values.values())[self._line_parameters:]
        return {self.of_fin.replace("%d", str(fin + 1)):
                dict(zip(self.names, numbers[fin * count:(fin + 1) * count], strict=True))
                for fin in range(len(self.fin_inputs))}

    def _functions(self, values: Mapping[str, Any]) -> Any:
        functions = [type(self).make(one) for one in self._fins(values).values()]
        return functions if self._several else functions[0]

    def _new_core(self, values: Mapping[str, Any]) -> Core | MultiFin:
        if not self._several:
            return Core(self._functions(values), self.sizes)
        line = list(values.values())[:self._line_parameters]
        return MultiFin(self._functions(values), line, self.power, self.sizes)

    def _inputs_of_one(self, row: Sequence[Any], motion_loads: Sequence[float]) -> tuple[Any, ...]:
        """Return the inputs of one core from a row of its actuator's inputs."""
        return inputs_of(row, motion_loads, self.sizes.motion, self.power is not None)

    def _finite(self, inputs: tuple[Any, ...]) -> bool:
        return all(isfinite(sum(each)) for each in inputs) if self._several else isfinite(sum(inputs))

    def _broken_rules(self, values: Mapping[str, Any], warnings: bool = False) -> dict[tuple[str, int], str]:
        """Return the messages of broken rules by fin and rule: of those that warn, if `warnings`, or that refuse."""
        judged = [("", type(self).make_line_checks(values), self.line_rules)] if self.line_rules else []
        judged += [(prefix, type(self).make_checks(one), self.rules) for prefix, one in self._fins(values).items()]
        return {(prefix, i): prefix + message for prefix, checks, rules in judged
                for i, (check, rule) in enumerate(zip(checks, rules, strict=True))
                for message in check_rules([(check, *rule)], warnings)}

    def _warn(self) -> None:
        """Log the warnings about the parameters, except those that are logged already and still hold."""
        warnings = self._broken_rules(self._parameter_values(), warnings=True)
        for rule in warnings:
            if rule not in self._warned:
                self._log(warnings[rule], "warning")
        self._warned = set(warnings)

    def _parameter_values(self) -> dict[str, Any]:
        return {self.rows[i][0]: self._values[i] for i in self.parameters}

    def _parameter_problems(self, values: Mapping[str, Any] | None = None) -> list[str]:
        values = self._parameter_values() if values is None else values
        limits = ((r[0], r[3], r[4]) for r in (self.rows[i] for i in (*self.held, *self.parameters))
                  if r[1] != "Boolean")
        held = {self.rows[i][0]: self._values[i] for i in self.held}
        return check_ranges({**held, **values}, limits) or list(self._broken_rules(values).values())
