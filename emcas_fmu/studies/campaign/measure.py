"""The bench's figures of each kind of experiment, measured from the command on, in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import inf, isnan
from typing import Any

import numpy as np

from ...actuators import get
from ...bench.excitation import Excitation
from ...bench.frequency_response import sweep_response, swept
from ...bench.metrics import FIGURES, Figure, leap_weights, leaping_power, motion, usage
from ...bench.runs import Run
from ...bench.subject import Subject, left_out
from ...motions import KINDS
from ...simulation import Array
from .experiments import Experiment

POWER = "supply_power"
# Power has more rows than other outputs: the drive has short transients after each sample of the controller.
POWER_ROWS = 5
_PERIOD = "controller.sample_time"
_ALL = "all"
# Columns, with the bench's name of each figure and the kinds of motion that have it.
_COLUMNS: Mapping[str, tuple[str, str]] = {
    **{name: (name, "jumps") for name in ("rise_time", "settling_time", "overshoot", "steady_error",
                                            "sustained_rate")},
    **{name: (name, "sweeps") for name in ("bandwidth_3db", "bandwidth_90deg", "peak_gain")},
    "peak_rate": ("peak_rate", _ALL),
    "tracking_error_peak": ("peak_tracking_error", "does not jump"),
    "tracking_error_rms": ("rms_tracking_error", _ALL),
    "power_peak": ("peak_power", _ALL),
    "power_rms": ("rms_power", _ALL),
    "energy": ("net_energy", _ALL),
    **{name: (name, _ALL) for name in ("peak_current", "rms_current", "saturated_share", "at_stop_share")},
}


@cache
def figures(kind: str, model: str) -> Mapping[str, Figure]:
    """Return the figures of a kind of experiment by column name, as far as the actuator has the outputs they need."""
    outputs, of_kind = {v.name for v in get(model).outputs}, KINDS[kind]
    groups = {_ALL, "jumps" if of_kind.jumps else "does not jump", *(["sweeps"] if of_kind.sweeps else [])}
    return {name: FIGURES[figure] for name, (figure, group) in _COLUMNS.items()
            if group in groups and outputs.issuperset(FIGURES[figure].needs)}


def lacking(model: str) -> dict[str, list[str]]:
    """Return the figures that an actuator does not have, by the reason."""
    return left_out({name: FIGURES[figure] for name, (figure, _) in _COLUMNS.items()},
                    [v.name for v in get(model).outputs])


def measured(experiment: Experiment, numbers: Mapping[str, Any], run: Run, leaps: Sequence[Array]) -> dict[str, Any]:
    """Return the figures of one finished run, or of many, by the bench's names; nan for a level that is never reached.

    The column POWER has POWER_ROWS values in each row, and jumps at the times `leaps` [s] after the command, one array
    for all runs or one for each. Raises ValueError if a step has no height.
    """
    columns = {name: column for name, column in run.columns.items() if name != POWER}
    rows = replace(run, columns=columns)
    begun = int(np.argmax(run.excitation.judged(columns["time"])))
    measures = usage(rows)
    if POWER in run.columns:
        power = run.columns[POWER][..., begun * POWER_ROWS:]
        weights = [leap_weights(power.shape[-1], run.excitation.step / POWER_ROWS, each) for each in leaps]
        measures |= leaping_power(power, weights[0] if len(weights) == 1 else np.stack(weights))
    if KINDS[experiment.kind].jumps:
        command = run.excitation.command
        if np.any((command[..., -1] == command[..., 0]) | (command[..., -1] == columns["fin_angle"][..., begun])):
            raise ValueError("the step has no height: the command stays where it is")
        measures |= motion(rows)
        measures["steady_error"] = np.abs(measures["steady_error"])
    if KINDS[experiment.kind].sweeps:
        low, high = (numbers[f"{experiment.prefix}.{side}"] for side in ("low", "high"))
        if columns["fin_angle"].ndim == 1:
            return measures | _bandwidths(swept(sweep_response(rows, float(low), float(high))))
        count = len(columns["fin_angle"])
        low, high = (np.broadcast_to(side, count).tolist() for side in (low, high))
        each = [_bandwidths(swept(sweep_response(rows.of(k), low[k], high[k]))) for k in range(count)]
        measures |= {name: np.array([one[name] for one in each]) for name in each[0]}
    return measures


def _bandwidths(measures: dict[str, float]) -> dict[str, float]:
    """Return the figures of a sweep: bandwidths beyond it are infinite, and 0 if the gain is below -3 dB throughout."""
    follows = measures["peak_gain"] >= -3.0
    beyond = inf if follows else 0.0
    gain, phase = measures["bandwidth_3db"], measures["bandwidth_90deg"]
    return {**measures, "bandwidth_3db": beyond if isnan(gain) or not follows else gain,
            "bandwidth_90deg": beyond if isnan(phase) else phase}


def named(experiment: Experiment, model: str, measures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of an experiment by column name."""
    return {f"{experiment.name}.{name}": measures[_COLUMNS[name][0]] for name in figures(experiment.kind, model)}


def leaps(subject: Subject, changes: Mapping[str, Any], run: Run) -> list[Array]:
    """Return the times [s] after the command at which the drive receives a new reference, a delay after each sample.

    One array if the times are the same in all runs, otherwise one for each. Empty if samples are too frequent for the
    rows.
    """
    period, delay = changes.get(_PERIOD, subject.values[_PERIOD]), subject.transport_delay(changes)
    periods, delays = np.broadcast_arrays(np.atleast_1d(period), delay)
    pairs = [*zip(periods.tolist(), delays.tolist(), strict=True)]
    made = {(period, delay): _leaps(period, delay, run.excitation) for period, delay in dict.fromkeys(pairs)}
    return [made[pair] for pair in pairs] if len(made) > 1 else [*made.values()]


def _leaps(period: float, delay: float, excitation: Excitation) -> Array:
    if period < 2.0 * excitation.step / POWER_ROWS:
        return np.empty(0)
    begin = excitation.begin
    first = np.ceil((begin - delay) / period - 1e-6)
    return np.arange(first, (excitation.stop - delay) / period) * period + delay - begin
