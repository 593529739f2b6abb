"""Documents inside the FMU: the page, the credibility card, the icon, licences."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from math import degrees
from pathlib import Path
from textwrap import dedent
from types import ModuleType
from typing import Any

from markupsafe import Markup

from .. import __copyright__, __license__, __version__
from ..actuators import capabilities, get, parts
from ..pages.credibility import CARD_FILE, Card, Fact, card
from ..pages.page import page, prose
from ..parameters import ParameterSet
from ..runtime import schedule
from .description import describe, parameters_in_words
from .format import Format
from .interface import FmuInterface, start_values
from .references import EmbeddedExperiment

_EXTERNAL = """This FMU computes in Python. Its binaries (linux64, win64) contain no Python: the host's process must
have Python 3.10 or later loaded. A Python host (fmpy) has it. With another host on Linux, preload the Python library,
for example

    LD_PRELOAD=libpython3.11.so host ...

On Windows add the folder of python3.dll to PATH. No Python package is needed, not even NumPy.

The code is read from the resources folder that the host passes to fmi2Instantiate: as a path, or as file:// and a path
in which %20 is the only percent code. Without this folder the host's process ends.
"""


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}"


def _rows(interface: FmuInterface, causality: str, sets: Sequence[ParameterSet], fmi: Format) -> list[dict[str, Any]]:
    """Return the table rows of the variables with a causality; if all values of an array are equal, one is written."""
    entries = {interface.name(e.variable.name, fin): e for fin, p in enumerate(sets) for e in p.entries}
    starts, names = start_values(interface, [p.values for p in sets]), [v.name for v in interface.variables]
    rows, screw = [], capabilities.SCREW_AND_LEVER in interface.actuator.provides
    for array in fmi.variables(interface):
        v, indices = array.variable, array.indices
        if v.causality != causality:
            continue
        row: dict[str, Any] = {"v": v, "dimensions": " × ".join(map(str, array.dimensions)), "source": "", "note": ""}
        if v.causality == "parameter":
            limits = "" if v.kind == "Boolean" else f"{v.minimum:.4g} … {v.maximum:.4g}"
            values = [_text(starts[i]) for i in indices]
            row |= {"range": limits, "value": values[0] if len(set(values)) == 1 else ", ".join(values)}
            if names[indices[0]] in entries:
                entry = entries[names[indices[0]]]
                # Shipped notes on parameters of the fin port, which every actuator has, may be about a screw.
                applies = screw or entry.file != "emcas.toml" or "screw" not in entry.note
                row |= {"source": entry.source, "note": entry.note if applies else ""}
        rows.append(row)
    return rows


def _blocks(docstring: str) -> Iterator[tuple[bool, Markup]]:
    """Yield for each paragraph of a docstring whether it is indented, as equations are, and its HTML."""
    for paragraph in docstring.split("\n\n"):
        indented = paragraph.startswith(" ")
        yield indented, prose(dedent(paragraph.strip("\n")) if indented else " ".join(paragraph.split()))


@lru_cache(maxsize=32)
def _docstring(module: ModuleType) -> str | None:
    """Return the docstring of a module from its source, since Python -OO removes it from the module."""
    return ast.get_docstring(ast.parse(inspect.getsource(module)))


def _card(interface: FmuInterface, sets: Sequence[ParameterSet], guid: str, backend: str, fmi: Format,
          platforms: Sequence[str], experiments: Sequence[EmbeddedExperiment]) -> Card:
    """Return the credibility card of an FMU; it is the same in every build."""
    configuration = [Fact("FMU", f"FMI {fmi.version}, back end {backend}, for {', '.join(platforms)}", note=guid)]
    reference = Path(str(get(parts(interface.kind)[0]).reference)).name
    # Two digits, since an integration may differ in the last bits between machines.
    compared = [Fact(f"{each.name}: largest error of fin_angle in {each.stop_time:g} s",
                     float(f"{degrees(each.difference):.2g}"), "deg",
                     note=f"{each.title}. Against the independent integration of {reference}")
                for each in experiments if each.independent]
    return card(sets, f"{interface.model}.fmu", configuration, compared)


def _page(interface: FmuInterface, sets: Sequence[ParameterSet], guid: str, backend: str, fmi: Format,
          platforms: Sequence[str], credibility: Card, references: bool) -> str:
    from .pictures import response_pictures  # imports Matplotlib: a third of the start time of every command

    equations = [*interface.actuator.modules, schedule, *([interface.line.equations] if interface.line else [])]
    tables = [(title, _rows(interface, causality, sets, fmi)) for title, causality in (
        ("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter"))]
    text = page("fmi/documentation.html.j2", credibility=credibility, actuator=interface.actuator,
                model=interface.model, guid=guid, description=describe(interface), fins=interface.fins,
                parameters=parameters_in_words(interface, sets), line=interface.line, backend=backend, fmi=fmi,
                platforms=platforms, references=references, tables=tables,
                step_ms=_text(sets[0].values["controller.sample_time"] * 1e3),
                pictures=() if interface.actuator.hidden else response_pictures(sets[0]),
                equations=[list(_blocks(text)) for text in filter(None, map(_docstring, equations))])
    return interface.respelt(text)


def _license(package: str) -> str:
    """Return the text of a package's licence; its name if the package is not installed."""
    try:
        shipped = distribution(package).files or []
    except PackageNotFoundError:
        shipped = []
    paths = (Path(file.locate()) for file in shipped if file.name.startswith("LICENSE"))
    path = next(filter(Path.is_file, paths), None)
    return path.read_text(encoding="utf-8") if path else f"The licence of {package}.\n"


def documents(interface: FmuInterface, sets: Sequence[ParameterSet], guid: str, backend: str, fmi: Format,
              platforms: Sequence[str], experiments: Sequence[EmbeddedExperiment] = ()) -> dict[str, bytes]:
    """Return documentation and icons of an FMU by archive name; `experiments` are the references inside the FMU."""
    credibility = _card(interface, sets, guid, backend, fmi, platforms, experiments)
    wrapper = ("pythonfmu-license.txt is the licence of PythonFMU: of the binaries, and of pythonfmu in resources.\n"
               if backend == "python" else "")
    texts = {
        "index.html": _page(interface, sets, guid, backend, fmi, platforms, credibility, bool(experiments)),
        Path(CARD_FILE).name: interface.respelt(json.dumps(credibility.as_dict(), indent=1, ensure_ascii=False)) + "\n",
        # Required by FMI 2.0.5, section 2.3; it refers to the other licences.
        "licenses/license.txt": f"{interface.model}.fmu was made by emcas-fmu {__version__}. {__copyright__}, "
                                f"{__license__} licence, as below.\n{wrapper}\n{_license('emcas-fmu')}"}
    if backend == "python":
        texts |= {"externalDependencies.txt": _EXTERNAL, "licenses/pythonfmu-license.txt": _license("pythonfmu")}
    picture = Path(__file__).with_name("icon.png").read_bytes()
    return {**{f"documentation/{name}": text.encode() for name, text in texts.items()},
            "model.png": picture, "terminalsAndIcons/icon.png": picture}
