"""Writing a baseline: text to be read in a review, the same for the same response."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ..actuators import NONLINEAR, get
from ..parameters import load_parameters
from .excite import KINDS, OPTIONAL, SOURCE
from .measure import FIGURES
from .model import DIGITS, FILE, NEVER, SCHEMA, TRACES, Approved, Baseline, Limit

_UNITS = {v.name: v.unit for v in get(NONLINEAR).file_entries}
_HEAD = """# The approved response of an actuator. Limits and cases may be edited; everything else is written by
# `emcas baseline record`, which keeps them. `emcas baseline check` compares with it.
"""


def write(baseline: Baseline, folder: Path) -> list[Path]:
    """Write the files of a baseline, and give them. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    step = baseline.limits.sample_time
    written = [folder / FILE]
    for approved in baseline.cases:
        if approved.traces:
            path = folder / f"{approved.case.name}.csv"
            path.write_text("\n".join(_rows(approved, step)) + "\n", encoding="utf-8", newline="\n")
            written.append(path)
    # Last, so that a folder with trajectories only is seen to be unfinished.
    written[0].write_text("\n".join(_document(baseline)) + "\n", encoding="utf-8", newline="\n")
    return written


def _rows(approved: Approved, step: float) -> Iterator[str]:
    yield ",".join(["time [s]", *(f"{name} [{TRACES[name][0]}]" for name in approved.traces)])
    columns = list(approved.traces.values())
    times = np.arange(len(columns[0])) * step
    for row in zip(times.tolist(), *(column.tolist() for column in columns), strict=True):
        yield ",".join(f"{value + 0.0:.{DIGITS}g}" for value in row)


def _document(baseline: Baseline) -> Iterator[str]:
    yield f"{_HEAD}schema = {json.dumps(SCHEMA)}\n"
    yield "[recorded]"
    yield from (f"{name} = {json.dumps(value)}" for name, value in baseline.recorded.items())
    yield "\n# All of them; a remark tells the shipped value where it is another.\n[parameters]"
    shipped = load_parameters().values
    for name, value in baseline.parameters.items():
        remark = "" if shipped.get(name) == value else f"  # shipped: {_quantity(name, shipped[name])}"
        yield f"{json.dumps(name)} = {_quantity(name, value)}{remark}"
    yield "\n# A figure may change by the larger of the two; one without an entry here is told and not judged."
    yield "[limits.figures]"
    yield from _limits(baseline.limits.figures)
    yield "\n# Outputs kept as trajectories of every case but sweeps, every sample_time.\n[limits.trajectories]"
    yield f'sample_time = "{baseline.limits.sample_time * 1e3:g} ms"'
    yield from (f'{name} = "{value:g} {TRACES[name][0]}"' for name, value in baseline.limits.traces.items())
    for approved in baseline.cases:
        yield from _case(approved)


def _quantity(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return json.dumps(value)
    unit = _UNITS[name]
    return repr(value) if unit == "1" else f'"{value!r} {unit}"'


def _limits(limits: Mapping[str, Limit]) -> Iterator[str]:
    for name, limit in limits.items():
        yield (f'{name} = {{ absolute = "{limit.absolute:g} {FIGURES[name].unit}", '
               f'relative = "{limit.relative * 100.0:g} %" }}')


def _case(approved: Approved) -> Iterator[str]:
    case = approved.case
    yield f"\n[case.{case.name}]\nkind = {json.dumps(case.kind)}"
    if case.source:
        yield f"{SOURCE[case.kind]} = {json.dumps(case.source)}"
    for name, value in case.entries.items():
        if value != OPTIONAL.get(name):
            yield f'{name} = "{value:.12g} {KINDS[case.kind][name]}"'
    if case.start:
        values = ", ".join(f"{json.dumps(name)} = {_quantity(name, value)}" for name, value in case.start.items())
        yield f"start = {{ {values} }}"
    if approved.limits:
        yield f"\n[case.{case.name}.limits]"
        yield from _limits(approved.limits)
    yield f"\n[case.{case.name}.figures]"
    for name, value in approved.figures.items():
        yield f'{name} = "{f"{value:.{DIGITS}g} {FIGURES[name].unit}" if isfinite(value) else NEVER}"'
