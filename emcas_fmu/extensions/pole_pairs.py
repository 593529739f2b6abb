"""Rule for the pole pairs of a motor, for which actuator, faults and inverter have a parameter each."""

from __future__ import annotations

from typing import Any

from ..namespace import value_of
from ..ops.base import Ops, Value
from ..rules import Rule, rule, when


def one_motor(first: str, second: str) -> Rule:
    """Return the rule that warns if two parameters differ, unless one is 0 or belongs to a fault that is not active."""
    @rule(f"{first} = %.6g and {second} = %.6g belong to the same motor: set both to the same number, or one to 0 "
          "to leave its effect out", warning=True)
    def check(ops: Ops, p: Any, _: Value) -> tuple[Value, ...]:
        one, other = value_of(p, first), value_of(p, second)
        act = ops.both(_acts(ops, p, first), _acts(ops, p, second))
        return when(ops, ops.both(act, ops.negate(ops.equal(one, other)))), one, other

    return check


def _acts(ops: Ops, p: Any, name: str) -> Value:
    """Return whether a number of pole pairs has an effect: that of a fault if it is switched on or scheduled."""
    has = value_of(p, name) > 0.0
    fault = name.rpartition(".")[0]
    if not fault.startswith("fault."):
        return has
    active, begin, end = (value_of(p, f"{fault}.{each}") for each in ("active", "begin", "end"))
    return ops.both(has, ops.either(active, end > begin))
