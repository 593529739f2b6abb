"""Stored reference cases, checked against the hashes of their provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isclose, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..simulation import Array
from . import files
from .cases import SIGNIFICANT_DIGITS, sag, select

Columns = Mapping[str, Array]
_NEAR = 1e-3  # steps, tolerance of row times: far above the rounding to nine digits


@dataclass(frozen=True)
class Stored:
    """A reference case from a folder or an FMU, with `step` and `stop_time` [s]; `model` is its actuator.

    If not `independent`, its response was computed by the package's stepping. Columns and start values are in SI.
    """

    name: str
    title: str
    kind: str
    step: float
    stop_time: float
    start_values: Mapping[str, Any]
    inputs: Columns
    reference: Columns
    parameters_hash: str
    model: str
    independent: bool = True

    def __post_init__(self) -> None:
        """Raise ValueError for impossible times, missing columns and start values that are not finite."""
        for what, value in (("step", self.step), ("stop time", self.stop_time)):
            if not (isinstance(value, (int, float)) and 0.0 < value < inf):
                raise ValueError(f"{self.name}: its {what} is {value!r}; expected seconds above 0")
        for columns, needed in ((self.inputs, ("time",)), (self.reference, ("time", "fin_angle"))):
            if missing := [name for name in needed if columns and name not in columns]:
                raise ValueError(f"{self.name}: there is no column {missing[0]}")
            time = columns.get("time", np.zeros(0))
            if columns and not (abs((len(time) - 1) * self.step - self.stop_time) < _NEAR * self.step and
                                np.allclose(time, np.arange(len(time)) * self.step, rtol=0.0, atol=_NEAR * self.step)):
                raise ValueError(f"{self.name}: the column time does not go from 0 to {self.stop_time:g} s in steps of "
                                 f"{self.step:g} s")
        if odd := [name for name, value in self.start_values.items() if not isfinite(value)]:
            raise ValueError(f"{self.name}: the start value of {odd[0]} is {self.start_values[odd[0]]}; "
                             "expected a finite number")

    @property
    def supply(self) -> float | None:
        """Start value of the supply [V]; None if the case does not drive it."""
        column = self.inputs.get("supply_voltage")
        return None if column is None else float(column[0])

    def with_supply(self, supply: float) -> Stored:
        """Return the case for a supply that starts at `supply` [V]: a sag from another voltage has no reference."""
        if self.name != "sag" or self.supply is None or isclose(self.supply, supply, rel_tol=10.0**-SIGNIFICANT_DIGITS):
            return self
        case = sag(supply)
        return replace(self, title=case.title, inputs=case.inputs(), reference={})


def load(folder: Path, names: Sequence[str] | None, needed: Iterable[str] = ()) -> list[Stored]:
    """Return the named cases of a folder; without names all of them, which must include the `needed` cases.

    Raises EmcasError for an unknown or missing case, a missing folder, files that differ from the provenance, and an
    incomplete provenance.
    """
    remedy = files.remedy(folder)
    if not folder.is_dir():
        raise EmcasError(f"{folder}: there is no such folder of reference files; {remedy}")
    provenance = files.read_provenance(folder)
    if not provenance:
        raise EmcasError(f"{folder / files.PROVENANCE}: is missing or empty; {remedy}")
    chosen = select(names, provenance, folder)
    if not names and (missing := [name for name in needed if name not in provenance]):
        raise EmcasError(f"{folder}: has no reference of {', '.join(missing)}; {remedy}, or name the cases "
                         "to run")
    return [_case(folder, name, entry, remedy) for name, entry in chosen.items()]


def _case(folder: Path, name: str, entry: Mapping[str, Any], remedy: str) -> Stored:
    if not isinstance(entry, Mapping):
        raise EmcasError(f"{folder / files.PROVENANCE}: {name} is not a table; {remedy}")
    inputs, reference = (files.read_table(folder, name, f"{kind}.csv", entry.get(f"sha256_{kind}", ""))
                         for kind in ("in", "ref"))
    try:
        return Stored(name, entry["title"], entry["kind"], entry["step"], entry["stop_time"], entry["start_values"],
                      inputs, reference, entry["sha256_parameters"], entry.get("model", NONLINEAR))
    except KeyError as error:
        raise EmcasError(f"{folder / files.PROVENANCE}: {name} has no entry {error}; {remedy}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise EmcasError(f"{folder / files.PROVENANCE}: {error}; {remedy}") from error
