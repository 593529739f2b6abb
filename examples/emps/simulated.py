"""Simulations of the records, in closed loops and in windows of 1 s with open loops, and their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from emcas_fmu.actuators import get
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.simulation import respond_all

from .records import NEWTON_PER_VOLT, SAMPLE_TIME, Array, Record

MODEL = str(Path(__file__).with_name("emps.py"))
Values = Mapping[str, float]
WINDOW = round(1.0 / SAMPLE_TIME)  # samples
BORDER = 49  # samples at the beginning that the authors leave out


def parameters() -> dict[str, float]:
    """Return the parameters of emps.toml, SI."""
    return dict(load_parameters(model=MODEL).values)


def _respond(sets: Sequence[Values], outputs: Sequence[str], **inputs: Array) -> dict[str, Array]:
    """Return outputs [sets, points] of the actuator; inputs are arrays [points] or [sets, points]."""
    variables = get(MODEL).inputs
    points = next(iter(inputs.values())).shape[-1]
    columns = [inputs.get(v.name, np.full(points, float(v.initial(sets[0])))) for v in variables]
    rows = np.array([parameter_row(values, MODEL) for values in sets])
    return respond_all(rows, columns, SAMPLE_TIME, outputs, model=MODEL).finished()


def _begun(record: Record, at: int, speed: Array) -> dict[str, float]:
    """Return the parameters of a start in the state of a record at a sample; `speed` [m/s] is the smoothed column."""
    return {"fin.start_angle": float(record.position[at]), "start.rate": float(speed[at]),
            "start.voltage": float(record.voltage[max(at - 1, 0)])}


def under_loops(record: Record, sets: Sequence[Values]) -> tuple[Array, Array]:
    """Return position [m] and voltage [V] in closed loops under the record's command: arrays [sets, samples]."""
    begun = _begun(record, 0, record.speed)
    command, added = (np.append(column, column[-1]) for column in (record.command, record.added))
    responses = _respond([{**values, **begun} for values in sets], ("fin_angle", "drive_voltage"), fin_command=command,
                         added_voltage=added)
    # The output at a communication point is the voltage of the sample before it.
    return responses["fin_angle"][:, :-1], responses["drive_voltage"][:, 1:]


def in_windows(record: Record, sets: Sequence[Values], dry: Array | float = 0.0) -> Array:
    """Return errors of position [m] with open loops: an array [sets, windows, samples].

    Each window begins in the state of the record, and its input is the record's voltage. `dry` [N], a number or an
    array [sets, windows], is added to the dry friction.
    """
    starts = range(0, len(record) - WINDOW + 1, WINDOW)
    speed = record.speed
    begun = [_begun(record, at, speed) for at in starts]
    dry = np.broadcast_to(dry, (len(sets), len(begun)))
    rows = [{**values, **start, "controller.kv": 0.0, "friction.dry": max(values["friction.dry"] + more, 0.0)}
            for values, added in zip(sets, dry.tolist(), strict=True) for start, more in zip(begun, added, strict=True)]
    voltage, position = (np.stack([column[at:at + WINDOW] for at in starts])
                         for column in (record.voltage, record.position))
    angle = _respond(rows, ("fin_angle",), added_voltage=np.tile(voltage, (len(sets), 1)))["fin_angle"]
    errors: Array = angle.reshape(len(sets), len(begun), WINDOW) - position
    return errors


def friction_levels(record: Record, values: Values) -> Array:
    """Return the level [N] added to the dry friction in each window, computed from the windows before; first 0.

    Dry friction changes with the temperature of the grease, from day to day by more than within seconds. The level
    minimises the squared errors of all windows before, which are assumed to be linear in it.
    """
    without, more = in_windows(record, [values, values], np.array([[0.0], [1.0]]))
    slope = more - without
    levels = -np.cumsum(np.sum(without * slope, axis=1)) / np.cumsum(np.sum(slope * slope, axis=1))
    return np.concatenate(([0.0], levels[:-1]))


@dataclass(frozen=True)
class Errors:
    """Errors against one record: of force and position in %, and of the position in open-loop windows in mm (RMS).

    The first two are defined by the authors: 100 times the norm of the difference over the norm of the measured signal,
    from sample 50 on; their filter is applied to the measured position. In `window_rms_mm_level` the friction of each
    window has the level of the windows before.
    """

    force_percent: float
    position_percent: float
    window_rms_mm: float
    window_rms_mm_level: float


def errors(record: Record, values: Values) -> Errors:
    """Return the errors of an actuator with these parameters."""
    position, voltage = (column[0] for column in under_loops(record, [values]))
    measured = record.smooth_position
    levels = friction_levels(record, values)
    return Errors(
        percent(voltage, record.voltage), percent(position, measured),
        *(1e3 * float(np.sqrt(np.mean(in_windows(record, [values], dry) ** 2))) for dry in (0.0, levels[np.newaxis])))


def percent(simulated: Array, measured: Array) -> float:
    """Return the norm of the difference in % of the norm of the measured signal, without the first BORDER samples."""
    return 100.0 * float(np.linalg.norm((simulated - measured)[BORDER:]) / np.linalg.norm(measured[BORDER:]))


def force(voltage: Array) -> Array:
    """Return the force [N] of a voltage [V]."""
    return voltage * NEWTON_PER_VOLT
