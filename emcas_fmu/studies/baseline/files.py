"""A baseline in files: text for a review, the same for the same response.

Every entry that is read is checked; a message names a wrong one and its file.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import PlainValidator, ValidationInfo, model_validator

from ...actuators import NONLINEAR, get
from ...errors import EmcasError
from ...parameters import load_parameters, schema
from ...support.writing import write_folder
from ...variables import Variable
from .model import (
    DIGITS,
    FILE,
    KINDS,
    NEVER,
    SCHEMA,
    Array,
    Baseline,
    Case,
    Limit,
    Limits,
    Reading,
    Replay,
    output_units,
    reading,
    start_entries,
    unit_of,
)

REMEDY = "restore it from your repository, or write it anew with `emcas baseline record`"
# Units in which a case keeps its numbers, in the order they are written.
_UNITS = {"command": "deg", "torque": "N.m", "duration": "s"}

_HEAD = """# The approved response of an actuator. Limits and cases may be edited; everything else is written by
# `emcas baseline record`, which keeps them. `emcas baseline check` compares with it.
"""


def _parameters(written: Any, info: ValidationInfo) -> dict[str, Any]:
    variables = start_entries(reading(info).model)
    return schema.each(written, lambda name, entry: schema.In.of(schema.parameter_of(name, variables)).number(entry))


def _case(name: str, written: Any, info: ValidationInfo) -> Case:
    if not name.replace("_", "").replace("-", "").isalnum():
        raise ValueError("a case is named by letters, digits, - and _, because a file is named after it")
    case = KINDS[schema.kind_of(written, KINDS)].model_validate(written, context=info.context)
    if reading(info).approved and case.figures is None:
        raise ValueError(f"figures is missing; {REMEDY}")
    return case


def _cases(written: Any, info: ValidationInfo) -> dict[str, Case]:
    cases = schema.each(written, lambda name, entry: _case(name, entry, info))
    if not cases:
        raise ValueError("there is no case; add one such as those of a new baseline")
    for name in cases:
        if any(isinstance(c, Replay) and Path(c.file) == Path(f"{name}.csv") for c in cases.values()):
            raise ValueError(f"the trajectory of {name} would be written over the inputs {name}.csv; rename the case")
    return cases


class _File(schema.Table):
    limits: Limits
    case: Annotated[Mapping[str, Case], PlainValidator(_cases)]
    recorded: dict[str, str] | None = None
    parameters: Annotated[Mapping[str, Any] | None, PlainValidator(_parameters)] = None

    @model_validator(mode="after")
    def _complete(self, info: ValidationInfo) -> _File:
        if reading(info).approved and (self.recorded is None or self.parameters is None):
            raise ValueError(f"{'recorded' if self.recorded is None else 'parameters'} is missing; {REMEDY}")
        return self


def read(path: Path, model: str = NONLINEAR) -> Baseline:
    """Return the baseline of an actuator in a folder, or of a file its limits and cases, for recording.

    Raises EmcasError.
    """
    plan = path.suffix == ".toml"
    file = path if plan else path / FILE
    if not file.is_file():
        raise EmcasError(f"{file}: there is no such file; record a baseline with `emcas baseline record MODEL "
                         f"--output {path}`")
    try:
        _, document = schema.document(file, EmcasError)
    except EmcasError as error:
        raise EmcasError(f"{error}; {REMEDY}") from error
    if (version := document.pop("schema", None)) != SCHEMA:
        raise EmcasError(f"{file}: schema: is {version!r}, this emcas reads {SCHEMA!r}; record the baseline again with "
                         "`emcas baseline record`, or use the emcas it was made with")
    name = get(model).name
    if (of := document.pop("model", NONLINEAR)) != name:
        raise EmcasError(f"{file}: is of the actuator {of}, not of {name}; say with --model what a parameter file is "
                         "of, or keep the baseline of each actuator in a folder of its own")
    tables = schema.read(_File, document, file, EmcasError, Reading(model, not plan))
    traces = {} if plan else {key: _traces(path / f"{key}.csv", tables.limits, model) for key, case in
                              tables.case.items() if case.kind != "sweep"}
    return Baseline(model, tables.limits, tables.case, traces, tables.recorded or {}, tables.parameters or {})


def _traces(path: Path, limits: Limits, model: str) -> dict[str, Array]:
    """Return the columns of a case's file, without time."""
    units = output_units(model)
    columns = ["time [s]", *(f"{name} [{units[name]}]" for name in limits.traces)]
    if not path.is_file():
        raise EmcasError(f"{path}: is missing; {REMEDY}")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file))
        if header != columns:
            raise ValueError(f"its columns are {', '.join(header)}; expected {', '.join(columns)}")
        for line, row in enumerate(rows, 2):
            if len(row) != len(header):
                raise ValueError(f"line {line} has {len(row)} values, not {len(header)}")
            if odd := [cell for cell in row if not isfinite(float(cell))]:
                raise ValueError(f"line {line} has {odd[0]}")
        table = np.array(rows, dtype=float).reshape(-1, len(header))
        if not np.allclose(table[:, 0], np.arange(len(table)) * limits.sample_time, rtol=0.0, atol=1e-6):
            raise ValueError(f"its times are not {limits.sample_time:g} s apart from 0")
    except ValueError as error:
        raise EmcasError(f"{path}: {error}; {REMEDY}") from error
    return dict(zip(limits.traces, table.T[1:], strict=True))


