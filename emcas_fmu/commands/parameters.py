"""`emcas parameters`: print a parameter set, checked, with units and sources."""

from __future__ import annotations

import json
from collections.abc import Iterable
from math import degrees, isfinite
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..files import named_sets
from ..parameters import ParameterSet
from .common import ModelOption, ParametersOption, failures, out, parameter_set

if TYPE_CHECKING:
    from ..studies.overview import Estimate

EPILOG = ("Examples:\n\n  emcas parameters\n\n  emcas parameters -p my_actuator.toml --json"
          "\n\n  emcas parameters -p my_actuator.toml --sensitivity 50"
          "\n\n  emcas parameters --sets\n\n  emcas parameters -p drive-pi"
          "\n\n  emcas parameters --model elastic+faults")


def parameters(
    parameters: ParametersOption = None,
    model: ModelOption = NONLINEAR,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
    sets: Annotated[bool, typer.Option("--sets", help="List the shipped sets that --parameters takes by "
                                                      "name.")] = False,
    sensitivity: Annotated[float | None, typer.Option(
        help="Order the shipped estimates by how far 10 % of each move the fin within 0.5 s of a step to half of "
             "command.limit against this hinge moment in N.m (0: none).", metavar="TORQUE")] = None,
) -> None:
    """Print the parameter set with units and sources, checked; of a file, what is still a shipped estimate."""
    from ..studies.overview import amounts_to, by_effect, shipped_estimates

    if sets:
        with failures():
            if parameters or model != NONLINEAR:
                raise EmcasError("--sets lists all sets, of any actuator: leave --parameters and --model out")
        _show_sets(as_json)
        return
    with failures():
        chosen = parameter_set(parameters, model)
        if sensitivity is not None and not isfinite(sensitivity):
            raise EmcasError(f"--sensitivity {sensitivity:g}: give a hinge moment in N.m")
        estimates = shipped_estimates(chosen) if sensitivity is None else by_effect(chosen, sensitivity)
    left = {name: estimate for estimate in estimates for name in estimate.names}
    records: list[dict[str, object]] = [
        {"name": e.variable.name, "value": e.value, "unit": e.variable.unit, "as_written": e.text, "source": e.source,
         "note": e.note, "file": e.file, "shipped_estimate": e.variable.name in left} for e in chosen.entries]
    if as_json:
        for record in records if sensitivity is not None else ():
            estimate = left.get(str(record["name"]))
            record["effect_deg"] = degrees(estimate.effect) if estimate and estimate.effect is not None else None
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
    if parameters:
        for what, amount in amounts_to(chosen).items():
            out.print(f"{what}: {amount}", highlight=False)
    if sensitivity is not None:
        _show_effects(estimates, sensitivity)
    elif parameters:
        _show_estimates(chosen, estimates)


def _show_estimates(chosen: ParameterSet, estimates: Iterable[Estimate]) -> None:
    """Print which values are still shipped estimates, a line for each group."""
    from ..studies.overview import by_group, offered

    count = sum(len(estimate.names) for estimate in estimates)
    out.print(f"Still shipped estimates: {count} of {len(chosen.entries)} values, by --sensitivity in the order of "
              "what they do", highlight=False, soft_wrap=True)
    on_sheets = {e.variable.name for entries in offered(chosen).values() for e in entries}
    listed = [estimate for estimate in estimates if on_sheets.intersection(estimate.names)]
    for group, names in by_group(listed).items():
        out.print(f"  {escape(group)}: {escape(', '.join(names))}", highlight=False, soft_wrap=True)
    if others := count - sum(len(estimate.names) for estimate in listed):
        out.print(f"  and {others} that are on no datasheet (--json has all)", highlight=False)


def _show_effects(estimates: Iterable[Estimate], torque: float) -> None:
    """Print the shipped estimates with what 10 % of each do."""
    table = Table("still a shipped estimate", "10 % of it, deg", title_justify="left", title=(
        f"Largest change of the fin's angle by 10 % of each: a step to half of command.limit against {torque:g} N.m"))
    for estimate in estimates:
        if estimate.effect is not None:
            table.add_row(escape(estimate.label), f"{degrees(estimate.effect):.3g}")
    out.print(table)
    if rest := [estimate.label for estimate in estimates if estimate.effect is None]:
        out.print(f"Not varied, being 0, a switch, a count or a temperature: {escape(', '.join(rest))}",
                  highlight=False, soft_wrap=True)


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
