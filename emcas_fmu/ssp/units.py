"""Units as SSP and FMI documents define them, and conversions between two of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose
from typing import Any

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit by name; a value x in it is ``factor * x + offset`` in the SI unit with these exponents of BASES.

    A unit that the document does not define has no exponents.
    """

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def defined(cls, name: str, attributes: Mapping[str, Any]) -> Unit:
        """Return the unit with the attributes of a BaseUnit element. Raises ValueError if one is not a number."""
        return cls(name, tuple(int(attributes.get(base, 0)) for base in BASES),
                   float(attributes.get("factor", 1.0)), float(attributes.get("offset", 0.0)))

    def __str__(self) -> str:
        return self.name or "no unit"


@dataclass(frozen=True)
class Conversion:
    """A value x in one unit is ``factor * x + offset`` in the other."""

    factor: float = 1.0
    offset: float = 0.0

    @property
    def identity(self) -> bool:
        """Whether the two units are the same."""
        return isclose(self.factor, 1.0, rel_tol=1e-9) and abs(self.offset) < 1e-9

    def __call__(self, value: float) -> float:
        return self.factor * value + self.offset


def conversion(start: Unit, end: Unit) -> Conversion | None:
    """Return the conversion between two units; None if they measure different quantities or one is not defined.

    An undefined unit is known by its name alone. Without a name any unit will do.
    """
    if start.exponents is None or end.exponents is None:
        return Conversion() if start.name == end.name or not start.name else None
    if start.exponents != end.exponents or end.factor == 0.0:
        return None
    return Conversion(start.factor / end.factor, (start.offset - end.offset) / end.factor)
