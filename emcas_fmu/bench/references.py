"""The references inside an FMU, as its manifest names them (FMI-LS-REF)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element, ParseError, parse

from ..errors import EmcasError
from ..fmi.references import EXPERIMENTS, FOLDER, MANIFEST, ROLES
from ..reference import files
from ..reference.cases import CASES
from ..reference.stored import Stored

CARRIED = "carried"  # kind of an experiment that is none of the usual cases
_KINDS = {case.name: case.kind for case in CASES}
_INDEPENDENT = {f"experiment/{role}": independent for independent, role in ROLES.items()}


def carried(unit: Path, file: Path, names: Mapping[str, str], model: str) -> tuple[Stored, ...]:
    """Return the experiments in the folder `unit`, to which the FMU `file` is unpacked, as those of one fin.

    `names` are the FMU's variables by the names of a single actuator. Raises EmcasError where they cannot be read.
    """
    folder = unit / FOLDER
    single = {"time": "time", **{full: name for name, full in names.items()}}

    def path(element: Element | None) -> Path:
        source = folder / unquote(str(None if element is None else element.get("source")))
        if not source.resolve().is_relative_to(unit.resolve()):
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
        raise EmcasError(f"{file}: the references inside cannot be read ({error}); build it again, or name a folder of "
                         "references with --directory") from error


def _stored(experiment: Element, path: Callable[[Element | None], Path], single: Mapping[str, str], model: str,
            independent: bool) -> Stored:
    def columns(tag: str, *needed: str) -> dict[str, Any]:
        table = files.read_csv(path(experiment.find(tag)))
        chosen = {single[name]: column for name, column in table.items() if name in single}
        return {name: chosen[name] for name in (*needed, *chosen)}

    parameters = experiment.find("Parameters")
    given = () if parameters is None else parse(path(parameters)).findall(".//{*}Parameter")
    name = experiment.attrib["name"]
    return Stored(
        name, experiment.get("description", name), _KINDS.get(name, CARRIED), float(experiment.attrib["stepSize"]),
        float(experiment.attrib["stopTime"]),
        {single[p.attrib["name"]]: _value(p[0]) for p in given if p.attrib["name"] in single},
        columns("Stimuli", "time"), columns("References", "time", "fin_angle"), "", model, independent)


def _value(element: Element) -> bool | float:
    text = element.attrib["value"]
    return text == "true" if element.tag.endswith("Boolean") else float(text)
