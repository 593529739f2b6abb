"""Tracing: operations that record themselves turn equations into a straight-line program.

A traced function looks up no attributes, calls only elementary functions, and reuses results of repeated operations.
Its operations are those of the original function in the same order, so the results are equal. Values that depend on
parameters alone are computed in a prologue that runs once. :mod:`emcas_fmu.trace.python_source` and
:mod:`emcas_fmu.trace.c_source` print the program.
"""

from __future__ import annotations

import keyword
import re
import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partialmethod
from math import isinf
from typing import Any, Union

from ..errors import hint
from ..ops.base import Ops, Thunk, Value
from ..ops.derived import Derived

Operand = Union["Expr", float, bool]
FUNCTIONS = ("sin", "cos", "tan", "atan", "exp", "log", "sqrt", "fabs", "floor")
"""Operations with one operand, written as functions."""
BITS = ("power_of_two", "exponent")
"""Operations on the bits of one value, for the elementary functions (:class:`emcas_fmu.ops.elementary.Bits`)."""


def _operator(operation: str, swapped: bool = False) -> Callable[[Expr, Value], Value]:
    """Return the operator that records an operation on a traced value and another value, the first if `swapped`."""
    def record(self: Expr, other: Value) -> Value:
        return self.tracer.emit(operation, other, self) if swapped else self.tracer.emit(operation, self, other)

    return record


def _comparison(operation: str, greater: bool = False) -> Callable[[Expr, Value], Value]:
    """Return the operator that records a comparison, unless the other value is infinite: traced values are finite."""
    def record(self: Expr, other: Value) -> Value:
        if _infinite(other):
            return (other < 0.0) is greater
        return self.tracer.emit(operation, self, other)

    return record


class Expr:
    """A value of the traced program: its name, and whether it depends on parameters alone (`fixed`)."""

    __slots__ = ("fixed", "name", "tracer")

    def __init__(self, tracer: Tracer, name: str, fixed: bool) -> None:
        self.tracer = tracer
        self.name = name
        self.fixed = fixed

    def __repr__(self) -> str:
        return self.name

    __hash__ = None  # type: ignore[assignment]
    __array_ufunc__ = None  # NumPy then refuses a traced value instead of calling its operators for each element

    def __eq__(self, other: object) -> bool:
        raise TypeError("traced values are compared by ops.equal, not by == or !=")

    def __bool__(self) -> bool:
        raise TypeError("a traced value has no truth: use ops.where, ops.branch, ops.both, ops.either, ops.negate")

    __add__ = _operator("add")
    __radd__ = _operator("add", swapped=True)
    __sub__ = _operator("subtract")
    __rsub__ = _operator("subtract", swapped=True)
    __rtruediv__ = _operator("divide", swapped=True)
    __lt__ = _comparison("less")
    __le__ = _comparison("less_equal")
    __gt__ = _comparison("greater", greater=True)
    __ge__ = _comparison("greater_equal", greater=True)

    def __truediv__(self, other: Value) -> Value:
        if not isinstance(other, Expr) and other == 0.0:
            raise ZeroDivisionError("division by 0 in traced code")
        return self.tracer.emit("divide", self, other)

    def __pow__(self, exponent: Value) -> Value:
        raise TypeError("there is no ** in traced code: write ops.pow(x, y)")

    def __abs__(self) -> Value:
        return self.tracer.fabs(self)

    def __mul__(self, other: Value) -> Value:
        # A product with 1 or -1 is exact: it is left out without changing a bit.
        if not isinstance(other, Expr) and abs(other) == 1.0:
            return self if other > 0.0 else -self
        return self.tracer.emit("multiply", self, other)

    __rmul__ = __mul__

    def __neg__(self) -> Value:
        return self.tracer.emit("negative", self)


@dataclass(slots=True)
class Assign:
    """``name = operation(operands)``."""

    name: str
    operation: str
    operands: tuple[Operand, ...]


@dataclass(slots=True)
class If:
    """If the condition holds, run `yes` and set `names` to `yes_values`; otherwise run `no` and set `no_values`."""

    condition: Operand
    names: tuple[str, ...]
    yes: Block
    no: Block
    yes_values: tuple[Operand, ...]
    no_values: tuple[Operand, ...]
    rare: bool = False


@dataclass(slots=True)
class Block:
    """Statements in their order."""

    statements: list[Assign | If] = field(default_factory=list)


@dataclass(slots=True)
class _Scope:
    """Conditions and values known while a block is traced, in addition to those in the `outer` scopes."""

    outer: _Scope | None = None
    holding: dict[str, bool] = field(default_factory=dict)
    """The condition of the branch to which the block belongs, and whether it holds in the block."""
    computed: dict[tuple[Any, ...], Expr] = field(default_factory=dict)
    """Values by operation and operands, for reuse."""
    block: Block = field(default_factory=Block)

    def find(self, key: tuple[Any, ...]) -> Expr | None:
        scope: _Scope | None = self
        while scope is not None:
            if (found := scope.computed.get(key)) is not None:
                return found
            scope = scope.outer
        return None

    def holds(self, condition: Value) -> Value:
        """Return True or False if a branch around the block determines the condition, else the condition."""
        scope: _Scope | None = self
        while scope is not None and isinstance(condition, Expr):
            condition = scope.holding.get(condition.name, condition)
            scope = scope.outer
        return condition


# Words of Python, of C, and of the code printed around the functions.
_WORDS = f"""
    {" ".join(keyword.kwlist)} {" ".join(FUNCTIONS)} auto bool case char const default do double enum extern frexp goto
    inf inline int ldexp long lru_cache nan register restrict short signed sizeof static struct switch typedef union
    unsigned void volatile main size_t fmin fmax errno NULL NAN INFINITY HUGE_VAL float parameters make out p c"""
