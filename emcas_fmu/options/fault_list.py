"""The faults there are: names, parameters, when each is active. The order gives the bits of `fault_word`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

from ..consistency import LONGEST_COMMAND_DELAY
from ..ops.base import Ops, Value
from ..variables import Variable

_SLACK = 1e-6  # of a sample time: a fault that begins at a sample begins with it, whatever rounding says


def _tunable(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return Variable(f"fault.{name}", "Real", "parameter", "tunable", unit, description, minimum, maximum)


@dataclass(frozen=True)
class Fault:
    """One fault: what it is, and how much of it, in parameters of its own."""

    name: str
    description: str
    own: tuple[Variable, ...] = ()

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Its switch, its schedule, and how much."""
        active = Variable(f"fault.{self.name}.active", "Boolean", "parameter", "tunable", "", self.description)
        begin = f"when {self.name} begins by schedule, from the start"
        end = f"when {self.name} ends by schedule (not after begin: never by schedule)"
        return (active, _tunable(f"{self.name}.begin", "s", 0.0, 1e9, begin),
                _tunable(f"{self.name}.end", "s", 0.0, 1e9, end), *self.own)


FAULTS = (
    Fault("jam", "the screw is blocked"),
    Fault("free_fin", "the shaft is broken between fork and fin: the fin floats, for good"),
    Fault("hard_over", "the controller's DAC puts out a constant", (
        _tunable("hard_over.share", "1", -1.0, 1.0, "of drive.reference_limit that the DAC puts out"),)),
    Fault("drive_loss", "the drive's bridge is open, unknown to the controller"),
    Fault("current_derating", "the drive limits the current further", (
        _tunable("current_derating.share", "1", 0.0, 1.0, "of drive.current_limit that is left"),)),
    Fault("brown_out", "the drive's supply sags", (
        _tunable("brown_out.share", "1", 0.0, 1.0, "of supply_voltage that is left"),)),
    Fault("encoder_freeze", "the encoder counts no motion"),
    Fault("encoder_bias", "the encoder reads too much", (
        _tunable("encoder_bias.angle", "rad", -0.5, 0.5, "of the fin that the encoder reads too much"),)),
    Fault("encoder_dropped", "the encoder misses counts of positive motion", (
        _tunable("encoder_dropped.share", "1", 0.0, 1.0, "of the counts of positive motion that are missed"),)),
    Fault("encoder_reversed", "the encoder counts backwards"),
    Fault("command_freeze", "commands no longer arrive: the last one holds"),
    Fault("command_delay", "commands arrive late", (
        _tunable("command_delay.time", "s", 0.0, 5.0, "by which commands are late, in whole samples, at most "
                                                      f"{LONGEST_COMMAND_DELAY} of them"),)),
    Fault("friction_rise", "friction at motor and fin rises", (
        _tunable("friction_rise.factor", "1", 1.0, 1e4, "by which it rises"),)),
    Fault("backlash_growth", "the gap between nut and fork grows, for good", (
        _tunable("backlash_growth.gap", "m", 0.0, 0.01, "by which it grows"),)),
)
PARAMETERS = tuple(v for fault in FAULTS for v in fault.parameters)


def active(ops: Ops, p: Any, time: Value) -> dict[str, Value]:
    """Whether each fault is active at a sample at `time` [s] from the start: switched on, or scheduled."""
    late = time + _SLACK * p.controller.sample_time

    def now(name: str) -> Value:
        own = getattr(p.fault, name)
        return ops.either(own.active, ops.both(late >= own.begin, late < own.end))

    return {fault.name: now(fault.name) for fault in FAULTS}


def word(ops: Ops, on: dict[str, Value]) -> Value:
    """A bit for each active fault, the first in FAULTS the least."""
    return reduce(lambda sum_, i: sum_ + ops.where(on[FAULTS[i].name], float(2**i), 0.0), range(len(FAULTS)), 0.0)
