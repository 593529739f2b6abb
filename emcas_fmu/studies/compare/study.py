"""Parameter sets and actuators judged by Table 2, and by the fin's rate with its load, each by the same runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...actuators import NAMES, split
from ...bench import verdict
from ...bench.subject import ParameterSubject, Run
from ...bench.verdict import REQUIREMENTS, Judged
from ...errors import EmcasError, hint
from ...parameters import ParameterError, ParameterSet, load_parameters, parameter_file
from ...progress import Progress, silent

DEFAULT = "default"
"""The name of the default set itself."""
DRIVES = (DEFAULT, "drive-si", "drive-scaled", "drive-pi")
"""What is compared unless sets are given."""
_AGAINST = next(r for r in REQUIREMENTS if r.name == "loaded_rate")
# Table 2 asks for its rate at 100 N.m and does not say which way the load acts: the rate with it is no row of Table 2.
ROWS = (*REQUIREMENTS, replace(_AGAINST, name="aided_rate", title="Fin rate with 100 N.m (added)",
                               needs=("load_aiding",)))
_OUTPUTS = ("fin_angle", "fin_rate")


@dataclass(frozen=True)
class Column:
    """One set or actuator: the name it was given by, the parameters, and what was measured, in the order of ROWS."""

    name: str
    parameters: ParameterSet
    judged: tuple[Judged, ...]
    runs: Mapping[str, Run] = field(repr=False)

    @property
    def passed(self) -> bool:
        """Whether all that was judged is met."""
        return verdict.all_passed(self.judged)


@dataclass(frozen=True)
class Result:
    """Sets, or actuators, beside each other."""

    columns: tuple[Column, ...]

    @property
    def rows(self) -> list[tuple[Judged, ...]]:
        """A row for each requirement: of every set what was measured for it."""
        return list(zip(*(column.judged for column in self.columns), strict=True))

    @property
    def estimates(self) -> list[str]:
        """Parameters that rest on an engineering estimate in at least one column."""
        estimates = {name for column in self.columns for name in column.parameters.estimates}
        return [name for name in self.units if name in estimates]

    @property
    def units(self) -> dict[str, str]:
        """Units of all parameters by name."""
        return {e.variable.name: e.variable.unit for column in self.columns for e in column.parameters.entries}

    @property
    def models(self) -> list[str]:
        """The actuators, each once."""
        return list(dict.fromkeys(column.parameters.actuator.name for column in self.columns))

    @property
    def differing(self) -> dict[str, tuple[Any, ...]]:
        """Values of the parameters that all have and that are not the same in every column, by name."""
        each = [column.parameters.values for column in self.columns]
        shared = {name: tuple(values[name] for values in each) for name in each[0]
                  if all(name in values for values in each)}
        return {name: values for name, values in shared.items() if len(set(values)) > 1}


def load_sets(names: Sequence[str], model: str, below: Sequence[Path] = ()) -> dict[str, ParameterSet]:
    """Return each set by the name or file it is given by, over the files `below`; of an actuator's name its default
    set. Raises EmcasError."""
    if twice := [name for name in names if names.count(name) > 1]:
        raise EmcasError(f"{twice[0]}: is given twice; give each set once")
    base = load_parameters(below, model=model)

    def loaded(name: str) -> ParameterSet:
        if name == DEFAULT:
            return base
        if split(name)[0] in NAMES:
            return load_parameters(below, model=name)
        try:
            parameter_file(name)
        except ParameterError as error:
            raise EmcasError(f"{error}; the actuators are {', '.join(NAMES)}{hint(name, NAMES)}") from error
        return load_parameters(name, base)

    return {name: loaded(name) for name in names}


def compare(sets: Mapping[str, ParameterSet], progress: Progress = silent) -> Result:
    """Judge every set. `progress` is called with the set and the run, how many are done and how many there are."""
    excitations, columns = verdict.table2_excitations(ROWS), list[Column]()
    total = len(sets) * len(excitations)
    for name, parameters in sets.items():
        subject, runs = ParameterSubject(parameters), dict[str, Run]()
        for label, excitation in excitations.items():
            progress(f"{name}: {label}", len(columns) * len(excitations) + len(runs), total)
            if not subject.obstacle(excitation):
                runs[label] = subject.run(excitation, outputs=_OUTPUTS)
        columns.append(Column(name, parameters, tuple(verdict.judge_table2(runs, ROWS)), runs))
    progress("done", total, total)
    return Result(tuple(columns))
