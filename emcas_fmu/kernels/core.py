"""Schedule, delay line and stepping of one actuator. Standard library only: it is embedded in the FMU.

Time is a count of ticks. A sample period is cut where the delayed reference
reaches the drive, and each part into equal ticks no longer than the longest
allowed, so that whatever the delay, samples and arrivals fall on tick boundaries.
The state stands at a tick. A communication point inside one is served by a
tentative step from there, so that the host's step sizes leave the trajectory alone.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from itertools import pairwise
from math import ceil, floor, sqrt
from typing import Any

# Communication points this close to a tick, as a share of the sample time, lie on it: hosts
# add up their steps in floating point, and a point just short of a sample would put the
# command off by a whole one. Never more than a quarter of the shortest tick.
TOLERANCE = 1e-3
# A tick has at most a handful of events; far more means the equations cannot be followed.
_MOST_EVENTS = 500
# The drive's integral is taken at mid-tick; this keeps its own oscillation resolved.
_INTEGRAL_PHASE = 0.07

Functions = tuple[Callable[..., tuple[Any, ...]], ...]


def longest_tick(parameters: Mapping[str, Any]) -> float:
    """Upper bound [s] of a tick."""
    longest, gain = float(parameters["solver.max_tick"]), parameters["drive.ki"]
    return min(longest, _INTEGRAL_PHASE * sqrt(parameters["motor.inductance"] / gain)) if gain > 0.0 else longest


class Schedule:
    """Ticks of a sample period: `offsets` and `lengths` [s], the tick where the delayed sample arrives."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        self.sample_time = period = float(parameters["controller.sample_time"])
        delay = parameters["drive.transport_delay"] / period
        self.delay_samples = floor(delay + TOLERANCE)
        fraction = delay - self.delay_samples
        fraction = 0.0 if fraction < TOLERANCE else fraction  # the last tick of a sample is no shorter either
        longest = longest_tick(parameters)
        cuts = [0.0]
        self.arrival = ceil(fraction * period / longest * (1.0 - 1e-9))
        rest = ceil((1.0 - fraction) * period / longest * (1.0 - 1e-9))
        for begin, width, count in ((0.0, fraction, self.arrival), (fraction, 1.0 - fraction, rest)):
            cuts += [(begin + width * i / count) * period for i in range(1, count + 1)]
        self.offsets = cuts[:-1]
        self.lengths = [b - a for a, b in pairwise(cuts)]
        self.ticks = len(self.lengths)
        self.slack = min(TOLERANCE * period, 0.25 * min(self.lengths))

    def locate(self, time: float) -> tuple[int, float]:
        """Whole ticks in a time [s] from the start, and what is left of it [s]; 0 within the tolerance."""
        slack = self.slack
        period = floor((time + slack) / self.sample_time)
        within = time - period * self.sample_time
        if within <= slack:
            return period * self.ticks, 0.0
        index = bisect_right(self.offsets, within + slack) - 1
        rest = within - self.offsets[index]
        return period * self.ticks + index, rest if rest > slack else 0.0


