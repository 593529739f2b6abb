"""Several fins that share one supply line. Standard library only: this file is embedded in the FMU.

multi_fin.h is the same in C, and explains how the line is stepped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .core import MOST_TICKS, Core, Functions, Inputs, Sizes, alike, finite, inputs_of

_CORE = 7  # functions that a core needs; mixing and the functions of the line follow
_COURSE = _CORE + 6  # of fins that store charge only

Outputs = Sequence[tuple[Any, ...]]


class MultiFin:
    """Cores of several fins, with the interface of one.

    `functions` are the kernel's, bound to each fin's parameters. The inputs are a tuple for each fin, with the source's
    supply. The outputs are those of the line (level at the fins, what the fins consume, power [W]), then those of the
    fins one by one. `line` are the line's parameters: the first is 0 if the line is stiff, the last is its update time
    [s]. `power` is the index of the supply power among a fin's outputs, None for fins without a supply, which have no
    line. `sizes` are those of a core.
    """

    __slots__ = ("_charges", "_functions", "_instant", "_line", "_mean", "_motion", "_of_line", "_power", "_powers",
                 "_supply", "cores")

    def __init__(self, functions: Sequence[Functions], line: Sequence[float], power: int | None,
                 sizes: Sizes) -> None:
        self.cores = [Core(f[:_CORE], sizes) for f in functions]
        self._functions = list(functions)
        self._line, self._power = tuple(line), power
        self._motion, self._supply = sizes.motion, 1 + sizes.loads  # of a core's inputs
        self._of_line = () if power is None else self._functions[0][_CORE + 4](*self._line)
        self._instant, self._mean = 1, 0.0
        self._charges = (0.0,) * len(self.cores) if len(self._functions[0]) > _COURSE else ()
        self._powers = self._charges  # means over the last interval, of fins that store charge

    def bind(self, functions: Sequence[Functions]) -> None:
        """Use these functions of the kernel, for instance after a tunable parameter has changed."""
        self._functions = list(functions)
        for core, f in zip(self.cores, functions, strict=True):
            core.bind(f[:_CORE])

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        return min(core.slack for core in self.cores)

    @property
    def latest(self) -> float:
        """Latest time of a host's clock [s]; its negative is the earliest."""
        return min(core.latest for core in self.cores)

    @property
    def state(self) -> tuple[Any, ...]:
        """Everything that changes while running."""
        return (self._of_line, self._consumed, self._instant, tuple(core.state for core in self.cores))

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        self._of_line, (self._mean, self._charges, self._powers), self._instant, states = state
        for core, one in zip(self.cores, states, strict=True):
            core.state = one

    @property
    def _consumed(self) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        return self._mean, self._charges, self._powers

    def unsound(self, state: Any, now: float, inputs: Inputs) -> str:
        """Return the problem of a state that was stored at `now` [s] from the start; see :meth:`Core.unsound`."""
        if not (isinstance(state, tuple) and len(state) == 4):
            return "wrong number of values"
        of_line, drawn, instant, states = state
        if not (isinstance(states, tuple) and len(states) == len(self.cores)):
            return "wrong number of fins"
        if problem := next(filter(None, (core.unsound(one, now, inputs)
                                         for core, one in zip(self.cores, states, strict=True))), ""):
            return problem
        if not alike((of_line, drawn), (self._of_line, self._consumed)):
            return "impossible state of the supply's line"
        possible = type(instant) is int and instant >= 1 and finite(instant)
        if possible and self._line and self._line[0] > 0.0:
            # The next instant of a line that is not stiff is later, by an interval and its rounding at most.
            ahead, interval = instant * self._line[-1] - now, self._line[-1]
            possible = 0.0 <= ahead <= interval + 1e-9
        return "" if possible else "impossible time of the supply's line"

    def motion_loads(self, *motion: float) -> list[tuple[float, ...]]:
        """Return each fin's loads of the vehicle's motion, from its inputs; all in SI, in the order of MotionLoads."""
        return [core.motion_loads(*motion) for core in self.cores]

    def acting(self, rows: Sequence[Sequence[Any]], motion_loads: Sequence[Sequence[float]], mixing: Sequence[float]
               ) -> tuple[Inputs, ...]:
        """Return each fin's core inputs from its actuator's inputs, its motion loads and the mixing commands."""
        inputs = [inputs_of(row, loads, self._motion, self._power is not None)
                  for row, loads in zip(rows, motion_loads, strict=True)]
        return tuple((*f[_CORE](command, *mixing), *rest)
                     for f, (command, *rest) in zip(self._functions, inputs, strict=True))

    def outputs(self, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Return the outputs of the line, then of the fins in the interface's order."""
        each = [core.outputs(self._supplied(i)) for core, i in zip(self.cores, inputs, strict=True)]
        return self._put_out(inputs[0][self._supply], each)

    def run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Advance to `end` [s] from the start with the inputs held, all or nothing; return the outputs there.

        Raises ArithmeticError if the equations cannot be followed.
        """
        before = self.state
        try:
            return self._run(end, inputs)
        except BaseException:
            self.state = before
            raise

    def _run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        last, source, stiff = end + self.slack, inputs[0][self._supply], self._stiff
        interval = self._line[-1] if self._line else 1.0
        if not stiff and not end / interval - self._instant <= MOST_TICKS:
            raise ArithmeticError(f"a step to {end!r} s has more than {MOST_TICKS} instants of the line")
        # A host's clock may be slightly before an instant that it means to have reached.
        while not stiff and (following := self._instant * interval) <= last:
            drawn = self._drawn(source, self._run_fins(min(following, end), inputs))
            state = self._following(source, drawn)
            if any(value - value != 0.0 for value in state):
                raise ArithmeticError("the state is no longer finite")
            self._of_line = state
            self._instant += 1
        return self._put_out(source, self._run_fins(end, inputs))

    @property
    def _stiff(self) -> bool:
        return not (self._line and self._line[0] > 0.0)

    def _run_fins(self, until: float, inputs: Sequence[Inputs]) -> Outputs:
        return [core.run(until, self._supplied(i)) for core, i in zip(self.cores, inputs, strict=True)]

    def _supplied(self, inputs: Inputs) -> Inputs:
        """Return a fin's inputs with the line's level as supply, instead of the source's."""
        if self._power is None:
            return inputs
        return (*inputs[:self._supply], self._level(inputs[self._supply]), *inputs[self._supply + 1:])

    def _level(self, source: float) -> float:
        (level,) = self._functions[0][_CORE + 1](source, *self._of_line)
        return level  # type: ignore[no-any-return]

    def _shared(self, source: float, each: Outputs) -> tuple[float, float, float]:
        """Return the outputs of the line from the fins': its level, what the fins consume, and their power [W]."""
        power = 0.0  # added in C's order; sum() compensates rounding from Python 3.12 on
        for outputs in each:
            power += outputs[self._power or 0]
        level = self._level(source)
        (drawn,) = self._functions[0][_CORE + 2](power, level)
        return level, drawn, power

    def _drawn(self, source: float, each: Outputs) -> float:
        """Return the current or flow that the fins consume from now on.

        Its mean since the last instant is stored, with the charges and mean powers of fins that store charge.
        """
        level, drawn, _ = self._shared(source, each)
        self._mean = drawn
        if not self._charges:
            return drawn
        drawn = self._mean = 0.0
        charges, powers, interval = [], [], self._line[-1]
        for core, f, outputs, before in zip(self.cores, self._functions, each, self._charges, strict=True):
            (current,) = f[_CORE + 2](outputs[self._power or 0], level)
            charge, ahead = f[_COURSE](interval, current, before, *core.state[-1])  # the plant's states there
            mean = (charge - before) / interval
            drawn += ahead
            self._mean += mean
            charges.append(charge)
            powers.append(level * mean)
        self._charges, self._powers = tuple(charges), tuple(powers)
        return drawn

    def _following(self, source: float, drawn: float) -> tuple[float, ...]:
        inductances = 0.0
        for f in self._functions:
            (inverse,) = f[_CORE + 5](self._line[-1])
            inductances += inverse
        return self._functions[0][_CORE + 3](*self._line, source, *self._of_line, drawn, self._mean, inductances)

    def _put_out(self, source: float, each: Outputs) -> tuple[Any, ...]:
        if self._power is None:
            return tuple(x for outputs in each for x in outputs)
        averaged = self._charges and not self._stiff
        if averaged:
            k = self._power
            each = [(*outputs[:k], power, *outputs[k + 1:]) for outputs, power in zip(each, self._powers, strict=True)]
        level, drawn, power = self._shared(source, each)
        return (level, self._mean if averaged else drawn, power, *(x for outputs in each for x in outputs))
