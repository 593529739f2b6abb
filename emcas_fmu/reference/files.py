"""The reference files: inputs, responses and options of every case, in the layout of the FMI cross-check.

    EMCAS_<case>_in.csv    input columns, one row per communication point
    EMCAS_<case>_ref.csv   the response at the same times
    EMCAS_<case>_ref.opt   start, stop, step size and relative tolerance
    provenance.toml        how each file was made, and hashes that show later changes

Layout: https://github.com/modelica/fmi-cross-check/blob/master/FMI-CROSS-CHECK-RULES.md
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..actuators import NONLINEAR, get
from ..actuators.external import load_module
from ..errors import EmcasError, unreadable
from ..parameters import ParameterSet, load_parameters, schema, toml
from ..support.progress import Progress, silent
from ..support.writing import write_folder
from .cases import CASES, SIGNIFICANT_DIGITS, SUPPLY_START, ReferenceCase, select, with_supply
from .events import Array, Scalar
from .plant import Plant

PROVENANCE = "provenance.toml"

Simulate = Callable[[Mapping[str, Scalar], Mapping[str, Array]], Mapping[str, Array]]
"""Function of parameters and input columns, including ``time``, that returns output columns at the same times; SI."""

# Overrides added to a case without encoder: the other sensors also measure true values, and the actuator is homed at
# the start, since it follows no command before.
_TRUE_ANGLE: Mapping[str, Scalar] = {"transducer.resolution": 0.0, "homing.required": False}
# Tolerance of an output not in TOLERANCES, relative to its nominal value: enough for a less accurate integrator.
_RELATIVE = 1e-6
# Largest magnitude in a column: far above any value of an actuator; sums of squares are still finite.
_LARGEST = 1e100
# Largest difference of a recomputed response from the stored one. Both have the integration error: tightening rtol
# tenfold moves no case by more than 1e-10 of a variable's range. Rounding to nine digits adds at most 5e-9 of the
# range. The rest allows for another libm. One encoder count that differs (1e-6 rad, 0.3 A) still exceeds the
# tolerances at least a hundredfold.
TOLERANCES = {
    "fin_angle": 1e-8,  # rad, range 0.4
    "fin_rate": 1e-6,  # rad/s, range 5
    "motor_current": 1e-5,  # A, range 60
    "motor_voltage": 1e-5,  # V, range 39
    "drive_reference": 1e-6,  # V, range 10
}


def simulator(model: str) -> Simulate:
    """Return the independent integration of an actuator. Raises EmcasError if there is none, or it cannot be loaded."""
    actuator = get(model)
    if actuator.reference is None:
        raise EmcasError(f"model {model}: the {actuator.name} actuator has no independent reference; choose a model "
                         "that has one, such as nonlinear, or name one as `reference` in your actuator's file")
    if isinstance(actuator.reference, str):
        module: Any = import_module(actuator.reference)
    elif not actuator.reference.is_file():
        raise EmcasError(f"{actuator.source}: reference {actuator.reference}: there is no such file; "
                         "correct its path")
    else:
        module = load_module(actuator.reference)
    if not callable(getattr(module, "simulate", None)):
        raise EmcasError(f"{actuator.reference}: defines no function simulate(parameters, inputs); add it")
    simulate: Simulate = module.simulate
    return simulate


def supply_start(model: str, values: Mapping[str, Scalar]) -> float:
    """Return the start value [V] of an actuator's supply_voltage, or without this input the default actuator's."""
    return next((float(v.initial(values)) for v in get(model).inputs if v.name == "supply_voltage"), SUPPLY_START)


def cases(model: str, values: Mapping[str, Scalar]) -> tuple[ReferenceCase, ...]:
    """Return the cases that an actuator can run with these values of its parameters, adapted to it.

    A case is left out if it drives an input or changes a parameter that the actuator does not have, other than one of
    the encoder.
    """
    names = {"time", *values, *(v.name for v in get(model).inputs)}
    return tuple(
        suited(case, model, values) for case in CASES
        if names.issuperset(name for name in (*case.overrides, *case.inputs()) if not name.startswith("encoder.")))


def suited(case: ReferenceCase, model: str, values: Mapping[str, Scalar]) -> ReferenceCase:
    """Return a case adapted to an actuator: a sag of its supply, exact sensors with the encoder off, its parameters."""
    exact = case.overrides.get("encoder.enabled") is False
    overrides = {**case.overrides, **(_TRUE_ANGLE if exact else {})}
    return replace(with_supply(case, supply_start(model, values)),
                   overrides={name: value for name, value in overrides.items() if name in values})


class Difference(NamedTuple):
    """Largest difference of a recomputed column from the stored one, and its tolerance, in the variable's SI unit."""

    case: str
    variable: str
    maximum: float
    tolerance: float


