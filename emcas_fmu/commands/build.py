"""`emcas build`: build an FMU from a parameter set, in Python or in C."""

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
        "Code of the FMU: python (the host needs Python; default for FMI 2.0) or native (C; the host needs nothing, "
        "building needs the extra 'native' or --cc).", "python|native")] = None,
    fmi: Annotated[str, common.value("Version of FMI; 3 is always native.", "2|3", "--fmi")] = "2",
    clock: Annotated[bool, typer.Option("--clock", help="FMI 3.0: add a clock that ticks when the controllers sample. "
                                        "Hosts that use fmi4c, such as Ecos 0.7, crash at any clock.")] = False,
    scalars: Annotated[bool, typer.Option("--scalars", help="FMI 3.0: no arrays, for hosts that do not support them, "
                                          "such as OMSimulator and Ecos.")] = False,
    platform: Annotated[list[str] | None, common.value(
        "Build only for the named platform: linux64, win64, darwin64 (macOS on Intel and Apple processors), "
        "aarch64-linux; native only. Repeatable.", "NAME")] = None,
    cc: Annotated[str | None, common.value("System C compiler instead of zig, for the machine on which it runs; "
                                           "native only.", "PROGRAM", "--cc")] = None,
    model: common.ModelOption = NONLINEAR,
    fins: Annotated[int, common.value("Number of actuators in the FMU, all on one supply. With 4 the model is called "
                                      "EMCAS4.", "N")] = 1,
    layout: common.LayoutOption = None,
    fin: common.FinFilesOption = None,
    names: Annotated[str, common.value(
        "Form of the variables' names: structured (fin[2].fin_angle) or flat (fin2_fin_angle). Flat is for tools that "
        "refuse dots and brackets, or turn such names into buses.", "structured|flat")] = "structured",
    inputs: Annotated[str, common.value(
        "Inputs of the FMU: all, or minimal (fin_command and aero_torque; the others become parameters). Minimal is "
        "for tools that require every input to be connected, or set unconnected inputs to 0.", "all|minimal")] = "all",
    identifier: Annotated[str | None, common.value(
        "Model identifier, a C identifier: the name of library and header, and the prefix of the C functions if "
        "several FMUs are compiled into one program. Default: the model's name.", "NAME")] = None,
    part: Annotated[str | None, common.value(
        "Build half of the actuator, for hardware as the other half: controller (input: measured angle, output: "
        "reference) or plant (input: reference).", "controller|plant")] = None,
    interface: Annotated[str, common.value(
        "Output of the FMU: angle (of the fin under the host's load) or torque (on a fin that is a body in the host's "
        "model).", "angle|torque")] = "angle",
    references: Annotated[bool, typer.Option(
        help="Embed reference responses, which any host can repeat. With changed parameters their integration takes a "
             "second or more. FMUs of --part and --interface torque have none.")] = True,
    output: Annotated[Path | None, common.value("FMU to write. Default: the model's identifier, such as EMCAS.fmu, "
                                                "or EMCAS4.fmu with --fins 4.", "FILE", "--output", "-o")] = None,
) -> None:
    """Build an FMU from a parameter set."""
    from ..fmi.interface import FmuInterface
    from ..fmi.package import build as build_fmu
    from ..parameters import load_parameters
    from ..studies.overview import in_words, remaining_estimates

    default = FmuInterface(fins, of_fmu(model, part, interface), own_identifier=identifier).identifier
    target = output or Path(f"{default}.fmu")
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
        common.say(f"still {escape(in_words(chosen, remaining_estimates(chosen)))}; emcas parameters, with the "
                   "same --parameters and --model, lists them")
