"""Figures against requirements: those of the thesis's Table 2, and those of a user's file.

Section 3.1 of Yerlikaya (2016) lists the figures of Table 2; it does not say how they are measured. The ways
chosen here are in each requirement's `how`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from math import degrees, isfinite, isnan, radians
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from junitparser import TestCase
from pydantic import BeforeValidator, Field, PlainValidator, PrivateAttr, ValidationInfo
from rich.markup import escape
from rich.table import Column
from rich.table import Table as RichTable

from ..errors import EmcasError
from ..reference.cases import LOAD
from ..schema import In, Table, each, load, named
from .excitation import Excitation, reference_case, step_to
from .metrics import ACCURACY, held_error, motion, sweep_response, unit_of
from .subject import Run
from .writers import junit_case, number

Sense = Literal["<=", ">="]
Runs = Mapping[str, Run]
TABLE_2 = "Yerlikaya (2016), Table 2"
HOLD = 3.0  # s: outlasts the integral action, whose time constant is kp/ki (1 s with the default gains)
_ACCURACY = round(degrees(ACCURACY), 9)  # deg
_SENSES = {"at most": "<=", "at least": ">="}


@dataclass(frozen=True)
class Judged:
    """A requirement and what was measured for it: `measured` [unit] at least or at most `limit` [unit].

    ``measured`` is None where what it needs was not run (skipped) or gave no such figure (failed, with the reason
    in ``note``); of a bandwidth ``beyond`` the sweep it is the highest frequency swept.
    """

    source: str
    name: str
    title: str
    measured: float | None
    sense: Sense
    limit: float
    unit: str
    note: str = ""
    skipped: bool = False
    beyond: bool = False

    @property
    def margin(self) -> float | None:
        """Distance to the limit [unit], negative where it is missed."""
        if self.measured is None or not isfinite(self.measured):
            return None
        return self.measured - self.limit if self.sense == ">=" else self.limit - self.measured

    @property
    def margin_percent(self) -> float | None:
        """The margin in % of the limit."""
        return None if self.margin is None or not self.limit else 100.0 * self.margin / abs(self.limit)

    @property
    def passed(self) -> bool:
        """Whether the limit is kept; never true of a figure that is missing or not a number."""
        return self.margin is not None and bool(self.margin >= 0.0)

    @property
    def more(self) -> str:
        """The sign before a figure that is a lower bound."""
        return "> " if self.beyond else ""

    def as_dict(self) -> dict[str, Any]:
        """Return the requirement with its margin and verdict, for JSON."""
        return {**asdict(self), "margin": self.margin, "margin_percent": self.margin_percent, "passed": self.passed}

    def junit_case(self, classname: str, time: float = 0.0) -> TestCase:
        """Return the requirement as a test case; `time` [s] is what its run took."""
        return junit_case(self.name, classname, "" if self.passed else str(self), self.note if self.skipped else "",
                         time=time)

    def __str__(self) -> str:
        measured = "no value" if self.measured is None else f"{self.more}{number(self.measured)} {self.unit}"
        text = f"{self.title}: {measured}, required {self.sense} {self.limit:g} {self.unit}"
        return f"{text} ({self.note})" if self.note else text


def all_passed(judged: Sequence[Judged]) -> bool:
    """Return whether something was judged and all of it passed."""
    counted = [j for j in judged if not j.skipped]
    return bool(counted) and all(j.passed for j in counted)


def summary_table(heading: str, judged: Sequence[Judged]) -> RichTable:
    """Return requirements as a table for the terminal, with a line between those of different sources."""
    table = RichTable(Column(heading, no_wrap=True), *(Column(name, justify="right") for name in (
        "measured", "required", "margin")), "unit", "")
    for j, after in zip_longest(judged, judged[1:]):
        table.add_row(escape(j.name), j.more + number(j.measured), f"{j.sense} {j.limit:g}", j.more + number(j.margin),
                      j.unit, "[dim]not run[/]" if j.skipped else "[green]ok[/]" if j.passed else "[bold red]FAIL[/]",
                      end_section=after is not None and after.source != j.source)
    return table


@dataclass(frozen=True)
class Requirement:
    """A row of Table 2: `needs` names the runs that `measure` takes its figure [unit] from."""

    name: str
    title: str
    sense: Sense
    limit: float
    unit: str
    how: str
    needs: tuple[str, ...]
    measure: Callable[[Sequence[Run]], float]


def _range(runs: Sequence[Run]) -> float:
    return degrees(min(abs(run.excitation.moves[-1].level + held_error(run)) for run in runs))


def _accuracy(runs: Sequence[Run]) -> float:
    return degrees(max(abs(held_error(run)) for run in runs))


def _rate(runs: Sequence[Run]) -> float:
    return degrees(min(motion(run, -1)["sustained_rate"] for run in runs))


def _bandwidth(runs: Sequence[Run]) -> float:
    response = sweep_response(runs[0])
    return response.beyond if np.isnan(response.bandwidth) else response.bandwidth


_HELD = {"hold_plus20": 20.0, "hold_minus20": -20.0, "hold_plus1": 1.0, "hold_minus1": -1.0}  # deg
REQUIREMENTS = (
    Requirement("range", "Operating range of the fin", ">=", 20.0 - _ACCURACY, "deg",
                f"smaller angle held at commands of +20 and -20 deg after {HOLD:g} s; the range is ±20 deg, "
                "its ends are met to the accuracy", tuple(_HELD)[:2], _range),
    Requirement("accuracy", "Position accuracy of the fin", "<=", _ACCURACY, "deg",
                f"largest error held after {HOLD:g} s at ±20 and ±1 deg, no load", tuple(_HELD), _accuracy),
    Requirement("unloaded_rate", "Unloaded fin rate", ">=", 220.0, "deg/s",
                "mean over the middle 60 % of steps to ±20 deg, the slower of the two", ("step_plus20", "step_minus20"),
                _rate),
    Requirement("loaded_rate", "Fin rate against 100 N.m", ">=", 200.0, "deg/s",
                "mean over the middle 60 % of a slew from -20 to +20 deg", ("load_opposing",), _rate),
    *(Requirement(f"bandwidth_{label}deg", f"Bandwidth at {amplitude} deg", ">=", 10.0, "Hz",
                  f"-3 dB of the fundamental, sine sweep of {amplitude} deg", (f"chirp_{label}deg",), _bandwidth)
      for label, amplitude in (("1", "1"), ("3p5", "3.5"))),
)


def holds() -> dict[str, Excitation]:
    """Return the steps of Table 2 that are held until the integral action is through, by name; one under the load."""
    return {**{name: step_to(radians(level), HOLD) for name, level in _HELD.items()},
            "hold_loaded": step_to(radians(20.0), HOLD, -LOAD)}


def table2_excitations(requirements: Sequence[Requirement] = REQUIREMENTS) -> dict[str, Excitation]:
    """Return every excitation that requirements are judged by, by name, with the parameters as they are."""
    names = sorted({name for requirement in requirements for name in requirement.needs})
    steps = holds()
    return {name: steps[name] if name in steps else reference_case(name, exact=False) for name in names}


def judge_table2(runs: Runs, requirements: Sequence[Requirement] = REQUIREMENTS) -> list[Judged]:
    """Judge Table 2, or other `requirements`, by runs by name.

    A row is skipped where a run was not made, failed where one ended early.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # a fin that does not move has no gain: nan, which fails
        return [_table2(requirement, runs) for requirement in requirements]


