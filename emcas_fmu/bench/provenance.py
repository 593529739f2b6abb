"""The provenance of a result: command, parameters and date."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..actuators import get
from ..actuators.fin_port import SAMPLE_TIME
from ..parameters import ParameterSet
from ..reference.files import parameters_hash
from ..support.dates import today

if TYPE_CHECKING:
    from .subject import Identification

SHIPPED = "the shipped parameters"
_TEMPERATURE = "friction.temperature"
_COMMAND: ContextVar[str] = ContextVar("command", default="")


@contextmanager
def made_by(arguments: Sequence[str]) -> Iterator[None]:
    """Name this command, with its arguments as they were typed, in all pages written within the context."""
    token = _COMMAND.set(shlex.join(arguments))
    try:
        yield
    finally:
        _COMMAND.reset(token)


@dataclass(frozen=True)
class Source:
    """A source of a page: `file` and its hash, the hash of all values, and the values `changed` beyond the files."""

    what: str
    file: str
    sha256: str = ""
    values_sha256: str = ""
    model: str = ""
    changed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Made:
    """How a page was made; `command` is empty for a Python program."""

    sources: tuple[Source, ...]
    command: str
    date: str


def made(*of: ParameterSet | Identification | Source) -> Made:
    """Return how a page with these sources is made now."""
    sources = [source for each in of for source in (
        (each,) if isinstance(each, Source) else
        _of_a_set(each) if isinstance(each, ParameterSet) else _of_an_article(each))]
    return Made(tuple(dict.fromkeys(sources)), _COMMAND.get(), today())


def conditions(model: str, values: Mapping[str, Any]) -> list[tuple[str, str, Any, str]]:
    """Return the conditions of a simulation that parameters define: words, name, value and unit."""
    actuator = get(model)
    rows: list[tuple[str, str, Any, str]] = []
    if actuator.supply:
        v = actuator.supply.input
        rows.append(("supply", v.name, v.initial(values), v.unit))
    if _TEMPERATURE in values:
        rows.append(("temperature", _TEMPERATURE, values[_TEMPERATURE], "degC"))
    return [*rows, ("sample time of the controllers", SAMPLE_TIME.name, values[SAMPLE_TIME.name], "s")]


ESTIMATE = " (estimate)"
"""Follows the name of a figure that depends on parameters that are engineering estimates."""


def resting_on(estimates: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a sentence for all figures that depend on the same estimated parameters, whose names are by figure."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for figure, names in estimates.items():
        alike.setdefault(tuple(names), []).append(figure)
    return [f"Estimate: {', '.join(figures)}, from engineering estimates of {', '.join(names)}."
            for names, figures in alike.items() if names]


def shipped(model: str) -> str:
    """Return the name of an actuator's default parameters in words."""
    source = get(model).source
    return f"the parameters of {source.name}" if source else SHIPPED


def _of_a_set(p: ParameterSet) -> Iterator[Source]:
    files = p.files or ((shipped(p.model), ""),)
    for file, sha256 in files[:-1]:
        yield Source("parameters", file, sha256)
    changed = tuple(e.variable.name for e in p.entries if e.source == "user" and not e.file)
    yield Source("parameters", *files[-1], parameters_hash(p.values), p.actuator.name, changed)


def _of_an_article(about: Identification) -> Iterator[Source]:
    what = "FMU" if about.kind == "FMU" else "parameters"
    yield Source(what, about.file, about.sha256, about.parameters_sha256,
                 about.model + (f", fin {about.fin}" if about.fin else ""))