_RESERVED = re.compile(rf"([pctr]\d+|{'|'.join(_WORDS.split())})_*")


def _printed(argument: str) -> str:
    """Return an argument's name for generated code; it is no temporary, parameter or reserved word."""
    return f"{argument}_" if _RESERVED.fullmatch(argument) else argument


@dataclass
class TracedFunction:
    """A function of the program: its name, its arguments as passed and as printed, its statements and results."""

    name: str
    arguments: Sequence[str]
    printed: Sequence[str]
    block: Block
    results: tuple[Operand, ...]


class Tracer(Derived):
    """An operations namespace (:class:`emcas_fmu.ops.base.Ops`) that records its operations."""

    def __init__(self) -> None:
        self._itself = weakref.proxy(self)  # for values; a strong reference would be a cycle, which is collected late
        self._first = self._scope = _Scope()
        self.prologue = self._first.block
        self._count = 0
        self.parameters: list[tuple[str, str]] = []
        self.functions: list[TracedFunction] = []

    def __getattr__(self, name: str) -> Any:
        known = [operation for operation in vars(Ops) if not operation.startswith("_")]
        raise AttributeError(f"ops has no {name}{hint(name, known)}; it has {', '.join(known)}")

    def parameter(self, key: str) -> Expr:
        """Return a parameter of the program, with the name `key` in the mapping that the caller passes to `make`."""
        name = f"p{len(self.parameters)}"
        self.parameters.append((name, key))
        return Expr(self._itself, name, True)

    def function(self, name: str, arguments: Sequence[str], body: Callable[..., Iterable[Value]]) -> None:
        """Trace `body(*arguments)` as a function of the program."""
        self._scope = scope = _Scope(self._first)
        printed = tuple(map(_printed, arguments))
        results = tuple(body(*(Expr(self._itself, argument, False) for argument in printed)))
        self._scope = self._first
        self.functions.append(TracedFunction(name, arguments, printed, scope.block, results))

    def emit(self, operation: str, *operands: Value) -> Expr:
        """Return the value of an operation, which is recorded unless it has been recorded before."""
        fixed = all(operand.fixed for operand in operands if isinstance(operand, Expr))
        key = operation, *map(repr, operands)  # as texts: 0.0 and -0.0 are equal, but differ in their bits
        scope = self._first if fixed else self._scope
        if (computed := scope.find(key)) is not None:
            return computed
        result = scope.computed[key] = self._new(fixed)
        scope.block.statements.append(Assign(result.name, operation, operands))
        return result

    def _new(self, fixed: bool) -> Expr:
        self._count += 1
        return Expr(self._itself, f"{'c' if fixed else 't'}{self._count}", fixed)

    sin = partialmethod(emit, "sin")
    cos = partialmethod(emit, "cos")
    tan = partialmethod(emit, "tan")
    atan = partialmethod(emit, "atan")
    exp = partialmethod(emit, "exp")
    log = partialmethod(emit, "log")
    sqrt = partialmethod(emit, "sqrt")
    floor = partialmethod(emit, "floor")
    power_of_two = partialmethod(emit, "power_of_two")
    exponent = partialmethod(emit, "exponent")

    def fabs(self, x: Value) -> Value:
        return self.emit("fabs", x) if _traced(x) else abs(x)

    def minimum(self, a: Value, b: Value) -> Value:
        return min(a, b) if _infinite(a) and not _traced(b) else self.emit("minimum", a, b)

    def maximum(self, a: Value, b: Value) -> Value:
        return max(a, b) if _infinite(a) and not _traced(b) else self.emit("maximum", a, b)

    def clip(self, x: Value, low: Value, high: Value) -> Value:
        return x if _infinite(low) and _infinite(high) else self.emit("clip", x, low, high)

    def equal(self, a: Value, b: Value) -> Value:
        return self.emit("equal", a, b) if _traced(a, b) else a == b

    def both(self, a: Value, b: Value) -> Value:
        if _traced(a) and _traced(b):
            return self.emit("both", a, b)
        constant, other = (b, a) if _traced(a) else (a, b)
        return other if constant else False

    def either(self, a: Value, b: Value) -> Value:
        if _traced(a) and _traced(b):
            return self.emit("either", a, b)
        constant, other = (b, a) if _traced(a) else (a, b)
        return True if constant else other

    def negate(self, a: Value) -> Value:
        return self.emit("negate", a) if _traced(a) else not a

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        condition = self._scope.holds(condition)
        if not _traced(condition):
            return yes if condition else no
        return self.emit("where", condition, yes, no)

    def branch(self, condition: Value, yes: Thunk, no: Thunk, rare: bool = False) -> tuple[Value, ...]:
        outer = self._scope
        condition = outer.holds(condition)
        if not isinstance(condition, Expr):
            return yes() if condition else no()
        sides = []
        for holds, side in ((True, yes), (False, no)):
            self._scope = scope = _Scope(outer, {condition.name: holds})
            sides.append((scope.block, tuple(side())))
        self._scope = outer
        (yes_block, yes_values), (no_block, no_values) = sides
        if len(yes_values) != len(no_values):
            raise ValueError(f"ops.branch: the functions return {len(yes_values)} and {len(no_values)} values; both "
                             "must return the same number")
        results = tuple(self._new(False) for _ in yes_values)
        outer.block.statements.append(
            If(condition, tuple(r.name for r in results), yes_block, no_block, yes_values, no_values, rare))
        return results


def _infinite(value: Value) -> bool:
    return isinstance(value, float) and isinf(value)


def _traced(*values: Value) -> bool:
    return any(isinstance(value, Expr) for value in values)