def file_of(case: str, suffix: str) -> str:
    """Return the name of one of a case's three files; `suffix` is `in.csv`, `ref.csv` or `ref.opt`."""
    return f"EMCAS_{case}_{suffix}"


def path_of(directory: Path, case: str, suffix: str) -> Path:
    """Return the path of one of a case's three files."""
    return directory / file_of(case, suffix)


def read_table(directory: Path, case: str, suffix: str, sha256: object = None) -> dict[str, Array]:
    """Return the columns [rows], in SI, of one of the two tables of a case.

    Raises EmcasError, with the file, if it is missing, damaged or unreadable, or its SHA-256 is not `sha256`.
    """
    path = path_of(directory, case, suffix)
    try:
        if sha256 is not None and sha256 != hashlib.sha256(path.read_bytes()).hexdigest():
            raise EmcasError(f"{path}: is not the file that {PROVENANCE} describes (its SHA-256 differs); restore it, "
                             f"or {remedy(directory)}")
        return read_csv(path)
    except FileNotFoundError as error:
        raise EmcasError(f"{path}: is missing; {remedy(directory)}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise EmcasError(unreadable(path, error)) from error
    except ValueError as error:
        raise EmcasError(f"{path}: {error}; {remedy(directory)}") from error


def csv_text(columns: Mapping[str, Array], digits: int = SIGNIFICANT_DIGITS) -> str:
    """Return CSV text: a header of names and one row per time, with significant `digits` and LF line ends.

    A column [rows, elements] has its elements in one cell, separated by spaces.
    """
    cells = [" ".join([f"%.{digits}g"] * (column.shape[1] if column.ndim > 1 else 1)) for column in columns.values()]
    text = StringIO()
    # Adding zero turns -0.0 into 0.0: the sign of a zero is not part of a response.
    np.savetxt(text, np.column_stack(list(columns.values())) + 0.0, ",".join(cells), header=",".join(columns),
               comments="")
    return text.getvalue()


def read_csv(path: Path) -> dict[str, Array]:
    """Return the columns [rows], in SI, of a file written by `csv_text`; a column of arrays is [rows, elements].

    Raises ValueError for a table without rows, for cells that are missing or not numbers, and for too large numbers.
    """
    header, *rows = path.read_text("utf-8").splitlines() or [""]
    names = header.split(",")
    if not rows:
        raise ValueError("it has no rows")
    table = np.loadtxt((row.replace(" ", ",") for row in rows), delimiter=",", ndmin=2).T
    ends = np.cumsum([len(cell.split()) for cell in rows[0].split(",")])
    if len(ends) != len(names) or ends[-1] != len(table):
        raise ValueError(f"its rows must have {len(names)} numbers, one for each name in its header")
    columns = {name: part[0] if len(part) == 1 else part.T
               for name, part in zip(names, np.split(table, ends[:-1]), strict=True)}
    for name, column in columns.items():
        if len(odd := column[~(np.abs(column) <= _LARGEST)]):
            raise ValueError(f"column {name} has {odd[0]:g}; expected numbers from {-_LARGEST:g} to {_LARGEST:g}")
    return columns


def read_provenance(directory: Path) -> dict[str, Any]:
    """Return the parsed `provenance.toml`, empty without one. Raises EmcasError if it cannot be read."""
    path = directory / PROVENANCE
    try:
        return schema.document(path, EmcasError)[1] if path.exists() else {}
    except EmcasError as error:
        raise EmcasError(f"{error}; {remedy(directory)}") from error


def remedy(directory: Path) -> str:
    """Return the remedy for missing or damaged reference files."""
    return (f"make the reference files with `emcas reference --directory {directory}`, and with --model and "
            "--parameters of your actuator")


def regenerate(directory: Path, names: Sequence[str] | None = None, progress: Progress = silent,
               parameters: ParameterSet | None = None) -> None:
    """Compute the named cases (default all), then write their files and the provenance into `directory`.

    The provenance of other cases is kept if `names` is not empty. `parameters` defaults to the shipped set. Raises
    EmcasError for an unknown case and for an actuator without an independent reference.
    """
    used = parameters or load_parameters()
    simulate = simulator(used.model)
    provenance = read_provenance(directory) if names else {}
    contents: dict[str, str | bytes] = {}
    for case in _cases(names, used, progress):
        values = {**used.values, **case.overrides}
        inputs = case.inputs()
        tables = {"in": csv_text(inputs), "ref": csv_text(simulate(values, inputs))}
        options = {"StartTime": 0.0, "StopTime": case.stop_time, "StepSize": case.step, "RelTol": Plant.accuracy.rtol}
        contents |= {file_of(case.name, f"{kind}.csv"): text for kind, text in tables.items()}
        contents[file_of(case.name, "ref.opt")] = "".join(f"{name}, {value:g}\n" for name, value in options.items())
        provenance[case.name] = _provenance(case, tables, values, used.model)
    contents[PROVENANCE] = "\n".join(_table(name, provenance[name]) for name in (case.name for case in CASES)
                                     if name in provenance)
    write_folder(directory, contents)


def outputs(directory: Path, names: Sequence[str] | None, parameters: ParameterSet) -> Iterator[Path]:
    """Yield the paths of the files that `regenerate` writes. Raises EmcasError for an unknown case."""
    for case in _cases(names, parameters, silent):
        yield from (path_of(directory, case.name, suffix) for suffix in ("in.csv", "ref.csv", "ref.opt"))
    yield directory / PROVENANCE


def compare(directory: Path, names: Sequence[str] | None = None, progress: Progress = silent,
            parameters: ParameterSet | None = None) -> list[Difference]:
    """Recompute the named cases (default all) and return their differences from the files in `directory`.

    The difference is infinite if a column is missing or has another number of rows. Raises EmcasError as `regenerate`
    does, and for a missing or damaged file.
    """
    differences = []
    used = parameters or load_parameters()
    simulate = simulator(used.model)
    nominal = {v.name: v.nominal or 1.0 for v in used.actuator.outputs}
    for case in _cases(names, used, progress):
        inputs = case.inputs()
        result = simulate({**used.values, **case.overrides}, inputs)
        allowed = {name: TOLERANCES.get(name, _RELATIVE * nominal.get(name, 0.0)) for name in result}
        for columns, suffix, tolerances in ((inputs, "in.csv", {}), (result, "ref.csv", allowed)):
            stored = read_table(directory, case.name, suffix)
            # Inputs are rounded before they are used, so they must be equal.
            for name, column in columns.items():
                stored_column = stored.get(name, np.zeros(0))
                same = stored_column.shape == column.shape
                maximum = float(np.max(np.abs(column - stored_column))) if same else float("inf")
                differences.append(Difference(case.name, name, maximum, tolerances.get(name, 0.0)))
    return differences


def _cases(names: Sequence[str] | None, parameters: ParameterSet, progress: Progress) -> Iterator[ReferenceCase]:
    """Yield the named cases (default all), and report the progress."""
    selected = select(names, {case.name: case for case in cases(parameters.model, parameters.values)})
    for done, case in enumerate(selected.values()):
        progress(case.name, done, len(selected))
        yield case
        progress(case.name, done + 1, len(selected))


def parameters_hash(values: Mapping[str, Scalar]) -> str:
    """Return the hash that identifies the parameters of a run in its provenance."""
    # References do not depend on the settings of the package's stepping.
    used = {name: float(value) for name, value in values.items() if not name.startswith("solver.")}
    return _sha256(json.dumps(used, sort_keys=True).encode())


def response_hash(values: Mapping[str, Scalar]) -> str:
    """Return the hash of the parameters that determine the response to a case.

    No case moves the vehicle, so without gravity `mounting.azimuth` has no effect.
    """
    return parameters_hash(values if values.get("loads.gravity") else {**values, "mounting.azimuth": 0.0})


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _method(model: str) -> dict[str, Any]:
    reference = get(model).reference
    if reference != get(NONLINEAR).reference:
        return {"method": f"that of the actuator, {Path(str(reference)).name}"}
    rtol, scales, max_step = Plant.accuracy
    return {"method": "scipy.integrate.solve_ivp, DOP853 with terminal events", "relative_tolerance": rtol,
            "absolute_tolerances": [rtol * scale for scale in scales], "maximum_step": max_step}


def _provenance(
        case: ReferenceCase, tables: Mapping[str, str], values: Mapping[str, Scalar], model: str) -> dict[str, Any]:
    return {
        **{name: getattr(case, name) for name in ("title", "kind", "amplitude", "stop_time", "step")},
        "command": "emcas reference",
        **_method(model),
        **({} if model == NONLINEAR else {"model": get(model).name}),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        **{f"sha256_{kind}": _sha256(text.encode()) for kind, text in tables.items()},
        "sha256_parameters": response_hash(values),
        "start_values": dict(case.overrides),
    }


def _table(name: str, entry: Mapping[str, Any]) -> str:
    """Return the TOML of one response: its table and the table of its start values."""
    plain = {key: value for key, value in entry.items() if key != "start_values"}
    return f"{toml.table(name, plain)}\n\n{toml.table(f'{name}.start_values', entry['start_values'])}\n"
