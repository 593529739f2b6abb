"""Cost of a 1 ms step of each model and option, over the nonlinear model's: `python benchmarks/models.py`."""

from __future__ import annotations

from time import process_time

import numpy as np

from emcas_fmu.actuators import EXTENSIONS, NAMES, NONLINEAR, get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.compiled import parameter_row

COUNT, STEPS, ROUNDS = 200, 400, 5


def cost(model: str) -> float:
    """Least CPU time [ns] of a step, of several rounds; a square wave of 5 deg at 5 Hz."""
    parameters = load_parameters(model=model)
    values = (parameters.with_values({"homing.required": False}) if "homing" in model else parameters).values
    names = [v.name for v in get(model).inputs]
    best = np.inf
    for _ in range(ROUNDS):
        batch = Batch(parameter_row(values, model)[np.newaxis], COUNT, model, lanes=1)
        for place, variable in enumerate(get(model).inputs):
            batch.hold(place, float(variable.initial(values)))
        begin = process_time()
        for k in range(1, STEPS + 1):
            batch.hold(names.index("fin_command"), 0.0873 if (k // 100) % 2 == 0 else -0.0873)
            batch.run(k * 1e-3)
        best = min(best, process_time() - begin)
    return 1e9 * best / (COUNT * STEPS)


def main() -> None:
    """Print the table."""
    base = cost(NONLINEAR)
    print(f"{'model':<56}{'ns a step':>10}{'of nonlinear':>14}")
    together = [option for option in EXTENSIONS if option != "lugre"]  # which goes with few
    for name in (*NAMES, *(f"{NONLINEAR}+{option}" for option in EXTENSIONS), "+".join((NONLINEAR, *together))):
        found = cost(name)
        print(f"{name:<56}{found:>10.0f}{found / base:>14.2f}")


if __name__ == "__main__":
    main()
