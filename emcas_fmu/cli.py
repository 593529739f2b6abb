"""The `emcas` command. Exit codes: 0 done, 1 a check failed, 2 the request cannot be carried out."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from . import __version__
from .errors import EmcasError
from .parameters import ParameterError, ParameterSet, load_parameters

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="rich",
                  help="Electromechanical control actuation system as an FMI 2.0 co-simulation FMU.")
_out = Console()
_err = Console(stderr=True)

ParametersOption = Annotated[Path | None, typer.Option(
    "--parameters", "-p", help="Parameter file (TOML); overrides any subset of the defaults.", metavar="FILE")]


@contextmanager
def _failures() -> Iterator[None]:
    """Expected failures as a message and exit code 2, never a traceback."""
    try:
        yield
    except (EmcasError, ParameterError, OSError) as error:
        _err.print(f"[bold red]error:[/] {escape(str(error))}", highlight=False, soft_wrap=True)
        raise typer.Exit(2) from error


def _progress() -> Progress:
    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
                    console=_err, transient=True)


def _version(value: bool) -> None:
    if value:
        _out.print(f"emcas {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                               help="Print the version and exit.")] = False) -> None:
    """Electromechanical control actuation system as an FMI 2.0 co-simulation FMU."""


BUILD_EPILOG = ("Examples:\n\n  emcas build\n\n  emcas build --parameters my_actuator.toml --output MyActuator.fmu"
                "\n\n  emcas build --backend native"
                "\n\n  emcas build --backend native --platform linux64 --platform win64"
                "\n\n  emcas build --backend native --cc gcc")


def build(
    parameters: ParametersOption = None,
    backend: Annotated[str, typer.Option(help="How the FMU computes: python (needs Python in the host), or "
                                              "native (C, needs nothing; built with the extra 'native' or --cc).",
                                         metavar="python|native")] = "python",
    platform: Annotated[list[str] | None, typer.Option(
        help="Only for this platform (may be given several times): linux64, win64, darwin64, aarch64-linux, "
             "aarch64-darwin; native only.")] = None,
    cc: Annotated[str | None, typer.Option("--cc", help="System C compiler instead of zig, for this platform; "
                                                        "native only.", metavar="PROGRAM")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="FMU to write.", metavar="FILE")] = Path("EMCAS.fmu"),
) -> None:
    """Build the FMU of a parameter set."""
    from .fmi.package import build as build_fmu

    with _failures(), _progress() as progress:
        built = build_fmu(load_parameters(parameters), output, backend, platform, cc, _stepper(progress, "compile"))
    _out.print(f"built {escape(str(built.path))}  {built.size / 1024:.0f} KiB  GUID {built.guid}  "
               f"({', '.join(built.platforms)})", highlight=False, soft_wrap=True)


app.command(epilog=BUILD_EPILOG)(build)


def build_command() -> None:
    """`emcas build` as a program of its own."""
    program = typer.Typer(add_completion=False, rich_markup_mode="rich")
    program.command(epilog=BUILD_EPILOG.replace("emcas build", "python build_fmu.py"))(build)
    program()


@app.command(name="parameters",
             epilog="Examples:\n\n  emcas parameters\n\n  emcas parameters -p my_actuator.toml --json")
def show_parameters(
    parameters: ParametersOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
) -> None:
    """Print the parameter set with units and sources, checked."""
    with _failures():
        chosen = load_parameters(parameters)
    if as_json:
        print(json.dumps(_parameter_records(chosen), indent=1))
        return
    notes = _out.width >= 130
    extra = [("note", "note")] if notes else []
    if _out.width >= 100:
        extra.insert(0, ("as written", "as_written"))
    table = Table("name", "value", "unit", "source", *(title for title, _ in extra),
                  title="EM-CAS parameters", title_justify="left")
    for column in table.columns[:4]:
        column.no_wrap = True
    table.columns[1].justify = "right"
    for record in _parameter_records(chosen):
        value = record["value"]
        text = f"{value:.6g}" if isinstance(value, float) else str(value).lower()
        table.add_row(record["name"], text, record["unit"], record["source"],
                      *(escape(record[key]) for _, key in extra))
    _out.print(table)
    if not notes:
        _out.print("A wider terminal, or --json, shows what each value rests on.")


def _parameter_records(chosen: ParameterSet) -> list[dict[str, Any]]:
    return [{"name": e.variable.name, "value": chosen.values[e.variable.name], "unit": e.variable.unit,
             "as_written": e.text, "source": e.source, "note": e.note, "file": str(e.file)}
            for e in chosen.entries]


@app.command(
    epilog="Examples:\n\n  emcas reference --check\n\n  emcas reference --case step_plus1 --directory ref"
           "\n\n  emcas reference --parameters my_actuator.toml --directory my_references")
def reference(
    directory: Annotated[Path | None, typer.Option(help="Folder of the reference files; models/reference "
                                                      "unless given.", metavar="DIR")] = None,
    case: Annotated[list[str] | None, typer.Option(help="Only this case (may be given several times).")] = None,
    parameters: ParametersOption = None,
    check: Annotated[bool, typer.Option("--check", help="Compare with the files there instead of writing.")] = False,
) -> None:
    """Regenerate the reference responses by independent integration, or compare with those stored."""
    from .files import models_directory
    from .reference import files

    with _failures():
        if parameters and not directory:
            raise EmcasError("--parameters needs --directory: the shipped references are of the default parameters")
        folder = directory or models_directory() / "reference"
        with _progress() as progress:
            step = _stepper(progress, "reference")
            if not check:
                files.regenerate(folder, names=case, progress=step, parameters=parameters)
            else:
                rows = files.compare(folder, names=case, progress=step, parameters=parameters)
    if not check:
        _out.print(f"written to {escape(str(folder))}", highlight=False, soft_wrap=True)
        return
    table = Table("case", "variable", "largest difference", "allowed", "")
    for name, variable, difference, tolerance in rows:
        verdict = "ok" if difference <= tolerance else "FAIL"
        table.add_row(name, variable, f"{difference:.3g}", f"{tolerance:.3g}", verdict)
    _out.print(table)
    if any(difference > tolerance for *_, difference, tolerance in rows):
        raise typer.Exit(1)


SIMULATE_EPILOG = ("Examples:\n\n  emcas simulate --step 10 --torque -50 --plot response.html"
                   "\n\n  emcas simulate --case chirp_3p5deg --plot chirp.png --output chirp.csv"
                   "\n\n  emcas simulate --input flight.csv -p my_actuator.toml --json figures.json")


@app.command(epilog=SIMULATE_EPILOG)
def simulate(
    case: Annotated[str | None, typer.Option(help="Reference case to run, such as step_plus10.")] = None,
    input_file: Annotated[Path | None, typer.Option("--input", "-i", help="CSV of time [s] and inputs in SI, as fmpy "
                                                    "reads it.", metavar="FILE")] = None,
    step: Annotated[float | None, typer.Option(help="Step of the fin command, in degrees, at 50 ms.",
                                               metavar="DEG")] = None,
    torque: Annotated[float, typer.Option(help="Constant hinge moment with --step, in N.m.")] = 0.0,
    parameters: ParametersOption = None,
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
    from . import excitation, response
    from .simulation import simulate as run

    with _failures():
        if [case, input_file, step].count(None) != 2:
            raise EmcasError("give one of --case, --input and --step")
        if plot and plot.suffix not in response.PICTURES:
            raise EmcasError(f"{plot}: a plot ends in {', '.join(response.PICTURES)}")
        for name, value in (("--stop", stop), ("--interval", interval)):
            if value is not None and not 0.0 < value < float("inf"):
                raise EmcasError(f"{name} {value}: must be above 0")
        if case and (stop or interval):
            raise EmcasError("--stop and --interval go with --step and --input: a case has its own")
        size = interval or 1e-3
        chosen = (excitation.from_case(case) if case else excitation.from_file(input_file, size, stop) if input_file
                  else excitation.from_step(step or 0.0, torque, size, stop or 0.5))
        values = load_parameters(parameters).replace(chosen.overrides).values
        try:
            result = run(values, chosen.stop, chosen.step, kernel,
                         **{name.replace(".", "__"): column for name, column in chosen.columns.items()})
        except (ArithmeticError, ValueError) as error:
            raise EmcasError(f"the response cannot be computed: {error}") from error
        figures = response.figures_of_merit(result)
        if output:
            response.write_csv(output, chosen, result)
        if plot:
            response.write_picture(plot, chosen, result)
        if as_json:
            as_json.write_text(json.dumps({"title": chosen.title, **figures}, indent=1), encoding="utf-8")
    table = Table("figure", "value", title=f"{chosen.title}, {chosen.stop:g} s", title_justify="left")
    table.columns[1].justify = "right"
    for name, value in figures.items():
        table.add_row(name, f"{value:.5g}")
    _out.print(table)
    for path in (output, plot, as_json):
        if path:
            _out.print(f"written {escape(str(path))}", highlight=False, soft_wrap=True)


VALIDATE_EPILOG = ("Examples:\n\n  emcas validate EMCAS.fmu\n\n  emcas validate EMCAS.fmu --report report.html "
                   "--junit junit.xml\n\n  emcas validate EMCAS.fmu --case step_plus20 --case load_opposing")


@app.command(epilog=VALIDATE_EPILOG)
def validate(
    fmu: Annotated[Path, typer.Argument(help="FMU to judge.", metavar="FMU")],
    case: Annotated[list[str] | None, typer.Option(help="Only this case (may be given several times).")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write all figures to this file.",
                                                    metavar="FILE")] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.", metavar="FILE")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a page with pictures to this file.",
                                                   metavar="FILE.html")] = None,
    directory: Annotated[Path | None, typer.Option(help="Folder of the reference files; models/reference "
                                                      "unless given.", metavar="DIR")] = None,
) -> None:
    """Run an FMU on every reference case and judge it by the reference and by the thesis's Table 2."""
    from .validation.results import write_json, write_junit
    from .validation.summary import summary
    from .validation.validate import validate as run

    with _failures():
        with _progress() as progress:
            result = run(fmu, case, directory, _stepper(progress, "validate"))
        for part in summary(result):
            _out.print(part, highlight=False)
        for path, write in ((as_json, write_json), (junit, write_junit)):
            if path:
                write(result, path)
        if report:
            from .validation.report import write_report

            write_report(result, report)
    if not result.passed:
        raise typer.Exit(1)


def _stepper(progress: Progress, label: str) -> Callable[[str, int, int], None]:
    """A callback(name, done, total) that moves a progress bar."""
    task = progress.add_task(label, total=None)
    return lambda name, done, total: progress.update(task, description=f"{label} {name}", completed=done, total=total)


if __name__ == "__main__":
    sys.exit(app())
