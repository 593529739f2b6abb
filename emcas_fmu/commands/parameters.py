"""`emcas parameters`: check a parameter set, and print it with units and sources."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from math import degrees, isfinite
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..parameters import ParameterSet
from ..support.files import described_sets
from . import common

if TYPE_CHECKING:
    from ..studies.overview import EstimatedEntries

EPILOG = common.examples("parameters", "", "-p my_actuator.toml --json", "-p my_actuator.toml --sensitivity 50",
                         "--sets", "-p drive-pi", "--model elastic+faults")


def parameters(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    sets: Annotated[bool, typer.Option(
        "--sets", help="List the shipped sets, whose names --parameters accepts.")] = False,
    sensitivity: Annotated[float | None, common.value(
        "Order the remaining estimates by their effect: the largest change of the fin angle if one estimate changes by "
        "10 %, in 0.5 s after a step to half of command.limit against this moment in N.m (0: none).", "TORQUE")] = None,
) -> None:
    """Check a parameter set and print it with units and sources; with --parameters, also the remaining estimates."""
    from ..studies.overview import amounts_to, by_effect, remaining_estimates

    if sets:
        if parameters or model != NONLINEAR:
            raise EmcasError("--sets lists all sets, of any actuator: leave --parameters and --model out")
        _show_sets(as_json)
        return
    chosen = common.parameter_set(parameters, model)
    if sensitivity is not None and not isfinite(sensitivity):
        raise EmcasError(f"--sensitivity {sensitivity:g}: give a finite hinge moment in N.m")
    estimates = remaining_estimates(chosen) if sensitivity is None else by_effect(chosen, sensitivity)
    left = {name: estimate for estimate in estimates for name in estimate.names}
    records: list[dict[str, object]] = [
        {"name": e.variable.name, "value": e.value, "unit": e.variable.unit, "as_written": e.text, "source": e.source,
         "note": e.note, "file": e.file, "remaining_estimate": e.variable.name in left,
         "shipped_estimate": e.variable.name in left and left[e.variable.name].shipped} for e in chosen.entries]
    if as_json:
        for record in records if sensitivity is not None else ():
            estimate = left.get(str(record["name"]))
            record["effect_deg"] = degrees(estimate.effect) if estimate and estimate.effect is not None else None
        print(json.dumps(records, indent=1))
        return
    notes = common.out.width >= 130
    columns = ["name", "value", "unit", "source", *["as_written"] * (common.out.width >= 100), *["note"] * notes]
    rows = [{**record, "value": f"{record['value']:.6g}" if isinstance(record["value"], float)
             else str(record["value"]).lower()} for record in records]
    common.out.print(common.table(
        [">" * (name == "value") + name.replace("_", " ") for name in columns],
        ([str(row[name]) for name in columns] for row in rows), f"Parameters of {chosen.actuator.name}",
        whole=range(4)))
    if not notes:
        common.out.print("A wider terminal, or --json, also shows the note on each value.")
    if parameters:
        for what, amount in amounts_to(chosen).items():
            common.out.print(f"{what}: {amount}")
    if sensitivity is not None:
        _show_effects(estimates, sensitivity)
    elif parameters:
        _show_estimates(chosen, estimates)


def _show_estimates(chosen: ParameterSet, estimates: Sequence[EstimatedEntries]) -> None:
    """Print the names of the values that are still estimates, one line for each group."""
    from ..studies.overview import by_group, in_words, offered

    common.say(f"Still {escape(in_words(chosen, estimates))}; --sensitivity orders them by their effect")
    on_sheets = {e.variable.name for entries in offered(chosen).values() for e in entries}
    listed = [estimate for estimate in estimates if on_sheets.intersection(estimate.names)]
    for group, names in by_group(listed).items():
        common.say(f"  {escape(group)}: {escape(', '.join(names))}")
    if others := sum(len(estimate.names) for estimate in estimates if estimate not in listed):
        common.out.print(f"  and {others} that no datasheet contains (--json lists all)")


def _show_effects(estimates: Iterable[EstimatedEntries], torque: float) -> None:
    """Print the remaining estimates with the effect of a 10 % change of each."""
    common.out.print(common.table(
        ["still an estimate", "effect of 10 % / deg"],
        ([each.label, f"{degrees(each.effect):.3g}"] for each in estimates if each.effect is not None),
        f"Largest change of the fin angle by a 10 % change: step to half of command.limit against {torque:g} N.m"))
    if rest := [estimate.label for estimate in estimates if estimate.effect is None]:
        common.say(f"Not varied (0, a switch, a count or a temperature): {escape(', '.join(rest))}")


def _show_sets(as_json: bool) -> None:
    """Print each set's name with the first paragraph of its file, a comment that describes it."""
    described = described_sets()
    if as_json:
        print(json.dumps([{"name": name, "description": text} for name, text in described.items()], indent=1))
        return
    common.out.print(common.table(["set", "description"], described.items(), "Sets for --parameters"))
