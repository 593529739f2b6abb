"""Base of the printers of traced programs: it counts how often values are read, and converts blocks to lines."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from .tracer import FUNCTIONS, Assign, Block, Expr, If, Operand, Tracer

# Operations that Python and C write alike.
ARITHMETIC = {
    "add": "{0} + {1}", "subtract": "{0} - {1}", "multiply": "{0} * {1}", "divide": "{0} / {1}", "negative": "-{0}",
    "less": "{0} < {1}", "less_equal": "{0} <= {1}", "greater": "{0} > {1}", "greater_equal": "{0} >= {1}",
    "equal": "{0} == {1}",
    **{name: f"{name}({{0}})" for name in FUNCTIONS},
}


class Writer(ABC):
    """A printer that converts blocks to lines; it omits values never read, and inlines a function's values read once.

    `templates` are the texts of operations in the language, with the operands as ``{0}``, ``{1}``, ``{2}``. An operand
    that occurs twice in a template counts as read twice.
    """

    def __init__(self, tracer: Tracer, templates: Mapping[str, str]) -> None:
        self.templates = templates
        self.uses: dict[str, int] = {}
        self.operations: set[str] = set()
        self._text: dict[str, str] = {}
        for function in tracer.functions:
            for value in function.results:
                self._use(value)
        for function in reversed(tracer.functions):
            self._count(function.block)
        self.read_by_functions = set(self.uses)
        self._count(tracer.prologue)  # read by all functions, so counted last

    def _use(self, value: Operand, times: int = 1) -> None:
        if isinstance(value, Expr):
            self.uses[value.name] = self.uses.get(value.name, 0) + times

    def _count(self, block: Block) -> None:
        for statement in reversed(block.statements):
            if isinstance(statement, Assign):
                if self.uses.get(statement.name):
                    self.operations.add(statement.operation)
                    template = self.templates[statement.operation]
                    for index, operand in enumerate(statement.operands):
                        self._use(operand, template.count(f"{{{index}}}"))
            else:
                for i in self.live(statement):
                    self._use(statement.yes_values[i])
                    self._use(statement.no_values[i])
                self._count(statement.no)
                self._count(statement.yes)
                if self.live(statement):
                    self._use(statement.condition)

    def live(self, statement: If) -> Sequence[int]:
        """Return the indices of the values of a branch that are read."""
        return [i for i, name in enumerate(statement.names) if self.uses.get(name)]

    def block(self, block: Block, depth: int) -> list[str]:
        """Return the lines of a block, indented to a depth."""
        lines: list[str] = []
        for statement in block.statements:
            if isinstance(statement, If):
                if live := self.live(statement):
                    lines += self.branch(statement, live, depth)
            elif (text := self.expression(statement)) is not None:
                lines.append("    " * depth + self.assignment(statement.name, text))
        return lines

    @abstractmethod
    def assignment(self, name: str, text: str) -> str:
        """Return the statement that sets a value to an expression."""

    @abstractmethod
    def branch(self, statement: If, live: Sequence[int], depth: int) -> list[str]:
        """Return the lines of a branch that sets the values at the indices `live`."""

    def operand(self, value: Operand) -> str:
        """Return the text of an operand."""
        if isinstance(value, Expr):
            return self._text.get(value.name) or self.name(value.name)
        text = self.literal(value)
        return f"({text})" if text.startswith("-") else text

    def operation(self, statement: Assign) -> str:
        """Return the text of an operation."""
        return self.templates[statement.operation].format(*(self.operand(o) for o in statement.operands))

    def expression(self, statement: Assign) -> str | None:
        """Return the text of an operation to be assigned to its name; None if it is inlined or never read."""
        uses = self.uses.get(statement.name, 0)
        if not uses:
            return None
        text = self.operation(statement)
        if uses == 1 and not statement.name.startswith("c"):
            self._text[statement.name] = f"({text})"
            return None
        return text

    def name(self, name: str) -> str:
        """Return the name of a value in the language."""
        return name

    def literal(self, value: float | bool) -> str:
        """Return a number in the language."""
        return repr(value)
