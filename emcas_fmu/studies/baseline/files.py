"""Read and write the files of a baseline: text that can be reviewed, the same for the same response.

Reading checks every entry; a message names the wrong entry and its file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators import NONLINEAR, get
from ...bench.excitation import read_columns
from ...bench.subject import ANGLE_KNOWN
from ...errors import EmcasError
from ...parameters import load_parameters, schema, toml
from ...reference.files import csv_text
from ...simulation import Array
from ...support.writing import write_folder
from .model import DIGITS, FILE, NEVER, Baseline, BaselineTables, Limits, file_unit, output_units, start_entries

SCHEMA = "emcas-baseline/1"
"""Name and version of the files' layout; the number changes when an entry is removed or changes its meaning."""
REMEDY = "restore it from your repository, or record it again with `emcas baseline record`"
_HEAD = """# The approved response of an actuator. Limits and cases may be edited; everything else is written by
# `emcas baseline record`, which keeps them. `emcas baseline check` compares with it.
"""


def read(folder: Path, model: str = NONLINEAR) -> Baseline:
    """Return the baseline of an actuator in a folder. Raises EmcasError."""
    file = folder / FILE
    baseline = parsed(written := _tables(file, model), file, model)
    missing = [*(key for key in ("recorded", "parameters") if key not in written),
               *(f"case.{key}.figures" for key, case in written["case"].items() if "figures" not in case)]
    if missing:
        raise EmcasError(f"{file}: {', '.join(missing)} is missing; {REMEDY}")
    return baseline.model_copy(update={"traces": {key: _traces(folder / f"{key}.csv", baseline.limits, model)
                                                  for key, case in baseline.case.items() if not case.sweeps}})


def read_plan(file: Path, model: str = NONLINEAR) -> Baseline:
    """Return the limits and cases of a baseline's file as a plan for recording; the file's other entries are not read.

    Raises EmcasError.
    """
    written = {key: table for key, table in _tables(file, model).items() if key not in ("recorded", "parameters")}
    cases = written.get("case")
    for case in cases.values() if isinstance(cases, dict) else ():
        if isinstance(case, dict):
            case.pop("figures", None)
    return parsed(written, file, model)


def _tables(file: Path, model: str) -> dict[str, Any]:
    """Return the tables of a file as written. Raises EmcasError if the file is not a baseline of this actuator."""
    if not file.exists() and not file.parent.is_file():
        raise EmcasError(f"{file}: there is no such file; record a baseline with `emcas baseline record MODEL --output "
                         f"{file.parent}`")
    try:
        _, written = schema.document(file, EmcasError)
    except EmcasError as error:
        raise EmcasError(f"{error}; {REMEDY}") from error
    if (version := written.pop("schema", None)) != SCHEMA:
        raise EmcasError(f"{file}: schema: is {version!r}, this emcas reads {SCHEMA!r}; record the baseline again with "
                         "`emcas baseline record`, or use the version of emcas that recorded it")
    name = get(model).name
    if (of := written.pop("model", NONLINEAR)) != name:
        raise EmcasError(f"{file}: is of the actuator {of}, not of {name}; name the actuator of a parameter file with "
                         "--model, and keep the baseline of each actuator in its own folder")
    return written


def parsed(written: Mapping[str, Any], file: Path, model: str) -> Baseline:
    """Return the baseline that the tables of a file describe, without trajectories. Raises EmcasError."""
    tables = schema.read(BaselineTables, written, file, EmcasError, model)
    return Baseline.model_construct(**dict(tables), model=model, written=written, traces={})


def _header(limits: Limits, model: str) -> list[str]:
    """Return the names of the columns of a trajectory's file."""
    units = output_units(model)
    return ["time [s]", *(f"{name} [{units[name][0]}]" for name in limits.traces)]


def _traces(path: Path, limits: Limits, model: str) -> dict[str, Array]:
    """Return the trajectories in a case's file, by output. Raises EmcasError if the file does not match the limits."""
    try:
        columns, expected = read_columns(path), _header(limits, model)
        if list(columns) != expected:
            raise EmcasError(f"{path}: its columns are {', '.join(columns)}; expected {', '.join(expected)}")
        time, *traces = columns.values()
        for line, row in enumerate(zip(*columns.values(), strict=True), 2):
            if odd := [cell for cell in row if not isfinite(cell)]:
                raise EmcasError(f"{path}: line {line} contains {odd[0]}, which is not a finite number")
        if not np.allclose(time, np.arange(len(time)) * limits.sample_time, rtol=0.0, atol=1e-6):
            raise EmcasError(f"{path}: its times must begin at 0 and be {limits.sample_time:g} s apart")
    except EmcasError as error:
        raise EmcasError(f"{error}; {REMEDY}") from error
    return dict(zip(limits.traces, traces, strict=True))


def write(baseline: Baseline, folder: Path) -> list[Path]:
    """Write the files of a baseline, all or none, and return their paths. Raises EmcasError."""
    header, period = _header(baseline.limits, baseline.model), baseline.limits.sample_time
    files: dict[str, str | bytes] = {}
    for name, traces in baseline.traces.items():
        if traces:
            columns = list(traces.values())
            files[f"{name}.csv"] = csv_text(
                dict(zip(header, [np.arange(len(columns[0])) * period, *columns], strict=True)), DIGITS)
    # FILE is written last: without it, a folder is recognised as unfinished.
    return write_folder(folder, {**files, FILE: "\n\n".join(_sections(baseline)) + "\n"})


def _sections(baseline: Baseline) -> Iterator[str]:
    name, variables = get(baseline.model).name, start_entries(baseline.model)
    shipped, present = load_parameters(model=baseline.model).values, baseline.parameters

    def line(key: str) -> str:
        now, default = (values[key] if isinstance(values[key], bool) or variables[key].unit == "1" else
                        f"{values[key]!r} {variables[key].unit}" for values in (present, shipped))
        remarks = [f"default: {toml.literal(default)}"] if shipped[key] != present[key] else []
        if key in ANGLE_KNOWN:
            remarks.append(f"{toml.literal(ANGLE_KNOWN[key])} in cases without the input home")
        return toml.entry(key, now) + (f"  # {'; '.join(remarks)}" if remarks else "")

    model = "" if name == NONLINEAR else f"\n{toml.entry('model', name)}"
    yield f"{_HEAD}{toml.entry('schema', SCHEMA)}{model}"
    yield toml.table("recorded", baseline.recorded)
    yield "\n".join(["# All parameters; a remark has the default value if it differs.\n[parameters]",
                     *map(line, present)])
    limits = baseline.written["limits"]
    yield ("# A figure may change by the larger of both limits; a figure without an entry is shown and not judged.\n"
           + toml.table("limits.figures", limits["figures"]))
    yield ("# Outputs whose trajectories are kept, every sample_time, in every case except sweeps.\n"
           + toml.table("limits.trajectories", limits["trajectories"]))
    for key, case in baseline.case.items():
        written = dict(baseline.written["case"][key])
        case_limits = written.pop("limits", {})
        yield toml.table(f"case.{key}", written)
        if case_limits:
            yield toml.table(f"case.{key}.limits", case_limits)
        yield toml.table(f"case.{key}.figures", {
            figure: f"{value:.{DIGITS}g} {file_unit(figure)}" if isfinite(value) else NEVER
            for figure, value in case.figures.items()})
