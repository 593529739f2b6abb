"""Several fins that share one supply line. The file is embedded in the FMU: it uses the standard library only.

multi_fin.h is the same in C, and describes how the line is stepped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .core import MOST_TICKS, TOO_MANY_TICKS, Core, Functions, Inputs, Sizes, alike, finite, inputs_of

_CORE = 7  # number of functions that a core needs; mixing and the functions of the line follow
_COURSE = _CORE + 6  # index of line_course, which only fins that store charge have

Outputs = Sequence[tuple[Any, ...]]


class MultiFin:
    """Cores of several fins, with the interface of one.

    `functions` are those of the kernel, bound to each fin's parameters. The inputs are a tuple for each fin, with the
    source's supply. The outputs are those of the line (voltage [V] or pressure [Pa] at the fins; total current [A] or
    flow [m3/s]; total power [W]), then those of each fin. `line` are the line's parameters: the first is 0 if the line
    is stiff, the last is its update time [s]. `power` is the index of the supply power among a fin's outputs; None for
    fins without a supply, which have no line. `sizes` are those of a core.
    """

    __slots__ = ("_charges", "_functions", "_instant", "_line", "_mean", "_motion", "_of_line", "_power", "_powers",
                 "_supply", "cores")

    def __init__(self, functions: Sequence[Functions], line: Sequence[float], power: int | None,
                 sizes: Sizes) -> None:
        self.cores = [Core(f[:_CORE], sizes) for f in functions]
        self._functions = list(functions)
        self._line, self._power = tuple(line), power
        self._motion, self._supply = sizes.motion, 1 + sizes.loads  # number of motion inputs, index of the supply
        self._of_line = () if power is None else self._functions[0][_CORE + 4](*self._line)
        self._instant, self._mean = 1, 0.0
        self._charges = (0.0,) * len(self.cores) if len(self._functions[0]) > _COURSE else ()
        self._powers = self._charges  # mean powers [W] over the last interval, of fins that store charge

    def bind(self, functions: Sequence[Functions]) -> None:
        """Replace the functions of the kernel, for instance after a tunable parameter has changed."""
        self._functions = list(functions)
        for core, f in zip(self.cores, functions, strict=True):
            core.bind(f[:_CORE])

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        return min(core.slack for core in self.cores)

    @property
    def latest(self) -> float:
        """Latest start [s] on a host's clock; its negative is the earliest."""
        return min(core.latest for core in self.cores)

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes while running, as nested tuples of numbers and None; it may be stored and restored."""
        return (self._of_line, self._consumption, self._instant, tuple(core.state for core in self.cores))

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        self._of_line, (self._mean, self._charges, self._powers), self._instant, states = state
        for core, one in zip(self.cores, states, strict=True):
            core.state = one

    @property
    def _consumption(self) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        return self._mean, self._charges, self._powers

    def unsound(self, state: Any, now: float, inputs: Inputs) -> str:
        """Return the problem of a state that was stored at `now` [s from the start]; see :meth:`Core.unsound`."""
        if not (isinstance(state, tuple) and len(state) == 4):
            return "wrong number of values"
        of_line, consumption, instant, states = state
        if not (isinstance(states, tuple) and len(states) == len(self.cores)):
            return "wrong number of fins"
        if problem := next(filter(None, (core.unsound(one, now, inputs)
                                         for core, one in zip(self.cores, states, strict=True))), ""):
            return problem
        if not alike((of_line, consumption), (self._of_line, self._consumption)):
            return "impossible state of the supply's line"
        possible = type(instant) is int and instant >= 1 and finite(instant)
        if possible and self._line and self._line[0] > 0.0:
            # The next instant of a line that is not stiff is at most an interval ahead, apart from rounding.
            ahead, interval = instant * self._line[-1] - now, self._line[-1]
            possible = 0.0 <= ahead <= interval + 1e-9
        return "" if possible else "impossible time of the supply's line"

    def motion_loads(self, *motion: float) -> list[tuple[float, ...]]:
        """Return each fin's motion loads for inputs of the vehicle's motion; all in SI, in the order of MotionLoads."""
        return [core.motion_loads(*motion) for core in self.cores]

    def acting(self, rows: Sequence[Sequence[Any]], motion_loads: Sequence[Sequence[float]], mixing: Sequence[float]
               ) -> tuple[Inputs, ...]:
        """Return each fin's core inputs from its actuator's inputs, its motion loads and the mixing commands."""
        inputs = [inputs_of(row, loads, self._motion, self._power is not None)
                  for row, loads in zip(rows, motion_loads, strict=True)]
        return tuple((*f[_CORE](command, *mixing), *rest)
                     for f, (command, *rest) in zip(self._functions, inputs, strict=True))

    def outputs(self, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Return the outputs of the line, then those of each fin, in the interface's order."""
        each = [core.outputs(self._at_line(i)) for core, i in zip(self.cores, inputs, strict=True)]
        return self._all_outputs(inputs[0][self._supply], each)

    def run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Advance to `end` [s from the start] with the inputs held, all or nothing; return the outputs there.

        Raises ArithmeticError if the step cannot be computed, ValueError for the root of a negative number.
        """
        state = self.state
        try:
            return self._run(end, inputs)
        except BaseException:
            self.state = state
            raise

    def _run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        last, source, stiff = end + self.slack, inputs[0][self._supply], self._stiff
        interval = self._line[-1] if self._line else 1.0
        if not stiff and not end / interval - self._instant <= MOST_TICKS:
            raise ArithmeticError(TOO_MANY_TICKS)
        # By rounding, a host's time may be slightly before an instant at which its step ends.
        while not stiff and (following := self._instant * interval) <= last:
            consumption = self._consumed_next(source, self._run_fins(min(following, end), inputs))
            state = self._following(source, consumption)
            if any(value - value != 0.0 for value in state):
                raise ArithmeticError("the state is no longer finite")
            self._of_line = state
            self._instant += 1
        return self._all_outputs(source, self._run_fins(end, inputs))

    @property
    def _stiff(self) -> bool:
        return not (self._line and self._line[0] > 0.0)

    def _run_fins(self, until: float, inputs: Sequence[Inputs]) -> Outputs:
        return [core.run(until, self._at_line(i)) for core, i in zip(self.cores, inputs, strict=True)]

    def _at_line(self, inputs: Inputs) -> Inputs:
        """Return a fin's inputs with the voltage or pressure of the line as supply, instead of the source's."""
        if self._power is None:
            return inputs
        return (*inputs[:self._supply], self._level(inputs[self._supply]), *inputs[self._supply + 1:])

    def _level(self, source: float) -> float:
        (level,) = self._functions[0][_CORE + 1](source, *self._of_line)
        return level  # type: ignore[no-any-return]

    def _shared(self, source: float, each: Outputs) -> tuple[float, float, float]:
        """Return the outputs of the line: voltage or pressure, total current or flow, and total power [W]."""
        power = 0.0  # summed as in C; sum() compensates rounding from Python 3.12 on
        for outputs in each:
            power += outputs[self._power or 0]
        level = self._level(source)
        (consumption,) = self._functions[0][_CORE + 2](power, level)
        return level, consumption, power

    def _consumed_next(self, source: float, each: Outputs) -> float:
        """Return the current or flow that the fins consume from now on; store past mean, charges and mean powers."""
        level, consumption, _ = self._shared(source, each)
        self._mean = consumption
        if not self._charges:
            return consumption
        consumption = self._mean = 0.0
        charges, powers, interval = [], [], self._line[-1]
        for core, f, outputs, before in zip(self.cores, self._functions, each, self._charges, strict=True):
            (current,) = f[_CORE + 2](outputs[self._power or 0], level)
            charge, ahead = f[_COURSE](interval, current, before, *core.state[-1])  # the plant's states there
            mean = (charge - before) / interval
            consumption += ahead
            self._mean += mean
            charges.append(charge)
            powers.append(level * mean)
        self._charges, self._powers = tuple(charges), tuple(powers)
        return consumption

    def _following(self, source: float, consumption: float) -> tuple[float, ...]:
        total = 0.0  # of the inverse inductances
        for f in self._functions:
            (inverse,) = f[_CORE + 5](self._line[-1])
            total += inverse
        return self._functions[0][_CORE + 3](*self._line, source, *self._of_line, consumption, self._mean, total)

    def _all_outputs(self, source: float, each: Outputs) -> tuple[Any, ...]:
        """Return all outputs; without a stiff line, current and powers of fins that store charge are interval means."""
        if self._power is None:
            return tuple(x for outputs in each for x in outputs)
        averaged = self._charges and not self._stiff
        if averaged:
            k = self._power
            each = [(*outputs[:k], power, *outputs[k + 1:]) for outputs, power in zip(each, self._powers, strict=True)]
        level, consumption, power = self._shared(source, each)
        return (level, self._mean if averaged else consumption, power, *(x for outputs in each for x in outputs))
