"""Printer of traced programs as C over vectors: the scalar program's operations in its order, for several actuators.

In runtime/vector.h ``lanes`` contains a number and ``lanes_mask`` a condition for each actuator of a vector. A side of
a branch runs if one or more of the lanes that count need it; its values are selected in the lanes that need it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from .c_source import CWriter, c_number
from .tracer import BITS, FUNCTIONS, Assign, Expr, If, Operand, Tracer
from .usage import ARITHMETIC

# Operations that cost more than a branch.
_WORK = re.compile(r" / |lanes_(?:sqrt|sin|cos|tan|atan|exp|log)")
_CALLS = {**dict.fromkeys((*FUNCTIONS, *BITS, "negate"), 1), "where": 3, "clip": 3, **dict.fromkeys((
    "both", "either", "minimum", "maximum", "less", "less_equal", "greater", "greater_equal", "equal"), 2)}
TEMPLATES = {**ARITHMETIC, **{name: f"lanes_{name}({', '.join(f'{{{i}}}' for i in range(count))})"
                              for name, count in _CALLS.items()}}


def vector_elementary(tracer: Tracer) -> str:
    """Return the C text of functions ``static inline lanes lanes_<name>(lanes x)``."""
    return "\n".join(_VectorWriter(tracer).elementary(
        "lanes", "    const unsigned which = LANES_ALL;", "    (void)which;"))


def vector_source(tracer: Tracer, prefix: str) -> str:
    """Return the C text of functions over lanes, like those of :func:`emcas_fmu.trace.c_source.c_source` over numbers.

    Their first argument has a bit for each lane that counts; the results of other lanes have no meaning. The scalar
    program computes the constants of each lane.
    """
    writer = _VectorWriter(tracer)
    reads = ", ".join(str(int(name in writer.read_by_functions)) for name, _ in tracer.parameters)
    return "\n".join(["/* Whether the functions read a parameter; others are read by the prologue only. */",
                      f"static const unsigned char {prefix.upper()}_READS[] = {{{reads}}};", "",
                      *writer.functions(prefix)])


class _VectorWriter(CWriter):
    type, which = "lanes", "unsigned"

    def __init__(self, tracer: Tracer) -> None:
        super().__init__(tracer, TEMPLATES)
        self._which = ["which"]  # the lanes that count in each enclosing block, the outermost first

    def literal(self, value: float | bool) -> str:
        return f"lanes_set({c_number(value)})"

    def number(self, value: Operand) -> str:
        """Return the text of an operand as numbers: 1 where a condition holds, else 0."""
        text = self.operand(value)
        return f"lanes_number({text})" if isinstance(value, Expr) and self.holds(value) else text

    def mask(self, value: Operand) -> str:
        """Return the text of an operand as a condition; a number is true if it is not 0."""
        text = self.operand(value)
        return text if isinstance(value, Expr) and self.holds(value) else f"lanes_true({text})"

    def operation(self, statement: Assign) -> str:
        name, operands, value = statement.operation, statement.operands, self.number
        if name in ("both", "either", "negate"):
            value = self.mask
        elif name == "where":
            if self.is_condition(statement):
                value, name = self.mask, "where_mask"
            return f"lanes_{name}({', '.join([self.mask(operands[0]), *map(value, operands[1:])])})"
        return self.templates[name].format(*map(value, operands))

    def assignment(self, name: str, text: str) -> str:
        return f"const {'lanes_mask' if name in self.conditions else 'lanes'} {name} = {text};"

    def branch(self, statement: If, live: Sequence[int], depth: int) -> list[str]:
        indent, label, around = "    " * depth, statement.names[live[0]], self._which[-1]
        lines = [f"{indent}const lanes_mask if_{label} = {self.mask(statement.condition)};"]
        blocks: list[list[str]] = []
        for side, block in (("yes", statement.yes), ("no", statement.no)):
            self._which.append(f"{side}_{label}")
            blocks.append(self.block(block, depth + 1))
            self._which.pop()
        values = [_Chosen.of(self, statement, i) for i in live]
        self.conditions.update(v.name for v in values if v.type == "lanes_mask")
        works = [bool(lines) or any(_WORK.search(text) for text in texts)
                 for lines, texts in zip(blocks, ([v.yes for v in values], [v.no for v in values]), strict=True)]
        if not any(works):
            return lines + [f"{indent}const {v.type} {v.name} = {v.select}(if_{label}, {v.yes}, {v.no});"
                            for v in values]
        # The values of a side without work are set first; those of the other side are then selected.
        lines += [f"{indent}{v.type} {v.name} = {v.no if not works[1] else v.yes if not works[0] else v.start};"
                  for v in values]
        lines.append(f"{indent}const unsigned bits_{label} = lanes_bits(if_{label});")
        if works[0]:
            some = f"yes_{label}"
            lines += [f"{indent}const unsigned {some} = {around} & bits_{label};",
                      f"{indent}if ({f'ELEMENTARY_RARELY({some})' if statement.rare else some}) {{", *blocks[0],
                      *(f"{indent}    {v.name} = {v.yes if works[1] else f'{v.select}(if_{label}, {v.yes}, {v.name})'};"
                        for v in values), f"{indent}}}"]
        if works[1]:
            lines += [f"{indent}const unsigned no_{label} = {around} & ~bits_{label};", f"{indent}if (no_{label}) {{",
                      *blocks[1], *(f"{indent}    {v.name} = {v.select}(if_{label}, {v.name}, {v.no});"
                                    for v in values), f"{indent}}}"]
        return lines


class _Chosen(NamedTuple):
    """A value of a branch in C: name, type, selecting function, initial value, and the value on either side."""

    name: str
    type: str
    select: str
    start: str
    yes: str
    no: str

    @classmethod
    def of(cls, writer: _VectorWriter, statement: If, index: int) -> _Chosen:
        """Return the value with this index of a branch."""
        name, yes, no = statement.names[index], statement.yes_values[index], statement.no_values[index]
        if writer.holds(yes) and writer.holds(no):
            return cls(name, "lanes_mask", "lanes_where_mask", "lanes_of_bits(0)", writer.mask(yes), writer.mask(no))
        return cls(name, "lanes", "lanes_where", "lanes_set(0.0)", writer.number(yes), writer.number(no))
