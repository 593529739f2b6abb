"""`emcas parameters`: print a parameter set, checked, with units and sources."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..files import named_sets
from .common import ModelOption, ParametersOption, failures, out, parameter_set

EPILOG = ("Examples:\n\n  emcas parameters\n\n  emcas parameters -p my_actuator.toml --json"
          "\n\n  emcas parameters --sets\n\n  emcas parameters -p drive-pi"
          "\n\n  emcas parameters --model elastic+faults")


def parameters(
    parameters: ParametersOption = None,
    model: ModelOption = NONLINEAR,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
    sets: Annotated[bool, typer.Option("--sets", help="List the shipped sets that --parameters takes by "
                                                      "name.")] = False,
) -> None:
    """Print the parameter set with units and sources, checked."""
    if sets:
        with failures():
            if parameters or model != NONLINEAR:
                raise EmcasError("--sets lists all sets, of any actuator: leave --parameters and --model out")
        _show_sets(as_json)
        return
    with failures():
        chosen = parameter_set(parameters, model)
    records = [{"name": e.variable.name, "value": e.value, "unit": e.variable.unit, "as_written": e.text,
                "source": e.source, "note": e.note, "file": e.file} for e in chosen.entries]
    if as_json:
        print(json.dumps(records, indent=1))
        return
    notes = out.width >= 130
    columns = ["name", "value", "unit", "source", *["as_written"] * (out.width >= 100), *["note"] * notes]
    table = Table(*(name.replace("_", " ") for name in columns), title="EM-CAS parameters", title_justify="left")
    for column in table.columns[:4]:
        column.no_wrap = True
    table.columns[1].justify = "right"
    for record in records:
        value = record["value"]
        record["value"] = f"{value:.6g}" if isinstance(value, float) else str(value).lower()
        table.add_row(*(escape(str(record[name])) for name in columns))
    out.print(table)
    if not notes:
        out.print("A wider terminal, or --json, shows what each value rests on.")


def _show_sets(as_json: bool) -> None:
    """Print each set's name with the first line of its file, a comment that says what it is."""
    with failures():
        described = {name: path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
                     for name, path in named_sets().items()}
    if as_json:
        print(json.dumps([{"name": name, "description": text} for name, text in described.items()], indent=1))
        return
    table = Table("set", "what it is", title="Sets for --parameters", title_justify="left")
    for name, text in described.items():
        table.add_row(name, escape(text))
    out.print(table)
