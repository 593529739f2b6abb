"""Writing a baseline: text to be read in a review, the same for the same response."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators import NONLINEAR, get
from ...parameters import load_parameters
from ...variables import Variable
from ...writing import write_folder
from .model import DIGITS, FILE, NEVER, SCHEMA, Baseline, Case, Limit, output_units, start_entries, unit_of

# Units in which a case keeps its numbers, in the order they are written.
_UNITS = {"command": "deg", "torque": "N.m", "duration": "s"}

_HEAD = """# The approved response of an actuator. Limits and cases may be edited; everything else is written by
# `emcas baseline record`, which keeps them. `emcas baseline check` compares with it.
"""


def write(baseline: Baseline, folder: Path) -> list[Path]:
    """Write the files of a baseline, all of them or none, and give them. Raises EmcasError."""
    units, files = output_units(baseline.model), dict[str, str | bytes]()
    for name, traces in baseline.traces.items():
        table, columns = BytesIO(), np.column_stack(list(traces.values()))
        times = np.arange(len(columns)) * baseline.limits.sample_time
        # No zero has a sign.
        np.savetxt(table, np.column_stack([times, columns]) + 0.0, f"%.{DIGITS}g", ",", comments="",
                   header=",".join(["time [s]", *(f"{output} [{units[output]}]" for output in traces)]))
        files[f"{name}.csv"] = table.getvalue()
    # Last, so that a folder with trajectories only is seen to be unfinished.
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
        yield from _case(name, case, variables)


def _quantity(variable: Variable, value: Any) -> str:
    if isinstance(value, bool):
        return json.dumps(value)
    return repr(value) if variable.unit == "1" else f'"{value!r} {variable.unit}"'


def _limits(limits: Mapping[str, Limit]) -> Iterator[str]:
    for name, limit in limits.items():
        yield f'{name} = {{ absolute = "{limit.absolute:g} {unit_of(name)}", relative = "{limit.relative:g} %" }}'


def _case(name: str, case: Case, variables: Mapping[str, Variable]) -> Iterator[str]:
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
