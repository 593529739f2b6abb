"""Table of docs/model/numerics.md, and the numbers in its text.

    python docs/figures/make_numerics.py           # writes the table
    python docs/figures/make_numerics.py --check   # exit code 1 if the table is stale
    python docs/figures/make_numerics.py --text    # prints the numbers of the text: encoder, steps of the load
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from make_tables import main, markdown

from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files
from emcas_fmu.reference.cases import CASES, ReferenceCase
from emcas_fmu.simulation import simulate
from emcas_fmu.support.files import models_directory

VALUES = load_parameters().values
TICKS = (0.1e-3, 0.35e-3, VALUES["solver.max_tick"])  # s
FINEST = 2e-6  # s, tick
SMALLEST = 1e-3  # mdeg; smaller differences are within the rounding of the stored reference
ROWS = {  # rows of the table, with their reference cases
    "steps ±1°": ("step_plus1", "step_minus1"),
    "steps ±5°, ±10°, ±20°": tuple(f"step_{sign}{size}" for sign in ("plus", "minus") for size in (5, 10, 20)),
    "the case `step`": ("step",), "square wave": ("square",), "sweep 1°": ("chirp_1deg",),
    "sweep 3.5°": ("chirp_3p5deg",), "100 N·m opposing, aiding": ("load_opposing", "load_aiding"), "−6 °C": ("cold",),
    "sagging bus": ("sag",)}
RUNS, DURATION = 120, 0.4  # number of random runs, and the duration of each [s]


def _angle(case: ReferenceCase, **parameters: Any) -> np.ndarray:
    """Return the fin angle [mdeg] at the rows of a case."""
    inputs = case.inputs()
    signals: dict[str, Any] = {name: column for name, column in inputs.items() if name != "time"}
    values = {**VALUES, **case.overrides, **parameters}
    angle: np.ndarray = 1e3 * np.degrees(simulate(values, case.stop_time, case.step, **signals)["fin_angle"])
    return angle


def ticks() -> str:
    """Return the table of the largest difference of the fin angle from the stored reference, by tick."""
    folder, largest = models_directory() / "reference", {}
    for case in CASES:
        stored = np.degrees(files.read_csv(files.path_of(folder, case.name, "ref.csv"))["fin_angle"]) * 1e3
        largest[case.name] = [float(np.abs(_angle(case, **{"solver.max_tick": tick}) - stored).max()) for tick in TICKS]
    rows = [[title] for title in ROWS]
    for row, names in zip(rows, ROWS.values(), strict=True):
        for column in range(len(TICKS)):
            error = max(largest[name][column] for name in names)
            row.append(f"{error:.2g}" if error >= SMALLEST else f"below {SMALLEST:g}")
    head = [f"{tick * 1e3:g} ms" for tick in TICKS]
    return markdown(("case", *head[:-1], f"{head[-1]} (default)"), rows)


def print_encoder() -> None:
    """Print the largest differences of the fin angle from that with the finest tick, with the encoder on."""
    chosen = (5e-6, 1e-5, 2e-5, 1e-4, *TICKS[1:])
    print(f"encoder on: largest difference from ticks of {FINEST * 1e6:g} us / mdeg\n")
    print(f"{'case':16}" + "".join(f"{tick * 1e6:>9g} us" for tick in chosen))
    for case in CASES:
        finest = _angle(case, **{"encoder.enabled": True, "solver.max_tick": FINEST})
        errors = [np.abs(_angle(case, **{"encoder.enabled": True, "solver.max_tick": tick}) - finest).max()
                  for tick in chosen]
        print(f"{case.name:16}" + "".join(f"{error:12.4f}" for error in errors))


def print_load_steps() -> None:
    """Print the errors in random runs with steps of the command, and steps of the load between samples."""
    rows, step = round(DURATION / 2e-4) + 1, 2e-4  # s; loads may step five times in a sample
    errors: dict[float, list[float]] = {tick: [] for tick in TICKS[1:]}
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        command, load = (np.zeros(rows) for _ in range(2))
        for signal, limit in ((command, VALUES["command.limit"]), (load, 100.0)):
            for begin in sorted(rng.integers(0, rows, 6)):
                signal[begin:] = rng.uniform(-limit, limit)

        def run(tick: float, command: np.ndarray = command, load: np.ndarray = load) -> np.ndarray:
            values = {**VALUES, "encoder.enabled": False, "solver.max_tick": tick}
            columns = simulate(values, DURATION, step, fin_command=command, aero_torque=load)
            angle: np.ndarray = 1e3 * np.degrees(columns["fin_angle"])
            return angle

        finest = run(FINEST)
        for tick, differences in errors.items():
            differences.append(float(np.abs(run(tick) - finest).max()))
    print(f"\nsteps of the load: difference from ticks of {FINEST * 1e6:g} us, largest and median of {RUNS} runs / "
          "mdeg")
    for tick, differences in errors.items():
        print(f"{tick * 1e6:>9g} us{max(differences):12.3f}{np.median(differences):12.3f}")


TABLES = {"model/numerics.md": {"ticks": ticks}}

if __name__ == "__main__":
    if "--text" in sys.argv[1:]:
        print_encoder()
        print_load_steps()
    else:
        sys.exit(main("--check" in sys.argv[1:], TABLES, "make_numerics.py"))
