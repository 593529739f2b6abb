"""The provenance of a result: command, parameters and date."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import PurePath

from ..actuators import get, is_shipped
from ..parameters import ParameterSet
from ..reference.files import parameters_hash
from ..support.dates import today

SHIPPED = "the shipped parameters"
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
    """A source of a page: a `file`, its hash, the hash of all values, and the names of values `changed` afterwards."""

    what: str
    file: str
    sha256: str = ""
    values_sha256: str = ""
    model: str = ""
    changed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Made:
    """How a page was made; `command` is empty if a Python program made it."""

    sources: tuple[Source, ...]
    command: str
    date: str


def made(*of: ParameterSet | Source) -> Made:
    """Return the provenance of a page that is made now from these sources."""
    sources = [source for each in of for source in ((each,) if isinstance(each, Source) else _of_a_set(each))]
    return Made(tuple(dict.fromkeys(sources)), _COMMAND.get(), today())


def repeatable(*fins: ParameterSet) -> Made:
    """Return provenance that is the same at every build, without date, command and folders.

    `fins` are the parameters of each fin. With several fins, each source has the number of its fin, from 1.
    """
    sources = [replace(source, file=PurePath(source.file).name, what=source.what + f" of fin {n}" * (len(fins) > 1),
                       model=source.model if n == len(fins) else "")
               for n, fin in enumerate(fins, 1) for source in made(fin).sources]
    return Made(tuple(sources), "", "")


def shipped(model: str) -> str:
    """Return the name of an actuator's default parameters in words."""
    actuator = get(model)
    name = actuator.source.name if actuator.source else actuator.name
    return SHIPPED if is_shipped(model) else f"the parameters of {name}"


def _of_a_set(p: ParameterSet) -> Iterator[Source]:
    files = p.files or ((shipped(p.model), ""),)
    for file, sha256 in files[:-1]:
        yield Source("parameters", file, sha256)
    changed = tuple(e.variable.name for e in p.entries if e.source == "user" and not e.file)
    yield Source("parameters", *files[-1], parameters_hash(p.values), p.actuator.name, changed)
