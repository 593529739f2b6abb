"""What the article is judged by: Table 2 of the thesis, and requirements from a file of the user's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any, Literal

from ..errors import EmcasError
from ..toml import tomllib
from ..units import quantity
from ..validation import requirements as table2
from ..validation.results import Verdict
from .bench import Bench
from .outcome import Outcome, flat, unit_of

_FIELDS = ("name", "title", "figure", "sense", "limit")
_SENSES: Mapping[str, Literal["<=", ">="]] = {"<=": "<=", ">=": ">=", "at most": "<=", "at least": ">="}


@dataclass(frozen=True)
class Wanted:
    """A requirement of the user's, as its file has it: limit in the unit of the figure it names."""

    name: str
    title: str
    figure: str
    sense: Literal["<=", ">="]
    limit: float
    source: str

    @property
    def unit(self) -> str:
        """The figure's unit."""
        return unit_of(self.figure)


@dataclass(frozen=True)
class Judged(Verdict):
    """A requirement and what was measured for it; `measured` is None where there is no such figure."""

    source: str
    name: str
    title: str
    measured: float | None
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    how: str

    @property
    def margin_percent(self) -> float | None:
        """The margin in % of the limit."""
        return None if self.margin is None or not self.limit else 100.0 * self.margin / abs(self.limit)


def judge_table2(bench: Bench) -> list[Judged]:
    """The requirements of Table 2, measured as `emcas validate` measures them."""
    found = [table2.judge(r, bench.table2) for r in table2.REQUIREMENTS]
    return [Judged(c.source, c.name, c.title, c.measured, c.sense, c.limit, c.unit, c.note) for c in found]


def judge(wanted: Sequence[Wanted], outcomes: Mapping[str, Outcome]) -> list[Judged]:
    """The user's requirements against the figures of the tests. Raises EmcasError where there is no such figure."""
    figures = dict(flat(outcomes))
    judged = []
    for w in wanted:
        test, _, rest = w.figure.partition(".")
        if w.figure in figures:
            measured: float | None = float(figures[w.figure])
            group, _, key = rest.partition(".")
            how = f"{outcomes[test].title}, {outcomes[test].label(group)}: {outcomes[test].quantity(key).how}"
            if measured is None or not isfinite(measured):
                how = f"the article never reaches what is measured: {how}"
        elif test in outcomes and outcomes[test].stopped:
            measured, how = None, outcomes[test].stopped
        else:
            known = [name for name, value in figures.items() if not isinstance(value, bool)]
            close = get_close_matches(w.figure, known, 3, 0.4) or known[:3]
            raise EmcasError(f"{w.source}: requirement {w.name}: there is no figure {w.figure}; close to it are "
                             f"{', '.join(close)} (`emcas report --json FILE` writes all)")
        if isinstance(figures.get(w.figure), bool):
            raise EmcasError(f"{w.source}: requirement {w.name}: {w.figure} is true or false, and has no limit; choose "
                             "a figure that is a number")
        judged.append(Judged(w.source, w.name, w.title, measured, w.sense, w.limit, w.unit, how))
    return judged


def load(path: Path) -> list[Wanted]:
    """The requirements of a TOML file, an array of tables ``[[requirement]]``.

    Raises EmcasError naming the file, the requirement and what to write.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise EmcasError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # also UnicodeDecodeError
        raise EmcasError(f"{path}: is not valid TOML: {error}") from error
    tables = document.pop("requirement", None)
    if document or not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise EmcasError(f"{path}: expected one or more tables [[requirement]] with {', '.join(_FIELDS)}, and nothing "
                         "else")
    wanted = [_wanted(path, number, table) for number, table in enumerate(tables, start=1)]
    names = [w.name for w in wanted]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise EmcasError(f"{path}: the name {', '.join(twice)} is given twice; give each requirement its own")
    return wanted


def _wanted(path: Path, number: int, table: Mapping[str, Any]) -> Wanted:
    label = f"{path}: requirement {table.get('name', number)}"
    if unknown := [key for key in table if key not in _FIELDS]:
        raise EmcasError(f"{label}: unknown {', '.join(unknown)}; a requirement has {', '.join(_FIELDS)}")
    if missing := [key for key in _FIELDS if key not in table and key != "title"]:
        raise EmcasError(f"{label}: has no {', '.join(missing)}")
    if not_text := [key for key in _FIELDS if not isinstance(table.get(key, ""), str)]:
        raise EmcasError(f"{label}: {not_text[0]} = {table[not_text[0]]!r}: expected a string, such as "
                         "limit = \"0.1 s\"")
    if table["sense"] not in _SENSES:
        raise EmcasError(f"{label}: sense = {table['sense']!r}: expected <= or >=")
    unit = unit_of(table["figure"])
    try:
        limit = _limit(table["limit"], unit)
    except ValueError as error:
        raise EmcasError(f"{label}: limit = {table['limit']!r}: {error}") from error
    return Wanted(table["name"], table.get("title", table["name"]), table["figure"], _SENSES[table["sense"]], limit,
                  path.name)


def _limit(written: str, unit: str) -> float:
    """A limit in the unit of its figure. Raises ValueError."""
    if unit == "dB":
        number, _, given = written.strip().partition(" ")
        if given.strip() != "dB":
            raise ValueError("expected a number with the unit dB")
        return float(number)
    if unit == "%":
        return quantity(written, "", "percent")
    return quantity(written, "", unit)

