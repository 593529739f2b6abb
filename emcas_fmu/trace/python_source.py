"""Printer of traced programs as Python source."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Sequence

from . import elementary
from .tracer import If, Operand, Tracer
from .usage import ARITHMETIC, Writer

TEMPLATES = {
    **ARITHMETIC,
    "both": "{0} and {1}", "either": "{0} or {1}", "negate": "not {0}",
    "minimum": "{0} if {0} < {1} else {1}", "maximum": "{0} if {0} > {1} else {1}",
    "clip": "{1} if {0} < {1} else {2} if {0} > {2} else {0}", "where": "{1} if {0} else {2}",
    "floor": "float(floor({0}))",
    # int() would raise for NaN, which the other languages accept.
    "power_of_two": "ldexp(1.0, int({0})) if {0} == {0} else {0}", "exponent": "float(frexp({0})[1] - 1)",
}
_TEMPORARY = re.compile(r"\bt\d+\b")


def python_source(tracer: Tracer, docstring: str, spelling: Callable[[str], str] = str) -> str:
    """Return the source text of a module with `make(parameters)`, which returns a tuple of the program's functions.

    `parameters` maps names to values; the name of a parameter there is `spelling(key)`.
    """
    writer = _PythonWriter(tracer, TEMPLATES)
    body: list[str] = []
    for function in tracer.functions:
        lines = writer.block(function.block, 2)
        lines.append(f"        return {writer.listed(function.results)}" + ("," if len(function.results) == 1 else ""))
        body += [f"    def {function.name}({', '.join(function.printed)}):", *_registers(lines), ""]
    prologue = [f"    {name} = parameters[{spelling(key)!r}]"
                for name, key in tracer.parameters if writer.uses.get(name)]
    prologue += writer.block(tracer.prologue, 1)
    functions = ", ".join(function.name for function in tracer.functions)
    return "\n".join([f'"""{docstring}"""', "",
                      "from functools import lru_cache  # noqa: F401",
                      "from math import fabs, floor, frexp, inf, ldexp, nan, sqrt  # noqa: F401", "", "",
                      *_elementary(writer.operations), "def make(parameters):", *prologue, "", *body,
                      f"    return {functions},", ""])


def _elementary(names: Container[str]) -> list[str]:
    """Return the lines of the elementary functions with these `names`."""
    tracer = elementary.traced()
    writer = _PythonWriter(tracer, TEMPLATES)
    lines = []
    for function in tracer.functions:
        if function.name in names:
            (result,) = function.results
            body = [*writer.block(function.block, 1), f"    return {writer.operand(result)}"]
            # Ticks of equal length need exp of the same values again and again, and it is slow in Python.
            lines += ["@lru_cache(maxsize=16)"] if function.name == "exp" else []
            lines += [f"def {function.name}({', '.join(function.printed)}):", *_registers(body), "", ""]
    return lines


class _PythonWriter(Writer):
    def listed(self, values: Iterable[Operand]) -> str:
        return ", ".join(self.operand(value) for value in values)

    def assignment(self, name: str, text: str) -> str:
        return f"{name} = {text}"

    def branch(self, statement: If, live: Sequence[int], depth: int) -> list[str]:
        indent, targets = "    " * depth, ", ".join(statement.names[i] for i in live)
        lines = [f"{indent}if {self.operand(statement.condition)}:"]
        lines += self.block(statement.yes, depth + 1)
        lines += [f"{indent}    {targets} = {self.listed(statement.yes_values[i] for i in live)}", f"{indent}else:"]
        lines += self.block(statement.no, depth + 1)
        return [*lines, f"{indent}    {targets} = {self.listed(statement.no_values[i] for i in live)}"]


def _registers(lines: Sequence[str]) -> list[str]:
    """Return the lines with temporaries renamed: those that are never in use at the same time share a name.

    The frame of a call has room for every local variable. With hundreds of variables it may not fit into the
    interpreter's present stack chunk; the interpreter would then map and unmap a new chunk at each call. A temporary is
    in use from the first line with its name to the last, even in a branch between them that does not set it.
    """
    used = [dict.fromkeys(_TEMPORARY.findall(line)) for line in lines]
    last = {name: number for number, temporaries in enumerate(used) for name in temporaries}
    names: dict[str, str] = {}
    free: list[str] = []
    result = []
    for number, (line, temporaries) in enumerate(zip(lines, used, strict=True)):
        ending = [name for name in temporaries if last[name] == number]
        starting = [name for name in temporaries if name not in names]
        # A line reads its operands before it sets its results.
        free += sorted(names[name] for name in ending if name in names)
        for name in starting:
            names[name] = free.pop() if free else f"r{len(set(names.values()))}"
        free += sorted(names[name] for name in ending if name in starting)
        result.append(_TEMPORARY.sub(lambda match: names[match.group()], line))
    return result