def _table2(r: Requirement, runs: Runs) -> Judged:
    absent = [name for name in r.needs if name not in runs]
    broken = [name for name in r.needs if name in runs and runs[name].stopped is not None]
    measured, beyond = None, False
    if absent:
        note = f"needs {', '.join(absent)}, not run"
    elif broken:
        note = f"{', '.join(broken)} did not run to the end"
    else:
        measured = r.measure([runs[name] for name in r.needs])
        beyond = r.measure is _bandwidth and isfinite(measured) and isnan(sweep_response(runs[r.needs[0]]).bandwidth)
        note = r.how if isfinite(measured) else f"the response never reaches what is measured: {r.how}"
    return Judged(TABLE_2, r.name, r.title, measured, r.sense, r.limit, r.unit, note, bool(absent), beyond)


def _limit(entry: Any, info: ValidationInfo) -> float:
    return float(In(unit_of(info.data.get("figure", ""))).number(entry))


class FileRequirement(Table):
    """A requirement of a user's file: its limit is in the unit that the name of its figure ends in."""

    name: str
    title: str = ""
    figure: str
    sense: Annotated[Sense, BeforeValidator(lambda entry: _SENSES.get(str(entry), entry))]
    limit: Annotated[float, PlainValidator(_limit)]
    _source: str = PrivateAttr("")

    def model_post_init(self, context: Any) -> None:
        """Keep the name of the file."""
        self._source = context

    @property
    def source(self) -> str:
        """The file it is from."""
        return self._source

    def judged(self, measured: float | None, note: str, beyond: bool = False) -> Judged:
        """Return the requirement with what was measured for it."""
        return Judged(self.source, self.name, self.title or self.name, measured, self.sense, self.limit,
                      unit_of(self.figure), note, beyond=beyond)


def _requirements(entries: Any, info: ValidationInfo) -> dict[str, FileRequirement]:
    if not entries:
        raise ValueError(f"expected one or more tables [[requirement]] with {', '.join(FileRequirement.model_fields)}")
    return each(named(entries), lambda _, entry: FileRequirement.model_validate(entry, context=info.context))


class _File(Table):
    requirement: Annotated[dict[str, FileRequirement], PlainValidator(_requirements)] = Field({}, validate_default=True)


def load_requirements(path: Path) -> list[FileRequirement]:
    """Return the requirements of a TOML file, an array of tables ``[[requirement]]``.

    Raises EmcasError naming the file, the requirement and what to write.
    """
    return list(load(_File, path, EmcasError, path.name).requirement.values())
