"""Delay line and stepping of one actuator. Standard library only: it is embedded in the FMU.

The state stands at a tick (:mod:`emcas_fmu.schedule`). A communication point inside one
is served by a tentative step from there, so that the host's step sizes leave the
trajectory alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# A tick has at most a handful of events; far more means the equations cannot be followed.
MOST_EVENTS = 500
# In one communication step; more is a slip of the host's and would seem to hang.
MOST_TICKS = 100_000_000

Functions = tuple[Callable[..., tuple[Any, ...]], ...]
Inputs = tuple[Any, ...]
Ramp = tuple[float, tuple[float, ...]]


class Core:
    """One actuator: its state and what moves it on.

    `functions` are those of the kernel bound to the parameters, `kept` and `shown` the numbers of states that a
    sample keeps to itself and shows. The inputs are ``command, aero_torque, f_x, f_z, supply, enable`` and the
    model's own. `state` is everything that changes while running, as nested tuples of numbers; it may be kept and
    put back.
    """

    __slots__ = ("_forces", "_initial", "_kept", "_locate", "_outputs", "_sample", "_step", "schedule", "state")

    def __init__(self, functions: Functions, kept: int = 2, shown: int = 2) -> None:
        self.bind(functions)
        self._kept = kept
        *_, samples, _ = self.schedule
        # Length of the delay line: the sample in the drive before and after the arrival, and those on their way.
        line = (0.0,) * (int(samples) + 2)
        begun = self._initial()
        plant = begun[:1 - shown - kept]
        measured, *held = begun[1 - shown:]
        #      tick, plant, kept, shown, delay line, active, part of the tick done, tentative plant
        self.state: tuple[Any, ...] = (0, plant, begun[len(plant):len(plant) + kept], (measured, 0.0, *held), line, 0.0,
                                       None, plant)

    def bind(self, functions: Functions) -> None:
        """Take the kernel's functions, anew after a tunable parameter changed."""
        schedule, self._locate, self._initial, self._sample, self._forces, self._step, self._outputs = functions
        period, before, after, *rest = schedule()
        self.schedule = (period, int(before), int(before) + int(after), *rest)

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        slack: float = self.schedule[-1]
        return slack

    def forces(self, *arguments: float) -> tuple[float, float]:
        """Specific force in the fin's frame from acceleration (x, y, z), roll and pitch."""
        f_x, f_z = self._forces(*arguments)
        return f_x, f_z

    def outputs(self, inputs: Inputs) -> tuple[Any, ...]:
        """Outputs in the order of the variable table."""
        _, _, _, shown, line, active, _, plant = self.state
        return self._outputs(*plant, active, line[-1], *shown, *inputs[:_OWN])

    def run(self, end: float, inputs: Inputs, ramp: Ramp | None = None) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start, all or nothing; gives the outputs there.

        The inputs are held, or with `ramp` = (begin [s], rates of change of those before ``enable``)
        are those at `begin` and change at these rates. A tick takes them at its middle.
        Raises ArithmeticError where the equations cannot be followed.
        """
        tick, plant, kept, shown, line, active, part, tentative = self.state
        period, before, ticks, arrival, h_before, h_after, _, _ = self.schedule
        step = self._step
        periods, position, rest = self._locate(end)
        target = int(periods) * ticks + int(position)
        if target <= tick:  # never back
            target, rest = max((target, rest), (tick, part[1] if part else 0.0))
        if target - tick > MOST_TICKS:
            raise ArithmeticError(f"{target - tick} ticks in one step are more than {MOST_TICKS}")
        acting = inputs
        while tick < target:
            index = tick % ticks
            h = h_before if index < before else h_after
            if ramp is not None:
                begun = tick // ticks * period + (index * h if index < before else arrival + (index - before) * h)
                acting = _ramped(inputs, ramp, begun + 0.5 * (h + part[1] if part else h))
            if part is not None:
                origin, _, first, _ = part
                if first[_SWITCHED] != acting[_SWITCHED]:
                    plant, part = self._split(plant, shown, active, part, acting)
                    origin = part[0]
                acting = _mean(_extended(part, h, acting))
                part = None
                h -= origin
            elif index == 0:
                kept, shown, line = self._sampled(
                    plant, kept, shown, line, inputs if ramp is None else _ramped(inputs, ramp, begun))
            active = line[0] if index < before else line[1]
            moved = step(*plant, *shown[2:], active, *acting[_ACTING], h)
            plant, used = moved[:-1], moved[-1]
            if used < h:
                plant = self._finish(plant, shown, active, acting, h - used)
            tick += 1
            acting = inputs
        tentative = plant
        if rest:
            index = tick % ticks
            if ramp is not None:
                begun = tick // ticks * period + (
                    index * h_before if index < before else arrival + (index - before) * h_after)
                acting = _ramped(inputs, ramp, begun + 0.5 * (rest + part[1] if part else rest))
            if index == 0 and part is None:
                kept, shown, line = self._sampled(
                    plant, kept, shown, line, inputs if ramp is None else _ramped(inputs, ramp, begun))
            active = line[0] if index < before else line[1]
            if part is not None and part[2][_SWITCHED] != acting[_SWITCHED]:
                plant, part = self._split(plant, shown, active, part, acting)
            part = _extended(part, rest, acting)
            tentative = self._finish(plant, shown, active, _mean(part), rest - part[0])
        final = inputs if ramp is None else _ramped(inputs, ramp, end)
        outputs = self._outputs(*tentative, active, line[-1], *shown, *final[:_OWN])
        total = sum(outputs, sum(tentative, sum(kept, sum(shown))))
        if total - total != 0.0:  # infinite or not a number
            raise ArithmeticError("the state is no longer finite")
        self.state = (tick, plant, kept, shown, line, active, part, tentative)
        return outputs

    def _sampled(self, plant: tuple[float, ...], kept: tuple[float, ...], shown: tuple[float, ...],
                 line: tuple[float, ...], inputs: Inputs) -> tuple[tuple[float, ...], ...]:
        """What the controllers keep and show after a sample, and the delay line."""
        command, _, _, _, *rest = inputs
        reference, *found = self._sample(*plant, *kept, *shown[2:], command, *rest)
        return tuple(found[:self._kept]), tuple(found[self._kept:]), (*line[1:], reference)

    def _split(self, plant: tuple[float, ...], shown: tuple[float, ...], active: float, part: _Part,
               inputs: Inputs) -> tuple[Any, ...]:
        """The plant moved on to where a tick has been covered to, and a part that starts there with the inputs."""
        origin, covered, _, _ = part
        return self._finish(plant, shown, active, _mean(part), covered - origin), (covered, covered, inputs, _NOTHING)

    def _finish(self, plant: tuple[float, ...], shown: tuple[float, ...], active: float, inputs: Inputs,
                left: float) -> tuple[float, ...]:
        """Step over what is left of a tick [s], from event to event."""
        held, acting = shown[2:], inputs[_ACTING]
        whole = left
        if left <= 0.0:
            return plant
        for _ in range(MOST_EVENTS):
            moved = self._step(*plant, *held, active, *acting, left)
            plant, used = moved[:-1], moved[-1]
            if used >= left:
                return plant
            left -= used
        raise ArithmeticError(f"more than {MOST_EVENTS} events in {whole} s")


# Inputs that change inside a tick act by their time-weighted mean over it. A part is (time in
# the tick where the plant stands, time covered, inputs there, integrals of the loads' differences).
_Part = tuple[float, float, tuple[Any, ...], tuple[float, ...]]
_LOADS = slice(1, 4)  # of the inputs: what has a mean
_ACTING = slice(1, 6)  # on the plant
_OWN = 6  # a model's own stand behind; only samples see them
_SWITCHED = slice(4, 6)  # supply and enable act through limits: where they change, the tick is split
_NOTHING = (0.0, 0.0, 0.0)


def _ramped(inputs: Inputs, ramp: Ramp, time: float) -> Inputs:
    begin, rates = ramp
    changing, rest = inputs[:5], inputs[5:]
    return (*(x + rate * (time - begin) for x, rate in zip(changing, rates, strict=True)), *rest)


def _extended(part: _Part | None, until: float, inputs: Inputs) -> _Part:
    if part is None:
        return 0.0, until, inputs, _NOTHING
    origin, done, base, sums = part
    gained = until - done
    changes = zip(sums, inputs[_LOADS], base[_LOADS], strict=True)
    return origin, until, base, tuple(s + gained * (x - b) for s, x, b in changes)


def _mean(part: _Part) -> Inputs:
    origin, covered, base, sums = part
    if covered <= origin:
        return base
    loads = (b + s / (covered - origin) for b, s in zip(base[_LOADS], sums, strict=True))
    return (base[0], *loads, *base[4:])
