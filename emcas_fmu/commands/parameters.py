"""`emcas parameters`: the set with units and sources."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from ..actuators import NONLINEAR
from ..parameters import ParameterSet, load_parameters
from .common import ModelOption, ParametersOption, failures, out, warn

EPILOG = ("Examples:\n\n  emcas parameters\n\n  emcas parameters -p my_actuator.toml --json"
          "\n\n  emcas parameters --model elastic+faults")


def show_parameters(
    parameters: ParametersOption = None,
    model: ModelOption = NONLINEAR,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
) -> None:
    """Print the parameter set with units and sources, checked."""
    with failures():
        chosen = load_parameters(parameters, model=model)
    warn(chosen.warnings)
    if as_json:
        print(json.dumps(_parameter_records(chosen), indent=1))
        return
    notes = out.width >= 130
    extra = [("note", "note")] if notes else []
    if out.width >= 100:
        extra.insert(0, ("as written", "as_written"))
    table = Table("name", "value", "unit", "source", *(title for title, _ in extra),
                  title="EM-CAS parameters", title_justify="left")
    for column in table.columns[:4]:
        column.no_wrap = True
    table.columns[1].justify = "right"
    for record in _parameter_records(chosen):
        value = record["value"]
        text = f"{value:.6g}" if isinstance(value, float) else str(value).lower()
        table.add_row(record["name"], text, record["unit"], record["source"],
                      *(escape(record[key]) for _, key in extra))
    out.print(table)
    if not notes:
        out.print("A wider terminal, or --json, shows what each value rests on.")


def _parameter_records(chosen: ParameterSet) -> list[dict[str, Any]]:
    return [{"name": e.variable.name, "value": chosen.values[e.variable.name], "unit": e.variable.unit,
             "as_written": e.text, "source": e.source, "note": e.note, "file": str(e.file)}
            for e in chosen.entries]
