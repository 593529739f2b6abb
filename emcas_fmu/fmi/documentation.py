"""Documents inside the FMU: the page, the icon, licences, reference files."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from .. import __version__, control, integrate, schedule, sensors
from ..files import models_directory
from ..parameters import ParameterSet, are_defaults
from ..physics import drive, friction, kinematics, loads, mechanics
from ..reference import files
from ..variables import INPUTS, OUTPUTS, PARAMETERS, Variable
from .figures import icon, response_figures
from .model_description import DESCRIPTION, MODEL

_EQUATIONS = (kinematics, mechanics, friction, loads, drive, sensors, control, schedule, integrate)
_EXTERNAL = """This FMU computes in Python. Its binaries (linux64, win64) load into a process that has Python 3.10 or
later loaded; they bring no Python of their own. From a Python host (fmpy) nothing is to do. From another host
on Linux, preload the Python library, for example

    LD_PRELOAD=libpython3.11.so host ...

on Windows put the folder of python3.dll on PATH. No Python package is needed: neither NumPy nor any other.
"""


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}"


def _rows(variables: tuple[Variable, ...], parameters: ParameterSet) -> list[dict[str, Any]]:
    entries = {e.variable.name: e for e in parameters.entries}
    rows = []
    for v in variables:
        row: dict[str, Any] = {"v": v, "source": "", "note": ""}
        if v.name in entries:
            entry = entries[v.name]
            limits = "" if v.kind == "Boolean" else f"{v.minimum:.4g} … {v.maximum:.4g}"
            row |= {"source": entry.source, "note": entry.note, "range": limits,
                    "value": _text(parameters.values[v.name])}
        rows.append(row)
    return rows


def _page(parameters: ParameterSet, guid: str) -> str:
    environment = Environment(loader=PackageLoader("emcas_fmu", "fmi"), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True)
    return environment.get_template("documentation.html.j2").render(
        model=MODEL, description=DESCRIPTION, version=__version__, guid=guid,
        step_ms=_text(parameters.values["controller.sample_time"] * 1e3),
        figures=response_figures(parameters), equations=[inspect.getdoc(module) for module in _EQUATIONS],
        tables=[("Inputs", _rows(INPUTS, parameters)), ("Outputs", _rows(OUTPUTS, parameters)),
                ("Parameters", _rows(PARAMETERS, parameters))])


def _licenses(*packages: tuple[str, str]) -> dict[str, bytes]:
    """Licences as their packages ship them: of (package, name of the file in the FMU)."""
    found = {}
    for name, target in packages:
        try:
            shipped = distribution(name).files or []
        except PackageNotFoundError:
            continue
        for file in shipped:
            path = Path(file.locate())
            if file.name.startswith("LICENSE") and path.is_file():
                found[target] = path.read_bytes()
                break
    return {f"documentation/licenses/{target}": content for target, content in found.items()}


def _references(parameters: ParameterSet) -> Mapping[str, bytes]:
    """The reference response of the case a newcomer plots; it holds for the shipped parameters only."""
    if not are_defaults(parameters):
        return {}
    folder = models_directory() / "reference"
    paths = [*(files.path_of(folder, "step", suffix) for suffix in ("in.csv", "ref.csv", "ref.opt")),
             folder / files.PROVENANCE]
    return {f"extra/reference/{path.name}": path.read_bytes() for path in paths if path.is_file()}


def documents(parameters: ParameterSet, guid: str, backend: str) -> dict[str, bytes]:
    """Archive name to content of everything that is documentation."""
    picture = icon()
    licenses = [("emcas-fmu", "LICENSE.txt")]
    python = {}
    if backend == "python":
        licenses.append(("pythonfmu", "pythonfmu-LICENSE.txt"))
        python["documentation/externalDependencies.txt"] = _EXTERNAL.encode()
    return {
        "documentation/index.html": _page(parameters, guid).encode(),
        **python,
        "model.png": picture,
        "terminalsAndIcons/icon.png": picture,
        **_licenses(*licenses),
        **_references(parameters),
    }
