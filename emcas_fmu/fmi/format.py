"""What differs between the versions of FMI for a unit in C; each is described in its folder (fmi2, fmi3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import fmpy

from ..variables import Variable
from .interface import FmuInterface


@dataclass(frozen=True)
class HostVariable:
    """A variable as a host in C refers to it: its name and value reference, and in words what it is."""

    name: str
    reference: int
    about: str


@dataclass(frozen=True)
class Format:
    """A version of FMI: its C besides what the versions share, and its model description.

    `main` is the file handed to the compiler, `written` are the files beside it, of the same folder; `headers` gives
    the standard's. `tables` gives what interface.h has besides the unit's scalars. `options` are attributes of the
    CoSimulation element, `notes` say on the page in the FMU how the unit answers its host. `by_machine` is whether each
    kind of machine has a folder of its own for its library, or each platform. `of_sources` are arguments of
    `model_description` that name the sources. `in_files` gives what fins have by
    their own names, and at the times of all, by the names of the unit. `listed` gives each variable, its dimensions in
    words, and the places of its elements among the unit's scalars.
    """

    version: str
    main: str
    package: str
    written: tuple[str, ...]
    headers: Callable[[], Mapping[str, str]]
    options: Mapping[str, str]
    notes: tuple[str, ...]
    by_machine: bool
    of_sources: Mapping[str, Any]
    tables: Callable[[FmuInterface], str]
    host_variables: Callable[[FmuInterface], Iterable[HostVariable]]
    listed: Callable[[FmuInterface], Iterable[tuple[Variable, str, tuple[int, ...]]]]
    in_files: Callable[[FmuInterface, Sequence[Mapping[str, Any]]], dict[str, Any]]
    model_description: Callable[..., Element]

    @property
    def arrays(self) -> bool:
        """Whether variables may be arrays."""
        return self.version != "2.0"

    @property
    def token(self) -> str:
        """What the version calls the identification of the interface in the header for hosts."""
        return "TOKEN" if self.arrays else "GUID"


def standard_headers(names: Sequence[str]) -> dict[str, str]:
    """Return headers of the FMI standard, as fmpy ships them."""
    folder = Path(fmpy.__file__).parent / "c-code"
    return {name: (folder / name).read_text(encoding="utf-8") for name in names}


def about(causality: str, kind: str, unit: str, elements: Any = "") -> str:
    """Return what a variable is, in words for a comment."""
    return ", ".join(filter(None, (causality, kind, unit, str(elements))))
