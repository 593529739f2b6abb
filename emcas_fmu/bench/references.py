"""The references embedded in an FMU, as its manifest lists them (FMI-LS-REF)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element, ParseError, parse

from ..errors import EmcasError
from ..fmi.references import EXPERIMENTS, FOLDER, MANIFEST, ROLES
from ..reference import files
from ..reference.cases import CASES
from ..reference.stored import Stored

EMBEDDED = "embedded"  # kind of an experiment that is not one of the reference cases
_KINDS = {case.name: case.kind for case in CASES}
_INDEPENDENT = {f"experiment/{role}": independent for independent, role in ROLES.items()}


def embedded(root: Path, file: Path, names: Mapping[str, str], model: str) -> tuple[Stored, ...]:
    """Return the experiments embedded in the FMU `file`, unpacked in the folder `root`, with the columns of one fin.

    There are none without a manifest. `names` maps a single actuator's names to those in the experiments' files. Raises
    EmcasError if a file cannot be read.
    """
    folder = root / FOLDER
    single = {"time": "time", **{full: name for name, full in names.items()}}

    def path(element: Element | None) -> Path:
        source = folder / unquote(str(None if element is None else element.get("source")))
        if not source.resolve().is_relative_to(root.resolve()):
            raise ValueError(f"{source} is outside the FMU")
        return source

    if not (folder / MANIFEST).is_file():
        return ()
    try:
        return tuple(
            _stored(experiment, path, single, model, _INDEPENDENT[related.get("role", "")])
            for related in parse(folder / MANIFEST).findall("Related")
            if related.get("type") == EXPERIMENTS and related.get("role") in _INDEPENDENT
            for experiment in parse(path(related)).findall("Experiment"))
    except (ParseError, ValueError, LookupError, TypeError, OSError) as error:
        raise EmcasError(f"{file}: the references inside cannot be read ({error}); build it again, or choose a "
                         "directory of references") from error


def _stored(experiment: Element, path: Callable[[Element | None], Path], single: Mapping[str, str], model: str,
            independent: bool) -> Stored:
    def columns(tag: str, *needed: str) -> dict[str, Any]:
        file = path(experiment.find(tag))
        try:
            table = dict(_scalars(files.read_csv(file)))
        except ValueError as error:
            raise ValueError(f"{file.name}: {error}") from error
        chosen = {single[name]: column for name, column in table.items() if name in single}
        return {name: chosen[name] for name in (*needed, *chosen)}

    parameters = experiment.find("Parameters")
    entries = () if parameters is None else parse(path(parameters)).findall(".//{*}Parameter")
    name = experiment.attrib["name"]
    return Stored(
        name, experiment.get("description", name), _KINDS.get(name, EMBEDDED), float(experiment.attrib["stepSize"]),
        float(experiment.attrib["stopTime"]),
        {single[name]: value for name, value in _scalars({p.attrib["name"]: _value(p[0]) for p in entries})
         if name in single},
        columns("Stimuli", "time"), columns("References", "time", "fin_angle"), "", model, independent)


def _scalars(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield columns or values with their names; an array's elements have their index, from 0, in the name."""
    for name, value in values.items():
        if isinstance(value, list) or getattr(value, "ndim", 1) > 1:
            yield from ((f"{name}[{k}]", each) for k, each in enumerate(value if isinstance(value, list) else value.T))
        else:
            yield name, value


def _value(element: Element) -> bool | float | list[bool | float]:
    """Return a value of a parameter set; a string contains the elements of an array."""
    values = [word == "true" if word in ("true", "false") else float(word) for word in element.attrib["value"].split()]
    return values if element.tag.endswith("String") else values[0]