class Core:
    """One actuator: its state and what moves it on.

    `functions` are those of the kernel bound to the parameters. The inputs are
    ``command, aero_torque, f_x, f_z, supply, enable``. `state` is everything that
    changes while running, as nested tuples of numbers; it may be kept and put back.
    """

    __slots__ = ("_forces", "_initial", "_outputs", "_sample", "_step", "schedule", "state")

    def __init__(self, functions: Functions, parameters: Mapping[str, Any]) -> None:
        self.schedule = Schedule(parameters)
        self.bind(functions)
        # Length of the delay line: the sample in the drive before and after the arrival, and those on their way.
        line = (0.0,) * (self.schedule.delay_samples + 2)
        angle, speed, current, xi, integral, counts, measured = self._initial()
        plant = (angle, speed, current, xi)
        #      tick, plant, I, counts, measured, limited, delay line, active, part of the tick done, tentative plant
        self.state: tuple[Any, ...] = (0, plant, integral, counts, measured, 0.0, line, 0.0, None, plant)

    def bind(self, functions: Functions) -> None:
        """Take the kernel's functions, anew after a tunable parameter changed."""
        self._initial, self._sample, self._forces, self._step, self._outputs = functions

    def forces(self, *arguments: float) -> tuple[float, float]:
        """Specific force in the fin's frame from acceleration (x, y, z), roll and pitch."""
        f_x, f_z = self._forces(*arguments)
        return f_x, f_z

    def outputs(self, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
        """Outputs in the order of the variable table."""
        _, _, _, _, measured, limited, line, active, _, plant = self.state
        return self._outputs(*plant, active, line[-1], measured, limited, *inputs)

    def run(self, end: float, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start with the inputs held, all or nothing; gives the outputs there.

        Raises ArithmeticError where the equations cannot be followed.
        """
        tick, plant, integral, counts, measured, limited, line, active, part, tentative = self.state
        angle, speed, current, xi = plant
        schedule, step = self.schedule, self._step
        lengths, arrival, ticks = schedule.lengths, schedule.arrival, schedule.ticks
        target, rest = schedule.locate(end)
        if target <= tick:  # never back
            target, rest = max((target, rest), (tick, part[1] if part else 0.0))
        enable = inputs[5]
        while tick < target:
            index = tick % ticks
            h = lengths[index]
            acting = inputs
            if part is not None:
                origin, _, begun, _ = part
                if begun[_SWITCHED] != inputs[_SWITCHED]:
                    angle, speed, current, xi, part = self._split((angle, speed, current, xi), active, part, inputs)
                    origin = part[0]
                acting = _mean(_extended(part, h, inputs))
                part = None
                h -= origin
            elif index == 0:
                reference, integral, counts, measured, limited = self._sample(
                    angle, speed, integral, counts, inputs[0], enable)
                line = (*line[1:], reference)
            active = line[0] if index < arrival else line[1]
            _, aero_torque, f_x, f_z, supply, on = acting
            angle, speed, current, xi, used = step(
                angle, speed, current, xi, active, aero_torque, f_x, f_z, supply, on, h)
            if used < h:
                angle, speed, current, xi = self._finish((angle, speed, current, xi), active, acting, h - used)
            tick += 1
        plant = tentative = (angle, speed, current, xi)
        if rest:
            index = tick % ticks
            if index == 0 and part is None:
                reference, integral, counts, measured, limited = self._sample(
                    angle, speed, integral, counts, inputs[0], enable)
                line = (*line[1:], reference)
            active = line[0] if index < arrival else line[1]
            if part is not None and part[2][_SWITCHED] != inputs[_SWITCHED]:
                *moved, part = self._split(plant, active, part, inputs)
                plant = tuple(moved)
            part = _extended(part, rest, inputs)
            tentative = self._finish(plant, active, _mean(part), rest - part[0])
        total = sum(tentative)
        if total - total != 0.0:  # infinite or not a number
            raise ArithmeticError("the state is no longer finite")
        outputs = self._outputs(*tentative, active, line[-1], measured, limited, *inputs)
        self.state = (tick, plant, integral, counts, measured, limited, line, active, part, tentative)
        return outputs

    def _split(self, plant: tuple[float, ...], active: float, part: _Part, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
        """The plant moved on to where a tick has been covered to, and a part that starts there with the inputs."""
        origin, covered, _, _ = part
        return *self._finish(plant, active, _mean(part), covered - origin), (covered, covered, inputs, _NOTHING)

    def _finish(self, plant: tuple[float, ...], active: float, inputs: tuple[Any, ...],
                left: float) -> tuple[float, ...]:
        """Step over what is left of a tick [s], from event to event."""
        _, *acting = inputs
        whole = left
        if left <= 0.0:
            return plant
        for _ in range(_MOST_EVENTS):
            *after, used = self._step(*plant, active, *acting, left)
            plant = tuple(after)
            if used >= left:
                return plant
            left -= used
        raise ArithmeticError(f"more than {_MOST_EVENTS} events in {whole} s")


# Inputs that change inside a tick act by their time-weighted mean over it. A part is (time in
# the tick where the plant stands, time covered, inputs there, integrals of the loads' differences).
_Part = tuple[float, float, tuple[Any, ...], tuple[float, ...]]
_LOADS = slice(1, 4)  # of the inputs: what has a mean
_SWITCHED = slice(4, 6)  # supply and enable act through limits: where they change, the tick is split
_NOTHING = (0.0, 0.0, 0.0)


def _extended(part: _Part | None, until: float, inputs: tuple[Any, ...]) -> _Part:
    if part is None:
        return 0.0, until, inputs, _NOTHING
    origin, done, base, sums = part
    gained = until - done
    changes = zip(sums, inputs[_LOADS], base[_LOADS], strict=True)
    return origin, until, base, tuple(s + gained * (x - b) for s, x, b in changes)


def _mean(part: _Part) -> tuple[Any, ...]:
    origin, covered, base, sums = part
    if covered <= origin:
        return base
    loads = (b + s / (covered - origin) for b, s in zip(base[_LOADS], sums, strict=True))
    return (base[0], *loads, *base[_SWITCHED])
