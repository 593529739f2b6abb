"""Figures of a sample's responses. All in SI; names of the bench's figures where they are the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isnan

import numpy as np

from ..bench import metrics
from ..bench.excitation import STEP
from ..simulation import Array
from .experiments import COMMAND, INDEX, POWER, POWER_ROWS, POWER_STEP, Excitation, Experiment


@dataclass(frozen=True)
class Figure:
    """Unit and title of a figure; `bad` is the side on which it is bad: 1 above, -1 below.

    A figure that cannot be had (nan) counts as worse than any: a time never reached is longer than all.
    """

    unit: str
    title: str
    kinds: tuple[str, ...]
    bad: float = 1.0

    @property
    def missing(self) -> float:
        """What one that cannot be had counts as in order."""
        return self.bad * inf


_ALL = ("step", "sine", "chirp", "hold")


def _as_tuned(name: str, kinds: tuple[str, ...], bad: float = 1.0) -> Figure:
    found = metrics.FIGURES[name]
    return Figure(found.unit, found.title, kinds, bad)


FIGURES: Mapping[str, Figure] = {
    "rise_time": _as_tuned("rise_time", ("step",)),
    "settling_time": _as_tuned("settling_time", ("step",)),
    "overshoot": _as_tuned("overshoot", ("step",)),
    "steady_error": _as_tuned("steady_error", ("step",)),
    "sustained_rate": _as_tuned("sustained_rate", ("step",), -1.0),
    "bandwidth_3db": _as_tuned("bandwidth_3db", ("chirp",), -1.0),
    "bandwidth_90deg": _as_tuned("bandwidth_90deg", ("chirp",), -1.0),
    "peak_gain": Figure("dB", "largest gain within the sweep", ("chirp",)),
    "peak_rate": Figure("rad/s", "largest fin rate, either way", _ALL, -1.0),
    "tracking_error_peak": Figure("rad", "largest distance from the clipped command", ("sine", "chirp", "hold")),
    "tracking_error_rms": Figure("rad", "distance from the clipped command, root mean square", _ALL),
    "power_peak": Figure("W", "largest power drawn", _ALL),
    "power_rms": Figure("W", "power, root mean square", _ALL),
    "energy": Figure("J", "energy drawn less regenerated", _ALL),
    "peak_current": _as_tuned("peak_current", _ALL),
    "rms_current": _as_tuned("rms_current", _ALL),
    "saturated_share": Figure("1", "share of the time a limit is active", _ALL),
    "at_stop_share": Figure("1", "share of the time against a mechanical stop", _ALL),
}


def names(experiment: Experiment) -> list[str]:
    """Figures of an experiment, by column name."""
    return [f"{experiment.name}.{name}" for name, figure in FIGURES.items() if experiment.kind in figure.kinds]


def figures(experiment: Experiment, numbers: Mapping[str, float], made: Excitation,
            response: Mapping[str, Array]) -> dict[str, float]:
    """Figures of a response by column name; nan where there is none (a level never reached).

    `response` has an array per output at the times of the excitation, `supply_power` POWER_ROWS to each. All from
    the command's instant on.
    """
    first = int(np.argmax(made.time > -STEP / 2))
    found = _common({name: column[first:] for name, column in response.items() if name != POWER})
    found |= _power(response[POWER][first * POWER_ROWS:], made.told)
    if experiment.kind == "step":
        found |= _step(made.time, response, float(numbers[f"{experiment.prefix}.amplitude"]))
    if experiment.kind == "chirp":
        sides = (float(numbers[f"{experiment.prefix}.{side}"]) for side in ("low", "high"))
        found |= _swept(made.time, made.table[:, INDEX[COMMAND]], response["fin_angle"], *sides)
    return {column: float(found[column.rpartition(".")[2]]) for column in names(experiment)}


def _common(response: Mapping[str, Array]) -> dict[str, float]:
    current, error = response["motor_current"], response["tracking_error"]
    return {
        "peak_rate": float(np.abs(response["fin_rate"]).max()),
        "tracking_error_peak": float(np.abs(error).max()), "tracking_error_rms": _rms(error),
        "peak_current": float(np.abs(current).max()), "rms_current": _rms(current),
        "saturated_share": float(np.mean(response["saturated"])), "at_stop_share": float(np.mean(response["at_stop"])),
    }


def _power(power: Array, told: Array) -> dict[str, float]:
    """Of rows POWER_STEP apart; `told` [s] from the first are instants the drive gets a new reference.

    Power leaps there, in step with the rows: what is cut by a leap is extended to it from either side, by the
    line through the two rows there.
    """
    weights = np.full(len(power), POWER_STEP)
    weights[[0, -1]] /= 2.0
    leap = np.floor(told / POWER_STEP + 1e-6).astype(int)
    inside = (leap >= 1) & (leap <= len(power) - 3)
    before = leap[inside]
    left = told[inside] - before * POWER_STEP
    for row, inner, length in ((before, -1, left), (before + 1, 1, POWER_STEP - left)):
        line = length**2 / (2.0 * POWER_STEP)
        np.add.at(weights, row, length - POWER_STEP / 2.0 + line)
        np.add.at(weights, row + inner, -line)
    return {"power_peak": float(power.max()), "energy": float(weights @ power),
            "power_rms": float(np.sqrt(weights @ power**2 / weights.sum()))}


def _rms(column: Array) -> float:
    return float(np.sqrt(np.mean(column**2)))


def _step(time: Array, response: Mapping[str, Array], amplitude: float) -> dict[str, float]:
    angle = response["fin_angle"]
    if amplitude in (0.0, angle[np.searchsorted(time, -1e-9)]):
        raise ValueError("the step has no height: the fin is told to stay where it is")
    step = metrics.step_metrics(time, angle, 0.0, amplitude)
    rates = metrics.slew(time, angle, response["fin_rate"], 0.0, amplitude)
    return {"rise_time": step.rise_time, "settling_time": step.settling_time, "overshoot": step.overshoot,
            "steady_error": abs(step.steady_error), "sustained_rate": rates.sustained}


def _swept(time: Array, command: Array, angle: Array, low: float, high: float) -> dict[str, float]:
    """A bandwidth beyond the sweep is infinite; 0 where the fin never comes within 3 dB of the command."""
    with np.errstate(divide="ignore", invalid="ignore"):  # a fin at rest has no gain and no phase
        found = metrics.frequency_response(time, command, angle, low, high)
        peak, gain, phase = float(np.max(found.gain_db)), found.bandwidth, found.phase_bandwidth
    follows = peak >= -3.0
    beyond = inf if follows else 0.0
    return {"bandwidth_3db": beyond if isnan(gain) or not follows else gain,
            "bandwidth_90deg": beyond if isnan(phase) else phase, "peak_gain": peak}
