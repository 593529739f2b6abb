"""Printer of traced programs as C99, with the order of operations of the Python source, so that results are equal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, isnan

from ..ops.elementary import FUNCTIONS
from .tracer import BITS, Assign, Expr, If, Operand, Tracer
from .usage import ARITHMETIC, Writer

TEMPLATES = {
    **ARITHMETIC,
    "both": "{0} && {1}", "either": "{0} || {1}", "negate": "!{0}",
    "minimum": "{0} < {1} ? {0} : {1}", "maximum": "{0} > {1} ? {0} : {1}",
    "clip": "{0} < {1} ? {1} : {0} > {2} ? {2} : {0}", "where": "{0} ? {1} : {2}",
    **{name: f"elementary_{name}({{0}})" for name in (*FUNCTIONS, *BITS)},
}
_CONDITIONS = {"less", "less_equal", "greater", "greater_equal", "equal", "both", "either", "negate"}

# The last bit of a double between 2**52 and 2**53 is worth 1: adding a whole number to 2**52 puts it in the last bits.
_HELPERS = """\
/* A condition that seldom holds: the compiler moves the code for it out of the usual path. */
#if defined __GNUC__
#define ELEMENTARY_RARELY(condition) __builtin_expect(!!(condition), 0)
#else
#define ELEMENTARY_RARELY(condition) (condition)
#endif

/* 2 to the power of a whole number from -1022 to 1023. */
static inline double elementary_power_of_two(double k)
{
    const double last = k + (0x1.8p52 + 1023.0);
    uint64_t bits;
    memcpy(&bits, &last, sizeof bits);
    bits <<= 52;
    double power;
    memcpy(&power, &bits, sizeof power);
    return power;
}

