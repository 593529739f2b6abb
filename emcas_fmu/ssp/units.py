"""Units as SSP and FMI define them: exponents of the base units, factor and offset to SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose
from typing import Any

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A value x in this unit is ``factor * x + offset`` in the SI unit with these exponents (in the order of BASES)."""

    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def of(cls, attributes: Mapping[str, Any]) -> Unit:
        """Read the attributes of a BaseUnit element. Raises ValueError if they are no numbers."""
        return cls(tuple(int(attributes.get(base, 0)) for base in BASES),
                   float(attributes.get("factor", 1.0)), float(attributes.get("offset", 0.0)))


@dataclass(frozen=True)
class Conversion:
    """A value y in the other unit is ``factor * x + offset``."""

    factor: float
    offset: float

    @property
    def identity(self) -> bool:
        """Whether the two units are the same."""
        return isclose(self.factor, 1.0, rel_tol=1e-9) and abs(self.offset) < 1e-9

    def __call__(self, value: float) -> float:
        return self.factor * value + self.offset


def conversion(start: Unit | None, end: Unit | None) -> Conversion | None:
    """Return how to convert from one unit to another; None if one is not known or they do not measure the same."""
    if start is None or end is None or start.exponents != end.exponents or end.factor == 0.0:
        return None
    return Conversion(start.factor / end.factor, (start.offset - end.offset) / end.factor)
