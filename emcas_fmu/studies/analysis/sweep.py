"""Frequency response of the actuator against amplitude: the describing function, by stepped sines.

At each amplitude and frequency, a sine is simulated to its steady state. The describing function is the fundamental of
the fin angle over that of the command (Gelb & Vander Velde, "Multiple-Input Describing Functions", section 2.2). For
actuators with all of NEEDS, the outputs also show when each limit acts; for the limit of the speed reference, the
controllers are computed again along the recorded motion. Additional sines refine the bandwidths and the lowest
frequency at which each limit acts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import inf, radians

import numpy as np

from ...actuators import capabilities
from ...actuators.declaration import SampleInputs
from ...actuators.positional import identifier
from ...bench.excitation import COMMAND, LOAD
from ...bench.frequency_response import FrequencyResponse, Sines, of_ratio
from ...bench.metrics import CREPT
from ...bench.subject import Subject
from ...control import command_bus
from ...namespace import Record, with_values
from ...ops.arrays import ARRAYS
from ...ops.floats import FLOATS
from ...physics import drive, inverter
from ...simulation import Array
from ...support.progress import Progress, silent

AMPLITUDES = (0.1, 0.3, 1.0, 2.0, 3.5, 6.0, 10.0, 15.0, 20.0)  # deg, of the command
LIMITS = ("rate", "current", "voltage", "dac")
"""Keys of the limits of speed reference, drive current, supply voltage and analogue reference."""
NEEDS = (capabilities.SCREW_EQUATIONS, capabilities.CASCADE, capabilities.CURRENT_LIMIT, capabilities.VOLTAGE_LIMIT,
         capabilities.REFERENCE_LIMIT, capabilities.RIGID_DRIVE_LINE, capabilities.MOTOR_CURRENT,
         capabilities.CURRENT_LOOP)
_TRANSIENT, _FITTED = (0.0, 1.0), (1.0, 2.0)  # smallest numbers of cycles, and shortest times [s]
_LOWEST = 0.5  # Hz
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


def sines(subject: Subject, amplitude: Array, frequency: Array, at: Array | float = 0.0, aero_torque: float = 0.0
          ) -> Array:
    """Return the describing function, and the share of time [1] in which each of LIMITS acts, as columns [runs, 5].

    Each run has an `amplitude` [rad], a `frequency` [Hz] and a mean fin angle `at` [rad]; `aero_torque` [N.m] is
    constant. Without all of NEEDS the shape is [runs, 1]. All sines are simulated together, since :func:`replay` takes
    as long for one as for a hundred. Raises EmcasError if a response cannot be computed.
    """
    stepped = Sines(frequency, _TRANSIENT, _FITTED, float(subject.values["controller.sample_time"]))
    wave, mean = stepped.excitation(1.0), np.broadcast_to(at, len(frequency))
    command = mean[:, np.newaxis] + amplitude[:, np.newaxis] * wave.command
    runs = subject.run_all(wave.holding({COMMAND: command, LOAD: aero_torque}), {"fin.start_angle": mean},
                           [name for name in _RECORDED if name in subject.outputs])
    for k in range(len(runs)):
        runs[k].finished()
    angle = runs.columns["fin_angle"]
    # Backlash absorbs the sine where the remaining motion is rounding.
    moved = np.array([np.ptp(rows) > CREPT for rows in stepped.rows(angle)])
    acting = _acting(subject, mean, command, runs.columns) if subject.actuator.provides.issuperset(NEEDS) else []
    return np.column_stack([np.where(moved, 1j * stepped.fit(angle) / amplitude, 0.0),
                            *([np.mean(rows) for rows in stepped.rows(limit)] for limit in acting)])


def _acting(subject: Subject, start: Array, command: Array, outputs: Mapping[str, Array]) -> list[Array]:
    """Return whether each of LIMITS acts [runs, rows]; see :func:`replay`."""
    actuator = subject.actuator
    p = actuator.equation_parameters(FLOATS, actuator.namespace(subject.values))
    u, current, applied = (outputs[name] for name in ("drive_reference", "motor_current", "motor_voltage"))
    supply = outputs.get("link_voltage", p.drive.supply_voltage)
    if actuator.structure.inverter:  # the limit is that of the voltage before the loss by the dead time
        applied = applied + inverter.dead_resistance(ARRAYS, p, supply, current) * current
    limit = outputs.get("current_limit", p.drive.current_limit)  # the extension heat reduces this limit
    return [replay(subject, start, command, outputs)[1], np.abs(drive.current_reference_raw(p, u)) > limit,
            np.abs(applied) >= _AT_LIMIT * drive.voltage_limit(ARRAYS, p, supply, outputs["motor_speed"], current),
            np.abs(u) >= p.drive.reference_limit]


def replay(subject: Subject, start: Array, command: Array, motion: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return the controllers' reference [V], and whether they limit the speed reference, along recorded motions.

    Arrays are [runs, samples]: fin `command` [rad]; in `motion`, SI, the states that the controllers read. Each motion
    begins at rest at its fin angle `start` [rad]. As in the core, the command arrives after the bus's latency.
    """
    actuator = subject.actuator
    p = actuator.namespace(subject.values)
    # In the second row of each result, no other limit of the controllers can act.
    p = with_values(p, {"drive.reference_limit": np.array([[p.drive.reference_limit], [inf]]),
                        "command.limit": np.array([[p.command.limit], [inf]])})
    starts = {v.name: v.initial(subject.values) for v in subject.inputs.values()}
    others = {"supply": starts[subject.supply or ""], "enable": True,
              **{identifier(v.name): starts[v.name] for v in actuator.further_inputs}}
    states = motion.keys() & {s.name for s in actuator.states}
    x, latency = actuator.start(ARRAYS, p, start), int(command_bus.latency(FLOATS, p))
    delayed = np.concatenate([np.zeros((latency, len(command))), command.T])
    reference, limited = np.empty_like(command), np.empty(command.shape, dtype=bool)
    for k in range(command.shape[1]):
        before = Record(**x | {name: motion[name][:, k] for name in states})
        after = actuator.commanded(ARRAYS, p, before, SampleInputs(
            command=delayed[k], position=actuator.position(ARRAYS, p, before), **others))
        limited[:, k] = np.broadcast_to(after["limited"], (2, len(command)))[1]
        x |= {name: value[0] if np.ndim(value) == 2 else value for name, value in after.items()}
        reference[:, k] = x["reference"]
    return reference, limited


