"""Tables of the pages of the kinds of actuation: errors by tick, against the independent integration of each kind.

    python docs/figures/make_ticks.py                    # writes the tables, in about a quarter of an hour
    python docs/figures/make_ticks.py worm_gear.md       # only those of one page
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from math import pi, radians
from pathlib import Path
from typing import Any

import numpy as np
from make_tables import main, markdown

from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.reference import files
from emcas_fmu.simulation import simulate

RIM = 0.045  # m, radius of the pitch circle of the worm's wheel
FALLING = {"worm.friction": 0.04, "worm.static_ratio": 3.75}
DRIVEN = {"worm.friction": 0.05}
SMALLEST = 1e-6  # deg; smaller differences are within the error of a reference
STEP, SLEWS, COLD, SAG = ("step_plus5",), ("load_opposing", "load_aiding"), ("cold",), ("sag",)
CASES = {"step of 5°": STEP, "slews of 40° against and with 100 N·m": SLEWS, "steps at −6 °C": COLD,
         "slew into a sag of the supply": SAG}


@dataclass(frozen=True)
class Runs:
    """Reference cases by name, or one run with input `columns` (SI, every 1 ms), with changed parameters."""

    cases: tuple[str, ...] = ()
    changes: Mapping[str, Any] = field(default_factory=dict)
    columns: Mapping[str, Any] = field(default_factory=dict)

    def inputs(self, default: ParameterSet) -> Iterable[tuple[ParameterSet, Mapping[str, Any]]]:
        """Yield the parameters without sensor counts, and the input columns with `time` [s], of each run."""
        if self.columns:
            exact = {"encoder.enabled": False, "transducer.resolution": 0.0}
            rows = len(next(iter(self.columns.values())))
            yield (default.with_values({**default.having(exact), **self.changes}),
                   {"time": np.arange(rows) * 1e-3, **self.columns})
        by_name = {case.name: case for case in files.cases(default.model, default.values)}
        for case in (by_name[name] for name in self.cases):
            yield default.with_values({**case.overrides, **self.changes}), case.inputs()


@cache
def _time(stop: float) -> Any:
    return np.arange(round(stop / 1e-3) + 1) * 1e-3


def _from(time: Any, at: float, value: float) -> Any:
    return np.where(time > at - 5e-4, value, 0.0)


def _worn(gap: float, **changes: float) -> dict[str, float]:
    """Return parameters with a backlash of `gap` [deg] at the fin, and other `changes`."""
    return {"drive_line.backlash": radians(gap) * RIM, **changes}


_SHAKEN = {"enable": 0.0 * _time(0.3), "aero_torque": 100.0 * np.sin(2.0 * pi * 20.0 * _time(0.3))}
WORM = {
    **{title: Runs(cases) for title, cases in CASES.items()},
    "slew of 40° with 100 N·m, friction that falls": Runs(SLEWS[1:], FALLING),
    "slew of 40° against 100 N·m, friction that falls": Runs(SLEWS[:1], FALLING)}
ELASTIC = {
    "step of 5°, 0.038°": Runs(STEP), "slews of 40° against and with 100 N·m, 0.1°": Runs(SLEWS, _worn(0.1)),
    "the same, friction that falls": Runs(SLEWS, _worn(0.1, **FALLING)),
    "the same, μ = 0.05, driven back, 0.2°": Runs(SLEWS, _worn(0.2, **DRIVEN)),
    "motor off, shaken by ±100 N·m at 20 Hz, locked, 0.2°": Runs((), _worn(0.2), _SHAKEN),
    "the same, μ = 0.05": Runs((), _worn(0.2, **DRIVEN), _SHAKEN),
    "unloaded, at −6 °C and into a sag, 0.1°": Runs(COLD + SAG, _worn(0.1)),
    "the same, 0.2°": Runs(COLD + SAG, _worn(0.2)),
    "the same, 0.2°, friction that falls": Runs(COLD + SAG, _worn(0.2, **FALLING))}
HYDROSTATIC = {
    **{title: Runs(cases) for title, cases in CASES.items() if cases != COLD},
    "±100 N·m at 7 Hz": Runs((), {}, {"aero_torque": 100.0 * np.sign(np.sin(2.0 * pi * 7.0 * _time(0.3)))}),
    "400 N·m against the relief valve": Runs((), {}, {"fin_command": np.full_like(_time(0.3), radians(5.0)),
                                                      "aero_torque": _from(_time(0.3), 0.1, -400.0)}),
    "reservoir lost": Runs((), {"reservoir.pressure": 0.0}, {
        "fin_command": _from(_time(0.3), 0.01, radians(15.0)), "aero_torque": _from(_time(0.3), 0.1, 100.0)}),
    "disabled, against the stop": Runs((), {}, {
        "fin_command": np.full_like(_time(0.3), radians(15.0)), "aero_torque": np.full_like(_time(0.3), 400.0),
        "enable": 1.0 - _from(_time(0.3), 0.1, 1.0)})}
CLUTCHES = {title: Runs(cases) for title, cases in CASES.items()}


def _degrees(error: float) -> str:
    if error < SMALLEST:
        return f"below {SMALLEST:f}°"
    return np.format_float_positional(error, precision=2, fractional=False, trim="-") + "°"


def table(model: str, cases: Mapping[str, Runs], ticks: tuple[float, ...]) -> str:
    """Return the table of the largest difference of the fin angle in each case, by tick [s]."""
    default, reference = load_parameters(model=model), files.simulator(model)
    rows = []
    for title, runs in cases.items():
        errors = np.zeros(len(ticks))
        for parameters, inputs in runs.inputs(default):
            expected = reference(parameters.values, inputs)["fin_angle"]
            signals: dict[str, Any] = {name: column for name, column in inputs.items() if name != "time"}
            ticked = (parameters.with_values({"solver.max_tick": tick}).values for tick in ticks)
            angles = (simulate(values, float(inputs["time"][-1]), 1e-3, model=model, **signals)["fin_angle"]
                      for values in ticked)
            errors = np.maximum(errors, [np.degrees(np.abs(angle - expected).max()) for angle in angles])
        rows.append((title, *map(_degrees, errors)))
    shipped = default.values["solver.max_tick"]
    head = (f"{tick * 1e3:g} ms{' (default)' if tick == shipped else ''}" for tick in ticks)
    return markdown(("case", *head), rows)


DOCUMENTS = {
    "model/worm_gear.md": {"ticks": partial(table, "worm-gear", WORM, (7e-4, 2.5e-4, 1.25e-4)),
                           "elastic_ticks": partial(table, "worm-gear-elastic", ELASTIC, (8e-5, 4e-5, 2e-5, 1e-5))},
    "model/clutch.md": {"ticks": partial(table, "clutch", CLUTCHES, (1e-3, 2e-4, 5e-5)),
                        "series_ticks": partial(table, "series-clutch", CLUTCHES, (1e-3, 2e-4, 5e-5))},
    "model/electrohydrostatic.md": {"ticks": partial(table, "electrohydrostatic", HYDROSTATIC, (1e-4, 2.5e-5))}}

if __name__ == "__main__":
    names = sys.argv[1:] or [Path(page).name for page in DOCUMENTS]
    sys.exit(main(False, {page: tables for page, tables in DOCUMENTS.items() if Path(page).name in names},
                  "make_ticks.py"))