def write(baseline: Baseline, folder: Path) -> list[Path]:
    """Write the files of a baseline, all or none, and return their paths. Raises EmcasError."""
    units, files = output_units(baseline.model), dict[str, str | bytes]()
    for name, traces in baseline.traces.items():
        table, columns = BytesIO(), np.column_stack(list(traces.values()))
        times = np.arange(len(columns)) * baseline.limits.sample_time
        # Adding 0.0 removes the sign of zeros.
        np.savetxt(table, np.column_stack([times, columns]) + 0.0, f"%.{DIGITS}g", ",", comments="",
                   header=",".join(["time [s]", *(f"{output} [{units[output]}]" for output in traces)]))
        files[f"{name}.csv"] = table.getvalue()
    # Written last: a folder with trajectories only is recognised as unfinished.
    files[FILE] = "\n".join(_document(baseline)) + "\n"
    return write_folder(folder, files)


def _document(baseline: Baseline) -> Iterator[str]:
    yield f"{_HEAD}schema = {json.dumps(SCHEMA)}"
    name, variables = get(baseline.model).name, start_entries(baseline.model)
    yield "" if name == NONLINEAR else f"model = {json.dumps(name)}\n"
    yield "[recorded]"
    yield from (f"{name} = {json.dumps(value)}" for name, value in baseline.recorded.items())
    yield "\n# All of them; a remark tells the shipped value where it is another.\n[parameters]"
    shipped = load_parameters(model=baseline.model).values
    for name, value in baseline.parameters.items():
        remark = "" if shipped[name] == value else f"  # shipped: {_quantity(variables[name], shipped[name])}"
        yield f"{json.dumps(name)} = {_quantity(variables[name], value)}{remark}"
    yield "\n# A figure may change by the larger of the two; one without an entry here is shown and not judged."
    yield "[limits.figures]"
    yield from _limits(baseline.limits.figures)
    yield "\n# Outputs kept as trajectories of every case but sweeps, every sample_time.\n[limits.trajectories]"
    yield f'sample_time = "{baseline.limits.sample_time * 1e3:g} ms"'
    units = output_units(baseline.model)
    yield from (f'{name} = "{value:g} {units[name]}"' for name, value in baseline.limits.traces.items())
    for name, case in baseline.cases.items():
        yield from _case_lines(name, case, variables)


def _quantity(variable: Variable, value: Any) -> str:
    if isinstance(value, bool):
        return json.dumps(value)
    return repr(value) if variable.unit == "1" else f'"{value!r} {variable.unit}"'


def _limits(limits: Mapping[str, Limit]) -> Iterator[str]:
    for name, limit in limits.items():
        yield f'{name} = {{ absolute = "{limit.absolute:g} {unit_of(name)}", relative = "{limit.relative:g} %" }}'


def _case_lines(name: str, case: Case, variables: Mapping[str, Variable]) -> Iterator[str]:
    yield f"\n[case.{name}]\nkind = {json.dumps(case.kind)}"
    fields = type(case).model_fields
    yield from (f"{key} = {json.dumps(getattr(case, key))}" for key in ("case", "file") if key in fields)
    yield from (f'{key} = "{getattr(case, key):.12g} {unit}"' for key, unit in _UNITS.items()
                if key in fields and getattr(case, key) != fields[key].default)
    if case.start:
        values = ", ".join(f"{json.dumps(key)} = {_quantity(variables[key], value)}"
                           for key, value in case.start.items())
        yield f"start = {{ {values} }}"
    if case.limits:
        yield f"\n[case.{name}.limits]"
        yield from _limits(case.limits)
    yield f"\n[case.{name}.figures]"
    for key, value in case.figures.items():
        yield f'{key} = "{f"{value:.{DIGITS}g} {unit_of(key)}" if isfinite(value) else NEVER}"'
