"""`emcas campaign`: run samples over parameters, commands, loads and faults, and summarise them."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from ..errors import EmcasError
from ..support import extras
from . import common

_SHOWN = 5, 50, 95  # percentiles on the terminal
EPILOG = ("Examples:\n\n  emcas campaign models/campaign.toml --output results"
          "\n\n  emcas campaign models/campaign_faults.toml --model elastic+faults"
          "\n\n  emcas campaign mine.toml --model my_actuator.py"
          "\n\n  emcas campaign mine.toml --requirements my_requirements.toml"
          "\n\n  emcas campaign mine.toml --fmu EMCAS.fmu --workers 8"
          "\n\n  emcas campaign mine.toml --fmu EMCAS4.fmu --fin 2"
          "\n\n  emcas campaign mine.toml --scheduler tcp://head:8786"
          "\n\n  emcas campaign mine.toml --only 17 --plot history.html --output history.csv"
          "\n\nA run that was stopped, goes on with the same command. Exit codes: 0 done (failed samples are "
          "results too), 1 every sample failed or some are missing, 2 the request cannot be carried out, 130 stopped "
          "by Ctrl-C.")


def campaign(
    file: Annotated[Path, typer.Argument(help="What varies, what is done, how often (TOML); see "
                                              "models/campaign.toml.", metavar="FILE")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the results; FILE_results beside "
                                                "you unless given. With --only, a CSV file of the sample's signals.",
                                                metavar="FOLDER")] = None,
    fmu: Annotated[Path | None, typer.Option(help="Run this FMU instead of the kernel: slower, same figures.",
                                             metavar="FILE.fmu")] = None,
    fin: Annotated[int | None, typer.Option(help="Which fin of an FMU of several; the first unless given.", min=1,
                                            metavar="N")] = None,
    model: Annotated[str | None, common.model_option(
        "Which actuator, instead of the file's", " Of an FMU it is the FMU's; name it for one of a file of yours.")
    ] = None,
    requirements: Annotated[str | None, typer.Option(
        help="Judge every sample's parameters by these requirements (TOML), or by the shipped ones, and give the "
             "probability that each is met; docs/use/requirements.md.", metavar="FILE.toml|shipped")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; as many as there are processors unless given. 0: in "
                                                     "this process, without Dask.", min=0, metavar="N")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a running Dask cluster, instead of processes "
                                                       "here.", metavar="ADDRESS")] = None,
    chunk: Annotated[int | None, typer.Option(help="Samples in a task and a part of the results; chosen unless "
                                                   "given.", min=1, metavar="N")] = None,
    only: Annotated[int | None, typer.Option(help="Run this one sample here, and print it.", metavar="INDEX")] = None,
    plot: Annotated[Path | None, typer.Option(help="With --only, draw the sample's time history: .html, .svg, .png or "
                                                   ".pdf. Of several experiments each has a file, as in "
                                                   "FILE_step.html; those of --output too.", metavar="FILE")] = None,
    report: Annotated[Path | None, common.page_option(
        what="Write the summary page here; summary.html in the folder unless given.")] = None,
    as_json: Annotated[Path | None, common.json_option(
        "Write the summary here; summary.json in the folder unless given. With --only, the sample.")] = None,
) -> None:
    """Run samples over parameters, commands, loads and faults: percentiles, sensitivities, worst samples."""
    with common.failures():
        from ..studies.campaign.study import load_study

        if workers is not None and scheduler is not None:
            raise EmcasError("--workers are processes here, --scheduler is another cluster: give one of them")
        inputs = (file, fmu, Path(requirements) if requirements else None)
        if only is not None:
            if report is not None:
                raise EmcasError(f"--report {report}: is of all samples; --plot draws the one of --only")
            common.check_outputs(as_json, inputs=inputs)
            common.ends_in(".csv")(output)
            study = load_study(file, fmu, fin, model, requirements)
            common.warn(study.warnings)
            _one(study, only, as_json, output, plot, inputs)
            return
        if plot is not None:
            raise EmcasError(f"--plot {plot}: draws one sample; name it with --only")
        folder = output or Path(f"{file.stem}_results")
        page, figures = report or folder / "summary.html", as_json or folder / "summary.json"
        common.check_outputs(page, figures, folders=(folder,), inputs=inputs)
        study = load_study(file, fmu, fin, model, requirements)
        common.warn(study.warnings)
        extras.require("campaign", "campaigns need", "filelock", "pyarrow", *(["distributed"] if workers != 0 else []))
        from ..studies.campaign.store import Store
        from ..studies.campaign.summary import as_dict, summarise

        with Store(folder, study) as store:
            stopped = _run(store, study, workers, scheduler, chunk)
            kept = study.samples - len(store.missing())
            if stopped:
                common.err.print(f"stopped: {kept} of {study.samples} samples are kept in {escape(str(folder))}; the "
                                 "same command goes on", soft_wrap=True)
                raise typer.Exit(common.INTERRUPTED)
            from ..bench.writers import write_json
            from ..studies.campaign.report import write_report

            summary = summarise(study, store.table())
            command = shlex.join(["emcas", "campaign", str(file), *common.option("--fmu", fmu),
                                  *common.option("--fin", fin), *common.option("--model", model, ""),
                                  *common.option("--requirements", requirements, "")])
            write_json(as_dict(summary, command), figures)
            write_report(summary, page, command)
    common.out.print(_table(summary))
    if summary.chances:
        common.out.print(_chances(summary))
    if summary.findings:
        common.out.print(_faults(summary))
    failed = f", {summary.failed} failed" if summary.failed else ""
    common.out.print(f"{summary.done} samples{failed}; GUID {study.guid}")
    for reason, count, first in summary.failures:
        common.say(f"{count} failed: {escape(reason)} (see --only {first})")
    common.print_written(folder, page, figures)
    if kept < study.samples:
        common.err.print(f"[bold red]error:[/] {study.samples - kept} of {study.samples} samples are missing in "
                         f"{escape(str(folder))}; run the same command again", soft_wrap=True)
        raise typer.Exit(1)
    if summary.failed == summary.done:
        raise typer.Exit(1)


def _run(store: Any, study: Any, workers: int | None, scheduler: str | None, chunk: int | None) -> bool:
    """Run the missing samples; return whether Ctrl-C stopped them."""
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
                client = run.remote_client(scheduler) if scheduler else run.local_client(
                    workers or os.cpu_count() or 1, study.plan.model)
                with client as ready:
                    run.by_dask(ready, study, missing, keep, chunk)
        except KeyboardInterrupt:
            return True
    return False


def _one(study: Any, index: int, as_json: Path | None, output: Path | None, plot: Path | None,
         inputs: tuple[Path | None, ...]) -> None:
    """Run one sample in this process; print it, and write its signals and pictures."""
    from ..bench.writers import write_json
    from ..figures.plots import check_ending
    from ..pages.numbers import rounded
    from ..studies.campaign.extension_outputs import in_words
    from ..studies.campaign.history import history
    from ..studies.campaign.sample import columns, listed, observed, rows, subject_of
    from ..studies.campaign.sampling import Sampler

    if not 0 <= index < study.samples:
        raise EmcasError(f"--only {index}: samples are numbered from 0 to {study.samples - 1}")
    plan, outputs = study.plan, observed(study.plan)
    check_ending(plot)
    files = {e: tuple(path and (path if len(plan.experiments) == 1 else path.with_stem(f"{path.stem}_{e.name}"))
                      for path in (output, plot)) for e in plan.experiments}
    common.check_outputs(as_json, *(path for each in files.values() for path in each), inputs=inputs)
    drawn = Sampler(study).draw([index])
    (row,) = listed(rows(plan.packed(), [index], drawn))
    if as_json:
        write_json(row, as_json)
    for experiment, (table_file, picture) in files.items() if output or plot else ():
        response = history(plan, experiment, drawn[0].tolist(), subject_of(plan))
        if table_file:
            response.write_csv(table_file)
        if picture:
            response.plot(picture)
    units = {**{v.name: v.unit for v in plan.actuator.file_entries}, **{f.name: f.unit for f in plan.factors},
             **{name: figure.unit for name, figure in columns(plan).items()}}
    table = Table("", "value", "unit", title=f"Sample {index} of {study.path.name}", title_justify="left")
    for name, value in row.items():
        if value != "":
            text = (rounded(value, ".8g") if isinstance(value, float) else
                    in_words(outputs[name], value) if name in outputs else str(value))
            unit = units.get(name, "1")
            table.add_row(escape(name), escape(text), "" if unit == "1" else unit)
    common.out.print(common.right_aligned(table, 1))
    common.print_written(*(path for each in files.values() for path in each))
    if row["error"]:
        raise typer.Exit(1)


def _table(summary: Any) -> Table:
    """Return the percentiles of every figure."""
    from ..bench.metrics import shown
    from ..studies.campaign.experiments import REQUIREMENT
    from ..studies.campaign.summary import text

    table = Table("figure", "unit", *(f"{p} %" for p in _SHOWN), "depends most on", title_justify="left",
                  title="Percentiles over the samples")
    table.columns[0].no_wrap = True
    for s in summary.spreads:
        if s.name.startswith(f"{REQUIREMENT}."):
            continue
        first = s.effects[0] if s.effects else None
        figures = [text(s.figure, s.percentiles[p]) for p in _SHOWN]
        table.add_row(s.name, shown(s.figure.unit)[0], *figures,
                      f"{_short(first.factor)} ({first.rank_correlation:+.2f})" if first and first.sure else "")
    return common.right_aligned(table, 2, 3, 4)


def _chances(summary: Any) -> Table:
    """Return the samples that meet each requirement, with the median and the worst percentile of its figure."""
    from ..bench.verdict import SENSES
    from ..studies.campaign.experiments import REQUIREMENT
    from ..studies.campaign.summary import text

    low, median, high = _SHOWN
    table = Table("requirement", "required", f"{median} %", f"worst {low} %", "met by", "probability (95 %)",
                  title_justify="left", title="Samples that meet the requirements", box=SIMPLE_HEAD,
                  padding=(0, 1, 0, 0), pad_edge=False)
    table.columns[0].no_wrap = True
    *each, together = summary.chances
    for chance in each:
        r, s = chance.requirement, summary.by_name.get(f"{REQUIREMENT}.{chance.requirement.name}")
        figures = [text(s.figure, s.percentiles[p]) for p in (median, high if r.sign > 0.0 else low)] if s else ["", ""]
        table.add_row(escape(r.name), f"{SENSES[r.sense]} {r.shown_limit:g} {r.shown[0]}",
                      *figures, f"{chance.met} of {chance.samples}", str(chance))
    for j in summary.study.left_out:
        table.add_row(escape(j.name), f"{j.sense} {j.limit:g} {j.unit}", "", "", "[dim]not judged[/]", "")
    table.add_section()
    every = "all of them" if not summary.study.left_out else "all that were judged"
    table.add_row(every, "", "", "", f"{together.met} of {together.samples}", str(together))
    return common.right_aligned(table)


def _faults(summary: Any) -> Table:
    """Return the injected faults with what was detected of them."""
    from ..studies.campaign.report import seconds

    table = Table("fault, alone", "samples", "detected", "after", "before", "by", title_justify="left",
                  title="Faults, and what the built-in test detected")
    table.columns[0].no_wrap = True
    several = len({f.experiment for f in summary.findings}) > 1
    for f in summary.findings:
        by = ", ".join(f"{name} {n}" for name, n in f.monitors.items() if n)
        table.add_row(f"{f.experiment}: {f.fault}" if several else f.fault, str(f.samples), str(f.found),
                      seconds(f.delay), str(f.before), by)
    return table


def _short(factor: str) -> str:
    """Return a factor's name without its experiment."""
    return factor.split(".", 2)[2].removeprefix("inputs.") if factor.startswith("experiments.") else factor
