"""What the parameters of each fin are, nominally and in each variant."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..files import models_directory
from ..fmi.interface import fin_sets, require_shared
from ..parameters import ParameterError, ParameterSet
from ..schema import In
from ..toml import tomllib
from .schema import NOMINAL, SspError

SHIPPED = ("cold", "degraded")  # variants, each a file among the models
EVERY_FIN = "every_fin"
_NAME = re.compile(r"[A-Za-z]\w*")


def fin_name(number: int) -> str:
    """The name of a fin's component, counted from 1."""
    return f"fin{number}"


@dataclass(frozen=True)
class Variant:
    """A named system: the parameter set of each fin, and the names the variant changes for every fin."""

    name: str
    fins: tuple[ParameterSet, ...]
    common: tuple[str, ...] = ()


def variant_files(given: Sequence[str]) -> dict[str, Path]:
    """The shipped variants and those `given` as ``NAME=FILE``, which may replace one. Raises SspError."""
    files = {name: models_directory() / f"{name}.toml" for name in SHIPPED}
    for text in given:
        name, separator, file = text.partition("=")
        if not separator or not file:
            raise SspError(f"--variant {text}: expected NAME=FILE, such as --variant hot=hot.toml")
        if not _NAME.fullmatch(name) or name in (NOMINAL, "shared", "inputs", "flat") or re.fullmatch(r"fin\d+", name):
            raise SspError(f"--variant {text}: {name!r} cannot name a variant; take a word other than {NOMINAL}, "
                           "shared, inputs, flat and fin1 ...")
        files[name] = Path(file)
    return files


def nominal(base: ParameterSet, fins: int, layout: str, files: Mapping[int, Path]) -> Variant:
    """The fins as built (:func:`emcas_fmu.fmi.interface.fin_sets`). Raises EmcasError."""
    return Variant(NOMINAL, fin_sets(base, fins, layout, files))


def without_shipped(files: Mapping[str, Path], base: ParameterSet) -> tuple[dict[str, Path], list[str]]:
    """The variants but for the shipped ones that change what the actuator has not, and why those are left out."""
    names, kept, without = {e.variable.name for e in base.entries}, {}, []
    for name, file in files.items():
        shipped = file == models_directory() / f"{name}.toml"
        changes = {entry for table in _document(file).values() for entry, _ in _entries(table)} if shipped else set()
        if lacking := sorted(changes - names):
            without.append(f"variant {name}: this actuator has no {', '.join(lacking)}")
        else:
            kept[name] = file
    return kept, without


def derived(name: str, file: Path, origin: Variant) -> Variant:
    """A variant of the system as built, out of a file such as models/cold.toml. Raises SspError or ParameterError."""
    document = _document(file)
    scopes = (EVERY_FIN, *(fin_name(i + 1) for i in range(len(origin.fins))))
    every = dict(_entries(document.get(EVERY_FIN, {})))
    for scope, table in document.items():
        if not isinstance(table, dict) or (scope not in scopes and not re.fullmatch(r"fin[1-9]", scope)):
            raise SspError(f"{file}: {scope}: expected tables {EVERY_FIN}, fin1, fin2 ... of parameters, such as "
                           f"[{EVERY_FIN}.friction]")
    fins = tuple(_changed(own, {**every, **dict(_entries(document.get(fin_name(i), {})))}, f"{file}: {fin_name(i)}")
                 for i, own in enumerate(origin.fins, start=1))
    require_shared(fins, str(file))
    return Variant(name, fins, tuple(every))


def _document(file: Path) -> dict[str, Any]:
    try:
        # Numbers stay text, as parameter files are read.
        document: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8-sig"), parse_float=str)
    except (OSError, ValueError, RecursionError) as error:
        raise SspError(f"{file}: cannot be read: {error}") from error
    return document


def _entries(node: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """What is written at each dotted name: a value, or a table with one."""
    for key, written in node.items():
        name = f"{path}.{key}" if path else key
        if isinstance(written, dict) and "value" not in written:
            yield from _entries(written, name)
        else:
            yield name, written


def _changed(base: ParameterSet, entries: Mapping[str, Any], where: str) -> ParameterSet:
    """`base` with entries over it; percentages are of its values. Raises ParameterError naming `where`."""
    units = {e.variable.name: e.variable.unit for e in base.entries}
    changes = dict(entries)
    for name, written in entries.items():
        fields = written if isinstance(written, dict) else {"value": written}
        text = " ".join(filter(None, (str(fields["value"]), str(fields.get("unit", ""))))).strip()
        if text.endswith("%") and name in units:
            try:
                value = In(units[name], base=float(base.values[name])).number(text)
            except ValueError as error:
                raise ParameterError([f"{where}: {name} = {text}: {error}"]) from error
            changes[name] = {**fields, "value": repr(value), "unit": units[name]}
    try:
        return base.replace(changes)
    except ParameterError as error:
        raise ParameterError([f"{where}: {problem.removeprefix('replaced value: ')}"
                              for problem in error.problems]) from error
