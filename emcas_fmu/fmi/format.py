"""The differences between the versions of FMI; the folders fmi2 and fmi3 describe one each."""

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
    """A variable for a host in C: its name, value reference, and a comment."""

    name: str
    reference: int
    about: str


@dataclass(frozen=True)
class Format:
    """A version of FMI: its C code in addition to the common files, and its model description.

    `main` is the file to compile, which includes the files `written`, in the same folder, and the standard's `headers`.
    `tables` returns the part of interface.h that the version adds. `options` are attributes of the CoSimulation
    element; `notes` are HTML for the documentation in the FMU, on its replies to the host. With `by_machine` each kind
    of machine has a folder for its library, otherwise each platform. `of_sources` are arguments of `model_description`
    that name the sources. `in_files` returns columns or values of all fins under the names of the interface. `listed`
    yields each variable, its dimensions in words, and the indices of its elements among the scalars.
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
        """Whether variables can be arrays."""
        return self.version != "2.0"

    @property
    def token(self) -> str:
        """The word for the identification of the interface, in the header for hosts."""
        return "TOKEN" if self.arrays else "GUID"


def standard_headers(names: Sequence[str]) -> dict[str, str]:
    """Return headers of the FMI standard, as fmpy ships them."""
    folder = Path(fmpy.__file__).parent / "c-code"
    return {name: (folder / name).read_text(encoding="utf-8") for name in names}


def about(causality: str, kind: str, unit: str, elements: Any = "") -> str:
    """Return causality, type, unit and elements of a variable as a comment."""
    return ", ".join(filter(None, (causality, kind, unit, str(elements))))
