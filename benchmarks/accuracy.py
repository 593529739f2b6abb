"""The figures of docs/model/numerics.md: accuracy against the tick, and what the encoder makes of small differences.

    python benchmarks/accuracy.py
"""

from __future__ import annotations

from typing import Any

import numpy as np

from emcas_fmu.files import models_directory
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files
from emcas_fmu.reference.cases import CASES, Case
from emcas_fmu.simulation import simulate

TICKS = (0.1e-3, 0.35e-3, 0.7e-3)  # s
FINEST = 2e-6
SENSITIVE = ("step_minus20", "load_aiding", "sag")


def _angle(case: Case, **parameters: Any) -> np.ndarray:
    """Fin angle [mdeg] at the rows of a case."""
    inputs = case.inputs()
    signals: dict[str, Any] = {name: (lambda t, c=column: float(c[round(t / case.step)]))
                               for name, column in inputs.items() if name != "time"}
    values = {**load_parameters().values, **case.overrides, **parameters}
    result: np.ndarray = np.degrees(simulate(values, case.stop_time, case.step, **signals)["fin_angle"]) * 1e3
    return result


def main() -> None:
    folder = models_directory() / "reference"
    print("largest difference to the stored reference / mdeg\n")
    print(f"{'case':16}" + "".join(f"{tick * 1e3:>9g} ms" for tick in TICKS))
    for case in CASES:
        reference = np.degrees(files.read_csv(files.path_of(folder, case.name, "ref.csv"))["fin_angle"]) * 1e3
        errors = [np.abs(_angle(case, **{"solver.max_tick": tick}) - reference).max() for tick in TICKS]
        print(f"{case.name:16}" + "".join(f"{error:12.3f}" for error in errors))
    print(f"\nencoder on: largest difference to ticks of {FINEST * 1e6:g} us / mdeg\n")
    ticks = (2e-5, 5e-5, 1e-4, 3.5e-4)
    print(f"{'case':16}" + "".join(f"{tick * 1e6:>9g} us" for tick in ticks))
    for case in (case for case in CASES if case.name in SENSITIVE):
        on = {"encoder.enabled": True}
        finest = _angle(case, **on, **{"solver.max_tick": FINEST})
        errors = [np.abs(_angle(case, **on, **{"solver.max_tick": tick}) - finest).max() for tick in ticks]
        print(f"{case.name:16}" + "".join(f"{error:12.3f}" for error in errors))


if __name__ == "__main__":
    main()
