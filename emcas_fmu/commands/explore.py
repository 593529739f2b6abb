"""`emcas explore`: write a page with a simulated actuator and sliders, for any browser."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..parameters import load_parameters
from ..support import extras
from ..support.files import as_given
from . import common
from .settings import changed, read_settings

EPILOG = common.examples(
    "explore", "", "--model elastic+heat --output elastic.html",
    "-p my_actuator.toml --set friction.temperature='-20 degC' --output cold.html",
    "--model my_actuator.py --requirements my_requirements.toml")


def explore(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    settings: Annotated[list[str] | None, common.value(
        "Initial value of a parameter, or constant value of an input, with a unit or in the variable's unit. "
        "Repeatable.", "NAME=VALUE", "--set")] = None,
    requirements: common.RequirementsOption = None,
    output: Annotated[Path, common.page_option("--output", "-o", what="Page to write.")] = Path("explore.html"),
    date: common.DateOption = "",
) -> None:
    """Write a page in which an actuator responds at once to sliders for command, load, supply, temperature and gains.

    The page contains the actuator's generated C, which zig (the extra native) compiles for the browser. The reader
    installs nothing, and the page sends no data.
    """
    from ..bench.excitation import COMMAND
    from ..bench.subject import ParameterSubject
    from ..fmi.interface import FmuInterface
    from ..studies.explore.page import render
    from ..support.dates import today
    from ..support.writing import write

    files = parameters or []
    common.check_outputs(output, inputs=(files, requirements))
    extras.require("native", "emcas explore needs", "ziglang")
    changes, _, constants = read_settings(settings or [], FmuInterface(1, model))
    if COMMAND in constants:
        raise EmcasError(f"--set {COMMAND}: a slider of the page sets it; leave it out")
    chosen = changed(load_parameters(files, model=model), changes[0])
    common.warn(chosen.warnings)
    command = shlex.join([
        "emcas", "explore", *common.option("--model", model, NONLINEAR), *common.parameter_arguments(files),
        *(part for each in settings or () for part in ("--set", each)),
        *common.option("--requirements", requirements and as_given(requirements)),
        *common.option("--output", output), *common.option("--date", date, "")])
    with common.err.status("compiling the actuator for the browser; the first time this takes a minute"):
        page = render(ParameterSubject(chosen, files), constants, command, date or today(), requirements)
    size = write(output, page)
    common.print_written(output)
    common.out.print(f"{size / 1000:.0f} kB; open the page in a browser")
