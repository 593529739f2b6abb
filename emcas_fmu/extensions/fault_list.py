"""All faults: names, parameters, needed capabilities, and when they are active. Their order is that in `fault_word`.

The general ones come first, then those that an actuator declares for its kind
(:class:`emcas_fmu.actuators.declaration.PlantFault`); one with the name of a general fault replaces that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

from ..actuators import capabilities
from ..actuators.declaration import Actuator, PlantFault
from ..errors import EmcasError
from ..ops.base import Ops, Value
from ..variables import Variable, in_group, tunable

# Longest delay of a command, in sample times: each needs a state.
LONGEST_COMMAND_DELAY = 50
MOST = 31  # bits of an Integer
_SLACK = 1e-6  # of a sample time: rounding does not delay a fault that begins at a sample


@dataclass(frozen=True)
class Fault:
    """A general fault: its description, the parameters of its amount, and its needs: one of these capabilities, and a
    supply for one `of_supply`."""

    name: str
    description: str
    amounts: tuple[Variable, ...] = ()
    needs: tuple[str, ...] = ()
    of_supply: bool = False


FAULTS = (
    Fault("jam", "the drive line is blocked"),
    Fault("free_fin", "the shaft is broken between fork and fin: the fin floats, permanently",
          needs=(capabilities.SCREW_DRIVE,)),
    Fault("hard_over", "the controller's DAC puts out a constant", (
        tunable("share", "1", -1.0, 1.0, "of drive.reference_limit that the DAC puts out"),),
        (capabilities.REFERENCE_LIMIT, capabilities.COMMAND_REFERENCE)),
    Fault("drive_loss", "the drive's bridge is open, unknown to the controller"),
    Fault("current_derating", "the drive limits the current further", (
        tunable("share", "1", 0.0, 1.0, "of drive.current_limit that is left"),),
        (capabilities.CURRENT_LIMIT,)),
    Fault("brown_out", "the drive's supply sags", (
        tunable("share", "1", 0.0, 1.0, "of the supply that is left"),), of_supply=True),
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
    Fault("backlash_growth", "the gap in the drive line grows permanently by wear", (
        tunable("gap", "m", 0.0, 0.01, "by which it grows"),),
        (capabilities.BACKLASH,)),
)


def general(actuator: Actuator) -> tuple[Fault, ...]:
    """Return the general faults that an actuator can have and does not replace by one of its kind."""
    declared = {fault.name for fault in actuator.faults}
    return tuple(fault for fault in FAULTS if fault.name not in declared
                 and (not fault.needs or actuator.provides.intersection(fault.needs))
                 and (not fault.of_supply or actuator.supply is not None))


def possible(actuator: Actuator) -> tuple[Fault | PlantFault, ...]:
    """Return the faults an actuator can have, in the order of their bits."""
    faults: tuple[Fault | PlantFault, ...] = (*general(actuator), *actuator.faults)
    there = {fault.name: fault for fault in faults}
    return tuple(there[name] for name in bits(actuator) if name in there)


def bits(actuator: Actuator) -> tuple[str, ...]:
    """Return the names of the bits of an actuator's `fault_word`, the least first: all general faults, then those of
    its kind. Raises EmcasError for more than there are bits."""
    faults: tuple[Fault | PlantFault, ...] = (*FAULTS, *actuator.faults)
    names = tuple(dict.fromkeys(fault.name for fault in faults))
    if len(names) > MOST:
        raise EmcasError(f"actuator {actuator.name}: {len(actuator.faults)} faults are declared; fault_word has room "
                         f"for {MOST - len(FAULTS)} beside the general ones")
    return names


def parameters(fault: Fault | PlantFault) -> tuple[Variable, ...]:
    """Return the parameters of a fault: its switch, its schedule and its amounts."""
    return in_group(
        f"fault.{fault.name}",
        Variable("active", "Boolean", "parameter", "tunable", "", fault.description, start=False),
        *(replace(tunable(name, "s", 0.0, 1e9, described), start=0.0) for name, described in (
            ("begin", f"when {fault.name} begins by schedule, from the start"),
            ("end", f"when {fault.name} ends by schedule (not after begin: never by schedule)"))),
        *fault.amounts)


def active(ops: Ops, p: Any, faults: Iterable[Fault | PlantFault], time: Value) -> dict[str, Value]:
    """Return by name whether a fault is active at a sample at `time` [s] from the start: switched on, or scheduled."""
    late = time + _SLACK * p.controller.sample_time

    def now(name: str) -> Value:
        fault = getattr(p.fault, name)
        return ops.either(fault.active, ops.both(late >= fault.begin, late < fault.end))

    return {fault.name: now(fault.name) for fault in faults}


def word(ops: Ops, names: tuple[str, ...], on: Mapping[str, Value]) -> Value:
    """Return the word with a bit, by :func:`bits`, for each active fault that the actuator can have."""
    return reduce(lambda total, name: total + ops.where(on[name], float(2**names.index(name)), 0.0),
                  (name for name in names if name in on), 0.0)
