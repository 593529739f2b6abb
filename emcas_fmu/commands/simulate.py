"""`emcas simulate`: simulate a step, a reference case or a file of inputs, without an FMU."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.markup import escape

from ..actuators import NONLINEAR
from ..errors import EmcasError
from ..fmi.interface import FmuInterface, fin_sets, require_shared
from ..motions import LEAD_IN
from ..parameters import load_parameters
from ..parameters.schema import In
from . import common
from .settings import changed, entered, read_settings

if TYPE_CHECKING:
    from ..bench.excitation import Excitation

EPILOG = common.examples(
    "simulate", "--step 10 --torque -50 --plot response.html",
    "--case chirp_3p5deg --plot chirp.png --output chirp.csv",
    "--step 15 --set angular_rate.x='60 rad/s' --set mounting.station=-1.5",
    "--input flight.csv -p my_actuator.toml --json figures.json",
    "--step 10 --model elastic+faults --set fault.jam.begin='80 ms' --set fault.jam.end='1 s' --plot jam.png",
    "--fins 4 --fin 2=my_actuator.toml --step 10 --set bus.source_resistance=0.02 --plot fins.html")
# Limits of command and load: half a turn, and a thousand times the rated hinge moment of Table 2, in either direction.
_STEP, _TORQUE = In("deg", -180.0, 180.0), In("N.m", -1e5, 1e5)


def _stepped(step: str, load: str, interval: float, stop: float) -> Excitation:
    """Return a step to an angle under a constant hinge moment, read from the options' texts. Raises EmcasError."""
    from ..bench.excitation import LOAD, check_span, step_to

    degrees, torque = entered(f"--step {step}", step, _STEP), entered(f"--torque {load}", load, _TORQUE)
    check_span("step", interval, stop)
    if stop <= LEAD_IN:
        raise EmcasError(f"--stop {stop:g}: the step is at {LEAD_IN:g} s; give a later end")
    stepped = step_to(radians(degrees), stop - LEAD_IN, step=interval)
    title = f"Step to {degrees:+g} deg" + (f" with {torque:+g} N.m" if torque else "")
    return replace(stepped.holding({LOAD: torque}), title=title)


def simulate(
    case: Annotated[str | None, common.value("Reference case to run, such as step_plus10.", "NAME")] = None,
    input_file: Annotated[Path | None, common.value("CSV of time in s and inputs in SI, in the format of fmpy.", "FILE",
                                                    "--input", "-i")] = None,
    step: Annotated[str | None, common.value("Step of the fin command at 50 ms, in degrees or with a unit.",
                                             "ANGLE")] = None,
    torque: Annotated[str | None, common.value("Constant hinge moment with --step, in N.m or with a unit.",
                                               "MOMENT")] = None,
    parameters: common.ParametersOption = None,
    model: common.ModelOption = NONLINEAR,
    settings: Annotated[list[str] | None, common.value(
        "Value of a parameter, or constant value of an input, with a unit or in the variable's unit. Repeatable. NAME "
        "applies to all fins, fin[2].NAME to one. With several fins, bus.source_resistance (or line.accumulator_volume "
        "of a hydraulic supply) makes the supply sag. roll_command, pitch_command and yaw_command are mixed into all "
        "commands.",
        "NAME=VALUE", "--set")] = None,
    fins: Annotated[int, common.value("Number of actuators on one supply, all with the same case, step or inputs; a "
                                      "column fin[2].fin_command of --input is for one fin. Several fins are computed "
                                      "in Python, more slowly.", "N")] = 1,
    layout: common.LayoutOption = None,
    fin: common.FinFilesOption = None,
    stop: Annotated[float | None, common.value("End of the simulation. Default: 0.5 with --step, the last time with "
                                               "--input.", "SECONDS")] = None,
    interval: Annotated[float | None, common.value("Communication step. Default: 0.001, or that of the case.",
                                                   "SECONDS")] = None,
    kernel: Annotated[str, common.value("compiled, python, or auto (compiled if that saves time). All give "
                                        "the same numbers.", "KERNEL")] = "auto",
    output: Annotated[Path | None, common.output_option("Write every signal to this CSV file.", ".csv")] = None,
    plot: Annotated[Path | None, common.plot_option("Plot the actuator's outputs, grouped by unit,")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Simulate a step, a reference case or a file of inputs, without an FMU."""
    from .. import api
    from ..bench.conditions import resting_on
    from ..bench.excitation import csv_file, reference_case
    from ..motions import STEP
    from ..pages.numbers import number
    from ..reference.files import supply_start

    if [case, input_file, step].count(None) != 2:
        raise EmcasError("give one of --case, --input and --step")
    (placement, files), interface = common.placed(fins, layout, fin), FmuInterface(fins, model)
    common.check_outputs(output, plot, as_json, inputs=(parameters, files.values(), input_file))
    for name, value in (("--stop", stop), ("--interval", interval)):
        if value is not None and not 0.0 < value < float("inf"):
            raise EmcasError(f"{name} {value}: must be finite and above 0")
    if case and (stop or interval):
        raise EmcasError("--stop and --interval are for --step and --input: a case has its own; leave them out")
    if torque is not None and step is None:
        raise EmcasError("--torque belongs to --step: a case or a file has its own loads; leave --torque out")
    excitation = (reference_case(case) if case else
              csv_file(input_file, interval or STEP, stop, model, fins) if input_file
              else _stepped(step or "0", torque or "0", interval or STEP, stop or 0.5))
    changes, line, constants = read_settings(settings or [], interface)
    if twice := [name for name in constants if name in excitation.columns]:
        raise EmcasError(f"--set {twice[0]}: {excitation.title} sets this input already; leave --set out")
    base = load_parameters(parameters, model=model)
    base = base.with_values(base.having(excitation.start_values))
    sets = fin_sets(base, fins, placement, files) if fins > 1 else (base,)
    sets = tuple(changed(each, {**changes[0], **changes[k]}) for k, each in enumerate(sets, 1))
    require_shared(sets, "--set")
    common.warn(warning for each in sets for warning in each.warnings)
    if case:
        excitation = reference_case(case, supply=supply_start(model, sets[0].values))
    response = api.simulate(sets, replace(excitation, start_values={}), kernel=kernel, line=line, **constants)
    common.write_results(response, (output, type(response).write_csv), (plot, type(response).plot))
    common.write_json(response.as_dict(), as_json)
    columns = [f">fin {k}" for k in range(1, fins + 1)] if fins > 1 else [">value"]
    common.out.print(common.table(["figure", *columns], response.lines(), f"{excitation.title}, {excitation.stop:g} s"))
    if interface.line:
        common.say(f"{interface.line.group}: " + ", ".join(
            f"{name} {number(value)}" for name, value in response.line.items()))
    for each in resting_on(response.estimates):
        common.say(escape(each))
    common.print_written(output, plot, as_json)
