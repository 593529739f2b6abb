"""Pages of the site that are made from the source: Python interface, declaration, FMU, commands, notebook, sliders."""

from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType
from typing import Any

import typer
from rich.text import Text
from typer.main import get_command

import emcas_fmu.api
from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR
from emcas_fmu.actuators.declaration import Actuator
from emcas_fmu.bench import excitation as excitations
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.cli import app
from emcas_fmu.fmi.interface import FmuInterface
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.explore.page import render
from emcas_fmu.variables import Variable

ROOT = Path(__file__).resolve().parents[2]


def python() -> str:
    """Return the page of the Python interface: every name of `emcas_fmu.__all__`."""
    about = (emcas_fmu.api.__doc__ or "").partition("\n\n")[2]
    members = {"actuators": ["NAMES", "EXTENSIONS", "get"],
               "excitations": [name for name, each in vars(excitations).items() if isinstance(each, FunctionType)
                               and each.__annotations__.get("return") == "Excitation" and not name.startswith("_")]}
    return f"# Python interface, name by name\n\n{about}\n" + "".join(
        _objects(f"api.{name}", heading_level=2, **{"members": members[name], "show_if_no_docstring": True}
                 if name in members else {}) for name in sorted(emcas_fmu.api.__all__, key=str.lower))


def declaration() -> str:
    """Return the page of the classes, functions and constants with which a user declares an actuator."""
    fields = inspect.getsource(Actuator).partition('"""\n\n')[2].partition("    def ")[0]
    bare = {"show_root_heading": False, "show_root_toc_entry": False}
    values = {**bare, "show_if_no_docstring": True}
    return "# Declaring an actuator, name by name\n" + "".join((
        _objects("actuators.declaration", **bare, members=False),
        _objects("actuators.declaration.Actuator", heading_level=2, members=False, show_signature=False),
        f"\n```python\n{inspect.cleandoc(fields)}\n```\n",
        *(_objects(f"actuators.declaration.{name}", heading_level=2)
          for name in ("State", "Supply", "PlantInputs", "SampleInputs")),
        "\n## Variables\n", _objects("variables", **bare),
        "\n## Rules\n", _objects("rules", **bare, members=["Rule", "when", "in_degrees"]),
        "\n## Fin port\n", _objects("actuators.fin_port", **values),
        "\n## Operations\n", _objects("ops.base", **values),
        "\n## Faults\n", _objects("actuators.plant_fault", **bare, members=["PlantFault"]),
        "\n## Capabilities\n", _objects("actuators.capabilities", **values)))


def _objects(path: str, **options: Any) -> str:
    """Return the mark that mkdocstrings replaces by the documentation of a module of the package, or of its members."""
    return f"\n::: emcas_fmu.{path}\n    options: {json.dumps(options)}\n"


def fmu() -> str:
    """Return the page of the FMU's variables: all of the default actuator, and the additional ones of every other."""
    default, four = FmuInterface(1), FmuInterface(4)
    parts = [
        "# The FMU, variable by variable\n\nVariables of the FMUs that `emcas build` makes, in SI units (temperature "
        "in degC). The page `documentation/index.html` in an FMU lists the FMU's own variables, with limits and notes. "
        "A value whose source is `estimate` is an engineering value, neither measured nor published.\n",
        f"\n## The default actuator\n\n{_sliders(NONLINEAR)}", *_variables(default, ()),
        "\n## Four fins\n\nThe names above have the prefixes `fin[1].` to `fin[4].`, except those that all fins share: "
        f"{', '.join(f'`{name}`' for name in four.shared)}. Additional variables:\n",
        *_variables(four, [v for v in four.variables if v.name.startswith("fin[")] + list(default.inputs)),
        "\n## Other actuators\n\nFor each actuator the variables that the default actuator does not have. Its FMU "
        "lacks the default actuator's variables that do not apply to it.\n"]
    for name in NAMES:
        if name == NONLINEAR:
            continue
        other = FmuInterface(1, name)
        parts += [f"\n### {name}\n\n{other.actuator.title[0].upper()}{other.actuator.title[1:]}. {_sliders(name)}",
                  *_variables(other, default.variables)]
    parts.append("\n## Extensions\n\nThe variables that each extension adds to the default actuator.\n")
    for name in EXTENSIONS:
        parts += [f"\n### +{name}\n", *_variables(FmuInterface(1, f"{NONLINEAR}+{name}"), default.variables)]
    return "".join(parts)


