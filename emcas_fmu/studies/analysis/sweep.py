"""Frequency response of the actuator against amplitude: the describing function, by stepped sines.

At each amplitude and frequency, the compiled kernel simulates a sine to its steady state. The describing function is
the fundamental of the fin angle over that of the command (Gelb & Vander Velde, "Multiple-Input Describing Functions",
section 2.2). For actuators with all of NEEDS, the outputs also show when each limit acts; for the limit of the speed
reference, the controllers are computed again along the recorded motion. Additional sines refine the bandwidths and the
lowest frequency at which each limit acts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...actuators import NONLINEAR, capabilities, get
from ...bench.frequency_response import FrequencyResponse, of_ratio
from ...bench.linear.systems import Array
from ...bench.metrics import CREPT
from ...control import command_bus, controllers, sensors
from ...ops.arrays import ARRAYS
from ...ops.floats import FLOATS
from ...physics import drive, inverter
from ...runtime.compiled import parameter_row
from ...simulation import respond_all
from ...support.progress import Progress, silent

AMPLITUDES = (0.1, 0.3, 1.0, 2.0, 3.5, 6.0, 10.0, 15.0, 20.0)  # deg, of the command
LIMITS = ("rate", "current", "voltage", "dac")
"""Keys of the limits of speed reference, drive current, supply voltage and analogue reference."""
NEEDS = (capabilities.SCREW_EQUATIONS, capabilities.CASCADE, capabilities.CURRENT_LIMIT, capabilities.VOLTAGE_LIMIT,
         capabilities.REFERENCE_LIMIT, capabilities.RIGID_DRIVE_LINE, capabilities.MOTOR_CURRENT,
         capabilities.CURRENT_LOOP)
_SETTLE, _WINDOW = 1.0, 2.0  # s; whole periods of the sine within the window are evaluated
_POINTS = 36  # number of frequencies of a sweep before it is refined
_NUMBERS = 2_000_000  # largest number of values per variable in a batch of sines: 16 MB
_RESOLVED = 3e-3  # largest relative distance, after refining, of the frequencies that enclose a crossing
_PARTS = 8  # number of parts into which a gap between two frequencies is divided
_RECORDED = ("fin_angle", "motor_angle", "motor_speed", "motor_current", "motor_voltage", "drive_reference",
         "current_limit", "link_voltage")
_AT_LIMIT = 1.0 - 1e-9  # share of its limit from which a voltage counts as clipped, because of rounding


@dataclass(frozen=True)
class Sweep:
    """The ``response`` at an ``amplitude`` [rad], and the share of time [1] in which each limit acts.

    ``active`` has these shares by [limit, frequency], without rows for an actuator that lacks one of NEEDS.
    """

    amplitude: float
    response: FrequencyResponse
    active: Array

    def onset(self, limit: str) -> float:
        """Return the lowest frequency [Hz] at which one of LIMITS acts; nan if it never acts."""
        acting = np.flatnonzero(self.active[LIMITS.index(limit)] > 0.0)
        return float(self.response.frequency[acting[0]]) if len(acting) else float("nan")


def frequencies(period: float, highest: float) -> Array:
    """Return logarithmic frequencies [Hz] with whole periods in the window, up to `highest` or 0.4/`period` [s]."""
    window = round(_WINDOW / period) * period
    grid = np.geomspace(1.0 / window, min(highest, 0.4 / period), _POINTS)
    return np.unique(np.round(grid * window)) / window


def sines(values: Mapping[str, Any], chosen: Sequence[tuple[float, float, Array]], aero_torque: float = 0.0,
          model: str = NONLINEAR) -> list[Sweep]:
    """Return a sweep for each (amplitude [rad], mean fin angle [rad], frequencies [Hz]) in `chosen`, under a load.

    Frequencies are rounded to whole periods. All sines are simulated together, since :func:`replay` takes as long for
    one as for a hundred.
    """
    period = float(values["controller.sample_time"])
    sizes = [len(frequency) for *_, frequency in chosen]
    frequency, samples = _whole(np.concatenate([frequency for *_, frequency in chosen]), period)
    amplitude, about = (np.repeat([each[k] for each in chosen], sizes) for k in range(2))
    settle, window = round(_SETTLE / period), round(_WINDOW / period)
    time = np.arange(settle + window + 1) * period
    command = about + amplitude * np.sin(2.0 * np.pi * np.outer(time, frequency))
    actuator, columns = get(model), {"fin_command": command.T, "aero_torque": aero_torque}
    inputs = [np.atleast_1d(columns.get(v.name, v.initial(values))) for v in actuator.inputs]
    recorded = [v.name for v in actuator.outputs if v.name in _RECORDED]
    sets = np.repeat([parameter_row({**values, "fin.start_angle": at}, model) for _, at, _ in chosen], sizes, axis=0)
    runs = respond_all(sets, inputs, period, recorded, model=model).finished()
    outputs = {name: column.T for name, column in runs.items()}
    steady = slice(settle, settle + window)
    angle, evaluated = outputs["fin_angle"][steady], np.arange(window)[:, np.newaxis] < samples
    turn = np.where(evaluated, np.exp(-2j * np.pi * np.outer(time[steady], frequency)), 0.0)
    ratio = np.sum(angle * turn, axis=0) / np.sum(command[steady] * turn, axis=0)
    ratio[np.ptp(angle, axis=0) <= CREPT] = 0.0  # backlash absorbs the sine; the remaining motion is rounding
    active = np.empty((0, len(frequency)))
    if actuator.provides.issuperset(NEEDS):
        _, raw = replay(values, about, command, outputs, model)
        p = actuator.equation_parameters(FLOATS, actuator.namespace(values))
        u = outputs["drive_reference"]
        limit = outputs.get("current_limit", p.drive.current_limit)  # the extension heat reduces this limit
        current, supply = outputs["motor_current"], outputs.get("link_voltage", p.drive.supply_voltage)
        applied = outputs["motor_voltage"]
        if actuator.structure.inverter:  # the limit is that of the voltage before the loss by the dead time
            applied = applied + inverter.dead_resistance(ARRAYS, p, supply, current) * current
        voltage_limit = drive.voltage_limit(ARRAYS, p, supply, outputs["motor_speed"], current)
        acting = np.stack([np.abs(raw) > p.controller.speed_limit,
                           np.abs(drive.current_reference_raw(p, u)) > limit,
                           np.abs(applied) >= voltage_limit * _AT_LIMIT,
                           np.abs(u) >= p.drive.reference_limit])
        active = np.mean(acting[:, steady], axis=1, where=evaluated)
    ends = np.cumsum(sizes)
    return [Sweep(each[0], of_ratio(frequency[end - size:end], ratio[end - size:end]), active[:, end - size:end])
            for each, size, end in zip(chosen, sizes, ends, strict=True)]


def _whole(frequency: Array, period: float) -> tuple[Array, NDArray[np.int_]]:
    """Return near frequencies [Hz] with whole periods in the window, and the number of samples in these periods."""
    window = round(_WINDOW / period)
    cycles = np.floor(frequency * window * period + 1e-9)
    samples = np.minimum(np.round(cycles / (frequency * period)).astype(int), window)
    return cycles / (samples * period), samples


def shared(sweeps: Sequence[Sweep]) -> list[Array]:
    """Return for each sweep the mask of those frequencies that all sweeps have in common."""
    common = reduce(np.intersect1d, (s.response.frequency for s in sweeps))
    return [np.isin(s.response.frequency, common) for s in sweeps]


def _between(s: Sweep) -> Array:
    """Return frequencies [Hz] that divide the gaps in which the sweep first reaches a level, unless they are narrow."""
    f, added = s.response.frequency, [np.empty(0)]
    for reached in (s.response.gain_db <= -3.0, s.response.phase <= -np.pi / 2.0, *(s.active > 0.0)):
        k = int(np.argmax(reached))
        if reached[k] and k and f[k] - f[k - 1] > _RESOLVED * f[k]:
            added.append(np.linspace(f[k - 1], f[k], _PARTS + 1)[1:-1])
    return np.unique(np.concatenate(added))


def _joined(one: Sweep, other: Sweep) -> Sweep:
    """Return both sweeps as one with ascending frequencies, each of them once."""
    frequency, rows = np.unique(np.concatenate([s.response.frequency for s in (one, other)]), return_index=True)
    ratio = np.concatenate([s.response.gain * np.exp(1j * np.nan_to_num(s.response.phase)) for s in (one, other)])
    return Sweep(one.amplitude, of_ratio(frequency, ratio[rows]),
                 np.concatenate([one.active, other.active], axis=1)[:, rows])


def replay(values: Mapping[str, Any], start: Array, command: Array, motion: Mapping[str, Array], model: str = NONLINEAR
           ) -> tuple[Array, Array]:
    """Return the controllers' reference [V] and unlimited speed reference [rad/s] along recorded motions.

    Arrays are [samples, runs]: fin `command` [rad]; in `motion`, motor angle [rad], speed [rad/s] and current [A]. Each
    motion begins at rest at its fin angle `start` [rad]. As in the core, the command arrives over the bus.
    """
    angle, speed, current = (motion[name] for name in ("motor_angle", "motor_speed", "motor_current"))
    actuator = get(model)
    p, plant = actuator.equation_parameters(FLOATS, actuator.namespace(values)), actuator.plant(values)
    turned = sensors.motor_counts(ARRAYS, p, angle[0])
    loops = controllers.at_rest(
        ARRAYS, p, sensors.measure(ARRAYS, p, plant, angle[0], angle[0], 0.0, turned), start)
    latency = int(command_bus.latency(FLOATS, p))
    delayed = np.concatenate([np.zeros((latency, *command.shape[1:])), command])
    wait, previous = command_bus.start(ARRAYS, p, start).values()
    reference, raw = np.empty_like(command), np.empty_like(command)
    for k in range(len(command)):
        arrived, wait, previous = command_bus.delivered(ARRAYS, p, delayed[k], wait, previous)
        measured = sensors.measure(ARRAYS, p, plant, angle[k], angle[k], speed[k], turned)
        out = controllers.sample(ARRAYS, p, loops, measured, current[k], arrived)
        loops, turned = out.loops, measured.motor_counts
        reference[k], raw[k] = out.reference, out.speed_raw
    return reference, raw


def sweeps(values: Mapping[str, Any], highest: float, at: float = 0.0, aero_torque: float = 0.0,
           amplitudes: Sequence[float] = AMPLITUDES, model: str = NONLINEAR,
           progress: Progress = silent) -> list[Sweep]:
    """Return sweeps up to `highest` [Hz] at those amplitudes [deg] that are within the range of commands.

    If none is, the amplitude is the limit of the range. The mean fin angle is `at` [rad], or as near to it as the
    amplitude allows within this range.
    """
    limit = float(values["command.limit"])
    chosen = [radians(size) for size in amplitudes if radians(size) <= limit * (1.0 + 1e-9)] or [limit]
    rooms = [max(limit - size, 0.0) for size in chosen]
    about = [min(max(at, -room), room) for room in rooms]
    period = float(values["controller.sample_time"])
    batch_size = max(1, int(_NUMBERS * period / ((_SETTLE + _WINDOW) * _POINTS)))
    merged: dict[int, Sweep] = {}
    missing = dict.fromkeys(range(len(chosen)), frequencies(period, highest))
    while missing:  # at first all frequencies, then those around crossings
        measured: list[Sweep] = []
        for first in range(0, len(missing), batch_size):
            batch = [(chosen[k], about[k], frequency) for k, frequency in [*missing.items()][first:first + batch_size]]
            sizes, all_hertz = np.degrees([each[0] for each in batch]), np.concatenate([each[2] for each in batch])
            progress(f"sines of {sizes[0]:g} to {sizes[-1]:g} deg, {min(all_hertz):.3g} to {max(all_hertz):.3g} Hz",
                     first, len(missing))
            measured += sines(values, batch, aero_torque, model)
        before = merged.copy()
        for k, finer in zip(missing, measured, strict=True):
            merged[k] = _joined(merged[k], finer) if k in merged else finer
        # With a long sample time, no sine with whole periods may exist between two frequencies.
        missing = {k: between for k in missing
                   if k not in before or len(merged[k].response.frequency) > len(before[k].response.frequency)
                   if len(between := _between(merged[k]))}
    return list(merged.values())
