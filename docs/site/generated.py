"""Pages of the site made from the source: the Python interface, declaring an actuator, the commands, the notebook."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import typer
from rich.text import Text
from typer.main import get_command

import emcas_fmu.api
from emcas_fmu.actuators.declaration import Actuator
from emcas_fmu.bench import excitation as excitations
from emcas_fmu.cli import app

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
    """Return the page of what a user's actuator is declared with."""
    fields = inspect.getsource(Actuator).partition('"""\n\n')[2].partition("    def ")[0]
    bare = {"show_root_heading": False, "show_root_toc_entry": False}
    values = {**bare, "show_if_no_docstring": True}
    return "# Declaring an actuator, name by name\n" + "".join((
        _objects("actuators.declaration", **bare, members=False),
        _objects("actuators.declaration.Actuator", heading_level=2, members=False, show_signature=False),
        f"\n```python\n{inspect.cleandoc(fields)}\n```\n",
        *(_objects(f"actuators.declaration.{name}", heading_level=2)
          for name in ("State", "Supply", "Acting", "Asked")),
        "\n## Variables\n", _objects("variables", **bare),
        "\n## Rules\n", _objects("rules", **bare, members=["Rule", "when", "in_degrees"]),
        "\n## Fin port\n", _objects("actuators.fin_port", **values),
        "\n## Operations\n", _objects("ops.base", **values),
        "\n## Faults\n", _objects("actuators.plant_fault", **bare, members=["PlantFault"]),
        "\n## Capabilities\n", _objects("actuators.capabilities", **values)))


def _objects(path: str, **options: Any) -> str:
    """Return where a module of the package, or what is in it, is documented."""
    return f"\n::: emcas_fmu.{path}\n    options: {json.dumps(options)}\n"


def commands() -> str:
    """Return the page of the commands: what each does, its arguments and options, and examples."""
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
    """Return a help text without its markup for the terminal, and sound as Markdown."""
    return re.sub(r"([*_<\[])", r"\\\1", Text.from_markup(text or "").plain)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def notebook() -> str:
    """Return the page of the notebook, with what its cells showed when it was stored."""
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
            yield f"![What the lines above draw](data:image/png;base64,{''.join(data['image/png']).strip()})"
        elif "text/html" in data:
            yield f"<div>{''.join(data['text/html'])}</div>"
        else:
            yield f"```text\n{''.join(output.get('text') or data['text/plain']).rstrip()}\n```"
