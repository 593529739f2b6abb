"""The parameters of each fin, in the nominal system and in each variant."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..fmi.interface import require_shared
from ..parameters import ParameterError, ParameterSet
from ..parameters.schema import In, document, leaves
from ..support.files import models_directory
from .archive import DEFAULT, NOMINAL, SspError

SHIPPED = ("cold", "degraded")  # variants whose files are in the folder `models`
EVERY_FIN = "every_fin"


@dataclass(frozen=True)
class Variant:
    """A variant of the system: its name, and the parameter set of each fin."""

    name: str
    fins: tuple[ParameterSet, ...]

    @property
    def names(self) -> list[str]:
        """The names of the fins' components."""
        return [f"fin{number}" for number in range(1, len(self.fins) + 1)]


def variant_files(arguments: Sequence[str]) -> dict[str, Path]:
    """Return the files of variants by name: of shipped ones, and of arguments ``NAME=FILE``, which may replace these.

    Raises SspError for an argument of another form.
    """
    files = {name: models_directory() / f"{name}.toml" for name in SHIPPED}
    for text in arguments:
        name, separator, file = text.partition("=")
        if not separator or not file:
            raise SspError(f"--variant {text}: expected NAME=FILE, such as --variant hot=hot.toml")
        if not re.fullmatch(r"[A-Za-z]\w*", name) or f"{name}.ssd" in (f"{NOMINAL}.ssd", DEFAULT):
            raise SspError(f"--variant {text}: {name!r} cannot name a variant; choose another word")
        files[name] = Path(file)
    return files


def derived(files: Mapping[str, Path], origin: Variant) -> tuple[list[Variant], list[str]]:
    """Return variants of the system `origin`, from files such as models/cold.toml, and messages about those left out.

    A shipped variant is left out if the actuator lacks one of its parameters. Raises SspError or ParameterError for
    problems of a file.
    """
    variants, left_out = [], []
    for name, file in files.items():
        tables = document(file, SspError, number=str)[1]  # numbers stay text, as in parameter files
        for scope, table in tables.items():
            if not isinstance(table, dict) or not re.fullmatch(rf"{EVERY_FIN}|fin[1-9]", scope):
                raise SspError(f"{file}: {scope}: expected tables {EVERY_FIN}, fin1, fin2 ... of parameters, such as "
                               f"[{EVERY_FIN}.friction]")
        changes = {scope: dict(leaves(table, lambda name, written: "value" not in written))
                   for scope, table in tables.items()}
        lacking = sorted({entry for each in changes.values() for entry in each} - origin.fins[0].values.keys())
        if lacking and file == models_directory() / f"{name}.toml" and name in SHIPPED:
            left_out.append(f"variant {name}: this actuator has no {', '.join(lacking)}")
            continue
        fins = tuple(_changed(fin, {**changes.get(EVERY_FIN, {}), **changes.get(scope, {})}, f"{file}: {scope}")
                     for scope, fin in zip(origin.names, origin.fins))
        require_shared(fins, str(file))
        variants.append(Variant(name, fins))
    return variants, left_out


def _changed(base: ParameterSet, entries: Mapping[str, Any], where: str) -> ParameterSet:
    """Return `base` with changed entries; percentages refer to its values. Raises ParameterError, with `where`."""
    units = {e.variable.name: e.variable.unit for e in base.entries}
    changes = dict(entries)
    for name, entry in entries.items():
        fields = entry if isinstance(entry, dict) else {"value": entry}
        text = " ".join(filter(None, (str(fields["value"]), str(fields.get("unit", ""))))).strip()
        if text.endswith("%") and name in units:
            try:
                value = In(units[name], base=float(base.values[name])).number(text)
            except ValueError as error:
                raise ParameterError([f"{where}: {name} = {text}: {error}"]) from error
            changes[name] = {**fields, "value": repr(value), "unit": units[name]}
    try:
        return base.with_values(changes)
    except ParameterError as error:
        raise ParameterError([f"{where}: {problem.removeprefix('replaced value: ')}"
                              for problem in error.problems]) from error
