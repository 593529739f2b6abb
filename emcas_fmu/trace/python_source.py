"""Traced programs as Python source."""

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
    # Of NaN, which the other languages take, int() would raise.
    "power_of_two": "ldexp(1.0, int({0})) if {0} == {0} else {0}", "exponent": "float(frexp({0})[1] - 1)",
}
_TEMPORARY = re.compile(r"\bt\d+\b")


def python_source(tracer: Tracer, docstring: str, spelt: Callable[[str], str] = str) -> str:
    """Return a module with `make(parameters) -> tuple of functions`, `parameters` being a flat mapping.

    Its keys are the parameters' names as `spelt`.
    """
    writer = _PythonWriter(tracer, TEMPLATES)
    body: list[str] = []
    for function in tracer.functions:
        lines = writer.block(function.block, 2)
        lines.append(f"        return {writer.listed(function.results)}" + ("," if len(function.results) == 1 else ""))
        body += [f"    def {function.name}({', '.join(function.printed)}):", *_registers(lines), ""]
    prologue = [f"    {name} = parameters[{spelt(key)!r}]" for name, key in tracer.parameters if writer.uses.get(name)]
    prologue += writer.block(tracer.prologue, 1)
    functions = ", ".join(function.name for function in tracer.functions)
    return "\n".join([f'"""{docstring}"""', "",
                      "from functools import lru_cache  # noqa: F401",
                      "from math import fabs, floor, frexp, inf, ldexp, nan, sqrt  # noqa: F401", "", "",
                      *_elementary(writer.operations), "def make(parameters):", *prologue, "", *body,
                      f"    return {functions},", ""])


def _elementary(names: Container[str]) -> list[str]:
    """Return the lines of those elementary functions that are among `names`."""
    tracer = elementary.traced()
    writer = _PythonWriter(tracer, TEMPLATES)
    lines = []
    for function in tracer.functions:
        if function.name in names:
            (result,) = function.results
            body = [*writer.block(function.block, 1), f"    return {writer.operand(result)}"]
            # Ticks of one length ask for the same powers again and again, and a function in Python takes long.
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
        temporaries = dict.fromkeys(_TEMPORARY.findall(line))
        ending = [name for name in temporaries if last[name] == number]
        starting = [name for name in temporaries if name not in names]
        # What is read for the last time here is read before anything here is set.
        free += sorted(names[name] for name in ending if name in names)
        for name in starting:
            names[name] = free.pop() if free else f"r{len(set(names.values()))}"
        free += sorted(names[name] for name in ending if name in starting)
        result.append(_TEMPORARY.sub(lambda match: names[match.group()], line))
    return result
