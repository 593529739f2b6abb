"""What is done to the actuator and what is read off: figures of steps, slews, sines, and of the linear loop.

Every command is given both ways; a figure is the worse of the two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import degrees, nan, pi
from typing import Any

import numpy as np

from ..actuators import NONLINEAR, get
from ..bench import metrics
from ..simulation import Array, respond

STEP = 1e-3  # s, between looks at the response
REST = 0.05  # s before a step
SETTLE = 0.4  # s at the first angle of a slew
LOAD_RISE = 0.02  # s, so that a load is no hammer
TAIL = 0.3  # s, where hunting is looked for
_LOWEST, _HIGHEST = 2.0, 60.0  # Hz, where a bandwidth is looked for
_LOOP_LOWEST, _LOOP_POINTS = 0.5, 150  # Hz, and how many: enough for margins to 1e-6
_PERIODS = 6.0  # of a sine; the first third is left out as transient
ACCURACY = round(degrees(metrics.ACCURACY), 9)  # deg
_INPUT = {v.name: i for i, v in enumerate(get(NONLINEAR).inputs)}


@dataclass(frozen=True)
class Test:
    """An experiment. ``amplitude`` [rad]; ``duration`` [s] after the step or slew; ``torque`` [N.m] along the motion
    (negative: against it), constant in a step, risen with the command in a slew from -amplitude to amplitude."""

    __test__ = False  # not one of pytest's

    kind: str
    amplitude: float = 0.0
    duration: float = 0.6
    torque: float = 0.0


@dataclass(frozen=True)
class Figure:
    """A figure's unit, the kinds of test that give it, and what it is."""

    unit: str
    kinds: tuple[str, ...]
    title: str


_MOVES = ("step", "slew")
FIGURES: Mapping[str, Figure] = {
    "rise_time": Figure("s", _MOVES, "10 to 90 % of the commanded change"),
    "settling_time": Figure("s", _MOVES, "until within 2 % of the change around the command for good"),
    "time_to_accuracy": Figure("s", _MOVES, f"until within {ACCURACY} deg of the command for good"),
    "overshoot": Figure("1", _MOVES, "beyond the command, share of the change"),
    "steady_error": Figure("rad", _MOVES, "mean error over the last tenth"),
    "ripple": Figure("rad", _MOVES, f"peak to peak over the last {TAIL:g} s"),
    "peak_rate": Figure("rad/s", _MOVES, "largest fin rate"),
    "sustained_rate": Figure("rad/s", _MOVES, "mean rate over the middle 60 % of the travel"),
    "peak_current": Figure("A", _MOVES, "largest motor current"),
    "rms_current": Figure("A", _MOVES, "motor current, root mean square over the test"),
    "bandwidth_3db": Figure("Hz", ("sine",), "lowest frequency where the fundamental is 3 dB down"),
    "bandwidth_90deg": Figure("Hz", ("sine",), "lowest frequency where the fundamental lags 90 deg"),
    "gain_margin": Figure("dB", ("linear",), "of the loop broken at the drive's reference"),
    "phase_margin": Figure("rad", ("linear",), "of the loop broken at the drive's reference"),
    "delay_margin": Figure("s", ("linear",), "further delay of the loop broken at the drive's reference"),
}


def measure(test: Test, values: Mapping[str, Any], figures: tuple[str, ...], senses: tuple[str, ...]) -> list[float]:
    """Figures of a test, the worse of both directions by the sense of their limits; nan where there is none.

    `values` are flat parameters in SI, encoder and all. Figures that only some limits need are only then computed.
    """
    if test.kind == "linear":
        found = _margins(values)
        return [found[name] for name in figures]
    if test.kind == "sine":
        found = _sine(test, values, figures)
        return [found[name] for name in figures]
    sides = [_move(test, values, sign) for sign in (1.0, -1.0)]
    return [_worse([side[name] for side in sides], sense) for name, sense in zip(figures, senses, strict=True)]


def _worse(pair: list[float], sense: str) -> float:
    if any(np.isnan(pair)):
        return nan
    return max(pair) if sense == "maximum" else min(pair)


def response(test: Test, values: Mapping[str, Any], sign: float = 1.0) -> dict[str, Array]:
    """Time [s] from the step, command and outputs [SI] of a step or slew."""
    table = _table(test, sign, float(values["drive.supply_voltage"]))
    result = respond(values, table, STEP)
    begin = REST if test.kind == "step" else SETTLE
    return {**result, "time": result["time"] - begin, "fin_command": table[:, _INPUT["fin_command"]]}


