"""The faults there are: names, parameters, what each needs, when it is active. Their order gives `fault_word`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator
from ..ops.base import Ops, Value
from ..variables import Variable, tunable

# Of a late command, in sample times: each is a state.
LONGEST_COMMAND_DELAY = 50
_SLACK = 1e-6  # of a sample time: a fault that begins at a sample begins with it, whatever rounding says


def _amount(name: str, unit: str, minimum: float, maximum: float, description: str) -> Variable:
    return tunable(f"fault.{name}", unit, minimum, maximum, description)


@dataclass(frozen=True)
class Fault:
    """One fault: what it is, how much of it, in parameters, and which capabilities it needs, any of them."""

    name: str
    description: str
    amounts: tuple[Variable, ...] = ()
    needs: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Its switch, its schedule, and how much."""
        active = Variable(f"fault.{self.name}.active", "Boolean", "parameter", "tunable", "", self.description)
        begin = f"when {self.name} begins by schedule, from the start"
        end = f"when {self.name} ends by schedule (not after begin: never by schedule)"
        return (active, _amount(f"{self.name}.begin", "s", 0.0, 1e9, begin),
                _amount(f"{self.name}.end", "s", 0.0, 1e9, end), *self.amounts)

    def possible(self, actuator: Actuator) -> bool:
        """Return whether an actuator can have this fault."""
        return not self.needs or bool(actuator.provides.intersection(self.needs))


FAULTS = (
    Fault("jam", "the screw is blocked"),
    Fault("free_fin", "the shaft is broken between fork and fin: the fin floats, for good",
          needs=(capabilities.SCREW_DRIVE,)),
    Fault("hard_over", "the controller's DAC puts out a constant", (
        _amount("hard_over.share", "1", -1.0, 1.0, "of drive.reference_limit that the DAC puts out"),),
        (capabilities.REFERENCE_LIMIT, capabilities.COMMAND_REFERENCE)),
    Fault("drive_loss", "the drive's bridge is open, unknown to the controller"),
    Fault("current_derating", "the drive limits the current further", (
        _amount("current_derating.share", "1", 0.0, 1.0, "of drive.current_limit that is left"),),
        (capabilities.CURRENT_LIMIT,)),
    Fault("brown_out", "the drive's supply sags", (
        _amount("brown_out.share", "1", 0.0, 1.0, "of supply_voltage that is left"),),
        (capabilities.SUPPLY_VOLTAGE,)),
    Fault("encoder_freeze", "the encoder counts no motion"),
    Fault("encoder_bias", "the encoder reads too much", (
        _amount("encoder_bias.angle", "rad", -0.5, 0.5, "of the fin that the encoder reads too much"),)),
    Fault("encoder_dropped", "the encoder misses counts of positive motion", (
        _amount("encoder_dropped.share", "1", 0.0, 1.0, "of the counts of positive motion that are missed"),)),
    Fault("encoder_reversed", "the encoder counts backwards"),
    Fault("command_freeze", "commands no longer arrive: the last one holds"),
    Fault("command_delay", "commands arrive late", (
        _amount("command_delay.time", "s", 0.0, 5.0, "by which commands are late, in whole samples, at most "
                                                      f"{LONGEST_COMMAND_DELAY} of them"),)),
    Fault("friction_rise", "friction at motor and fin rises", (
        _amount("friction_rise.factor", "1", 1.0, 1e4, "by which it rises"),),
        (capabilities.SCREW_DRIVE,)),
    Fault("backlash_growth", "the gap between nut and fork grows, for good", (
        _amount("backlash_growth.gap", "m", 0.0, 0.01, "by which it grows"),),
        (capabilities.BACKLASH,)),
)


def possible(actuator: Actuator) -> tuple[Fault, ...]:
    """Return the faults an actuator can have."""
    return tuple(fault for fault in FAULTS if fault.possible(actuator))


def active(ops: Ops, p: Any, faults: tuple[Fault, ...], time: Value) -> dict[str, Value]:
    """Return whether each fault is active at a sample at `time` [s] from the start: switched on, or scheduled.

    Those that an actuator cannot have are not.
    """
    late = time + _SLACK * p.controller.sample_time

    def now(name: str) -> Value:
        fault = getattr(p.fault, name)
        return ops.either(fault.active, ops.both(late >= fault.begin, late < fault.end))

    return {**{fault.name: False for fault in FAULTS}, **{fault.name: now(fault.name) for fault in faults}}


def word(ops: Ops, faults: tuple[Fault, ...], on: Mapping[str, Value]) -> Value:
    """Return a bit for each active fault, the first in FAULTS the least."""
    return reduce(lambda total, fault: total + ops.where(on[fault.name], float(2**FAULTS.index(fault)), 0.0), faults,
                  0.0)
