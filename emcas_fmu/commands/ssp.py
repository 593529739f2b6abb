"""`emcas ssp`: write several fins as an SSP 1.0 archive, or check one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.text import Text

from . import common

EPILOG = common.examples(
    "ssp", "--output EMCAS.ssp", "--fmu EMCAS.fmu --layout plus", "--model elastic+faults --variant jammed=jammed.toml",
    "-p my_actuator.toml --fin 2=second.toml --variant hot=hot.toml", "--system-connectors --output wired.ssp",
    "--halves --fins 1 --output halves.ssp",
    "check EMCAS.ssp", "check vehicle.ssp --fmu EMCAS.fmu --json findings.json")

app = typer.Typer(add_completion=False, rich_markup_mode="rich", invoke_without_command=True, epilog=EPILOG,
                  help="Write several fins as an SSP 1.0 archive with variants nominal, cold, degraded, or check one.")


@app.callback()
@common.failures()
def write(
    context: typer.Context,
    fmu: Annotated[Path | None, common.value("FMU for the archive. Default: a native FMU is built.", "FMU")] = None,
    output: Annotated[Path, common.value("Archive to write.", "FILE.ssp", "--output", "-o")] = Path("EMCAS.ssp"),
    model: common.SubjectModelOption = None,
    parameters: common.ParametersOption = None,
    fins: Annotated[int, common.value("Number of fins, 1 to 8, evenly spaced about the body.", "N")] = 4,
    layout: common.LayoutOption = None,
    fin: common.FinFilesOption = None,
    variant: Annotated[list[str] | None, common.value(
        "Additional variant, or a replacement for cold or degraded, from a file such as models/degraded.toml. "
        "Repeatable.", "NAME=FILE")] = None,
    border: Annotated[bool, typer.Option("--system-connectors", help="Wire the fins to connectors of the system, such "
                                         "as fin1_fin_command. fmpy's simulate_ssp needs them; libcosim and Ecos "
                                         "refuse them.")] = False,
    halves: Annotated[bool, typer.Option("--halves", help="Write each fin as two components, controllers and plant, "
                                         "so that hardware can replace one. Both FMUs are built (no --fmu) and wired "
                                         "to connectors of the system.")] = False,
) -> None:
    """Write an SSP 1.0 archive with the variants nominal, cold and degraded.

    The shipped variants cold and degraded are left out if they change a parameter that the actuator lacks.
    """
    if context.invoked_subcommand:
        return
    from ..fmi.interface import fin_files
    from ..ssp.archive import DEFAULT, NOMINAL
    from ..ssp.variants import variant_files
    from ..ssp.write import write_ssp

    of_fins, of_variants = fin_files(fin or []), variant_files(variant or [])
    common.check_outputs(output, inputs=(fmu, parameters, of_fins.values(), of_variants.values()))
    with common.work("compile") as step:
        written = write_ssp(output, fmu, parameters, fins=fins, layout=layout or "cross", fin_files=of_fins,
                            variant_files=of_variants, border=border, model=model, progress=step, halves=halves)
    common.say(f"written {escape(str(output))}  {output.stat().st_size / 1024:.0f} KiB  {fins} fin{'s'[:fins != 1]}, "
               f"FMU {written.guid}")
    common.warn((*(f"left out: {what}" for what in written.left_out), *written.warnings))
    files = ", ".join(f"{name} ({DEFAULT if name == NOMINAL else f'{name}.ssd'})" for name in written.report.variants)
    common.say(f"variants {files}; schema and wiring checked")
    for finding in written.report.warnings:
        common.say(f"[yellow]warning:[/] {escape(str(finding))}")


@app.command(epilog=common.examples(
    "ssp check", "EMCAS.ssp", "vehicle.ssp --fmu EMCAS.fmu", "vehicle.ssp --json findings.json"))
@common.failures()
def check(
    ssp: Annotated[Path, typer.Argument(help="Archive to check, written by emcas ssp or with the same structure.",
                                        metavar="FILE.ssp")],
    fmu: Annotated[Path | None, common.value("FMU that the archive must contain.", "FMU")] = None,
    guid: Annotated[str | None, common.value("GUID of the FMU, instead of --fmu.", "GUID")] = None,
    model: Annotated[str | None, common.model_option("Actuator of the FMU, if its name does not contain it")] = None,
    as_json: Annotated[Path | None, common.json_option("Write all findings to this file.")] = None,
) -> None:
    """Check schema, wiring, units, parameters and FMU of an SSP; exit code 1 if there are errors."""
    from ..errors import EmcasError
    from ..ssp.check import check as run

    if fmu and guid:
        raise EmcasError("--fmu and --guid exclude each other; leave one out")
    common.check_outputs(as_json, inputs=(ssp, fmu))
    report = run(ssp, guid, fmu, model)
    common.write_json(report.document(), as_json)
    if report.findings:
        rows: list[list[Text] | None] = []
        for each in sorted(report.findings, key=lambda f: f.level):
            texts = ([each.place, each.file], [each.message, each.remedy])
            rows += [Text(each.level, "red" if each.level == "error" else "yellow"),
                     *(Text(upper + "\n" * bool(upper)).append(lower, "dim") for upper, lower in texts)], None
        common.out.print(common.table(["", "where", "problem and remedy"], rows))
    errors, warnings = (f"{len(findings)} {name}{'s' * (len(findings) != 1)}" for findings, name in (
        (report.errors, "error"), (report.warnings, "warning")))
    verdict = f"[bold red]failed[/], {errors}" if report.errors else "[bold green]passed[/]"
    common.say(f"{verdict}, {warnings}: {escape(str(ssp))}, variants "
              f"{', '.join(map(escape, report.variants)) or 'none'}, {report.connections} connections, "
              f"{report.parameters} parameters")
    if report.unchecked:
        common.say(f"[yellow]not checked[/] until these errors are corrected: wiring and parameters of "
                   f"{', '.join(map(escape, report.unchecked))}")
    if report.errors:
        raise typer.Exit(1)
