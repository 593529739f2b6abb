"""The identified values as a parameter file that `load_parameters` reads.

What the base set already changed from the defaults is carried over, so that experiments can be
chained: each starts from the file the one before has written.
"""

from __future__ import annotations

import re
from math import floor, log10
from pathlib import Path

from .. import __version__
from ..parameters import Entry, ParameterSet, entry_line, load_parameters
from .result import Estimate, Identification

SOURCE = "identified"
_REMARK = "# Reported, no parameter: "
_ELEMENT = re.compile(r"(.+)\[\d+\]")


def write_parameters(result: Identification, base: ParameterSet, path: Path,
                     base_path: Path | None = None) -> ParameterSet:
    """Write the file, and give the set it makes. Raises ParameterError where the set has no sense."""
    found = {e.name: e for e in result.estimates if e.parameter}
    notes = {name: _note(result, e) for name, e in found.items()}
    base.replace({name: e.value for name, e in found.items()})  # says what is wrong before anything is written
    entries = [e for e in base.entries if e.variable.name in found or e.file != "emcas.toml"]
    lines = [f"# Identified by emcas {__version__} ({result.kind}); values, units, 1-sigma uncertainties in the notes.",
             *_remarks(result, base_path), ""]
    done: set[str] = set()
    for entry in entries:
        match = _ELEMENT.fullmatch(entry.variable.name)
        name = match[1] if match else entry.variable.name
        if name in done:
            continue
        done.add(name)
        group = [e for e in base.entries if e.variable.name == name or e.variable.name.startswith(name + "[")]
        lines.append(_line(name, group, found, notes, array=match is not None))
    text = "\n".join([*lines, ""])
    path.write_text(text, encoding="utf-8", newline="\n")
    return load_parameters(path)


def _remarks(result: Identification, base_path: Path | None) -> list[str]:
    """Comments on what is no parameter, those of the base file among them."""
    new = [f"{_REMARK}{e.name} = {_rounded(e):g} {e.unit} (1 sigma {e.sigma:.2g}; {result.files})"
           for e in result.estimates if not e.parameter]
    if base_path is None:
        return new
    mine = tuple(line.partition(" = ")[0] + " = " for line in new)
    old = [line for line in base_path.read_text(encoding="utf-8-sig").splitlines()
           if line.startswith(_REMARK) and not (mine and line.startswith(mine))]
    return [*old, *new]


def _rounded(estimate: Estimate) -> float:
    """The value with three digits of its uncertainty: more are noise."""
    if not estimate.sigma > 0.0:
        return estimate.value
    return round(estimate.value, 2 - floor(log10(estimate.sigma)))


def _note(result: Identification, estimate: Estimate) -> str:
    return f"1 sigma {estimate.sigma:.2g}{_spelled(estimate.unit)}; {result.files}"


def _spelled(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _line(name: str, group: list[Entry], found: dict[str, Estimate], notes: dict[str, str], array: bool) -> str:
    names = [e.variable.name for e in group]
    unit = group[0].variable.unit
    values = [_rounded(found[n]) if n in found else e.value for n, e in zip(names, group, strict=True)]
    fresh = [n for n in names if n in found]
    if fresh and array:
        sigmas = ", ".join(f"{found[n].sigma:.2g}" for n in names if n in found)
        note = f"1 sigma [{sigmas}]{_spelled(unit)}; {notes[fresh[0]].partition('; ')[2]}"
    else:
        note = notes[fresh[0]] if fresh else group[0].note
    return entry_line(name, values, unit, SOURCE if fresh else group[0].source, note)
