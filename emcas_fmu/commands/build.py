"""`emcas build`: build the FMU of a parameter set, in Python or in C."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ..actuators import NONLINEAR, of_fmu
from . import common

EPILOG = common.examples(
    "build", "", "--parameters my_actuator.toml --output MyActuator.fmu", "--backend native",
    "--backend native --platform linux64 --platform win64", "--backend native --cc gcc", "--fmi 3", "--fmi 3 --scalars",
    "--backend native --names flat", "--backend native --inputs minimal", "--backend native --identifier Rudder",
    "--model second-order", "--part controller", "--part plant --backend native",
    "--interface torque --backend native",
    "--fins 4 --layout cross --fin 2=my_actuator.toml --backend native")


def build(
    parameters: common.ParametersOption = None,
    backend: Annotated[str | None, common.value(
        "How the FMU computes: python (needs Python in the host; the default for FMI 2.0), or native (C, needs "
        "nothing; built with the extra 'native' or --cc).", "python|native")] = None,
    fmi: Annotated[str, common.value("Version of FMI; 3 is native only.", "2|3", "--fmi")] = "2",
    clock: Annotated[bool, typer.Option("--clock", help="FMI 3.0: with a clock that ticks when the controllers sample. "
                                        "Hosts made with fmi4c, such as Ecos 0.7, crash at any clock.")] = False,
    scalars: Annotated[bool, typer.Option("--scalars", help="FMI 3.0: no arrays, for hosts that do not know them, such "
                                          "as OMSimulator and Ecos.")] = False,
    platform: Annotated[list[str] | None, common.value(
        "Only for this platform (may be repeated): linux64, win64, darwin64 (macOS on Intel's and Apple's processors), "
        "aarch64-linux; native only.", "NAME")] = None,
    cc: Annotated[str | None, common.value("System C compiler instead of zig, for this platform; native only.",
                                           "PROGRAM", "--cc")] = None,
    model: common.ModelOption = NONLINEAR,
    fins: Annotated[int, common.value("Actuators in the FMU, on one supply; with 4 the model is called EMCAS4.",
                                      "N")] = 1,
    layout: common.LayoutOption = None,
    fin: common.FinFilesOption = None,
    names: Annotated[str, common.value(
        "Names of variables, as fin[2].fin_angle, or flat, as fin2_fin_angle: for tools that refuse dots and brackets, "
        "or make buses of them.", "structured|flat")] = "structured",
    inputs: Annotated[str, common.value(
        "Inputs of the FMU: all, or minimal, fin_command and aero_torque alone. The others are parameters then, for "
        "tools that want every input connected, or start those that are not at 0.", "all|minimal")] = "all",
    identifier: Annotated[str | None, common.value(
        "Model identifier, a C identifier: the name of library and header, and before the names of C functions where "
        "several FMUs are compiled into one program; default: the model's name.", "NAME")] = None,
    part: Annotated[str | None, common.value(
        "Only the controllers (measured angle in, reference out), or only the plant (reference in): hardware replaces "
        "the other.", "controller|plant")] = None,
    interface: Annotated[str, common.value(
        "What the host gets: the fin's angle under its load, or, for a fin that is a body of the host's, the torque on "
        "it.", "angle|torque")] = "angle",
    references: Annotated[bool, typer.Option(
        help="Include responses that any host can repeat; for new parameters they need a second or more "
             "to integrate. None of a part or with torque.")] = True,
    output: Annotated[Path | None, common.value("FMU to write; default: EMCAS.fmu, or EMCAS4.fmu with --fins 4, or the "
                                                "identifier.",
                                                "FILE", "--output", "-o")] = None,
) -> None:
    """Build the FMU of a parameter set."""
    from ..fmi.interface import FmuInterface
    from ..fmi.package import build as build_fmu
    from ..parameters import load_parameters
    from ..studies.overview import in_words, remaining_estimates

    unit = FmuInterface(fins, of_fmu(model, part, interface), own_identifier=identifier)
    target = output or Path(f"{unit.identifier}.fmu")
    placement, files = common.placed(fins, layout, fin)
    common.check_outputs(target, inputs=(parameters, files.values()))
    chosen = load_parameters(parameters, model=model)
    with common.work("build") as step:
        built = build_fmu(chosen, target, backend, platform, cc, step, fins, placement, files, fmi, references,
                          clock, names, part, scalars, inputs, identifier, interface)
    common.warn(built.warnings)
    common.say(f"built {escape(str(built.path))}  {built.size / 1024:.0f} KiB  GUID {built.guid}  "
               f"({', '.join(built.platforms)})")
    if parameters:
        common.say(f"still {escape(in_words(chosen, remaining_estimates(chosen)))}; emcas parameters, with the same "
                   "options, lists them")
