"""Traced programs as C over vectors: the scalar program's operations in its order, for several actuators at once.

In runtime/vector.h ``lanes`` is a number for each actuator of a vector and ``lanes_mask`` a condition for each. A
branch runs when a lane of those that count wants it, and its values are taken where its condition holds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from .c_source import CWriter, any_literal
from .tracer import BITS, FUNCTIONS, Assign, Expr, If, Operand, Tracer
from .usage import ARITHMETIC

# What costs more than a branch.
_WORK = re.compile(r" / |lanes_(?:sqrt|sin|cos|tan|atan|exp|log)")
_CALLS = {**dict.fromkeys((*FUNCTIONS, *BITS, "negate"), 1), "where": 3, "clip": 3, **dict.fromkeys((
    "both", "either", "minimum", "maximum", "less", "less_equal", "greater", "greater_equal", "equal"), 2)}
TEMPLATES = {**ARITHMETIC, **{name: f"lanes_{name}({', '.join(f'{{{i}}}' for i in range(count))})"
                              for name, count in _CALLS.items()}}


def vector_elementary(tracer: Tracer) -> str:
    """Return functions of one value with one result as ``static inline lanes lanes_<name>(lanes x)``."""
    return "\n".join(_VectorWriter(tracer).elementary(
        "lanes", "    const unsigned which = LANES_ALL;", "    (void)which;"))


def vector_source(tracer: Tracer, prefix: str) -> str:
    """Return functions over lanes, as :func:`emcas_fmu.trace.c_source.c_source` gives them over numbers.

    Each takes first the lanes that count, a bit each: what it gives for others has no meaning. Constants are prepared
    for each lane by the scalar program.
    """
    writer = _VectorWriter(tracer)
    reads = ", ".join(str(int(name in writer.read_by_functions)) for name, _ in tracer.parameters)
    return "\n".join(["/* Whether a parameter is read by the functions, or by what is prepared only. */",
                      f"static const unsigned char {prefix.upper()}_READS[] = {{{reads}}};", "",
                      *writer.functions(prefix)])


class _VectorWriter(CWriter):
    type, which = "lanes", "unsigned"

    def __init__(self, tracer: Tracer) -> None:
        super().__init__(tracer, TEMPLATES)
        self._which = ["which"]  # the lanes that count in each block around, from the outside

    def literal(self, value: float | bool) -> str:
        return f"lanes_set({any_literal(value)})"

    def number(self, value: Operand) -> str:
        """Return the text of an operand as numbers: 1 where a condition holds, else 0."""
        text = self.operand(value)
        return f"lanes_number({text})" if isinstance(value, Expr) and self.holds(value) else text

    def mask(self, value: Operand) -> str:
        """Return the text of an operand as a condition: a number that is not 0 is one that holds."""
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
        # A side without work is where its values begin; the other's are put in their places.
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
    """A value of a branch: its name, what it is and what selects it in C, before the branch, and on either side."""

    name: str
    type: str
    select: str
    start: str
    yes: str
    no: str

    @classmethod
    def of(cls, writer: _VectorWriter, statement: If, place: int) -> _Chosen:
        """Return the value at a place of a branch."""
        name, yes, no = statement.names[place], statement.yes_values[place], statement.no_values[place]
        if writer.holds(yes) and writer.holds(no):
            return cls(name, "lanes_mask", "lanes_where_mask", "lanes_of_bits(0)", writer.mask(yes), writer.mask(no))
        return cls(name, "lanes", "lanes_where", "lanes_set(0.0)", writer.number(yes), writer.number(no))
