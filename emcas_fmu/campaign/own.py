"""What the outputs that a model and its options add come to in a sample; all from the command's instant on.

Numbers are figures, like those of :mod:`emcas_fmu.campaign.measure`. What a mean says nothing of, states, flags and
words of bits, is observed: the last one, and of a word the bits that ever were set.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from ..actuators import EXTENSIONS, NAMES, NONLINEAR, extension_outputs
from ..bench.excitation import STEP
from ..extensions import fault_list, monitors
from ..simulation import Array
from ..variables import Variable
from .experiments import Excitation, Experiment
from .measure import FIGURES, Figure

# Outputs that are words, and what their bits stand for, the least first.
WORDS: Mapping[str, tuple[str, ...]] = {
    "fault_word": tuple(fault.name for fault in fault_list.FAULTS),
    "built_in_test": tuple(monitor.name for monitor in monitors.MONITORS),
}
_EVERY = ("step", "sine", "chirp", "hold")


def _of(v: Variable) -> dict[str, Figure]:
    """Figures of an output; none of one that is a state or a number without an order."""
    if v.kind == "Real":
        return {f"{v.name}_last": Figure(v.unit, f"{v.description}, at the end", _EVERY),
                f"{v.name}_largest": Figure(v.unit, f"{v.description}, largest", _EVERY),
                f"{v.name}_smallest": Figure(v.unit, f"{v.description}, smallest", _EVERY, -1.0)}
    if v.kind == "Boolean":
        return {f"{v.name}_share": Figure("1", f"share of the time in which {v.name} is true", _EVERY, -1.0)}
    if v.name in WORDS:
        return {f"{v.name}_first": Figure("s", f"when {v.name} first has a bit set", _EVERY)}
    return {}


def _seen(v: Variable) -> dict[str, str]:
    """What is observed of an output besides, with the kind of each."""
    if v.kind == "Real":
        return {}
    kind = "String" if v.items else "Boolean" if v.kind == "Boolean" else "Integer"
    return {f"{v.name}_last": kind, **({f"{v.name}_ever": "Integer"} if v.name in WORDS else {})}


def names(experiment: Experiment, model: str) -> list[str]:
    """Figures of the model's own outputs, by column name."""
    return [f"{experiment.name}.{name}" for v in extension_outputs(model) for name in _of(v)]


def observed(experiment: Experiment, model: str) -> dict[str, str]:
    """Columns that are no figures, with the kind of each: Integer, Boolean or String."""
    return {f"{experiment.name}.{name}": kind for v in extension_outputs(model) for name, kind in _seen(v).items()}


@cache
def _figures() -> dict[str, Figure]:
    kinds = (*NAMES, *(f"{NONLINEAR}+{option}" for option in EXTENSIONS))
    return {name: figure for kind in kinds for v in extension_outputs(kind) for name, figure in _of(v).items()}


def figure_of(column: str) -> Figure:
    """What the figure of a column is, of any model."""
    name = column.rpartition(".")[2]
    return FIGURES[name] if name in FIGURES else _figures()[name]


def bits(word: str, value: int) -> tuple[str, ...]:
    """Names of the bits of a word that are set."""
    return tuple(name for i, name in enumerate(WORDS[word]) if value >> i & 1)


def told(column: str, value: object) -> str:
    """An observation for people: of a word the bits that are set, by name."""
    word = column.rpartition(".")[2].rpartition("_")[0]
    if word in WORDS and isinstance(value, int):
        return f"{value} ({', '.join(bits(word, value))})" if value else "0"
    return str(value).lower() if isinstance(value, bool) else str(value)


def reduced(experiment: Experiment, model: str, made: Excitation, response: Mapping[str, Array]) -> dict[str, Any]:
    """Figures and observations of a response by column name; `response` has an array per output."""
    acting = made.time > -STEP / 2
    found: dict[str, Any] = {}
    for v in extension_outputs(model):
        found |= _reduced(v, response[v.name][acting], made.time[acting])
    return {f"{experiment.name}.{name}": value for name, value in found.items()}


def _reduced(v: Variable, column: Array, time: Array) -> dict[str, Any]:
    last = column[-1]
    if v.kind == "Real":
        return {f"{v.name}_last": float(last), f"{v.name}_largest": float(column.max()),
                f"{v.name}_smallest": float(column.min())}
    if v.kind == "Boolean":
        return {f"{v.name}_last": bool(last), f"{v.name}_share": float(np.mean(column))}
    if v.items:
        return {f"{v.name}_last": v.items[round(last) - 1][0]}
    whole = np.rint(column).astype(np.int64)
    found: dict[str, Any] = {f"{v.name}_last": int(whole[-1])}
    if v.name in WORDS:
        found[f"{v.name}_ever"] = int(np.bitwise_or.reduce(whole))
        found[f"{v.name}_first"] = float(time[np.argmax(whole != 0)]) if whole.any() else float("nan")
    return found
