"""Several cores that move together on one bus. Standard library only: it is embedded in the FMU.

fmi/fins.h is the same in C, and says how the bus is stepped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .core import MOST_TICKS, Core, Functions, Inputs

_CORE = 7  # of the functions, what a core takes; then mixing, then what the bus needs


class Bank:
    """Cores of several fins, with the interface of one.

    `functions` are the kernel's, bound to each fin's parameters. The inputs are a tuple for each fin, supplied
    by the source; the outputs those of the bus (voltage, current, power) and then fin by fin. `power` is the place of
    the supply's power among a fin's outputs, None of fins without a supply, which have no bus; `sizes` are a core's.
    """

    __slots__ = ("_current", "_instant", "_interval", "_inverse_inductance", "_next_sag", "_power", "_resistance",
                 "_sag", "_voltage", "cores")

    def __init__(self, functions: Sequence[Functions], resistance: float, interval: float, power: int | None,
                 sizes: tuple[int, ...]) -> None:
        self.cores = [Core(f[:_CORE], *sizes) for f in functions]
        self._resistance, self._interval, self._power = resistance, interval, power
        self._sag = 0.0
        self._instant = 1
        self._take(functions)

    def bind(self, functions: Sequence[Functions]) -> None:
        """Take the kernel's functions, anew after a tunable parameter changed."""
        for core, f in zip(self.cores, functions, strict=True):
            core.bind(f[:_CORE])
        self._take(functions)

    def _take(self, functions: Sequence[Functions]) -> None:
        if self._power is None:
            return
        self._voltage, self._current, self._next_sag, _ = functions[0][_CORE + 1:]
        self._inverse_inductance = 0.0
        for f in functions:
            (inverse,) = f[-1]()
            self._inverse_inductance += inverse

    @property
    def slack(self) -> float:
        """Tolerance of communication points [s]."""
        return min(core.slack for core in self.cores)

    @property
    def state(self) -> tuple[Any, ...]:
        """Everything that changes while running."""
        return (self._sag, self._instant, tuple(core.state for core in self.cores))

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        self._sag, self._instant, states = state
        for core, one in zip(self.cores, states, strict=True):
            core.state = one

    def outputs(self, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Outputs of the bus, then of the fins in the order of the variable table."""
        found = [core.outputs(self._supplied(i, self._sag)) for core, i in zip(self.cores, inputs, strict=True)]
        return self._put_out(inputs[0][4], found)

    def run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        """Move on to `end` [s] from the start with the inputs held, all or nothing; gives the outputs there.

        Raises ArithmeticError where the equations cannot be followed.
        """
        before = self.state
        try:
            return self._run(end, inputs)
        except BaseException:
            self.state = before
            raise

    def _run(self, end: float, inputs: Sequence[Inputs]) -> tuple[Any, ...]:
        stiff, slack = not self._resistance > 0.0, self.slack
        if not stiff and not end / self._interval - self._instant <= MOST_TICKS:
            raise ArithmeticError(f"a step to {end!r} s has more than {MOST_TICKS} instants of the bus")
        while True:
            instant = self._instant * self._interval
            # A host's clock may stand a little before an instant it means to have reached.
            meets = not stiff and instant <= end + slack
            until = instant if meets and instant < end else end
            found = [core.run(until, self._supplied(i, self._sag)) for core, i in zip(self.cores, inputs, strict=True)]
            source = inputs[0][4]
            if not meets:
                return self._put_out(source, found)
            (voltage,) = self._voltage(source, self._sag)
            (drawn,) = self._current(self._total(found), voltage)
            (sag,) = self._next_sag(self._resistance, self._sag, drawn, self._interval, self._inverse_inductance)
            if sag - sag != 0.0:
                raise ArithmeticError("the state is no longer finite")
            self._sag = sag
            self._instant += 1

    def _supplied(self, inputs: Inputs, sag: float) -> Inputs:
        if self._power is None:
            return inputs
        (voltage,) = self._voltage(inputs[4], sag)
        return (*inputs[:4], voltage, *inputs[5:])

    def _total(self, outputs: Sequence[Sequence[float]]) -> float:
        total = 0.0  # in C's order; sum() compensates from Python 3.12 on
        for each in outputs:
            total += each[self._power or 0]
        return total

    def _put_out(self, source: float, outputs: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        fins = tuple(x for each in outputs for x in each)
        if self._power is None:
            return fins
        (voltage,) = self._voltage(source, self._sag)
        power = self._total(outputs)
        (drawn,) = self._current(power, voltage)
        return (voltage, drawn, power, *fins)


Mix = Callable[..., tuple[float]]


def mixes(functions: Sequence[Functions]) -> list[Mix]:
    """Each fin's mixing of commands."""
    return [f[_CORE] for f in functions]
