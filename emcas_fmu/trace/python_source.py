"""Traced programs as Python source."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .tracer import Assign, Block, Operand, Tracer
from .usage import ARITHMETIC, Writer

TEMPLATES = {
    **ARITHMETIC,
    "both": "{0} and {1}", "either": "{0} or {1}", "negate": "not {0}",
    "minimum": "{0} if {0} < {1} else {1}", "maximum": "{0} if {0} > {1} else {1}",
    "clip": "{1} if {0} < {1} else {2} if {0} > {2} else {0}", "where": "{1} if {0} else {2}",
    "floor": "float(floor({0}))",
}
_TEMPORARY = re.compile(r"\bt\d+\b")


def python_source(tracer: Tracer, docstring: str) -> str:
    """A module with `make(parameters) -> tuple of functions`, `parameters` being a flat mapping."""
    writer = Writer(tracer, TEMPLATES)
    body: list[str] = []
    for function in tracer.functions:
        lines = [*_block(writer, function.block, 2), f"        return {_tuple(writer, function.results)}"]
        body += [f"    def {function.name}({', '.join(function.arguments)}):", *_registers(lines), ""]
    prologue = [f"    {name} = parameters[{key!r}]" for name, key in tracer.parameters if writer.uses.get(name)]
    prologue += _block(writer, tracer.prologue, 1)
    functions = ", ".join(function.name for function in tracer.functions)
    return "\n".join([f'"""{docstring}"""', "",
                      "from math import atan, cos, exp, fabs, floor, log, sin, sqrt, tan  # noqa: F401", "", "",
                      "def make(parameters):", *prologue, "", *body, f"    return {functions},", ""])


def _tuple(writer: Writer, values: Sequence[Operand]) -> str:
    return ", ".join(writer.operand(v) for v in values) + ("," if len(values) == 1 else "")


def _block(writer: Writer, block: Block, depth: int) -> list[str]:
    indent = "    " * depth
    lines: list[str] = []
    for statement in block.statements:
        if isinstance(statement, Assign):
            text = writer.expression(statement)
            if text is not None:
                lines.append(f"{indent}{statement.name} = {text}")
            continue
        live = writer.live(statement)
        if not live:
            continue
        targets = ", ".join(statement.names[i] for i in live)
        for keyword, inner, values in (
            (f"if {writer.operand(statement.condition)}:", statement.yes, statement.yes_values),
            ("else:", statement.no, statement.no_values),
        ):
            lines.append(f"{indent}{keyword}")
            lines += _block(writer, inner, depth + 1)
            lines.append(f"{indent}    {targets} = {', '.join(writer.operand(values[i]) for i in live)}")
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
