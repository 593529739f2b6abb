"""Reading a baseline: every entry is checked, and a wrong one named with its file."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ..actuators import NONLINEAR, get
from ..errors import EmcasError
from ..toml import tomllib
from ..units import UnitError, quantity
from .excite import KINDS, OPTIONAL, SOURCE, Case
from .measure import FIGURES
from .model import FILE, NEVER, SCHEMA, TRACES, Approved, Array, Baseline, Limit, Limits

_VARIABLES = {v.name: v for v in get(NONLINEAR).file_entries}
_TUNED = {v.name: v for v in get(NONLINEAR).parameters}
REMEDY = "restore it from your repository, or write it anew with `emcas baseline record`"


class _Entries:
    """A table of the file; what it gives is checked, and errors name file and entry."""

    def __init__(self, path: Path, where: str, table: object, known: Mapping[str, Any] | None = None) -> None:
        self.path, self.where = path, where
        if not isinstance(table, dict):
            self.fail("", "has to be a table of entries")
        self.table: dict[str, Any] = table
        for name in self.table:
            if known is not None and name not in known:
                close = get_close_matches(name, known, 1)
                self.fail(name, "there is no such entry; " + (f"did you mean {close[0]}?" if close
                                                              else f"there is {', '.join(known)}"))

    def fail(self, name: str, what: str) -> NoReturn:
        raise EmcasError(f"{self.path}: {'.'.join(part for part in (self.where, name) if part)}: {what}")

    def sub(self, name: str, known: Mapping[str, Any] | None = None, needed: bool = False) -> _Entries:
        if needed and name not in self.table:
            self.fail(name, f"is missing; {REMEDY}")
        return _Entries(self.path, f"{self.where}.{name}".strip("."), self.table.get(name, {}), known)

    def text(self, name: str) -> str:
        value = self.table.get(name)
        if not isinstance(value, str) or not value:
            self.fail(name, "is missing or no text")
        return value

    def number(self, name: str, unit: str, minimum: float = -np.inf) -> float:
        value = self.table.get(name)
        if value is None:
            self.fail(name, "is missing")
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            self.fail(name, f"is {value!r}; expected text such as \"1 {unit}\"")
        try:
            found = quantity(value if isinstance(value, str) else repr(value), "", unit)
        except UnitError as error:
            self.fail(name, f"is {value!r}: {error}")
        if not found >= minimum:
            self.fail(name, f"is {value!r}; it must be at least {minimum:g} {unit}")
        return found

    def each(self, convert: Callable[[str], Any]) -> dict[str, Any]:
        return {name: convert(name) for name in self.table}


def read(path: Path) -> Baseline:
    """The baseline of a folder; of a file only limits and cases, which is what recording needs. Raises EmcasError."""
    template = path.suffix == ".toml"
    file = path if template else path / FILE
    if not file.is_file():
        raise EmcasError(f"{file}: there is no such file; record a baseline with `emcas baseline record MODEL "
                         f"--output {path}`")
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:  # of TOML or of UTF-8
        raise EmcasError(f"{file}: cannot be read as TOML: {error}; {REMEDY}") from error
    if (found := document.get("schema")) != SCHEMA:
        raise EmcasError(f"{file}: schema: is {found!r}, this emcas reads {SCHEMA!r}; record the baseline again with "
                         "`emcas baseline record`, or use the emcas it was made with")
    top = _Entries(file, "", document, dict.fromkeys(("schema", "recorded", "parameters", "limits", "case")))
    limits = _limits(top.sub("limits", {"figures": 0, "trajectories": 0}, needed=True))
    cases = top.sub("case", needed=True)
    if not cases.table:
        cases.fail("", "there is no case; add one such as those of a new baseline")
    approved = tuple(_case(cases.sub(name), name, limits, None if template else path) for name in cases.table)
    for name in (a.case.name for a in approved):
        if any(Path(a.case.source) == Path(f"{name}.csv") for a in approved if a.case.kind == "file"):
            cases.fail(name, f"its trajectory would be written over the inputs {name}.csv; rename the case")
    parameters = top.sub("parameters", _VARIABLES)
    recorded = top.sub("recorded", needed=not template)
    return Baseline(limits, approved, recorded.each(recorded.text),
                    parameters.each(lambda name: _value(parameters, name)))


def _value(entries: _Entries, name: str) -> Any:
    variable, value = _VARIABLES[name], entries.table[name]
    if variable.kind == "Boolean":
        if not isinstance(value, bool):
            entries.fail(name, f"is {value!r}; expected true or false")
        return value
    number = entries.number(name, variable.unit)
    return int(number) if variable.kind == "Integer" else number


def _limits(entries: _Entries) -> Limits:
    traces = entries.sub("trajectories", {"sample_time": 0, **TRACES}, needed=True)
    sample = traces.number("sample_time", "s", 1e-3)
    if abs(sample * 1e3 - round(sample * 1e3)) > 1e-9:
        traces.fail("sample_time", f"is {sample:g} s; it must be a whole number of ms")
    return Limits(_figure_limits(entries.sub("figures", FIGURES, needed=True)),
                  {name: traces.number(name, TRACES[name][0], 0.0) for name in traces.table if name != "sample_time"},
                  round(sample, 9))


def _figure_limits(entries: _Entries) -> dict[str, Limit]:
    found = {}
    for name in entries.table:
        own = entries.sub(name, {"absolute": 0, "relative": 0})
        found[name] = Limit(own.number("absolute", FIGURES[name].unit, 0.0), own.number("relative", "%", 0.0) / 100.0)
    return found


def _case(entries: _Entries, name: str, limits: Limits, folder: Path | None) -> Approved:
    if not name.replace("_", "").replace("-", "").isalnum():
        entries.fail("", "a case is named by letters, digits, - and _, because a file is named after it")
    kind = entries.text("kind")
    if kind not in KINDS:
        entries.fail("kind", f"is {kind!r}; there is {', '.join(KINDS)}")
    source = SOURCE.get(kind, "")
    known = {**KINDS[kind], **({source: ""} if source else {})}
    _Entries(entries.path, entries.where, entries.table, dict.fromkeys((*known, "kind", "start", "limits", "figures")))
    numbers = {key: OPTIONAL[key] if key in OPTIONAL and key not in entries.table else entries.number(key, unit)
               for key, unit in KINDS[kind].items()}
    if not numbers.get("command", 1.0):
        entries.fail("command", "is 0; nothing would move")
    if not 0.1 <= numbers.get("duration", 1.0) <= 60.0:
        entries.fail("duration", f"is {numbers['duration']:g} s; it must be within 0.1 .. 60 s")
    start = entries.sub("start", _TUNED)
    case = Case(name, kind, numbers, entries.text(source) if source else "",
                start.each(lambda key: _value(start, key)))
    for key, value in case.start.items():
        if not _TUNED[key].minimum <= value <= _TUNED[key].maximum:
            start.fail(key, f"is {value:g}; it must be within {_TUNED[key].minimum:g} .. {_TUNED[key].maximum:g} "
                            f"{_TUNED[key].unit}")
    own = _figure_limits(entries.sub("limits", FIGURES))
    if folder is None:
        return Approved(case, limits=own)
    figures = entries.sub("figures", FIGURES, needed=True)
    values = {key: float("nan") if figures.table[key] == NEVER else figures.number(key, FIGURES[key].unit)
              for key in figures.table}
    traces = {} if kind == "sweep" else _traces(folder / f"{name}.csv", limits)
    return Approved(case, values, traces, own)


def _traces(path: Path, limits: Limits) -> dict[str, Array]:
    """The columns of a case's file but its time."""
    wanted = ["time [s]", *(f"{name} [{TRACES[name][0]}]" for name in limits.traces)]
    if not path.is_file():
        raise EmcasError(f"{path}: is missing; {REMEDY}")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file))
        if header != wanted:
            raise ValueError(f"its columns are {', '.join(header)}; expected {', '.join(wanted)}")
        for line, row in enumerate(rows, 2):
            if len(row) != len(header):
                raise ValueError(f"line {line} has {len(row)} values, not {len(header)}")
            for cell in row:
                if not np.isfinite(float(cell)):
                    raise ValueError(f"line {line} has {cell}")
        table = np.array([[float(cell) for cell in row] for row in rows]).reshape(-1, len(header))
        if not np.allclose(table[:, 0], np.arange(len(table)) * limits.sample_time, rtol=0.0, atol=1e-6):
            raise ValueError(f"its times are not {limits.sample_time:g} s apart from 0")
    except ValueError as error:
        raise EmcasError(f"{path}: {error}; {REMEDY}") from error
    return dict(zip(limits.traces, table.T[1:], strict=True))
