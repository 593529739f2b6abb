"""Plot docs/figures/batch.png and write the tables of docs/use/batch.md, from results of the benchmark.

    python benchmarks/batch.py --scaling --json eight.json
    python benchmarks/batch.py --scaling --json four.json --lanes 4
    python docs/figures/make_batch.py eight.json four.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from make_tables import main, markdown, save
from matplotlib.ticker import FuncFormatter

from emcas_fmu.plotting import plots

SETS = {True: "own parameters", False: "one set for all"}
LOOKS = {8: plots.VERMILLION, 4: plots.BLUE}


def _scaling(run: Any, own: bool) -> list[Any]:
    return [line for line in run["scaling"] if line["own"] == own]


def _inverse(x: Any) -> Any:
    """Return the number of actuators in real time for a time of x [ns] per step of 1 ms, or the time for a number x."""
    return 1e6 / np.maximum(x, 1e-9)  # Matplotlib also passes 0


def draw(runs: Sequence[Any]) -> None:
    """Plot the time of a step against the number of actuators."""
    with plots.style():
        figure, (axes,) = plots.figure(1, 2, height=3.2, sharex=True, sharey=True)
        for panel, (own, title) in zip(axes, SETS.items(), strict=True):
            count = [line["actuators"] for line in _scaling(runs[0], own)]
            loop = np.median([[line["loop_ns"] for line in _scaling(run, own)] for run in runs], axis=0)
            panel.loglog(count, loop, "o-", color=plots.GRAY, markersize=3.5, label="one at a time")
            for run in sorted(runs, key=lambda run: int(run["lanes"])):
                panel.loglog(count, [line["vectors_ns"] for line in _scaling(run, own)], "o-", markersize=3.5,
                             color=LOOKS[run["lanes"]], label=f"{run['lanes']} at once")
            panel.set(title=title, xlabel="actuators", xticks=count, ylim=(40.0, 20_000.0))
            panel.minorticks_off()
            for axis in (panel.xaxis, panel.yaxis):
                axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}"))
            for label in panel.get_xticklabels():
                label.set(rotation=30, ha="right", rotation_mode="anchor")
        axes[0].set(ylabel="CPU time per actuator and step of 1 ms [ns]")
        axes[0].legend()
        real = axes[1].secondary_yaxis("right", functions=(_inverse, _inverse))
        real.set(ylabel="actuators that a core moves in real time")
        real.minorticks_off()
        real.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}"))
        save(figure, "batch")


def ratios(runs: Sequence[Any]) -> str:
    """Return the table of the time with the loop, and of the time with vectors over it, measured in the same run."""
    head, rows = ["actuators"], []
    for title in SETS.values():
        head += [f"{title}: loop", *(f"{run['lanes']} at once" for run in runs)]
    for i, line in enumerate(_scaling(runs[0], True)):
        row = [f"{line['actuators']:,}"]
        for own in SETS:
            row += [f"{np.median([_scaling(run, own)[i]['loop_ns'] for run in runs]):.0f} ns",
                    *(f"{_scaling(run, own)[i]['ratio']:.2f}" for run in runs)]
        rows.append(row)
    hard = [run["hard.1000.ns"]["loop_ns"] for run in runs]
    rows.append(["1,000, hard", f"{np.median(hard):.0f} ns", *(f"{run['hard.1000']:.2f}" for run in runs),
                 *("" for _ in range(1 + len(runs)))])
    return markdown(head, rows)


def threads(runs: Sequence[Any]) -> str:
    """Return the sentence on the time of a step with several threads, divided by the time with one thread."""
    shares, count = [], runs[0]["threads"][0]["actuators"]
    for run in runs:
        one, *more = run["threads"]
        shares += [f"{line['threads']} threads with {run['lanes']} at once {line['wall_ns'] / one['wall_ns']:.2f}"
                   for line in more]
    return (f"Time of {count:,} actuators with one parameter set, divided by the time with one thread: "
            f"{', '.join(shares)}.")


if __name__ == "__main__":
    measured = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    draw(measured)
    sys.exit(main(False, {"use/batch.md": {"ratios": partial(ratios, measured),
                                           "threads": partial(threads, measured)}}, "make_batch.py"))
