"""A whole validation of an FMU: every reference case, Table 2, and the linear model beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees, radians
from pathlib import Path

import fmpy
import numpy as np

from ..actuators import NONLINEAR, get
from ..files import models_directory
from ..parameters import load_parameters
from ..reference import files
from ..reference.simulate import OUTPUTS
from . import findings, metrics, requirements, stored
from .linear import LinearModel
from .results import (
    SCHEMA,
    CaseResult,
    Difference,
    FmuInfo,
    Result,
    Series,
    VariableError,
    write_json,
    write_junit,
)
from .runs import Columns, Unit, opened

__all__ = ["SCHEMA", "Result", "validate", "write_json", "write_junit"]

Progress = Callable[[str, int, int], None]

RECORDED = (*OUTPUTS, "saturated")
STEP = 1e-3  # s, of the runs without a reference
# Errors of these are told in degrees.
_DISPLAY: Mapping[str, tuple[float, str]] = {
    "fin_angle": (degrees(1.0), "deg"), "fin_rate": (degrees(1.0), "deg/s"), "motor_current": (1.0, "A"),
    "motor_voltage": (1.0, "V"), "drive_reference": (1.0, "V")}
_LINEAR_END = 0.35  # s; the step is at requirements.STEP_AT


def validate(fmu: Path, names: Sequence[str] | None = None, directory: Path | None = None,
             progress: Progress | None = None, fin: int | None = None) -> Result:
    """Judge the FMU, or one `fin` of it from 1 on, by the reference cases in `directory` (default: the stored ones).

    With `names`, only these cases and what they suffice for. `progress` is called with the name
    of the run, how many are done and how many there are. Raises EmcasError where the validation
    cannot be carried out; a failing FMU is a result.
    """
    folder = directory or models_directory() / "reference"
    cases = stored.load(folder, names)
    whole = not names
    with opened(fmu, fin) as unit:
        unit.require([v.name for v in get(NONLINEAR).inputs], "input")
        unit.require(RECORDED, "output")
        unit.require(sorted({v.name for v in get(NONLINEAR).parameters}.union(*(c.start_values for c in cases))),
                     "parameter")
        extra = {**_holds(), **_linear_steps()} if whole else {}
        total, done = len(cases) + len(extra), 0

        def tell(name: str) -> None:
            if progress:
                progress(name, done, total)

        runs: dict[str, Series] = {}
        for case in cases:
            tell(case.name)
            exact = unit.run(case.inputs, case.step, case.start_values, RECORDED)
            # The encoder's chatter hides small errors, so references do without; performance does not.
            shipped = {name: value for name, value in case.start_values.items() if not name.startswith("encoder.")}
            run = exact if shipped == case.start_values else unit.run(case.inputs, case.step, shipped, RECORDED)
            runs[case.name] = Series(case.inputs, run, case.reference, exact)
            done += 1
        for name, inputs in extra.items():
            tell(name)
            run = unit.run(inputs, STEP, {}, RECORDED)
            runs[name] = Series(inputs, run, {}, run)
            done += 1
        tell("done")
        info = _info(unit)
    model = LinearModel(info.parameters)
    linear = {amplitude: (runs[name], model.simulate(runs[name].inputs["fin_command"]))
              for amplitude in findings.AMPLITUDES if (name := _linear_name(amplitude)) in runs}
    comparisons = tuple(findings.compare(a, *pair) for a, pair in linear.items() if pair[0].run.stopped is None)
    results = tuple(_case_result(case, runs[case.name]) for case in cases)
    criteria = [requirements.trajectory(c.name, c.title, runs[c.name], c.errors["fin_angle"].maximum) for c in results]
    criteria += [requirements.judge(requirement, runs) for requirement in requirements.REQUIREMENTS]
    return Result(info, str(folder), results, tuple(criteria), comparisons,
                  (*findings.claims(comparisons), *findings.accuracy(runs)), _notes(info, cases, runs), runs, linear)


def _time(stop: float) -> metrics.Array:
    return np.round(np.arange(round(stop / STEP) + 1) * STEP, 9)


def _step_inputs(stop: float, command: float, moment: float = 0.0) -> Columns:
    time = _time(stop)
    after = time > requirements.STEP_AT - STEP / 2
    return {"time": time, "fin_command": np.where(after, radians(command), 0.0),
            "aero_torque": np.where(after, moment, 0.0)}


def _holds() -> dict[str, Columns]:
    stop = requirements.STEP_AT + requirements.HOLD
    return {name: _step_inputs(stop, *what) for name, what in requirements.HOLDS.items()}


def _linear_name(amplitude: float) -> str:
    return f"linear_{amplitude:g}deg"


def _linear_steps() -> dict[str, Columns]:
    return {_linear_name(amplitude): _step_inputs(_LINEAR_END, amplitude) for amplitude in findings.AMPLITUDES}


def _case_result(case: stored.Stored, series: Series) -> CaseResult:
    run = series.exact
    rows = min(len(run.columns["time"]), len(series.reference["time"]))
    found = {}
    for name, (scale, unit) in _DISPLAY.items():
        error = (metrics.errors(run.columns[name][:rows] * scale, series.reference[name][:rows] * scale) if rows
                 else metrics.Errors(float("nan"), float("nan")))
        found[name] = VariableError(error.maximum, error.rms, unit)
    return CaseResult(case.name, case.title, case.kind, case.stop_time, run.stopped, run.wall_time, run.messages, found,
                      requirements.figures(case.kind, series))


def _info(unit: Unit) -> FmuInfo:
    description, defaults = unit.description, load_parameters()
    parameters = {v.name: unit.starts[v.name] for v in get(NONLINEAR).parameters}
    parameters |= {v.key: unit.starts[v.name] for v in get(NONLINEAR).inputs if v.key}
    differences = tuple(
        Difference(e.variable.name, parameters[e.variable.name], e.value, e.variable.unit)
        for e in defaults.entries if parameters[e.variable.name] != e.value)
    return FmuInfo(str(unit.path), description.modelName, description.guid, description.version or "",
                   description.generationTool or "", unit.sha256, fmpy.platform, fmpy.__version__, parameters,
                   differences, tuple(e.variable.name for e in defaults.entries if e.source == "estimate"))


def _notes(info: FmuInfo, cases: Sequence[stored.Stored], runs: Mapping[str, Series]) -> tuple[str, ...]:
    notes = []
    if info.differences:
        notes.append(f"The FMU's parameters differ from the defaults: {', '.join(d.name for d in info.differences)}")
    foreign = [case.name for case in cases
               if files.parameters_hash({**info.parameters, **case.start_values}) != case.parameters_hash]
    if foreign:
        which = "all cases" if len(foreign) == len(cases) else ", ".join(foreign)
        notes.append(f"The references of {which} were made with other parameters than the FMU's; make its own with "
                     "`emcas reference --parameters FILE --directory DIR` and validate with `--directory DIR`")
    for name, series in runs.items():
        if series.run.stopped is not None:
            notes.append(f"{name}: the FMU went no further than {series.run.stopped:.6g} s")
        notes += [f"{name}: FMU log: {message}" for message in series.run.messages]
    return tuple(notes)