def shared(sweeps: Sequence[Sweep]) -> list[Array]:
    """Return for each sweep the mask of those frequencies that all sweeps have in common."""
    common = reduce(np.intersect1d, (s.response.frequency for s in sweeps))
    return [np.isin(s.response.frequency, common) for s in sweeps]


def _between(s: Sweep) -> list[float]:
    """Return frequencies [Hz] that divide the gaps in which the sweep first reaches a level, unless they are narrow."""
    f, added = s.response.frequency, set[float]()
    for reached in (s.response.gain_db <= -3.0, s.response.phase <= -np.pi / 2.0, *(s.active > 0.0)):
        k = int(np.argmax(reached))
        if reached[k] and k and f[k] - f[k - 1] > _RESOLVED * f[k]:
            added.update(np.linspace(f[k - 1], f[k], _PARTS + 1)[1:-1].tolist())
    return sorted(added)


def _sweep(amplitude: float, measured: Mapping[float, Array]) -> Sweep:
    """Return the sweep with the results of :func:`sines` by frequency [Hz]."""
    frequency = sorted(measured)
    ratio, *active = np.array([measured[each] for each in frequency]).T
    return Sweep(amplitude, of_ratio(np.array(frequency), ratio), np.real(active))


def sweeps(subject: Subject, highest: float, at: float = 0.0, aero_torque: float = 0.0,
           amplitudes: Sequence[float] = AMPLITUDES, progress: Progress = silent) -> list[Sweep]:
    """Return sweeps up to `highest` [Hz] at those amplitudes [deg] that are within the range of commands.

    If none is, the amplitude is the limit of the range. The mean fin angle is `at` [rad], or as near to it as the
    amplitude allows within this range.
    """
    limit, period = subject.command_limit, float(subject.values["controller.sample_time"])
    chosen = np.array([radians(size) for size in amplitudes if radians(size) <= limit * (1.0 + 1e-9)] or [limit])
    rooms = np.maximum(limit - chosen, 0.0)
    about = np.clip(at, -rooms, rooms)
    grid = np.geomspace(_LOWEST, min(highest, 0.4 / period), _POINTS).tolist()
    batch_size = max(1, int(_NUMBERS * period / (_TRANSIENT[1] + _FITTED[1])))
    measured: list[dict[float, Array]] = [{} for _ in chosen]
    missing = [(k, frequency) for k in range(len(chosen)) for frequency in grid]
    while missing:  # at first all frequencies, then those around crossings
        for first in range(0, len(missing), batch_size):
            k, frequency = map(np.array, zip(*missing[first:first + batch_size], strict=True))
            progress(f"sines of {frequency.min():.3g} to {frequency.max():.3g} Hz", first, len(missing))
            results = sines(subject, chosen[k], frequency, about[k], aero_torque)
            for row, each, result in zip(k.tolist(), frequency.tolist(), results, strict=True):
                measured[row][each] = result
        made = [_sweep(*each) for each in zip(chosen.tolist(), measured, strict=True)]
        missing = [(k, frequency) for k, s in enumerate(made) for frequency in _between(s)]
    return made