@lru_cache(maxsize=64)
def _table(test: Test, sign: float, supply: float) -> Array:
    begin = REST if test.kind == "step" else SETTLE
    time = np.arange(round((begin + test.duration) / STEP) + 1) * STEP
    table = np.zeros((len(time), len(_INPUT)))
    table[:, _INPUT["supply_voltage"]] = supply
    table[:, _INPUT["enable"]] = 1.0
    after = time > begin - STEP / 2
    command, torque = sign * test.amplitude, sign * test.torque
    if test.kind == "step":
        table[after, _INPUT["fin_command"]] = command
        table[:, _INPUT["aero_torque"]] = torque
    else:
        table[:, _INPUT["fin_command"]] = np.where(after, command, -command)
        table[:, _INPUT["aero_torque"]] = torque * np.clip((time - begin) / LOAD_RISE, 0.0, 1.0)
    table.flags.writeable = False
    return table


def _move(test: Test, values: Mapping[str, Any], sign: float) -> dict[str, float]:
    result = response(test, values, sign)
    time, angle, command = result["time"], result["fin_angle"], sign * test.amplitude
    step = metrics.step_metrics(time, angle, 0.0, command)
    rates = metrics.slew(time, angle, result["fin_rate"], 0.0, command)
    tail = angle[time > time[-1] - TAIL]
    current = result["motor_current"][time >= 0.0]
    return {
        "rise_time": step.rise_time, "settling_time": step.settling_time, "overshoot": step.overshoot,
        "steady_error": abs(step.steady_error), "peak_rate": rates.peak, "sustained_rate": rates.sustained,
        "time_to_accuracy": step.time_to_accuracy,
        "ripple": float(np.ptp(tail)), "peak_current": float(np.abs(current).max()),
        "rms_current": float(np.sqrt(np.mean(current**2))),
    }


def _sine(test: Test, values: Mapping[str, Any], figures: tuple[str, ...]) -> dict[str, float]:
    """Frequencies where gain and lag pass their levels, by bisection of the describing function."""
    seen: dict[float, complex] = {}

    def at(frequency: float) -> complex:
        if frequency not in seen:
            seen[frequency] = fundamental(values, test.amplitude, frequency)
        return seen[frequency]

    levels: dict[str, Callable[[complex], float]] = {
        "bandwidth_3db": lambda h: abs(h) - 10.0 ** (-3.0 / 20.0),
        "bandwidth_90deg": lambda h: h.real,  # a servo's lag grows from none: it is 90 deg where this first vanishes
    }
    return {name: _crossing(level, at) for name, level in levels.items() if name in figures}


def _crossing(level: Callable[[complex], float], response_at: Callable[[float], complex]) -> float:
    """Where a level that is positive at low frequency first falls to zero; the highest looked at if nowhere."""
    def margin(frequency: float) -> float:
        return level(response_at(frequency))

    grid = np.geomspace(_LOWEST, _HIGHEST, 12)
    low = _LOWEST
    for high in grid:
        if margin(float(high)) <= 0.0:
            break
        low = float(high)
    else:
        return _HIGHEST
    if low == high:
        return _LOWEST
    high = float(high)
    for _ in range(6):  # to 2 parts in 1000
        middle = (low * high) ** 0.5
        low, high = (middle, high) if margin(middle) > 0.0 else (low, middle)
    return float((low * high) ** 0.5)


def fundamental(values: Mapping[str, Any], amplitude: float, frequency: float) -> complex:
    """Describing function of the closed loop [1]: the fundamental of the fin angle over a sine command.

    `amplitude` [rad], `frequency` [Hz]. By projection over whole periods, after the transient.
    """
    begin = max(_PERIODS / 3.0 / frequency, 0.1)
    length = max(_PERIODS * 2.0 / 3.0 / frequency, 0.15)
    periods = np.ceil(length * frequency)
    stop = begin + periods / frequency
    time = np.arange(round(stop / STEP) + 2) * STEP
    table = np.zeros((len(time), len(_INPUT)))
    table[:, _INPUT["supply_voltage"]] = values["drive.supply_voltage"]
    table[:, _INPUT["enable"]] = 1.0
    table[:, _INPUT["fin_command"]] = amplitude * np.sin(2.0 * pi * frequency * time)
    angle = respond(values, table, STEP)["fin_angle"]
    # A least-squares fit needs no whole number of samples in a period.
    inside = (time >= begin) & (time <= stop)
    phase = 2.0 * pi * frequency * time[inside]
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones(phase.size)])
    (sine, cosine, _), *_ = np.linalg.lstsq(basis, angle[inside], rcond=None)
    return complex(sine, cosine) / amplitude


def _margins(values: Mapping[str, Any]) -> dict[str, float]:
    """Margins at the drive's reference; none where the closed loop is unstable."""
    from ..analysis.frequency import highest, margins
    from ..analysis.linear import LinearActuator

    linear = LinearActuator(values)
    if not linear.stable:
        return dict.fromkeys(("gain_margin", "phase_margin", "delay_margin"), nan)
    loop = linear.loop("reference")
    found = margins(loop, np.geomspace(_LOOP_LOWEST, highest(loop), _LOOP_POINTS))
    return {"gain_margin": found.gain_db, "phase_margin": found.phase, "delay_margin": found.delay}
