"""Parameters, runs and comparisons that the tests of several extensions share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference import files
from emcas_fmu.simulation import simulate

WAYS = ("positive", "negative")
NO_COULOMB = {f"friction.coulomb.{way}[{power}]": 0.0 for way in WAYS for power in range(7)}  # at the motor
# Without controllers the current reference is drive.current_offset.
NO_CONTROLLER = {"controller.position.kp": 0.0, "controller.position.ki": 0.0, "controller.velocity.kp": 0.0,
                 "compensation.gain": 0.0}
BLOCKED = {**NO_CONTROLLER, "friction.coulomb.positive[0]": 10.0, "friction.coulomb.negative[0]": 10.0,
           "drive.ki": 0.0}
# Independent integrations: module of emcas_fmu.reference and class.
REFERENCES = {"nonlinear": ("plant", "Plant"), "worm-gear": ("worm_gear", "WormPlant"),
              "worm-gear-elastic": ("worm_gear_elastic", "MeshPlant"),
              "series-clutch": ("series_clutch", "SeriesClutch"),
              "electrohydrostatic": ("electrohydrostatic", "Electrohydrostatic")}

def values_of(*changes: Mapping[str, Any], model: str, **named: Any) -> Mapping[str, Any]:
    """Return a model's values with changes; also by keyword, ``__`` for the dot."""
    changed = {name: value for each in changes for name, value in each.items()}
    return load_parameters(model=model).with_values(
        changed | {name.replace("__", "."): value for name, value in named.items()}).values


def tick_errors(base: str, extension: str, values: Mapping[str, Any], stop: float, ticks: Sequence[float],
                **inputs: Any) -> Any:
    """Return the largest errors of the fin angle [deg], compared with the independent integration.

    `ticks` multiply solver.max_tick; `inputs` are constants or columns with a row for each 1 ms.
    """
    module, name = REFERENCES[base]
    rows = round(stop / 1e-3) + 1
    columns: dict[str, Any] = {key: np.broadcast_to(column, rows) for key, column in inputs.items()}
    plant = getattr(import_module(f"emcas_fmu.reference.{module}"), name)
    exact = plant.simulate(values, {"time": np.arange(rows) * 1e-3, **columns})["fin_angle"]
    runs = [simulate({**values, "solver.max_tick": values["solver.max_tick"] * tick}, stop, model=f"{base}+{extension}",
                     **columns) for tick in ticks]
    return np.array([np.degrees(np.abs(run["fin_angle"] - exact).max()) for run in runs])


def case_error(model: str, values: Mapping[str, Any], name: str, rows: int, **changes: Any) -> float:
    """Return the largest error of the fin angle [deg] in the first rows of a case, against its independent integration.

    `changes` of values, ``__`` for the dot, replace those of the case.
    """
    (case,) = (each for each in files.cases(model, values) if each.name == name)
    values = {**values, **case.overrides, **{key.replace("__", "."): value for key, value in changes.items()}}
    inputs: dict[str, Any] = {key: column[:rows] for key, column in case.inputs().items()}
    exact = files.simulator(model)(values, inputs)
    time = inputs.pop("time")
    run = simulate(values, float(time[-1]), float(time[1]), model=model, **inputs)
    return float(np.degrees(np.max(np.abs(run["fin_angle"] - exact["fin_angle"]))))