def _sliders(name: str) -> str:
    """Return a link to an actuator's page with sliders, relative to emcas_fmu/fmi/interface.py."""
    return f"[Move it with sliders](../../docs/explore/{name}.html).\n"


def explored(name: str) -> str:
    """Return the page with sliders of an actuator."""
    return render(ParameterSubject(load_parameters(model=name)), {}, f"emcas explore --model {name}")


@cache
def thesis() -> bytes:
    """Return the thesis's page, which is made once while `mkdocs serve` runs: this takes a minute."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "docs.thesis", "--output", "thesis.html"], cwd=folder, check=True,
                       env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL)
        return Path(folder, "thesis.html").read_bytes()


def _variables(interface: FmuInterface, known: Sequence[Variable]) -> Iterator[str]:
    """Yield the lines of tables of an FMU's inputs, outputs and parameters, without the variables `known` by name."""
    names = {v.name for v in known}
    entries = {entry.variable.name: entry for entry in load_parameters(model=interface.kind).entries}
    for title, variables in (("input", interface.inputs), ("output", interface.outputs),
                             ("parameter", interface.parameters)):
        if shown := [v for v in variables if v.name not in names]:
            values = "value | source |" if title == "parameter" else ""
            yield f"\n| {title} | unit | meaning |{values}\n|---|---|---|{'---|---|' if values else ''}\n"
        for v in shown:
            entry = entries.get(v.name)
            value = "" if title != "parameter" else " | |"
            if entry:
                value = f" {_value(v, entry.value)} | {entry.source} |"
            yield f"| `{v.name}` | {v.unit} | {_cell(_plain(v.description))} |{value}\n"


def _value(variable: Variable, value: Any) -> str:
    return str(value).lower() if variable.kind == "Boolean" else variable.in_words(value)


def commands() -> str:
    """Return the page of the commands, each with its purpose, arguments, options and examples."""
    return "# Commands\n\n" + "".join(_command(get_command(app), "emcas", None))


def _command(command: Any, name: str, parent: Any) -> Iterator[str]:
    context = typer.Context(command, info_name=name.split()[-1], parent=parent)
    yield f"\n## {name}\n\n" if parent else ""
    yield f"{_plain(command.help)}\n\n```text\n{name} {' '.join(command.collect_usage_pieces(context))}\n```\n"
    records = [param.get_help_record(context) for param in command.get_params(context)]
    if rows := [row for row in records if row and row[0] != "--help"]:
        yield "\n| | |\n|---|---|\n"
        yield from (f"| `{option}` | {_cell(_plain(meaning))} |\n" for option, meaning in rows)
    if command.epilog:
        examples = "\n".join(line.strip() for line in command.epilog.splitlines()[1:] if line.strip())
        yield f"\n```sh\n{examples}\n```\n"
    for sub in getattr(command, "commands", {}).values():
        yield from _command(sub, f"{name} {sub.name}", context)


def _plain(text: str | None) -> str:
    """Return a help text without the terminal's markup, and with Markdown's marks escaped."""
    return re.sub(r"([*_<\[])", r"\\\1", Text.from_markup(text or "").plain)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def notebook() -> str:
    """Return the page of the notebook, with the stored outputs of its cells."""
    cells = json.loads((ROOT / "examples/notebook/first_steps.ipynb").read_text(encoding="utf-8"))["cells"]
    return "\n\n".join(part for cell in cells for part in _cell_parts(cell))


def _cell_parts(cell: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield f"```python\n{source}\n```"
    for output in cell["outputs"]:
        data = output.get("data", {})
        if "image/png" in data:
            yield f"![Picture of the lines above](data:image/png;base64,{''.join(data['image/png']).strip()})"
        elif "text/html" in data:
            yield f"<div>{''.join(data['text/html'])}</div>"
        else:
            yield f"```text\n{''.join(output.get('text') or data['text/plain']).rstrip()}\n```"
