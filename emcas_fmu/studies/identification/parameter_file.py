"""The identified values as a parameter file that `load_parameters` reads.

What the base set already changed from the defaults is carried over, so that experiments can be
chained: each starts from the file the one before has written.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import floor, log10
from pathlib import Path

from ... import __version__
from ...parameters import ParameterSet, file_entry, write_parameters
from .result import Estimate, Identification

SOURCE = "identified"
_REMARK = "Reported, no parameter: "


def write_identified(result: Identification, base: ParameterSet, path: Path, base_files: Iterable[Path] = ()) -> None:
    """Write the base set with what was identified over it. Raises ParameterError where that makes no sound set."""
    changes: dict[str, object] = {}
    for name in dict.fromkeys(e.name.partition("[")[0] for e in result.estimates if e.parameter):
        estimates = {e.name: e for e in result.estimates if e.parameter and e.name.partition("[")[0] == name}
        array = [e for e in base.entries if e.variable.name.partition("[")[0] == name]
        values = [_rounded(estimates[e.variable.name]) if e.variable.name in estimates else float(e.value)
                  for e in array]
        changes[name] = file_entry(values, array[0].variable.unit, SOURCE, _note(result, list(estimates.values())))
    first = f"Identified by emcas {__version__} ({result.kind}); values, units, 1-sigma uncertainties in the notes."
    write_parameters(base.replace(changes), path, [first, *_remarks(result, base_files)])


def _remarks(result: Identification, base_files: Iterable[Path]) -> list[str]:
    """Comments on what is no parameter, those of the base files among them."""
    new = [f"{_REMARK}{e.name} = {_rounded(e):g} {e.unit} (1 sigma {e.sigma:.2g}; {result.files})"
           for e in result.estimates if not e.parameter]
    mine = tuple(line.partition(" = ")[0] + " = " for line in new)
    lines = [line.removeprefix("# ") for file in base_files
             for line in file.read_text(encoding="utf-8-sig").splitlines()]
    return [*(line for line in lines if line.startswith(_REMARK) and not line.startswith(mine)), *new]


def _rounded(estimate: Estimate) -> float:
    """The value with three digits of its uncertainty: more are noise."""
    if not estimate.sigma > 0.0:
        return estimate.value
    return round(estimate.value, 2 - floor(log10(estimate.sigma)))


def _note(result: Identification, estimates: Sequence[Estimate]) -> str:
    sigmas = ", ".join(f"{e.sigma:.2g}" for e in estimates)
    unit = "" if estimates[0].unit == "1" else f" {estimates[0].unit}"
    return f"1 sigma {f'[{sigmas}]' if len(estimates) > 1 else sigmas}{unit}; {result.files}"
