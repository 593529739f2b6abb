"""The program accepts the commands in pages and READMEs, and their files exist."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from emcas_fmu.actuators import NONLINEAR, get
from emcas_fmu.bench.fmu import chosen_model
from emcas_fmu.cli import app
from emcas_fmu.fmi.interface import model_name
from emcas_fmu.studies import starter

from .recipes import ROOT, commands

OWN = "examples/own_actuator/README.md"
DOCUMENTS = [path.relative_to(ROOT).as_posix() for path in sorted((
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"),
    *(ROOT / "examples").rglob("*.md")))]
WRITTEN = ("output", "plot", "report", "as_json", "junit", "markdown", "journal")
# The reader's files, the file of the workflow, the files that the page of emcas explore saves, and placeholders.
YOURS = re.compile(r"[Mm]y_?\w*(\.\w+)?|actuator\.toml|inputs\.csv|parameters\.toml|FILE\.\w+|[A-Z]+")
# FMUs that the README builds and other pages use.
BUILT = {Path("EMCAS.fmu"): NONLINEAR, Path("EMCAS3.fmu"): NONLINEAR, Path("EMCAS4.fmu"): NONLINEAR}


def parsed(arguments: list[str]) -> tuple[str, dict[str, Any]]:
    """Return the command's name and its options as the program parses them; no options if the line only names one."""
    command: Any = get_command(app)
    while arguments and arguments[0] in getattr(command, "commands", {}):
        command = command.commands[arguments.pop(0)]
    if len(arguments) == 1 and arguments[0] in [option for each in command.params for option in each.opts]:
        return command.name, {}
    return command.name, command.make_context(command.name, arguments).params


def paths(value: Any) -> Iterator[Path]:
    """Yield the files and folders among the values of an option, also those of N=FILE."""
    for each in value if isinstance(value, (list, tuple)) else [value]:
        if isinstance(each, Path):
            yield each
        elif isinstance(each, str) and (match := re.fullmatch(r"(?:\w+=)?([^=+]+\.(?:toml|py))", each)):
            yield Path(match[1])


@pytest.mark.parametrize("document", DOCUMENTS)
def test_commands_are_accepted_and_their_files_exist(document: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    made: dict[Path, Any] = {} if document == "README.md" else dict(BUILT)  # FMUs and their actuators
    # Files whose text the page shows below their name or in a here-document.
    shown = {Path(name) for names in re.findall(r"^(?:# (\S+\.toml)$|cat > (\S+) <<)",
                                                (ROOT / document).read_text("utf-8"), re.MULTILINE) for name in names}
    for line in commands(document):
        name, options = parsed(line[1:])
        if not options:
            continue
        model: Any = options.get("model")
        written = {"directory": options["directory"]} if name == "reference" and not options["check"] else {}
        written |= {key: options[key] for key in WRITTEN if options.get(key)}
        for key, value in options.items():
            for path in paths(value) if key not in written else ():
                # The folder of a baseline is made by an earlier command and is not checked.
                known = (path in made or path in shown or path.exists() or any(map(YOURS.fullmatch, path.parts))
                         or ("*" in path.name and any(path.parent.glob(path.name))))
                assert known or key == "baseline", f"{document}: {' '.join(line)}: {path}"
                if path.suffix == ".fmu" and made.get(path) is not None:
                    chosen_model(path.name, model_name(get(made[path]).name), model and get(model).name)
        made |= dict.fromkeys((Path(value) for value in written.values()), model)
        if name == "init":  # the page then changes to the folder
            made |= dict.fromkeys(map(Path, (starter.PARAMETERS, starter.TUNING, starter.CAMPAIGN,
                                             starter.REQUIREMENTS)))
        if name == "build":
            made |= dict.fromkeys({Path(f"{model_name(get(model).name, options['fins'])}.fmu")}, model)


def test_commands_are_detected() -> None:
    assert min(len(commands(document)) for document in ("README.md", "docs/tools/ci.md", OWN)) > 5


@pytest.mark.parametrize("name", ["parameters", "simulate"])
def test_commands_for_a_users_actuator_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    chosen = [line[1:] for line in commands(OWN) if line[1] == name and "direct-drive" not in line]
    for line in chosen:
        result = CliRunner().invoke(app, [text.replace("examples/", f"{ROOT}/examples/") for text in line])
        assert result.exit_code == 0, result.output
    assert chosen
