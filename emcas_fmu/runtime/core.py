"""Samples, delay buffers and ticks of one actuator. The file is embedded in the FMU: it uses the standard library only.

core.h is the same in C; only there inputs may ramp. The state is that at the beginning of a tick
(:mod:`emcas_fmu.runtime.schedule`). At a communication point inside a tick the outputs come from a tentative step, so
that the trajectory does not depend on the host's step sizes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, NamedTuple

# Largest number of steps in a tick, each to an event or the tick's end. More are a mistake in the actuator's step().
MOST_EVENTS = 500
# Largest ratio of the time that a step takes to the rest of the tick: above 1 only by rounding.
ROUNDED = 1.0 + 1e-9
TOO_MANY_EVENTS = (f"more than {MOST_EVENTS} events in a tick: step() of the actuator does not reach the tick's end; "
                   "it must return a time above 0 and at most h")
# Largest number of ticks in one communication step. More are a mistake of the host: the step would seem to hang.
MOST_TICKS = 100_000_000
TOO_MANY_TICKS = f"more than {MOST_TICKS} ticks in one step; choose a shorter step"
REASONS = ("", "the state is no longer finite", TOO_MANY_EVENTS, TOO_MANY_TICKS)
"""Messages of the results in core_state.h (core_result)."""
# Ticks from zero to the latest start. There a double resolves an eighth of a tick. The tolerance for the rounding of
# a host's time is four eighths, the slack is at most a quarter of a tick: together less than a tick.
LATEST = 2.0**49

Functions = tuple[Callable[..., tuple[Any, ...]], ...]
Inputs = tuple[Any, ...]
# A tick that contains a communication point: the plant's time within the tick [s], the time up to which inputs are
# known [s], the inputs at the beginning, and the integrals of the loads' differences from these.
Part = tuple[float, float, Inputs, tuple[float, ...]]

FIRST = 2  # number of inputs of an actuator before the vehicle's motion: command and aero_torque


class Sizes(NamedTuple):
    """Numbers of states of plant and controller, of inputs, and of loads.

    `motion` counts the inputs of the vehicle's motion, `loads` aero_torque and the motion loads, `acting` the further
    inputs that act on the plant.
    """

    plant: int
    controller: int
    motion: int
    loads: int
    acting: int


def inputs_of(row: Sequence[Any], motion_loads: Sequence[float], motion: int, supplied: bool) -> Inputs:
    """Return a core's inputs from a `row` of the actuator's inputs, in the interface's order, and its motion loads.

    `motion` is the number of inputs of the vehicle's motion. Unless the actuator is `supplied`, its supply is 0.
    """
    supply = () if supplied else (0.0,)
    return (*row[:FIRST], *motion_loads, *supply, *row[FIRST + motion:])


def finite(value: Any) -> bool:
    """Return whether a value of a stored state is a finite number that a float can represent."""
    return (isinstance(value, float) and isfinite(value)) or (isinstance(value, int) and abs(value) <= 2**53)


def alike(value: Any, template: Any) -> bool:
    """Return whether a value consists of finite numbers, nested in tuples like the template."""
    if not isinstance(template, tuple):
        return finite(value)
    return isinstance(value, tuple) and len(value) == len(template) and all(map(alike, value, template))


class Core:
    """One actuator: its state and the functions that advance it.

    `functions` are those of the kernel, bound to the parameters; `sizes` are those of the actuator. The inputs are
    command, loads, ``supply``, ``enable`` and the further inputs.
    """

    __slots__ = ("_acting", "_active", "_commands", "_controller", "_kernel_initial", "_kernel_locate",
                 "_kernel_motion_loads", "_kernel_outputs", "_kernel_sample", "_kernel_step", "_line", "_loads",
                 "_part", "_period", "_plant", "_position", "_sampled", "_states", "_supply", "_tentative", "schedule")

    def __init__(self, functions: Functions, sizes: Sizes) -> None:
        self._states, self._controller, _, loads, acting = sizes
        self._loads, self._supply = slice(1, 1 + loads), 1 + loads  # the loads have a mean over a tick
        self._acting = slice(1, 3 + loads + acting)
        self.bind(functions)
        self.start()

    def bind(self, functions: Functions) -> None:
        """Replace the functions of the kernel, for instance after a tunable parameter has changed."""
        (kernel_schedule, self._kernel_locate, self._kernel_initial, self._kernel_sample, self._kernel_motion_loads,
         self._kernel_step, self._kernel_outputs) = functions
        period, before, after, *rest = kernel_schedule()
        self.schedule = (period, int(before), int(before) + int(after), *rest)

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        return float(self.schedule[-1])

    @property
    def latest(self) -> float:
        """Latest start [s] on a host's clock; its negative is the earliest."""
        return float(LATEST * min(self.schedule[4:6]))

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes while running, as nested tuples of numbers and None; it may be stored and restored."""
        return (self._period, self._position, self._plant, self._sampled, self._line, self._commands, self._active,
                self._part, self._tentative)

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        (self._period, self._position, self._plant, self._sampled, self._line, self._commands, self._active,
         self._part, self._tentative) = state

    def unsound(self, state: Any, now: float, inputs: Inputs) -> str:
        """Return the problem of a state that was stored at `now` [s from the start]; "" if it is sound.

        The state may be any value. This core must be at its start; `inputs` have the shape of its inputs.
        """
        length, before, ticks, _, h_before, h_after, *_, slack = self.schedule
        if not (isinstance(state, tuple) and len(state) == len(self.state)):
            return "wrong number of values"
        period, position, *numbers, part, tentative = state
        _, _, *shape, _, plant = self.state
        if not alike((*numbers, tentative), (*shape, plant)):
            return "a number is not finite"
        if not (type(period) is type(position) is int and period >= 0 and 0 <= position < ticks
                and -slack <= now - period * length <= length + slack and now * sys.float_info.epsilon <= slack):
            return "impossible position in time"
        within = h_before if position < before else h_after
        if part is not None and not (alike(part, (0.0, 0.0, inputs, self._zero_loads))
                                     and 0.0 <= part[0] <= part[1] <= within):
            return "impossible part of a tick"
        return ""

    def motion_loads(self, *motion: float) -> tuple[float, ...]:
        """Return the motion loads for inputs of the vehicle's motion; all in SI, in the order of MotionLoads."""
        loads: tuple[float, ...] = self._kernel_motion_loads(*motion)
        return loads

    def start(self) -> None:
        """Set the state at rest at the start."""
        initial = self._kernel_initial()
        plant, rest = initial[:self._states], initial[self._states:]
        limited = self._controller + 1  # index of the flag for a limit, which is not among the initial values
        # The delay buffer: the references in the drive before and after the arrival, then those still delayed.
        line = (0.0,) * (int(self.schedule[-3]) + 2)
        commands = (0.0,) * int(self.schedule[-2])
        self.state = (0, 0, plant, (*rest[:limited], 0.0, *rest[limited:]), line, commands, 0.0, None, plant)

    def outputs(self, inputs: Inputs) -> tuple[Any, ...]:
        """Return the outputs in the interface's order."""
        return self._kernel_outputs(*self._tentative, self._active, self._line[-1], *self._sampled[self._controller:],
                                    inputs[0], *inputs[self._acting])

    def run(self, end: float, inputs: Inputs) -> tuple[Any, ...]:
        """Advance to `end` [s from the start] with the inputs held, all or nothing; return the outputs there.

        Raises ArithmeticError if the step cannot be computed, ValueError for the root of a negative number.
        """
        state = self.state
        try:
            return self._run(end, inputs)
        except BaseException:
            self.state = state
            raise

    def _run(self, end: float, inputs: Inputs) -> tuple[Any, ...]:
        length, before, ticks, _, h_before, h_after, _, _, slack = self.schedule
        periods, at, rest = self._period + 1, 0, 0.0  # most hosts step from sample to sample
        if not -slack <= end - periods * length <= slack:
            periods, at, rest = self._kernel_locate(end)
        if not (periods - self._period) * ticks <= MOST_TICKS:
            raise ArithmeticError(TOO_MANY_TICKS)
        reached, to = (self._period, self._position), (int(periods), int(at))
        if to <= reached:  # time never goes back
            covered = self._part[1] if self._part is not None else 0.0
            if to < reached or rest < covered:
                rest = covered
            to = reached
        period, position = to
        # The number of ticks is computed first, so that the loop ends whatever the state was.
        for _ in range((period - self._period) * ticks + position - self._position):
            self._tick(inputs, h_before if self._position < before else h_after, True)
            self._position += 1
            if self._position == ticks:
                self._position = 0
                self._period += 1
        self._tentative = self._plant
        if rest > 0.0:
            self._tick(inputs, rest, False)
        outputs = self.outputs(inputs)
        total = sum(outputs, sum(self._tentative, sum(self._sampled)))
        if total - total != 0.0:  # infinite or not a number
            raise ArithmeticError("the state is no longer finite")
        return outputs

    def _tick(self, inputs: Inputs, until: float, whole: bool) -> None:
        """Advance to `until` [s] within a tick; if `whole`, the tick ends there, and there is no part afterwards."""
        part, origin, acting = self._part, 0.0, inputs
        if self._position == 0 and part is None:
            self._sample(inputs)
        self._active = self._line[0 if self._position < self.schedule[1] else 1]
        if part is not None:
            part = self._split(part, inputs)
            origin = part[0]
        if part is not None or not whole:
            part = self._extend(part, until, inputs)
            acting = self._mean(part)
        if whole:
            self._plant, self._part = self._finish(acting, until - origin), None
        else:
            self._tentative, self._part = self._finish(acting, until - origin), part

    def _sample(self, inputs: Inputs) -> None:
        count, command = self._controller, inputs[0]
        if self._commands:
            command, self._commands = self._commands[0], (*self._commands[1:], command)
        reference, *sampled = self._kernel_sample(*self._plant, *self._sampled[:count], *self._sampled[count + 2:],
                                                  command, *inputs[self._supply:])
        self._sampled, self._line = tuple(sampled), (*self._line[1:], reference)

    def _split(self, part: Part, inputs: Inputs) -> Part:
        """Return the part; if inputs that act through limits have changed, advance the plant and return a new part."""
        origin, covered, first, _ = part
        switched = slice(self._supply, self._acting.stop)
        if first[switched] == inputs[switched]:
            return part
        self._plant = self._finish(self._mean(part), covered - origin)
        return covered, covered, inputs, self._zero_loads

    def _finish(self, inputs: Inputs, left: float) -> tuple[float, ...]:
        """Return the plant's state after the rest of a tick, `left` [s], stepped from event to event."""
        plant: tuple[float, ...] = self._plant
        if left <= 0.0:
            return plant
        step = self._kernel_step
        acting = (*self._sampled[self._controller + 2:], self._active, *inputs[self._acting])
        for _ in range(MOST_EVENTS):
            moved = step(*plant, *acting, left)
            plant, used = moved[:-1], moved[-1]
            if left <= used <= left * ROUNDED:
                return plant
            left -= used
        raise ArithmeticError(TOO_MANY_EVENTS)

    def _extend(self, part: Part | None, until: float, inputs: Inputs) -> Part:
        if part is None:
            return 0.0, until, inputs, self._zero_loads
        origin, covered, first, sums = part
        gained = until - covered
        changes = zip(sums, inputs[self._loads], first[self._loads], strict=True)
        return origin, until, first, tuple(s + gained * (x - b) for s, x, b in changes)

    def _mean(self, part: Part) -> Inputs:
        origin, covered, first, sums = part
        if covered <= origin:
            return first
        loads = (b + s / (covered - origin) for b, s in zip(first[self._loads], sums, strict=True))
        return (first[0], *loads, *first[self._supply:])

    @property
    def _zero_loads(self) -> tuple[float, ...]:
        return (0.0,) * (self._supply - 1)
