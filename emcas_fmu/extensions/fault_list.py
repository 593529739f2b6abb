"""The faults there are: names, parameters, what each needs, when it is active. Their order gives `fault_word`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator
from ..ops.base import Ops, Value
from ..variables import Variable, in_group, tunable

# Of a late command, in sample times: each is a state.
LONGEST_COMMAND_DELAY = 50
_SLACK = 1e-6  # of a sample time: a fault that begins at a sample begins with it, whatever rounding says


@dataclass(frozen=True)
class Fault:
    """One fault: what it is, how much of it, in parameters, and which capabilities it needs, any of them."""

    name: str
    description: str
    amounts: tuple[Variable, ...] = ()
    needs: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Return its switch, its schedule, and how much of it there is."""
        return in_group(
            f"fault.{self.name}",
            Variable("active", "Boolean", "parameter", "tunable", "", self.description),
            tunable("begin", "s", 0.0, 1e9, f"when {self.name} begins by schedule, from the start"),
            tunable("end", "s", 0.0, 1e9, f"when {self.name} ends by schedule (not after begin: never by schedule)"),
            *self.amounts)


FAULTS = (
    Fault("jam", "the screw is blocked"),
    Fault("free_fin", "the shaft is broken between fork and fin: the fin floats, for good",
          needs=(capabilities.SCREW_DRIVE,)),
    Fault("hard_over", "the controller's DAC puts out a constant", (
        tunable("share", "1", -1.0, 1.0, "of drive.reference_limit that the DAC puts out"),),
        (capabilities.REFERENCE_LIMIT, capabilities.COMMAND_REFERENCE)),
    Fault("drive_loss", "the drive's bridge is open, unknown to the controller"),
    Fault("current_derating", "the drive limits the current further", (
        tunable("share", "1", 0.0, 1.0, "of drive.current_limit that is left"),),
        (capabilities.CURRENT_LIMIT,)),
    Fault("brown_out", "the drive's supply sags", (
        tunable("share", "1", 0.0, 1.0, "of supply_voltage that is left"),),
        (capabilities.SUPPLY_VOLTAGE,)),
    Fault("encoder_freeze", "the encoder counts no motion"),
    Fault("encoder_bias", "the encoder reads too much", (
        tunable("angle", "rad", -0.5, 0.5, "of the fin that the encoder reads too much"),)),
    Fault("encoder_dropped", "the encoder misses counts of positive motion", (
        tunable("share", "1", 0.0, 1.0, "of the counts of positive motion that are missed"),)),
    Fault("encoder_reversed", "the encoder counts backwards"),
    Fault("command_freeze", "commands no longer arrive: the last one holds"),
    Fault("command_delay", "commands arrive late", (
        tunable("time", "s", 0.0, 5.0, "by which commands are late, in whole samples, at most "
                                                      f"{LONGEST_COMMAND_DELAY} of them"),)),
    Fault("friction_rise", "friction at motor and fin rises", (
        tunable("factor", "1", 1.0, 1e4, "by which it rises"),),
        (capabilities.SCREW_DRIVE,)),
    Fault("backlash_growth", "the gap between nut and fork grows, for good", (
        tunable("gap", "m", 0.0, 0.01, "by which it grows"),),
        (capabilities.BACKLASH,)),
)


def possible(actuator: Actuator) -> tuple[Fault, ...]:
    """Return the faults an actuator can have."""
    return tuple(fault for fault in FAULTS if not fault.needs or actuator.provides.intersection(fault.needs))


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
