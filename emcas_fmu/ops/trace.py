"""Operations that write themselves down: physics in, straight-line Python source out.

A traced function costs no calls, no attribute look-ups and no repeated
subexpressions, and does the very operations of the original in their order, so
both give the same bits. What depends on parameters alone is moved to a prologue
that runs once; a branch's operations stay inside the branch.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Union

from .base import Thunk, Value

Operand = Union["Expr", float, bool]
_TEMPORARY = re.compile(r"\bt\d+\b")


class Expr:
    """A value of the traced program: a name, and whether parameters alone determine it."""

    __slots__ = ("fixed", "name", "tracer")

    def __init__(self, tracer: Tracer, name: str, fixed: bool) -> None:
        self.tracer = tracer
        self.name = name
        self.fixed = fixed

    def __bool__(self) -> bool:
        raise TypeError("a traced value has no truth: use ops.where, ops.branch, ops.both, ops.either, ops.negate")

    def __add__(self, other: Value) -> Value:
        return self.tracer.emit("{} + {}", self, other)

    def __radd__(self, other: Value) -> Value:
        return self.tracer.emit("{} + {}", other, self)

    def __sub__(self, other: Value) -> Value:
        return self.tracer.emit("{} - {}", self, other)

    def __rsub__(self, other: Value) -> Value:
        return self.tracer.emit("{} - {}", other, self)

    def __mul__(self, other: Value) -> Value:
        # Exact for every number, so that folding changes no bit.
        if not isinstance(other, Expr) and abs(other) == 1.0:
            return self if other > 0.0 else -self
        return self.tracer.emit("{} * {}", self, other)

    def __rmul__(self, other: Value) -> Value:
        return self * other

    def __truediv__(self, other: Value) -> Value:
        return self.tracer.emit("{} / {}", self, other)

    def __rtruediv__(self, other: Value) -> Value:
        return self.tracer.emit("{} / {}", other, self)

    def __neg__(self) -> Value:
        return self.tracer.emit("-{}", self)

    def __lt__(self, other: Value) -> Value:
        return self.tracer.emit("{} < {}", self, other)

    def __le__(self, other: Value) -> Value:
        return self.tracer.emit("{} <= {}", self, other)

    def __gt__(self, other: Value) -> Value:
        return self.tracer.emit("{} > {}", self, other)

    def __ge__(self, other: Value) -> Value:
        return self.tracer.emit("{} >= {}", self, other)


@dataclass
class _Assign:
    name: str
    template: str
    operands: tuple[Operand, ...]


@dataclass
class _If:
    condition: Operand
    names: tuple[str, ...]
    yes: _Block
    no: _Block
    yes_values: tuple[Operand, ...]
    no_values: tuple[Operand, ...]


@dataclass
class _Block:
    parent: _Block | None = None
    statements: list[_Assign | _If] = field(default_factory=list)
    known: dict[tuple[Any, ...], Expr] = field(default_factory=dict)

    def find(self, key: tuple[Any, ...]) -> Expr | None:
        block: _Block | None = self
        while block is not None:
            if key in block.known:
                return block.known[key]
            block = block.parent
        return None


class Tracer:
    """An operations namespace (:class:`emcas_fmu.ops.base.Ops`) that records what is asked of it."""

    def __init__(self) -> None:
        self._prologue = _Block()
        self._block = self._prologue
        self._count = 0
        self._parameters: list[tuple[str, str]] = []
        self._functions: list[tuple[str, Sequence[str], _Block, tuple[Operand, ...]]] = []

    # -- leaves and functions ------------------------------------------------

    def parameter(self, key: str) -> Expr:
        """A value known when the program is made, read from the mapping given to `make`."""
        name = f"p{len(self._parameters)}"
        self._parameters.append((name, key))
        return Expr(self, name, True)

    def function(self, name: str, arguments: Sequence[str], body: Callable[..., Iterable[Value]]) -> None:
        """Trace `body(*arguments)` as a function of the program."""
        self._block = block = _Block(self._prologue)
        results = tuple(body(*(Expr(self, argument, False) for argument in arguments)))
        self._block = self._prologue
        self._functions.append((name, arguments, block, results))

    # -- operations ----------------------------------------------------------

    def emit(self, template: str, *operands: Value) -> Expr:
        fixed = all(not isinstance(o, Expr) or o.fixed for o in operands)
        key = (template, *(o.name if isinstance(o, Expr) else (type(o), repr(o)) for o in operands))
        found = self._block.find(key)
        if found is not None:
            return found
        block = self._prologue if fixed else self._block
        result = self._new(fixed)
        block.statements.append(_Assign(result.name, template, operands))
        block.known[key] = result
        return result

    def _new(self, fixed: bool) -> Expr:
        self._count += 1
        return Expr(self, f"{'c' if fixed else 't'}{self._count}", fixed)

    def sin(self, x: Value) -> Value:
        return self.emit("sin({})", x)

    def cos(self, x: Value) -> Value:
        return self.emit("cos({})", x)

    def tan(self, x: Value) -> Value:
        return self.emit("tan({})", x)

    def atan(self, x: Value) -> Value:
        return self.emit("atan({})", x)

    def exp(self, x: Value) -> Value:
        return self.emit("exp({})", x)

    def log(self, x: Value) -> Value:
        return self.emit("log({})", x)

    def sqrt(self, x: Value) -> Value:
        return self.emit("sqrt({})", x)

    def fabs(self, x: Value) -> Value:
        return self.emit("fabs({})", x) if _traced(x) else abs(x)

    def floor(self, x: Value) -> Value:
        return self.emit("float(floor({}))", x)

    def minimum(self, a: Value, b: Value) -> Value:
        return self.emit("{0} if {0} < {1} else {1}", a, b)

    def maximum(self, a: Value, b: Value) -> Value:
        return self.emit("{0} if {0} > {1} else {1}", a, b)

    def clip(self, x: Value, low: Value, high: Value) -> Value:
        return self.emit("{1} if {0} < {1} else {2} if {0} > {2} else {0}", x, low, high)

    def equal(self, a: Value, b: Value) -> Value:
        return self.emit("{} == {}", a, b) if _traced(a, b) else a == b

    def both(self, a: Value, b: Value) -> Value:
        if _traced(a) and _traced(b):
            return self.emit("{} and {}", a, b)
        known, other = (b, a) if _traced(a) else (a, b)
        return other if known else False

    def either(self, a: Value, b: Value) -> Value:
        if _traced(a) and _traced(b):
            return self.emit("{} or {}", a, b)
        known, other = (b, a) if _traced(a) else (a, b)
        return True if known else other

    def negate(self, a: Value) -> Value:
        return self.emit("not {}", a) if _traced(a) else not a

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        if not _traced(condition):
            return yes if condition else no
        return self.emit("{1} if {0} else {2}", condition, yes, no)

    def branch(self, condition: Value, yes: Thunk, no: Thunk) -> tuple[Value, ...]:
        if not isinstance(condition, Expr):
            return yes() if condition else no()
        outer = self._block
        self._block = yes_block = _Block(outer)
        yes_values = tuple(yes())
        self._block = no_block = _Block(outer)
        no_values = tuple(no())
        self._block = outer
        if len(yes_values) != len(no_values):
            raise ValueError(f"branches give {len(yes_values)} and {len(no_values)} values")
        results = tuple(self._new(False) for _ in yes_values)
        outer.statements.append(
            _If(condition, tuple(r.name for r in results), yes_block, no_block, yes_values, no_values))
        return results

    # -- source --------------------------------------------------------------

    def source(self, docstring: str) -> str:
        """The program: a module with `make(parameters) -> tuple of functions`."""
        writer = _Writer([self._prologue, *(block for _, _, block, _ in self._functions)],
                         [value for *_, results in self._functions for value in results])
        body: list[str] = []
        for name, arguments, block, results in self._functions:
            lines = [*writer.block(block, 2), f"        return {writer.tuple_text(results)}"]
            body += [f"    def {name}({', '.join(arguments)}):", *_registers(lines), ""]
        prologue = [f"    {name} = parameters[{key!r}]" for name, key in self._parameters if writer.uses.get(name)]
        prologue += writer.block(self._prologue, 1)
        functions = ", ".join(name for name, *_ in self._functions)
        return "\n".join([f'"""{docstring}"""', "",
                          "from math import atan, cos, exp, fabs, floor, log, sin, sqrt, tan  # noqa: F401", "", "",
                          "def make(parameters):", *prologue, "", *body, f"    return {functions},", ""])


class _Writer:
    """Turns blocks into text: drops what nobody reads, inlines what is read once."""

    def __init__(self, blocks: Sequence[_Block], results: Sequence[Operand]) -> None:
        self.uses: dict[str, int] = {}
        self._text: dict[str, str] = {}
        for value in results:
            self._use(value)
        for block in reversed(blocks):  # the prologue is first in the list and counted last
            self._count(block)

    def _use(self, value: Operand, times: int = 1) -> None:
        if isinstance(value, Expr):
            self.uses[value.name] = self.uses.get(value.name, 0) + times

    def _count(self, block: _Block) -> None:
        for statement in reversed(block.statements):
            if isinstance(statement, _Assign):
                if self.uses.get(statement.name):
                    for index, operand in enumerate(statement.operands):
                        self._use(operand, _occurrences(statement.template, index))
            else:
                live = [i for i, name in enumerate(statement.names) if self.uses.get(name)]
                for i in live:
                    self._use(statement.yes_values[i])
                    self._use(statement.no_values[i])
                self._count(statement.no)
                self._count(statement.yes)
                if live:
                    self._use(statement.condition)

    def operand(self, value: Operand) -> str:
        if isinstance(value, Expr):
            return self._text.get(value.name, value.name)
        text = repr(value)
        return f"({text})" if text.startswith("-") else text

    def tuple_text(self, values: Sequence[Operand]) -> str:
        return ", ".join(self.operand(v) for v in values) + ("," if len(values) == 1 else "")

    def block(self, block: _Block, depth: int) -> list[str]:
        indent = "    " * depth
        lines: list[str] = []
        for statement in block.statements:
            if isinstance(statement, _Assign):
                uses = self.uses.get(statement.name, 0)
                if not uses:
                    continue
                text = statement.template.format(*(self.operand(o) for o in statement.operands))
                if uses == 1 and not statement.name.startswith("c"):
                    self._text[statement.name] = f"({text})"
                else:
                    lines.append(f"{indent}{statement.name} = {text}")
            else:
                live = [i for i, name in enumerate(statement.names) if self.uses.get(name)]
                if not live:
                    continue
                targets = ", ".join(statement.names[i] for i in live)
                for keyword, inner, values in (
                    (f"if {self.operand(statement.condition)}:", statement.yes, statement.yes_values),
                    ("else:", statement.no, statement.no_values),
                ):
                    lines.append(f"{indent}{keyword}")
                    lines += self.block(inner, depth + 1)
                    lines.append(f"{indent}    {targets} = {', '.join(self.operand(values[i]) for i in live)}")
        return lines


def _registers(lines: Sequence[str]) -> list[str]:
    """Give temporaries whose lives do not overlap one name.

    A call's frame holds every local of the function; with hundreds of them it would
    not fit the interpreter's stack chunk, which is then mapped and unmapped call by call.
    A life lasts from the first line that names the temporary to the last, which also
    spans the other branch of a condition that sets it in both.
    """
    last = {name: number for number, line in enumerate(lines) for name in _TEMPORARY.findall(line)}
    names: dict[str, str] = {}
    free: list[str] = []
    result = []
    for number, line in enumerate(lines):
        found = dict.fromkeys(_TEMPORARY.findall(line))
        ending = [name for name in found if last[name] == number]
        starting = [name for name in found if name not in names]
        # What is read for the last time here is read before anything here is set.
        free += sorted(names[name] for name in ending if name in names)
        for name in starting:
            names[name] = free.pop() if free else f"r{len(set(names.values()))}"
        free += sorted(names[name] for name in ending if name in starting)
        result.append(_TEMPORARY.sub(lambda match: names[match.group()], line))
    return result


def _traced(*values: Value) -> bool:
    return any(isinstance(value, Expr) for value in values)


def _occurrences(template: str, index: int) -> int:
    return template.count(f"{{{index}}}") or 1
