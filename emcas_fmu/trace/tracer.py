"""Operations that write themselves down: physics in, a straight-line program out.

A traced function costs no calls, no attribute look-ups and no repeated
subexpressions, and does the very operations of the original in their order, so
both give the same bits. What depends on parameters alone is moved to a prologue
that runs once; a branch's operations stay inside the branch. :mod:`python_source`
and :mod:`c_source` print the program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import isinf
from typing import Any, Union

from ..ops.base import Thunk, Value

Operand = Union["Expr", float, bool]


class Expr:
    """A value of the traced program: a name, and whether parameters alone determine it."""

    __slots__ = ("fixed", "name", "tracer")

    def __init__(self, tracer: Tracer, name: str, fixed: bool) -> None:
        self.tracer = tracer
        self.name = name
        self.fixed = fixed

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        raise TypeError("traced values are compared by ops.equal, not by == or !=")

    def __bool__(self) -> bool:
        raise TypeError("a traced value has no truth: use ops.where, ops.branch, ops.both, ops.either, ops.negate")

    def __add__(self, other: Value) -> Value:
        return self.tracer.emit("add", self, other)

    def __radd__(self, other: Value) -> Value:
        return self.tracer.emit("add", other, self)

    def __sub__(self, other: Value) -> Value:
        return self.tracer.emit("subtract", self, other)

    def __rsub__(self, other: Value) -> Value:
        return self.tracer.emit("subtract", other, self)

    def __mul__(self, other: Value) -> Value:
        # Exact for every number, so that folding changes no bit.
        if not isinstance(other, Expr) and abs(other) == 1.0:
            return self if other > 0.0 else -self
        return self.tracer.emit("multiply", self, other)

    def __rmul__(self, other: Value) -> Value:
        return self * other

    def __truediv__(self, other: Value) -> Value:
        return self.tracer.emit("divide", self, other)

    def __rtruediv__(self, other: Value) -> Value:
        return self.tracer.emit("divide", other, self)

    def __neg__(self) -> Value:
        return self.tracer.emit("negative", self)

    # Every value is below infinity: a limit there is none.

    def __lt__(self, other: Value) -> Value:
        return other > 0.0 if _infinite(other) else self.tracer.emit("less", self, other)

    def __le__(self, other: Value) -> Value:
        return other > 0.0 if _infinite(other) else self.tracer.emit("less_equal", self, other)

    def __gt__(self, other: Value) -> Value:
        return other < 0.0 if _infinite(other) else self.tracer.emit("greater", self, other)

    def __ge__(self, other: Value) -> Value:
        return other < 0.0 if _infinite(other) else self.tracer.emit("greater_equal", self, other)


@dataclass
class Assign:
    """``name = operation(operands)``."""

    name: str
    operation: str
    operands: tuple[Operand, ...]


@dataclass
class If:
    """``names`` are `yes_values` after the block `yes` where the condition holds, else `no_values` after `no`."""

    condition: Operand
    names: tuple[str, ...]
    yes: Block
    no: Block
    yes_values: tuple[Operand, ...]
    no_values: tuple[Operand, ...]


@dataclass
class Block:
    """Statements in their order; what its parents compute is known in it too."""

    parent: Block | None = None
    statements: list[Assign | If] = field(default_factory=list)
    known: dict[tuple[Any, ...], Expr] = field(default_factory=dict)

    def find(self, key: tuple[Any, ...]) -> Expr | None:
        block: Block | None = self
        while block is not None:
            if key in block.known:
                return block.known[key]
            block = block.parent
        return None


@dataclass
class Traced:
    """A function of the program: its arguments, statements and results."""

    name: str
    arguments: Sequence[str]
    block: Block
    results: tuple[Operand, ...]


class Tracer:
    """An operations namespace (:class:`emcas_fmu.ops.base.Ops`) that records what is asked of it."""

    def __init__(self) -> None:
        self.prologue = Block()
        self._block = self.prologue
        self._count = 0
        self.parameters: list[tuple[str, str]] = []
        self.functions: list[Traced] = []

    # -- leaves and functions ------------------------------------------------

    def parameter(self, key: str) -> Expr:
        """A value known when the program is made, read from the mapping given to `make`."""
        name = f"p{len(self.parameters)}"
        self.parameters.append((name, key))
        return Expr(self, name, True)

    def function(self, name: str, arguments: Sequence[str], body: Callable[..., Iterable[Value]]) -> None:
        """Trace `body(*arguments)` as a function of the program."""
        self._block = block = Block(self.prologue)
        results = tuple(body(*(Expr(self, argument, False) for argument in arguments)))
        self._block = self.prologue
        self.functions.append(Traced(name, arguments, block, results))

    # -- operations ----------------------------------------------------------

    def emit(self, operation: str, *operands: Value) -> Expr:
        """The value of an operation of :data:`OPERATIONS`, recorded unless it is known already."""
        fixed = all(not isinstance(o, Expr) or o.fixed for o in operands)
        key = (operation, *(o.name if isinstance(o, Expr) else (type(o), repr(o)) for o in operands))
        found = self._block.find(key)
        if found is not None:
            return found
        block = self.prologue if fixed else self._block
        result = self._new(fixed)
        block.statements.append(Assign(result.name, operation, operands))
        block.known[key] = result
        return result

    def _new(self, fixed: bool) -> Expr:
        self._count += 1
        return Expr(self, f"{'c' if fixed else 't'}{self._count}", fixed)

    def sin(self, x: Value) -> Value:
        return self.emit("sin", x)

    def cos(self, x: Value) -> Value:
        return self.emit("cos", x)

    def tan(self, x: Value) -> Value:
        return self.emit("tan", x)

    def atan(self, x: Value) -> Value:
        return self.emit("atan", x)

    def exp(self, x: Value) -> Value:
        return self.emit("exp", x)

    def log(self, x: Value) -> Value:
        return self.emit("log", x)

    def sqrt(self, x: Value) -> Value:
        return self.emit("sqrt", x)

    def fabs(self, x: Value) -> Value:
        return self.emit("fabs", x) if _traced(x) else abs(x)

    def floor(self, x: Value) -> Value:
        return self.emit("floor", x)

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
        known, other = (b, a) if _traced(a) else (a, b)
        return other if known else False

    def either(self, a: Value, b: Value) -> Value:
        if _traced(a) and _traced(b):
            return self.emit("either", a, b)
        known, other = (b, a) if _traced(a) else (a, b)
        return True if known else other

    def negate(self, a: Value) -> Value:
        return self.emit("negate", a) if _traced(a) else not a

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        if not _traced(condition):
            return yes if condition else no
        return self.emit("where", condition, yes, no)

    def branch(self, condition: Value, yes: Thunk, no: Thunk) -> tuple[Value, ...]:
        if not isinstance(condition, Expr):
            return yes() if condition else no()
        outer = self._block
        self._block = yes_block = Block(outer)
        yes_values = tuple(yes())
        self._block = no_block = Block(outer)
        no_values = tuple(no())
        self._block = outer
        if len(yes_values) != len(no_values):
            raise ValueError(f"branches give {len(yes_values)} and {len(no_values)} values")
        results = tuple(self._new(False) for _ in yes_values)
        outer.statements.append(
            If(condition, tuple(r.name for r in results), yes_block, no_block, yes_values, no_values))
        return results


def _infinite(value: Value) -> bool:
    return isinstance(value, float) and isinf(value)


def _traced(*values: Value) -> bool:
    return any(isinstance(value, Expr) for value in values)