/* The exponent of a number of at least 2 to the power of -1022. */
static inline double elementary_exponent(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (double)((int)(bits >> 52) - 1023);
}
"""


def c_elementary(tracer: Tracer) -> str:
    """Return the C text of functions ``static inline double elementary_<name>(double x)``."""
    return "\n".join([_HELPERS, *_ElementaryWriter(tracer).elementary("elementary")])


def c_source(tracer: Tracer, prefix: str, templates: Mapping[str, str] = TEMPLATES) -> str:
    """Return the C text of a program: its sizes and its static functions.

    ``<prefix>_prepare(p, c)`` computes the constants `c` [<PREFIX>_CONSTANTS] from the parameters `p`
    [<PREFIX>_PARAMETERS]. The other functions have the arguments `p`, `c`, those of the traced function, and the array
    `out` for its results.
    """
    writer = CWriter(tracer, templates)
    upper = prefix.upper()
    text = [f"enum {{ {upper}_PARAMETERS = {len(tracer.parameters)}, {upper}_CONSTANTS = {len(writer.constants)} }};",
            ""]
    text += [f"static inline void {prefix}_prepare(const double *restrict p, double *restrict c)", "{",
             "    (void)p, (void)c;", *writer.block(tracer.prologue, 1), "}", ""]
    return "\n".join([*text, *writer.functions(prefix)])


def c_number(value: float | bool) -> str:
    """Return a number in C; it may be infinite or not a number."""
    if isfinite(value):
        return repr(float(value))
    return "NAN" if isnan(value) else "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"


def _bare(text: str) -> str:
    """Return a condition without parentheses around the whole: compilers warn of ((a == b))."""
    depth = 0
    for i, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


class CWriter(Writer):
    """The statements of a traced function in C."""

    type = "double"
    which = ""  # type of a first argument `which`; empty if functions do not have it

    def __init__(self, tracer: Tracer, templates: Mapping[str, str] = TEMPLATES) -> None:
        super().__init__(tracer, templates)
        self._tracer = tracer
        self.conditions: set[str] = set()
        # Constants are the prologue's values that functions read; the other values are local to the prologue.
        self.constants = {s.name: i for i, s in enumerate(
            s for s in tracer.prologue.statements if isinstance(s, Assign) and s.name in self.read_by_functions)}

    def functions(self, prefix: str) -> list[str]:
        """Return the lines of all functions; each fills an array of results from parameters, constants, arguments."""
        lines = []
        first, used = (f"{self.which} which, ", "(void)which, ") if self.which else ("", "")
        for function in self._tracer.functions:
            arguments = "".join(f", {self.type} {a}" for a in function.printed)
            lines += [f"static inline void {prefix}_{function.name}({first}const {self.type} *restrict p, "
                      f"const {self.type} *restrict c{arguments}, {self.type} *restrict out)", "{",
                      f"    {used}(void)p, (void)c;"]
            if function.printed:
                lines.append("    " + ", ".join(f"(void){a}" for a in function.printed) + ";")
            lines += self.block(function.block, 1)
            lines += [f"    out[{i}] = {self.number(value)};" for i, value in enumerate(function.results)]
            lines += ["}", ""]
        return lines

    def elementary(self, prefix: str, *beginning: str) -> list[str]:
        """Return the lines of functions with one argument and one result; `beginning` are their first lines."""
        lines = []
        for function in self._tracer.functions:
            (argument,), (result,) = function.printed, function.results
            lines += [f"static inline {self.type} {prefix}_{function.name}({self.type} {argument})", "{", *beginning,
                      *self.block(function.block, 1), f"    return {self.number(result)};", "}", ""]
        return lines

    def number(self, value: Operand) -> str:
        """Return the text of an operand as a number; in C a condition is a number."""
        return self.operand(value)

    def name(self, name: str) -> str:
        if name in self.constants:
            return f"c[{self.constants[name]}]"
        return f"p[{name[1:]}]" if name.startswith("p") and name[1:].isdigit() else name

    def literal(self, value: float | bool) -> str:
        if not isfinite(value):
            raise ValueError(f"{value!r} cannot be used in traced code")
        return repr(float(value))

    def expression(self, statement: Assign) -> str | None:
        text = super().expression(statement)
        if self.is_condition(statement):
            self.conditions.add(statement.name)
        return text

    def assignment(self, name: str, text: str) -> str:
        kind = "int" if name in self.conditions else "double"
        declared = "" if name in self.constants else f"const {kind} "
        return f"{declared}{self.name(name)} = {text};"

    def branch(self, statement: If, live: Sequence[int], depth: int) -> list[str]:
        indent = "    " * depth
        yes, no = self.block(statement.yes, depth + 1), self.block(statement.no, depth + 1)
        kinds: dict[str, list[str]] = {"int": [], "double": []}
        for i in live:
            both = self.holds(statement.yes_values[i]) and self.holds(statement.no_values[i])
            kinds["int" if both else "double"].append(statement.names[i])
        self.conditions.update(kinds["int"])
        lines = [f"{indent}{kind} {', '.join(names)};" for kind, names in kinds.items() if names]
        condition = _bare(self.operand(statement.condition))
        lines.append(f"{indent}if ({f'ELEMENTARY_RARELY({condition})' if statement.rare else condition}) {{")
        for inner, values, end in ((yes, statement.yes_values, "} else {"), (no, statement.no_values, "}")):
            lines += inner
            lines += [f"{indent}    {statement.names[i]} = {self.operand(values[i])};" for i in live]
            lines.append(f"{indent}{end}")
        return lines

    def is_condition(self, statement: Assign) -> bool:
        """Return whether the result of an operation is a condition: for `where`, whether both its values are."""
        if statement.operation == "where":
            return all(self.holds(value) for value in statement.operands[1:])
        return statement.operation in _CONDITIONS

    def holds(self, value: Operand) -> bool:
        """Return whether an operand is a condition."""
        return value.name in self.conditions if isinstance(value, Expr) else isinstance(value, bool)


class _ElementaryWriter(CWriter):
    def literal(self, value: float | bool) -> str:
        return c_number(value)
