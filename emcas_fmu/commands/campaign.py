"""`emcas campaign`: run samples with varied parameters, commands, loads and faults, and summarise them."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from ..errors import EmcasError
from ..support import extras
from . import common

EPILOG = common.examples(
    "campaign", "models/campaign.toml --output results", "models/campaign_faults.toml --model elastic+faults",
    "mine.toml --model my_actuator.py", "mine.toml --requirements my_requirements.toml",
    "mine.toml --fmu EMCAS.fmu --workers 8", "mine.toml --fmu EMCAS4.fmu --fin 2",
    "mine.toml --scheduler tcp://head:8786", "mine.toml --only 17 --plot history.html --output history.csv", last=[
        "The same command continues a campaign that was stopped. Exit codes: 0 done (failed samples are results too), "
        "1 every sample failed or some are missing, 2 the request cannot be executed, 130 stopped by Ctrl-C."])


def campaign(
    file: Annotated[Path, typer.Argument(help="Campaign: factors, experiments, number of samples (TOML); see "
                                              "models/campaign.toml.", metavar="FILE")],
    output: Annotated[Path | None, common.value("Folder for the results. Default: ./FILE_results. With --only: CSV "
                                                "file for the sample's signals.", "FOLDER", "--output", "-o")] = None,
    fmu: Annotated[Path | None, common.value("Simulate this FMU instead of the package's kernel: slower, same figures.",
                                             "FILE.fmu")] = None,
    fin: common.FinOption = None,
    model: Annotated[str | None, common.model_option(
        "Actuator, instead of the one in FILE", " With --fmu leave it out, unless your own Python file declares the "
                                                "FMU's actuator.")] = None,
    requirements: Annotated[str | None, common.value(
        "Judge every sample's parameters by the requirements in this file, or by the shipped ones, and compute the "
        "probability that each requirement is met; docs/use/requirements.md.", "FILE.toml|shipped")] = None,
    workers: Annotated[int | None, common.value("Number of worker processes. Default: one per processor. 0: run in "
                                                "this process, without Dask.", "N", min=0)] = None,
    scheduler: Annotated[str | None, common.value("Address of a Dask scheduler, whose workers replace local processes.",
                                                  "ADDRESS")] = None,
    chunk: Annotated[int | None, common.value("Samples per task, and per file of the results. Default: by the "
                                              "number and duration of samples.", "N", min=1)] = None,
    only: Annotated[int | None, common.value("Run only this sample, in this process, and print it.", "INDEX")] = None,
    plot: Annotated[Path | None, common.plot_option(
        "With --only, plot the sample's signals over time", " With several experiments each has a file, such as "
        "FILE_step.html, also for --output.")] = None,
    report: Annotated[Path | None, common.page_option(
        what="Write the summary page to this file. Default: summary.html in the folder.")] = None,
    as_json: Annotated[Path | None, common.json_option(
        "Write the summary to this file. Default: summary.json in the folder. With --only: the sample.")] = None,
) -> None:
    """Run samples with varied parameters, commands, loads and faults: percentiles, sensitivities, worst samples."""
    from ..studies.campaign.study import load_study

    if workers is not None and scheduler is not None:
        raise EmcasError("--workers starts local processes, --scheduler uses a cluster: give one of them")
    if only is None and plot is not None:
        raise EmcasError(f"--plot {plot}: the plot shows one sample; choose it with --only")
    if only is not None and report is not None:
        raise EmcasError(f"--report {report}: the page is about all samples; with --only, use --plot")
    inputs = (file, fmu, Path(requirements) if requirements else None)
    folder = output or Path(f"{file.stem}_results")
    page, figures = report or folder / "summary.html", as_json or folder / "summary.json"
    if only is not None:
        common.check_outputs(as_json, inputs=inputs)
        common.ends_in(".csv")(output)
    else:
        common.check_outputs(page, figures, folders=(folder,), inputs=inputs)
    study = load_study(file, fmu, fin, model, requirements)
    common.warn(study.warnings)
    if only is not None:
        _one(study, only, as_json, output, plot, inputs)
        return
    extras.require("campaign", "campaigns need", "filelock", "pyarrow", *(["distributed"] if workers != 0 else []))
    from ..studies.campaign.store import Store
    from ..studies.campaign.summary import as_dict, summarise

    with Store(folder, study) as store:
        stopped = _run(store, study, workers, scheduler, chunk)
        kept = study.samples - len(store.missing())
        if stopped:
            common.err.print(f"stopped: {kept} of {study.samples} samples are kept in {escape(str(folder))}; the "
                             "same command continues", soft_wrap=True)
            raise typer.Exit(common.INTERRUPTED)
        from ..studies.campaign.report import tables, write_report

        summary = summarise(study, store.table())
        command = shlex.join(["emcas", "campaign", str(file), *common.option("--fmu", fmu),
                              *common.option("--fin", fin), *common.option("--model", model, ""),
                              *common.option("--requirements", requirements, "")])
        common.write_json(as_dict(summary, command), figures)
        write_report(summary, page, command)
    for table in tables(summary):
        common.out.print(table)
    failed = f", {summary.failed} failed" if summary.failed else ""
    common.out.print(f"{summary.done} samples{failed}; GUID {study.guid}")
    for reason, count, first in summary.failures:
        common.say(f"{count} failed: {escape(reason)} (see --only {first})")
    common.print_written(folder, page, figures)
    if kept < study.samples:
        common.err.print(f"[bold red]error:[/] {study.samples - kept} of {study.samples} samples are missing in "
                         f"{escape(str(folder))}; run the same command again", soft_wrap=True)
    if kept < study.samples or summary.failed == summary.done:
        raise typer.Exit(1)


def _run(store: Any, study: Any, workers: int | None, scheduler: str | None, chunk: int | None) -> bool:
    """Run the missing samples; return True if Ctrl-C stopped the campaign."""
    from ..studies.campaign import run

    missing = store.missing()
    if not len(missing):
        return False
    with common.progress_bar() as progress:
        task = progress.add_task(f"campaign {study.path.name}", total=study.samples,
                                 completed=study.samples - len(missing))

        def keep(rows: dict[str, Any]) -> None:
            store.write(rows)
            progress.advance(task, len(rows["index"]))

        try:
            if workers == 0:
                run.in_process(study, missing, keep, chunk)
            else:
                with run.remote_client(scheduler) if scheduler else run.local_client(
                        workers or os.cpu_count() or 1, study.model) as client:
                    run.by_dask(client, study, missing, keep, chunk)
        except KeyboardInterrupt:
            return True
    return False


def _one(study: Any, index: int, as_json: Path | None, output: Path | None, plot: Path | None,
         inputs: tuple[Path | None, ...]) -> None:
    """Run one sample in this process; print it, and write the requested signals and plots."""
    from ..pages.numbers import rounded
    from ..studies.campaign.extension_outputs import in_words, observed
    from ..studies.campaign.sample import columns, history, listed, rows

    if not 0 <= index < study.samples:
        raise EmcasError(f"--only {index}: there is no such sample; the indices are 0 to {study.samples - 1}")
    files = {e: [path and (path if len(study.experiments) == 1 else path.with_stem(f"{path.stem}_{e.name}"))
                 for path in (output, plot)] for e in study.experiments}
    written = [path for pair in files.values() for path in pair]
    common.check_outputs(as_json, *written, inputs=inputs)
    (row,) = listed(rows(study, [index], study.draw([index])))
    common.write_json(row, as_json)
    for experiment, (table_file, picture) in files.items() if output or plot else ():
        response = history(study, experiment, index)
        if table_file:
            response.write_csv(table_file)
        if picture:
            response.plot(picture)
    outputs = observed(study)
    units = {**{v.name: v.unit for v in study.actuator.file_entries}, **{f.name: f.unit for f in study.factors},
             **{name: figure.unit for name, figure in columns(study).items()}}
    common.out.print(common.table(["", ">value", "unit"], (
        [name, rounded(value, ".8g") if isinstance(value, float) else
         in_words(outputs[name], value) if name in outputs else str(value),
         "" if (unit := units.get(name, "1")) == "1" else unit]
        for name, value in row.items() if value != ""), f"Sample {index} of {study.path.name}"))
    common.print_written(*written)
    if row["error"]:
        raise typer.Exit(1)
