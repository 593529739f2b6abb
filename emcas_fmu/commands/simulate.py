"""`emcas simulate`: a response without an FMU."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ..actuators import NONLINEAR, extension_outputs, get
from ..errors import EmcasError
from ..parameters import load_parameters
from ..reference.cases import LEAD_IN
from .common import ModelOption, ParametersOption, check_outputs, failures, out

if TYPE_CHECKING:
    from ..bench.excitation import Excitation

EPILOG = ("Examples:\n\n  emcas simulate --step 10 --torque -50 --plot response.html"
                   "\n\n  emcas simulate --case chirp_3p5deg --plot chirp.png --output chirp.csv"
                   "\n\n  emcas simulate --input flight.csv -p my_actuator.toml --json figures.json"
                   "\n\n  emcas simulate --step 10 --model elastic+faults --set fault.jam.begin='80 ms' "
                   "--set fault.jam.end='1 s' --plot jam.png")


def _told(given: Iterable[str], inputs: Iterable[str]) -> tuple[dict[str, object], dict[str, float]]:
    """Parameters and constant inputs out of NAME=VALUE. Raises EmcasError."""
    parameters: dict[str, object] = {}
    held: dict[str, float] = {}
    for text in given:
        name, separator, written = (part.strip() for part in text.partition("="))
        if not (name and separator and written):
            raise EmcasError(f"--set {text}: expected a name and a value, as in --set controller.position.kp=70")
        value: object = {"true": True, "false": False}.get(written.lower(), written)
        if name not in inputs:
            parameters[name] = value
        elif isinstance(value, bool):
            held[name] = float(value)
        else:
            raise EmcasError(f"--set {text}: {name} is true or false")
    return parameters, held


def _stepped(degrees: float, torque: float, interval: float, stop: float) -> Excitation:
    """A step to an angle [deg] under a constant hinge moment [N.m]. Raises EmcasError."""
    from ..bench.excitation import LOAD, check_span, step_to

    check_span("step", interval, stop)
    if stop <= LEAD_IN:
        raise EmcasError(f"step: it comes at {LEAD_IN:g} s, the end at {stop:g} s is before that; see --stop")
    step = step_to(radians(degrees), stop - LEAD_IN, step=interval)
    title = f"Step to {degrees:+g} deg" + (f" with {torque:+g} N.m" if torque else "")
    return replace(step.holding({LOAD: torque}), title=title)


def simulate(
    case: Annotated[str | None, typer.Option(help="Reference case to run, such as step_plus10.")] = None,
    input_file: Annotated[Path | None, typer.Option("--input", "-i", help="CSV of time in s and inputs in SI, as fmpy "
                                                    "reads it.", metavar="FILE")] = None,
    step: Annotated[float | None, typer.Option(help="Step of the fin command, in degrees, at 50 ms.",
                                               metavar="DEG")] = None,
    torque: Annotated[float | None, typer.Option(help="Constant hinge moment with --step, in N.m.")] = None,
    parameters: ParametersOption = None,
    model: ModelOption = NONLINEAR,
    given: Annotated[list[str] | None, typer.Option(
        "--set", help="Another value of a parameter, or a constant of an input that the model has besides the common "
                      "ones (may be given several times).", metavar="NAME=VALUE")] = None,
    stop: Annotated[float | None, typer.Option(help="End in seconds; 0.5 with --step, else that of the input.")] = None,
    interval: Annotated[float | None, typer.Option(help="Communication step in seconds; 0.001, or the case's "
                                                        "own.")] = None,
    kernel: Annotated[str, typer.Option(help="compiled, python, or auto: compiled if there is a C compiler. The "
                                             "numbers are the same.")] = "auto",
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write every signal to this CSV file.",
                                                metavar="FILE")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the response: .html, .svg, .png or .pdf.",
                                              metavar="FILE")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write the figures to this file.",
                                                 metavar="FILE")] = None,
) -> None:
    """Run the actuator on a case, a file of inputs or a step, without an FMU."""
    from .. import response
    from ..bench.excitation import STEP, csv_file, reference_case
    from ..plots import check_ending
    from ..simulation import simulate as run

    with failures():
        if [case, input_file, step].count(None) != 2:
            raise EmcasError("give one of --case, --input and --step")
        check_ending(plot)
        check_outputs(output, plot, as_json, inputs=(*(parameters or ()), input_file))
        for name, value in (("--stop", stop), ("--interval", interval)):
            if value is not None and not 0.0 < value < float("inf"):
                raise EmcasError(f"{name} {value}: must be above 0")
        if case and (stop or interval):
            raise EmcasError("--stop and --interval go with --step and --input: a case has its own")
        if torque is not None and step is None:
            raise EmcasError("--torque goes with --step: a case or a file has its own loads")
        chosen = (reference_case(case) if case else csv_file(input_file, interval or STEP, stop, model) if input_file
                  else _stepped(step or 0.0, torque or 0.0, interval or STEP, stop or 0.5))
        changes, held = _told(given or [], [v.name for v in get(model).further_inputs])
        parameters_of = load_parameters(parameters, model=model)
        parameters_of = parameters_of.replace(parameters_of.having(chosen.start_values)).replace(changes)
        chosen = chosen.holding(held)
        try:
            result = run(parameters_of.values, float(chosen.time[-1]), chosen.step, kernel, parameters_of.model,
                         **{name.replace(".", "__"): column for name, column in chosen.columns.items()})
        except (ArithmeticError, TypeError, ValueError) as error:
            raise EmcasError(f"the response cannot be computed: {error}") from error
        own = extension_outputs(model)
        figures = response.figures_of_merit(result, own)
        if output:
            response.write_csv(output, chosen, result)
        if plot:
            response.write_picture(plot, chosen, result, own)
        if as_json:
            as_json.write_text(json.dumps({"title": chosen.title, **figures}, indent=1), encoding="utf-8")
    table = Table("figure", "value", title=f"{chosen.title}, {chosen.stop:g} s", title_justify="left")
    table.columns[1].justify = "right"
    for name, value in figures.items():
        table.add_row(name, f"{value:.5g}")
    out.print(table)
    for path in (output, plot, as_json):
        if path:
            out.print(f"written {escape(str(path))}", highlight=False, soft_wrap=True)
