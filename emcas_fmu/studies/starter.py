"""Starter files for a new actuator: a parameter file to fill in from datasheets, and files of studies.

Names, units and datasheet terms come from the actuator's declaration. Values and their sources come from its default
set, studies from the files in the folder models.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap

from ..actuators import NONLINEAR
from ..bench.requirements import load_requirements
from ..motions import RATED
from ..parameters import Entry, ParameterSet, shipped_file
from ..support.files import models_directory
from .overview import offered
from .tuning.study import has_shipped_study

PARAMETERS, TUNING, CAMPAIGN, REQUIREMENTS = "actuator.toml", "tuning.toml", "campaign.toml", "requirements.toml"
README = "README.md"
SOURCES = {"thesis": "read in the thesis", "derived": "derived", "tuned": "by emcas tune", "estimate": "an estimate"}
_WIDTH = 116
_INSTRUCTIONS = ("Remove the # before a value that you have, and write the value in the unit of your datasheet: \"4 "
                 "mm/turn\", \"35 ozf*in/A\", \"420 g*cm^2\". Values behind a # keep their defaults. "
                 "docs/use/your_actuator.md relates datasheets to these values; `emcas parameters -p FILE --model "
                 "MODEL` checks the file and lists the remaining estimates.")
_MOMENT = re.compile(r"[\d.]+(?= N\.m)")
_VARIED = re.compile(r'^\[vary\."(.+?)"\]', re.MULTILINE)
_INPUT = re.compile(r"^\[experiments\.(\w+)\.inputs\.([\w.]+)\]", re.MULTILINE)


def starter_files(base: ParameterSet) -> dict[str, str]:
    """Return the texts of the starter files by name, for the default set `base`; with a tuning study if one fits."""
    files = {PARAMETERS: parameter_text(base), CAMPAIGN: campaign_text(base),
             REQUIREMENTS: shipped_file("requirements", base.model).read_text(encoding="utf-8")}
    if has_shipped_study(base):
        files[TUNING] = shipped_file("tuning", base.model).read_text(encoding="utf-8")
    return {**files, README: _readme(base, files)}


def parameter_text(base: ParameterSet) -> str:
    """Return a parameter file in which every value of :func:`.overview.offered` is commented out."""
    lines = [f"# Parameters of your {base.actuator.name} actuator, which override its defaults.", "#"]
    lines += _comment(_INSTRUCTIONS, "# ")
    tables: dict[str, list[str]] = {}
    for name, entries in offered(base).items():
        table, dot, key = name.partition(".")
        if not dot:
            table, key = "", name
        tables.setdefault(table, []).extend(["", *_described(entries), f"#{key} = {_value(entries)}"])
    for table, text in sorted(tables.items(), key=lambda item: item[0] != ""):  # names outside tables come first
        lines += ["", *([f"[{table}]"] if table else []), *(text if not table else text[1:])]
    return "\n".join([*lines, ""])


def _described(entries: Sequence[Entry]) -> Iterator[str]:
    """Yield comments on a value or an array: description, term in a datasheet, default value and source."""
    first, variable = entries[0], entries[0].variable
    count = f" (and so on: {len(entries)} values)" if len(entries) > 1 else ""
    yield from _comment(f"{variable.description}{count}", "# ")
    if variable.sheet:
        yield from _comment(variable.sheet, "#   read in  ")
    unit = "" if variable.unit in ("", "1") else f" (in {variable.unit} or another unit of that quantity)"
    default = ", ".join(e.text for e in entries)
    yield from _comment(f"{default}{unit}, {SOURCES.get(first.source, first.source)}. {first.note}", "#   default  ")


def _comment(text: str, begin: str) -> list[str]:
    return wrap(text, _WIDTH, initial_indent=begin, subsequent_indent="#" + " " * (len(begin) - 1),
                break_long_words=False, break_on_hyphens=False)


def _value(entries: Sequence[Entry]) -> str:
    """Return a value or an array as TOML, in the unit of the default file."""
    texts = [e.text if e.variable.unit in ("", "1") else json.dumps(e.text, ensure_ascii=False) for e in entries]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


def campaign_text(base: ParameterSet) -> str:
    """Return the shipped campaign for the user's file, without factors and experiments whose variables are missing.

    Its moments about the hinge are scaled by the rated load of the actuator's requirements.
    """
    scale = load_requirements(None, base).rated_load / RATED
    parameters, inputs = set(base.values), {v.name for v in base.actuator.inputs}
    model = "" if base.model == NONLINEAR else f"\nmodel = {json.dumps(base.model)}"
    kept, left_out = [], set()
    for paragraph in (models_directory() / CAMPAIGN).read_text(encoding="utf-8").split("\n\n"):
        varied, acting = _VARIED.search(paragraph), _INPUT.search(paragraph)
        if acting and acting[2] not in inputs:
            left_out.add(acting[1])
        elif paragraph.startswith("# [base]"):
            kept.append(f'[base]{model}\nparameters = "{PARAMETERS}"')
        elif not varied or varied[1] in parameters:
            kept.append(_MOMENT.sub(lambda moment: f"{scale * float(moment[0]):g}", paragraph.replace("models/", "")))
    return "\n\n".join(p for p in kept if not any(p.startswith(f"[experiments.{name}]") for name in left_out)) + "\n"


def commands(base: ParameterSet, files: Mapping[str, str]) -> list[list[str]]:
    """Return the commands to run next, as pairs of command line and purpose."""
    model = [] if base.model == NONLINEAR else ["--model", base.model]
    tuned = "tuned.toml" if TUNING in files else PARAMETERS
    lines = [(["parameters", "-p", PARAMETERS, *model], "checks the values, lists the remaining estimates"),
             (["simulate", "-p", PARAMETERS, *model, "--step", "5", "--plot", "step.html"], "plots a step response")]
    if TUNING in files:
        lines.append((["tune", TUNING, "-p", PARAMETERS, *model, "-o", tuned, "--report", "tuning.html"],
                      "tunes the gains in a minute or two; fewer --generations are faster"))
    lines += [(["build", "-p", tuned, *model, "-o", "MyActuator.fmu"], "makes an FMU; in C with --backend native"),
              (["report", tuned, *model, "--requirements", REQUIREMENTS, "-o", "report.html"], "tests for acceptance"),
              (["campaign", CAMPAIGN, "--output", "results"], "simulates production scatter")]
    return [[shlex.join(["emcas", *arguments]), purpose] for arguments, purpose in lines]


def _readme(base: ParameterSet, files: Mapping[str, str]) -> str:
    listed = commands(base, files)
    width = max(len(command) for command, _ in listed)
    about = {PARAMETERS: "your values",
             TUNING: "the gains to tune, and requirements for them: `emcas tune`",
             CAMPAIGN: "production scatter: `emcas campaign`",
             REQUIREMENTS: "the actuator's requirements: `emcas validate`, `emcas report`, `emcas compare`"}
    return "\n".join([
        f"# An actuator of the model {base.actuator.name}", "",
        *(f"- `{name}`: {content}" for name, content in about.items() if name in files), "",
        "The limits in the studies are those of a shipped actuator: replace them with yours. Run in this folder:", "",
        "```sh",
        *(f"{command:<{width}}  # {purpose}" for command, purpose in listed), "```", "",
        "docs/use/your_actuator.md in the project's repository relates the terms of datasheets to these values.", ""])
