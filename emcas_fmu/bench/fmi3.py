"""FMUs of FMI 3.0 with the calls of fmpy's FMI 2.0 slave: studies run both versions in the same way.

The elements of arrays have the names of FMI 2.0, and indices instead of value references.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..fmi.interface import FINS

_TYPES = {"Real": "Real", "Integer": "Integer", "String": "String", "Boolean": "Boolean", "Enumeration": "Integer",
          "Float64": "Real", "Int32": "Integer", "UInt32": "Integer"}
_ACCESS = {"Enumeration": "Int64"}


@dataclass(frozen=True)
class Element:
    """An element of an array, or a scalar: name, type in the FMU, kind and causality as in FMI 2.0, start value (text),
    value reference, index in the array, number of elements of the array, and the array's name."""

    name: str
    type: str
    kind: str
    causality: str
    start: str | None
    reference: int
    index: int
    count: int
    array: str

    @property
    def in_files(self) -> str:
        """The name in tables and parameter sets, where an element of an array has its index, from 0."""
        return self.array if self.count == 1 else f"{self.array}[{self.index}]"


def elements(description: Any, structured: Mapping[str, str]) -> tuple[Element, ...]:
    """Return the variables of fmpy's model description whose type is one of _TYPES, arrays by element, without time.

    `structured` maps the names of variables with flat names to structured names.
    """
    return tuple(e for v in description.modelVariables if v.causality != "independent" and v.type in _TYPES
                 for e in _elements(v, structured.get(v.name, v.name)))


def _elements(v: Any, structured: str) -> Iterator[Element]:
    sizes = [int(d.start) for d in v.dimensions]
    names = [structured]
    if sizes and structured.startswith(FINS):
        names = [f"fin[{fin + 1}].{structured.removeprefix(FINS)}" for fin in range(sizes.pop(0))]
    for size in sizes:
        names = [f"{name}[{k}]" for name in names for k in range(size)]
    starts = [v.start] * len(names) if v.start is None or not v.dimensions else str(v.start).split()
    for k, (name, start) in enumerate(zip(names, starts, strict=True)):
        yield Element(name, v.type, _TYPES[v.type], v.causality, start, int(v.valueReference), k, len(names),
                      v.name)


class Fmi3Slave:
    """fmpy's FMI 3.0 `slave` with the calls of FMI 2.0; a variable's value reference is its index in `listed`."""

    def __init__(self, slave: Any, listed: Sequence[Element]) -> None:
        self._slave, self._listed = slave, listed
        self.getReal = self.getInteger = self.getBoolean = self._get
        self.setReal = self.setInteger = self.setBoolean = self._set

    def setupExperiment(self) -> None:  # noqa: N802  as fmpy has it
        """Do nothing: a run starts at 0 s, the default of the initialization in FMI 3.0."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._slave, name)

    def _array(self, e: Element) -> list[Any]:
        values: list[Any] = getattr(self._slave, f"get{_ACCESS.get(e.type, e.type)}")([e.reference], e.count)
        return values

    def _get(self, indices: Sequence[int]) -> list[Any]:
        chosen = [self._listed[index] for index in indices]
        arrays: dict[int, list[Any]] = {}
        for e in chosen:
            if e.reference not in arrays:
                arrays[e.reference] = self._array(e)
        return [arrays[e.reference][e.index] for e in chosen]

    def _set(self, indices: Sequence[int], values: Sequence[Any]) -> None:
        for index, value in zip(indices, values, strict=True):
            e = self._listed[index]
            whole = [value] if e.count == 1 else self._array(e)
            whole[e.index] = value
            getattr(self._slave, f"set{_ACCESS.get(e.type, e.type)}")([e.reference], whole)
