"""The identified values as a parameter file for `load_parameters`.

The file also has the values that the base set changed from the defaults: experiments can be chained, each starting
from the file that the previous one has written.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from math import floor, log10
from pathlib import Path

from ... import __version__
from ...parameters import file_entry, write_parameters
from .result import Estimate, Identification

SOURCE = "identified"
_REMARK = "Reported, no parameter: "


def write_identified(result: Identification, path: Path, base_files: Iterable[Path] = ()) -> None:
    """Write the base set with the identified values. Raises ParameterError if these break its limits or rules."""
    names = Counter(_array(e.variable.name) for e in result.base.entries)
    identified = [e for e in result.estimates if e.parameter]
    changes: dict[str, object] = {}
    for array in dict.fromkeys(_array(e.name) for e in identified):
        elements = [e for e in identified if _array(e.name) == array]
        whole = len(elements) == names[array]
        for name, members in {array: elements}.items() if whole else {e.name: [e] for e in elements}.items():
            changes[name] = file_entry([_rounded(e) for e in members], members[0].unit, SOURCE, _note(result, members))
    first = (f"Identified by emcas {__version__} ({result.experiment.kind}); values, units, 1-sigma uncertainties in "
             "the notes.")
    write_parameters(result.base.with_values(changes), path, [first, *_remarks(result, base_files)])


def _array(name: str) -> str:
    return name.partition("[")[0]


def _remarks(result: Identification, base_files: Iterable[Path]) -> list[str]:
    """Return comments on estimates that are not parameters, and those of the base files."""
    new = [f"{_REMARK}{e.name} = {_rounded(e):g} {e.unit} (1 sigma {e.sigma:.2g}; {result.files})"
           for e in result.estimates if not e.parameter]
    replaced = tuple(line.partition(" = ")[0] + " = " for line in new)
    lines = [line.removeprefix("# ") for file in base_files
             for line in file.read_text(encoding="utf-8-sig").splitlines()]
    return [*(line for line in lines if line.startswith(_REMARK) and not line.startswith(replaced)), *new]


def _rounded(estimate: Estimate) -> float:
    """Return the value to three digits of its uncertainty: more are noise."""
    if not estimate.sigma > 0.0:
        return estimate.value
    return round(estimate.value, 2 - floor(log10(estimate.sigma)))


def _note(result: Identification, estimates: Sequence[Estimate]) -> str:
    sigmas = ", ".join(f"{e.sigma:.2g}" for e in estimates)
    unit = "" if estimates[0].unit == "1" else f" {estimates[0].unit}"
    return f"1 sigma {f'[{sigmas}]' if len(estimates) > 1 else sigmas}{unit}; {result.files}"
