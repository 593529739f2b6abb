"""Tables of docs/tools/campaigns.md: errors of the figures of power against fine rows, and the example's verdict.

    python docs/figures/make_campaigns.py           # writes the tables
    python docs/figures/make_campaigns.py --check   # exit code 1 if a table is stale
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from math import radians
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from make_tables import DOCS, main, markdown

from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.motions import LEAD_IN, STEP
from emcas_fmu.pages.numbers import with_unit
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign import experiments
from emcas_fmu.studies.campaign.experiments import REQUIREMENT, Experiment, excitation
from emcas_fmu.studies.campaign.run import in_process
from emcas_fmu.studies.campaign.store import Store
from emcas_fmu.studies.campaign.study import load_study
from emcas_fmu.studies.campaign.summary import summarise, text

FINE = 50  # rows in 1 ms, 20 us apart
ON_A_ROW = 3e-3  # s, a transport delay with which the jumps of power coincide with rows
FIGURES = ("net_energy", "rms_power", "peak_power")
EXPERIMENTS = {
    **{f"step of {size} deg": (Experiment("a", "step", 0.6), {"amplitude": radians(size)}) for size in (1, 5, 20)},
    "sine of 2 deg, 10 Hz": (Experiment("a", "sine", 0.6), {"amplitude": radians(2), "frequency": 10.0}),
    "sweep of 1 deg, 0.5 to 30 Hz": (Experiment("a", "sweep", 12.0), {
        "amplitude": radians(1), "low": 0.5, "high": 30.0})}


def _plain(power: Any, step: float) -> dict[str, float]:
    """Return net energy [J], rms and peak [W] of a power [W] in rows `step` [s] apart."""
    return {"net_energy": float(np.trapezoid(power, dx=step)), "rms_power": float(np.sqrt(np.mean(power**2))),
            "peak_power": float(power.max())}


def differences(experiment: Experiment, factors: Mapping[str, float], delay: float
                ) -> tuple[dict[str, float], dict[str, float]]:
    """Return relative errors of a campaign's figures, and of figures from rows 1 ms apart, against rows 20 us apart.

    `delay` is the transport delay [s].
    """
    subject = ParameterSubject(load_parameters().with_values({"drive.transport_delay": delay}))
    numbers = {f"{experiment.prefix}.{name}": value for name, value in factors.items()}
    excited = excitation(experiment, subject.values, numbers, subject.model)
    _, run = subject.run_all(excited, {}, substeps=experiments.POWER_ROWS, fine=[experiments.POWER]).finished()
    measured = {name: values.item() for name, values in experiments.measured(
        experiment, numbers, run, experiments.leaps(subject, {}, run)).items()}
    first = round(LEAD_IN / STEP) * FINE
    power = subject.run(excited, outputs=[experiments.POWER], substeps=FINE, fine=[experiments.POWER]).columns[
        experiments.POWER][first:]
    fine, coarse = _plain(power, STEP / FINE), _plain(power[::FINE], STEP)
    return ({name: measured[name] / value - 1.0 for name, value in fine.items()},
            {name: coarse[name] / value - 1.0 for name, value in fine.items()})


def _cell(ours: float, coarse: float) -> str:
    shown = f"{100 * ours:+.1f}" if abs(ours) < 0.095 else f"{100 * ours:+.0f}"
    rows = f"{100 * coarse:+.0f}"
    shown, rows = ("0" + text[2:] if float(text) == 0.0 else text.replace("-", "−") for text in (shown, rows))
    return f"{shown} % ({rows})"


def power() -> str:
    """Return the table of relative errors against rows 20 us apart; in brackets the errors of rows 1 ms apart."""
    shipped = float(load_parameters().values["drive.transport_delay"])
    rows = []
    for title, (experiment, factors) in EXPERIMENTS.items():
        ours, coarse = differences(experiment, factors, shipped)
        row = [_cell(ours[figure], coarse[figure]) for figure in FIGURES]
        ours, coarse = differences(experiment, factors, ON_A_ROW)
        rows.append([title, *row, *(_cell(ours[figure], coarse[figure]) for figure in FIGURES[:2])])
    names = [f"`{name}`" for name in FIGURES]
    return markdown(("", *names, *(f"{name}, {ON_A_ROW * 1e3:g} ms" for name in names[:2])), rows)


def judged() -> str:
    """Return the table of the requirements of the page's campaign: percentiles, and samples that meet them."""
    page = (DOCS / "tools/campaigns.md").read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        files = {name: Path(folder) / name for name in ("tolerances.toml", "specification.toml")}
        for name, file in files.items():
            file.write_text(re.findall(rf"```toml\n(# {name}\n.*?)```", page, re.DOTALL)[0], encoding="utf-8")
        study = load_study(files["tolerances.toml"], requirements=files["specification.toml"])
        with Store(Path(folder) / "judged", study) as store:
            in_process(study, store.missing(), store.write)
            summary = summarise(study, store.table())
    rows = []
    *each, together = summary.chances
    for chance in each:
        r: Any = chance.requirement
        spread = summary.by_name[f"{REQUIREMENT}.{r.name}"]
        limit = f"{'≥' if r.sense == 'minimum' else '≤'} {with_unit(r.shown_limit, r.shown[0])}"
        rows.append([f"`{r.name}`", limit, *(text(spread.figure, spread.percentiles[p]) for p in (5, 50, 95)),
                     f"{chance.met} of {chance.samples}", str(chance)])
    rows.append(["all", "", "", "", "", f"{together.met} of {together.samples}", str(together)])
    return markdown(("", "required", "5 %", "50 %", "95 %", "met by", "probability"), rows)


TABLES = {"tools/campaigns.md": {"power": power, "judged": judged}}

if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:], TABLES, "make_campaigns.py"))
