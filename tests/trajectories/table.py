"""The table of trajectories: results of equations, rules and declarations in a JSON file.

    python -m tests.trajectories        # writes the table again

Tests compare it with the present results. It is written again if equations change on purpose, after their own tests
pass: the numbers show that results have changed, not that they are right. The difference in the table shows which
actuators have changed; the others must not.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterable, Mapping
from math import inf, isfinite
from pathlib import Path
from typing import Any

from emcas_fmu.actuators import get
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters

from .points import points, varied
from .runs import mark, models, through

FILE = Path(__file__).with_name("table.json")
Table = dict[str, dict[str, Any]]
_NEVER: dict[Any, str] = {inf: "inf", -inf: "-inf"}  # JSON has neither


def trajectories(model: str) -> dict[str, list[float]]:
    """Return the marks of a model's runs by the run's name, each in the order of the model's outputs."""
    return {name: [_short(value) for value in marks.values()] for name, marks in through(model)}


def declared(model: str) -> dict[str, list[Any]]:
    """Return minimum, maximum, nominal and start value of each variable of a model, by name."""
    actuator = get(model)
    line = () if actuator.supply is None else actuator.supply.line.outputs + actuator.supply.line.parameters
    return {v.name: [_NEVER.get(x, x) for x in (v.minimum, v.maximum, v.nominal, v.start)]
            for v in (*actuator.inputs, *actuator.limited_outputs, *actuator.parameters, *line)}


def rules(model: str) -> list[float]:
    """Return a mark of each rule of a model over random parameters, from its margin and the numbers of its message.

    Rules that warn about the supply are last.
    """
    p, draw = load_parameters(model=model), random.Random(7)
    entries = [v for v in p.actuator.file_entries if v.kind == "Real"]
    columns: dict[int, list[float]] = {}
    for _ in range(30):
        values = {**p.values, **{v.name: varied(draw, v.minimum, v.maximum, p.values[v.name])
                                 for v in draw.sample(entries, len(entries) // 3)}}
        namespace = p.actuator.namespace(values)
        for index, rule in enumerate((*p.actuator.all_rules, *p.actuator.supply_rules)):
            for share in (-0.8, 0.0, 0.6):
                try:
                    results = rule.check(FLOATS, namespace, share)
                except (ArithmeticError, ValueError):
                    results = (-7.0,)
                columns.setdefault(index, []).extend(x if isfinite(x) else -9.0 for x in map(float, results))
    return [_short(mark(column)) for column in columns.values()]


def _short(value: float) -> float:
    return float(f"{value:.12g}")


def write() -> None:
    """Write the table, a line for each run, model and variable."""
    table: Table = {"declared": {}, "rules": {}, "points": {}, "trajectories": {}}
    for model in models():
        table["trajectories"][model] = trajectories(model)
        table["rules"][model] = rules(model)
        table["points"][model] = points(model)
        for name, limits in declared(model).items():
            table["declared"].setdefault(name, limits)
            if limits != table["declared"][name]:
                table["declared"][f"{model} {name}"] = limits
    sections = [f"{json.dumps(section)}: " + _block(
        f" {json.dumps(name)}: " + (_block(f"  {json.dumps(run)}: {json.dumps(marks)}" for run, marks in row.items())
                                    if isinstance(row, dict) else json.dumps(row)) for name, row in rows.items())
                for section, rows in table.items()]
    FILE.write_text("{" + ",\n".join(sections) + "}\n", encoding="utf-8", newline="\n")


def _block(lines: Iterable[str]) -> str:
    return "{\n" + ",\n".join(lines) + "}"


def stored() -> Mapping[str, Any]:
    """Return the stored table."""
    table: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return table
